//! Stub: ear clipping of planar, possibly concave polygons.
use glam::DVec3;

/// Appends the triangles of the polygon as indices into `corners`, with the polygon's winding.
pub(crate) fn triangulate(corners: &[DVec3], out: &mut Vec<[u32; 3]>) {
    for i in 1..u32::try_from(corners.len()).unwrap_or(0).saturating_sub(1) {
        out.push([0, i, i + 1]);
    }
}
