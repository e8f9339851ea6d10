//! `hemicube.points`: rows of sensors.

use crate::attended::attended;
use crate::compute::interrupted;
use crate::heat::kelvin;
use crate::scene::Scene;
use crate::session::BackendChoice;
use crate::sky::{pairs, warn_of_places};
use crate::views::{self, Views, csr, placed, require_as_many, require_items, require_tolerance};
use crate::{compute, errors, numbers, portals};
use glam::DVec3;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::frame::Horizon;
use hemicube::points::{Body, PointOptions, Sensor, SensorRow, Surroundings, first_resolution, rows_of_sensors};
use hemicube::sky::SensorPoint;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// View factors of sensors: a row each, of a cube one for each of its six sides (east, north, west, south, up, down).
#[pyclass(frozen, extends = Views, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Points {
    rows: Vec<SensorRow>,
    scene: Py<Scene>,
}

#[pymethods]
impl Points {
    fn __repr__(&self) -> String {
        format!("<hemicube.Points of {} rows>", self.rows.len())
    }

    /// View factor of the sky of each row: what escapes above the horizon.
    #[getter]
    fn sky<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.rows.iter().map(|row| row.sky).collect())
    }

    /// True for rows that settled within the tolerance, and without one for all.
    #[getter]
    fn settled<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_vec(py, self.rows.iter().map(|row| row.is_settled).collect())
    }

    /// The share of each row that mirrors and panes reflect or let through; 0 without any.
    #[getter]
    fn passed<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.rows.iter().map(SensorRow::handed_on).collect())
    }

    /// Share of each row that is followed no further: after the last portal, or beyond the last repeat; 0 without
    /// portals.
    #[getter]
    fn cut_off<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.rows.iter().map(|row| row.cut_off).collect())
    }

    /// View factors to each patch: a `scipy.sparse.csr_matrix`. Its row sums, `sky`, `ground` and `blocked` add up to
    /// 1; through portals with `cut_off`, less `passed`.
    fn to_scipy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows = (self.rows.iter()).map(|row| row.patches.iter().map(|&(patch, factor)| (patch.0, factor)));
        csr(py, rows, self.scene.get().patches.len())
    }

    /// View factors to each object, or with `by='material'` to each material, in the order of the scene's `objects` or
    /// `materials`: one row a row, one column each.
    #[pyo3(signature = (by="object"))]
    fn zones<'py>(&self, py: Python<'py>, by: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let scene = self.scene.get();
        let (count, of): (usize, fn(&hemicube_scene::Triangle) -> u32) = match by {
            "object" => (scene.input.objects.len(), |triangle| triangle.object),
            "material" => (scene.input.materials.len(), |triangle| triangle.material),
            other => {
                return Err(errors::input(format!(
                    "`by` is `{other}`; object or material is needed"
                )));
            }
        };
        let mut sums = vec![0.0; self.rows.len() * count];
        for (row, sums) in self.rows.iter().zip(sums.chunks_mut(count.max(1))) {
            for &(patch, factor) in &row.patches {
                let zone = of(&scene.input.triangles[scene.patches.triangle(patch)]) as usize;
                if let Some(sum) = sums.get_mut(zone) {
                    *sum += factor;
                }
            }
        }
        PyArray1::from_vec(py, sums).reshape([self.rows.len(), count])
    }

    /// A `pandas.DataFrame` of a line a row: view factors to objects, or with `by='material'` to materials, by their
    /// names, and `(sky)`, `(ground)`, `(blocked)`. Needs pandas.
    #[pyo3(signature = (by="object"))]
    fn to_pandas<'py>(&self, py: Python<'py>, by: &str) -> PyResult<Bound<'py, PyAny>> {
        let zones = self.zones(py, by)?;
        let input = &self.scene.get().input;
        let names: Vec<String> = match by {
            "object" => input.objects.clone(),
            _ => input.materials.iter().map(|material| material.name.clone()).collect(),
        };
        let frame = crate::pandas::frame(py, zones.as_any(), None, Some(&names))?;
        let shares = |row: &SensorRow| [row.sky, row.ground, row.blocked];
        for (place, name) in ["(sky)", "(ground)", "(blocked)"].into_iter().enumerate() {
            let column = self.rows.iter().map(|row| shares(row)[place]).collect();
            frame.set_item(name, PyArray1::from_vec(py, column))?;
        }
        Ok(frame)
    }

    /// Mean radiant temperature of each row in kelvin, by the radiosity of each patch in W/m² (`solve_heat`'s) and the
    /// temperatures of sky, ground and backs in kelvin; the ground's is the sky's where it is not given, and backs are
    /// left out.
    #[pyo3(signature = (radiosity, *, sky, ground=None, backs=None))]
    fn mean_radiant_temperature<'py>(
        &self,
        py: Python<'py>,
        radiosity: &Bound<'_, PyAny>,
        sky: &Bound<'py, PyAny>,
        ground: Option<&Bound<'py, PyAny>>,
        backs: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let radiosity = numbers::vector(radiosity, "radiosity", self.scene.get().patches.len())?;
        let sky = kelvin(sky, "sky")?;
        let given = |given: Option<&Bound<'py, PyAny>>, name: &str| given.map(|given| kelvin(given, name)).transpose();
        let outside = [
            sky,
            given(ground, "ground")?.unwrap_or(sky),
            given(backs, "backs")?.unwrap_or(f64::NAN),
        ];
        let temperature = |row: &SensorRow| row.mean_radiant_temperature(&radiosity, outside);
        Ok(PyArray1::from_vec(py, self.rows.iter().map(temperature).collect()))
    }
}

/// The form of sensors by its name; planes have normals.
fn body(name: Option<&str>, normal: Option<DVec3>) -> PyResult<Body> {
    match (name, normal) {
        (None | Some("plane"), Some(normal)) => Ok(Body::Plane(normal)),
        (None | Some("sphere"), _) => Ok(Body::Sphere),
        (Some("cube"), _) => Ok(Body::Cube),
        (Some("person"), _) => Ok(Body::Person),
        (Some("seated"), facing) => Ok(Body::Seated(facing)),
        (Some("cylinder"), _) => Ok(Body::Cylinder),
        (Some("plane"), None) => Err(errors::input(
            "`body` is `plane`, and a plane needs a direction to look in; give `normals`",
        )),
        (Some(other), _) => Err(errors::input(format!(
            "`body` is `{other}`; plane, sphere, cube, person, seated or cylinder is needed"
        ))),
    }
}

/// View factors of free points to patches, sky and ground: sensors, measurements, people; no row of a patch is
/// computed.
///
/// `positions` are (m, 3), in the scene's coordinates. `body` is 'plane' (with `normals`, (m, 3)), 'sphere', 'cube'
/// (six rows a point), 'person' (standing, six weighted sides), 'seated' (with `normals` facing along them) or
/// 'cylinder' (upright); by default a plane with normals and a sphere without. `up` is needed where the scene does not say. `tolerance` refines each row until it changes by
/// no more than this share. `progress(done, total)` is called with numbers of points some times a second.
///
/// `specular`, `specular_bound`, `symmetry`, `sector`, `periodic` and `repeats` are `compute`'s, and so is `band`, of
/// one: points see through mirrors, panes and images of a cell, and rows are of what arrives. `Points.passed` and `.cut_off` tell of it.
#[pyfunction]
#[pyo3(signature = (
    scene, positions, *, normals=None, body=None, up=None, tolerance=None, resolution=None, backend="cpu",
    backend_dir=None, backend_options=None, engine="auto", threads=0, progress=None, specular=None,
    specular_bound=None, symmetry=BTreeMap::new(), sector=None, periodic=BTreeMap::new(), repeats=None, band=None
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn points(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    positions: &Bound<'_, PyAny>,
    normals: Option<&Bound<'_, PyAny>>,
    body: Option<&str>,
    up: Option<&str>,
    tolerance: Option<f64>,
    resolution: Option<u32>,
    backend: &str,
    backend_dir: Option<PathBuf>,
    backend_options: Option<BTreeMap<String, String>>,
    engine: &str,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
    specular: Option<&Bound<'_, PyAny>>,
    specular_bound: Option<f64>,
    symmetry: BTreeMap<String, f64>,
    sector: Option<(String, u32)>,
    periodic: BTreeMap<String, (f64, f64)>,
    repeats: Option<u32>,
    band: Option<&str>,
) -> PyResult<Py<Points>> {
    let given = scene;
    let scene = scene.get();
    let backend = BackendChoice::new(backend, backend_dir, pairs(backend_options), engine)?;
    require_tolerance(tolerance)?;
    let horizon = Horizon::new(views::up(scene, up)?, 0.0);
    let options = PointOptions {
        render: RenderSettings {
            resolution: compute::resolution(resolution.unwrap_or(first_resolution(tolerance)))?,
            culling: Culling::On,
            covered: false,
        },
        tolerance,
        threads,
        patches: true,
    };
    let asked = portals::Asked {
        specular,
        specular_bound,
        symmetry,
        sector,
        periodic,
        repeats,
        tolerance,
    };
    let (portals, with_images) = asked.portals(scene, band)?;
    let model = with_images.as_ref().unwrap_or(&scene.model);
    let sensors = sensors(positions, normals, body)?;
    let is_outside = |sensor: &Sensor| {
        portals
            .images
            .as_ref()
            .is_some_and(|images| !images.holds(sensor.position))
    };
    if let Some(point) = sensors.iter().position(is_outside) {
        return Err(errors::input(format!("point {point} lies outside the period")));
    }
    let looks: Vec<SensorPoint> = sensors
        .iter()
        .map(|sensor| SensorPoint {
            position: sensor.position,
            normal: match sensor.body {
                Body::Plane(normal) => normal,
                _ => horizon.up,
            },
        })
        .collect();
    warn_of_places(py, scene, &looks, horizon)?;
    let found = attended(py, progress, |attendant| -> PyResult<Option<Vec<SensorRow>>> {
        let mut sessions = Vec::new();
        for _ in options.resolutions() {
            sessions.push(require_items(backend.open()?, "points are computed")?);
        }
        let surroundings = Surroundings {
            horizon,
            portals: Some(&portals),
        };
        rows_of_sensors(
            model,
            &sensors,
            surroundings,
            options,
            sessions,
            &|_, row| row,
            &mut |done| attendant.tell((done, sensors.len())),
        )
        .map_err(|error| errors::compute(&error))
    })??;
    let rows = found.ok_or_else(interrupted)?;
    let shares = Views::new(rows.iter().map(|row| [row.ground, row.blocked, row.change]));
    let scene = given.clone().unbind();
    Py::new(py, (Points { rows, scene }, shares))
}

/// Sensors of arrays.
fn sensors(
    positions: &Bound<'_, PyAny>,
    normals: Option<&Bound<'_, PyAny>>,
    name: Option<&str>,
) -> PyResult<Vec<Sensor>> {
    let positions = numbers::points(positions, "positions")?;
    let normals = normals.map(|normals| numbers::points(normals, "normals")).transpose()?;
    if let Some(normals) = &normals {
        require_as_many(&positions, normals)?;
    }
    let sensor = |(point, position): (usize, &[f64; 3])| {
        let (position, normal) = placed(point, *position, normals.as_ref().map(|normals| normals[point]))?;
        Ok(Sensor {
            position,
            body: body(name, normal)?,
        })
    };
    positions.iter().enumerate().map(sensor).collect()
}
