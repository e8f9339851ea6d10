//! Places of free points: in the open, in solids, below the ground, behind sheets, far off. By rays in all directions,
//! independent of a point's own direction.

use super::rays::{Caster, Hit, directions};
use crate::Model;
use crate::bvh::Tree;
use crate::sky::SensorPoint;
use glam::DVec3;
use serde::Serialize;

/// Rays from a point into each of the two hemispheres about the way up.
const RAYS: u32 = 128;
/// Rays about a point's own direction.
const RAYS_OF_VIEW: u32 = 32;
/// A point is off its surface by this share of the scene: points of façades lie in them, but for rounding.
const OFFSET: f64 = 1e-9;
/// More of the directions than this are backs only from within a solid: a plane's back fills half of them.
const SOLID: f64 = 0.55;
/// Least share of backs in the upper half of the directions, from below the ground.
const GROUND: f64 = 0.5;
/// Most of the fronts in the lower half there.
const NOTHING: f64 = 0.05;
/// A point is far off when it is farther from the scene's middle than so many halves of its box: millimetres for
/// metres, or other coordinates.
const FAR: f64 = 25.0;
/// A point is shut in when so many of the directions end on something.
const SHUT: f64 = 0.95;

/// The place of a point, by its surroundings. Only one-sided surfaces have backs to tell it by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Place {
    /// Nothing speaks against it.
    Open,
    /// Most directions, all round, end on backs of one-sided surfaces.
    InSolid,
    /// Backs above, and no front below.
    BelowGround,
    /// Backs fill more than half of its view.
    BehindSheet,
    /// So far away that nothing of the scene is large in its view: its coordinates are of another unit or origin.
    FarOff,
}

/// The place of each point. `up` is a direction; `points` are in the scene's coordinates.
///
/// ```
/// use hemicube::diagnose::{Place, places};
/// use hemicube::sky::SensorPoint;
/// use hemicube::{HierarchyOptions, Model};
/// use hemicube_scene::{Patches, Subdivision, generate};
/// use hemicube_spatial::glam::DVec3;
///
/// // A room is wound inwards: within it there are fronts all round, and its walls hide what lies behind them.
/// let room = generate::cornell_box();
/// let model = Model::new(Patches::new(&room, Subdivision::None)?.into(), HierarchyOptions::default())?;
/// let point = |x, y, z| SensorPoint { position: DVec3::new(x, y, z), normal: DVec3::Y };
/// let found = places(&model, &[point(278.0, 500.0, 280.0), point(278.0, -5.0, 280.0)], DVec3::Y);
/// assert_eq!(found, [Place::Open, Place::BelowGround]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn places(model: &Model, points: &[SensorPoint], up: DVec3) -> Vec<Place> {
    let tree = &*Tree::of(model.geometry());
    let mut caster = Caster::new(tree);
    // Evenly over a hemisphere: of cosine-distributed directions, z² is spread evenly.
    let even = |d: DVec3| {
        let z = d.z * d.z;
        (d.truncate().normalize_or_zero() * (1.0 - z * z).sqrt()).extend(z)
    };
    let all: Vec<DVec3> = directions(RAYS).into_iter().map(even).collect();
    let view = directions(RAYS_OF_VIEW);
    points
        .iter()
        .map(|point| place(model, &mut caster, [&all, &view], point, up))
        .collect()
}

/// A direction about z turned to be about `axis`.
fn about(axis: DVec3, direction: DVec3) -> DVec3 {
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    tangent * direction.x + bitangent * direction.y + axis * direction.z
}

/// The shares of directions about `axis` that end on backs and on fronts.
fn shares(caster: &mut Caster<'_>, origin: DVec3, axis: DVec3, directions: &[DVec3]) -> [f64; 2] {
    let (mut backs, mut fronts) = (0u32, 0u32);
    for &direction in directions {
        match caster.first_of_point(origin, about(axis, direction)) {
            Hit::Back(_) => backs += 1,
            Hit::Patch(_) => fronts += 1,
            Hit::Nothing => {}
        }
    }
    let count = directions.len().max(1) as f64;
    [f64::from(backs) / count, f64::from(fronts) / count]
}

fn place(model: &Model, caster: &mut Caster<'_>, [all, view]: [&[DVec3]; 2], point: &SensorPoint, up: DVec3) -> Place {
    let (Some(normal), Some(up)) = (point.normal.try_normalize(), up.try_normalize()) else {
        return Place::Open;
    };
    let origin = model.normalise(point.position) + OFFSET * normal;
    if origin.length() > FAR {
        return Place::FarOff;
    }
    let [above, _] = shares(caster, origin, up, all);
    let [below, faces_below] = shares(caster, origin, -up, all);
    // A solid may stand on the ground without a floor of its own.
    let is_shut = above >= SHUT && below + faces_below >= SHUT && faces_below > NOTHING;
    if 0.5 * (above + below) > SOLID || is_shut {
        Place::InSolid
    } else if above >= GROUND && faces_below <= NOTHING {
        Place::BelowGround
    } else if shares(caster, origin, normal, view)[0] > 0.5 {
        Place::BehindSheet
    } else {
        Place::Open
    }
}
