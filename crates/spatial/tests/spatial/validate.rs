//! Shows `validate` failing: each kind of defect, made in a good octree.

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::morton::Cube;
use hemicube_spatial::{Aabb, Fit, Node, Octree, OctreeOptions, ValidationError};

/// The parts of an octree, to be doctored.
struct Parts {
    options: OctreeOptions,
    cube: Cube,
    order: Vec<u32>,
    nodes: Vec<Node>,
    boxes: Vec<Aabb>,
}

/// Points in all octants, a few of them near each other, and two boxes that fit no octant.
fn good() -> Parts {
    let mut boxes: Vec<Aabb> = (0..64u32)
        .map(|i| {
            let p = DVec3::new(f64::from(i % 4), f64::from(i / 4 % 4), f64::from(i / 16)) / 3.0;
            Aabb {
                min: p * 0.9,
                max: p * 0.9 + 0.1,
            }
        })
        .collect();
    boxes.push(Aabb {
        min: DVec3::splat(0.4),
        max: DVec3::splat(0.6),
    });
    boxes.push(Aabb {
        min: DVec3::splat(0.3),
        max: DVec3::splat(0.7),
    });
    let options = OctreeOptions {
        max_level: 3,
        min_items: 3,
    };
    let octree = Octree::build(&boxes, options).expect("finite boxes");
    assert!(octree.nodes().len() > 9 && !octree.nodes()[0].own().is_empty() && !octree.nodes()[1].is_leaf());
    Parts {
        options,
        cube: octree.cube(),
        order: octree.order().to_vec(),
        nodes: octree.nodes().to_vec(),
        boxes,
    }
}

fn defect(doctor: impl FnOnce(&mut Parts)) -> ValidationError {
    let mut parts = good();
    doctor(&mut parts);
    let Parts {
        options,
        cube,
        order,
        nodes,
        boxes,
    } = parts;
    // Not `expect_err`, which would print the octree.
    match Octree::from_parts(Fit::Whole, options, cube, order, nodes, &boxes) {
        Ok(_) => panic!("the doctored octree was accepted"),
        Err(error) => error,
    }
}

#[test]
fn the_undoctored_octree_is_accepted() {
    let Parts {
        options,
        cube,
        order,
        nodes,
        boxes,
    } = good();
    let octree = Octree::from_parts(Fit::Whole, options, cube, order, nodes, &boxes).expect("untouched");
    assert_eq!(octree, Octree::build(&boxes, options).expect("finite boxes"));
}

#[test]
fn a_bad_frame_is_found() {
    assert_eq!(defect(|parts| parts.options.max_level = 22), ValidationError::Frame);
    assert_eq!(defect(|parts| parts.cube.half_edge = f64::NAN), ValidationError::Frame);
    assert_eq!(defect(|parts| parts.cube.half_edge = -1.0), ValidationError::Frame);
    assert_eq!(
        defect(|parts| parts.cube.origin.x = f64::INFINITY),
        ValidationError::Frame
    );
}

#[test]
fn a_bad_order_is_found() {
    assert_eq!(
        defect(|parts| parts.order.truncate(65)),
        ValidationError::ItemCount { items: 65, boxes: 66 }
    );
    assert_eq!(defect(|parts| parts.order[5] = 66), ValidationError::Order { place: 5 });
    assert_eq!(
        defect(|parts| parts.order[5] = parts.order[4]),
        ValidationError::Order { place: 5 }
    );
    assert_eq!(
        defect(|parts| parts.boxes[7].max.y = f64::NAN),
        ValidationError::Box { index: 7 }
    );
    assert_eq!(
        defect(|parts| parts.boxes[7].max.y = -1.0),
        ValidationError::Box { index: 7 }
    );
}

#[test]
fn a_bad_root_is_found() {
    assert_eq!(defect(|parts| parts.nodes.clear()), ValidationError::Root);
    assert_eq!(defect(|parts| parts.nodes[0].parent = Some(0)), ValidationError::Root);
    assert_eq!(defect(|parts| parts.nodes[0].item_end -= 1), ValidationError::Root);
    let over_nothing = |parts: &mut Parts| {
        parts.order.clear();
        parts.boxes.clear();
    };
    assert_eq!(defect(over_nothing), ValidationError::Root);
}

#[test]
fn bad_ranges_are_found() {
    assert_eq!(
        defect(|parts| parts.nodes[0].own_end = 67),
        ValidationError::Items { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[0].own_end += 1),
        ValidationError::Items { node: 1 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[2].first_item += 1),
        ValidationError::Items { node: 2 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[8].item_end = u32::MAX),
        ValidationError::Items { node: 0 }
    );
    let last = good().nodes.len() - 1;
    assert_eq!(
        defect(|parts| parts.nodes[last].own_end -= 1),
        ValidationError::Items { node: last }
    );
    let empty = |parts: &mut Parts| {
        let (first, second) = (parts.nodes[1].first_item, parts.nodes[1].item_end);
        parts.nodes[1].item_end = first;
        parts.nodes[1].own_end = first;
        parts.nodes[2].first_item = first;
        assert!(second > first);
    };
    assert_eq!(defect(empty), ValidationError::Items { node: 1 });
}

#[test]
fn misplaced_children_are_found() {
    assert_eq!(
        defect(|parts| parts.nodes[0].first_child = 0),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[0].first_child = u32::MAX),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[0].child_count = u32::MAX),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[1].first_child += 1),
        ValidationError::Children { node: 1 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[3].parent = Some(1)),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[3].parent = None),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.options.min_items = 66),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.options.max_level = 0),
        ValidationError::Children { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[0].child_count = 7),
        ValidationError::Items { node: 0 }
    );
    let count = good().nodes.len();
    assert_eq!(
        defect(|parts| parts.nodes.push(parts.nodes[count - 1])),
        ValidationError::Orphans { node: count }
    );
}

/// A root whose items all lie in one octant, above a node that should be in its stead.
#[test]
fn a_chain_is_found() {
    let b = Aabb {
        min: DVec3::ZERO,
        max: DVec3::ZERO,
    };
    let boxes = vec![b; 9];
    let options = OctreeOptions {
        max_level: 21,
        min_items: 3,
    };
    let octree = Octree::build(&boxes, options).expect("finite boxes");
    let leaf = octree.nodes()[0];
    let root = Node {
        level: 0,
        own_end: 0,
        own_bounds: Aabb::EMPTY,
        first_child: 1,
        child_count: 1,
        ..leaf
    };
    let nodes = vec![
        root,
        Node {
            parent: Some(0),
            ..leaf
        },
    ];
    let chained = Octree::from_parts(
        Fit::Whole,
        options,
        octree.cube(),
        octree.order().to_vec(),
        nodes,
        &boxes,
    );
    assert_eq!(chained, Err(ValidationError::Children { node: 0 }));
}

#[test]
fn bad_levels_and_cells_are_found() {
    assert_eq!(
        defect(|parts| parts.nodes[4].level = 0),
        ValidationError::Level { node: 4 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[4].level = u32::MAX),
        ValidationError::Level { node: 4 }
    );
    let deepest = good().nodes.iter().map(|node| node.level).max().expect("a node");
    assert!(deepest > 1);
    assert_eq!(
        defect(|parts| parts.nodes[0].cell[1] = 1),
        ValidationError::Cell { node: 0 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[4].cell[0] += 2),
        ValidationError::Cell { node: 4 }
    );
    assert_eq!(
        defect(|parts| parts.nodes[2].cell = parts.nodes[1].cell),
        ValidationError::Cell { node: 2 }
    );
}

#[test]
fn items_in_the_wrong_node_are_found() {
    let parts = good();
    let leaf = parts.nodes.iter().position(Node::is_leaf).expect("a leaf");
    let place = parts.nodes[leaf].first_item as usize;
    let elsewhere = parts.order.len() - 1;
    assert_eq!(
        defect(|parts| parts.order.swap(place, elsewhere)),
        ValidationError::Outside { node: leaf, place },
        "the last item is in the opposite corner"
    );
    assert_eq!(
        defect(|parts| parts.order.swap(0, elsewhere)),
        ValidationError::TooHigh { node: 0, place: 0 },
        "a small item in the root, a large one in the last leaf"
    );
    let undivided = |parts: &mut Parts| {
        let root = &mut parts.nodes[0];
        root.own_end = root.item_end;
        root.own_bounds = root.bounds;
        root.child_count = 0;
        parts.nodes.truncate(1);
    };
    assert!(matches!(defect(undivided), ValidationError::TooHigh { node: 0, .. }));
}

/// The same in a loose octree, where the middle and the size count.
#[test]
fn items_in_the_wrong_loose_node_are_found() {
    let Parts { options, boxes, .. } = good();
    let octree = Octree::build_loose(&boxes, options).expect("finite boxes");
    let nodes = octree.nodes();
    let leaf = nodes.iter().position(Node::is_leaf).expect("a leaf");
    let with = |order: Vec<u32>, boxes: &[Aabb]| {
        Octree::from_parts(Fit::Loose, options, octree.cube(), order, nodes.to_vec(), boxes).map(|_| ())
    };
    let order = || octree.order().to_vec();
    assert_eq!(with(order(), &boxes), Ok(()));

    let place = nodes[leaf].first_item as usize;
    let mut swapped = order();
    swapped.swap(place, boxes.len() - 1);
    let error = with(swapped, &boxes);
    assert_eq!(
        error,
        Err(ValidationError::Outside { node: leaf, place }),
        "the middle is elsewhere"
    );

    let mut grown = boxes.clone();
    let item = &mut grown[octree.order()[place] as usize];
    (item.min, item.max) = (item.min - 0.3, item.max + 0.3);
    let error = with(order(), &grown);
    assert_eq!(
        error,
        Err(ValidationError::Outside { node: leaf, place }),
        "too large for the cell"
    );

    let Parts { cube, order, nodes, .. } = good();
    let error = Octree::from_parts(Fit::Loose, options, cube, order, nodes, &boxes);
    assert!(
        matches!(error, Err(ValidationError::TooHigh { node: 0, .. })),
        "not loose"
    );
}

#[test]
fn loose_and_cutting_bounds_are_found() {
    let count = good().nodes.len();
    for node in 0..count {
        assert_eq!(
            defect(|parts| parts.nodes[node].bounds.max.x += 1e-12),
            ValidationError::Bounds { node }
        );
        assert_eq!(
            defect(|parts| parts.nodes[node].bounds.min.y += 1e-3),
            ValidationError::Bounds { node }
        );
        assert_eq!(
            defect(|parts| parts.nodes[node].own_bounds.min.z = f64::NAN),
            ValidationError::Bounds { node }
        );
    }
    let item = good().order[65] as usize;
    assert_eq!(
        defect(|parts| parts.boxes[item].min.x += 1e-9),
        ValidationError::Bounds { node: count - 1 },
        "other boxes"
    );
}

#[test]
fn messages_say_what_and_what_next() {
    for error in [
        ValidationError::Frame,
        ValidationError::ItemCount { items: 1, boxes: 2 },
        ValidationError::Order { place: 1 },
        ValidationError::Box { index: 1 },
        ValidationError::Root,
        ValidationError::Items { node: 1 },
        ValidationError::Children { node: 1 },
        ValidationError::Orphans { node: 1 },
        ValidationError::Level { node: 1 },
        ValidationError::Cell { node: 1 },
        ValidationError::Outside { node: 1, place: 2 },
        ValidationError::TooHigh { node: 1, place: 2 },
        ValidationError::Bounds { node: 1 },
    ] {
        let text = error.to_string();
        assert!(
            text.starts_with(|c: char| !c.is_uppercase()) && text.ends_with("from these boxes"),
            "{text}"
        );
    }
}
