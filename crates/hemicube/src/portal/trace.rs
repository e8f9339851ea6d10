//! Rays through portals.

use super::known::KnownLegs;
use super::motion::{MotionId, Motions, OTHER};
use super::specular::{Laws, Optics};
use crate::bvh::Tree;
use crate::geometry::Plane;
use crate::visibility::nearest::Met;
use glam::DVec3;
use std::sync::Arc;

/// Length of a leg: longer than any way through the scene, which fits a cube of side 2.
const FAR: f64 = 4.0;

/// Length of a leg from a point, which may lie outside of that cube: as far longer as it stands off.
fn leg_from(from: DVec3) -> f64 {
    let off = from.length_squared();
    if off > 3.0 { FAR + off.sqrt() } else { FAR }
}

/// Most portals of a path.
pub(super) const PASSES_MAX: u32 = 10_000;

/// A ray on its way, with the weight that is left of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) from: DVec3,
    /// A unit vector.
    pub(super) towards: DVec3,
    /// The plane that it leaves, looking where it goes: nothing in or below it is met.
    pub(super) horizon: Plane,
    pub(super) weight: u64,
    /// Portals that it went through.
    pub(super) passes: u32,
    /// From where what it meets lies to where it seems to lie, seen from the path's beginning.
    pub(super) motion: MotionId,
    /// Length of the path so far.
    pub(super) length: f64,
}

/// A ray at the side of a patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    /// `None`: the back of a one-sided patch.
    pub(super) patch: Option<u32>,
    pub(super) at: DVec3,
    /// Length of the path.
    pub(super) length: f64,
    /// The weight handed on.
    pub(super) passed: u64,
    /// Returns whether that depends on the angle.
    pub(super) varies: bool,
}

/// A surface that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct MetAt {
    /// The side seen: a patch, or the tree's patch count for the back of a one-sided one.
    pub(super) id: u32,
    /// Its block and lane.
    pub(super) slot: u32,
    pub(super) corners: [DVec3; 3],
    /// From the ray's beginning.
    pub(super) distance: f64,
}

/// Ends of paths.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends {
    /// Length.
    pub(super) reach: f64,
    /// Weight.
    pub(super) least: u64,
    /// The motion of what is looked for, if only that is: under it, nothing is reflected any more.
    pub(super) only: Option<MotionId>,
}

/// Takes the weight of paths.
pub(super) trait Tally {
    /// It arrives at a surface; some of it is handed on.
    fn arrive(&mut self, ray: &Ray, arrival: &Arrival);
    /// It leaves the scene.
    fn escape(&mut self, ray: &Ray);
    /// It is not followed further.
    fn cut(&mut self, ray: &Ray, weight: u64);
}

/// Optics of the patches of a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surfaces<'a> {
    /// Means where they depend on the angle.
    pub(super) optics: &'a [Optics],
    pub(super) laws: &'a Laws,
}

impl Surfaces<'_> {
    /// The optics of a patch met under an angle, by its cosine.
    pub(super) fn at(&self, patch: u32, cosine: impl FnOnce() -> f64) -> Optics {
        if self.laws.varies(patch) {
            self.laws.at(patch, cosine())
        } else {
            self.optics.get(patch as usize).copied().unwrap_or_default()
        }
    }
}

/// Follows paths; one a thread.
#[derive(Debug)]
pub(super) struct Tracer {
    pub(super) tree: Arc<Tree>,
    /// By patch of the model; means where they depend on the angle.
    pub(super) optics: Vec<Optics>,
    /// Those that depend on the angle.
    laws: Laws,
    /// Legs traced, and their bound: beyond it every path is cut off at its next portal.
    pub(super) legs: u64,
    pub(super) legs_max: u64,
    pending: Vec<u32>,
    /// Legs of the row traced for other bands.
    pub(super) known: KnownLegs,
    rays: Vec<Ray>,
}

impl Tracer {
    pub(super) fn new(tree: Arc<Tree>, mut laws: Laws) -> Self {
        Self {
            tree,
            optics: std::mem::take(&mut laws.means),
            laws,
            legs: 0,
            legs_max: u64::MAX,
            pending: Vec::new(),
            known: KnownLegs::default(),
            rays: Vec::new(),
        }
    }

    pub(super) fn surfaces(&self) -> Surfaces<'_> {
        Surfaces {
            optics: &self.optics,
            laws: &self.laws,
        }
    }

    /// The first triangle on a leg.
    pub(super) fn nearest(&mut self, ends: [DVec3; 2], horizon: &Plane) -> Option<Met> {
        self.known.nearest(&self.tree, ends, horizon, &mut self.pending)
    }

    /// Follows a path and all its branches. A branch ends at `reach` of length, at `least` of weight, and after
    /// [`PASSES_MAX`] portals.
    pub(super) fn follow(&mut self, first: Ray, ends: Ends, motions: &mut Motions, tally: &mut impl Tally) {
        self.rays.clear();
        self.rays.push(first);
        self.follow_rest(ends, motions, tally);
    }

    /// Follows the branches left by [`Self::meet`].
    pub(super) fn follow_rest(&mut self, ends: Ends, motions: &mut Motions, tally: &mut impl Tally) {
        while let Some(ray) = self.rays.pop() {
            let leg = (ends.reach - ray.length).min(leg_from(ray.from));
            if leg <= 0.0 {
                continue;
            }
            self.legs += 1;
            let end = ray.from + ray.towards * leg;
            match self.nearest([ray.from, end], &ray.horizon) {
                None => tally.escape(&ray),
                Some(met) => {
                    let met = MetAt {
                        id: met.id,
                        slot: met.slot,
                        corners: met.corners,
                        distance: met.place * leg,
                    };
                    self.meet(&ray, &met, ends, motions, tally);
                }
            }
        }
    }

    /// Goes on with a ray at the surface known to be its first.
    pub(super) fn meet(&mut self, ray: &Ray, met: &MetAt, ends: Ends, motions: &mut Motions, tally: &mut impl Tally) {
        let at = ray.from + ray.towards * met.distance;
        // The back of a one-sided patch hands on nothing.
        let varies = self.laws.varies(met.id);
        let optics = if varies {
            let normal = crate::geometry::cross(&met.corners).normalize_or_zero();
            self.laws.at(met.id, normal.dot(ray.towards))
        } else {
            self.optics.get(met.id as usize).copied().unwrap_or_default()
        };
        let [reflected, through] = divide(Some(&optics), ray.weight);
        let arrival = Arrival {
            patch: (met.id < self.tree.patch_count).then_some(met.id),
            at,
            length: ray.length + met.distance,
            passed: reflected + through,
            varies,
        };
        tally.arrive(ray, &arrival);
        if arrival.passed == 0 {
            return;
        }
        let Some(normal) = crate::geometry::cross(&met.corners).try_normalize() else {
            tally.cut(ray, arrival.passed);
            return;
        };
        // Towards the side that the ray comes from.
        let normal = if normal.dot(ray.towards) > 0.0 { -normal } else { normal };
        let offset = normal.dot(met.corners[0]);
        let is_over = ray.passes >= PASSES_MAX || self.legs >= self.legs_max;
        for (weight, is_mirror) in [(reflected, true), (through, false)] {
            if weight == 0 || is_mirror && ends.only == Some(ray.motion) {
                continue;
            }
            let on = Ray {
                from: at,
                towards: if is_mirror {
                    (ray.towards - 2.0 * normal.dot(ray.towards) * normal).normalize()
                } else {
                    ray.towards
                },
                horizon: if is_mirror {
                    Plane { normal, offset }
                } else {
                    Plane {
                        normal: -normal,
                        offset: -offset,
                    }
                },
                weight,
                passes: ray.passes + 1,
                motion: match ray.motion {
                    OTHER => OTHER,
                    motion if is_mirror => motions.reflected(motion, met.slot, normal, offset),
                    motion => motion,
                },
                length: arrival.length,
            };
            if is_over || weight <= ends.least {
                tally.cut(&on, weight);
            } else {
                self.rays.push(on);
            }
        }
    }
}

/// The parts of a weight that a surface reflects and lets through.
pub(super) fn divide(optics: Option<&Optics>, weight: u64) -> [u64; 2] {
    let Some(optics) = optics else { return [0; 2] };
    let reflected = share(weight, optics.specular);
    [reflected, share(weight, optics.transmittance).min(weight - reflected)]
}

/// A share of a weight, rounded down; all of it for 1.
fn share(weight: u64, of: f64) -> u64 {
    if of >= 1.0 {
        return weight;
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 ≤ share ≤ weight ≤ 2⁴⁸"
    )]
    let share = (weight as f64 * of) as u64;
    share.min(weight)
}
