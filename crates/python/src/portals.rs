//! Mirrors, panes, planes of symmetry, sectors and periods of `hemicube.compute`.

use crate::errors;
use crate::scene::Scene;
use hemicube::driver::glazing::Glazing;
use hemicube::portal::{ImageSettings, Images, Period, Portals, Sector, Specular, Symmetry};
use hemicube::{HierarchyOptions, Model};
use hemicube_scene::Axis;
use pyo3::prelude::*;
use pyo3::types::PyDict;
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
        if self.repeats.is_some_and(|repeats| repeats > REPEATS_MAX) {
            return Err(errors::input(format!("`repeats` is from 0 to {REPEATS_MAX}")));
        }
        Ok(ImageSettings {
            symmetry: symmetry.collect::<PyResult<_>>()?,
            sector: sector.transpose()?,
            periods: periods.collect::<PyResult<_>>()?,
            repeats: self.repeats,
            bound: self.tolerance.unwrap_or(0.01) / 10.0,
        })
    }

    /// The portals of a scene, and the model with images of it, if there are any.
    pub(crate) fn portals(&self, scene: &Scene) -> PyResult<(Portals, Option<Model>)> {
        let settings = self.images()?;
        let (input, patches) = (&scene.input, &scene.patches);
        let (model, images) = if settings.is_empty() {
            (None, None)
        } else {
            let made = Images::model(settings, input, patches, HierarchyOptions::default());
            let (model, images) = made.map_err(|error| errors::input(error.to_string()))?;
            (Some(model), Some(images))
        };
        let bound = self.specular_bound;
        if let Some(bound) = bound.filter(|bound| !(0.0..1.0).contains(bound)) {
            return Err(errors::input(format!(
                "`specular_bound` is {bound}; a share from 0 up to 1 is needed"
            )));
        }
        let bound = bound.unwrap_or_else(|| self.tolerance.map_or(1e-4, |tolerance| tolerance / 20.0));
        let specular = self.specular.map(|given| {
            let glazing: Glazing = serde_json::from_str(&json(given)?)
                .map_err(|error| errors::input(format!("`specular` is no dictionary of mirrors and panes: {error}")))?;
            let wrong = |error: &dyn std::fmt::Display| errors::input(format!("`specular`: {error}"));
            let bands = glazing.bands().map_err(|error| wrong(&error))?;
            if bands.len() > 1 {
                return Err(errors::input(format!(
                    "`specular` has {} bands, and a matrix is of one: give numbers in place of lists",
                    bands.len()
                )));
            }
            let [materials, objects] = glazing.laws(input, 0).map_err(|error| wrong(&error))?;
            Specular::new(input, patches, &materials, &objects, bound).map_err(|error| wrong(&error))
        });
        let specular = specular.transpose()?;
        Ok((Portals { images, specular }, model))
    }
}
