//! Heat by the names of surfaces: properties as a dictionary, results by object, material or face.

use crate::attended::{Attendant, attended};
use crate::errors;
use crate::matrix::{Matrix, Use, stored};
use crate::numbers;
use crate::scene::warn;
use crate::solve::{KELVIN_MAX, Manner, PairsOf};
use crate::words;
use hemicube::analysis::surfaces::{
    ERROR_TOLD, EnclosureError, HeatBalance, MatrixTables, SurfaceHeat, heat_by_surface, heat_errors, row_errors,
};
use hemicube::analysis::zones::{GroupBy, reason_against};
use hemicube::groups::spread;
use hemicube::solve::{
    Condition, Enclosures, Factors, Heat, HeatSolution, Named, Properties, PropertyError, Reading, Solution,
    SolveOptions, Tables, Temperature, Undetermined, disagreement, enclosures, open_share, question_of_cold,
    solve_heat,
};
use hemicube::store::{PatchTable, RowTable};
use numpy::PyArray1;
use pyo3::exceptions::{PyKeyError, PyRuntimeWarning};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::CString;

/// A temperature: kelvin, or text such as '20 °C'.
pub(crate) fn kelvin(given: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    if let Ok(text) = given.extract::<String>() {
        let read = text.parse::<Temperature>();
        return read
            .map(Temperature::kelvin)
            .map_err(|error| errors::input(format!("`{name}`: {error}")));
    }
    let wrong = |found: &str| {
        errors::input(format!(
            "`{name}` is {found}; a temperature in kelvin, from 0 on, or text such as '20 °C' is needed"
        ))
    };
    match given.extract::<f64>() {
        Ok(kelvin) if (0.0..=KELVIN_MAX).contains(&kelvin) => Ok(kelvin),
        Ok(kelvin) if kelvin.is_nan() => Err(wrong("NaN")),
        Ok(kelvin) => Err(wrong(&kelvin.to_string())),
        Err(_) => Err(wrong(&format!("of the type {}", given.get_type().name()?))),
    }
}

/// Asks whether temperatures, with what they are of, are degrees Celsius.
pub(crate) fn question_cold(py: Python<'_>, cold: &[String]) -> PyResult<()> {
    question_of_cold(cold).map_or(Ok(()), |question| warn(py, &question))
}

/// A temperature in kelvin that may be one in degrees Celsius, with what it is of. 0 is cold space.
pub(crate) fn cold(kelvin: f64, of: &str) -> Option<String> {
    (kelvin > 0.0 && kelvin < Temperature::COLD).then(|| format!("{kelvin} K of {of}"))
}

/// Tells of surroundings at 0 K that nobody asked for, where a scene is open.
pub(crate) fn warn_of_surroundings(py: Python<'_>, matrix: &Matrix) -> PyResult<()> {
    let Some(share) = open_share(&matrix.exchange_table()?, &matrix.area()?) else {
        return Ok(());
    };
    warn(
        py,
        &format!(
            "{:.1} % of the view leaves the scene, and what lies outside is taken to be at 0 K; `ambient` says how \
             warm it is, and `ambient=0` that it is cold space",
            100.0 * share
        ),
    )
}

/// The ground's temperature, and the share of each patch's view that ends on it.
pub(crate) fn ground(
    matrix: &Matrix,
    ground: Option<&Bound<'_, PyAny>>,
    below: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<(f64, Vec<f64>)>> {
    match (ground, below) {
        (None, None) => Ok(None),
        (Some(ground), Some(below)) => {
            let below = numbers::vector(below, "below_horizon", matrix.patch_count())?;
            if let Some(wrong) = below.iter().find(|share| !(0.0..=1.0).contains(*share)) {
                return Err(errors::input(format!(
                    "`below_horizon` has {wrong}; shares of a view are from 0 to 1"
                )));
            }
            Ok(Some((kelvin(ground, "ground")?, below)))
        }
        _ => Err(errors::input(
            "`ground` and `below_horizon` go together: `sky(scene).ground` is the share of each patch's view",
        )),
    }
}

/// An error of properties, with its next step.
pub(crate) fn wrong(error: PropertyError) -> PyErr {
    let step = error
        .step
        .as_ref()
        .map(|step| format!("; {}", words::of_properties(step)));
    errors::input(error.reason + &step.unwrap_or_default())
}

/// Properties of a matrix's patches from a dictionary.
pub(crate) fn properties_of(matrix: &Matrix, table: &PatchTable, given: &Bound<'_, PyAny>) -> PyResult<Properties> {
    let py = given.py();
    let keywords = PyDict::new(py);
    // NumPy's numbers are numbers.
    keywords.set_item("default", py.import("builtins")?.getattr("float")?)?;
    let text: String = py
        .import("json")?
        .call_method("dumps", (given,), Some(&keywords))?
        .extract()?;
    let tables: Tables = serde_json::from_str(&text)
        .map_err(|error| errors::input(format!("`properties` is no dictionary of properties: {error}")))?;
    let [objects, materials] = matrix.group_names();
    let named = Named {
        objects,
        materials,
        object: &table.object,
        material: &table.material,
    };
    let mut tables = tables;
    spread(&mut tables, objects, materials, &matrix.further_names()).map_err(|tie| errors::input(tie.to_string()))?;
    Properties::new(named, None, tables).map_err(wrong)
}

/// Looking for enclosures and solving, once there is a matrix.
struct Solving<'a, 'py> {
    py: Python<'py>,
    heat: &'a Heat,
    escaped: &'a [f64],
    named: Named<'a>,
    rows: &'a RowTable,
    pairs: Option<PairsOf<'a>>,
    options: SolveOptions,
    progress: Option<&'a Bound<'py, PyAny>>,
}

/// A solution, what nothing determines, the enclosures, and by how much the readings of pairs differ, as stored.
type Solved = (HeatSolution, Undetermined, Enclosures, Option<Vec<f64>>);

impl Use<PyResult<Solved>> for Solving<'_, '_> {
    fn with(self, factors: &dyn Factors) -> PyResult<Solved> {
        let (heat, escaped, named, options) = (self.heat, self.escaped, self.named, self.options);
        let (rows, is_as_stored) = (self.rows, self.pairs.is_none());
        let pairs = PairsOf::read(self.pairs, factors, options.threads())?;
        let factors = pairs.as_ref().map_or(factors, |pairs| pairs as &dyn Factors);
        attended(self.py, self.progress, |attendant: Attendant<'_, (u32, f64)>| {
            let found = enclosures(factors).map_err(|error| errors::solving(&error))?;
            let open = heat.require_temperatures(&found, escaped, named);
            let open = open.map_err(|error| errors::solving(&error))?;
            let solved = solve_heat(factors, heat, options, &mut |step| {
                attendant.tell((step.iteration, step.residual))
            });
            let solved = solved.map_err(|error| errors::solving(&error))?;
            let differs = is_as_stored.then(|| {
                let kept: Vec<f64> = (0..heat.area.len()).map(|patch| rows.kept(patch)).collect();
                let black = |(patch, kept): (usize, &f64)| match *kept > 0.0 {
                    true => solved.solution.radiosity.of(patch)[0] / kept,
                    false => 0.0,
                };
                let blacks: Vec<f64> = kept.iter().enumerate().map(black).collect();
                disagreement(factors, &heat.area, &kept, &blacks)
            });
            Ok((solved, open, found, stored(differs.transpose())?))
        })?
    }
}

/// What comes from outside the scene: temperatures in kelvin, and heat that patches take up.
pub(crate) struct Surroundings {
    pub(crate) ambient: f64,
    /// The ground's, and the shares of rows that meet it.
    pub(crate) ground: Option<(f64, Vec<f64>)>,
    /// In W/m², a number a patch.
    pub(crate) load: Option<Vec<f64>>,
}

/// A solved exchange of heat.
pub(crate) struct Found {
    pub(crate) found: HeatSolution,
    /// The irradiance from outside.
    pub(crate) outside: Option<Vec<f64>>,
    /// The rows that were solved with.
    pub(crate) rows: RowTable,
    /// The largest part of its heat that is not known of an enclosure or a body in one.
    pub(crate) energy_error: f64,
}

/// Solves the exchange of heat between surfaces with `given` properties. Temperatures that nothing determines are NaN,
/// and heat of which more than 1 % is not known has a warning.
pub(crate) fn solve(
    py: Python<'_>,
    matrix: &Matrix,
    given: &Bound<'_, PyAny>,
    surroundings: Surroundings,
    manner: Manner<'_, '_>,
) -> PyResult<Found> {
    let table = matrix.patches()?;
    let threads = manner.options.threads();
    let [rows, stored_rows] = matrix.read_table(py, manner.memory / 2, manner.reading, threads)?;
    let properties = properties_of(matrix, &table, given)?;
    let thermal = properties.thermal().map_err(wrong)?;
    let colder = thermal
        .iter()
        .filter(|kind| kind.is_used)
        .filter_map(|kind| match kind.condition {
            Condition::Temperature(given) if !given.is_celsius() => cold(given.kelvin(), &kind.shown()),
            _ => None,
        });
    question_cold(py, &colder.collect::<Vec<_>>())?;
    let heat = Heat::new(&thermal, properties.kind_of_patch(), &table.area, &rows);
    let mut heat = heat.map_err(|error| errors::solving(&error))?;
    let ambient = surroundings.ambient;
    match &surroundings.ground {
        None => heat.surround(&[(ambient, &rows.escaped)]),
        Some((ground, below)) => {
            // Shares of a sky of its own resolution may exceed what escapes by the matrix.
            let below: Vec<f64> = below
                .iter()
                .zip(&rows.escaped)
                .map(|(below, all)| below.min(*all))
                .collect();
            let above: Vec<f64> = rows
                .escaped
                .iter()
                .zip(&below)
                .map(|(all, below)| all - below)
                .collect();
            heat.surround(&[(ambient, &above), (*ground, &below)]);
        }
    }
    if let Some(load) = &surroundings.load {
        heat = heat.with_load(load).map_err(|error| errors::solving(&error))?;
    }
    let [objects, materials] = matrix.group_names();
    let named = Named {
        objects,
        materials,
        object: &table.object,
        material: &table.material,
    };
    let solving = Solving {
        py,
        heat: &heat,
        escaped: &rows.escaped,
        named,
        rows: &rows,
        pairs: PairsOf::of(manner.reading, &table.area, &stored_rows),
        options: manner.options,
        progress: manner.progress,
    };
    let (mut found, open, enclosures, differs) = matrix.lend(py, manner.memory / 2, solving)?;
    if open.patches.contains(&true) {
        let text = format!(
            "nothing determines the temperature of {}: they are adiabatic, and see nothing that has one",
            open.names
        );
        let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
        for (kelvin, _) in found
            .temperature
            .iter_mut()
            .zip(&open.patches)
            .filter(|(_, open)| **open)
        {
            *kelvin = f64::NAN;
        }
    }
    for note in properties.notes() {
        let text = CString::new(note.replace('\0', " ")).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
    }
    let energy_error = energy_error(
        &found,
        &table,
        &rows,
        differs,
        (&enclosures, properties.kind_of_patch()),
    );
    if energy_error > ERROR_TOLD {
        let why = match manner.reading {
            Reading::Pairs => "rows of the matrix do not sum to 1",
            Reading::AsStored => "A[i] F[i, j] is not A[j] F[j, i] in the matrix as it is stored",
        };
        let text = format!(
            "heat of an enclosure, or of a surface in one, is known within {:.1} % only: {why}; `balance` closes it, \
             and a smaller `tolerance` measures it",
            100.0 * energy_error
        );
        warn(py, &text)?;
    }
    Ok(Found {
        found,
        outside: heat.outside,
        rows,
        energy_error,
    })
}

/// The largest part of its heat that is not known of an enclosure or a body in one.
fn energy_error(
    found: &HeatSolution,
    table: &PatchTable,
    rows: &RowTable,
    differs: Option<Vec<f64>>,
    (enclosures, body): (&Enclosures, &[u32]),
) -> f64 {
    let patches = table.len();
    let radiosity = |patch: usize| found.solution.radiosity.of(patch)[0];
    let flux = |patch: usize| radiosity(patch) - rows.kept(patch) * found.solution.irradiance.of(patch)[0];
    let heat: Vec<f64> = (0..patches).map(|patch| table.area[patch] * flux(patch)).collect();
    let sent: Vec<f64> = (0..patches).map(|patch| table.area[patch] * radiosity(patch)).collect();
    let differs = differs.unwrap_or_else(|| vec![0.0; patches]);
    let of_rows = row_errors(rows).into_iter().zip(&heat).zip(differs);
    let error: Vec<f64> = of_rows.map(|((share, heat), differs)| share * heat + differs).collect();
    let residual = found.solution.residuals.iter().copied().fold(0.0, f64::max);
    let errors = heat_errors([&heat, &error, &sent], enclosures, body, residual);
    errors.iter().map(EnclosureError::share).fold(0.0, f64::max)
}

/// Heat by surface of a solution.
pub(crate) fn by_surface(
    matrix: &Matrix,
    solved: &Solution,
    outside: Option<&[f64]>,
    temperature: &[f64],
    by: &str,
) -> PyResult<HeatBySurface> {
    let by = group(by)?;
    if let Some(reason) = reason_against(matrix.patch_kind(), by) {
        return Err(errors::input(format!("the matrix {reason}")));
    }
    if solved.radiosity.patches() != matrix.patch_count() {
        return Err(errors::input(format!(
            "the solution is of {} patches, and the matrix of {}",
            solved.radiosity.patches(),
            matrix.patch_count()
        )));
    }
    let (table, rows) = (matrix.patches()?, matrix.exchange_table()?);
    let of = MatrixTables {
        patches: &table,
        rows: &rows,
        names: matrix.group_names(),
    };
    let (surfaces, balance) = heat_by_surface(of, by, solved, outside, temperature);
    Ok(HeatBySurface { surfaces, balance })
}

/// The grouping of a name.
pub(crate) fn group(by: &str) -> PyResult<GroupBy> {
    match by {
        "object" => Ok(GroupBy::Object),
        "material" => Ok(GroupBy::Material),
        "face" => Ok(GroupBy::Face),
        other => Err(errors::input(format!(
            "`by` is `{other}`; object, material or face is needed"
        ))),
    }
}

/// Heat by surface, a number each, in the order of `names`. `heats["floor"]` is the net heat of a surface in W, and
/// `to_dict()` has all columns, `to_pandas()` a data frame of them.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct HeatBySurface {
    surfaces: Vec<SurfaceHeat>,
    balance: HeatBalance,
}

impl HeatBySurface {
    fn column<'py>(&self, py: Python<'py>, of: impl Fn(&SurfaceHeat) -> f64) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.surfaces.iter().map(of).collect())
    }
}

fn temperature(surface: &SurfaceHeat, at: usize) -> f64 {
    surface.temperature.map_or(f64::NAN, |values| values[at])
}

#[pymethods]
impl HeatBySurface {
    /// Name of each surface: of its object or material, or the number of its face.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.surfaces.iter().map(|surface| surface.name.clone()).collect()
    }

    /// Area of each surface: (k,).
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| surface.area)
    }

    /// Net heat of each surface in W, positive where it gives heat off: (k,).
    #[getter]
    fn heat<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| surface.heat)
    }

    /// Mean net flux of each surface in W/m²: (k,).
    #[getter]
    fn flux<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| surface.flux)
    }

    /// Mean temperature of each surface in kelvin, by area: (k,). NaN where nothing determines it.
    #[getter]
    fn temperature<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| temperature(surface, 0))
    }

    /// Least temperature of a patch of each surface in kelvin: (k,).
    #[getter]
    fn least_temperature<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| temperature(surface, 1))
    }

    /// Greatest temperature of a patch of each surface in kelvin: (k,).
    #[getter]
    fn greatest_temperature<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| temperature(surface, 2))
    }

    /// Mean radiosity of each surface in W/m²: (k,).
    #[getter]
    fn radiosity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| surface.radiosity)
    }

    /// Mean irradiance of each surface in W/m²: (k,).
    #[getter]
    fn irradiance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |surface| surface.irradiance)
    }

    /// The sum of all heat in W: `given_off` + `taken_up` = `surroundings` + `error`.
    #[getter]
    fn balance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, value) in [
            ("given_off", self.balance.given_off),
            ("taken_up", self.balance.taken_up),
            ("surroundings", self.balance.surroundings),
            ("error", self.balance.error),
        ] {
            dict.set_item(name, value)?;
        }
        Ok(dict)
    }

    /// All columns by name.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("name", self.names())?;
        dict.set_item("area", self.areas(py))?;
        dict.set_item("heat", self.heat(py))?;
        dict.set_item("flux", self.flux(py))?;
        dict.set_item("temperature", self.temperature(py))?;
        dict.set_item("least_temperature", self.least_temperature(py))?;
        dict.set_item("greatest_temperature", self.greatest_temperature(py))?;
        dict.set_item("radiosity", self.radiosity(py))?;
        dict.set_item("irradiance", self.irradiance(py))?;
        Ok(dict)
    }

    /// A `pandas.DataFrame` of `to_dict()`, by the surfaces' names. Needs pandas.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let frame = crate::pandas::frame(py, self.to_dict(py)?.as_any(), None, None)?;
        frame.call_method1("set_index", ("name",))
    }

    /// Number of surfaces.
    fn __len__(&self) -> usize {
        self.surfaces.len()
    }

    /// Net heat of a surface in W, by its name.
    fn __getitem__(&self, name: &str) -> PyResult<f64> {
        let found = self.surfaces.iter().find(|surface| surface.name == name);
        let found = found.ok_or_else(|| PyKeyError::new_err(format!("there is no surface `{name}`; `names` has them")));
        Ok(found?.heat)
    }

    fn __repr__(&self) -> String {
        format!(
            "<hemicube.HeatBySurface of {} surfaces, {:.4e} W given off, error {:.1e} W>",
            self.surfaces.len(),
            self.balance.given_off,
            self.balance.error
        )
    }
}
