//! Form factors between triangles near each other: the double contour integral (Sparrow 1963), whose inner integral, and
//! all that lies between parallel edges, has a closed form; the rest by adaptive quadrature along one edge.
//!
//! ```text
//! A_i F_ij = 1/(2π) ∮_i ∮_j ln r  dr_i · dr_j
//! ```
//!
//! holds where each triangle lies in front of the other's plane, so both are cut there first: surfaces that cross, and
//! walls that end on a floor, are then like any others. Nothing is singular where the two touch, and plates a hair apart,
//! whose factor from a point is a step, are smooth here: a quadrature over either's area has trouble with both. In
//! architecture most edges are parallel or at right angles to each other, and the result is exact but for rounding.
#![allow(
    unsafe_code,
    reason = "functions compiled for an instruction set are called after it was found"
)]

use super::GAUSS;
use super::lanes::{LANES, angle};
use glam::DVec3;

/// A triangle cut by a plane: up to four corners, in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outline {
    corners: [DVec3; 4],
    count: usize,
}

impl Outline {
    pub(crate) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        (0..self.count).map(|k| (self.corners[k], self.corners[(k + 1) % self.count]))
    }
}

/// The part of `triangle` in front of the plane through `on` with unit `normal`; what is nearer to it than `tolerance` counts
/// as on it. `None` where nothing is in front.
pub(crate) fn in_front(triangle: &[DVec3; 3], on: DVec3, normal: DVec3, tolerance: f64) -> Option<Outline> {
    let heights = triangle.map(|p| {
        let h = normal.dot(p - on);
        if h.abs() <= tolerance { 0.0 } else { h }
    });
    if heights.iter().all(|&h| h <= 0.0) {
        return None;
    }
    let mut outline = Outline {
        corners: [DVec3::ZERO; 4],
        count: 0,
    };
    let mut push = |p| {
        if outline.count < 4 {
            outline.corners[outline.count] = p;
            outline.count += 1;
        }
    };
    for k in 0..3 {
        let next = (k + 1) % 3;
        let (p, q, hp, hq) = (triangle[k], triangle[next], heights[k], heights[next]);
        if hp >= 0.0 {
            push(p);
        }
        if (hp > 0.0 && hq < 0.0) || (hp < 0.0 && hq > 0.0) {
            // From the end in front, so that the cut of a shared edge is the same from either side.
            let (a, b, ha, hb) = if hp > 0.0 { (p, q, hp, hq) } else { (q, p, hq, hp) };
            push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    Some(outline)
}

/// A_i F_ij, to within `enough` as a share of the smaller one's area. The order of the arguments matters in the last bits.
pub(crate) fn exchange(outer: &[DVec3; 3], inner: &[DVec3; 3], enough: f64) -> f64 {
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
    // So that logarithms are of numbers near 1: a common factor falls out of a closed contour, but not out of its rounding.
    let scale = 1.0 / size;
    let local = |t: &[DVec3; 3]| t.map(|p| (p - origin) * scale);
    let (outer, inner) = (local(outer), local(inner));
    let normal = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).try_normalize();
    let (Some(outer_normal), Some(inner_normal)) = (normal(&outer), normal(&inner)) else {
        return 0.0;
    };
    let (Some(first), Some(second)) = (
        in_front(&outer, inner[0], inner_normal, ON_PLANE),
        in_front(&inner, outer[0], outer_normal, ON_PLANE),
    ) else {
        return 0.0;
    };
    let area = 0.5 * (outer[1] - outer[0]).cross(outer[2] - outer[0]).length();
    let share = enough * area * std::f64::consts::TAU / 9.0;
    let mut sum = 0.0;
    for (a, b) in first.edges() {
        let Some(u) = (b - a).try_normalize() else { continue };
        for (c, d) in second.edges() {
            let Some(v) = (d - c).try_normalize() else { continue };
            let cosine = u.dot(v);
            if cosine.abs() < RIGHT_ANGLE {
                continue;
            }
            let turned = if cosine < 0.0 { (d, c) } else { (c, d) };
            let comparable = a.distance(b) > COMPARABLE * c.distance(d);
            let part = if comparable && u.cross(v).length_squared() < PARALLEL {
                parallel((a, b), turned)
            } else {
                skew((a, b), turned, share / cosine.abs())
            };
            sum += cosine * part;
        }
    }
    let exchange = sum * size * size / std::f64::consts::TAU;
    if exchange > 0.0 { exchange } else { 0.0 }
}

/// In units of the pair's extent.
const ON_PLANE: f64 = 1e-13;
/// Cosines below this are rounding.
const RIGHT_ANGLE: f64 = 1e-14;
/// Squared sines below this: parallel. Over an edge of length 1 the two are then less than 1e-9 nearer at one end.
const PARALLEL: f64 = 1e-18;

/// Edges shorter than this part of the other: the differences of the closed form would lose their digits.
const COMPARABLE: f64 = 1e-3;

/// ∫∫ ln r over two parallel edges that point the same way.
///
/// With x = t − s along both and h the distance of their lines, it is the second difference of Q, Q'' = ½ ln (h² + x²):
/// Q = ¼ (x² − h²) ln (h² + x²) − ¾ x² + h x atan (x/h).
fn parallel((a, b): (DVec3, DVec3), (c, d): (DVec3, DVec3)) -> f64 {
    let length = a.distance(b);
    let u = (b - a) / length;
    let (start, end) = (u.dot(c - a), u.dot(d - a));
    let h = ((c - a).cross(u).length() + (d - a).cross(u).length()) * 0.5;
    let q = |x: f64| {
        let squared = h * h + x * x;
        0.25 * (x * x - h * h) * logarithm(squared) - 0.75 * x * x + h * x.abs() * angle(x.abs(), h)
    };
    (q(end) - q(start)) - (q(end - length) - q(start - length))
}

/// ∫∫ ln r over two edges, to within `enough`.
fn skew((a, b): (DVec3, DVec3), (c, d): (DVec3, DVec3), enough: f64) -> f64 {
    let length = a.distance(b);
    let over = |start: f64, width: f64| {
        let mut points = Points::new(c, d);
        for (l, &(x, _)) in GAUSS.iter().enumerate() {
            let p = a + (b - a) * (start + width * x);
            for k in 0..3 {
                points.point[k][l] = p[k];
            }
        }
        let values = along(&points);
        let mut sum = 0.0;
        for (value, &(_, weight)) in values.iter().zip(&GAUSS) {
            sum += value * weight;
        }
        sum * width * length
    };
    // Below its own rounding a difference says nothing, and halving would go on for ever.
    let enough = enough.max(ROUNDING * length * c.distance(d));
    let mut pending = vec![(0.0, 1.0, over(0.0, 1.0), 0)];
    let mut sum = 0.0;
    while let Some((start, width, whole, depth)) = pending.pop() {
        let half = 0.5 * width;
        let (left, right) = (over(start, half), over(start + half, half));
        if depth >= DEEPEST || (left + right - whole).abs() <= enough {
            sum += left + right;
        } else {
            pending.push((start, half, left, depth + 1));
            pending.push((start + half, half, right, depth + 1));
        }
    }
    sum
}

/// Of an integral over two edges, in their lengths.
const ROUNDING: f64 = 2e-15;

/// Halvings of an edge: what is left is 1e-12 of it.
const DEEPEST: u32 = 40;

/// Eight points, and the edge that each is integrated along.
#[repr(C, align(64))]
struct Points {
    point: [[f64; LANES]; 3],
    start: [f64; 3],
    along: [f64; 3],
    length: f64,
}

impl Points {
    fn new(start: DVec3, end: DVec3) -> Self {
        let length = start.distance(end);
        Self {
            point: [[0.0; LANES]; 3],
            start: start.to_array(),
            along: ((end - start) / length).to_array(),
            length,
        }
    }
}

/// ∫ ln r from each point along the edge: with t along it and h the distance of its line,
/// ½ t ln (h² + t²) − t + h atan (t/h) between its ends.
fn along(points: &Points) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
            // SAFETY: the processor has AVX-512 F and DQ.
            unsafe { along_avx512(points, &mut out) };
            return out;
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            unsafe { along_avx2(points, &mut out) };
            return out;
        }
    }
    along_portable(points, &mut out);
    out
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq")]
fn along_avx512(points: &Points, out: &mut [f64; LANES]) {
    along_portable(points, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn along_avx2(points: &Points, out: &mut [f64; LANES]) {
    along_portable(points, out);
}

#[inline(always)]
fn along_portable(points: &Points, out: &mut [f64; LANES]) {
    let (s, u, length) = (points.start, points.along, points.length);
    for l in 0..LANES {
        let d = [
            s[0] - points.point[0][l],
            s[1] - points.point[1][l],
            s[2] - points.point[2][l],
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

/// ln x for x ≥ 0, as that of 1e-300 below 1e-300: x = 2^e m with m in [√½, √2), ln m = 2 artanh ((m − 1)/(m + 1)) by its
/// series, whose first term left out is below 1e-18.
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

    /// Mean over fine pieces of the outer triangle of the factor from a point: what the contour integral must give.
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
            let found = exchange(&low, &high, 1e-8);
            assert!((found - 0.125).abs() < 2.0 * gap + 1e-7, "{gap}: {found}");
        }
    }

    #[test]
    fn a_wall_through_the_floor_counts_above_it_only() {
        let floor = [p(-1., -1., 0.), p(2., -1., 0.), p(-1., 2., 0.)];
        let wall = [p(0., 0., -1.), p(0., 1., 0.5), p(0., 0., 0.5)];
        let above = [p(0., 2. / 3., 0.), p(0., 1., 0.5), p(0., 0., 0.5)];
        let rest = [p(0., 0., 0.), p(0., 2. / 3., 0.), p(0., 0., 0.5)];
        // The floor is cut too: only what lies in front of the wall sees it.
        let whole = exchange(&wall, &floor, 1e-9);
        let parts = exchange(&above, &floor, 1e-9) + exchange(&rest, &floor, 1e-9);
        assert!((whole - parts).abs() < 1e-8, "{whole} {parts}");
        assert!(whole > 0.01);
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
            let found = exchange(&i, &j, 1e-7);
            let fine = by_area(&i, &j, 96);
            let area = 0.5 * (i[1] - i[0]).cross(i[2] - i[0]).length();
            prop_assert!((found - fine).abs() < 1e-3 * area, "{found} {fine}");
        }

        #[test]
        fn both_directions_agree(i in triangle(), j in triangle()) {
            let (there, back) = (exchange(&i, &j, 1e-9), exchange(&j, &i, 1e-9));
            prop_assert!((there - back).abs() < 1e-6, "{there} {back}");
        }

        #[test]
        fn every_path_gives_the_same_bits(t in triangle(), at in triangle()) {
            let mut points = Points::new(t[0], t[1]);
            for l in 0..LANES {
                for k in 0..3 {
                    points.point[k][l] = at[l % 3][k] * (l as f64 * 0.3);
                }
            }
            let mut portable = [0.0; LANES];
            along_portable(&points, &mut portable);
            prop_assert_eq!(along(&points).map(f64::to_bits), portable.map(f64::to_bits));
        }
    }
}
