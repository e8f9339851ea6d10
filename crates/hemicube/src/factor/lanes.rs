//! Point-to-triangle form factors, eight at a time.
//!
//! Lambert's contour formula for a differential element at x with normal n and a polygon with corners p_k seen from x
//! (Lambert 1760; Baum, Rushmeier & Winget 1989, eq. 9):
//!
//! ```text
//! F = −1/(2π) Σ_k  n · (p_k × p_{k+1}) / |p_k × p_{k+1}|  ·  angle(p_k, p_{k+1})
//! ```
//!
//! for corners counter-clockwise as seen from the polygon's front, after a cut of the polygon at the element's horizon.
//! The angle comes from its sine and cosine by an own arc tangent: values are the same bits on every machine. One
//! source is compiled for each instruction set, without fused multiply-add.

use crate::simd::{InstructionSet, cross, dispatch, dot, plus};

/// Number of evaluations a call.
pub(crate) const LANES: usize = 8;

/// Eight elements, each with its triangle.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Elements {
    /// Positions, by coordinate.
    pub(crate) point: [[f64; LANES]; 3],
    /// Unit normals, by coordinate.
    pub(crate) normal: [[f64; LANES]; 3],
    /// Corners, by coordinate of corner 0, then 1, then 2; counter-clockwise as seen from the front.
    pub(crate) corners: [[f64; LANES]; 9],
}

impl Elements {
    pub(crate) const fn new() -> Self {
        Self {
            point: [[0.0; LANES]; 3],
            normal: [[0.0; LANES]; 3],
            corners: [[0.0; LANES]; 9],
        }
    }
}

/// The form factor from each element to the front of its triangle; 0 from behind or below the horizon.
pub(crate) fn evaluate(elements: &Elements) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    evaluate_by(InstructionSet::widest(), elements, &mut out);
    out
}

dispatch! {
    fn evaluate_by = evaluate_portable(elements: &Elements, out: &mut [f64; LANES])
}

/// atan(t)/t as a polynomial in t² over |t| ≤ tan(π/8): Chebyshev's fit of degree 12 in 60 digits. Its error is below
/// 5e-20; rounding leaves 1.6e-16.
const ATAN: [f64; 13] = [
    1.0,
    -0.333_333_333_333_333_26,
    0.199_999_999_999_970_15,
    -0.142_857_142_853_297_1,
    0.111_111_110_853_221_09,
    -0.090_909_080_590_311_91,
    0.076_922_810_999_377_44,
    -0.066_662_052_599_765_26,
    0.058_768_340_046_141_61,
    -0.052_173_125_740_615_91,
    0.044_995_007_289_840_32,
    -0.033_387_824_501_211_95,
    0.015_113_765_096_600_925,
];

const TAN_PI_8: f64 = 0.414_213_562_373_095_05;

#[inline(always)]
fn select(condition: bool, a: f64, b: f64) -> f64 {
    if condition { a } else { b }
}

/// The angle in 0..=π of the vector (x, y), y ≥ 0; 0 for y = x = 0.
#[inline(always)]
pub(crate) fn angle_portable(y: f64, x: f64) -> f64 {
    let ax = x.abs();
    let steep = y > ax;
    let (small, large) = (select(steep, ax, y), select(steep, y, ax));
    let t = small / select(large > 0.0, large, 1.0);
    let wide = t > TAN_PI_8;
    let t = select(wide, (t - 1.0) / (t + 1.0), t);
    let s = t * t;
    let mut p = ATAN[12];
    for k in (0..12).rev() {
        p = p * s + ATAN[k];
    }
    let r = t * p + select(wide, std::f64::consts::FRAC_PI_4, 0.0);
    let r = select(steep, std::f64::consts::FRAC_PI_2 - r, r);
    select(x < 0.0, std::f64::consts::PI - r, r)
}

/// One edge's term of the contour sum.
#[inline(always)]
pub(super) fn term(n: [f64; 3], p: [f64; 3], q: [f64; 3]) -> f64 {
    let c = cross(p, q);
    let length = dot(c, c).sqrt();
    let along = dot(n, c) / select(length > 0.0, length, 1.0);
    along * angle_portable(length, dot(p, q))
}

/// Moves p towards q onto the horizon if p lies below it.
#[inline(always)]
fn lifted(p: [f64; 3], q: [f64; 3], zp: f64, zq: f64) -> [f64; 3] {
    let below = zp < 0.0;
    let difference = zp - zq;
    let f = select(below, zp / select(difference != 0.0, difference, 1.0), 0.0);
    [
        p[0] + (q[0] - p[0]) * f,
        p[1] + (q[1] - p[1]) * f,
        p[2] + (q[2] - p[2]) * f,
    ]
}

/// The part of an edge in the contour.
#[derive(Clone, Copy)]
struct Edge {
    /// The term of its part above the horizon.
    term: f64,
    /// The point at which it dips below the horizon, or 0.
    down: [f64; 3],
    /// The point at which it rises above the horizon, or 0.
    up: [f64; 3],
}

#[inline(always)]
fn edge(n: [f64; 3], p: [f64; 3], q: [f64; 3], zp: f64, zq: f64) -> Edge {
    let (from, to) = (lifted(p, q, zp, zq), lifted(q, p, zq, zp));
    let (dips, rises) = ((zp >= 0.0) & (zq < 0.0), (zp < 0.0) & (zq >= 0.0));
    Edge {
        term: select((zp < 0.0) & (zq < 0.0), 0.0, term(n, from, to)),
        down: [
            select(dips, to[0], 0.0),
            select(dips, to[1], 0.0),
            select(dips, to[2], 0.0),
        ],
        up: [
            select(rises, from[0], 0.0),
            select(rises, from[1], 0.0),
            select(rises, from[2], 0.0),
        ],
    }
}

#[inline(always)]
fn evaluate_portable(elements: &Elements, out: &mut [f64; LANES]) {
    for l in 0..LANES {
        let x = [elements.point[0][l], elements.point[1][l], elements.point[2][l]];
        let n = [elements.normal[0][l], elements.normal[1][l], elements.normal[2][l]];
        let corner = |k: usize| {
            [
                elements.corners[3 * k][l] - x[0],
                elements.corners[3 * k + 1][l] - x[1],
                elements.corners[3 * k + 2][l] - x[2],
            ]
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let (za, zb, zc) = (dot(n, a), dot(n, b), dot(n, c));
        // Each edge's part above the horizon. No inner loop, because it would keep the lanes from being vectorised.
        let (ab, bc, ca) = (edge(n, a, b, za, zb), edge(n, b, c, zb, zc), edge(n, c, a, zc, za));
        // A triangle crosses the horizon at most once each way, or not at all, when this term is 0.
        let down = plus(plus(ab.down, bc.down), ca.down);
        let up = plus(plus(ab.up, bc.up), ca.up);
        let sum = ab.term + bc.term + ca.term + term(n, down, up);
        let factor = sum * (-0.5 * std::f64::consts::FRAC_1_PI);
        out[l] = select(factor > 0.0, factor, 0.0);
    }
}

/// Number of weights of an edge: of two rules, three null rules and three corners.
pub(crate) const RULES: usize = 8;

/// Sums over edges of Lambert's terms, eight edges at a time, with [`RULES`] weights each.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct EdgeTerms {
    from: [[f64; LANES]; 3],
    to: [[f64; LANES]; 3],
    weights: [[f64; RULES]; LANES],
    filled: usize,
    normal: [f64; 3],
    sums: [f64; RULES],
}

impl Default for EdgeTerms {
    fn default() -> Self {
        Self {
            from: [[0.0; LANES]; 3],
            to: [[0.0; LANES]; 3],
            weights: [[0.0; RULES]; LANES],
            filled: 0,
            normal: [0.0; 3],
            sums: [0.0; RULES],
        }
    }
}

impl EdgeTerms {
    /// Begins elements of a unit normal.
    pub(crate) fn begin(&mut self, normal: glam::DVec3) {
        self.normal = normal.to_array();
        (self.filled, self.sums) = (0, [0.0; RULES]);
    }

    /// Adds the edge from `p` to `q`, seen from an element at the origin.
    #[inline]
    pub(crate) fn push(&mut self, p: glam::DVec3, q: glam::DVec3, weights: [f64; RULES]) {
        let l = self.filled;
        for k in 0..3 {
            self.from[k][l] = p[k];
            self.to[k][l] = q[k];
        }
        self.weights[l] = weights;
        self.filled += 1;
        if self.filled == LANES {
            self.flush();
        }
    }

    /// The weighted sums of factors, and begins new ones.
    pub(crate) fn finish(&mut self) -> [f64; RULES] {
        self.flush();
        std::mem::take(&mut self.sums).map(|sum| sum * (-0.5 * std::f64::consts::FRAC_1_PI))
    }

    fn flush(&mut self) {
        let mut terms = [0.0; LANES];
        terms_by(InstructionSet::widest(), self.normal, &self.from, &self.to, &mut terms);
        for (term, weights) in terms.iter().zip(&self.weights[..self.filled]) {
            for (sum, weight) in self.sums.iter_mut().zip(weights) {
                *sum += term * weight;
            }
        }
        self.filled = 0;
    }
}

dispatch! {
    fn terms_by = terms_portable(
        normal: [f64; 3],
        from: &[[f64; LANES]; 3],
        to: &[[f64; LANES]; 3],
        out: &mut [f64; LANES],
    )
}

#[inline(always)]
fn terms_portable(normal: [f64; 3], from: &[[f64; LANES]; 3], to: &[[f64; LANES]; 3], out: &mut [f64; LANES]) {
    for l in 0..LANES {
        out[l] = term(
            normal,
            [from[0][l], from[1][l], from[2][l]],
            [to[0][l], to[1][l], to[2][l]],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    #[test]
    fn angles_are_those_of_the_library() {
        for k in 0..=2000 {
            let exact = std::f64::consts::PI * f64::from(k) / 2000.0;
            for scale in [1e-150, 1.0, 1e150] {
                let found = angle_portable(exact.sin().abs() * scale, exact.cos() * scale);
                assert!((found - exact).abs() < 1e-15, "{exact}: {found}");
            }
        }
        assert_eq!(angle_portable(0.0, 0.0), 0.0);
    }

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    fn elements() -> impl Strategy<Value = Elements> {
        prop::collection::vec((point(), point(), [point(), point(), point()]), LANES).prop_map(|lanes| {
            let mut elements = Elements::new();
            for (l, (x, n, corners)) in lanes.into_iter().enumerate() {
                let n = n.try_normalize().unwrap_or(DVec3::Z);
                for k in 0..3 {
                    elements.point[k][l] = x[k];
                    elements.normal[k][l] = n[k];
                    for (c, corner) in corners.iter().enumerate() {
                        elements.corners[3 * c + k][l] = corner[k];
                    }
                }
            }
            elements
        })
    }

    proptest! {
        #[test]
        fn every_path_gives_the_same_bits(elements in elements()) {
            let mut portable = [0.0; LANES];
            evaluate_portable(&elements, &mut portable);
            for set in InstructionSet::all() {
                let mut out = [0.0; LANES];
                evaluate_by(set, &elements, &mut out);
                prop_assert_eq!(out.map(f64::to_bits), portable.map(f64::to_bits));
            }
        }

        #[test]
        fn a_triangle_and_its_pieces_give_the_same(elements in elements(), u in 0.0..1.0f64) {
            // Cut by a line through corner 0: the two parts add up, whatever the horizon does.
            let whole = evaluate(&elements);
            let (mut left, mut right) = (elements.clone(), elements.clone());
            for k in 0..3 {
                for l in 0..LANES {
                    let (p, q) = (elements.corners[3 + k][l], elements.corners[6 + k][l]);
                    let cut = p + (q - p) * u;
                    left.corners[6 + k][l] = cut;
                    right.corners[3 + k][l] = cut;
                }
            }
            let (left, right) = (evaluate(&left), evaluate(&right));
            for l in 0..LANES {
                prop_assert!((0.0..=1.0 + 1e-12).contains(&whole[l]));
                let (left, right, whole) = (left[l], right[l], whole[l]);
                prop_assert!((left + right - whole).abs() < 1e-11, "{left} + {right} ≠ {whole}");
            }
        }
    }
}
