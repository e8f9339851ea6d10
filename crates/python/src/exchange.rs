//! `hemicube.exchange`: what surfaces exchange, by name.

use crate::errors;
use crate::heat::{group, properties_of, wrong};
use crate::matrix::{Matrix, stored};
use crate::solve::reading;
use hemicube::analysis::exchange::{Exchange as Factors, Network};
use hemicube::solve::enclosures;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::atomic::Ordering;

/// Exchange factors of surfaces, in the order of `names`; the last column of each array is the surroundings. Arrays are
/// (k, k + 1) for one band, (bands, k, k + 1) for several.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Exchange {
    network: Network,
    factors: Factors,
    bands: Vec<String>,
    enclosure: Vec<u32>,
}

impl Exchange {
    fn array<'py>(&self, py: Python<'py>, value: impl Fn(usize, usize, usize) -> f64) -> PyResult<Bound<'py, PyAny>> {
        let (bands, count) = (self.factors.gebhart.len(), self.network.len());
        let mut flat = Vec::with_capacity(bands * count * (count + 1));
        for band in 0..bands {
            for from in 0..count {
                flat.extend((0..=count).map(|to| value(band, from, to)));
            }
        }
        let flat = PyArray1::from_vec(py, flat);
        if bands == 1 {
            let square: Bound<'_, PyArray2<f64>> = flat.reshape([count, count + 1])?;
            return Ok(square.into_any());
        }
        let stack: Bound<'_, PyArray3<f64>> = flat.reshape([bands, count, count + 1])?;
        Ok(stack.into_any())
    }
}

#[pymethods]
impl Exchange {
    /// Name of each surface: of its object or material, or the number of its face or patch.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.network.names.clone()
    }

    /// Names of the bands.
    #[getter]
    fn bands(&self) -> Vec<String> {
        self.bands.clone()
    }

    /// Area of each surface: (k,).
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.network.area)
    }

    /// Share of each surface's view that leaves the scene: (k,).
    #[getter]
    fn escaped<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.network.escaped)
    }

    /// Number of the enclosure of each surface: (k,).
    #[getter]
    fn enclosures<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.enclosure)
    }

    /// Gebhart factors: the part of a row's emission that a column absorbs.
    #[getter]
    fn gebhart<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, |band, from, to| self.factors.gebhart(band, from, to))
    }

    /// Total exchange areas A_i F_ij of script F, in the square of the scene's unit.
    #[getter]
    fn exchange_areas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, |band, from, to| self.factors.area(&self.network, band, from, to))
    }

    /// Radiative conductances σ A_i F_ij in W/K⁴, for heat σ A_i F_ij (T_i⁴ − T_j⁴).
    #[getter]
    fn conductances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, |band, from, to| {
            self.factors.conductance(&self.network, band, from, to)
        })
    }

    /// Surfaces that see each other, and their exchange area A_i F_ij: (i, j, area), i ≤ j. 1 / area is the resistance
    /// between their radiosities.
    fn resistors(&self) -> PyResult<Vec<(u32, u32, f64)>> {
        self.network.pairs().map_err(|error| errors::solving(&error))
    }

    /// Number of surfaces.
    /// A `pandas.DataFrame` from surfaces to surfaces and `(surroundings)`, by their names: of `what`, 'gebhart',
    /// 'exchange_areas' or 'conductances', and of a `band` where there are several. Needs pandas.
    #[pyo3(signature = (what="gebhart", *, band=None))]
    fn to_pandas<'py>(&self, py: Python<'py>, what: &str, band: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
        let data = match what {
            "gebhart" => self.gebhart(py)?,
            "exchange_areas" => self.exchange_areas(py)?,
            "conductances" => self.conductances(py)?,
            other => {
                return Err(errors::input(format!(
                    "`what` is `{other}`; gebhart, exchange_areas or conductances is needed"
                )));
            }
        };
        let place = match band {
            Some(name) => self.bands.iter().position(|band| band == name),
            None => (self.factors.gebhart.len() == 1).then_some(0),
        };
        let Some(place) = place else {
            return Err(errors::input(format!(
                "`band` is needed, one of {}",
                self.bands.join(", ")
            )));
        };
        let data = if self.factors.gebhart.len() == 1 {
            data
        } else {
            data.get_item(place)?
        };
        let mut columns = self.names();
        columns.push("(surroundings)".to_owned());
        crate::pandas::frame(py, &data, Some(&self.names()), Some(&columns))
    }

    fn __len__(&self) -> usize {
        self.network.len()
    }

    fn __repr__(&self) -> String {
        let conservation = (0..self.factors.gebhart.len()).map(|band| self.factors.conservation(band));
        format!(
            "<hemicube.Exchange of {} surfaces, rows add up to 1 within {:.1e}>",
            self.network.len(),
            conservation.fold(0.0, f64::max)
        )
    }
}

/// Gebhart factors, total exchange areas and conductances between the surfaces of a matrix: the program's `exchange`.
///
/// `properties` are those of `solve_heat`; `emissivity` is a number, or one for each of its `bands`. `by` is 'object',
/// 'material', 'face' or 'patch'. A_i F_ij is one number for both directions, of both rows; `as_stored` takes each row as
/// it is.
#[pyfunction]
#[pyo3(signature = (matrix, properties, *, by="object", threads=0, as_stored=false))]
pub(crate) fn exchange(
    py: Python<'_>,
    matrix: &Bound<'_, Matrix>,
    properties: &Bound<'_, PyAny>,
    by: &str,
    threads: usize,
    as_stored: bool,
) -> PyResult<Exchange> {
    let matrix = matrix.get();
    let table = matrix.patches()?;
    let properties = properties_of(matrix, &table, properties)?;
    let by = match by {
        "patch" => None,
        name => Some(group(name)?),
    };
    matrix.with_store(py, None, |store, cancel| {
        let failed = |error| errors::solving(&error);
        let network = Network::new(store, by, reading(as_stored)).map_err(failed)?;
        let kinds = properties.emissivities().map_err(wrong)?;
        let of_patch = |patch: usize| kinds[properties.kind_of_patch()[patch] as usize].clone();
        let values = network.of_surfaces(of_patch).map_err(|name| {
            errors::input(format!(
                "the patches of `{name}` have several emissivities, and a surface has one; take smaller surfaces"
            ))
        })?;
        let bands = values.first().map_or(1, Vec::len);
        let emissivity: Vec<Vec<f64>> = (0..bands)
            .map(|band| values.iter().map(|values| values[band]).collect())
            .collect();
        let go_on = &mut |_, _| !cancel.load(Ordering::Relaxed);
        let factors = Factors::new(&network, &emissivity, threads, go_on).map_err(failed)?;
        let enclosure = enclosures(&network.factors).map_err(failed)?.of_patch().to_vec();
        stored(store.require_complete())?;
        Ok(Exchange {
            bands: if bands == 1 {
                vec!["total".to_owned()]
            } else {
                properties.bands().to_vec()
            },
            network,
            factors,
            enclosure,
        })
    })
}
