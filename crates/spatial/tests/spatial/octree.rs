//! Building: structure over random, flat, heaped and extreme boxes.

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::morton::LEVEL_COUNT;
use hemicube_spatial::{Aabb, Fit, Octree, OctreeError, OctreeOptions};
use proptest::prelude::*;

/// Boxes on a grid and off it, points, slabs and heaps.
fn boxes() -> impl Strategy<Value = Vec<Aabb>> {
    let coordinate = || prop_oneof![(-16..16i32).prop_map(|x| f64::from(x) / 4.0), -4.0..4.0];
    let length = || prop_oneof![Just(0.0), Just(0.25), 0.0..0.2, 0.0..3.0];
    let one = (
        [coordinate(), coordinate(), coordinate()],
        [length(), length(), length()],
    )
        .prop_map(|(low, size)| {
            let min = DVec3::from_array(low);
            Aabb {
                min,
                max: min + DVec3::from_array(size),
            }
        });
    (prop::collection::vec(one, 0..120), 0..40usize, -9..9i32).prop_map(|(mut boxes, heap, scale)| {
        if let Some(&first) = boxes.first() {
            boxes.extend(vec![first; heap]);
        }
        for b in &mut boxes {
            *b = Aabb {
                min: b.min * 10f64.powi(scale),
                max: b.max * 10f64.powi(scale),
            };
        }
        boxes
    })
}

fn build_as(fit: Fit, boxes: &[Aabb], options: OctreeOptions) -> Octree {
    match fit {
        Fit::Whole => Octree::build(boxes, options),
        Fit::Loose => Octree::build_loose(boxes, options),
    }
    .expect("finite boxes")
}

fn fit() -> impl Strategy<Value = Fit> {
    prop_oneof![Just(Fit::Whole), Just(Fit::Loose)]
}

fn options() -> impl Strategy<Value = OctreeOptions> {
    (0..=LEVEL_COUNT, 0..12u32).prop_map(|(max_level, min_items)| OctreeOptions { max_level, min_items })
}

fn build(boxes: &[Aabb], max_level: u32, min_items: u32) -> Octree {
    let octree = Octree::build(boxes, OctreeOptions { max_level, min_items }).expect("finite boxes");
    assert_eq!(octree.validate(boxes), Ok(()));
    octree
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn every_octree_is_valid(boxes in boxes(), fit in fit(), options in options()) {
        let octree = build_as(fit, &boxes, options);
        prop_assert_eq!(octree.validate(&boxes), Ok(()));
        prop_assert!(octree.nodes().len() <= 2 * boxes.len());
        prop_assert_eq!(&build_as(fit, &boxes, options), &octree);
    }

    /// Told apart from `validate`, by counting.
    #[test]
    fn every_item_is_the_own_of_one_node(boxes in boxes(), fit in fit(), options in options()) {
        let octree = build_as(fit, &boxes, options);
        let mut owners = vec![0; boxes.len()];
        for node in octree.nodes() {
            for place in node.own() {
                let item = octree.order()[place as usize] as usize;
                owners[item] += 1;
                prop_assert!(node.own_bounds.contains_box(&boxes[item]));
            }
            for place in node.all() {
                prop_assert!(node.bounds.contains_box(&boxes[octree.order()[place as usize] as usize]));
            }
        }
        prop_assert!(owners.iter().all(|&count| count == 1));
    }

    #[test]
    fn levels_and_items_keep_to_the_options(boxes in boxes(), fit in fit(), options in options()) {
        let octree = build_as(fit, &boxes, options);
        for node in octree.nodes() {
            prop_assert!(node.level <= options.max_level);
            prop_assert!(node.is_leaf() || node.all().len() > options.min_items as usize);
        }
    }
}

#[test]
fn of_nothing_there_are_no_nodes() {
    let octree = build(&[], 21, 0);
    assert!(octree.nodes().is_empty() && octree.order().is_empty());
}

#[test]
fn a_single_box_is_a_leaf() {
    let b = Aabb {
        min: DVec3::splat(-2.0),
        max: DVec3::new(3.0, 4.0, 5.0),
    };
    for min_items in [0, 1] {
        let octree = build(&[b], 21, min_items);
        let [root] = octree.nodes() else {
            panic!("{} nodes", octree.nodes().len())
        };
        assert!(root.is_leaf() && root.parent.is_none() && root.own() == (0..1) && root.bounds == b);
    }
}

#[test]
fn a_heap_of_equal_boxes_makes_no_chain() {
    let point = Aabb::from_points([DVec3::splat(0.1)]);
    assert_eq!(build(&vec![point; 1000], 21, 4).nodes().len(), 1);
    let far = Aabb::from_points([DVec3::splat(1e6)]);
    let mut boxes = vec![point; 1000];
    boxes.push(far);
    let octree = build(&boxes, 21, 4);
    assert_eq!(octree.nodes().len(), 3, "a root, the heap and the one far away");
    assert_eq!(octree.nodes()[1].level, 21);
    let identity: Vec<u32> = (0..1001).collect();
    assert_eq!(octree.order(), identity, "ties by input index");
}

#[test]
fn a_grid_that_fits_the_cells_leaves_nothing_behind() {
    // 556 is the width of the Cornell room: no power of two, and cut into 16 by exact halving all the same.
    let edge = 556.0 / 16.0;
    let tile = |i: u32, j: u32| {
        let min = DVec3::new(f64::from(i) * edge, f64::from(j) * edge, 7.0);
        Aabb {
            min,
            max: min + DVec3::new(edge, edge, 0.0),
        }
    };
    let boxes: Vec<Aabb> = (0..16).flat_map(|i| (0..16).map(move |j| tile(i, j))).collect();
    let octree = build(&boxes, 4, 1);
    for node in octree.nodes() {
        assert_eq!(node.own().len(), usize::from(node.is_leaf()), "{node:?}");
        assert_eq!(node.is_leaf(), node.level == 4);
    }
    assert_eq!(
        octree.nodes().len(),
        1 + 4 + 16 + 64 + 256,
        "a flat scene is a quadtree"
    );
}

#[test]
fn own_items_are_in_order_of_their_middles() {
    // All astride the middle in x, listed against their order in y.
    let slab = |y: f64| Aabb {
        min: DVec3::new(-1.0, y, 0.0),
        max: DVec3::new(1.0, y + 0.01, 0.0),
    };
    let boxes: Vec<Aabb> = (0..100).rev().map(|i| slab(f64::from(i) / 50.0 - 1.0)).collect();
    let octree = build(&boxes, 21, 10);
    let expected: Vec<u32> = (0..100).rev().collect();
    assert_eq!(octree.order(), expected);
}

/// Tiles laid across the borders of all cells: a strict octree keeps most of them high up, a loose one none.
#[test]
fn a_loose_octree_takes_items_down() {
    let tile = |k: u32| {
        let min = DVec3::new(f64::from(k % 100) + 0.5, f64::from(k / 100) + 0.5, 0.0);
        Aabb::from_points([min, min + DVec3::new(1.0, 1.0, 0.0)])
    };
    let mut boxes: Vec<Aabb> = (0..10_000).map(tile).collect();
    boxes.push(Aabb::from_points([DVec3::ZERO, DVec3::splat(128.0)]));
    let options = OctreeOptions {
        max_level: 21,
        min_items: 16,
    };
    let high_up = |octree: Octree| -> usize {
        assert_eq!(octree.validate(&boxes), Ok(()));
        octree
            .nodes()
            .iter()
            .filter(|node| !node.is_leaf())
            .map(|node| node.own().len())
            .sum()
    };
    assert!(high_up(build_as(Fit::Whole, &boxes, options)) > 3000);
    assert_eq!(
        high_up(build_as(Fit::Loose, &boxes, options)),
        1,
        "the one that is as large as the cube"
    );
}

#[test]
fn extremes_of_size_and_place_are_built() {
    let max = f64::MAX;
    let all = Aabb {
        min: DVec3::splat(-max),
        max: DVec3::splat(max),
    };
    let corner = Aabb::from_points([DVec3::splat(max)]);
    let tiny = Aabb::from_points([DVec3::splat(5e-324), DVec3::ZERO]);
    build_as(Fit::Loose, &[all, corner, tiny, tiny], OctreeOptions::default());
    let octree = build(&[all, corner, tiny, tiny], 21, 1);
    assert_eq!(octree.nodes()[0].bounds, all);
    build(&[tiny, tiny, Aabb::from_points([DVec3::ZERO])], 21, 0);
    let far = DVec3::new(1e7, -1e7, 1e7);
    let boxes: Vec<Aabb> = (0..200)
        .map(|i| Aabb::from_points([far + f64::from(i) * 1e-6, far + f64::from(i + 1) * 1e-6]))
        .collect();
    assert!(build(&boxes, 21, 2).nodes().len() > 50);
}

#[test]
fn bad_input_is_named() {
    let good = Aabb {
        min: DVec3::ZERO,
        max: DVec3::ONE,
    };
    let options = OctreeOptions::default();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            for end in 0..2 {
                let mut b = good;
                (if end == 0 { &mut b.min } else { &mut b.max })[axis] = bad;
                assert_eq!(
                    Octree::build(&[good, b], options),
                    Err(OctreeError::NonFinite { index: 1 }),
                    "{b:?}"
                );
            }
        }
    }
    let inverted = Aabb {
        min: DVec3::ONE,
        max: DVec3::new(2.0, 2.0, 0.5),
    };
    assert_eq!(
        Octree::build(&[inverted], options),
        Err(OctreeError::EmptyBox { index: 0 })
    );
    assert_eq!(
        Octree::build(&[Aabb::EMPTY], options),
        Err(OctreeError::NonFinite { index: 0 })
    );
    let too_deep = OctreeOptions {
        max_level: 22,
        min_items: 1,
    };
    assert_eq!(
        Octree::build(&[good], too_deep),
        Err(OctreeError::Level { max_level: 22 })
    );
    for error in [
        OctreeError::NonFinite { index: 3 },
        OctreeError::EmptyBox { index: 3 },
        OctreeError::Level { max_level: 22 },
        OctreeError::TooMany { count: 1 << 33 },
    ] {
        let text = error.to_string();
        assert!(
            text.starts_with(|c: char| !c.is_uppercase()) && !text.ends_with('.') && text.contains("; "),
            "{text}"
        );
    }
}

/// The size of the largest scene that the thesis took on.
#[test]
fn a_million_and_a_half_boxes_are_built() {
    let side = 1225u32;
    let tile = |k: u32| {
        let (i, j) = (f64::from(k % side), f64::from(k / side));
        Aabb::from_points([
            DVec3::new(i, j, (i * 0.37).sin() * 9.0),
            DVec3::new(i + 1.0, j + 1.0, (j * 0.73).sin() * 9.0),
        ])
    };
    let boxes: Vec<Aabb> = (0..side * side).map(tile).collect();
    let start = std::time::Instant::now();
    let octree = Octree::build(&boxes, OctreeOptions::default()).expect("finite boxes");
    let seconds = start.elapsed().as_secs_f64();
    assert_eq!(octree.validate(&boxes), Ok(()));
    // What the time is when nothing else runs is for the bench to say; this only catches a blow-up.
    assert!(seconds < 30.0, "{} boxes took {seconds} s", boxes.len());
}
