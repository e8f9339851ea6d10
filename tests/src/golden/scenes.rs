//! The sixteen scenes of the scoreboard: seven of the generator, seven made here, two real ones of the shared folder.
//!
//! Made here are kinds that the generator lacks: thin things among large triangles, closed shells, a bowl in which each
//! patch sees all. Coordinates come from + − × ÷ √ alone, so that a scene is the same on every machine.

use crate::geometry::{box_inside, box_outside, even, grid, scene_of, scene_with_sides};
use crate::random::Random;
use crate::scenes::{model_as_it_is, read, scenes_dir};
use glam::DVec3;
use hemicube::Model;
use hemicube::store::scene_hash;
use hemicube_scene::generate::{self, BlockCityParameters, Generate, Kind};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Scene, Subdivision};

type Triangle = [DVec3; 3];

/// Names of all scenes, in the order of the board.
pub const NAMES: [&str; 16] = [
    "room-360",
    "room-2560",
    "city",
    "block-city",
    "field",
    "maze",
    "spheres",
    "thin-enclosure",
    "sealed",
    "bowl",
    "leaves",
    "louvres",
    "heat-sink",
    "office",
    "denhaag-8897",
    "aggressor",
];

/// A scene made ready, with its hash.
#[derive(Debug)]
pub struct Ready {
    /// One of [`NAMES`].
    pub name: &'static str,
    /// The scene for hemicubes.
    pub model: Model,
    /// [`scene_hash`] of its triangles.
    pub hash: String,
}

/// A scene by its name; `None` where the folder of real scenes lacks it.
///
/// # Panics
/// When the name is none of [`NAMES`], or a file is there and cannot be read.
pub fn ready(name: &'static str) -> Option<Ready> {
    let mut scene = made(name)?;
    repair(&mut scene, RepairOptions::default());
    let model = model_as_it_is(&scene, Subdivision::None);
    let hash = scene_hash(&scene, model.patches());
    Some(Ready { name, model, hash })
}

fn made(name: &str) -> Option<Scene> {
    let generated = |kind, target_patches| {
        let spec = Generate {
            kind,
            target_patches,
            seed: 1,
        };
        generate::generate(spec).expect("a target in range")
    };
    Some(match name {
        "room-360" => generate::room(3).expect("a room"),
        "room-2560" => generate::room(8).expect("a room"),
        "city" => generated(Kind::City, 2_500),
        "block-city" => {
            let city = BlockCityParameters {
                blocks: 16,
                ..BlockCityParameters::default()
            };
            city.generate().expect("a city")
        }
        "field" => generated(Kind::Field, 1_000),
        "maze" => generated(Kind::Maze, 2_000),
        "spheres" => generated(Kind::Spheres, 2_000),
        "thin-enclosure" => thin_enclosure(),
        "sealed" => sealed(),
        "bowl" => bowl(),
        "leaves" => leaves(),
        "louvres" => louvres(),
        "heat-sink" => heat_sink(),
        "office" => office(),
        "denhaag-8897" => real("city/denhaag-8897.obj")?,
        "aggressor" => real("interior/aggressor.obj")?,
        other => panic!("the board has no scene `{other}`"),
    })
}

fn real(file: &str) -> Option<Scene> {
    let folder = scenes_dir()?;
    folder
        .join(file)
        .exists()
        .then(|| read(&folder, file).unwrap_or_else(|error| panic!("{file}: {error}")))
}

/// Faces, each cut into pieces with edges of `piece` at most, up to 64 along an edge.
fn cut(faces: impl IntoIterator<Item = [DVec3; 4]>, piece: f64) -> impl Iterator<Item = Triangle> {
    let pieces = move |a: DVec3, b: DVec3| {
        let count = (a.distance(b) / piece).ceil().clamp(1.0, 64.0);
        // From 1 to 64.
        even((1..=64).find(|&n| f64::from(n) >= count).unwrap_or(64))
    };
    faces
        .into_iter()
        .flat_map(move |face| grid(face, &pieces(face[0], face[1]), &pieces(face[0], face[3])))
}

/// A cavity of 1 × 1 × 0.02: opposite patches are five times as wide as they are apart.
fn thin_enclosure() -> Scene {
    scene_of(cut(box_inside(DVec3::new(1.0, 1.0, 0.02)), 0.1))
}

/// A closed cube with an inner and an outer face, and six plates around it: nothing passes the wall.
fn sealed() -> Scene {
    let inner = cut(box_inside(DVec3::ONE), 0.25);
    let outer = cut(box_outside(DVec3::ZERO, DVec3::ONE), 0.25);
    // Faces that look inwards, of a cube three times as large, without their rims.
    let plates = box_inside(DVec3::splat(3.0)).into_iter().flat_map(|face| {
        let middle = face.iter().sum::<DVec3>() / 4.0;
        let shrunk = face.map(|p| (p - middle) / 3.0 + middle - DVec3::ONE);
        grid(shrunk, &even(3), &even(3))
    });
    scene_of(inner.chain(outer).chain(plates))
}

/// A bowl of a sphere's lower part, seen from within: each patch sees all others, and nothing hides anything.
fn bowl() -> Scene {
    const PIECES: u32 = 24;
    let square = [(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5)].map(|(x, y)| DVec3::new(x, y, -1.0));
    let flat = grid(square, &even(PIECES), &even(PIECES));
    scene_of(flat.into_iter().map(|t| t.map(|p| p / p.length())))
}

/// Two-sided leaves of some centimetres in a crown over a lawn.
fn leaves() -> Scene {
    let mut random = Random(17);
    let lawn = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
    let lawn = grid(lawn, &even(10), &even(10)).into_iter().map(|t| (t, false));
    let mut anywhere = |scale: f64| DVec3::new(random.unit(), random.unit(), random.unit()) * scale;
    let leaves = (0..500).map(|_| {
        let at = DVec3::new(1.0, 1.0, 0.8) + anywhere(2.0);
        let corner = |of: DVec3| at + (of - 0.5) * 0.35;
        (
            [corner(anywhere(1.0)), corner(anywhere(1.0)), corner(anywhere(1.0))],
            true,
        )
    });
    let leaves: Vec<_> = leaves.collect();
    scene_with_sides(lawn.chain(leaves))
}

/// A closed box whose front is behind louvres of sheet, a millimetre thick and askew, with a block inside.
fn louvres() -> Scene {
    let size = DVec3::new(1.0, 0.8, 1.0);
    let walls = cut(box_inside(size), 0.25);
    let core = cut(box_outside(DVec3::new(0.35, 0.4, 0.2), DVec3::new(0.3, 0.3, 0.6)), 0.15);
    let slats = (0..18).flat_map(|k| {
        let low = DVec3::new(0.03, 0.0, 0.0);
        let at = DVec3::new(0.0, 0.12, 0.06 + 0.05 * f64::from(k));
        // Turned by the angle of 3 : 4 : 5 about x.
        let turn = move |p: DVec3| DVec3::new(p.x, 0.8 * p.y - 0.6 * p.z, 0.6 * p.y + 0.8 * p.z) + at;
        let faces = box_outside(low, DVec3::new(0.94, 0.06, 0.001)).map(|face| face.map(turn));
        cut(faces, 0.3)
    });
    scene_of(walls.chain(core).chain(slats))
}

/// A plate with fins on it, under the open sky: the fins stand on large triangles, which they cover in part.
fn heat_sink() -> Scene {
    let base = cut(box_outside(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.1)), 0.2);
    let fins = (0..12).flat_map(|k| {
        let low = DVec3::new(0.02 + 0.085 * f64::from(k), 0.0, 0.1);
        // Without the foot, which nothing sees.
        let [_, sides @ ..] = box_outside(low, DVec3::new(0.02, 1.0, 0.45));
        cut(sides, 0.2)
    });
    scene_of(base.chain(fins))
}

/// A room with tables on thin legs, a shelf and a cupboard.
fn office() -> Scene {
    let walls = cut(box_inside(DVec3::new(6.0, 4.0, 3.0)), 0.6);
    let block = |low: [f64; 3], size: [f64; 3], piece: f64| {
        cut(box_outside(DVec3::from_array(low), DVec3::from_array(size)), piece)
    };
    let mut things: Vec<Triangle> = walls.collect();
    for (x, y) in [(0.8, 0.7), (3.2, 0.7), (0.8, 2.3)] {
        things.extend(block([x, y, 0.7], [1.6, 0.8, 0.03], 0.4));
        for (dx, dy) in [(0.05, 0.05), (1.5, 0.05), (0.05, 0.7), (1.5, 0.7)] {
            things.extend(block([x + dx, y + dy, 0.0], [0.05, 0.05, 0.7], 0.4));
        }
    }
    for level in 0..5 {
        things.extend(block([4.2, 3.6, 0.3 + 0.4 * f64::from(level)], [1.4, 0.35, 0.02], 0.5));
    }
    things.extend(block([5.2, 2.2, 0.0], [0.7, 1.0, 2.0], 0.5));
    scene_of(things)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_made_and_is_the_same_again() {
        for name in NAMES {
            let (Some(one), Some(two)) = (ready(name), ready(name)) else {
                assert!(scenes_dir().is_none(), "{name}");
                continue;
            };
            assert_eq!(one.hash, two.hash, "{name}");
            let count = one.model.patches().len();
            assert!((100..10_000).contains(&count), "{name}: {count}");
        }
    }

    #[test]
    fn faces_of_closed_things_look_away_from_their_solids() {
        // Six plates look at the cube, and the cube's outer faces at them.
        let scene = sealed();
        let towards = |t: &hemicube_scene::Triangle| {
            let [a, b, c] = t.corners;
            (b - a).cross(c - a).dot(DVec3::splat(0.5) - a)
        };
        let count = |is: fn(f64) -> bool| scene.triangles.iter().filter(|t| is(towards(t))).count();
        assert_eq!((count(|d| d > 0.0), count(|d| d < 0.0)), (6 * 32 + 6 * 18, 6 * 32));
        let up = bowl();
        assert!(up.triangles.iter().all(|t| {
            let [a, b, c] = t.corners;
            (b - a).cross(c - a).dot(a) < 0.0
        }));
    }
}
