//! The native half of the Python package `hemicube` (`python/hemicube`): the parts that need speed. Docstrings are the
//! comments here; the types are in `python/hemicube/_native.pyi`.
//!
//! Long work runs on a thread of its own while the calling thread, without the interpreter's lock, waits for it, looks
//! for signals and calls back (`attended.rs`).
//!
//! No Rust references into NumPy's arrays beyond a call, because NumPy owns its arrays: a matrix in memory is read-only
//! arrays, and solving copies a run of rows at a time out of them. Work runs on a thread of its own while the calling
//! one looks for signals, because Python runs handlers on its main thread only, and calibration and reading know
//! nothing of Python.

mod attended;
mod compute;
mod errors;
mod exchange;
mod export;
mod faces;
mod heat;
mod matrix;
mod numbers;
mod pandas;
mod pickle;
mod points;
mod portals;
mod program;
mod scene;
mod session;
mod sky;
mod solve;
mod views;
mod words;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("STEFAN_BOLTZMANN", hemicube::solve::STEFAN_BOLTZMANN)?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<matrix::Matrix>()?;
    module.add_class::<matrix::Rows>()?;
    module.add_class::<export::Zones>()?;
    module.add_class::<solve::Solution>()?;
    module.add_class::<heat::HeatBySurface>()?;
    module.add_class::<exchange::Exchange>()?;
    module.add_class::<views::Views>()?;
    module.add_class::<sky::Sky>()?;
    module.add_class::<points::Points>()?;
    module.add_function(wrap_pyfunction!(compute::compute, module)?)?;
    module.add_function(wrap_pyfunction!(matrix::open, module)?)?;
    module.add_function(wrap_pyfunction!(solve::solve, module)?)?;
    module.add_function(wrap_pyfunction!(solve::solve_heat, module)?)?;
    module.add_function(wrap_pyfunction!(exchange::exchange, module)?)?;
    module.add_function(wrap_pyfunction!(sky::sky, module)?)?;
    module.add_function(wrap_pyfunction!(sky::sky_of_points, module)?)?;
    module.add_function(wrap_pyfunction!(points::points, module)?)?;
    module.add_function(wrap_pyfunction!(pickle::matrix_at, module)?)?;
    module.add_function(wrap_pyfunction!(pickle::matrix_of, module)?)?;
    module.add_function(wrap_pyfunction!(scene::scene_of, module)?)?;
    module.add_function(wrap_pyfunction!(faces::triangles_of, module)?)?;
    module.add_function(wrap_pyfunction!(solve::solution_of, module)?)?;
    module.add_function(wrap_pyfunction!(program::main, module)?)?;
    Ok(())
}
