//! The three outcomes against exact arithmetic and against points of which the side is known.

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, Containment, Frustum, Plane};
use proptest::prelude::*;

/// A plane and a box with integer coordinates, so that i128 knows the signed offset of each corner. Sliding the box far
/// along the plane makes the terms of the offset huge, and they nearly cancel.
fn near_miss() -> impl Strategy<Value = (Plane, Aabb, i128, i128)> {
    let size = 1i64 << 40;
    let point = [-size..size, -size..size, -size..size];
    let normal = (100..1i64 << 12, -8..=8i64, -3..=3i64, any::<bool>());
    let step = (-3..=3i64, -3..=3i64);
    (normal, -size..size, point, step, [0..2i64, 0..2i64, 0..2i64]).prop_map(
        |((a, more, c, minus), slide, point, (step, rise), extent)| {
            let b = if minus { -a - more } else { a + more };
            let low = [
                point[0] + b * slide + step,
                point[1] - a * slide - step * b.signum(),
                point[2] + rise,
            ];
            let high = [low[0] + extent[0], low[1] + extent[1], low[2] + extent[2]];
            let normal = [a, b, c];
            let offset = |pick: fn(i128, i128) -> i128| -> i128 {
                (0..3)
                    .map(|axis| {
                        let term = |p: i64| i128::from(normal[axis]) * (i128::from(p) - i128::from(point[axis]));
                        pick(term(low[axis]), term(high[axis]))
                    })
                    .sum()
            };
            #[allow(clippy::cast_precision_loss, reason = "all below 2⁵³")]
            let vector = |v: [i64; 3]| DVec3::from_array(v.map(|x| x as f64));
            let plane = Plane {
                point: vector(point),
                normal: vector(normal),
            };
            (
                plane,
                Aabb {
                    min: vector(low),
                    max: vector(high),
                },
                offset(i128::min),
                offset(i128::max),
            )
        },
    )
}

fn direction() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0]
        .prop_map(DVec3::from_array)
        .prop_filter("not too short", |v| v.length() > 0.1)
        .prop_map(DVec3::normalize)
}

/// A convex pyramid: apex and corners round an axis, all lengths and openings.
fn pyramid() -> impl Strategy<Value = (DVec3, [DVec3; 4])> {
    let apex = (direction(), -3..8i32).prop_map(|(d, scale)| d * 10f64.powi(scale));
    let opening = [0.02..3.0, 0.02..3.0, 0.02..3.0, 0.02..3.0];
    (apex, direction(), opening, -6..6i32, any::<bool>()).prop_map(|(apex, axis, opening, scale, reversed)| {
        let (u, v) = axis.any_orthonormal_pair();
        // One corner on each half axis: convex whatever the four openings.
        let [a, b, c, d] = opening;
        let mut corners = [u * a, v * b, -u * c, -v * d].map(|side| (axis + side) * 10f64.powi(scale));
        if reversed {
            corners.reverse();
        }
        (apex, corners)
    })
}

fn cube_round(p: DVec3, half: f64) -> Aabb {
    Aabb {
        min: p - half,
        max: p + half,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, max_global_rejects: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn outcomes_are_proofs_against_exact_arithmetic((plane, bounds, lowest, highest) in near_miss()) {
        match Frustum::from_planes(&[plane]).classify(&bounds) {
            Containment::Outside => prop_assert!(highest < 0, "culled, but a corner is {} inside", highest),
            Containment::Inside => prop_assert!(lowest > 0, "inside, but a corner is {} outside", lowest),
            Containment::Straddling => {}
        }
    }

    /// The margin is no excuse: what is clear of the plane by a part in 10¹² of its distance is decided.
    #[test]
    fn what_is_clear_is_decided((plane, bounds, lowest, highest) in near_miss(), lift in 1i32..40) {
        let reach = (bounds.min - plane.point).abs().max((bounds.max - plane.point).abs());
        let clear = (reach * plane.normal.abs()).element_sum() * 1e-12 + 2f64.powi(lift);
        let outcome = Frustum::from_planes(&[plane]).classify(&bounds);
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        let (lowest, highest) = (lowest as f64, highest as f64);
        prop_assert!(lowest < clear || outcome == Containment::Inside);
        prop_assert!(highest > -clear || outcome == Containment::Outside);
    }

    #[test]
    fn pyramids_know_their_points(
        (apex, corners) in pyramid(),
        weights in [0.01..1.0, 0.01..1.0, 0.01..1.0, 0.01..1.0],
        distance in -5..5i32,
        miss in -5..0i32,
        half in -8..3i32,
    ) {
        let frustum = Frustum::pyramid(apex, corners).expect("convex by construction");
        prop_assert_eq!(frustum.planes().len(), 4);
        let scale = 10f64.powi(distance) / corners[0].length();
        let sum = |weights: [f64; 4]| -> DVec3 { (0..4).map(|i| corners[i] * (weights[i] * scale)).sum() };
        let half = 10f64.powi(half) * 10f64.powi(distance);

        let inside = apex + sum(weights);
        // Unless the sum is lost in the apex' own rounding, in which case nothing is known of the point.
        prop_assume!((inside - apex).length() > 1e-9 * apex.length());
        prop_assert_ne!(frustum.classify(&cube_round(inside, half)), Containment::Outside);
        prop_assert!(frustum.contains(inside));

        let behind = apex - sum(weights);
        prop_assert_ne!(frustum.classify(&cube_round(behind, half)), Containment::Inside);
        prop_assert!(!frustum.contains(behind));

        // Beyond each side in turn, by a small part of the distance.
        let t = -(10f64.powi(miss));
        prop_assume!((inside - apex).length() * t.abs() > 1e-6 * apex.length());
        for side in 0..4 {
            let mut beyond = weights;
            beyond[(side + 2) % 4] = t;
            beyond[(side + 3) % 4] = t;
            let beyond = apex + sum(beyond);
            prop_assert_ne!(frustum.classify(&cube_round(beyond, half)), Containment::Inside);
            prop_assert_eq!(frustum.classify(&cube_round(beyond, 0.0)), Containment::Outside);
        }
        prop_assert_eq!(frustum.classify(&cube_round(inside, 0.0)), Containment::Inside);
    }
}

/// Shows that the near misses of these tests are such that plain signs get them wrong.
#[test]
fn without_a_margin_near_misses_are_misjudged() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let strategy = near_miss();
    let mut misjudged = 0;
    for _ in 0..2000 {
        let (plane, bounds, lowest, highest) = strategy.new_tree(&mut runner).expect("a case").current();
        let (a, b) = (
            (bounds.min - plane.point) * plane.normal,
            (bounds.max - plane.point) * plane.normal,
        );
        let naive = (a.min(b).element_sum(), a.max(b).element_sum());
        misjudged += usize::from((naive.0 > 0.0 && lowest <= 0) || (naive.1 < 0.0 && highest >= 0));
    }
    assert!(misjudged > 20, "only {misjudged} of 2000");
}
