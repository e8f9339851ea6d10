//! The measured Cornell box: corner coordinates in millimetres from the data page of the Cornell Program of Computer
//! Graphics; reflectances and emission are the customary RGB approximation of the measured spectra, from the 2011 OBJ
//! version of the box (McGuire's archive).
//!
//! y points up; the camera of the data page stands at (278, 273, −800) and looks along +z. Each face is listed from the
//! corner that the data page lists first, and cut along the diagonal from there. Three things to know of it: the red
//! wall's corners do not lie in one plane (by 3.2 mm), so it is two planes; the blocks have no bottoms and stand on the
//! floor without sharing an edge with it, so patches of the floor under them see only the inside of a block; and the
//! light fills a hole in the ceiling, which is therefore four faces around it. The front wall is not on the data page:
//! it closes the box, so that every row of F sums to 1.

use super::builder::{SceneBuilder, nearest_square};
use crate::{Error, Scene, Subdivision};
use glam::DVec3;

/// Name, reflectance, emission.
type Surface = (&'static str, [f64; 3], [f64; 3]);

const WHITE: Surface = ("white", [0.725, 0.71, 0.68], [0.0; 3]);
const RED: Surface = ("red", [0.63, 0.065, 0.05], [0.0; 3]);
const GREEN: Surface = ("green", [0.14, 0.45, 0.091], [0.0; 3]);
const LIGHT: Surface = ("light", [0.78, 0.78, 0.78], [17.0, 12.0, 4.0]);

const CEILING: f64 = 548.8;

/// Name, surface, faces.
type Object = (&'static str, Surface, &'static [[[f64; 3]; 4]]);

/// Normals point into the room, the blocks' outwards. The front wall is last.
const OBJECTS: [Object; 9] = [
    (
        "floor",
        WHITE,
        &[[
            [552.8, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 559.2],
            [549.6, 0.0, 559.2],
        ]],
    ),
    (
        "ceiling",
        WHITE,
        &[
            [
                [556.0, CEILING, 0.0],
                [556.0, CEILING, 559.2],
                [343.0, CEILING, 332.0],
                [343.0, CEILING, 227.0],
            ],
            [
                [556.0, CEILING, 559.2],
                [0.0, CEILING, 559.2],
                [213.0, CEILING, 332.0],
                [343.0, CEILING, 332.0],
            ],
            [
                [0.0, CEILING, 559.2],
                [0.0, CEILING, 0.0],
                [213.0, CEILING, 227.0],
                [213.0, CEILING, 332.0],
            ],
            [
                [0.0, CEILING, 0.0],
                [556.0, CEILING, 0.0],
                [343.0, CEILING, 227.0],
                [213.0, CEILING, 227.0],
            ],
        ],
    ),
    (
        "light",
        LIGHT,
        &[[
            [343.0, CEILING, 227.0],
            [343.0, CEILING, 332.0],
            [213.0, CEILING, 332.0],
            [213.0, CEILING, 227.0],
        ]],
    ),
    (
        "back_wall",
        WHITE,
        &[[
            [549.6, 0.0, 559.2],
            [0.0, 0.0, 559.2],
            [0.0, CEILING, 559.2],
            [556.0, CEILING, 559.2],
        ]],
    ),
    (
        "right_wall",
        GREEN,
        &[[
            [0.0, 0.0, 559.2],
            [0.0, 0.0, 0.0],
            [0.0, CEILING, 0.0],
            [0.0, CEILING, 559.2],
        ]],
    ),
    (
        "left_wall",
        RED,
        &[[
            [552.8, 0.0, 0.0],
            [549.6, 0.0, 559.2],
            [556.0, CEILING, 559.2],
            [556.0, CEILING, 0.0],
        ]],
    ),
    (
        "short_block",
        WHITE,
        &[
            [
                [130.0, 165.0, 65.0],
                [82.0, 165.0, 225.0],
                [240.0, 165.0, 272.0],
                [290.0, 165.0, 114.0],
            ],
            [
                [290.0, 0.0, 114.0],
                [290.0, 165.0, 114.0],
                [240.0, 165.0, 272.0],
                [240.0, 0.0, 272.0],
            ],
            [
                [130.0, 0.0, 65.0],
                [130.0, 165.0, 65.0],
                [290.0, 165.0, 114.0],
                [290.0, 0.0, 114.0],
            ],
            [
                [82.0, 0.0, 225.0],
                [82.0, 165.0, 225.0],
                [130.0, 165.0, 65.0],
                [130.0, 0.0, 65.0],
            ],
            [
                [240.0, 0.0, 272.0],
                [240.0, 165.0, 272.0],
                [82.0, 165.0, 225.0],
                [82.0, 0.0, 225.0],
            ],
        ],
    ),
    (
        "tall_block",
        WHITE,
        &[
            [
                [423.0, 330.0, 247.0],
                [265.0, 330.0, 296.0],
                [314.0, 330.0, 456.0],
                [472.0, 330.0, 406.0],
            ],
            [
                [423.0, 0.0, 247.0],
                [423.0, 330.0, 247.0],
                [472.0, 330.0, 406.0],
                [472.0, 0.0, 406.0],
            ],
            [
                [472.0, 0.0, 406.0],
                [472.0, 330.0, 406.0],
                [314.0, 330.0, 456.0],
                [314.0, 0.0, 456.0],
            ],
            [
                [314.0, 0.0, 456.0],
                [314.0, 330.0, 456.0],
                [265.0, 330.0, 296.0],
                [265.0, 0.0, 296.0],
            ],
            [
                [265.0, 0.0, 296.0],
                [265.0, 330.0, 296.0],
                [423.0, 330.0, 247.0],
                [423.0, 0.0, 247.0],
            ],
        ],
    ),
    (
        "front_wall",
        WHITE,
        &[[
            [0.0, 0.0, 0.0],
            [552.8, 0.0, 0.0],
            [556.0, CEILING, 0.0],
            [0.0, CEILING, 0.0],
        ]],
    ),
];

const TRIANGLES: u64 = 40;
/// Metres in the table's unit.
const METRES: f64 = 0.001;

/// The measured Cornell box with a front wall, in millimetres: 20 quads, 40 triangles, closed but for the seams under
/// the blocks.
pub fn cornell_box() -> Scene {
    build(SceneBuilder::empty(METRES), &OBJECTS, 1)
}

/// The measured Cornell box as published, open at the front: 19 quads, 38 triangles.
pub fn cornell_box_open() -> Scene {
    build(SceneBuilder::empty(METRES), &OBJECTS[..OBJECTS.len() - 1], 1)
}

/// The closed Cornell box with every edge cut into `pieces`, as watertight as the box: 40·`pieces`² triangles, those of
/// [`cornell_box`] under [`Subdivision::Split`].
///
/// # Errors
/// When that is more than [`MAX_PATCHES`](super::MAX_PATCHES), or `pieces` is 0.
pub fn room(pieces: u32) -> Result<Scene, Error> {
    if pieces == 0 {
        return Err(Error::malformed("`pieces` is 0; cut each edge into at least 1"));
    }
    let count = TRIANGLES.saturating_mul(u64::from(pieces).pow(2));
    Ok(build(SceneBuilder::new(count, METRES)?, &OBJECTS, pieces))
}

/// Into how many pieces each edge of the box is cut to come nearest to `target` patches.
pub(super) fn pieces_for(target: u64) -> u32 {
    nearest_square(target, TRIANGLES)
}

fn build(mut builder: SceneBuilder, objects: &[Object], pieces: u32) -> Scene {
    let split = Subdivision::Split(pieces);
    let mut parts = Vec::new();
    for (name, (material, diffuse, emission), quads) in objects {
        builder.object(*name);
        builder.optical_material(material, *diffuse, *emission);
        for quad in *quads {
            let [a, b, c, d] = quad.map(DVec3::from_array);
            parts.clear();
            split.cut(&[a, b, c], &mut parts);
            split.cut(&[a, c, d], &mut parts);
            builder.face(parts.iter().copied());
        }
    }
    builder.finish()
}
