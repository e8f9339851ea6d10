//! Polygons of meshes in other packages, cut into triangles, and values of patches added up over faces.

use crate::{errors, numbers};
use glam::DVec3;
use hemicube_scene::{ReadOptions, faces};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

/// Triangles as indices of points, (m, 3), and each one's polygon, (m,).
type Cut = (Py<PyArray2<u32>>, Py<PyArray1<u32>>);

/// Cuts polygons: the points of all of them, and where each ends.
#[pyfunction]
#[pyo3(name = "_triangles_of", signature = (points, corners, ends))]
pub(crate) fn triangles_of(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    corners: &Bound<'_, PyAny>,
    ends: &Bound<'_, PyAny>,
) -> PyResult<Cut> {
    let points: Vec<DVec3> = numbers::points(points, "points")?
        .into_iter()
        .map(DVec3::from_array)
        .collect();
    let corners = numbers::ids(corners, "corners", corners.len()?)?;
    let ends = numbers::ids(ends, "ends", ends.len()?)?;
    let corner = |corner: i64| {
        let number = u32::try_from(corner)
            .ok()
            .filter(|&number| (number as usize) < points.len());
        number.ok_or_else(|| errors::input(format!("a cell has the point {corner}, and there are {}", points.len())))
    };
    let corners = corners.into_iter().map(corner).collect::<PyResult<Vec<u32>>>()?;
    let end = |end: i64| usize::try_from(end).map_err(|_| errors::input(format!("a cell ends at {end}")));
    let ends = ends.into_iter().map(end).collect::<PyResult<Vec<usize>>>()?;
    let cut = py.detach(|| faces::triangles(&points, &corners, &ends, ReadOptions::default()));
    let (triangles, polygons) = cut.map_err(|error| errors::input(error.to_string()))?;
    let count = triangles.len();
    let flat: Vec<u32> = triangles.into_iter().flatten().collect();
    Ok((
        PyArray1::from_vec(py, flat).reshape([count, 3])?.unbind(),
        PyArray1::from_vec(py, polygons).unbind(),
    ))
}
