//! Walks against brute force over all boxes.

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::morton::{LEVEL_COUNT, decode};
use hemicube_spatial::{Aabb, Containment, CullCounters, Frustum, Node, Octree, OctreeOptions, Plane, Visit};
use proptest::prelude::*;

fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = DVec3> {
    [range.clone(), range.clone(), range].prop_map(DVec3::from_array)
}

fn boxes() -> impl Strategy<Value = Vec<Aabb>> {
    let size = prop_oneof![4 => 0.0..0.3f64, 1 => 0.0..4.0f64];
    let one = (vector(-5.0..5.0), vector(0.0..1.0), size);
    prop::collection::vec(
        one.prop_map(|(min, extent, size)| Aabb {
            min,
            max: min + extent * size,
        }),
        0..250,
    )
}

fn options() -> impl Strategy<Value = OctreeOptions> {
    (0..=LEVEL_COUNT, 0..12u32).prop_map(|(max_level, min_items)| OctreeOptions { max_level, min_items })
}

/// The side of a hemicube of random frame: a pyramid of 90°, from above the horizon.
fn frustum() -> impl Strategy<Value = (DVec3, [DVec3; 4])> {
    let axis = vector(-1.0..1.0).prop_filter("not too short", |v| v.length() > 0.1);
    (vector(-6.0..6.0), axis, any::<bool>()).prop_map(|(apex, axis, top)| {
        let z = axis.normalize();
        let (x, y) = z.any_orthonormal_pair();
        let corners = if top {
            [z - x - y, z + x - y, z + x + y, z - x + y]
        } else {
            [x - y, x + y, x + y + z, x - y + z]
        };
        (apex, corners)
    })
}

/// What became of each item of the input, from the ranges that a walk gave.
fn outcomes(octree: &Octree, frustum: &Frustum) -> (Vec<Containment>, CullCounters) {
    let mut outcomes = vec![Containment::Outside; octree.order().len()];
    let mut last: Option<(u32, Containment)> = None;
    let counters = octree.cull(frustum, |items, containment| {
        assert!(!items.is_empty() && containment != Containment::Outside);
        if let Some((end, before)) = last {
            assert!(
                end < items.start || (end == items.start && before != containment),
                "{end} {items:?}"
            );
        }
        last = Some((items.end, containment));
        for &item in &octree.order()[items.start as usize..items.end as usize] {
            outcomes[item as usize] = containment;
        }
    });
    (outcomes, counters)
}

/// The largest and the smallest signed offset over the box, of each plane.
fn offsets(plane: &Plane, b: &Aabb) -> (f64, f64) {
    let (low, high) = (
        (b.min - plane.point) * plane.normal,
        (b.max - plane.point) * plane.normal,
    );
    (low.min(high).element_sum(), low.max(high).element_sum())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn culling_is_brute_force(
        boxes in boxes(),
        loose in any::<bool>(),
        options in options(),
        (apex, corners) in frustum(),
        samples in prop::collection::vec([0.01..1.0, 0.01..1.0, 0.01..1.0, 0.01..1.0], 50),
    ) {
        let build = if loose { Octree::build_loose } else { Octree::build };
        let octree = build(&boxes, options).expect("finite boxes");
        let frustum = Frustum::pyramid(apex, corners).expect("a right pyramid");
        let (outcomes, counters) = outcomes(&octree, &frustum);
        for (b, outcome) in boxes.iter().zip(&outcomes) {
            let by_plane: Vec<_> = frustum.planes().map(|plane| offsets(&plane, b)).collect();
            match outcome {
                Containment::Outside => prop_assert!(by_plane.iter().any(|&(_, highest)| highest < 1e-12)),
                Containment::Inside => prop_assert!(by_plane.iter().all(|&(lowest, _)| lowest > -1e-12)),
                Containment::Straddling => {}
            }
        }
        // No box is missed that a point of the frustum is in.
        for sample in samples {
            let p = apex + (0..4).map(|i| corners[i] * (sample[i] * 5.0)).sum::<DVec3>();
            for (b, outcome) in boxes.iter().zip(&outcomes) {
                prop_assert!(*outcome != Containment::Outside || !b.contains(p), "{:?} is culled, {} in it", b, p);
            }
        }
        let culled = outcomes.iter().filter(|&&o| o == Containment::Outside).count();
        prop_assert_eq!(counters.items_culled, culled as u64);
        prop_assert!(counters.nodes_culled + counters.nodes_inside <= counters.nodes_tested);
        prop_assert!(counters.nodes_tested <= 2 * octree.nodes().len() as u64);
    }

    /// One item a leaf and no own items higher up: then culling is as sharp as testing each box.
    #[test]
    fn culling_of_points_is_sharp(points in prop::collection::vec(vector(-5.0..5.0), 1..200), (apex, corners) in frustum()) {
        let boxes: Vec<Aabb> = points.iter().map(|&p| Aabb::from_points([p])).collect();
        let octree = Octree::build(&boxes, OctreeOptions { max_level: 21, min_items: 1 }).expect("finite boxes");
        let frustum = Frustum::pyramid(apex, corners).expect("a right pyramid");
        let (outcomes, _) = outcomes(&octree, &frustum);
        for (b, outcome) in boxes.iter().zip(outcomes) {
            prop_assert_eq!(outcome, frustum.classify(b));
        }
    }

    /// Along a ray from the eye, the leaves whose cells it crosses are visited in the order of crossing.
    #[test]
    fn visits_go_front_to_back(
        points in prop::collection::vec(vector(0.0..1.0), 2..200),
        eye in vector(-0.5..1.5),
        target in vector(0.0..1.0),
    ) {
        let boxes: Vec<Aabb> = points.iter().map(|&p| Aabb::from_points([p])).collect();
        let octree = Octree::build(&boxes, OctreeOptions { max_level: 21, min_items: 2 }).expect("finite boxes");
        let mut rank = vec![None; octree.nodes().len()];
        let mut visits = 0;
        octree.visit_front_to_back(eye, |index, node| {
            assert!(rank[index as usize].replace(visits).is_none(), "visited twice");
            if let Some(parent) = node.parent {
                assert!(rank[parent as usize].is_some(), "before its parent");
            }
            visits += 1;
            Visit::Descend
        });
        prop_assert_eq!(visits, octree.nodes().len());
        let mut last = None;
        for step in 0..400 {
            let p = eye.lerp(target, f64::from(step) / 200.0);
            let unit = octree.cube().unit_position(p);
            if unit.min_element() < 0.0 || unit.max_element() >= 1.0 {
                continue;
            }
            let cell = decode(octree.cube().position_code(p));
            let holds = |node: &Node| cell.map(|c| c >> (LEVEL_COUNT - node.level)) == node.cell;
            if let Some(leaf) = octree.nodes().iter().position(|node| node.is_leaf() && holds(node)) {
                prop_assert!(last <= rank[leaf], "leaf {} after the {:?}th visit", leaf, last);
                last = rank[leaf];
            }
        }
    }
}

fn row(count: u32) -> Vec<Aabb> {
    (0..count)
        .map(|i| Aabb::from_points([DVec3::new(f64::from(i), 0.0, 0.0)]))
        .collect()
}

#[test]
fn a_wholly_visible_octree_is_one_range() {
    let boxes = row(1000);
    let octree = Octree::build(&boxes, OctreeOptions::default()).expect("finite boxes");
    let everything = Frustum::from_planes(&[]);
    let mut ranges = Vec::new();
    let counters = octree.cull(&everything, |items, containment| ranges.push((items, containment)));
    assert_eq!(ranges, [(0..1000, Containment::Inside)]);
    assert_eq!(
        counters,
        CullCounters {
            nodes_tested: 1,
            nodes_culled: 0,
            nodes_inside: 1,
            items_culled: 0
        }
    );

    let nothing = Frustum::from_planes(&[Plane {
        point: DVec3::Y,
        normal: DVec3::Y,
    }]);
    let mut sum = counters;
    sum += octree.cull(&nothing, |items, _| panic!("{items:?} is outside"));
    assert_eq!(
        sum,
        CullCounters {
            nodes_tested: 2,
            nodes_culled: 1,
            nodes_inside: 1,
            items_culled: 1000
        }
    );
}

#[test]
fn an_empty_octree_has_nothing_to_visit() {
    let octree = Octree::build(&[], OctreeOptions::default()).expect("no boxes");
    let counters = octree.cull(&Frustum::default(), |items, _| panic!("{items:?} of nothing"));
    assert_eq!(counters, CullCounters::default());
    octree.visit_front_to_back(DVec3::ZERO, |index, _| panic!("node {index} of none"));
}

#[test]
fn skip_and_stop_are_obeyed() {
    let octree = Octree::build(
        &row(1000),
        OctreeOptions {
            max_level: 21,
            min_items: 1,
        },
    )
    .expect("finite boxes");
    let mut visited = 0;
    octree.visit_front_to_back(DVec3::ZERO, |_, node| {
        visited += 1;
        if node.level == 0 { Visit::Descend } else { Visit::Skip }
    });
    assert_eq!(visited, 1 + octree.nodes()[0].child_count);
    visited = 0;
    octree.visit_front_to_back(DVec3::ZERO, |_, _| {
        visited += 1;
        if visited < 7 { Visit::Descend } else { Visit::Stop }
    });
    assert_eq!(visited, 7);
}

/// A NaN eye has no order, but must not lose a node or panic.
#[test]
fn an_eye_nowhere_still_sees_all_nodes() {
    let octree = Octree::build(
        &row(100),
        OctreeOptions {
            max_level: 21,
            min_items: 1,
        },
    )
    .expect("finite boxes");
    for eye in [DVec3::NAN, DVec3::INFINITY, DVec3::NEG_INFINITY] {
        let mut visited = 0;
        octree.visit_front_to_back(eye, |_, _| {
            visited += 1;
            Visit::Descend
        });
        assert_eq!(visited, octree.nodes().len());
    }
}
