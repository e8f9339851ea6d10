//! Faces of meshes that are in memory: polygons as lists of points, cut into triangles as the readers cut them.

use crate::bounds::Bounds;
use crate::polygon::triangulate;
use crate::{Error, ReadOptions};
use glam::DVec3;

/// Cuts polygons into triangles with their winding. Polygon k has the corners from `ends[k - 1]` (or 0) to `ends[k]` of
/// `corners`, indices of `points`. Returns the triangles, as indices of points, and each one's polygon. A polygon with
/// fewer than three corners, or without area, has none.
///
/// # Errors
/// When an end or an index is beyond what there is, or polygons have too many corners; the message names the polygon.
///
/// ```
/// use hemicube_scene::{ReadOptions, faces};
/// use glam::DVec3;
///
/// // A square, and a triangle on it.
/// let points = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y, DVec3::Z];
/// let cut = faces::triangles(&points, &[0, 1, 2, 3, 0, 1, 4], &[4, 7], ReadOptions::default())?;
/// assert_eq!(cut, (vec![[0, 1, 2], [0, 2, 3], [0, 1, 4]], vec![0, 0, 1]));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn triangles(
    points: &[DVec3],
    corners: &[u32],
    ends: &[usize],
    options: ReadOptions,
) -> Result<(Vec<[u32; 3]>, Vec<u32>), Error> {
    let mut bounds = Bounds::new(size_of_val(points) + size_of_val(corners), options);
    let (mut triangles, mut polygons) = (Vec::new(), Vec::new());
    let (mut outline, mut cut) = (Vec::new(), Vec::new());
    let mut begin = 0;
    for (polygon, &end) in (0..).zip(ends) {
        let Some(numbers) = corners.get(begin..end) else {
            return Err(Error::malformed(format!(
                "polygon {polygon} ends at corner {end}, and begins at {begin} of {}",
                corners.len()
            )));
        };
        begin = end;
        outline.clear();
        for &number in numbers {
            outline.push(points.get(number as usize).copied().ok_or_else(|| {
                Error::malformed(format!(
                    "polygon {polygon} has the point {number}, and there are {}, from 0 on",
                    points.len()
                ))
            })?);
        }
        bounds.polygon(outline.len())?;
        cut.clear();
        triangulate(&outline, &mut cut);
        polygons.resize(polygons.len() + cut.len(), polygon);
        triangles.extend(cut.iter().map(|triangle| triangle.map(|at| numbers[at as usize])));
    }
    Ok((triangles, polygons))
}
