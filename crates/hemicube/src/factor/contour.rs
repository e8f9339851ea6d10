//! Form factors between triangles near each other: the double contour integral (Sparrow 1963). The inner integral has a
//! closed form, and between edges on parallel or meeting lines so has the outer one; the rest is adaptive quadrature
//! along one edge.
//!
//! ```text
//! A_i F_ij = 1/(2π) ∮_i ∮_j ln r  dr_i · dr_j
//! ```
//!
//! holds where each triangle lies in front of the other's plane, so both are cut there first: surfaces that cross, and
//! walls that end on a floor, are then like any others. Nothing is singular where the two touch. In architecture most
//! edges are parallel or at right angles to each other, and the result is exact but for rounding.
//!
//! No quadrature over areas for near pairs, because plates a hair apart have factors like steps; the contour integral
//! is smooth there, and where edges are parallel or at right angles it is exact.

use super::GAUSS;
use super::lanes::{LANES, angle_portable as angle};
use crate::geometry::{self, in_front};
use crate::simd::{InstructionSet, dispatch};
use crate::steps;
use glam::DVec3;

/// Precision of a contour integral.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Precision {
    /// Error as a share of the smaller triangle's area, to begin with.
    pub(crate) absolute: f64,
    /// Error as a share of the value: between nearly coplanar triangles, terms of the size of the area cancel.
    pub(crate) relative: f64,
    /// Least error worth more effort, in areas of the smaller triangle.
    pub(crate) least: f64,
}

impl Precision {
    /// Relative to the area and to the value, however small it is.
    pub(crate) const fn of_both(absolute: f64, relative: f64) -> Self {
        Self {
            absolute,
            relative,
            least: 1e-14,
        }
    }

    /// Tolerances near rounding: differences of a quadrature that is four to eight digits rougher than the result.
    pub(crate) const fn exact() -> Self {
        Self {
            absolute: 1e-9,
            relative: 1e-10,
            least: 1e-13,
        }
    }

    /// Relative to the area only.
    pub(crate) const fn of_area(share: f64) -> Self {
        Self {
            absolute: share,
            relative: 0.0,
            least: share,
        }
    }
}

/// The exchange area A_i F_ij to a precision. The order of the arguments matters in the last bits.
pub(crate) fn exchange(outer: &[DVec3; 3], inner: &[DVec3; 3], precision: Precision) -> f64 {
    steps::add(STEPS_AN_EXCHANGE);
    let origin = outer[0];
    let size = outer
        .iter()
        .chain(inner)
        .map(|p| p.distance_squared(origin))
        .fold(0.0, f64::max)
        .sqrt();
    if size == 0.0 {
        return 0.0;
    }
    // Logarithms of numbers near 1: a common factor falls out of a closed contour, but not out of its rounding.
    let scale = 1.0 / size;
    let local = |t: &[DVec3; 3]| t.map(|p| (p - origin) * scale);
    let (outer, inner) = (local(outer), local(inner));
    let normal = |t: &[DVec3; 3]| geometry::cross(t).try_normalize();
    let (Some(outer_normal), Some(inner_normal)) = (normal(&outer), normal(&inner)) else {
        return 0.0;
    };
    let (Some(first), Some(second)) = (
        in_front(&outer, inner[0], inner_normal, ON_PLANE),
        in_front(&inner, outer[0], outer_normal, ON_PLANE),
    ) else {
        return 0.0;
    };
    let mut closed = Closed::new();
    let mut skew: [Option<Skew>; 16] = [None; 16];
    let mut skew_count = 0;
    for (a, b) in first.edges() {
        let Some(u) = (b - a).try_normalize() else { continue };
        for (c, d) in second.edges() {
            let Some(v) = (d - c).try_normalize() else { continue };
            let cosine = u.dot(v);
            if cosine.abs() < RIGHT_ANGLE {
                continue;
            }
            // Make both point the same way.
            let ((c, d), v) = if cosine < 0.0 { ((d, c), -v) } else { ((c, d), v) };
            let (p, q) = (Edge::new(a, b, u), Edge::new(c, d, v));
            let comparable = p.length > COMPARABLE * q.length;
            if comparable && u.cross(v).length_squared() < PARALLEL {
                closed.add_parallel(&p, &q, cosine);
            } else if let Some(apex) = apex(&p, &q) {
                closed.add_meeting(&p, &q, apex, cosine);
            } else {
                skew[skew_count] = Some(Skew { p, q, cosine });
                skew_count += 1;
            }
        }
    }
    let closed = closed.sum();
    let area = geometry::area(&outer);
    let whole = area * std::f64::consts::TAU;
    let (mut enough, least) = (precision.absolute * whole, precision.least * whole);
    let sum = loop {
        let (mut sum, mut error) = (closed, 0.0);
        for Skew { p, q, cosine } in skew[..skew_count].iter().flatten() {
            let part = along_skew(p, q, enough / (9.0 * cosine.abs()));
            sum += cosine * part.sum;
            error += cosine.abs() * part.difference;
        }
        // Differences of a much rougher quadrature: if they are small enough, the error is much smaller.
        if error <= precision.relative * sum || enough <= least {
            break sum;
        }
        enough = (precision.relative * sum)
            .min(1e-1 * enough)
            .max(1e-3 * enough)
            .max(least);
    };
    let exchange = sum * size * size / std::f64::consts::TAU;
    if exchange > 0.0 { exchange } else { 0.0 }
}

/// An edge: its ends, its direction and its length.
#[derive(Clone, Copy, Debug)]
struct Edge {
    start: DVec3,
    end: DVec3,
    along: DVec3,
    length: f64,
}

impl Edge {
    fn new(start: DVec3, end: DVec3, along: DVec3) -> Self {
        Self {
            start,
            end,
            along,
            length: start.distance(end),
        }
    }
}

/// Two edges without a closed form, and the cosine between them.
#[derive(Clone, Copy, Debug)]
struct Skew {
    p: Edge,
    q: Edge,
    cosine: f64,
}

/// The coordinates of two edges' starts along their lines, from the point at which these meet.
#[derive(Clone, Copy, Debug)]
struct FromApex {
    p: f64,
    q: f64,
}

/// Finds the point at which the lines of two edges meet; `None` if they do not, or far from both.
fn apex(p: &Edge, q: &Edge) -> Option<FromApex> {
    // Common corners first: no angle is too small for them.
    for (corner, s) in [(p.start, 0.0), (p.end, -p.length)] {
        for (other, t) in [(q.start, 0.0), (q.end, -q.length)] {
            if corner.distance_squared(other) <= ON_PLANE * ON_PLANE {
                return Some(FromApex { p: s, q: t });
            }
        }
    }
    let cosine = p.along.dot(q.along);
    let sine_squared = p.along.cross(q.along).length_squared();
    if sine_squared < SLENDER {
        return None;
    }
    let between = q.start - p.start;
    let (on_p, on_q) = (between.dot(p.along), between.dot(q.along));
    let s = (on_p - cosine * on_q) / sine_squared;
    let t = (cosine * on_p - on_q) / sine_squared;
    let gap = between + q.along * t - p.along * s;
    let ratio = p.length.min(q.length) / p.length.max(q.length);
    let (reaches, meet) = if ratio < COMPARABLE {
        // The pair's exchange area is of the order of the short edge squared, and so must be what is lost.
        ([p.length, q.length], MEET * ratio)
    } else {
        ([p.length + q.length; 2], MEET)
    };
    let [reach_p, reach_q] = reaches.map(|reach| MEETING_REACH * reach);
    let meets = gap.length_squared() <= meet * meet && s.abs() <= reach_p && t.abs() <= reach_q;
    meets.then_some(FromApex { p: -s, q: -t })
}

/// Distance of lines, in units of the pair's extent, below which they meet: the error is its square.
const MEET: f64 = 1e-8;
/// Squared sine of the least angle between lines with a well-known meeting point.
const SLENDER: f64 = 1e-4;
/// Distance of an apex, in lengths of the edges, beyond which the closed form would lose its digits: a term of an
/// edge's end has the apex' distance as its weight, and the terms of both ends differ by the edge's length.
const MEETING_REACH: f64 = 4.0;

/// Closed forms to be evaluated, eight at a time.
struct Closed {
    sum: f64,
    segments: Segments,
    weights: [f64; LANES],
    filled: usize,
    quadratics: Quadratics,
    quadratic_weights: [f64; LANES],
    quadratics_filled: usize,
}

impl Closed {
    fn new() -> Self {
        Self {
            sum: 0.0,
            segments: Segments::new(),
            weights: [0.0; LANES],
            filled: 0,
            quadratics: Quadratics {
                x: [0.0; LANES],
                h: [0.0; LANES],
            },
            quadratic_weights: [0.0; LANES],
            quadratics_filled: 0,
        }
    }

    /// ∫∫ ln r over two parallel edges that point the same way.
    ///
    /// With x = t − s along both and h the distance of their lines, the second difference of Q, Q'' = ½ ln (h² + x²).
    fn add_parallel(&mut self, p: &Edge, q: &Edge, cosine: f64) {
        let (from, to) = (q.start - p.start, q.end - p.start);
        let (start, end) = (p.along.dot(from), p.along.dot(to));
        let h = (from.cross(p.along).length() + to.cross(p.along).length()) * 0.5;
        for (x, sign) in [
            (end, 1.0),
            (start, -1.0),
            (end - p.length, -1.0),
            (start - p.length, 1.0),
        ] {
            let l = self.quadratics_filled;
            (self.quadratics.x[l], self.quadratics.h[l]) = (x, h);
            self.quadratic_weights[l] = sign * cosine;
            self.quadratics_filled += 1;
            if self.quadratics_filled == LANES {
                self.flush_quadratics();
            }
        }
    }

    /// ∫∫ ln r over two edges with lines that meet, s and t the coordinates of their starts.
    ///
    /// r is homogeneous in the two coordinates x = (s, t): div (x ln r) = 2 ln r + 1. By Gauss's theorem,
    /// ∫∫ ln r = ½ (∮ ln r x·n − s-length × t-length): from each edge's ends along the other.
    fn add_meeting(&mut self, p: &Edge, q: &Edge, from: FromApex, cosine: f64) {
        let FromApex { p: s, q: t } = from;
        self.add_segment(p.start, q, -0.5 * cosine * s);
        self.add_segment(p.end, q, 0.5 * cosine * (s + p.length));
        self.add_segment(q.start, p, -0.5 * cosine * t);
        self.add_segment(q.end, p, 0.5 * cosine * (t + q.length));
        self.sum -= 0.5 * cosine * p.length * q.length;
    }

    fn add_segment(&mut self, point: DVec3, edge: &Edge, weight: f64) {
        if weight == 0.0 {
            return;
        }
        self.segments.set(self.filled, point, edge);
        self.weights[self.filled] = weight;
        self.filled += 1;
        if self.filled == LANES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let values = along(&self.segments);
        for (value, weight) in values.iter().zip(&self.weights[..self.filled]) {
            self.sum += weight * value;
        }
        self.filled = 0;
    }

    fn flush_quadratics(&mut self) {
        let values = quadratics(&self.quadratics);
        for (value, weight) in values.iter().zip(&self.quadratic_weights[..self.quadratics_filled]) {
            self.sum += weight * value;
        }
        self.quadratics_filled = 0;
    }

    fn sum(mut self) -> f64 {
        if self.filled > 0 {
            self.flush();
        }
        if self.quadratics_filled > 0 {
            self.flush_quadratics();
        }
        self.sum
    }
}

/// Distance from a plane that counts as on it, in units of the pair's extent.
const ON_PLANE: f64 = 1e-13;
/// Cosine below which a right angle is off by rounding only.
const RIGHT_ANGLE: f64 = 1e-14;
/// Squared sine below which edges are parallel: over a length of 1, less than 1e-9 nearer at one end.
const PARALLEL: f64 = 1e-18;

/// Ratio of lengths below which the differences of a closed form would lose their digits.
const COMPARABLE: f64 = 1e-3;

/// An integral over two edges.
#[derive(Clone, Copy, Debug, Default)]
struct Quadrature {
    sum: f64,
    /// Sum of the last halvings' differences.
    difference: f64,
    /// Number of halvings.
    halvings: u32,
}

/// ∫∫ ln r over two edges, to within `enough` or rounding.
fn along_skew(p: &Edge, q: &Edge, enough: f64) -> Quadrature {
    let mut segments = Segments::new();
    for l in 0..LANES {
        segments.set(l, DVec3::ZERO, q);
    }
    let mut over = |start: f64, width: f64| {
        for (l, &(x, _)) in GAUSS.iter().enumerate() {
            let point = p.start + (p.end - p.start) * (start + width * x);
            for k in 0..3 {
                segments.point[k][l] = point[k];
            }
        }
        let values = along(&segments);
        let mut sum = 0.0;
        for (value, &(_, weight)) in values.iter().zip(&GAUSS) {
            sum += value * weight;
        }
        sum * width * p.length
    };
    // Below its own rounding a difference says nothing, and halving would go on for ever. The inner integral is the
    // difference of two values as large as the distance of its edge's ends: a short edge is no surer.
    let reach = [p.start, p.end]
        .iter()
        .flat_map(|a| [a.distance_squared(q.start), a.distance_squared(q.end)])
        .fold(q.length * q.length, f64::max)
        .sqrt();
    let enough = enough.max(ROUNDING * p.length * reach);
    // One half of each halving waits while the other is halved.
    let mut pending = [(0.0, 0.0, 0.0, 0u32); DEEPEST as usize + 2];
    pending[0] = (0.0, 1.0, over(0.0, 1.0), 0);
    let mut count = 1;
    let mut all = Quadrature::default();
    while count > 0 {
        count -= 1;
        let (start, width, whole, depth) = pending[count];
        let half = 0.5 * width;
        let (left, right) = (over(start, half), over(start + half, half));
        let difference = (left + right - whole).abs();
        all.halvings += 1;
        if depth >= DEEPEST || difference <= enough {
            all.sum += left + right;
            all.difference += difference;
        } else {
            pending[count] = (start, half, left, depth + 1);
            pending[count + 1] = (start + half, half, right, depth + 1);
            count += 2;
        }
    }
    all
}

/// Rounding of an integral over two edges, in their lengths.
const ROUNDING: f64 = 2e-15;

/// Bound of the halvings of an edge: to 1e-12 of it.
const DEEPEST: u32 = 40;

/// Eight points, each with an edge to integrate along.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Segments {
    point: [[f64; LANES]; 3],
    start: [[f64; LANES]; 3],
    along: [[f64; LANES]; 3],
    length: [f64; LANES],
}

impl Segments {
    const fn new() -> Self {
        Self {
            point: [[0.0; LANES]; 3],
            start: [[0.0; LANES]; 3],
            along: [[0.0; LANES]; 3],
            length: [0.0; LANES],
        }
    }

    fn set(&mut self, lane: usize, point: DVec3, edge: &Edge) {
        for k in 0..3 {
            self.point[k][lane] = point[k];
            self.start[k][lane] = edge.start[k];
            self.along[k][lane] = edge.along[k];
        }
        self.length[lane] = edge.length;
    }
}

/// Arguments of Q.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Quadratics {
    x: [f64; LANES],
    h: [f64; LANES],
}

/// Q = ¼ (x² − h²) ln (h² + x²) − ¾ x² + h x atan (x/h): its second derivative in x is ½ ln (h² + x²).
fn quadratics(at: &Quadratics) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    quadratics_by(InstructionSet::widest(), at, &mut out);
    out
}

dispatch! {
    fn quadratics_by = quadratics_portable(at: &Quadratics, out: &mut [f64; LANES])
}

#[inline(always)]
fn quadratics_portable(at: &Quadratics, out: &mut [f64; LANES]) {
    for l in 0..LANES {
        let (x, h) = (at.x[l], at.h[l]);
        let squared = h * h + x * x;
        out[l] = 0.25 * (x * x - h * h) * logarithm(squared) - 0.75 * x * x + h * x.abs() * angle(x.abs(), h);
    }
}

/// Steps of an exchange area without integrals along edges, and of eight of these integrals. Measured.
const STEPS_AN_EXCHANGE: u64 = 700;
const STEPS_ALONG: u64 = 70;

/// ∫ ln r from each point along the edge: ½ t ln (h² + t²) − t + h atan (t/h) between its ends, t along the edge and h
/// the distance of its line.
fn along(points: &Segments) -> [f64; LANES] {
    steps::add(STEPS_ALONG);
    let mut out = [0.0; LANES];
    along_by(InstructionSet::widest(), points, &mut out);
    out
}

dispatch! {
    fn along_by = along_portable(points: &Segments, out: &mut [f64; LANES])
}

#[inline(always)]
fn along_portable(points: &Segments, out: &mut [f64; LANES]) {
    for l in 0..LANES {
        let u = [points.along[0][l], points.along[1][l], points.along[2][l]];
        let length = points.length[l];
        let d = [
            points.start[0][l] - points.point[0][l],
            points.start[1][l] - points.point[1][l],
            points.start[2][l] - points.point[2][l],
        ];
        let t = d[0] * u[0] + d[1] * u[1] + d[2] * u[2];
        let c = [
            d[1] * u[2] - d[2] * u[1],
            d[2] * u[0] - d[0] * u[2],
            d[0] * u[1] - d[1] * u[0],
        ];
        let squared = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
        let h = squared.sqrt();
        let end = t + length;
        let between = angle(h * length, squared + t * end);
        out[l] = 0.5 * (end * logarithm(squared + end * end) - t * logarithm(squared + t * t)) - length + h * between;
    }
}

/// ln max(x, 1e-300): x = 2^e m with m in [√½, √2), ln m = 2 artanh ((m − 1)/(m + 1)) by its series; the first term
/// left out is below 1e-18.
#[inline(always)]
pub(crate) fn logarithm(x: f64) -> f64 {
    let x = if x > 1e-300 { x } else { 1e-300 };
    let bits = x.to_bits();
    // The exponent as a float without a conversion that AVX2 lacks.
    let exponent = f64::from_bits(0x4330_0000_0000_0000 | (bits >> 52)) - (4_503_599_627_370_496.0 + 1023.0);
    let mantissa = f64::from_bits((bits & 0x000F_FFFF_FFFF_FFFF) | 0x3FF0_0000_0000_0000);
    let large = mantissa > std::f64::consts::SQRT_2;
    let m = if large { 0.5 * mantissa } else { mantissa };
    let e = if large { exponent + 1.0 } else { exponent };
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let mut p = 1.0 / 23.0;
    for k in (0..11).rev() {
        p = p * q + SERIES[k];
    }
    e * std::f64::consts::LN_2 + 2.0 * s * p
}

const SERIES: [f64; 11] = [
    1.0,
    1.0 / 3.0,
    1.0 / 5.0,
    1.0 / 7.0,
    1.0 / 9.0,
    1.0 / 11.0,
    1.0 / 13.0,
    1.0 / 15.0,
    1.0 / 17.0,
    1.0 / 19.0,
    1.0 / 21.0,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::point_to_triangle;
    use proptest::prelude::*;

    #[test]
    fn logarithms_are_those_of_the_library() {
        for k in -600..600 {
            for m in [1.0, 1.1, 1.414, 1.5, 1.99] {
                let x = m * 2f64.powi(k);
                let exact = x.ln();
                assert!((logarithm(x) - exact).abs() <= 4e-16 * exact.abs().max(1.0), "{x}");
            }
        }
        assert_eq!(logarithm(0.0), logarithm(1e-300));
    }

    fn precision(share: f64) -> Precision {
        Precision::of_both(share, share)
    }

    /// The contour integral's value by the mean of point factors over fine pieces of the outer triangle.
    fn by_area(outer: &[DVec3; 3], inner: &[DVec3; 3], n: u32) -> f64 {
        let cross = (outer[1] - outer[0]).cross(outer[2] - outer[0]);
        let points = crate::frame::sample_points(*outer, n);
        let sum: f64 = points
            .iter()
            .map(|&p| point_to_triangle(p, cross.normalize(), inner))
            .sum();
        0.5 * cross.length() * sum / f64::from(n * n)
    }

    fn p(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn plates_a_hair_apart() {
        // Two triangles of area ½ that overlap in a half of the unit square's half: F is the overlap's share.
        let low = [p(0., 0., 0.), p(1., 0., 0.), p(0., 1., 0.)];
        for gap in [1e-4, 1e-6, 1e-9] {
            let high = [p(0.5, 0., gap), p(0.5, 1., gap), p(1.5, 0., gap)];
            let found = exchange(&low, &high, precision(1e-8));
            assert!((found - 0.125).abs() < 2.0 * gap + 1e-7, "{gap}: {found}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Asked for what rounding does not allow, a quadrature must stop there: it once halved short edges far from
        /// long ones for minutes.
        #[test]
        fn quadratures_end_at_their_rounding(
            lengths in prop::array::uniform2(-9.0..0.0f64),
            apart in -9.0..0.0f64,
            directions in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
        ) {
            let unit = |d: [f64; 3]| DVec3::from_array(d).try_normalize().unwrap_or(DVec3::X);
            let [along_p, along_q, away] = directions.map(unit);
            let [p_length, q_length] = lengths.map(|e| 10f64.powf(e));
            // Each goes through a point of its own, somewhere near its middle.
            let edge = |middle: DVec3, along: DVec3, length: f64| {
                Edge::new(middle - along * (0.4 * length), middle + along * (0.6 * length), along)
            };
            let p = edge(DVec3::ZERO, along_p, p_length);
            let q = edge(away * 10f64.powf(apart), along_q, q_length);
            let all = along_skew(&p, &q, 0.0);
            prop_assert!(all.sum.is_finite());
            prop_assert!(all.halvings < 1000, "{}", all.halvings);
        }
    }

    #[test]
    fn a_wall_through_the_floor_counts_above_it_only() {
        let floor = [p(-1., -1., 0.), p(2., -1., 0.), p(-1., 2., 0.)];
        let wall = [p(0., 0., -1.), p(0., 1., 0.5), p(0., 0., 0.5)];
        let above = [p(0., 2. / 3., 0.), p(0., 1., 0.5), p(0., 0., 0.5)];
        let rest = [p(0., 0., 0.), p(0., 2. / 3., 0.), p(0., 0., 0.5)];
        // The floor is cut too: only what lies in front of the wall sees it.
        let whole = exchange(&wall, &floor, precision(1e-9));
        let parts = exchange(&above, &floor, precision(1e-9)) + exchange(&rest, &floor, precision(1e-9));
        assert!((whole - parts).abs() < 1e-8, "{whole} {parts}");
        assert!(whole > 0.01);
    }

    /// A grain of a tenth of a millimetre, as high above a plain of ten kilometres: lines of their edges pass each
    /// other within the grain's size. Taken to meet, they made the factor 0.9616.
    #[test]
    fn a_grain_sees_a_plain_as_its_points_do() {
        let plain = [p(-5e3, -5e3, 0.), p(5e3, -5e3, 0.), p(5e3, 5e3, 0.)];
        let grain = [
            p(12.0000908, 6.999875, 1.24471742e-4),
            p(12.000125, 6.99990918, 1.24471742e-4),
            p(12.0002378, 6.99982725, 1.95491503e-4),
        ];
        let area = crate::geometry::area(&grain);
        let points = by_area(&grain, &plain, 16) / area;
        assert!((points - 0.944_356).abs() < 1e-4, "{points}");
        for precision in [Precision::of_both(1e-4, 2e-3), Precision::of_both(3e-5, 6e-4)] {
            let found = exchange(&grain, &plain, precision) / area;
            assert!((found - points).abs() < 5e-4, "{found}, by points {points}");
        }
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array))
            .prop_filter("slivers", |t| (t[1] - t[0]).cross(t[2] - t[0]).length() > 0.1)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn contours_give_what_areas_give(i in triangle(), j in triangle()) {
            // Points on one triangle do not integrate what happens where it crosses the other.
            if crate::factor::is_cut(&i, &j) || crate::factor::is_cut(&j, &i) {
                return Ok(());
            }
            let found = exchange(&i, &j, precision(1e-7));
            let fine = by_area(&i, &j, 96);
            let area = crate::geometry::area(&i);
            prop_assert!((found - fine).abs() < 1e-3 * area, "{found} {fine}");
        }

        #[test]
        fn both_directions_agree(i in triangle(), j in triangle()) {
            let (there, back) = (exchange(&i, &j, precision(1e-9)), exchange(&j, &i, precision(1e-9)));
            prop_assert!((there - back).abs() < 1e-6, "{there} {back}");
        }

        #[test]
        fn every_path_gives_the_same_bits(t in triangle(), at in triangle()) {
            let edge = Edge::new(t[0], t[1], (t[1] - t[0]).normalize());
            let mut segments = Segments::new();
            for l in 0..LANES {
                segments.set(l, at[l % 3] * (l as f64 * 0.3), &edge);
            }
            let at = Quadratics {
                x: segments.point[0],
                h: segments.point[1].map(f64::abs),
            };
            let (mut portable, mut portable_quadratics) = ([0.0; LANES], [0.0; LANES]);
            along_portable(&segments, &mut portable);
            quadratics_portable(&at, &mut portable_quadratics);
            prop_assert_eq!(along(&segments).map(f64::to_bits), portable.map(f64::to_bits));
            prop_assert_eq!(quadratics(&at).map(f64::to_bits), portable_quadratics.map(f64::to_bits));
            for set in InstructionSet::all() {
                let (mut found, mut found_quadratics) = ([0.0; LANES], [0.0; LANES]);
                along_by(set, &segments, &mut found);
                quadratics_by(set, &at, &mut found_quadratics);
                prop_assert_eq!(found.map(f64::to_bits), portable.map(f64::to_bits));
                prop_assert_eq!(found_quadratics.map(f64::to_bits), portable_quadratics.map(f64::to_bits));
            }
        }

        #[test]
        fn edges_whose_lines_meet_have_a_closed_form(
            apex in triangle(), s in -1.0..1.0f64, t in -1.0..1.0f64, lengths in [0.1..2.0f64, 0.1..2.0f64],
        ) {
            // Lines through corner 0 along two edges; either may run through the apex.
            let (u, v) = ((apex[1] - apex[0]).normalize(), (apex[2] - apex[0]).normalize());
            let edge = |along: DVec3, from: f64, length: f64| {
                Edge::new(apex[0] + along * from, apex[0] + along * (from + length), along)
            };
            let (p, q) = (edge(u, s, lengths[0]), edge(v, t, lengths[1]));
            let Some(found_apex) = super::apex(&p, &q) else { return Ok(()) };
            let mut closed = Closed::new();
            closed.add_meeting(&p, &q, found_apex, 1.0);
            let closed = closed.sum();
            // In two parts where the apex lies within: halving may stop too early beside a kink.
            let within = if s < 0.0 && s + lengths[0] > 0.0 { -s } else { 0.0 };
            let by_quadrature: f64 = [(s, within), (s + within, lengths[0] - within)]
                .iter()
                .filter(|(_, length)| *length > 0.0)
                .map(|&(from, length)| along_skew(&edge(u, from, length), &q, 1e-13).sum)
                .sum();
            prop_assert!((closed - by_quadrature).abs() < 1e-10, "{closed} {by_quadrature}");
        }
    }
}
