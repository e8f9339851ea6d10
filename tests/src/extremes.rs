//! Scenes that break hemicubes elsewhere, for the tests and the table of `docs/dev/extremes.md`.

use crate::geometry::{box_inside, even, flipped, grid, quad, scene_of, scene_with_sides};
use glam::{DQuat, DVec3};
use hemicube_scene::{Scene, Subdivision};

type Triangle = [DVec3; 3];

/// A closed room with a closed block afloat in it, askew; 60 triangles, times the square of `pieces`.
pub fn room_with_a_block(pieces: u32) -> Scene {
    let walls = box_inside(DVec3::new(1.0, 1.3, 0.8));
    let walls = walls
        .into_iter()
        .flat_map(|face| grid(face, &even(2 * pieces), &even(2 * pieces)));
    let turn = DQuat::from_axis_angle(DVec3::new(2.0, -1.0, 3.0).normalize(), 0.6);
    let place = move |p: DVec3| DVec3::new(0.5, 0.6, 0.35) + turn * ((p - 0.5) * DVec3::new(0.3, 0.5, 0.2));
    let block = box_inside(DVec3::ONE).into_iter();
    let block = block.flat_map(move |face| grid(flipped(face).map(place), &even(pieces), &even(pieces)));
    scene_of(walls.chain(block))
}

/// A cube's inside with a strip of 10⁻⁷ across the middle of each face, both ways: edges of 1 beside edges of 10⁻⁷.
pub fn slivers() -> Scene {
    let cuts = [0.0, 0.31, 0.31 + 1e-7, 1.0];
    scene_of(
        box_inside(DVec3::ONE)
            .into_iter()
            .flat_map(|face| grid(face, &cuts, &cuts)),
    )
}

/// A cube's inside, and in it a two-sided triangle with edges a millionth as long.
pub fn mote() -> Scene {
    let room = box_inside(DVec3::ONE).into_iter();
    let room = room.flat_map(|face| grid(face, &even(3), &even(3)));
    let mote = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| DVec3::new(0.41, 0.53, 0.37) + p * 1e-6);
    scene_with_sides(room.map(|t| (t, false)).chain([(mote, true)]))
}

/// Two unit squares facing each other at a distance, the upper one moved aside by 0.3 and 0.2.
pub fn near_plates(gap: f64) -> Scene {
    let [floor, ceiling, ..] = box_inside(DVec3::new(1.0, 1.0, gap));
    let aside = ceiling.map(|p| p + DVec3::new(0.3, 0.2, 0.0));
    scene_of(
        [floor, aside]
            .into_iter()
            .flat_map(|face| grid(face, &even(2), &even(2))),
    )
}

/// Two triangles with a common edge, their fronts at an angle in degrees, each cut into 16.
pub fn hinge(degrees: f64) -> Scene {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let floor = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1.0, 0.0)];
    let leaf = [DVec3::X, DVec3::ZERO, DVec3::new(0.5, cosine, sine)];
    let mut parts = Vec::new();
    for triangle in [floor, leaf] {
        Subdivision::Levels(2).cut(&triangle, &mut parts);
    }
    scene_of(parts)
}

/// A cube's inside with every triangle twice, from another corner the second time.
pub fn duplicates() -> Scene {
    let once = box_inside(DVec3::ONE).into_iter();
    let once = once.flat_map(|face| grid(face, &even(3), &even(3)));
    scene_of(once.flat_map(|[a, b, c]| [[a, b, c], [b, c, a]]))
}

/// Walls of a room from under an unsplit ground to a ceiling, and ground on both sides of them; the ground is face 0.
/// Its twin, `split`, has the ground cut along all crossing lines. With each triangle the number of its face.
pub fn walls_through_the_ground(split: bool) -> Vec<(usize, Triangle)> {
    let [_, ceiling, walls @ ..] = box_inside(DVec3::ONE);
    let lowered = |face: [DVec3; 4]| face.map(|p| if p.z == 0.0 { p - DVec3::Z * 0.23 } else { p });
    let faces = [ceiling].into_iter().chain(walls.map(lowered));
    on_the_ground(faces, [0.0, 1.0], [0.0, 1.0], split)
}

/// A tower through an unsplit ground, under a ceiling; otherwise like [`walls_through_the_ground`].
pub fn tower_through_the_ground(split: bool) -> Vec<(usize, Triangle)> {
    let [_, ceiling, ..] = box_inside(DVec3::ONE);
    let place = |p: DVec3| p * DVec3::new(0.2, 0.25, 0.7) + DVec3::new(0.3, 0.45, -0.21);
    let [_, top, sides @ ..] = box_inside(DVec3::ONE).map(|face| flipped(face).map(place));
    let faces = [ceiling, top].into_iter().chain(sides);
    on_the_ground(faces, [0.3, 0.5], [0.45, 0.7], split)
}

fn on_the_ground(
    faces: impl Iterator<Item = [DVec3; 4]>,
    along: [f64; 2],
    across: [f64; 2],
    split: bool,
) -> Vec<(usize, Triangle)> {
    let ground = [(-0.3, -0.3), (1.3, -0.3), (1.3, 1.3), (-0.3, 1.3)].map(|(x, y)| DVec3::new(x, y, 0.0));
    let places = |[p, q]: [f64; 2]| [0.0, (p + 0.3) / 1.6, (q + 0.3) / 1.6, 1.0];
    let ground = if split {
        grid(ground, &places(along), &places(across))
    } else {
        quad(ground).to_vec()
    };
    let faces = faces.enumerate().flat_map(|(k, face)| quad(face).map(|t| (k + 1, t)));
    ground.into_iter().map(|t| (0, t)).chain(faces).collect()
}

/// A floor of two triangles with a closed block on the middle of each, so that their centroids lie inside, under a
/// ceiling of 8.
pub fn buried_centroids() -> Scene {
    let [floor, ceiling, ..] = box_inside(DVec3::ONE);
    let block = |x: f64, y: f64| {
        let place = move |p: DVec3| DVec3::new(x, y, -0.05) + (p - DVec3::new(0.5, 0.5, 0.0)) * 0.15;
        box_inside(DVec3::ONE)
            .into_iter()
            .flat_map(move |face| quad(flipped(face).map(place)))
    };
    let blocks = block(2.0 / 3.0, 1.0 / 3.0).chain(block(1.0 / 3.0, 2.0 / 3.0));
    scene_of(
        quad(floor)
            .into_iter()
            .chain(grid(ceiling, &even(2), &even(2)))
            .chain(blocks),
    )
}

/// One triangle and no other.
pub fn single_patch() -> Scene {
    scene_of([[
        DVec3::new(3.0, 1.0, 2.0),
        DVec3::new(4.0, 1.5, 2.0),
        DVec3::new(3.0, 2.0, 2.5),
    ]])
}

/// Three triangles without sight of one another: back to back, and side by side in a plane.
pub fn empty_view() -> Scene {
    let [a, b, c] = [
        DVec3::new(3.0, 1.0, 2.0),
        DVec3::new(4.0, 1.5, 2.0),
        DVec3::new(3.0, 2.0, 2.5),
    ];
    let below = [a, c, b].map(|p| p - DVec3::new(-0.5, 1.0, 1.0));
    scene_of([[a, b, c], below, [a, b, c].map(|p| p + (b - a) * 3.0)])
}

/// More than 2²⁴ tiny triangles under a cube's inside, listed last: ids beyond 24 bits. They face away.
pub fn many_ids() -> Scene {
    let motes = (0..=1_u32 << 24).map(|k| {
        let at = DVec3::new(f64::from(k & 0xFFF), f64::from(k >> 12), 0.0) / 4096.0 - DVec3::Z * 0.1;
        [at, at + DVec3::Y / 8192.0, at + DVec3::X / 8192.0]
    });
    let room = box_inside(DVec3::ONE).into_iter();
    scene_of(motes.chain(room.flat_map(|face| grid(face, &even(2), &even(2)))))
}
