//! Close hemicubes: those with a surface right before them, as where two houses share a wall.
//!
//! A GPU clips triangles at a near plane in f32, and its depths are f32: of a close hemicube it loses triangles as
//! large as the scene, or sees through the wall. A backend with [`leaves_close`](crate::backend::Capabilities::leaves_close)
//! leaves such hemicubes to a processor.

use crate::backend::{Geometry, Hemicube};
use crate::bvh::distance;
use glam::DVec3;
use hemicube_spatial::Visit;

/// Distance of a close hemicube's nearest surface, at most, in normalised units: 2⁻¹⁸, some centimetres in a city of
/// ten kilometres. Four times the nearest near plane at which an NVIDIA H100 lost no triangle (docs/dev/gpu.md).
pub const CLOSE: f64 = 1.0 / 262_144.0;

/// Returns the distance from a hemicube's eye to the nearest surface that reaches above its plane, the emitter's left
/// out, or `within` where none is nearer. Looks at the surfaces of nodes within that distance of the eye.
pub fn distance_before(geometry: &Geometry, hemicube: &Hemicube, within: f64) -> f64 {
    let mut nearest = within;
    // An octree without surfaces is one that no scene was put into.
    if geometry.octree.order().len() != geometry.surfaces.len() {
        return nearest;
    }
    let eye = hemicube.origin;
    geometry.octree.visit_front_to_back(eye, |_, node| {
        if node.bounds.distance_squared(eye) >= nearest * nearest {
            return Visit::Skip;
        }
        if node.own_bounds.distance_squared(eye) < nearest * nearest {
            for surface in node.own().map(|index| &geometry.surfaces[index as usize]) {
                let is_own =
                    hemicube.emitter.is_some() && [Some(surface.front), surface.back].contains(&hemicube.emitter);
                let height = |&corner: &DVec3| hemicube.axes[2].dot(corner - eye);
                let mut heights = surface.corners.iter().map(height);
                if !is_own && heights.any(|height| height > geometry.plane_tolerance) {
                    nearest = nearest.min(distance(eye, &surface.corners));
                }
            }
        }
        Visit::Descend
    });
    nearest
}

/// Returns whether a surface is within [`CLOSE`] of a hemicube's eye and above its plane.
pub fn is_close(geometry: &Geometry, hemicube: &Hemicube) -> bool {
    distance_before(geometry, hemicube, CLOSE) < CLOSE
}
