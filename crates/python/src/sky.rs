//! `hemicube.sky`: views of the sky from patches and points.

use crate::attended::{Attendant, attended};
use crate::compute::interrupted;
use crate::scene::{Scene, warn};
use crate::session::BackendChoice;
use crate::views::{self, Views, csr, placed, require_as_many, require_items, require_tolerance};
use crate::{compute, errors, numbers, portals};
use glam::DVec3;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::diagnose::{Place, places};
use hemicube::portal::{Portals, Specular};
use hemicube::sky::{
    Glazed, Horizon, LEVELS, PARTS_MAX, PointRow, SUN_ERROR, SensorPoint, SkyDivision, SkyOptions, SkyRow,
    rows_of_points, sky_of_patches, sky_through_portals, sunlight,
};
use hemicube::{InputPatch, Model};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The patches visible from a point, and their weights.
type Seen = Vec<(InputPatch, u64)>;

/// Views of the sky and of the ground below the horizon, from patches or points.
#[pyclass(frozen, extends = Views, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Sky {
    division: SkyDivision,
    rows: Vec<SkyRow>,
    /// Views of patches from points, and the number of patches.
    seen: Option<(Vec<Seen>, usize)>,
    /// Irradiance of each row from each sun, and the number of suns.
    sunlight: Option<(Vec<f32>, usize)>,
}

fn share(weight: u64, row: &SkyRow) -> f64 {
    if row.hemicubes == 0 {
        return f64::NAN;
    }
    weight as f64 / row.whole() as f64
}

impl Sky {
    /// The object of rows, with what both kinds of rows have in its base.
    fn object(
        py: Python<'_>,
        division: SkyDivision,
        rows: Vec<SkyRow>,
        seen: Option<(Vec<Seen>, usize)>,
        sunlight: Option<(Vec<f32>, usize)>,
    ) -> PyResult<Py<Self>> {
        let shares = Views::new(rows.iter().map(|row| {
            let first = row.columns.first().filter(|(column, _)| *column == 0);
            let ground = share(first.map_or(0, |(_, weight)| *weight), row);
            [ground, share(row.blocked, row), row.change]
        }));
        let sky = Self {
            division,
            rows,
            seen,
            sunlight,
        };
        Py::new(py, (sky, shares))
    }
}

#[pymethods]
impl Sky {
    fn __repr__(&self) -> String {
        format!(
            "<hemicube.Sky of {} rows, {} patches of the sky>",
            self.rows.len(),
            self.division.columns() - 1
        )
    }

    /// Sky view factor of each row: the share of the hemisphere, weighted by the cosine, that is sky.
    #[getter]
    fn view_factors<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.rows.iter().map(SkyRow::sky_view_factor).collect())
    }

    /// Irradiance of each row from each of `suns`, of 1 on a plane across its beam: (n, suns), 0 for suns below the
    /// horizon. Direct, through panes, and off up to three mirrors. None without suns.
    #[getter]
    fn sunlight<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let Some((light, suns)) = &self.sunlight else {
            return Ok(None);
        };
        let rows = self.rows.len();
        PyArray1::from_slice(py, light).reshape([rows, *suns]).map(Some)
    }

    /// Solid angle of each column in steradians; the first is the ground.
    #[getter]
    fn solid_angles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let columns = 0..self.division.columns();
        PyArray1::from_vec(py, columns.map(|column| self.division.solid_angle(column)).collect())
    }

    /// Fractions of each row to the ground (column 0) and to each patch of the sky, in the order of Radiance's
    /// `gendaymtx`: a `scipy.sparse.csr_matrix`.
    fn to_scipy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows = self.rows.iter().map(|row| {
            let columns = row.columns.iter();
            columns.map(|&(column, weight)| (column, weight as f64 / row.whole() as f64))
        });
        csr(py, rows, self.division.columns() as usize)
    }

    /// Fractions of points' views on patches of the scene: a `scipy.sparse.csr_matrix`; None for rows of patches, whose
    /// matrix is `compute`'s.
    fn patches_to_scipy<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some((seen, patches)) = &self.seen else {
            return Ok(None);
        };
        let rows = seen.iter().map(|row| {
            row.iter()
                .map(|&(patch, weight)| (patch.0, weight as f64 / f64::from(WHOLE)))
        });
        csr(py, rows, *patches).map(Some)
    }
}

/// Settings of both kinds of rows.
#[derive(Debug)]
struct Request {
    division: SkyDivision,
    horizon: Horizon,
    options: SkyOptions,
    backend: BackendChoice,
}

impl Request {
    #[allow(clippy::too_many_arguments, reason = "keywords")]
    fn new(
        scene: &Scene,
        division: &str,
        up: Option<&str>,
        north: f64,
        tolerance: Option<f64>,
        resolution: u32,
        samples: u32,
        rotation: bool,
        threads: usize,
        backend: BackendChoice,
    ) -> PyResult<Self> {
        let parts = match division.split_once(':') {
            None if division == "tregenza" => Some(1),
            Some(("reinhart", parts)) => parts.parse().ok(),
            _ => None,
        };
        let division = parts.and_then(SkyDivision::new).ok_or_else(|| {
            errors::input(format!(
                "`division` is `{division}`; tregenza, or reinhart:1 to reinhart:{PARTS_MAX}, is needed"
            ))
        })?;
        let up = views::up(scene, up)?;
        require_tolerance(tolerance)?;
        if tolerance.is_some() && samples != 1 {
            return Err(errors::input(
                "`tolerance` chooses how many hemicubes there are; `samples` is for runs without",
            ));
        }
        if !north.is_finite() {
            return Err(errors::input(format!(
                "`north` is {north}; an angle in degrees is needed"
            )));
        }
        Ok(Self {
            division,
            horizon: Horizon::new(up, north),
            options: SkyOptions {
                render: RenderSettings {
                    resolution: compute::resolution(resolution)?,
                    culling: Culling::On,
                    covered: false,
                },
                samples_per_edge: compute::samples_per_edge(samples)?,
                tolerance,
                rotate: rotation,
                threads,
            },
            backend,
        })
    }

    fn open(&self) -> PyResult<Box<dyn HemicubeBackend>> {
        require_items(self.backend.open()?, "the sky is read")
    }
}

pub(crate) fn pairs(options: Option<BTreeMap<String, String>>) -> Vec<(String, String)> {
    options.unwrap_or_default().into_iter().collect()
}

/// Views of the sky from each patch of a scene: sky view factors, and their division over patches of the sky.
///
/// `division` is 'tregenza' (145 patches) or 'reinhart:N' (144 N² + 1). `up` is needed where the scene does not say;
/// `north` turns it clockwise, in degrees, from +y with z up, −z with y up. `tolerance` refines each row until its sky
/// view factor changes by no more than this share; without it a patch gets `samples` hemicubes of `resolution` pixels
/// an edge. `progress(done, total)` is called with numbers of rows some times a second.
///
/// `specular`, `specular_bound`, `symmetry`, `sector`, `periodic`, `repeats` and `band` (of one) are `compute`'s: the
/// sky is seen through panes, in mirrors, and past the images of a cell. `specular` has no `tolerance`: more `samples`
/// or a larger `resolution` refine it.
///
/// `suns` are directions towards suns, (m, 3): `Sky.sunlight` has what each patch receives of them.
#[pyfunction]
#[pyo3(signature = (
    scene, *, division="tregenza", up=None, north=0.0, tolerance=None, resolution=256, samples=1, rotation=true,
    backend="cpu", backend_dir=None, backend_options=None, engine="auto", threads=0, progress=None, suns=None,
    specular=None, specular_bound=None, symmetry=BTreeMap::new(), sector=None, periodic=BTreeMap::new(), repeats=None,
    band=None
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn sky(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    division: &str,
    up: Option<&str>,
    north: f64,
    tolerance: Option<f64>,
    resolution: u32,
    samples: u32,
    rotation: bool,
    backend: &str,
    backend_dir: Option<PathBuf>,
    backend_options: Option<BTreeMap<String, String>>,
    engine: &str,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
    suns: Option<&Bound<'_, PyAny>>,
    specular: Option<&Bound<'_, PyAny>>,
    specular_bound: Option<f64>,
    symmetry: BTreeMap<String, f64>,
    sector: Option<(String, u32)>,
    periodic: BTreeMap<String, (f64, f64)>,
    repeats: Option<u32>,
    band: Option<&str>,
) -> PyResult<Py<Sky>> {
    let scene = scene.get();
    if specular.is_some() && tolerance.is_some() {
        return Err(errors::input(
            "`tolerance` refines what is seen directly; with `specular`, give `samples` or `resolution` in its place",
        ));
    }
    let backend = BackendChoice::new(backend, backend_dir, pairs(backend_options), engine)?;
    let request = Request::new(
        scene, division, up, north, tolerance, resolution, samples, rotation, threads, backend,
    )?;
    let suns = suns.map(directions).transpose()?;
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
    let task = Task {
        scene,
        model: with_images.as_ref().unwrap_or(&scene.model),
        request: &request,
        portals: &portals,
    };
    let found = attended(py, progress, |attendant| task.run(suns.as_deref(), &attendant))??;
    let (rows, light) = found.ok_or_else(interrupted)?;
    let light = light.map(|light| (light, suns.map_or(0, |suns| suns.len())));
    Sky::object(py, request.division, rows, None, light)
}

/// Directions towards suns, of length 1.
fn directions(given: &Bound<'_, PyAny>) -> PyResult<Vec<DVec3>> {
    let suns = numbers::points(given, "suns")?.into_iter().enumerate();
    let direction = |(sun, towards): (usize, [f64; 3])| {
        DVec3::from_array(towards).try_normalize().ok_or_else(|| {
            errors::input(format!(
                "sun {sun} of `suns` is {towards:?}, which points nowhere; a direction towards it is needed"
            ))
        })
    };
    suns.map(direction).collect()
}

/// Rows of patches, and the light of suns, if there are any.
type Found = (Vec<SkyRow>, Option<Vec<f32>>);

/// Rows of patches, and suns, through portals.
struct Task<'a> {
    scene: &'a Scene,
    /// With images.
    model: &'a Model,
    request: &'a Request,
    portals: &'a Portals,
}

impl Task<'_> {
    /// Rows, and the light of suns; `None` where interrupted.
    fn run(&self, suns: Option<&[DVec3]>, attendant: &Attendant<'_, (usize, usize)>) -> PyResult<Option<Found>> {
        let Self { scene, request, .. } = *self;
        let per_edge = request.options.samples_per_edge;
        let rows: Vec<(InputPatch, u32)> = scene.patches.iter().map(|patch| (patch, per_edge)).collect();
        let none = Specular::none(&scene.patches);
        let glazed = Glazed {
            division: &request.division,
            horizon: request.horizon,
            specular: self.portals.specular.as_ref().unwrap_or(&none),
            images: self.portals.images.as_ref(),
        };
        let backend = request.open()?;
        let mut tell = |done| attendant.tell((done, rows.len()));
        let found = if self.portals.specular.is_some() {
            sky_through_portals(self.model, &rows, glazed, request.options, backend, &mut tell)
        } else {
            let (division, horizon) = (&request.division, request.horizon);
            sky_of_patches(
                self.model,
                &rows,
                division,
                horizon,
                request.options,
                backend,
                &mut tell,
            )
        };
        let Some(found) = found.map_err(|error| errors::compute(&error))? else {
            return Ok(None);
        };
        let Some(suns) = suns else {
            return Ok(Some((found, None)));
        };
        let patches: Vec<InputPatch> = scene.patches.iter().collect();
        let mut light = Vec::with_capacity(patches.len() * suns.len());
        // A few at a time, so that it can be interrupted; each time costs a look at all patches.
        let at_once = (RAYS_AT_ONCE / suns.len().max(1)).max(patches.len() / 64).max(1);
        for patches in patches.chunks(at_once) {
            if !attendant.tell((rows.len(), rows.len())) {
                return Ok(None);
            }
            let threads = request.options.threads;
            let error = request.options.tolerance.unwrap_or(SUN_ERROR);
            light.extend(sunlight(self.model, patches, suns, glazed, error, threads));
        }
        Ok(Some((found, Some(light))))
    }
}

/// Pairs of patch and sun between two looks for an interrupt.
const RAYS_AT_ONCE: usize = 1 << 16;

/// Warns of points that are not in the open, by their numbers.
pub(crate) fn warn_of_places(py: Python<'_>, scene: &Scene, points: &[SensorPoint], horizon: Horizon) -> PyResult<()> {
    const SHOWN: usize = 5;
    let found = py.detach(|| places(&scene.model, points, horizon.up));
    for (place, what) in [
        (
            Place::InSolid,
            "in solids, surrounded by backs of one-sided surfaces; move them out",
        ),
        (
            Place::BelowGround,
            "below the ground, with its back above them; raise them, and look whether `up` is right",
        ),
        (
            Place::BehindSheet,
            "behind surfaces, with backs in more than half of their view; turn their normals, or make sheets \
             `two_sided`",
        ),
        (
            Place::FarOff,
            "more than ten times the scene's size away from it; give them in its unit and from its origin",
        ),
    ] {
        let there: Vec<usize> = (0..)
            .zip(&found)
            .filter(|(_, found)| **found == place)
            .map(|(at, _)| at)
            .collect();
        if !there.is_empty() {
            let shown: Vec<String> = there.iter().take(SHOWN).map(usize::to_string).collect();
            let more = if there.len() > SHOWN { ", …" } else { "" };
            let (count, all) = (there.len(), points.len());
            warn(
                py,
                &format!(
                    "{count} of {all} points (numbers {}{more}, from 0) lie {what}",
                    shown.join(", ")
                ),
            )?;
        }
    }
    Ok(())
}

/// Views of the sky from free points: measurements, people, points of a façade. `positions` and `normals` are (m, 3),
/// in the scene's coordinates. Otherwise as `sky`, without portals (`points` goes through them); points are refined by
/// hemicubes of twice the resolution.
#[pyfunction]
#[pyo3(signature = (
    scene, positions, normals, *, division="tregenza", up=None, north=0.0, tolerance=None, resolution=256,
    rotation=true, backend="cpu", backend_dir=None, backend_options=None, engine="auto", threads=0, progress=None
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn sky_of_points(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    positions: &Bound<'_, PyAny>,
    normals: &Bound<'_, PyAny>,
    division: &str,
    up: Option<&str>,
    north: f64,
    tolerance: Option<f64>,
    resolution: u32,
    rotation: bool,
    backend: &str,
    backend_dir: Option<PathBuf>,
    backend_options: Option<BTreeMap<String, String>>,
    engine: &str,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<Sky>> {
    let scene = scene.get();
    let backend = BackendChoice::new(backend, backend_dir, pairs(backend_options), engine)?;
    let request = Request::new(
        scene, division, up, north, tolerance, resolution, 1, rotation, threads, backend,
    )?;
    let positions = numbers::points(positions, "positions")?;
    let normals = numbers::points(normals, "normals")?;
    require_as_many(&positions, &normals)?;
    let points = positions.iter().zip(&normals).enumerate();
    let points = points.map(|(point, (&position, &normal))| {
        let (position, normal) = placed(point, position, Some(normal))?;
        let normal = normal.unwrap_or_default();
        Ok(SensorPoint { position, normal })
    });
    let points: Vec<SensorPoint> = points.collect::<PyResult<_>>()?;
    warn_of_places(py, scene, &points, request.horizon)?;
    let found = attended(py, progress, |attendant| -> PyResult<Option<Vec<PointRow>>> {
        let sessions: Vec<_> = (0..LEVELS).map(|_| request.open()).collect::<PyResult<_>>()?;
        rows_of_points(
            &scene.model,
            &points,
            &request.division,
            request.horizon,
            request.options,
            sessions,
            &mut |done| attendant.tell((done, points.len())),
        )
        .map_err(|error| errors::compute(&error))
    })??;
    let (seen, rows) = found
        .ok_or_else(interrupted)?
        .into_iter()
        .map(|row| (row.patches, row.sky))
        .unzip();
    Sky::object(py, request.division, rows, Some((seen, scene.patches.len())), None)
}
