//! Unoccluded form factors in closed form: point to triangle, and triangle to triangle by an outer quadrature.
//!
//! The exchange area A_i F_ij is symmetric. The outer integral is over the smaller triangle, where the closed form
//! varies least, and the arguments are put in a fixed order: both directions get the same bits. The number of outer
//! points depends on the distance of the two in radii of the outer one. Where they touch, nearly touch or cross, a
//! contour integral takes their place.

pub(crate) mod coarse;
pub(crate) mod contour;
pub(crate) mod far;
mod lanes;

use crate::geometry::{self, CompactTriangle, Sphere, distance, quarters};
use coarse::{Found, Pairs, Reach, WIDTH};
use contour::Precision;
use far::{Others, Own};
use glam::DVec3;
use lanes::Elements;
pub(crate) use lanes::{EdgeTerms, LANES, RULES, angle_portable};
use std::sync::OnceLock;

/// Quadrature of the unoccluded form factor, by the distance of the two triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorRule {
    /// Radii of both beyond which three points are taken on either.
    far: f64,
    /// Radii of the smaller one, between the spheres round the two, beyond which one point is taken on it.
    one: f64,
    /// Radii beyond which six points are taken (degree 4).
    six: f64,
    /// Radii beyond which six points are taken on each of four sub-triangles; nearer, the contour integral.
    twenty_four: f64,
    /// Precision of the contour integral.
    precision: Precision,
    /// Distances from which single precision does; `None` if it does nowhere.
    coarse: Option<Reach>,
    /// True for [`Self::exact`].
    is_exact: bool,
}

impl FactorRule {
    /// The rule for a relative tolerance, with an own error well below it.
    pub fn for_tolerance(tolerance: f64) -> Self {
        // Errors of each step on real rows are measured in `backends/cpu/tests/engines/ladder.rs`: below 6e-4 for
        // the first, 4e-5 for the third.
        let (far, one, six, twenty_four, precision) = match tolerance {
            t if t >= 2.5e-3 => (3.5, 8.0, 1.5, 0.6, Precision::of_both(1e-4, 2e-3)),
            t if t >= 1.5e-3 => (6.5, 15.0, 2.1, 0.85, Precision::of_both(3e-5, 6e-4)),
            t if t >= 5e-4 => (12.0, 30.0, 3.0, 1.2, Precision::of_both(1e-5, 2e-4)),
            t if t >= 1.5e-4 => (22.0, 55.0, 4.2, 1.7, Precision::of_both(1e-6, 5e-5)),
            t if t < EXACT_BELOW => return Self::exact(),
            _ => (40.0, 100.0, 6.0, 2.5, Precision::of_both(1e-7, 1e-5)),
        };
        let coarse = (tolerance >= 2.5e-3).then_some(Reach {
            far: 8.0,
            middle: 1.25,
            cut: 6.0,
        });
        Self {
            far,
            one,
            six,
            twenty_four,
            precision,
            coarse,
            is_exact: false,
        }
    }

    /// The rule with an error of 1e-10 of the value, or of rounding: about 1e-15 of the smaller area.
    ///
    /// Nineteen points (degree 8) from 14 radii on, on each of four parts from 6, on each of sixteen from 2.5; nearer,
    /// and where a plane cuts the outer triangle, the contour integral.
    pub fn exact() -> Self {
        Self {
            far: f64::INFINITY,
            one: f64::INFINITY,
            six: f64::INFINITY,
            twenty_four: f64::INFINITY,
            precision: Precision::exact(),
            coarse: None,
            is_exact: true,
        }
    }
}

/// Tolerance below which closed forms are as exact as they can be.
const EXACT_BELOW: f64 = 9e-7;

/// The form factor from an element at `point` with unit normal `normal` to the front of a triangle, nothing in between.
///
/// ```
/// use hemicube::factor::point_to_triangle;
/// use hemicube_spatial::glam::DVec3;
///
/// // The top of a hemicube, from its centre: fronts are where corners run counter-clockwise.
/// let [a, b, c, d] = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
/// let top: f64 = [[a, b, c], [a, c, d]].iter().map(|half| point_to_triangle(DVec3::ZERO, DVec3::Z, half)).sum();
/// let root = 2.0_f64.sqrt();
/// assert!((top - 4.0 / (std::f64::consts::PI * root) * (1.0 / root).atan()).abs() < 1e-12);
/// assert_eq!(point_to_triangle(DVec3::ZERO, DVec3::Z, &[a, c, b]), 0.0, "the back is not seen");
/// ```
pub fn point_to_triangle(point: DVec3, normal: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let mut elements = Elements::new();
    set_target(&mut elements, normal, triangle);
    for k in 0..3 {
        elements.point[k] = [point[k]; LANES];
    }
    lanes::evaluate(&elements)[0]
}

/// The form factor from an element to the front of a convex polygon, all of it above the horizon.
pub(crate) fn point_to_polygon(point: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let mut sum = 0.0;
    for (k, &p) in polygon.iter().enumerate() {
        let q = polygon[(k + 1) % polygon.len()];
        sum += lanes::term(normal.to_array(), (p - point).to_array(), (q - point).to_array());
    }
    (sum * (-0.5 * std::f64::consts::FRAC_1_PI)).max(0.0)
}

/// The angle in 0..=π of the vector (x, y), y ≥ 0: the same bits on every machine.
pub(crate) fn angle(y: f64, x: f64) -> f64 {
    lanes::angle_portable(y, x)
}

/// Form factors from several elements to one triangle, eight at a time.
///
/// ```
/// use hemicube::factor::{PointFactors, point_to_triangle};
/// use hemicube_spatial::glam::DVec3;
///
/// let triangle = [DVec3::Z, DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, 0.0, 1.0)];
/// let points: Vec<DVec3> = (0..20).map(|k| DVec3::X * (0.2 * f64::from(k))).collect();
/// let mut factors = PointFactors::new();
/// let along = factors.evaluate(points.iter().map(|&point| (point, DVec3::Z)), &triangle);
/// assert!(along[3..].is_sorted_by(|near, far| near > far), "less with every step away");
/// assert_eq!(along[5], point_to_triangle(points[5], DVec3::Z, &triangle), "one at a time or eight: the same bits");
/// ```
#[derive(Debug)]
pub struct PointFactors {
    elements: Elements,
    out: Vec<f64>,
}

impl Default for PointFactors {
    fn default() -> Self {
        Self::new()
    }
}

impl PointFactors {
    /// Without an element.
    pub fn new() -> Self {
        Self {
            elements: Elements::new(),
            out: Vec::new(),
        }
    }

    /// The form factor from each (position, unit normal) to the front of `triangle`, in order.
    pub fn evaluate(&mut self, from: impl Iterator<Item = (DVec3, DVec3)>, triangle: &[DVec3; 3]) -> &[f64] {
        self.pairs(from.map(|(point, normal)| (point, normal, *triangle)))
    }

    /// The form factor from each (position, unit normal) to the front of its triangle, in order.
    pub(crate) fn pairs(&mut self, pairs: impl Iterator<Item = (DVec3, DVec3, [DVec3; 3])>) -> &[f64] {
        self.out.clear();
        let mut filled = 0;
        for (point, normal, triangle) in pairs {
            for k in 0..3 {
                self.elements.point[k][filled] = point[k];
                self.elements.normal[k][filled] = normal[k];
                for (c, corner) in triangle.iter().enumerate() {
                    self.elements.corners[3 * c + k][filled] = corner[k];
                }
            }
            filled += 1;
            if filled == LANES {
                self.out.extend(lanes::evaluate(&self.elements));
                filled = 0;
            }
        }
        if filled > 0 {
            self.out.extend(&lanes::evaluate(&self.elements)[..filled]);
        }
        &self.out
    }
}

/// The unoccluded exchange area A_i F_ij of two triangles, in squared units: symmetric to the bit.
///
/// ```
/// use hemicube::factor::{FactorRule, exchange};
/// use hemicube_spatial::glam::DVec3;
///
/// // A unit square and another one that stands on an edge of it, in two triangles each: F = 0.20004.
/// let square = |a, b, c, d| [[a, b, c], [a, c, d]];
/// let floor = square(DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y);
/// let wall = square(DVec3::ZERO, DVec3::Z, DVec3::X + DVec3::Z, DVec3::X);
/// let rule = FactorRule::for_tolerance(1e-4);
/// let pairs = floor.iter().flat_map(|i| wall.iter().map(move |j| (i, j)));
/// let factor: f64 = pairs.clone().map(|(i, j)| exchange(j, i, &rule)).sum();
/// assert!((factor - 0.200_044).abs() < 1e-5, "{factor}");
/// assert_eq!(factor, pairs.map(|(i, j)| exchange(i, j, &rule)).sum::<f64>(), "reciprocal to the bit");
/// ```
pub fn exchange(i: &[DVec3; 3], j: &[DVec3; 3], rule: &FactorRule) -> f64 {
    let mut out = [0.0];
    let mut exchanges = Exchanges::new(*rule);
    exchanges.begin(i);
    exchanges.add(0, j, &mut out);
    exchanges.finish(&mut out);
    out[0]
}

/// Exchange areas A_i F_ij of one triangle and many others, several distant ones at a time: the bits of [`exchange`].
///
/// ```
/// use hemicube::factor::{Exchanges, FactorRule, exchange};
/// use hemicube_spatial::glam::DVec3;
///
/// let own = [DVec3::ZERO, DVec3::X, DVec3::Y];
/// let above = |z: f64| [DVec3::new(0.0, 0.0, z), DVec3::new(0.0, 1.0, z), DVec3::new(1.0, 0.0, z)];
/// let rule = FactorRule::for_tolerance(1e-3);
/// let (mut exchanges, mut found) = (Exchanges::new(rule), [0.0; 30]);
/// exchanges.begin(&own);
/// for place in 0..30 {
///     exchanges.add(place, &above(0.5 + place as f64), &mut found);
/// }
/// exchanges.finish(&mut found); // before this, some still wait for others to be evaluated with
/// assert!(found.is_sorted_by(|near, far| near > far));
/// assert_eq!(found[29], exchange(&own, &above(29.5), &rule));
/// ```
#[derive(Debug)]
pub struct Exchanges {
    rule: FactorRule,
    corners: [DVec3; 3],
    single: Single,
    double: Double,
    waiting: Elements,
    /// For each waiting lane, the place of its value and the outer area as its factor.
    waiting_places: [(usize, f64); LANES],
    waiting_filled: usize,
}

/// Pairs to be evaluated in single precision, and the places of their values.
#[derive(Debug)]
struct Single {
    own: CompactTriangle,
    pairs: Pairs,
    places: [usize; WIDTH],
    corners: [[DVec3; 3]; WIDTH],
    filled: usize,
    middle: Pairs,
    middle_places: [usize; WIDTH],
    middle_filled: usize,
}

/// Pairs to be evaluated in double precision, and the places of their values.
#[derive(Debug)]
struct Double {
    own: Own,
    others: Others,
    places: [usize; LANES],
    filled: usize,
}

impl Exchanges {
    /// Without a pair.
    pub fn new(rule: FactorRule) -> Self {
        Self {
            rule,
            corners: [DVec3::ZERO; 3],
            single: Single {
                own: CompactTriangle::default(),
                pairs: Pairs::new(),
                places: [0; WIDTH],
                corners: [[DVec3::ZERO; 3]; WIDTH],
                filled: 0,
                middle: Pairs::new(),
                middle_places: [0; WIDTH],
                middle_filled: 0,
            },
            double: Double {
                own: Own::default(),
                others: Others {
                    corners: [[0.0; LANES]; 9],
                },
                places: [0; LANES],
                filled: 0,
            },
            waiting: Elements::new(),
            waiting_places: [(0, 0.0); LANES],
            waiting_filled: 0,
        }
    }

    /// Begins triangle `i`. The pairs of another must be finished.
    pub fn begin(&mut self, i: &[DVec3; 3]) {
        self.corners = *i;
        if self.rule.coarse.is_some() {
            self.single.own = CompactTriangle::new(i);
        } else {
            self.double.own = Own::new(i);
        }
    }

    /// Adds the pair (i, j). Its value is at `out[place]` after [`Exchanges::finish`] at the latest.
    pub fn add(&mut self, place: usize, j: &[DVec3; 3], out: &mut [f64]) {
        if let Some(reach) = self.rule.coarse {
            let single = &mut self.single;
            single.pairs.set(single.filled, &single.own, &CompactTriangle::new(j));
            single.places[single.filled] = place;
            single.corners[single.filled] = *j;
            single.filled += 1;
            if single.filled == WIDTH {
                self.flush_added(reach, out);
            }
            return;
        }
        let double = &mut self.double;
        for (c, corner) in j.iter().enumerate() {
            for k in 0..3 {
                double.others.corners[3 * c + k][double.filled] = corner[k];
            }
        }
        double.places[double.filled] = place;
        double.filled += 1;
        if double.filled == LANES {
            self.flush_double(out);
        }
    }

    /// Evaluates the waiting pairs.
    pub fn finish(&mut self, out: &mut [f64]) {
        if let Some(reach) = self.rule.coarse {
            self.flush_added(reach, out);
            self.flush_middle(out);
        } else {
            self.flush_double(out);
        }
        self.flush_waiting(out);
    }

    /// Evaluates the added pairs in single precision.
    fn flush_added(&mut self, reach: Reach, out: &mut [f64]) {
        let single = &mut self.single;
        if single.filled == 0 {
            return;
        }
        let filled = std::mem::take(&mut single.filled);
        let found = coarse::far(&single.own, &single.pairs, &reach);
        for l in 0..filled {
            let corners = self.single.corners[l];
            self.place(self.single.places[l], l, &found, || corners, out);
        }
    }

    /// Writes a pair's value to its place, or passes the pair on to the next closer evaluation.
    #[inline(always)]
    fn place(
        &mut self,
        place: usize,
        lane: usize,
        found: &Found,
        corners: impl FnOnce() -> [DVec3; 3],
        out: &mut [f64],
    ) {
        match found.kind[lane] {
            coarse::DONE => out[place] = found.exchange[lane],
            coarse::MIDDLE => {
                let single = &mut self.single;
                single.middle.copy(single.middle_filled, &single.pairs, lane);
                single.middle_places[single.middle_filled] = place;
                single.middle_filled += 1;
                if single.middle_filled == WIDTH {
                    self.flush_middle(out);
                }
            }
            _ => self.add_near(place, &corners(), out),
        }
    }

    fn flush_middle(&mut self, out: &mut [f64]) {
        let single = &mut self.single;
        if single.middle_filled == 0 {
            return;
        }
        let found = coarse::middle(&single.own, &single.middle);
        for (exchange, &place) in found.exchange.iter().zip(&single.middle_places[..single.middle_filled]) {
            out[place] = *exchange;
        }
        single.middle_filled = 0;
    }

    fn flush_double(&mut self, out: &mut [f64]) {
        let double = &mut self.double;
        if double.filled == 0 {
            return;
        }
        let filled = std::mem::take(&mut double.filled);
        let far = far::evaluate(&double.own, &double.others, self.rule.far);
        for l in 0..filled {
            let double = &self.double;
            let place = double.places[l];
            if far.kind[l] == far::DONE {
                out[place] = far.exchange[l];
                continue;
            }
            let corner = |k: usize| {
                DVec3::new(
                    double.others.corners[3 * k][l],
                    double.others.corners[3 * k + 1][l],
                    double.others.corners[3 * k + 2][l],
                )
            };
            let j = [corner(0), corner(1), corner(2)];
            self.add_near(place, &j, out);
        }
    }

    fn add_near(&mut self, place: usize, j: &[DVec3; 3], out: &mut [f64]) {
        let (outer, inner) = in_order(&self.corners, j);
        let cross = geometry::cross(&outer);
        let double_area = cross.length();
        if double_area == 0.0 {
            out[place] = 0.0;
            return;
        }
        let normal = cross / double_area;
        if is_far(&outer, &inner, self.rule.one) {
            let center = geometry::centroid(&outer);
            let l = self.waiting_filled;
            for k in 0..3 {
                self.waiting.point[k][l] = center[k];
                self.waiting.normal[k][l] = normal[k];
                for (c, corner) in inner.iter().enumerate() {
                    self.waiting.corners[3 * c + k][l] = corner[k];
                }
            }
            self.waiting_places[l] = (place, 0.5 * double_area);
            self.waiting_filled += 1;
            if self.waiting_filled == LANES {
                self.flush_waiting(out);
            }
            return;
        }
        // Rounding may lift the value of a pair that all but touches above the smaller area.
        let area = 0.5 * double_area;
        out[place] = near(&outer, &inner, normal, area, &self.rule).min(area);
    }

    fn flush_waiting(&mut self, out: &mut [f64]) {
        if self.waiting_filled == 0 {
            return;
        }
        let factors = lanes::evaluate(&self.waiting);
        for (factor, &(place, area)) in factors.iter().zip(&self.waiting_places[..self.waiting_filled]) {
            out[place] = area * factor;
        }
        self.waiting_filled = 0;
    }
}

/// Returns whether the spheres round two triangles are farther apart than `radii` radii of the outer one.
fn is_far(outer: &[DVec3; 3], inner: &[DVec3; 3], radii: f64) -> bool {
    let (outer, inner) = (Sphere::of(outer), Sphere::of(inner));
    outer.center.distance(inner.center) - inner.radius() > (radii + 1.0) * outer.radius()
}

/// The exchange area of a pair that is not far apart.
fn near(outer: &[DVec3; 3], inner: &[DVec3; 3], normal: DVec3, area: f64, rule: &FactorRule) -> f64 {
    let sphere = Sphere::of(outer);
    let radii = distance(sphere.center, inner) / sphere.radius() - 1.0;
    if rule.is_exact && radii > EXACT_RADII[2] && !is_cut(outer, inner) {
        let divisions = EXACT_RADII.iter().filter(|&&from| radii <= from).count();
        let mut sum = Quadrature::new(normal, inner);
        add_nineteen_points(&mut sum, outer, 1.0, divisions);
        return area * sum.finish();
    }
    if radii <= rule.twenty_four || is_cut(outer, inner) {
        return contour::exchange(outer, inner, rule.precision);
    }
    let mut sum = Quadrature::new(normal, inner);
    if radii > rule.six {
        add_six_points(&mut sum, outer, 1.0);
    } else {
        for quarter in quarters(outer) {
            add_six_points(&mut sum, &quarter, 0.25);
        }
    }
    area * sum.finish()
}

/// Returns whether the inner triangle's plane cuts the outer one: the factor from a point has a kink at the cut.
fn is_cut(outer: &[DVec3; 3], inner: &[DVec3; 3]) -> bool {
    let normal = geometry::cross(inner);
    let heights = outer.map(|p| normal.dot(p - inner[0]));
    heights.iter().any(|&h| h > 0.0) && heights.iter().any(|&h| h < 0.0)
}

/// Orders two triangles by area, and by their corners if equal: the order of arguments does not matter.
fn in_order(i: &[DVec3; 3], j: &[DVec3; 3]) -> ([DVec3; 3], [DVec3; 3]) {
    let area = |t: &[DVec3; 3]| geometry::cross(t).length_squared();
    let bits = |t: &[DVec3; 3]| t.map(|p| p.to_array().map(|x| x.to_bits()));
    let order = area(i).total_cmp(&area(j)).then_with(|| bits(i).cmp(&bits(j)));
    if order.is_le() { (*i, *j) } else { (*j, *i) }
}

fn set_target(elements: &mut Elements, normal: DVec3, triangle: &[DVec3; 3]) {
    for k in 0..3 {
        elements.normal[k] = [normal[k]; LANES];
        for (c, corner) in triangle.iter().enumerate() {
            elements.corners[3 * c + k] = [corner[k]; LANES];
        }
    }
}

/// A weighted mean of the closed form over points of the outer triangle, eight at a time.
struct Quadrature {
    elements: Elements,
    weights: [f64; LANES],
    filled: usize,
    sum: f64,
}

impl Quadrature {
    fn new(normal: DVec3, inner: &[DVec3; 3]) -> Self {
        let mut elements = Elements::new();
        set_target(&mut elements, normal, inner);
        Self {
            elements,
            weights: [0.0; LANES],
            filled: 0,
            sum: 0.0,
        }
    }

    #[inline(always)]
    fn add(&mut self, point: DVec3, weight: f64) {
        for k in 0..3 {
            self.elements.point[k][self.filled] = point[k];
        }
        self.weights[self.filled] = weight;
        self.filled += 1;
        if self.filled == LANES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let factors = lanes::evaluate(&self.elements);
        for l in 0..self.filled {
            self.sum += self.weights[l] * factors[l];
        }
        self.filled = 0;
    }

    fn finish(mut self) -> f64 {
        if self.filled > 0 {
            self.flush();
        }
        self.sum
    }
}

/// Points and weights of degree 4 on a triangle (Dunavant 1985, n = 6): two orbits of three, (large, small, small) in
/// its turns.
pub(crate) const SIX: [(f64, f64, f64); 2] = [
    (0.816_847_572_980_459, 0.091_576_213_509_771, 0.109_951_743_655_322),
    (0.108_103_018_168_070, 0.445_948_490_915_965, 0.223_381_589_678_011),
];

/// Radii beyond which nineteen points are exact; on each of four parts; on each of sixteen.
const EXACT_RADII: [f64; 3] = [14.0, 6.0, 2.5];

/// Weights of the centroid and of Radon's two orbits (1948), (1 − 2a, a, a) in its turns: in the rule of degree 5, and
/// in that of degree 8.
const CENTROID: [f64; 2] = [0.225, 0.037_861_091_200_314_7];
const RADON: [(f64, [f64; 2]); 2] = [
    (
        0.101_286_507_323_456_33,
        [0.125_939_180_544_827_15, 0.037_620_425_413_182_9],
    ),
    (
        0.470_142_064_105_115_1,
        [0.132_394_152_788_506_18, 0.078_357_352_244_117_4],
    ),
];
/// Orbits (1 − 2a, a, a) and weights in the rule of degree 8 alone, and its orbit of six, (c, d, 1 − c − d).
const NINETEEN: [(f64, f64); 2] = [
    (0.232_102_326_775_050_4, 0.116_271_479_656_965_9),
    (0.029_480_860_884_439_6, 0.013_444_267_375_165_4),
];
const ORBIT_OF_SIX: (f64, f64, f64) = (
    0.232_102_326_775_050_4,
    0.029_480_860_884_439_6,
    0.037_509_722_455_231_7,
);

/// Nineteen points of a triangle, each with its weights in Radon's rule of degree 5 and in one of degree 8 that holds
/// its seven points (Laurie 1982, algorithm 584).
pub(crate) fn nineteen([a, b, c]: &[DVec3; 3]) -> [(DVec3, [f64; 2]); 19] {
    let (a, b, c) = (*a, *b, *c);
    let all = a + b + c;
    let mut points = [(all / 3.0, CENTROID); 19];
    let orbits = RADON
        .into_iter()
        .chain(NINETEEN.map(|(near, weight)| (near, [0.0, weight])));
    for (k, (near, weights)) in orbits.enumerate() {
        for (m, corner) in [a, b, c].into_iter().enumerate() {
            points[1 + 3 * k + m] = (all * near + corner * (1.0 - 3.0 * near), weights);
        }
    }
    let (s, t, weight) = ORBIT_OF_SIX;
    let turns = [[a, b, c], [b, c, a], [c, a, b], [b, a, c], [c, b, a], [a, c, b]];
    for (point, [p, q, r]) in points[13..].iter_mut().zip(turns) {
        *point = (p * s + q * t + r * (1.0 - s - t), [0.0, weight]);
    }
    points
}

/// Three null rules of the nineteen points: sums that vanish for polynomials of degree 4, orthogonal to the difference
/// of the two rules and to each other, and as long (Berntsen & Espelid 1991). A function with a kink makes all of them
/// small at once far more rarely than that difference alone.
pub(crate) fn null_rules() -> &'static [[f64; 19]; 3] {
    static RULES: OnceLock<[[f64; 19]; 3]> = OnceLock::new();
    RULES.get_or_init(|| {
        let points = nineteen(&[DVec3::X, DVec3::Y, DVec3::Z]);
        let difference = points.map(|(_, [fifth, eighth])| eighth - fifth);
        let length = dot(&difference, &difference).sqrt();
        let mut basis: Vec<[f64; 19]> = Vec::new();
        for i in 0..=4 {
            for j in 0..=4 - i {
                let monomial = points.map(|(p, _)| p.x.powi(i) * p.y.powi(j));
                basis.extend(without_basis(monomial, &basis));
            }
        }
        basis.extend(without_basis(difference, &basis));
        let mut rules = [[0.0; 19]; 3];
        let mut found = 0;
        for k in 0..19 {
            let mut unit = [0.0; 19];
            unit[k] = 1.0;
            if let Some(rule) = without_basis(unit, &basis).filter(|_| found < 3) {
                basis.push(rule);
                rules[found] = rule.map(|weight| weight * length);
                found += 1;
            }
        }
        rules
    })
}

/// How far a triangle's three *corner points* lie from its corners, in barycentric coordinates.
const BESIDE_CORNER: f64 = 5e-3;

/// Points near a triangle's corners, nearer than any of the nineteen.
pub(crate) fn corner_points([a, b, c]: &[DVec3; 3]) -> [DVec3; 3] {
    let all = (*a + *b + *c) * BESIDE_CORNER;
    [a, b, c].map(|corner| all + *corner * (1.0 - 3.0 * BESIDE_CORNER))
}

/// What a function's values at the nineteen points say of its values at the three corner points, a rule each: those of
/// the polynomial of degree 4 through them, by least squares.
pub(crate) fn corner_rules() -> &'static [[f64; 19]; 3] {
    static RULES: OnceLock<[[f64; 19]; 3]> = OnceLock::new();
    RULES.get_or_init(|| {
        let corners = corner_points(&[DVec3::X, DVec3::Y, DVec3::Z]);
        rules_of_polynomials(|i, j| corners.map(|p| p.x.powi(i) * p.y.powi(j)))
    })
}

/// The monomials of degree 4, by the powers of the first two barycentric coordinates.
const MONOMIALS: [(i32, i32); 15] = {
    let mut all = [(0, 0); 15];
    let (mut i, mut k) = (0, 0);
    while i <= 4 {
        let mut j = 0;
        while j <= 4 - i {
            all[k] = (i, j);
            (j, k) = (j + 1, k + 1);
        }
        i += 1;
    }
    all
};

/// The polynomial of degree 4 through a function's values at the nineteen points, by least squares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fitted([f64; 15]);

impl Fitted {
    pub(crate) fn of(values: &[f64; 19]) -> Self {
        static RULES: OnceLock<[[f64; 19]; 15]> = OnceLock::new();
        let rules = RULES.get_or_init(|| {
            rules_of_polynomials(|i, j| MONOMIALS.map(|other| if other == (i, j) { 1.0 } else { 0.0 }))
        });
        Self(rules.map(|rule| dot(&rule, values)))
    }

    /// Its value at a point of barycentric coordinates.
    pub(crate) fn at(&self, barycentric: [f64; 3]) -> f64 {
        let [x, y, _] = barycentric;
        let terms = MONOMIALS.iter().zip(self.0);
        terms
            .map(|(&(i, j), coefficient)| coefficient * x.powi(i) * y.powi(j))
            .sum()
    }
}

/// Rules of the nineteen points for what is linear in a polynomial of degree 4, N numbers of each monomial x^i y^j.
fn rules_of_polynomials<const N: usize>(of_monomial: impl Fn(i32, i32) -> [f64; N]) -> [[f64; 19]; N] {
    let points = nineteen(&[DVec3::X, DVec3::Y, DVec3::Z]);
    // Orthonormal polynomials over the nineteen points, each with its numbers.
    let mut basis: Vec<([f64; 19], [f64; N])> = Vec::new();
    for (i, j) in MONOMIALS {
        let (mut at_points, mut numbers) = (points.map(|(p, _)| p.x.powi(i) * p.y.powi(j)), of_monomial(i, j));
        for _ in 0..2 {
            for (of_points, of_numbers) in &basis {
                let share = dot(&at_points, of_points);
                at_points.iter_mut().zip(of_points).for_each(|(x, b)| *x -= share * b);
                numbers.iter_mut().zip(of_numbers).for_each(|(x, b)| *x -= share * b);
            }
        }
        let length = dot(&at_points, &at_points).sqrt();
        basis.push((at_points.map(|x| x / length), numbers.map(|x| x / length)));
    }
    std::array::from_fn(|k| {
        let mut rule = [0.0; 19];
        for (of_points, of_numbers) in &basis {
            for (weight, x) in rule.iter_mut().zip(of_points) {
                *weight += x * of_numbers[k];
            }
        }
        rule
    })
}

fn dot(p: &[f64; 19], q: &[f64; 19]) -> f64 {
    p.iter().zip(q).map(|(p, q)| p * q).sum()
}

/// The unit vector along what an orthonormal basis leaves of a vector (Gram & Schmidt, twice); `None` for nothing.
fn without_basis(mut vector: [f64; 19], basis: &[[f64; 19]]) -> Option<[f64; 19]> {
    let before = dot(&vector, &vector).sqrt();
    for _ in 0..2 {
        for of_basis in basis {
            let share = dot(&vector, of_basis);
            vector.iter_mut().zip(of_basis).for_each(|(x, b)| *x -= share * b);
        }
    }
    let length = dot(&vector, &vector).sqrt();
    (length > 1e-6 * before).then(|| vector.map(|x| x / length))
}

/// Nineteen points on each part of a triangle that is `share` of the outer one, divided so often.
fn add_nineteen_points(sum: &mut Quadrature, triangle: &[DVec3; 3], share: f64, divisions: usize) {
    if divisions > 0 {
        for quarter in quarters(triangle) {
            add_nineteen_points(sum, &quarter, 0.25 * share, divisions - 1);
        }
        return;
    }
    for (point, [_, weight]) in nineteen(triangle) {
        sum.add(point, weight * share);
    }
}

/// Six points on a triangle that is `share` of the outer one.
fn add_six_points(sum: &mut Quadrature, triangle: &[DVec3; 3], share: f64) {
    for (large, small, weight) in SIX {
        let all = (triangle[0] + triangle[1] + triangle[2]) * small;
        for corner in triangle {
            sum.add(all + *corner * (large - small), weight * share);
        }
    }
}

/// Eight Gauss–Legendre points and weights on 0..1.
const GAUSS: [(f64, f64); LANES] = [
    (0.019_855_071_751_231_884, 0.050_614_268_145_188_130),
    (0.101_666_761_293_186_630, 0.111_190_517_226_687_235),
    (0.237_233_795_041_835_507, 0.156_853_322_938_943_644),
    (0.408_282_678_752_175_098, 0.181_341_891_689_180_991),
    (0.591_717_321_247_824_902, 0.181_341_891_689_180_991),
    (0.762_766_204_958_164_493, 0.156_853_322_938_943_644),
    (0.898_333_238_706_813_370, 0.111_190_517_226_687_235),
    (0.980_144_928_248_768_116, 0.050_614_268_145_188_130),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn null_rules_vanish_to_degree_four() {
        let points = nineteen(&[DVec3::X, DVec3::Y, DVec3::Z]);
        let difference = points.map(|(_, [fifth, eighth])| eighth - fifth);
        for rule in null_rules() {
            assert!(dot(rule, &difference).abs() < 1e-12);
            assert!((dot(rule, rule) / dot(&difference, &difference) - 1.0).abs() < 1e-12);
            for (i, j) in (0..=4).flat_map(|i| (0..=4 - i).map(move |j| (i, j))) {
                let sum = dot(rule, &points.map(|(p, _)| p.x.powi(i) * p.z.powi(j)));
                assert!(sum.abs() < 1e-12, "x^{i} z^{j}: {sum}");
            }
            let kink = dot(rule, &points.map(|(p, _)| (p.x + 0.3 * p.y - 0.4).max(0.0)));
            assert!(kink.abs() > 1e-5, "{kink}");
        }
    }

    #[test]
    fn corner_rules_have_the_values_of_polynomials_of_degree_four() {
        let cell = [DVec3::X, DVec3::Y, DVec3::Z];
        let (points, corners) = (nineteen(&cell), corner_points(&cell));
        for (rule, corner) in corner_rules().iter().zip(corners) {
            for (i, j) in (0..=5).flat_map(|i| (0..=5 - i).map(move |j| (i, j))) {
                let of = |p: DVec3| p.x.powi(i) * p.z.powi(j);
                let off = (dot(rule, &points.map(|(p, _)| of(p))) - of(corner)).abs();
                assert!(i + j > 4 || off < 1e-12, "x^{i} z^{j}: {off}");
            }
            let of = |p: DVec3| if p.distance(corner) < 0.02 { 1.0 } else { 0.0 };
            let off = dot(rule, &points.map(|(p, _)| of(p))) - of(corner);
            assert!((off + 1.0).abs() < 1e-12, "{off}");
        }
    }

    #[test]
    fn a_fitted_polynomial_has_the_values_of_those_of_degree_four() {
        let points = nineteen(&[DVec3::X, DVec3::Y, DVec3::Z]);
        for (i, j) in (0..=5).flat_map(|i| (0..=5 - i).map(move |j| (i, j))) {
            let of = |p: DVec3| p.x.powi(i) * p.z.powi(j);
            let fitted = Fitted::of(&points.map(|(p, _)| of(p)));
            for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.3, 0.6], [0.01, 0.98], [0.2, 0.2]] {
                let p = DVec3::new(x, y, 1.0 - x - y);
                let off = (fitted.at(p.to_array()) - of(p)).abs();
                assert!(i + j > 4 || off < 1e-12, "x^{i} z^{j} at {p}: {off}");
            }
        }
    }

    /// The exact rule against itself on pieces: other radii, other steps of the rule, the same sum.
    #[test]
    fn the_exact_rule_adds_up() {
        let rule = FactorRule::exact();
        let mut state = 7u64;
        let mut next = || {
            state = crate::sampling::splitmix::hash(state);
            crate::sampling::splitmix::unit(state) * 2.0 - 1.0
        };
        let (mut worst, mut worst_relative) = (0.0f64, 0.0f64);
        for k in 0..400 {
            let mut triangle = |at: DVec3| [0; 3].map(|_| at + DVec3::new(next(), next(), next()));
            let away = 1.5f64.powi(k % 13) - 1.0;
            let (i, j) = (triangle(DVec3::ZERO), triangle(DVec3::new(0.3, 0.4, 0.8) * away));
            let whole = exchange(&i, &j, &rule);
            let (of_i, of_j) = (quarters(&i), quarters(&j));
            let pieces = of_i
                .iter()
                .flat_map(|i| of_j.iter().map(move |j| exchange(i, j, &rule)));
            let sum: f64 = pieces.sum();
            let area = geometry::area(&i).min(geometry::area(&j));
            worst = worst.max((whole - sum).abs() / area);
            if whole > 1e-8 * area {
                worst_relative = worst_relative.max((whole - sum).abs() / whole);
            }
        }
        assert!(worst < 1e-10 && worst_relative < 1e-6, "{worst:e} {worst_relative:e}");
    }

    #[test]
    fn the_exact_rule_closes_a_cube() {
        // Rows of the pieces of one face to all of the other five.
        let rule = FactorRule::exact();
        let corner = |k: u32| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2));
        let faces = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ];
        let pieces: Vec<Vec<[DVec3; 3]>> = faces
            .iter()
            .map(|&[a, b, c, d]| {
                let halves = [[a, b, c], [a, c, d]].map(|t| t.map(corner));
                halves.iter().flat_map(quarters).flat_map(|t| quarters(&t)).collect()
            })
            .collect();
        let mut worst = 0.0f64;
        for i in &pieces[0] {
            let others = pieces[1..].iter().flatten();
            let sum: f64 = others.map(|j| exchange(i, j, &rule)).sum();
            worst = worst.max((sum / geometry::area(i) - 1.0).abs());
        }
        assert!(worst < 1e-11, "{worst:e}");
    }

    const COARSE: f64 = 1e-2;
    const MIDDLE: f64 = 1e-3;
    const FINE: f64 = 1e-4;

    fn unit_square(hinge_degrees: f64) -> ([[DVec3; 3]; 2], [[DVec3; 3]; 2]) {
        let (sine, cosine) = hinge_degrees.to_radians().sin_cos();
        let lie = |u: f64, v: f64| DVec3::new(u, v, 0.0);
        let stand = |u: f64, v: f64| DVec3::new(u * cosine, v, u * sine);
        let floor = [
            [lie(0., 0.), lie(1., 0.), lie(1., 1.)],
            [lie(0., 0.), lie(1., 1.), lie(0., 1.)],
        ];
        // Wound so that it faces the floor.
        let wall = [
            [stand(0., 0.), stand(1., 1.), stand(1., 0.)],
            [stand(0., 0.), stand(0., 1.), stand(1., 1.)],
        ];
        (floor, wall)
    }

    fn between(a: &[[DVec3; 3]; 2], b: &[[DVec3; 3]; 2], tolerance: f64) -> f64 {
        let rule = FactorRule::for_tolerance(tolerance);
        a.iter()
            .flat_map(|i| b.iter().map(move |j| exchange(i, j, &rule)))
            .sum()
    }

    /// Relative error of two unit squares with a common edge at an angle, whose area is 1 so that A F = F.
    fn hinge_error(degrees: f64, exact: f64, tolerance: f64) -> f64 {
        let (floor, wall) = unit_square(degrees);
        (between(&floor, &wall, tolerance) / exact - 1.0).abs()
    }

    /// A_i F_ij from the triangle on the edge x = z = 0, 0 ≤ y ≤ 1, in the plane z = 0 with a third corner at `apex`,
    /// or from the unit square on that edge, by the closed form from points that crowd towards the edge and the
    /// `breaks` along it.
    fn by_points(apex: Option<(f64, f64)>, breaks: &[f64], inner: &[[DVec3; 3]]) -> f64 {
        // Eight Gauss points on each of panels that halve towards both ends.
        let graded = |a: f64, b: f64| {
            let mut ends: Vec<f64> = (1..=40).map(|k| 0.5f64.powi(k)).collect();
            ends.push(0.0);
            ends.reverse();
            let upper: Vec<f64> = ends.iter().rev().skip(1).map(|e| 1.0 - e).collect();
            ends.extend(upper);
            let panels: Vec<(f64, f64)> = ends.windows(2).map(|e| (e[0], e[1])).collect();
            panels
                .into_iter()
                .flat_map(|(p, q)| GAUSS.map(|(x, w)| (p + (q - p) * x, (q - p) * w)))
                .map(|(x, w)| (a + (b - a) * x, (b - a) * w))
                .collect::<Vec<_>>()
        };
        let mut ends = vec![0.0, 1.0];
        ends.extend(breaks.iter().filter(|&&b| 0.0 < b && b < 1.0));
        ends.sort_by(f64::total_cmp);
        let along: Vec<(f64, f64)> = ends.windows(2).flat_map(|e| graded(e[0], e[1])).collect();
        let mut factors = PointFactors::new();
        let mut sum = 0.0;
        let (height, top, narrowing) = apex.map_or((1.0, 0.0, 0.0), |(x, y)| (x, y, 1.0));
        for (x, wx) in graded(0.0, 1.0) {
            for triangle in inner {
                let at = |y: f64| DVec3::new(x * height, y + (top - y) * (x * narrowing), 0.0);
                let points = along.iter().map(|&(y, _)| (at(y), DVec3::Z));
                let row = factors.evaluate(points, triangle);
                let mean: f64 = row.iter().zip(&along).map(|(f, (_, wy))| f * wy).sum();
                sum += mean * wx * (1.0 - x * narrowing) * height;
            }
        }
        sum
    }

    /// Angles between two surfaces; 180° is flat.
    const HINGES: [f64; 8] = [10.0, 45.0, 90.0, 135.0, 170.0, 179.0, 179.9, 179.99];

    /// A point of the wall that stands on the edge x = z = 0.
    fn on_wall(degrees: f64, u: f64, v: f64) -> DVec3 {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        DVec3::new(u * cosine, v, u * sine)
    }

    #[test]
    fn triangles_with_a_common_edge_at_any_angle() {
        // Third corners of floor and wall, and the wall's part of the edge: of right angles, slanted, slivers, walls
        // that stand on a part of the edge, and one that reaches far beyond it.
        let cases = [
            ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
            ((1.0, 1.0), (1.0, 1.0), (0.0, 1.0)),
            ((0.8, 0.3), (0.5, -0.4), (0.0, 1.0)),
            ((0.01, 0.5), (1.0, 0.5), (0.0, 1.0)),
            ((0.01, 0.5), (0.02, 0.2), (0.0, 1.0)),
            ((1.0, 0.5), (0.25, 0.5), (0.375, 0.625)),
            ((1.0, 0.2), (0.5, 0.7), (0.5, 1.5)),
            ((0.3, 0.0), (4.0, 2.0), (-1.0, 3.0)),
        ];
        for (floor_apex, wall_apex, (from, to)) in cases {
            let floor = [DVec3::ZERO, DVec3::new(floor_apex.0, floor_apex.1, 0.0), DVec3::Y];
            for degrees in HINGES {
                let stand = |u: f64, v: f64| on_wall(degrees, u, v);
                let wall = [stand(0.0, from), stand(0.0, to), stand(wall_apex.0, wall_apex.1)];
                let exact = by_points(Some(floor_apex), &[from, to], &[wall]);
                for tolerance in [COARSE, MIDDLE, FINE] {
                    let found = exchange(&floor, &wall, &FactorRule::for_tolerance(tolerance));
                    assert!(
                        (found / exact - 1.0).abs() < tolerance,
                        "{floor_apex:?} {wall_apex:?} {from}..{to} {degrees}° at {tolerance}: {found:e} {exact:e}"
                    );
                }
            }
        }
    }

    #[test]
    fn squares_with_a_common_edge_at_any_angle() {
        for degrees in HINGES {
            let (floor, wall) = unit_square(degrees);
            let exact = by_points(None, &[], &wall);
            for tolerance in [COARSE, MIDDLE, FINE] {
                let found = between(&floor, &wall, tolerance);
                assert!(
                    (found / exact - 1.0).abs() < tolerance,
                    "{degrees}° at {tolerance}: {found:e} {exact:e}"
                );
            }
        }
        // The points themselves, against Howell's C-14.
        let right = by_points(None, &[], &unit_square(90.0).1);
        assert!((right / 0.200_043_776_075_403 - 1.0).abs() < 1e-12, "{right}");
    }

    #[test]
    fn squares_with_a_common_edge() {
        // 90° is Howell's C-14 in closed form; the others were computed to 10 digits with 96 × 96 graded points.
        for (degrees, exact, coarse, middle, fine) in [
            (45.0, 0.483_347_70, 3e-3, 1e-4, 3e-5),
            (90.0, 0.200_043_776_075_403, 1e-3, 1e-4, 1e-5),
            (135.0, 0.048_309_45, 3e-3, 2e-4, 3e-5),
            (170.0, 0.002_362_06, 5e-3, 1e-3, 3e-5),
        ] {
            for (tolerance, bound) in [(COARSE, coarse), (MIDDLE, middle), (FINE, fine)] {
                let error = hinge_error(degrees, exact, tolerance);
                assert!(error < bound, "{degrees}° at {tolerance}: {error:e}");
            }
        }
    }

    /// Every step of the exact rule, against the contour integral, which nears it from the other side.
    #[test]
    fn exact_factors_are_exact_at_every_distance() {
        let own = [DVec3::ZERO, DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.3, 0.9, 0.0)];
        let rule = FactorRule::exact();
        for aside in [0.0, 0.7, 2.0] {
            for tilt in [0.0, 0.4, 1.1] {
                for step in 0..24 {
                    let z = 0.3 * 1.25f64.powi(step);
                    let turned = |p: DVec3| glam::DQuat::from_rotation_x(tilt) * p + DVec3::new(aside * z, 0.0, z);
                    let other = [DVec3::ZERO, DVec3::new(0.2, 1.7, 0.0), DVec3::new(1.6, 0.2, 0.0)].map(turned);
                    if other.iter().any(|p| p.z <= 0.0) {
                        continue;
                    }
                    let found = exchange(&own, &other, &rule);
                    let exact = contour::exchange(&own, &other, Precision::of_both(1e-13, 1e-12));
                    // Terms of the contour cancel: its rounding is a share of the area.
                    assert!(
                        (found - exact).abs() <= 1e-10 * exact + 2e-15,
                        "{z} {aside} {tilt}: {found:e} {exact:e} {:e}",
                        found / exact - 1.0
                    );
                }
            }
        }
        // Howell's C-14 and C-11.
        let sum = |a: &[[DVec3; 3]; 2], b: &[[DVec3; 3]; 2]| -> f64 {
            a.iter()
                .flat_map(|i| b.iter().map(move |j| exchange(i, j, &rule)))
                .sum()
        };
        let (floor, wall) = unit_square(90.0);
        assert!((sum(&floor, &wall) / 0.200_043_776_075_403 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn rows_have_the_bits_of_pairs() {
        let scene = hemicube_scene::generate::cornell_box();
        let patches = hemicube_scene::Patches::new(&scene, hemicube_scene::Subdivision::Levels(2)).expect("patches");
        let model = crate::Model::new(patches.into(), crate::HierarchyOptions::default()).expect("a model");
        let all: Vec<u32> = model.patches().iter().map(|p| p.0).collect();
        for tolerance in [COARSE, MIDDLE] {
            let rule = FactorRule::for_tolerance(tolerance);
            let mut exchanges = Exchanges::new(rule);
            let mut row = vec![0.0; all.len()];
            for i in (0..all.len()).step_by(97) {
                let own = model.normalised_corners(all[i]);
                exchanges.begin(&own);
                for (place, &j) in all.iter().enumerate() {
                    exchanges.add(place, &model.normalised_corners(j), &mut row);
                }
                exchanges.finish(&mut row);
                for (&j, &found) in all.iter().zip(&row) {
                    let other = model.normalised_corners(j);
                    assert_eq!(found.to_bits(), exchange(&own, &other, &rule).to_bits(), "{i} {j}");
                    assert_eq!(found.to_bits(), exchange(&other, &own, &rule).to_bits(), "{j} {i}");
                }
                assert!(row.iter().any(|&f| f > 0.0));
            }
        }
    }

    #[test]
    fn parallel_squares() {
        let square = |z: f64, up: bool| {
            let p = |x: f64, y: f64| DVec3::new(x, y, z);
            let (a, b, c, d) = (p(0., 0.), p(1., 0.), p(1., 1.), p(0., 1.));
            if up {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, c, b], [a, d, c]]
            }
        };
        // Howell C-11.
        for (height, exact) in [(1.0, 0.199_824_895_698_387), (3.0, 0.032_971_397_219_497_3)] {
            for (tolerance, bound) in [(COARSE, 3e-3), (MIDDLE, 2e-4), (FINE, 1e-5)] {
                let found = between(&square(0.0, true), &square(height, false), tolerance);
                assert!((found / exact - 1.0).abs() < bound, "{height} at {tolerance}: {found}");
            }
            assert_eq!(
                between(&square(0.0, false), &square(height, false), FINE),
                0.0,
                "seen from behind"
            );
            assert_eq!(
                between(&square(0.0, true), &square(height, true), FINE),
                0.0,
                "its back is seen"
            );
        }
    }

    #[test]
    fn no_pair_exchanges_more_than_leaves_its_smaller_triangle() {
        // A party wall on a larger one, from a tile of The Hague: they meet in a corner, 0.2 mm apart at the other end.
        let wall = [(91.116, -1.986, 3.896), (92.74, -4.605, 3.896), (92.74, -4.605, 6.613)];
        let other = [(95.244, -8.644, 3.77), (91.116, -1.986, 3.77), (91.116, -1.986, 10.319)];
        let [wall, other] = [wall, other].map(|t| t.map(DVec3::from));
        let area = crate::geometry::area(&wall);
        for tolerance in [COARSE, MIDDLE, 1e-4] {
            let found = exchange(&wall, &other, &FactorRule::for_tolerance(tolerance));
            assert!(found <= area && found > 0.999 * area, "{tolerance}: {found} of {area}");
        }
    }

    #[test]
    fn the_order_of_arguments_does_not_matter_to_the_bit() {
        let (floor, wall) = unit_square(60.0);
        let far = wall.map(|t| t.map(|p| p * 0.37 + DVec3::new(3.0, 1.0, 0.5)));
        let rule = FactorRule::for_tolerance(COARSE);
        for i in &floor {
            for j in wall.iter().chain(&far) {
                assert_eq!(exchange(i, j, &rule).to_bits(), exchange(j, i, &rule).to_bits());
            }
        }
    }

    #[test]
    fn a_small_receiver_on_a_long_edge() {
        // A T-junction: the small triangle's edge lies within the large one's (exact by 96 × 96 graded points).
        let (floor, wall) = unit_square(90.0);
        let small = wall.map(|t| t.map(|p| p * 0.25 + DVec3::new(0.0, 0.375, 0.0)));
        let whole = between(&floor, &small, FINE);
        for (tolerance, bound) in [(COARSE, 2e-3), (MIDDLE, 3e-4)] {
            let found = between(&floor, &small, tolerance);
            assert!((found / whole - 1.0).abs() < bound, "{tolerance}: {found} {whole}");
        }
    }
}
