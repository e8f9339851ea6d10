//! Radiosities of a solution, for mean radiant temperatures.

use super::Arguments;
use crate::exit::hinted;
use crate::report::require_matrix;
use anyhow::{Context, Result, anyhow, bail};
use hemicube::points::SensorRow;
use hemicube::solve::StoredSolution;
use hemicube::store::Store;
use std::path::{Path, PathBuf};

/// Name of a solution, where none is given.
const NAME: &str = "thermal";

/// The directory of a matrix and the name of its solution, of `DIR` or `DIR:NAME`.
pub(super) fn parts_of(given: &Path) -> (PathBuf, String) {
    if !given.is_dir()
        && let Some((directory, name)) = given.to_str().and_then(|text| text.rsplit_once(':'))
    {
        return (directory.into(), name.to_owned());
    }
    (given.to_owned(), NAME.to_owned())
}

/// Opens the matrix and the solution.
///
/// # Errors
/// When there is none.
pub(super) fn open(given: &Path) -> Result<(Store, StoredSolution)> {
    let (directory, name) = parts_of(given);
    require_matrix(&directory)?;
    let store = Store::open(&directory)?;
    let solution = StoredSolution::open(&store, &name)?;
    Ok((store, solution))
}

/// Radiosities by patch in W/m², and the temperatures of sky, ground and backs in kelvin.
pub(super) struct Heat {
    radiosity: Vec<f64>,
    outside: [f64; 3],
}

impl Heat {
    pub(super) fn new(arguments: &Arguments, store: &Store, solution: &StoredSolution) -> Result<Self> {
        let report = solution.report();
        if report["quantity"] != "heat" {
            return Err(hinted(
                anyhow!(
                    "the solution in `{}` is of light, and a mean radiant temperature is of heat",
                    store.directory().display()
                ),
                format!("`hemicube solve {} --thermal` makes one", store.directory().display()),
            ));
        }
        let radiosity = solution.quantity("radiosity")?;
        if radiosity.rows() != 1 {
            bail!(
                "the solution in `{}` has {} right-hand sides; one of a single one is needed",
                store.directory().display(),
                radiosity.rows()
            );
        }
        let ambient = report["surfaces"]["heat"]["ambient"].as_f64();
        let of = |given: Option<f64>, what: &str| {
            given.or(ambient).with_context(|| {
                format!("the solution does not say what lay outside; `--{what}-temperature KELVIN` does")
            })
        };
        let sky = of(arguments.sky_temperature, "sky")?;
        let ground = of(arguments.ground_temperature, "ground")?;
        Ok(Self {
            radiosity: radiosity.row(0)?,
            // Backs exchange nothing in `solve`: what a sensor meets there counts as what lay outside.
            outside: [sky, ground, ambient.unwrap_or(ground)],
        })
    }

    /// The mean radiant temperature of a row in kelvin.
    pub(super) fn temperature(&self, row: &SensorRow) -> f64 {
        row.mean_radiant_temperature(&self.radiosity, self.outside)
    }
}
