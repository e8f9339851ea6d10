//! Form factors between triangles that are not near each other to some thousandths, sixteen pairs at a time in single
//! precision.
//!
//! The kernel K(d) = (n_i · d)(−n_j · d) / (π d⁴) depends on two points by the vector d between them alone. Far apart,
//! its mean over both triangles is its value at the centroids plus half its second derivatives times the sum of the
//! triangles' second moments: one division a pair. Nearer, it is summed over six points of either (degree 4). Single
//! precision is enough because vectors between centroids are taken in double precision first, and all else is relative
//! to the centroids.
//!
//! Terms of both sums change places with the triangles, so that A_i F_ij = A_j F_ji to the bit.

use super::SIX;
use crate::geometry::CompactTriangle;
use crate::simd::{InstructionSet, dispatch};

/// Number of pairs a call.
pub(crate) const WIDTH: usize = 16;

/// Sixteen triangles relative to one other.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Pairs {
    /// From that one's centroid to theirs, by coordinate.
    between: [[f32; WIDTH]; 3],
    normal: [[f32; WIDTH]; 3],
    edge: [[f32; WIDTH]; 3],
    median: [[f32; WIDTH]; 3],
    area: [f32; WIDTH],
}

impl Pairs {
    pub(crate) const fn new() -> Self {
        Self {
            between: [[0.0; WIDTH]; 3],
            normal: [[0.0; WIDTH]; 3],
            edge: [[0.0; WIDTH]; 3],
            median: [[0.0; WIDTH]; 3],
            area: [0.0; WIDTH],
        }
    }

    /// Puts the pair of `own` and `other` into a lane.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
    pub(crate) fn set(&mut self, lane: usize, own: &CompactTriangle, other: &CompactTriangle) {
        for k in 0..3 {
            self.between[k][lane] = (other.center[k] - own.center[k]) as f32;
            self.normal[k][lane] = other.normal[k];
            self.edge[k][lane] = other.edge[k];
            self.median[k][lane] = other.median[k];
        }
        self.area[lane] = other.area;
    }

    /// Copies a lane of others.
    #[inline(always)]
    pub(crate) fn copy(&mut self, lane: usize, from: &Self, from_lane: usize) {
        for k in 0..3 {
            self.between[k][lane] = from.between[k][from_lane];
            self.normal[k][lane] = from.normal[k][from_lane];
            self.edge[k][lane] = from.edge[k][from_lane];
            self.median[k][lane] = from.median[k][from_lane];
        }
        self.area[lane] = from.area[from_lane];
    }
}

/// Distances from which each evaluation does: squared distances of centroids, over the sum of both triangles' squared
/// distances of corners from centroids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reach {
    /// For second derivatives.
    pub(crate) far: f32,
    /// For six points on either.
    pub(crate) middle: f32,
    /// For six points on either if one's plane cuts the other: the kernel has a kink at the cut.
    pub(crate) cut: f32,
}

/// Results for sixteen pairs.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Found {
    /// A_i F_ij where `kind` is [`DONE`]; of [`middle`], always.
    pub(crate) exchange: [f64; WIDTH],
    pub(crate) kind: [u32; WIDTH],
}

/// The exchange area is found, or 0: one triangle lies wholly behind the other.
pub(crate) const DONE: u32 = 0;
/// The pair is for [`middle`].
pub(crate) const MIDDLE: u32 = 1;
/// The pair is too near for either.
pub(crate) const NEAR: u32 = 2;

impl Found {
    const fn new() -> Self {
        Self {
            exchange: [0.0; WIDTH],
            kind: [DONE; WIDTH],
        }
    }
}

/// Sorts sixteen pairs by how far apart they are, and evaluates those far apart.
pub(crate) fn far(own: &CompactTriangle, others: &Pairs, reach: &Reach) -> Found {
    let mut out = Found::new();
    far_by(InstructionSet::widest(), own, others, reach, &mut out);
    out
}

/// Evaluates sixteen pairs by six points on either triangle.
pub(crate) fn middle(own: &CompactTriangle, others: &Pairs) -> Found {
    let mut out = Found::new();
    middle_by(InstructionSet::widest(), own, others, &mut out);
    out
}

dispatch! {
    fn far_by = far_portable(own: &CompactTriangle, others: &Pairs, reach: &Reach, out: &mut Found)
}

dispatch! {
    fn middle_by = middle_portable(own: &CompactTriangle, others: &Pairs, out: &mut Found)
}

#[inline(always)]
fn dot(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

#[inline(always)]
fn lane(of: &[[f32; WIDTH]; 3], l: usize) -> [f32; 3] {
    [of[0][l], of[1][l], of[2][l]]
}

#[inline(always)]
fn select(condition: bool, a: f32, b: f32) -> f32 {
    if condition { a } else { b }
}

#[inline(always)]
fn most(p: f32, q: f32) -> f32 {
    select(p > q, p, q)
}

#[inline(always)]
fn least(p: f32, q: f32) -> f32 {
    select(p < q, p, q)
}

/// Sum of the squared distances of a triangle's corners from its centroid.
#[inline(always)]
fn extent(edge: [f32; 3], median: [f32; 3]) -> f32 {
    1.5 * dot(median, median) + 0.5 * dot(edge, edge)
}

/// Shares of the outer products of median and edge in a triangle's second moments.
const OF_MEDIAN: f32 = 1.0 / 8.0;
const OF_EDGE: f32 = 1.0 / 24.0;

#[inline(always)]
fn far_portable(own: &CompactTriangle, others: &Pairs, reach: &Reach, out: &mut Found) {
    let mut kernels = [0.0; WIDTH];
    let own_extent = extent(own.edge, own.median);
    for l in 0..WIDTH {
        let (d, normal) = (lane(&others.between, l), lane(&others.normal, l));
        let (edge, median) = (lane(&others.edge, l), lane(&others.median, l));
        let square = dot(d, d);
        let sizes = own_extent + extent(edge, median);
        // Heights of each one's centroid above the other's plane, and the differences of its corners' heights.
        let (a, b) = (dot(own.normal, d), -dot(normal, d));
        let (a_edge, a_median) = (dot(own.normal, edge), dot(own.normal, median));
        let (b_edge, b_median) = (dot(normal, own.edge), dot(normal, own.median));
        let highest = |h: f32, edge: f32, median: f32| h + most(median, 0.5 * edge.abs() - 0.5 * median);
        let lowest = |h: f32, edge: f32, median: f32| h + least(median, -0.5 * edge.abs() - 0.5 * median);
        let behind = (highest(a, a_edge, a_median) <= 0.0) | (highest(b, b_edge, b_median) <= 0.0);
        let in_front = (lowest(a, a_edge, a_median) > 0.0) & (lowest(b, b_edge, b_median) > 0.0);

        let w = 1.0 / select(square > 0.0, square, 1.0);
        let (aw, bw) = (a * w, b * w);
        let both = aw * bw;
        // Along a vector v within j's plane, half the second derivative of (a b)/d⁴ is, with p = d·v/d²,
        // (−4 (n_i·v) b p + a b (12 p² − 2 v²/d²)) / d⁴; within i's plane with the two changing places.
        let along = |height: f32, of_other: f32, v: [f32; 3]| {
            let p = dot(d, v) * w;
            both * (12.0 * (p * p) - 2.0 * (dot(v, v) * w)) - 4.0 * (height * of_other * p)
        };
        let of_others = OF_MEDIAN * along(a_median * w, bw, median) + OF_EDGE * along(a_edge * w, bw, edge);
        let of_own = OF_MEDIAN * along(b_median * w, -aw, own.median) + OF_EDGE * along(b_edge * w, -aw, own.edge);
        let kernel = both + (of_others + of_own);
        kernels[l] = select(behind, 0.0, most(kernel, 0.0));
        let is_far = in_front & (square >= reach.far * sizes);
        let from = select(in_front, reach.middle, reach.cut);
        let kind = if square >= from * sizes { MIDDLE } else { NEAR };
        out.kind[l] = if behind | is_far { DONE } else { kind };
    }
    weigh(own, others, &kernels, out);
}

/// The six points of a triangle, in vectors from its centroid to its corners, and their weights.
#[allow(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
const ORBIT: [(f32, f32); 2] = [
    ((SIX[0].0 - SIX[0].1) as f32, SIX[0].2 as f32),
    ((SIX[1].0 - SIX[1].1) as f32, SIX[1].2 as f32),
];

/// Vectors from the centroid to the corners.
#[inline(always)]
fn corners(edge: [f32; 3], median: [f32; 3]) -> [[f32; 3]; 3] {
    let (e, m) = (scaled(edge, 0.5), scaled(median, -0.5));
    [
        [m[0] - e[0], m[1] - e[1], m[2] - e[2]],
        [m[0] + e[0], m[1] + e[1], m[2] + e[2]],
        median,
    ]
}

#[inline(always)]
fn scaled(v: [f32; 3], by: f32) -> [f32; 3] {
    [v[0] * by, v[1] * by, v[2] * by]
}

/// A point of a triangle's six: the corner it is near to, and its orbit.
type OrbitPoint = (usize, usize);

/// A pair, prepared for sums over points of either triangle.
#[derive(Clone, Copy)]
struct Pair {
    between: [f32; 3],
    normals: [[f32; 3]; 2],
    /// Heights of each one's centroid above the other's plane.
    heights: [f32; 2],
    /// Vectors from either centroid to its corners.
    corners: [[[f32; 3]; 3]; 2],
}

// Functions, not closures: these would not all be inlined, and the lanes not be vectorised.
impl Pair {
    /// The kernel between a point of the one triangle and a point of the other.
    #[inline(always)]
    fn kernel(&self, p: OrbitPoint, q: OrbitPoint) -> f32 {
        let x = scaled(self.corners[0][p.0], ORBIT[p.1].0);
        let y = scaled(self.corners[1][q.0], ORBIT[q.1].0);
        let d = self.between;
        // The difference of the small vectors first: only its sign changes when the triangles change places.
        let v = [d[0] + (y[0] - x[0]), d[1] + (y[1] - x[1]), d[2] + (y[2] - x[2])];
        let w = 1.0 / most(dot(v, v), f32::MIN_POSITIVE);
        let from_one = most(self.heights[0] + dot(self.normals[0], y), 0.0);
        let from_other = most(self.heights[1] + dot(self.normals[1], x), 0.0);
        (from_one * w) * (from_other * w)
    }

    /// Two kernels that change places with the triangles.
    #[inline(always)]
    fn both(&self, p: OrbitPoint, q: OrbitPoint) -> f32 {
        self.kernel(p, q) + self.kernel(q, p)
    }

    /// Σ over both of an orbit.
    #[inline(always)]
    fn same(&self, o: usize) -> f32 {
        let on = self.kernel((0, o), (0, o)) + self.kernel((1, o), (1, o)) + self.kernel((2, o), (2, o));
        on + (self.both((0, o), (1, o)) + self.both((1, o), (2, o)) + self.both((2, o), (0, o)))
    }

    /// Σ over points of different orbits.
    #[inline(always)]
    fn mixed(&self) -> f32 {
        let on = self.both((0, 0), (0, 1)) + self.both((1, 0), (1, 1)) + self.both((2, 0), (2, 1));
        let there = self.both((0, 0), (1, 1)) + self.both((1, 0), (2, 1)) + self.both((2, 0), (0, 1));
        let back = self.both((1, 0), (0, 1)) + self.both((2, 0), (1, 1)) + self.both((0, 0), (2, 1));
        on + (there + back)
    }
}

#[inline(always)]
fn middle_portable(own: &CompactTriangle, others: &Pairs, out: &mut Found) {
    let mut kernels = [0.0; WIDTH];
    let own_corners = corners(own.edge, own.median);
    for l in 0..WIDTH {
        let (d, normal) = (lane(&others.between, l), lane(&others.normal, l));
        let pair = Pair {
            between: d,
            normals: [own.normal, normal],
            heights: [dot(own.normal, d), -dot(normal, d)],
            corners: [own_corners, corners(lane(&others.edge, l), lane(&others.median, l))],
        };
        let (outer, inner) = (ORBIT[0].1, ORBIT[1].1);
        let sum = outer * outer * pair.same(0) + inner * inner * pair.same(1) + outer * inner * pair.mixed();
        kernels[l] = sum;
    }
    weigh(own, others, &kernels, out);
}

/// Multiplies kernels by areas. Apart from the loops before: a loop has no more lanes than its widest numbers allow.
#[inline(always)]
fn weigh(own: &CompactTriangle, others: &Pairs, kernels: &[f32; WIDTH], out: &mut Found) {
    for l in 0..WIDTH {
        let areas = f64::from(own.area) * f64::from(others.area[l]);
        out.exchange[l] = areas * (f64::from(kernels[l]) * std::f64::consts::FRAC_1_PI);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::{FactorRule, exchange, is_cut};
    use crate::geometry::{area, centroid};
    use glam::DVec3;
    use proptest::prelude::*;

    const REACH: Reach = Reach {
        far: 8.0,
        middle: 1.5,
        cut: 4.0,
    };

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array))
    }

    fn pairs(own: &CompactTriangle, triangles: &[[DVec3; 3]]) -> Pairs {
        let mut pairs = Pairs::new();
        for (l, triangle) in triangles.iter().enumerate() {
            pairs.set(l, own, &CompactTriangle::new(triangle));
        }
        pairs
    }

    /// The exchange area of two triangles turned to each other, at the distance of their centroids.
    fn most_exchanged(i: &[DVec3; 3], j: &[DVec3; 3]) -> f64 {
        area(i) * area(j) / (std::f64::consts::PI * centroid(i).distance_squared(centroid(j)))
    }

    #[test]
    fn a_triangle_without_area_exchanges_nothing() {
        let flat = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        let other = [DVec3::Z * 9.0, DVec3::Z * 9.0 + DVec3::Y, DVec3::Z * 9.0 + DVec3::X];
        let own = CompactTriangle::new(&flat);
        let found = far(&own, &pairs(&own, &[other]), &REACH);
        assert_eq!((found.kind[0], found.exchange[0]), (DONE, 0.0));
    }

    proptest! {
        #[test]
        fn every_path_gives_the_same_bits(
            i in triangle(), others in prop::collection::vec((triangle(), prop::array::uniform3(-9.0..9.0f64)), WIDTH),
        ) {
            let own = CompactTriangle::new(&i);
            let others: Vec<_> = others.into_iter().map(|(t, shift)| t.map(|p| p + DVec3::from_array(shift))).collect();
            let pairs = pairs(&own, &others);
            let (mut portable_far, mut portable_middle) = (Found::new(), Found::new());
            far_portable(&own, &pairs, &REACH, &mut portable_far);
            middle_portable(&own, &pairs, &mut portable_middle);
            let bits = |of: &Found| of.exchange.map(f64::to_bits);
            let same = |p: &Found, q: &Found| p.kind == q.kind && bits(p) == bits(q);
            for set in InstructionSet::all() {
                let (mut found_far, mut found_middle) = (Found::new(), Found::new());
                far_by(set, &own, &pairs, &REACH, &mut found_far);
                middle_by(set, &own, &pairs, &mut found_middle);
                prop_assert!(same(&portable_far, &found_far) && same(&portable_middle, &found_middle), "{set:?}");
            }
            prop_assert!(same(&portable_far, &far(&own, &pairs, &REACH)));
            prop_assert!(same(&portable_middle, &middle(&own, &pairs)));
        }

        #[test]
        fn both_directions_give_the_same_bits(
            i in triangle(), j in triangle(), shift in prop::array::uniform3(-9.0..9.0f64),
        ) {
            let j = j.map(|p| p + DVec3::from_array(shift));
            let (of_i, of_j) = (CompactTriangle::new(&i), CompactTriangle::new(&j));
            let (there, back) = (pairs(&of_i, &[j]), pairs(&of_j, &[i]));
            let (p, q) = (far(&of_i, &there, &REACH), far(&of_j, &back, &REACH));
            prop_assert_eq!(p.kind[0], q.kind[0]);
            prop_assert_eq!(p.exchange[0].to_bits(), q.exchange[0].to_bits());
            let (p, q) = (middle(&of_i, &there), middle(&of_j, &back));
            prop_assert_eq!(p.exchange[0].to_bits(), q.exchange[0].to_bits());
        }

        #[test]
        fn pairs_are_as_good_as_their_distance(
            i in triangle(), j in triangle(), shift in prop::array::uniform3(-20.0..20.0f64),
        ) {
            let j = j.map(|p| p + DVec3::from_array(shift));
            let own = CompactTriangle::new(&i);
            let pairs = pairs(&own, &[j]);
            let most = most_exchanged(&i, &j);
            let exact = exchange(&i, &j, &FactorRule::for_tolerance(1e-6));
            let is_cut = is_cut(&i, &j) || is_cut(&j, &i);
            for (reach, bound) in [(8.0, 2e-3), (32.0, 3e-4), (128.0, 5e-5)] {
                let found = far(&own, &pairs, &Reach { far: reach, middle: reach, cut: reach });
                if found.kind[0] == DONE {
                    let found = found.exchange[0];
                    prop_assert!((found - exact).abs() < bound * most, "far {reach}: {found} {exact} {most}");
                }
            }
            for (reach, bound) in [(1.5, 1e-3), (8.0, 4e-5)] {
                let bound = if is_cut { 1e-2 } else { bound };
                let found = far(&own, &pairs, &Reach { far: f32::INFINITY, middle: reach, cut: reach });
                if found.kind[0] == MIDDLE {
                    let found = middle(&own, &pairs).exchange[0];
                    prop_assert!((found - exact).abs() < bound * most, "middle {reach}: {found} {exact} {most}");
                }
            }
        }
    }
}
