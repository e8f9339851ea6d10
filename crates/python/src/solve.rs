//! `hemicube.solve`: light and heat from a matrix.

use crate::attended::{Attendant, attended};
use crate::matrix::{Matrix, Use, python};
use crate::{errors, numbers};
use hemicube::solve::{
    Block, EnergyBalance, Factors, Method, Problem, Solution as Solved, SolveOptions, energy_balance,
    solve as solve_for,
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;

/// Products with the matrix, and the residual then.
type Steps = (u32, f64);

/// A solution: `radiosity` B and `irradiance` G of each patch, one column a right-hand side, (n,) where one was given.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Solution {
    solved: Solved,
    balance: Vec<EnergyBalance>,
    is_block: bool,
}

fn array<'py>(py: Python<'py>, block: &Block, is_block: bool) -> PyResult<Bound<'py, PyAny>> {
    let flat = PyArray1::from_vec(py, block.values().to_vec());
    if is_block {
        return Ok(flat.reshape([block.patches(), block.columns()])?.into_any());
    }
    Ok(flat.into_any())
}

#[pymethods]
impl Solution {
    /// B, the radiosity of each patch.
    #[getter]
    fn radiosity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, &self.solved.radiosity, self.is_block)
    }

    /// G, the irradiance of each patch.
    #[getter]
    fn irradiance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, &self.solved.irradiance, self.is_block)
    }

    /// Relative residual of each right-hand side.
    #[getter]
    fn residuals(&self) -> Vec<f64> {
        self.solved.residuals.clone()
    }

    /// Number of products with the matrix.
    #[getter]
    fn iterations(&self) -> u32 {
        self.solved.iterations
    }

    /// True if every residual is at most the tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.solved.converged
    }

    /// The power balance of each right-hand side: a dict each. emitted + from_outside = absorbed + escaped + blocked +
    /// unselected + closure + reciprocity + residual.
    #[getter]
    fn balance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let value = serde_json::to_value(&self.balance).map_err(|error| errors::input(error.to_string()))?;
        python(py, &value)
    }

    fn __repr__(&self) -> String {
        let residual = self.solved.residuals.iter().copied().fold(0.0, f64::max);
        format!(
            "<hemicube.Solution of {} patches, {} iterations, residual {residual:.1e}>",
            self.solved.radiosity.patches(),
            self.solved.iterations
        )
    }
}

/// Solving, once there is a matrix.
struct Solving<'a, 'py> {
    py: Python<'py>,
    problem: &'a Problem,
    options: SolveOptions,
    progress: Option<&'a Bound<'py, PyAny>>,
}

impl Use<PyResult<Solved>> for Solving<'_, '_> {
    fn with(self, factors: &dyn Factors) -> PyResult<Solved> {
        let (problem, options) = (self.problem, self.options);
        attended(self.py, self.progress, |attendant: Attendant<'_, Steps>| {
            solve_for(factors, problem, options, &mut |step| {
                attendant.tell((step.iteration, step.residual))
            })
            .map_err(|error| errors::solving(&error))
        })?
    }
}

/// Solves (I − R (F + S)) B = E + R H for the radiosity B of every patch: light, or heat.
///
/// `emission` E and `outside` H (irradiance from outside the matrix, as from the sky) are numbers, (n,) or (n, k) for k
/// right-hand sides at once. `reflectance` R is a number, (n,) or (n, bands); right-hand side r is of band r modulo the
/// number of bands. Heat is the same with reflectance 1 − ε and emission ε σ T⁴ (`STEFAN_BOLTZMANN`), and the net flux
/// is B − G. S = 1 − Σ F − escaped returns to its patch: backs, and the closure error of a row, exchange nothing.
///
/// `method` is 'gmres', 'gauss-seidel' or 'jacobi'; `tolerance` the relative residual to reach within `max_iterations`
/// products; a solution above it has a warning. `memory` bytes are used for a store. `progress(iteration, residual)` is
/// called some times a second.
#[pyfunction]
#[pyo3(signature = (
    matrix, reflectance, emission, *, outside=None, method="gmres", restart=20, tolerance=1e-6, max_iterations=500,
    memory=1_000_000_000, threads=0, progress=None
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn solve(
    py: Python<'_>,
    matrix: &Bound<'_, Matrix>,
    reflectance: &Bound<'_, PyAny>,
    emission: &Bound<'_, PyAny>,
    outside: Option<&Bound<'_, PyAny>>,
    method: &str,
    restart: u32,
    tolerance: f64,
    max_iterations: u32,
    memory: u64,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Solution> {
    let matrix = matrix.get();
    let count = matrix.patch_count();
    let (emitted, columns, mut is_block) = numbers::columns(emission, "emission", count)?;
    let (reflected, bands, _) = numbers::columns(reflectance, "reflectance", count)?;
    let outside = outside
        .map(|given| numbers::columns(given, "outside", count))
        .transpose()?;
    let arriving = outside.as_ref().map_or(1, |(_, columns, _)| *columns);
    let sides = columns.max(arriving);
    is_block |= outside.as_ref().is_some_and(|(_, _, is_block)| *is_block);
    if [columns, arriving].iter().any(|&given| given != 1 && given != sides) {
        return Err(errors::input(format!(
            "`emission` has {columns} right-hand sides and `outside` {arriving}; as many are needed, or one"
        )));
    }
    if sides % bands != 0 {
        return Err(errors::input(format!(
            "`reflectance` has {bands} bands, and there are {sides} right-hand sides: a multiple is needed"
        )));
    }
    let block = |values: &[f64], given: usize| {
        Block::from_fn(count, sides, |patch, side| {
            values[patch * given + if given == 1 { 0 } else { side }]
        })
    };
    let problem = Problem {
        reflectance: Block::from_fn(count, bands, |patch, band| reflected[patch * bands + band]),
        bands: (0..sides).map(|side| side % bands).collect(),
        emission: block(&emitted, columns),
        outside: outside.as_ref().map(|(values, columns, _)| block(values, *columns)),
        returned: Some(matrix.table()?.returned()),
    };
    if !(1e-14..1.0).contains(&tolerance) {
        return Err(errors::input(format!(
            "`tolerance` is {tolerance}; a number from 1e-14 up to 1 is needed"
        )));
    }
    if !(1..=200).contains(&restart) || max_iterations == 0 {
        return Err(errors::input(format!(
            "`restart` is {restart} and `max_iterations` {max_iterations}; 1 to 200, and 1 or more, are needed"
        )));
    }
    let options = SolveOptions {
        method: match method {
            "gmres" => Method::Gmres { restart },
            "gauss-seidel" => Method::GaussSeidel,
            "jacobi" => Method::Jacobi,
            other => {
                return Err(errors::input(format!(
                    "`method` is `{other}`; gmres, gauss-seidel or jacobi is needed"
                )));
            }
        },
        tolerance,
        max_iterations,
        threads,
    };
    let solved = matrix.lend(
        py,
        memory / 2,
        Solving {
            py,
            problem: &problem,
            options,
            progress,
        },
    )?;
    if !solved.converged {
        PyErr::warn(
            py,
            &py.get_type::<PyRuntimeWarning>(),
            c"the residual did not reach the tolerance; allow more with `max_iterations`, or look for surfaces that \
              reflect all",
            1,
        )?;
    }
    let balance = energy_balance(&problem, &solved, &matrix.area()?, &matrix.table()?);
    Ok(Solution {
        solved,
        balance,
        is_block,
    })
}
