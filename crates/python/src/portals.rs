//! Mirrors, panes, planes of symmetry, sectors and periods of `hemicube.compute`, `points` and `sky`.

use crate::errors;
use crate::scene::Scene;
use hemicube::driver::glazing::Glazing;
use hemicube::portal::{ImageSettings, Images, Period, Portals, Sector, Specular, Symmetry};
use hemicube::{HierarchyOptions, Model};
use hemicube_scene::{Axis, Budget};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::collections::BTreeMap;

/// Most repeats of a cell on either side of a period.
const REPEATS_MAX: u32 = 1000;

/// The portals asked for.
#[derive(Debug)]
pub(crate) struct Asked<'a, 'py> {
    pub(crate) specular: Option<&'a Bound<'py, PyAny>>,
    pub(crate) specular_bound: Option<f64>,
    pub(crate) symmetry: BTreeMap<String, f64>,
    pub(crate) sector: Option<(String, u32)>,
    pub(crate) periodic: BTreeMap<String, (f64, f64)>,
    pub(crate) repeats: Option<u32>,
    pub(crate) tolerance: Option<f64>,
}

/// The keyword `band`.
#[derive(Clone, Debug, FromPyObject)]
pub(crate) enum AskedBand {
    /// One matrix.
    One(String),
    /// A matrix each.
    Several(Vec<String>),
}

/// Tables of `specular`, and the names of their bands.
type Tables = (Glazing, Vec<String>);

fn wrong(error: &dyn std::fmt::Display) -> PyErr {
    errors::input(format!("`specular`: {error}"))
}

/// The number of a band by its name.
fn band_of(tables: Option<&Tables>, name: &str) -> PyResult<usize> {
    let Some((_, bands)) = tables else {
        return Err(errors::input(format!(
            "`band` is `{name}`, and bands are those of `specular`, which is not given"
        )));
    };
    bands.iter().position(|band| band == name).ok_or_else(|| {
        errors::input(format!(
            "`band` is `{name}`, and `specular` has {}",
            if bands.len() == 1 {
                "one band: leave `band` out".to_owned()
            } else {
                format!("the bands {}", bands.join(", "))
            }
        ))
    })
}

fn axis(what: &str, name: &str) -> PyResult<Axis> {
    match name {
        "x" => Ok(Axis::X),
        "y" => Ok(Axis::Y),
        "z" => Ok(Axis::Z),
        _ => Err(errors::input(format!("`{what}`: `{name}` is no axis: x, y or z is"))),
    }
}

/// A dictionary as JSON.
fn json(given: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = given.py();
    let keywords = PyDict::new(py);
    // NumPy's numbers are numbers.
    keywords.set_item("default", py.import("builtins")?.getattr("float")?)?;
    py.import("json")?
        .call_method("dumps", (given,), Some(&keywords))?
        .extract()
}

impl Asked<'_, '_> {
    fn images(&self) -> PyResult<ImageSettings> {
        let symmetry = self.symmetry.iter().map(|(name, &at)| {
            let axis = axis("symmetry", name)?;
            if at.is_finite() {
                Ok(Symmetry { axis, at })
            } else {
                Err(errors::input(format!("`symmetry`: {at} is not finite")))
            }
        });
        let periods = self.periodic.iter().map(|(name, &(low, high))| {
            let axis = axis("periodic", name)?;
            if low < high && low.is_finite() && high.is_finite() {
                Ok(Period { axis, low, high })
            } else {
                Err(errors::input(format!(
                    "`periodic`: a period ends after its beginning, and {low} is not below {high}"
                )))
            }
        });
        let sector = self.sector.as_ref().map(|(name, count)| {
            let axis = axis("sector", name)?;
            Ok::<_, PyErr>(Sector { axis, count: *count })
        });
        if self.repeats.is_some() && self.periodic.is_empty() {
            return Err(errors::input("`repeats` are those of a period: give `periodic`, too"));
        }
        if self.repeats.is_some_and(|repeats| repeats > REPEATS_MAX) {
            return Err(errors::input(format!("`repeats` is from 0 to {REPEATS_MAX}")));
        }
        Ok(ImageSettings {
            symmetry: symmetry.collect::<PyResult<_>>()?,
            sector: sector.transpose()?,
            periods: periods.collect::<PyResult<_>>()?,
            repeats: self.repeats,
            bound: self.tolerance.unwrap_or(0.01) / 10.0,
            budget: Budget::default(),
        })
    }

    /// The portals of a scene, and the model with images of it, if there are any. Tables of several bands need the
    /// name of one of them.
    pub(crate) fn portals(&self, scene: &Scene, band: Option<&str>) -> PyResult<(Portals, Option<Model>)> {
        let tables = self.tables()?;
        let band = match (&tables, band) {
            (tables, Some(name)) => band_of(tables.as_ref(), name)?,
            (Some((_, bands)), None) if bands.len() > 1 => {
                return Err(errors::input(format!(
                    "`specular` has {} bands, and a matrix is of one: `band='{}'` takes one of them",
                    bands.len(),
                    bands[0]
                )));
            }
            _ => 0,
        };
        let (images, model) = self.with_images(scene)?;
        let specular = self.specular(scene, tables.as_ref(), band)?;
        Ok((Portals { images, specular }, model))
    }

    /// The portals of a scene in each of these bands, and the model with images of it, if there are any.
    pub(crate) fn of_bands(&self, scene: &Scene, names: &[String]) -> PyResult<(Vec<Portals>, Option<Model>)> {
        if names.is_empty() {
            return Err(errors::input("`band` is an empty list; names of bands are needed"));
        }
        if let Some(twice) = (1..names.len()).find(|&at| names[..at].contains(&names[at])) {
            return Err(errors::input(format!("`band` has `{}` twice", names[twice])));
        }
        let tables = self.tables()?;
        let bands = names.iter().map(|name| band_of(tables.as_ref(), name));
        let bands = bands.collect::<PyResult<Vec<usize>>>()?;
        let (images, model) = self.with_images(scene)?;
        let of_band = |band| {
            Ok(Portals {
                images: images.clone(),
                specular: self.specular(scene, tables.as_ref(), band)?,
            })
        };
        let portals = bands.into_iter().map(of_band).collect::<PyResult<_>>()?;
        Ok((portals, model))
    }

    fn with_images(&self, scene: &Scene) -> PyResult<(Option<Images>, Option<Model>)> {
        let settings = self.images()?;
        if settings.is_empty() {
            return Ok((None, None));
        }
        let made = Images::model(settings, &scene.input, &scene.patches, HierarchyOptions::default());
        let (model, images) = made.map_err(|error| errors::input(error.to_string()))?;
        Ok((Some(images), Some(model)))
    }

    fn tables(&self) -> PyResult<Option<Tables>> {
        let Some(given) = self.specular else { return Ok(None) };
        if !given.is_instance_of::<PyDict>() && given.hasattr("__fspath__")? | given.is_instance_of::<PyString>() {
            return Err(errors::input(
                "`specular` is a dictionary of mirrors and panes; `tomllib.load` makes one of a file",
            ));
        }
        let glazing: Glazing = serde_json::from_str(&json(given)?)
            .map_err(|error| errors::input(format!("`specular` is no dictionary of mirrors and panes: {error}")))?;
        let bands = glazing.bands().map_err(|error| wrong(&error))?;
        Ok(Some((glazing, bands)))
    }

    fn specular(&self, scene: &Scene, tables: Option<&Tables>, band: usize) -> PyResult<Option<Specular>> {
        let bound = self.specular_bound;
        if let Some(bound) = bound.filter(|bound| !(0.0..1.0).contains(bound)) {
            return Err(errors::input(format!(
                "`specular_bound` is {bound}; a share from 0 up to 1 is needed"
            )));
        }
        let bound = bound.unwrap_or_else(|| self.tolerance.map_or(1e-4, |tolerance| tolerance / 20.0));
        let Some((glazing, _)) = tables else {
            return match self.specular_bound {
                Some(_) => Err(errors::input(
                    "`specular_bound` ends paths through mirrors and panes: give `specular`, too",
                )),
                None => Ok(None),
            };
        };
        let (input, patches) = (&scene.input, &scene.patches);
        let [materials, objects] = glazing.laws(input, band).map_err(|error| wrong(&error))?;
        let found = Specular::new(input, patches, &materials, &objects, bound);
        found.map(Some).map_err(|error| wrong(&error))
    }
}
