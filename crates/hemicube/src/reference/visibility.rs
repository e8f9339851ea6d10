//! Rays against the scene: obvhs's hierarchy over f32 boxes, and triangles met in f64.
//!
//! Ray and triangle: Möller & Trumbore 1997. A box is widened by more than the rounding of its corners, of the ray's
//! origin, of its direction and of the slab test together: no ray to its triangle misses the box.

use crate::Model;
use crate::frame;
use crate::geometry;
use crate::visibility::spaces::Spaces;
use glam::{DVec3, Vec3A};
use hemicube_scene::InputPatch;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use std::sync::Arc;
use std::time::Duration;

/// Margin by which boxes are widened: a few f32 roundings (6e-8) over a path of at most 2√3, in normalised units.
const WIDEN: f32 = 4e-6;
/// Width beyond a triangle's edges within which it stops a ray, in barycentric coordinates: a thousand roundings. A ray
/// through an edge that two triangles share is stopped by one of them.
const HAIR: f64 = 1e-12;
/// Longer than any segment within normalised coordinates.
const FAR: f32 = 8.0;

/// A patch as the end of rays, in normalised coordinates.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    pub(super) patch: u32,
    pub(super) corners: [DVec3; 3],
    pub(super) normal: DVec3,
    pub(super) area: f64,
    surface: u32,
}

impl Sight {
    /// `None` for a patch without area.
    pub(super) fn new(model: &Model, patch: InputPatch) -> Option<Self> {
        let corners = model.patches().corners(patch).map(|p| model.normalise(p));
        let [_, _, normal] = frame::axes(corners, 0.0)?;
        let area = geometry::area(&corners);
        (area > 0.0).then_some(Self {
            patch: patch.0,
            corners,
            normal,
            area,
            surface: u32::try_from(model.patches().surface(patch)).ok()?,
        })
    }

    /// A free point facing along `normal`.
    pub(super) fn free(point: DVec3, normal: DVec3) -> Self {
        Self {
            patch: u32::MAX,
            corners: [point; 3],
            normal: normal.normalize_or_zero(),
            area: 0.0,
            surface: u32::MAX,
        }
    }

    pub(super) fn centroid(&self) -> DVec3 {
        geometry::centroid(&self.corners)
    }

    pub(super) fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.corners[0])
    }
}

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Met {
    Nothing,
    /// The back of a one-sided surface.
    Back,
    Patch(u32),
}

#[derive(Clone, Debug)]
struct Occluder {
    corner: DVec3,
    edges: [DVec3; 2],
    surface: u32,
    front: u32,
    back: Option<u32>,
}

impl Occluder {
    fn corners(&self) -> [DVec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
    }

    /// Distance of the hit along `direction`, and the determinant, positive for a hit on the front.
    #[inline(always)]
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let [e, f] = self.edges;
        let p = direction.cross(f);
        let determinant = e.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let s = origin - self.corner;
        let u = s.dot(p) * inverse;
        if !(-HAIR..=1.0 + HAIR).contains(&u) {
            return None;
        }
        let q = s.cross(e);
        let v = direction.dot(q) * inverse;
        if v < -HAIR || u + v > 1.0 + HAIR {
            return None;
        }
        let t = f.dot(q) * inverse;
        (t > 0.0).then_some((t, determinant))
    }

    /// The patch on the side of the hit.
    fn side(&self, determinant: f64) -> Option<u32> {
        if determinant > 0.0 { Some(self.front) } else { self.back }
    }
}

/// All surfaces under a hierarchy.
pub(super) struct Occluders {
    hierarchy: Bvh2,
    /// In the hierarchy's order.
    occluders: Vec<Occluder>,
    tolerance: f64,
    spaces: Arc<Spaces>,
}

impl std::fmt::Debug for Occluders {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Occluders")
            .field("count", &self.occluders.len())
            .finish_non_exhaustive()
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "rounding to f32 is what the widened boxes allow for"
)]
fn rounded(p: DVec3) -> Vec3A {
    Vec3A::new(p.x as f32, p.y as f32, p.z as f32)
}

impl Occluders {
    pub(super) fn new(model: &Model) -> Self {
        let geometry = model.geometry();
        let boxes: Vec<Aabb> = geometry
            .surfaces
            .iter()
            .map(|surface| {
                let (low, high) = geometry::bounds(&surface.corners);
                Aabb::new(rounded(low) - Vec3A::splat(WIDEN), rounded(high) + Vec3A::splat(WIDEN))
            })
            .collect();
        let mut hierarchy = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        let occluders = hierarchy
            .primitive_indices
            .iter()
            .map(|&index| {
                let surface = &geometry.surfaces[index as usize];
                let [a, b, c] = surface.corners;
                Occluder {
                    corner: a,
                    edges: [b - a, c - a],
                    // Fewer than 2³¹ surfaces.
                    #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ patches")]
                    surface: model.patches().surface(surface.front) as u32,
                    front: surface.front.0,
                    back: surface.back.map(|patch| patch.0),
                }
            })
            .collect();
        hierarchy.primitive_indices = Vec::new();
        Self {
            hierarchy,
            occluders,
            tolerance: geometry.plane_tolerance,
            spaces: Spaces::of(model),
        }
    }

    /// Returns whether a surface lies in or below the emitter's horizon, its plane.
    fn is_below(&self, emitter: &Sight, occluder: &Occluder) -> bool {
        occluder.surface == emitter.surface || occluder.corners().iter().all(|&c| emitter.height(c) <= self.tolerance)
    }

    /// The first hit of the ray from a point of the emitter; `direction` of unit length.
    pub(super) fn first(&self, emitter: &Sight, origin: DVec3, direction: DVec3) -> Met {
        self.first_counted(emitter, [origin, direction], |_| false, &mut 0)
    }

    /// [`Self::first`] of a ray's origin and direction; of surfaces in one plane, a patch that `is_apart` names comes
    /// after all others. Adds the triangles that the ray was held against to `tests`.
    pub(super) fn first_counted(
        &self,
        emitter: &Sight,
        [origin, direction]: [DVec3; 2],
        is_apart: impl Fn(u32) -> bool,
        tests: &mut u64,
    ) -> Met {
        let mut nearest = f64::INFINITY;
        // The first hit so far, its distance along the ray, and its surface.
        let mut best: Option<(Met, f64, &Occluder)> = None;
        let ray = Ray::new(rounded(origin), rounded(direction), 0.0, FAR);
        self.hierarchy.ray_traverse(ray, &mut RayHit::none(), |_, index| {
            *tests += 1;
            let occluder = &self.occluders[index];
            let Some((t, determinant)) = occluder.meet(origin, direction) else {
                return f32::INFINITY;
            };
            // The cosine between ray and plane bounds the distance of surfaces in one plane along the ray.
            let cosine = (determinant / occluder.edges[0].cross(occluder.edges[1]).length()).abs();
            let tie = 4.0 * self.tolerance / cosine.max(1e-4);
            if t > nearest + tie || self.is_below(emitter, occluder) {
                return f32::INFINITY;
            }
            let found = occluder.side(determinant).map_or(Met::Back, Met::Patch);
            let wins = match best {
                None => true,
                // Surfaces crossing at a small angle are as near to each other, and not in one plane.
                Some((_, before, other)) if (t - before).abs() > tie || !self.are_in_plane(occluder, other) => {
                    t < before
                }
                Some((met, ..)) => match (met, found) {
                    (_, Met::Back | Met::Nothing) => false,
                    (Met::Patch(old), Met::Patch(new)) => (is_apart(new), new) < (is_apart(old), old),
                    (_, Met::Patch(_)) => true,
                },
            };
            if wins {
                best = Some((found, t, occluder));
            }
            nearest = nearest.min(t);
            // Boxes at the same depth must still be opened.
            #[allow(clippy::cast_possible_truncation, reason = "rounding to f32, less than the margin")]
            let limit = (t + tie) as f32 + WIDEN;
            limit
        });
        best.map_or(Met::Nothing, |(met, ..)| met)
    }

    /// Returns whether one of two surfaces lies in the plane of the other.
    fn are_in_plane(&self, p: &Occluder, q: &Occluder) -> bool {
        let lies_in = |p: &Occluder, q: &Occluder| {
            let [e, f] = q.edges;
            let normal = e.cross(f).normalize_or_zero();
            let height = |corner: DVec3| normal.dot(corner - q.corner).abs();
            p.corners().into_iter().all(|corner| height(corner) <= self.tolerance)
        };
        lies_in(p, q) || lies_in(q, p)
    }

    /// Returns whether nothing lies between a point of the emitter and a point of the receiver. `last` holds the
    /// occluder of the pair's previous segment.
    pub(super) fn sees(
        &self,
        emitter: &Sight,
        from: DVec3,
        receiver: &Sight,
        to: DVec3,
        last: &mut Option<u32>,
    ) -> bool {
        let direction = to - from;
        let length = direction.length();
        if length == 0.0 {
            return true;
        }
        let occludes = |occluder: &Occluder| {
            if occluder.surface == receiver.surface || occluder.surface == emitter.surface {
                return false;
            }
            let Some((t, determinant)) = occluder.meet(from, direction) else {
                return false;
            };
            if t > BEYOND || self.is_below(emitter, occluder) {
                return false;
            }
            let in_plane = occluder
                .corners()
                .iter()
                .all(|&c| receiver.height(c).abs() <= self.tolerance);
            if in_plane {
                // Of two spaces, each sees its own.
                let is_before = |patch| patch < receiver.patch && !self.spaces.separate(patch, receiver.patch);
                return occluder.side(determinant).is_some_and(is_before);
            }
            t < 1.0
        };
        if let Some(occluder) = last.and_then(|index| self.occluders.get(index as usize))
            && occludes(occluder)
        {
            return false;
        }
        #[allow(clippy::cast_possible_truncation, reason = "rounding to f32, less than the margin")]
        let limit = (length * BEYOND) as f32 + WIDEN;
        let ray = Ray::new(rounded(from), rounded(direction / length), 0.0, limit);
        self.hierarchy.ray_traverse_miss(ray, |_, index| {
            if occludes(&self.occluders[index]) {
                *last = u32::try_from(index).ok();
                0.0
            } else {
                f32::INFINITY
            }
        })
    }
}

/// Distance beyond the receiver at which a surface in its plane may be met, in lengths of the segment.
const BEYOND: f64 = 1.001;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::visibility::segments::tests::through_shared_edges;

    #[test]
    fn a_ray_through_an_edge_that_two_triangles_share_is_stopped() {
        for (triangles, [start, end]) in through_shared_edges() {
            let meets = |[a, b, c]: [DVec3; 3]| {
                let occluder = Occluder {
                    corner: a,
                    edges: [b - a, c - a],
                    surface: 0,
                    front: 0,
                    back: None,
                };
                occluder.meet(start, end - start).is_some_and(|(at, _)| at < 1.0)
            };
            assert!(triangles.into_iter().any(meets), "{triangles:?} from {start} to {end}");
        }
    }
}
