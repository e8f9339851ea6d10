//! Every directed edge of the patches is met by its reverse, corner bits compared: no crack that light could pass.
//!
//! Left out: `Subdivision::PatchSize`, which cuts neighbours into different numbers of pieces and so leaves
//! T-junctions.
#![cfg(feature = "generate")]

use glam::DVec3;
use hemicube_scene::generate::{FieldParameters, MazeParameters, SpheresParameters, cornell_box, cornell_box_open};
use hemicube_scene::{Patches, Scene, Subdivision};
use std::collections::HashMap;

/// The directed edges that occur more often than their reverses, once for each time; order unspecified.
fn unmatched(scene: &Scene, subdivision: Subdivision) -> Vec<[DVec3; 2]> {
    type Point = [u64; 3];
    let patches = Patches::new(scene, subdivision).unwrap();
    let bits = |p: DVec3| p.to_array().map(f64::to_bits);
    let mut excess: HashMap<(Point, Point), (i64, [DVec3; 2])> = HashMap::new();
    for [a, b, c] in patches.surfaces() {
        for [p, q] in [[*a, *b], [*b, *c], [*c, *a]] {
            let (from, to) = (bits(p), bits(q));
            let (key, one) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            let entry = excess.entry(key).or_insert((0, [p, q]));
            entry.0 += one;
        }
    }
    excess
        .into_values()
        .flat_map(|(n, edge)| std::iter::repeat_n(edge, usize::try_from(n.abs()).unwrap()))
        .collect()
}

#[test]
fn the_room_is_closed_but_for_the_feet_of_the_blocks() {
    let scene = cornell_box();
    let pieces = [
        (Subdivision::None, 1),
        (Subdivision::Levels(4), 16),
        (Subdivision::Split(5), 5),
    ];
    for (subdivision, pieces) in pieces {
        let open = unmatched(&scene, subdivision);
        assert_eq!(open.len(), 8 * pieces, "{subdivision:?}");
        let inside = |p: DVec3| p.y == 0.0 && p.x > 80.0 && p.x < 473.0 && p.z > 64.0 && p.z < 457.0;
        assert!(open.iter().flatten().all(|&p| inside(p)), "{subdivision:?}: {open:?}");
    }
}

#[test]
fn a_missing_wall_is_noticed() {
    assert_eq!(unmatched(&cornell_box_open(), Subdivision::None).len(), 8 + 4);
    let mut scene = cornell_box();
    scene.triangles[0].corners.swap(0, 1);
    assert!(
        unmatched(&scene, Subdivision::Split(3)).len() > 24,
        "a turned triangle leaves its edges open"
    );
}

#[test]
fn mazes_are_closed() {
    for (columns, rows, pieces, seed) in [(1, 1, 1, 1), (1, 4, 2, 1), (7, 5, 1, 2), (4, 6, 3, 3), (3, 3, 9, 4)] {
        let maze = MazeParameters {
            columns,
            rows,
            pieces,
            ceiling: true,
            seed,
        };
        let scene = maze.generate().unwrap();
        for subdivision in [Subdivision::None, Subdivision::Levels(2), Subdivision::Split(3)] {
            assert!(unmatched(&scene, subdivision).is_empty(), "{maze:?} {subdivision:?}");
        }
    }
}

#[test]
fn a_maze_without_ceiling_is_open_only_at_the_top_of_its_walls() {
    let maze = MazeParameters {
        ceiling: false,
        ..MazeParameters::default()
    };
    let open = unmatched(&maze.generate().unwrap(), Subdivision::Split(2));
    assert_eq!(open.len(), 90 * 4 * 3 * 2);
    assert!(open.iter().flatten().all(|p| p.y == 3.0));
}

#[test]
fn spheres_and_their_room_are_closed() {
    for (spheres, sphere_pieces, wall_pieces) in [(1, 1, 1), (9, 4, 5), (3, 7, 3)] {
        let parameters = SpheresParameters {
            spheres,
            sphere_pieces,
            wall_pieces,
            seed: 5,
        };
        let scene = parameters.generate().unwrap();
        for subdivision in [Subdivision::None, Subdivision::Levels(1), Subdivision::Split(3)] {
            assert!(
                unmatched(&scene, subdivision).is_empty(),
                "{parameters:?} {subdivision:?}"
            );
        }
    }
}

#[test]
fn a_field_is_open_only_along_its_rim() {
    let field = FieldParameters { squares: 30, seed: 3 };
    let open = unmatched(&field.generate().unwrap(), Subdivision::Split(2));
    assert_eq!(open.len(), 4 * 30 * 2);
    let on_rim = |[p, q]: &[DVec3; 2]| {
        [p.x, p.z]
            .iter()
            .zip([q.x, q.z])
            .any(|(&a, b)| a == b && (a == 0.0 || a == 300.0))
    };
    assert!(open.iter().all(on_rim));
}
