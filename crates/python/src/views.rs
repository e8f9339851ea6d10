//! Common parts of sky rows and rows of sensors: the shares of both, their matrices, and checks of their arguments.

use crate::errors;
use crate::scene::{Scene, axis};
use glam::DVec3;
use hemicube::backend::HemicubeBackend;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Rows of view factors from patches or points.
#[pyclass(frozen, subclass, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Views {
    /// Ground, backs and change of each row.
    shares: Vec<[f64; 3]>,
}

impl Views {
    /// The share below the horizon, the share on backs, and the change of each row.
    pub(crate) fn new(shares: impl Iterator<Item = [f64; 3]>) -> Self {
        Self {
            shares: shares.collect(),
        }
    }

    fn column<'py>(&self, py: Python<'py>, at: usize) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.shares.iter().map(|shares| shares[at]).collect())
    }
}

#[pymethods]
impl Views {
    fn __len__(&self) -> usize {
        self.shares.len()
    }

    /// Share of each row that escapes below the horizon.
    #[getter]
    fn ground<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, 0)
    }

    /// Share of each row on backs of one-sided patches.
    #[getter]
    fn blocked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, 1)
    }

    /// Change of each row by its last refinement (`Sky`: of its sky view factor); NaN without a tolerance.
    #[getter]
    fn changes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, 2)
    }
}

/// A `scipy.sparse.csr_matrix` of rows of columns and values.
pub(crate) fn csr<R: Iterator<Item = (u32, f64)>>(
    py: Python<'_>,
    rows: impl Iterator<Item = R>,
    columns: usize,
) -> PyResult<Bound<'_, PyAny>> {
    let (mut indptr, mut indices, mut data) = (vec![0_i64], Vec::<i64>::new(), Vec::new());
    for row in rows {
        for (column, value) in row {
            indices.push(column.into());
            data.push(value);
        }
        indptr.push(i64::try_from(data.len()).unwrap_or(i64::MAX));
    }
    let named = PyDict::new(py);
    named.set_item("shape", (indptr.len() - 1, columns))?;
    let arrays = (
        PyArray1::from_vec(py, data),
        PyArray1::from_vec(py, indices),
        PyArray1::from_vec(py, indptr),
    );
    py.import("scipy.sparse")?
        .call_method("csr_matrix", (arrays,), Some(&named))
}

/// The axis asked for, or the scene's.
pub(crate) fn up(scene: &Scene, name: Option<&str>) -> PyResult<hemicube_scene::Axis> {
    match name {
        Some(name) => axis(name),
        None => hemicube_scene::up::up(&scene.input)
            .known()
            .ok_or_else(|| errors::input("the scene does not say which axis points up; `up=\"z\"` does")),
    }
}

/// Refuses tolerances out of range.
pub(crate) fn require_tolerance(tolerance: Option<f64>) -> PyResult<()> {
    match tolerance.filter(|tolerance| !(1e-5..=0.5).contains(tolerance)) {
        None => Ok(()),
        Some(wrong) => Err(errors::input(format!(
            "`tolerance` is {wrong}; a share from 0.00001 to 0.5 is needed"
        ))),
    }
}

/// Refuses backends without item buffers, from which `what`.
pub(crate) fn require_items(backend: Box<dyn HemicubeBackend>, what: &str) -> PyResult<Box<dyn HemicubeBackend>> {
    if backend.info().capabilities.items {
        return Ok(backend);
    }
    Err(errors::backend(format!(
        "backend `{}` hands out no item buffers, from which {what}; `backend=\"cpu\"` does",
        backend.info().name
    )))
}

/// Refuses other numbers of directions than of points.
pub(crate) fn require_as_many(positions: &[[f64; 3]], normals: &[[f64; 3]]) -> PyResult<()> {
    if positions.len() == normals.len() {
        return Ok(());
    }
    Err(errors::input(format!(
        "there are {} positions and {} normals; as many are needed",
        positions.len(),
        normals.len()
    )))
}

/// A place, and the direction in which it looks.
pub(crate) fn placed(point: usize, position: [f64; 3], normal: Option<[f64; 3]>) -> PyResult<(DVec3, Option<DVec3>)> {
    let (position, normal) = (DVec3::from_array(position), normal.map(DVec3::from_array));
    if position.is_finite() && normal.is_none_or(|normal| normal.try_normalize().is_some()) {
        return Ok((position, normal));
    }
    Err(errors::input(format!(
        "point {point} has no place, or no direction to look in"
    )))
}
