//! `hemicube.solve`: light and heat from a matrix.

use crate::attended::{Attendant, attended};
use crate::heat::{self, HeatBySurface};
use crate::matrix::{Matrix, Use, stored};
use crate::pickle::{Reduced, maker};
use crate::{errors, numbers};
use hemicube::solve::{
    Block, EnergyBalance, Factors, Method, OPEN_LEAST, Pairs, Problem, Reading, STEFAN_BOLTZMANN, Solution as Solved,
    SolveOptions, energy_balance, require_shares, solve as solve_for,
};
use hemicube::store::RowTable;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Products with the matrix, and the residual then.
type Steps = (u32, f64);

/// A solution: `radiosity` B and `irradiance` G of each patch, one column a right-hand side, (n,) where one was given.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Solution {
    solved: Solved,
    balance: Vec<Terms>,
    /// Temperatures of heat, patch by patch.
    temperature: Option<Vec<f64>>,
    /// Irradiance of heat from the surroundings, patch by patch, where there is one state.
    outside: Option<Vec<f64>>,
    /// ρs + τ of each patch; empty without mirrors and panes.
    handed_on: Vec<f64>,
    /// The largest part of its heat that is not known of an enclosure or a body in one.
    energy_error: Option<f64>,
    is_block: bool,
}

/// The terms of a power balance by their names.
type Terms = Vec<(String, f64)>;

/// The terms of balances, in their order.
fn terms(balances: &[EnergyBalance]) -> Vec<Terms> {
    let of = |b: &EnergyBalance| {
        let terms = [
            ("emitted", b.emitted),
            ("from_outside", b.from_outside),
            ("absorbed", b.absorbed),
            ("escaped", b.escaped),
            ("blocked", b.blocked),
            ("unselected", b.unselected),
            ("closure", b.closure),
            ("returned", b.returned),
            ("reciprocity", b.reciprocity),
            ("residual", b.residual),
        ];
        terms.map(|(name, power)| (name.to_owned(), power)).to_vec()
    };
    balances.iter().map(of).collect()
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
    fn balance<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let dict = |terms: &Terms| {
            let dict = PyDict::new(py);
            for (name, power) in terms {
                dict.set_item(name, power)?;
            }
            Ok(dict)
        };
        self.balance.iter().map(dict).collect()
    }

    /// The largest part of its heat that is not known of an enclosure, or of a surface of one condition in it, because
    /// rows of the matrix do not sum to 1; of heat by `properties`, None otherwise.
    #[getter]
    fn energy_error(&self) -> Option<f64> {
        self.energy_error
    }

    /// B − G, the net flux of each patch, and B − (1 − ρs − τ) G of mirrors and panes: of heat in W/m², positive where
    /// the patch gives off more than it receives.
    #[getter]
    fn flux<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (sent, received) = (&self.solved.radiosity, &self.solved.irradiance);
        let flux = Block::from_fn(sent.patches(), sent.columns(), |patch, side| {
            sent.of(patch)[side] - (1.0 - self.handed_on.get(patch).unwrap_or(&0.0)) * received.of(patch)[side]
        });
        array(py, &flux, self.is_block)
    }

    /// The temperature of each patch in kelvin, of heat; None for light.
    #[getter]
    fn temperature<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let of = |values: &Vec<f64>| {
            let columns = self.solved.radiosity.columns();
            let block = Block::from_fn(self.solved.radiosity.patches(), columns, |patch, side| {
                values[patch * columns + side]
            });
            array(py, &block, self.is_block)
        };
        self.temperature.as_ref().map(of).transpose()
    }

    /// Heat, flux and temperature by surface of the `matrix` that was solved: by 'object', 'material' or 'face'. Of one
    /// state of heat only.
    #[pyo3(signature = (matrix, by="object"))]
    fn by_surface(&self, matrix: &Bound<'_, Matrix>, by: &str) -> PyResult<HeatBySurface> {
        let Some(temperature) = self
            .temperature
            .as_ref()
            .filter(|_| self.solved.radiosity.columns() == 1)
        else {
            return Err(errors::input(
                "`by_surface` is of one state of heat, as `solve_heat` finds it with one temperature a patch",
            ));
        };
        heat::by_surface(matrix.get(), &self.solved, self.outside.as_deref(), temperature, by)
    }

    /// Pickles the arrays and numbers.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, solution) = (slf.py(), slf.get());
        let solved = &solution.solved;
        let arguments = (
            array(py, &solved.radiosity, true)?,
            array(py, &solved.irradiance, true)?,
            solved.residuals.clone(),
            solved.iterations,
            solved.converged,
            solution.balance.clone(),
            solution
                .temperature
                .clone()
                .map(|values| PyArray1::from_vec(py, values)),
            solution.is_block,
            solution.outside.clone().map(|values| PyArray1::from_vec(py, values)),
            solution.handed_on.clone(),
            solution.energy_error,
        );
        Ok((maker(py, "_solution_of")?, arguments.into_pyobject(py)?))
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
    pairs: Option<PairsOf<'a>>,
    options: SolveOptions,
    progress: Option<&'a Bound<'py, PyAny>>,
}

/// Areas and stored rows of a matrix whose pairs are read once.
#[derive(Clone, Copy)]
pub(crate) struct PairsOf<'a> {
    pub(crate) areas: &'a [f64],
    pub(crate) rows: &'a RowTable,
}

impl<'a> PairsOf<'a> {
    /// Of some reading; `None` as stored.
    pub(crate) fn of(reading: Reading, areas: &'a [f64], rows: &'a RowTable) -> Option<Self> {
        (reading == Reading::Pairs).then_some(Self { areas, rows })
    }

    /// The pairs of `factors`.
    pub(crate) fn read<'f>(of: Option<Self>, factors: &'f dyn Factors, threads: usize) -> PyResult<Option<Pairs<'f>>> {
        of.map(|of| stored(Pairs::new(factors, of.areas, of.rows, threads)))
            .transpose()
    }
}

impl Use<PyResult<Solved>> for Solving<'_, '_> {
    fn with(self, factors: &dyn Factors) -> PyResult<Solved> {
        let (problem, options) = (self.problem, self.options);
        let pairs = PairsOf::read(self.pairs, factors, options.threads())?;
        let factors = pairs.as_ref().map_or(factors, |pairs| pairs as &dyn Factors);
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
///
/// A_i F_ij and A_j F_ji are two readings of one number: F is made of both, so that what is put in comes out, and S is
/// of its rows. `as_stored` takes each row as it is.
#[pyfunction]
#[pyo3(signature = (
    matrix, reflectance, emission, *, outside=None, method="gmres", restart=20, tolerance=1e-6, max_iterations=500,
    memory=1_000_000_000, threads=0,
    progress=None, as_stored=false
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
    as_stored: bool,
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
    let options = options(method, restart, tolerance, max_iterations, threads)?;
    let reading = reading(as_stored);
    let tables = matrix.read_table(py, memory / 2, reading, options.threads())?;
    let rows = &tables[0];
    let shown = |patch: usize| format!("patch {patch}");
    let most = |patch: usize| {
        (0..bands)
            .map(|band| reflected[patch * bands + band])
            .fold(0.0, f64::max)
    };
    require_shares(rows, "reflectance", shown, most).map_err(|error| errors::solving(&error))?;
    let problem = Problem {
        reflectance: Block::from_fn(count, bands, |patch, band| reflected[patch * bands + band]),
        bands: (0..sides).map(|side| side % bands).collect(),
        emission: block(&emitted, columns),
        outside: outside.as_ref().map(|(values, columns, _)| block(values, *columns)),
        returned: Some(rows.returned()),
    };
    let manner = Manner {
        options,
        memory,
        progress,
        reading,
        is_block,
    };
    solution(py, matrix, &problem, &tables, manner)
}

/// What of the matrix stands for a pair.
pub(crate) fn reading(as_stored: bool) -> Reading {
    if as_stored { Reading::AsStored } else { Reading::Pairs }
}

/// The options of solving, looked at.
fn options(method: &str, restart: u32, tolerance: f64, max_iterations: u32, threads: usize) -> PyResult<SolveOptions> {
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
    Ok(SolveOptions {
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
    })
}

/// Memory for solving, and the callback.
#[derive(Clone, Copy)]
pub(crate) struct Manner<'a, 'py> {
    pub(crate) options: SolveOptions,
    pub(crate) memory: u64,
    pub(crate) progress: Option<&'a Bound<'py, PyAny>>,
    pub(crate) reading: Reading,
    is_block: bool,
}

/// Solves a problem, and warns where it did not converge.
fn solution<'py>(
    py: Python<'py>,
    matrix: &Matrix,
    problem: &Problem,
    [rows, stored_rows]: &[RowTable; 2],
    manner: Manner<'_, 'py>,
) -> PyResult<Solution> {
    let areas = matrix.area()?;
    let solved = matrix.lend(
        py,
        manner.memory / 2,
        Solving {
            py,
            problem,
            pairs: PairsOf::of(manner.reading, &areas, stored_rows),
            options: manner.options,
            progress: manner.progress,
        },
    )?;
    warn_unconverged(py, &solved)?;
    let balance = energy_balance(problem, &solved, &areas, rows);
    Ok(Solution {
        solved,
        balance: terms(&balance),
        temperature: None,
        outside: None,
        handed_on: rows.handed_on.clone(),
        energy_error: None,
        is_block: manner.is_block,
    })
}

/// Warns of a residual above the tolerance.
fn warn_unconverged(py: Python<'_>, solved: &Solved) -> PyResult<()> {
    if solved.converged {
        return Ok(());
    }
    PyErr::warn(
        py,
        &py.get_type::<PyRuntimeWarning>(),
        c"the residual did not reach the tolerance; allow more with `max_iterations`, or look for surfaces that \
          reflect all",
        1,
    )
}

/// Heat between grey, diffuse surfaces, as the program's `solve --thermal`: radiosity B, irradiance G, `flux` B − G in
/// W/m² and `temperature` in kelvin.
///
/// Either `properties`, a dictionary as the program's file of materials (docs/heat.md): `{"default": {"emissivity":
/// 0.9, "temperature": "20 °C"}, "object": {"floor": {"flux": 40}, "Zone 3*": {"heat": 500, "isothermal": True}},
/// "material": {…}}`, with the conditions `temperature`, `adiabatic`, `flux` (W/m²), `heat` (W), `isothermal` and
/// `body`.
///
/// Or arrays: `emissivity` is a number or (n,), from 0 to 1; `temperature` in kelvin a number, (n,), or (n, k) for k
/// right-hand sides at once. NaN is an adiabatic patch: it sends what it receives, whatever its emissivity, and its
/// temperature is found.
///
/// What leaves the scene goes to, and comes from, surroundings at `ambient`, in kelvin or as '20 °C'; 0 is cold space.
/// `load`, with `properties`, is the heat that each patch takes up from elsewhere, as of the sun, (n,) in W/m²: a patch
/// whose temperature is to be found radiates it.
/// `ground`, with `properties`, is the temperature of what lies below the horizon, and `below_horizon` (n,) the share
/// of each patch's view that ends there, such as `sky(scene).ground`. The other keywords are those of `solve`.
///
/// With `properties`, `energy_error` of the solution is the largest part of its heat that is not known of an enclosure
/// or a surface; above 1 % there is a warning.
#[pyfunction]
#[pyo3(signature = (
    matrix, emissivity=None, temperature=None, *, properties=None, ambient=None, ground=None, below_horizon=None,
    load=None, method="gmres", restart=20, tolerance=1e-6, max_iterations=500, memory=1_000_000_000, threads=0,
    progress=None, as_stored=false
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn solve_heat(
    py: Python<'_>,
    matrix: &Bound<'_, Matrix>,
    emissivity: Option<&Bound<'_, PyAny>>,
    temperature: Option<&Bound<'_, PyAny>>,
    properties: Option<&Bound<'_, PyAny>>,
    ambient: Option<&Bound<'_, PyAny>>,
    ground: Option<&Bound<'_, PyAny>>,
    below_horizon: Option<&Bound<'_, PyAny>>,
    load: Option<&Bound<'_, PyAny>>,
    method: &str,
    restart: u32,
    tolerance: f64,
    max_iterations: u32,
    memory: u64,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
    as_stored: bool,
) -> PyResult<Solution> {
    if ambient.is_none() {
        heat::warn_of_surroundings(py, matrix.get())?;
    }
    let ambient = match ambient {
        Some(given) => {
            let kelvin = heat::kelvin(given, "ambient")?;
            if given.extract::<f64>().is_ok() {
                heat::question_cold(py, &Vec::from_iter(heat::cold(kelvin, "`ambient`")))?;
            }
            kelvin
        }
        None => 0.0,
    };
    let manner = |is_block| {
        options(method, restart, tolerance, max_iterations, threads).map(|options| Manner {
            options,
            memory,
            progress,
            reading: reading(as_stored),
            is_block,
        })
    };
    match (properties, emissivity, temperature) {
        (Some(properties), None, None) => {
            let ground = heat::ground(matrix.get(), ground, below_horizon)?;
            let count = matrix.get().patch_count();
            let load = load.map(|load| numbers::vector(load, "load", count)).transpose()?;
            let surroundings = heat::Surroundings { ambient, ground, load };
            heat_of_properties(py, matrix.get(), properties, surroundings, manner(false)?)
        }
        (None, ..) if ground.is_some() || below_horizon.is_some() || load.is_some() => Err(errors::input(
            "`ground`, `below_horizon` and `load` are for `properties`",
        )),
        (None, Some(emissivity), Some(temperature)) => {
            let arrays = [emissivity, temperature];
            heat_of_arrays(py, matrix.get(), arrays, ambient, manner)
        }
        _ => Err(errors::input(
            "`properties`, or both `emissivity` and `temperature`, are needed",
        )),
    }
}

/// Heat by names.
fn heat_of_properties(
    py: Python<'_>,
    matrix: &Matrix,
    properties: &Bound<'_, PyAny>,
    surroundings: heat::Surroundings,
    manner: Manner<'_, '_>,
) -> PyResult<Solution> {
    let heat::Found {
        found,
        outside,
        rows,
        energy_error,
    } = heat::solve(py, matrix, properties, surroundings, manner)?;
    warn_unconverged(py, &found.solution)?;
    let balance = energy_balance(&found.problem, &found.solution, &matrix.area()?, &rows);
    Ok(Solution {
        solved: found.solution,
        balance: terms(&balance),
        temperature: Some(found.temperature),
        outside,
        handed_on: rows.handed_on,
        energy_error: Some(energy_error),
        is_block: false,
    })
}

/// Heat by arrays.
fn heat_of_arrays<'a, 'py>(
    py: Python<'py>,
    matrix: &Matrix,
    [emissivity, temperature]: [&Bound<'py, PyAny>; 2],
    ambient: f64,
    manner: impl Fn(bool) -> PyResult<Manner<'a, 'py>>,
) -> PyResult<Solution>
where
    'py: 'a,
{
    let count = matrix.patch_count();
    let emissivity = match emissivity.extract::<f64>() {
        Ok(number) => vec![number; count],
        Err(_) => numbers::vector(emissivity, "emissivity", count)?,
    };
    let (kelvin, columns, is_block) = numbers::columns(temperature, "temperature", count)?;
    if let Some(wrong) = emissivity.iter().find(|value| !(0.0..=1.0).contains(*value)) {
        return Err(errors::input(format!("an emissivity is {wrong}; it is from 0 to 1")));
    }
    let is_wrong = |kelvin: &&f64| !kelvin.is_nan() && !(0.0..=KELVIN_MAX).contains(*kelvin);
    if let Some(wrong) = kelvin.iter().find(is_wrong) {
        return Err(errors::input(format!(
            "a temperature is {wrong}; it is in kelvin, from 0 on, or NaN for an adiabatic patch"
        )));
    }
    let cold = kelvin.iter().filter_map(|&kelvin| heat::cold(kelvin, "`temperature`"));
    heat::question_cold(py, &Vec::from_iter(cold.take(1)))?;
    let black = |kelvin: f64| STEFAN_BOLTZMANN * kelvin.powi(4);
    let of = |patch: usize, side: usize| kelvin[patch * columns + side];
    let manner = manner(is_block)?;
    let tables = matrix.read_table(py, manner.memory / 2, manner.reading, manner.options.threads())?;
    let table = &tables[0];
    let shown = |patch: usize| format!("patch {patch}");
    require_shares(table, "emissivity", shown, |patch| emissivity[patch]).map_err(|error| errors::solving(&error))?;
    // What escapes may not be known.
    let is_open = table.escaped.iter().any(|&share| share.is_nan() || share > OPEN_LEAST);
    let is_held = |side: usize| (0..count).any(|patch| emissivity[patch] > 0.0 && !of(patch, side).is_nan());
    if !is_open && !(0..columns).all(is_held) {
        return Err(errors::input(
            "nothing determines the temperatures: in a closed scene a patch needs one, and an emissivity above 0",
        ));
    }
    let escaped = |patch: usize| Some(table.escaped[patch]).filter(|share| !share.is_nan());
    let problem = Problem {
        // Patches adiabatic at some right-hand sides only have a reflectance a side.
        reflectance: Block::from_fn(count, columns, |patch, side| {
            if of(patch, side).is_nan() {
                table.kept(patch)
            } else {
                (table.kept(patch) - emissivity[patch]).max(0.0)
            }
        }),
        bands: (0..columns).collect(),
        emission: Block::from_fn(count, columns, |patch, side| {
            if of(patch, side).is_nan() {
                0.0
            } else {
                emissivity[patch] * black(of(patch, side))
            }
        }),
        outside: (ambient > 0.0).then(|| {
            Block::from_fn(count, columns, |patch, _| {
                escaped(patch).map_or(0.0, |share| share * black(ambient))
            })
        }),
        returned: Some(table.returned()),
    };
    let mut found = solution(py, matrix, &problem, &tables, manner)?;
    // An adiabatic patch sends as much as a black one of its temperature; of a mirror, what it would send.
    let radiosity = Block::from_fn(count, columns, |patch, side| match table.kept(patch) {
        1.0 => found.solved.radiosity.of(patch)[side],
        _ => found.solved.irradiance.of(patch)[side],
    });
    let radiosity = radiosity.values();
    let settled = |(&kelvin, &sent): (&f64, &f64)| match kelvin.is_nan() {
        true => (sent / STEFAN_BOLTZMANN).max(0.0).powf(0.25),
        false => kelvin,
    };
    found.temperature = Some(kelvin.iter().zip(radiosity).map(settled).collect());
    found.outside = problem
        .outside
        .filter(|_| columns == 1)
        .map(|outside| outside.values().to_vec());
    Ok(found)
}

/// Hotter than any furnace: a unit mistaken, or a typing error.
pub(crate) const KELVIN_MAX: f64 = 1e6;

/// The solution of a pickle.
#[pyfunction]
#[pyo3(name = "_solution_of", signature = (
    radiosity, irradiance, residuals, iterations, converged, balance, temperature, is_block, outside=None,
    handed_on=Vec::new(), energy_error=None
))]
#[allow(clippy::too_many_arguments, reason = "the state of a solution")]
pub(crate) fn solution_of(
    radiosity: &Bound<'_, PyAny>,
    irradiance: &Bound<'_, PyAny>,
    residuals: Vec<f64>,
    iterations: u32,
    converged: bool,
    balance: Vec<Terms>,
    temperature: Option<&Bound<'_, PyAny>>,
    is_block: bool,
    outside: Option<&Bound<'_, PyAny>>,
    handed_on: Vec<f64>,
    energy_error: Option<f64>,
) -> PyResult<Solution> {
    let patches = radiosity.len()?;
    let block = |given: &Bound<'_, PyAny>, what| {
        let (values, columns, _) = numbers::columns(given, what, patches)?;
        let block = Block::from_fn(patches, columns, |patch, side| values[patch * columns + side]);
        Ok::<_, PyErr>(block)
    };
    let (radiosity, irradiance) = (block(radiosity, "radiosity")?, block(irradiance, "irradiance")?);
    let sides = radiosity.columns();
    let temperature = temperature
        .map(|given| numbers::vector(given, "temperature", patches * sides))
        .transpose()?;
    let outside = outside
        .map(|given| numbers::vector(given, "outside", patches))
        .transpose()?;
    if irradiance.columns() != sides || residuals.len() != sides || balance.len() != sides || (sides != 1 && !is_block)
    {
        return Err(errors::content(format!(
            "a pickled solution of {sides} right-hand sides has arrays of others"
        )));
    }
    let solved = Solved {
        radiosity,
        irradiance,
        residuals,
        iterations,
        converged,
    };
    Ok(Solution {
        solved,
        balance,
        temperature,
        outside,
        handed_on,
        energy_error,
        is_block,
    })
}
