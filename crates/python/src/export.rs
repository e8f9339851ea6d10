//! Files for other programs, by the table of formats of `hemicube_export`, and form factors between zones.

use crate::errors;
use crate::matrix::{Matrix, stored};
use crate::numbers;
use crate::pandas;
use crate::scene::Scene;
use crate::words;
use hemicube::Grouping;
use hemicube::analysis::zones::{GroupBy, Zone, zones};
use hemicube::solve::StoredSolution;
use hemicube::store::{Store, scene_hash};
use hemicube_export::{
    Colors, ExportFormat, ExportOptions, Grouping as RowsBy, PatchFormat, PatchResults, SolverFormat, SolverOptions,
    WriteOptions, export as export_matrix, export_for, write_patches,
};
use hemicube_scene::Axis;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Results of the patches, by name.
type Named = Vec<(String, Vec<f64>)>;

/// The keywords of `Matrix.export`.
pub(crate) struct Asked<'a> {
    pub(crate) patches: bool,
    pub(crate) scene: Option<&'a Scene>,
    pub(crate) values: Option<Named>,
    pub(crate) show: Option<String>,
    pub(crate) up: Option<Axis>,
    pub(crate) overwrite: bool,
}

/// The results of a dictionary.
pub(crate) fn values(given: &Bound<'_, PyDict>, patches: usize) -> PyResult<Named> {
    let read = |(name, array): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let name: String = name.extract()?;
        let numbers = numbers::vector(&array, &format!("values[\"{name}\"]"), patches)?;
        Ok((name, numbers))
    };
    given.iter().map(read).collect()
}

fn failed(error: &hemicube_export::Error) -> PyErr {
    match error {
        hemicube_export::Error::Store(error) => errors::store(error),
        hemicube_export::Error::Unfit { next, .. } => errors::input(format!("{error}; {}", words::of_export(next))),
        error => errors::input(error.to_string()),
    }
}

/// Writes a matrix, or its patches, in the format of the path's extension. Returns the file's size.
pub(crate) fn export(py: Python<'_>, matrix: &Matrix, path: &Path, asked: Asked<'_>) -> PyResult<u64> {
    let beside = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let beside = Some(beside.unwrap_or(Path::new(".")));
    let of_matrix = ExportFormat::of(path);
    let format = match PatchFormat::of(path) {
        Ok(format) if asked.patches || of_matrix.is_err() => format,
        _ => {
            let format = of_matrix.map_err(|error| {
                let of_patches = PatchFormat::of(path)
                    .err()
                    .map(|error| format!(", or, of patches: {error}"));
                errors::input(format!("{error}{}", of_patches.unwrap_or_default()))
            })?;
            asked.require_matrix(path)?;
            let overwrite = asked.overwrite;
            return matrix.with_store(py, beside, |store, cancel| {
                let options = ExportOptions {
                    overwrite,
                    allow_incomplete: false,
                    cancel: Some(cancel),
                };
                let report = export_matrix(store, path, format, options).map_err(|error| failed(&error))?;
                Ok(report.bytes)
            });
        }
    };
    if format.needs_corners() && asked.scene.is_none() {
        return Err(errors::input(format!(
            "`{}` needs the corners of the patches, which the matrix does not keep; `scene=` has them",
            path.display()
        )));
    }
    matrix.with_store(py, beside, |store, cancel| asked.write(store, path, format, cancel))
}

/// The keywords of `Matrix.export` that are for solvers.
pub(crate) struct ForSolver<'a> {
    pub(crate) by: Option<&'a str>,
    pub(crate) order: Option<Vec<String>>,
    pub(crate) zone: Option<&'a str>,
    pub(crate) program_version: Option<&'a str>,
}

impl ForSolver<'_> {
    /// Refuses them without a solver.
    pub(crate) fn require_none(&self) -> PyResult<()> {
        let given = [
            ("by", self.by.is_some()),
            ("order", self.order.is_some()),
            ("zone", self.zone.is_some()),
            ("program_version", self.program_version.is_some()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((name, _)) => Err(errors::input(format!(
                "`{name}` has no meaning without a solver; `format=` names one"
            ))),
        }
    }

    /// Grouping of the file's rows.
    fn rows(&self) -> PyResult<Option<RowsBy>> {
        Ok(match self.by {
            None => None,
            Some("patch") => Some(RowsBy::Patch),
            Some("face") => Some(RowsBy::By(GroupBy::Face)),
            Some("object") => Some(RowsBy::By(GroupBy::Object)),
            Some("material") => Some(RowsBy::By(GroupBy::Material)),
            Some(other) => {
                return Err(errors::input(format!(
                    "`by` is `{other}`; patch, face, object or material is needed"
                )));
            }
        })
    }
}

/// Writes a matrix in a solver's files. Returns their size together.
pub(crate) fn export_for_solver(
    py: Python<'_>,
    matrix: &Matrix,
    path: &Path,
    solver: &str,
    given: &ForSolver<'_>,
    asked: &Asked<'_>,
) -> PyResult<u64> {
    let Some(format) = SolverFormat::named_as(solver) else {
        let names: Vec<&str> = SolverFormat::ALL.iter().map(|format| format.label()).collect();
        return Err(errors::input(format!(
            "`format` is `{solver}`; one of {} is needed",
            names.join(", ")
        )));
    };
    asked.require_matrix(path)?;
    for (name, is_given, wanted) in [
        ("zone", given.zone.is_some(), format == SolverFormat::EnergyPlus),
        (
            "program_version",
            given.program_version.is_some(),
            matches!(format, SolverFormat::EnergyPlus | SolverFormat::Calculix),
        ),
    ] {
        if is_given && !wanted {
            return Err(errors::input(format!(
                "`{name}` has no meaning for {}",
                format.program()
            )));
        }
    }
    let (rows, overwrite) = (given.rows()?, asked.overwrite);
    let beside = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    matrix.with_store(py, Some(beside.unwrap_or(Path::new("."))), |store, cancel| {
        let options = SolverOptions {
            grouping: rows,
            order: given.order.as_deref(),
            zone: given.zone,
            version: given.program_version,
            write: WriteOptions { overwrite, cancel },
        };
        let report = export_for(store, path, format, &options).map_err(|error| failed(&error))?;
        Ok(report.files.iter().map(|file| file.bytes).sum())
    })
}

impl Asked<'_> {
    /// Refuses keywords that are of patches.
    fn require_matrix(&self, path: &Path) -> PyResult<()> {
        let given = [
            ("patches", self.patches),
            ("scene", self.scene.is_some()),
            ("values", self.values.is_some()),
            ("show", self.show.is_some()),
            ("up", self.up.is_some()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((name, _)) => Err(errors::input(format!(
                "`{name}` has no meaning for `{}`, a format of the matrix; formats of patches are {}",
                path.display(),
                hemicube_export::listed(PatchFormat::ALL.iter().map(|format| format.named()), "`").join(", ")
            ))),
        }
    }

    /// Writes what is known of the patches.
    fn write(self, store: &Store, path: &Path, format: PatchFormat, cancel: &AtomicBool) -> PyResult<u64> {
        stored(store.require_complete())?;
        let names = StoredSolution::names(store);
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut results = PatchResults::read(store, &names).map_err(|error| failed(&error))?;
        let last = self.values.as_ref().and_then(|values| Some(values.last()?.0.clone()));
        for (name, values) in self.values.unwrap_or_default() {
            if results.column(&name).is_some() {
                return Err(errors::input(format!(
                    "`values` has `{name}`, which the matrix has too; another name is needed"
                )));
            }
            results.push(&name, values).map_err(|error| failed(&error))?;
        }
        if let Some(scene) = self.scene {
            if scene_hash(&scene.input, &scene.patches) != store.manifest().scene.blake3 {
                return Err(errors::input(format!(
                    "`scene` is another than the matrix's, which is of `{}` with {} patches",
                    store.manifest().scene.file,
                    store.patch_count()
                )));
            }
            let grouping = stored(Grouping::of_store(store, &scene.input, &scene.patches))?;
            if let Some(grouping) = grouping {
                results.spread(&grouping).map_err(|error| failed(&error))?;
            }
            let up = match self.up {
                Some(up) => up,
                None if format.is_upright() => known_up(&scene.input)?,
                None => Axis::Z,
            };
            results.place(&scene.patches, up).map_err(|error| failed(&error))?;
        }
        if format.has_colors() {
            let shown = self.show.or(last).unwrap_or_else(|| "seen".to_owned());
            let Some(values) = results.numbers(&shown) else {
                return Err(errors::input(format!(
                    "`show` is `{shown}`; one of {} is needed",
                    results.labels().join(", ")
                )));
            };
            results.colors = Some(Colors::on_scale(&shown, &values, None));
        } else if let Some(shown) = self.show {
            return Err(errors::input(format!(
                "`show` is `{shown}`, and `{}` has no colours",
                path.display()
            )));
        }
        let options = WriteOptions {
            overwrite: self.overwrite,
            cancel,
        };
        write_patches(&results, path, format, options).map_err(|error| failed(&error))
    }
}

/// The axis that points up in a scene, by the program's rule.
fn known_up(scene: &hemicube_scene::Scene) -> PyResult<Axis> {
    let found = hemicube_scene::up::up(scene);
    found.known().ok_or_else(|| {
        let reason = &found.reason;
        errors::input(format!(
            "`up` is needed: the scene does not say which axis points up ({reason})"
        ))
    })
}

/// Zones of a matrix: patches added up by object, material or face. `zones["floor", "ceiling"]` is the form factor from
/// the floor to the ceiling, `factors` all of them.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Zones {
    zones: Vec<Zone>,
}

impl Zones {
    pub(crate) fn of(py: Python<'_>, matrix: &Matrix, by: &str) -> PyResult<Self> {
        let by = match by {
            "object" => GroupBy::Object,
            "material" => GroupBy::Material,
            "face" => GroupBy::Face,
            other => {
                return Err(errors::input(format!(
                    "`by` is `{other}`; object, material or face is needed"
                )));
            }
        };
        let zones = matrix.with_store(py, None, |store, _| stored(zones(store, by)))?;
        Ok(Self { zones })
    }

    fn column<'py>(&self, py: Python<'py>, of: impl Fn(&Zone) -> f64) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.zones.iter().map(of).collect())
    }

    /// The place of a zone by its name.
    fn place(&self, name: &str) -> PyResult<usize> {
        let place = self.zones.iter().position(|zone| zone.name == name);
        place.ok_or_else(|| PyKeyError::new_err(format!("there is no zone `{name}`; `names` has them")))
    }
}

#[pymethods]
impl Zones {
    /// Name of each zone: of its object or material, or the number of its face.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.zones.iter().map(|zone| zone.name.clone()).collect()
    }

    /// Area of each zone: (k,).
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |zone| zone.area)
    }

    /// Number of patches of each zone: (k,).
    #[getter]
    fn patches<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_vec(py, self.zones.iter().map(|zone| zone.patches).collect())
    }

    /// Share of each zone's view that leaves the scene: (k,).
    #[getter]
    fn escaped<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |zone| zone.escaped)
    }

    /// Share of each zone's view that ends on backs of one-sided patches: (k,).
    #[getter]
    fn blocked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |zone| zone.blocked)
    }

    /// Share of each zone's view that ends on patches without a column: (k,).
    #[getter]
    fn unselected<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |zone| zone.unselected)
    }

    /// The form factors, from rows to columns: (k, k), in the order of `names`; NaN in a row that was not computed.
    #[getter]
    fn factors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let count = self.zones.len();
        let mut flat = vec![0.0; count * count];
        for (row, zone) in flat.chunks_exact_mut(count.max(1)).zip(&self.zones) {
            if !zone.has_rows() {
                row.fill(f64::NAN);
            }
            for &(to, factor) in &zone.factors {
                row[to as usize] = factor;
            }
        }
        PyArray1::from_vec(py, flat).reshape([count, count])
    }

    /// A `pandas.DataFrame` of the form factors, from rows to columns, by the zones' names. Needs pandas.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let names = self.names();
        pandas::frame(py, self.factors(py)?.as_any(), Some(&names), Some(&names))
    }

    /// Number of zones.
    fn __len__(&self) -> usize {
        self.zones.len()
    }

    /// The form factor from the first zone to the second, by their names.
    fn __getitem__(&self, key: (String, String)) -> PyResult<f64> {
        let (from, to) = (self.place(&key.0)?, self.place(&key.1)?);
        Ok(self.zones[from].factor_to(u32::try_from(to).unwrap_or(u32::MAX)))
    }

    fn __repr__(&self) -> String {
        let names: Vec<String> = self
            .zones
            .iter()
            .take(5)
            .map(|zone| format!("{:?}", zone.name))
            .collect();
        let more = if self.zones.len() > 5 { ", …" } else { "" };
        format!(
            "<hemicube.Zones: {} zones, {}{more}>",
            self.zones.len(),
            names.join(", ")
        )
    }
}
