//! Form factors between triangles far from each other, eight pairs at a time.
//!
//! Beyond some radii of both triangles the kernel cos φ_i cos φ_j / (π r²) is nearly a quadratic over either of them.
//! The three midpoints of the edges integrate a quadratic exactly (degree 2; Hammer & Stroud 1956): nine evaluations,
//! no arc tangent. The order of addition stays the same when the two triangles change places: A_i F_ij = A_j F_ji to
//! the bit.

use super::lanes::LANES;
use crate::simd::{InstructionSet, cross, dispatch, dot, minus, most};
use glam::DVec3;

/// A triangle, prepared for evaluation.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Own {
    corners: [[f64; 3]; 3],
    /// Midpoints of the edges.
    middles: [[f64; 3]; 3],
    pub(crate) center: [f64; 3],
    /// The normal, as long as twice the area.
    pub(crate) cross: [f64; 3],
    /// Squared radius of the sphere round the centre.
    pub(crate) squared_radius: f64,
}

impl Own {
    pub(super) fn new(corners: &[DVec3; 3]) -> Self {
        let [a, b, c] = corners.map(|p| p.to_array());
        shape(a, b, c)
    }
}

/// Prepares a triangle for evaluation.
#[inline(always)]
pub(crate) fn shape(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Own {
    let middle = |p: [f64; 3], q: [f64; 3]| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])];
    let third = 1.0 / 3.0;
    let center = [
        (a[0] + b[0] + c[0]) * third,
        (a[1] + b[1] + c[1]) * third,
        (a[2] + b[2] + c[2]) * third,
    ];
    let cross = cross(minus(b, a), minus(c, a));
    let distance = |p: [f64; 3]| {
        let d = minus(p, center);
        dot(d, d)
    };
    let (p, q, r) = (distance(a), distance(b), distance(c));
    Own {
        corners: [a, b, c],
        middles: [middle(a, b), middle(b, c), middle(c, a)],
        center,
        cross,
        squared_radius: most(most(p, q), r),
    }
}

/// Eight triangles, by coordinate of corner 0, then 1, then 2.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Others {
    pub(super) corners: [[f64; LANES]; 9],
}

/// Results for eight pairs.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Far {
    /// The exchange area A_i F_ij where `kind` is [`DONE`].
    pub(super) exchange: [f64; LANES],
    pub(super) kind: [u64; LANES],
}

/// The exchange area is within the rule's error, or 0: one triangle lies wholly behind the other.
pub(super) const DONE: u64 = 1;

impl Far {
    pub(super) const fn new() -> Self {
        Self {
            exchange: [0.0; LANES],
            kind: [0; LANES],
        }
    }
}

/// Evaluates eight pairs, except those nearer than `radii` of both triangles or cut by one's plane.
pub(super) fn evaluate(own: &Own, others: &Others, radii: f64) -> Far {
    let mut out = Far::new();
    evaluate_by(InstructionSet::widest(), own, others, radii, &mut out);
    out
}

dispatch! {
    fn evaluate_by = evaluate_portable(own: &Own, others: &Others, radii: f64, out: &mut Far)
}

/// (N_i · d)(−N_j · d) / d⁴: symmetric to the bit.
#[inline(always)]
fn kernel(own: &Own, other: &Own, k: usize, l: usize) -> f64 {
    let d = minus(other.middles[l], own.middles[k]);
    let square = dot(d, d);
    (dot(own.cross, d) * -dot(other.cross, d)) / (square * square)
}

#[inline(always)]
fn evaluate_portable(own: &Own, others: &Others, radii: f64, out: &mut Far) {
    let limit = 2.0 * radii * radii;
    for l in 0..LANES {
        let corner = |k: usize| {
            [
                others.corners[3 * k][l],
                others.corners[3 * k + 1][l],
                others.corners[3 * k + 2][l],
            ]
        };
        let other = shape(corner(0), corner(1), corner(2));
        // Heights of each one's corners above the other's plane.
        let (mut all_front, mut none_of_other, mut none_of_own) = (true, true, true);
        for k in 0..3 {
            let of_other = dot(own.cross, minus(other.corners[k], own.center));
            let of_own = dot(other.cross, minus(own.corners[k], other.center));
            all_front &= (of_other > 0.0) & (of_own > 0.0);
            none_of_other &= of_other <= 0.0;
            none_of_own &= of_own <= 0.0;
        }
        let between = minus(other.center, own.center);
        let is_far = dot(between, between) >= limit * (own.squared_radius + other.squared_radius);
        // Mirrored terms in pairs: a sum of two does not depend on its order.
        let kernel = |k: usize, l: usize| kernel(own, &other, k, l);
        let on = kernel(0, 0) + kernel(1, 1) + kernel(2, 2);
        let off = (kernel(0, 1) + kernel(1, 0)) + (kernel(1, 2) + kernel(2, 1)) + (kernel(2, 0) + kernel(0, 2));
        let behind = none_of_other | none_of_own;
        let exchange = (on + off) * (std::f64::consts::FRAC_1_PI / 36.0);
        out.exchange[l] = if behind { 0.0 } else { exchange };
        out.kind[l] = if behind | (all_front & is_far) { DONE } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::{FactorRule, exchange};
    use crate::geometry::{area, centroid};
    use proptest::prelude::*;

    fn others(triangle: &[DVec3; 3]) -> Others {
        let mut others = Others {
            corners: [[0.0; LANES]; 9],
        };
        for (k, corner) in triangle.iter().enumerate() {
            for x in 0..3 {
                others.corners[3 * k + x] = [corner[x]; LANES];
            }
        }
        others
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array))
    }

    proptest! {
        #[test]
        fn every_path_gives_the_same_bits_and_so_do_both_directions(
            i in triangle(), j in triangle(), shift in prop::array::uniform3(-9.0..9.0f64),
        ) {
            let j = j.map(|p| p + DVec3::from_array(shift));
            let (own, other) = (Own::new(&i), others(&j));
            let mut portable = Far::new();
            evaluate_portable(&own, &other, 6.0, &mut portable);
            let back = evaluate(&Own::new(&j), &others(&i), 6.0);
            prop_assert_eq!(portable.kind, back.kind);
            if portable.kind[0] == DONE {
                prop_assert_eq!(portable.exchange[0].to_bits(), back.exchange[0].to_bits());
            }
            for set in InstructionSet::all() {
                let mut out = Far::new();
                evaluate_by(set, &own, &other, 6.0, &mut out);
                prop_assert_eq!(out.exchange.map(f64::to_bits), portable.exchange.map(f64::to_bits));
                prop_assert_eq!(out.kind, portable.kind);
            }
        }

        #[test]
        fn far_pairs_are_as_good_as_their_distance(
            i in triangle(), j in triangle(), shift in prop::array::uniform3(-40.0..40.0f64),
        ) {
            let j = j.map(|p| p + DVec3::from_array(shift));
            for (radii, bound) in [(6.0, 3e-3), (18.0, 2e-4)] {
                let far = evaluate(&Own::new(&i), &others(&j), radii);
                if far.kind[0] == DONE && far.exchange[0] > 0.0 {
                    // The largest exchange area at this distance, of triangles turned to each other.
                    let squared = centroid(&i).distance_squared(centroid(&j));
                    let most = area(&i) * area(&j) / (std::f64::consts::PI * squared);
                    let exact = exchange(&i, &j, &FactorRule::for_tolerance(1e-6));
                    prop_assert!((far.exchange[0] - exact).abs() < bound * most, "{} {exact}", far.exchange[0]);
                }
            }
        }
    }
}
