//! `hemicube.compute`.

use crate::attended::{Attendant, attended};
use crate::errors;
use crate::matrix::Matrix;
use crate::portals::{self, AskedBand};
use crate::scene::Scene;
use crate::session::{BUILT_IN, BackendChoice};
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, RESOLUTIONS};
use hemicube::driver::compute::{PartSink, Progress, RowChoice};
use hemicube::driver::glazing::matrix_of_band;
use hemicube::driver::job::{Job, Observer, PartListener, Run, Sessions, Stage, StorePlace};
use hemicube::driver::level::{Asked, DEFAULT_TOLERANCE};
use hemicube::driver::update::Update;
use hemicube::portal::Portals;
use hemicube::store::{Form, Part, PatchTable, Store};
use hemicube::{Grouping, Model, PatchKind};
use hemicube_backend_cpu::EngineChoice;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Default pixels along an edge of sums of pixels.
const RESOLUTION_OF_PIXEL: u32 = 256;

/// Rows done, and rows in all.
type Rows = (u64, u64);

/// Everything asked for but the scene.
#[derive(Debug)]
struct Request {
    job: Job,
    /// With images of the scene, where it is a part; otherwise the scene's.
    model: Option<Model>,
    backend: BackendChoice,
    /// Portals of bands after the job's own.
    further: Vec<Arc<Portals>>,
    /// A store a matrix; none in memory.
    outputs: Vec<PathBuf>,
    overwrite: bool,
}

/// Passes a run's progress to the attendant, and its cancellation to the run.
struct Attended<'a> {
    attendant: &'a Attendant<'a, Rows>,
    /// Rows of an earlier run.
    resumed: Cell<u64>,
}

impl Observer for Attended<'_> {
    fn begin(&self, stage: Stage) {
        if let Stage::Rows { resumed, .. } = stage {
            self.resumed.set(resumed);
        }
    }

    fn progress(&self, progress: Progress) {
        let resumed = self.resumed.get();
        self.attendant
            .tell((resumed + progress.rows, resumed + progress.row_count));
    }

    fn cancel(&self) -> Option<&AtomicBool> {
        Some(self.attendant.cancel())
    }
}

/// Pixels along an edge of the hemicube, if there can be so many.
pub(crate) fn resolution(wanted: u32) -> PyResult<u32> {
    if wanted.is_multiple_of(16) && RESOLUTIONS.contains(&wanted) {
        return Ok(wanted);
    }
    Err(errors::input(format!(
        "`resolution` is {wanted}; a multiple of 16 from {} to {} is needed",
        RESOLUTIONS.start(),
        RESOLUTIONS.end()
    )))
}

/// n of n² hemicubes.
pub(crate) fn samples_per_edge(samples: u32) -> PyResult<u32> {
    if samples > 0 && samples <= 4096 && samples.isqrt().pow(2) == samples {
        return Ok(samples.isqrt());
    }
    Err(errors::input(format!(
        "`samples` is {samples}; a perfect square (1, 4, 9, 16…) up to 4096 is needed"
    )))
}

fn asked(
    tolerance: Option<f64>,
    correction: Option<&str>,
    wanted: Option<u32>,
    samples: Option<u32>,
) -> PyResult<Asked> {
    let sums_pixels = match correction {
        None | Some("tolerance") => false,
        Some("pixel") => true,
        Some(other) => {
            return Err(errors::input(format!(
                "`correction` is `{other}`; tolerance or pixel is needed"
            )));
        }
    };
    if sums_pixels {
        if tolerance.is_some() {
            return Err(errors::input(
                "`tolerance` does nothing where pixels are summed: leave it, or `correction`, out",
            ));
        }
        return Ok(Asked::Settings {
            correction: Correction::Pixel,
            resolution: resolution(wanted.unwrap_or(RESOLUTION_OF_PIXEL))?,
            samples_per_edge: samples_per_edge(samples.unwrap_or(1))?,
        });
    }
    if wanted.is_some() || samples.is_some() {
        return Err(errors::input(
            "a tolerance chooses its hemicubes; `resolution` and `samples` are for `correction=\"pixel\"`",
        ));
    }
    let tolerance = tolerance.unwrap_or(DEFAULT_TOLERANCE);
    if !(1e-7..=0.5).contains(&tolerance) {
        return Err(errors::input(format!(
            "`tolerance` is {tolerance}; a share from 0.0000001 to 0.5 is needed"
        )));
    }
    Ok(Asked::Tolerance(tolerance))
}

/// Rows out of `count`.
fn row_choice(rows: Option<(u32, u32)>, sample_rows: Option<u32>, seed: u64, count: u32) -> PyResult<RowChoice> {
    match (rows, sample_rows) {
        (None, None) => Ok(RowChoice::All),
        (Some((start, end)), None) if start < end && end <= count => Ok(RowChoice::Range { start, end }),
        (Some((start, end)), None) => Err(errors::input(format!(
            "`rows` is ({start}, {end}); the scene has {count} patches, from 0 on"
        ))),
        (None, Some(0)) => Err(errors::input("`sample_rows` is 0; 1 or more is needed")),
        (None, Some(wanted)) => Ok(RowChoice::Sample {
            count: wanted.min(count),
            seed,
        }),
        (Some(_), Some(_)) => Err(errors::input("`rows` and `sample_rows` exclude each other")),
    }
}

impl Request {
    /// The matrices, one or one a band, computed on a thread without the interpreter's lock.
    fn run(&self, scene: &Scene, attendant: &Attendant<'_, Rows>) -> PyResult<Vec<Matrix>> {
        let observer = Attended {
            attendant,
            resumed: Cell::new(0),
        };
        let sessions = Sessions {
            rows: self.backend.open()?,
            calibration: self.backend.open()?,
        };
        let model = self.model.as_ref().unwrap_or(&scene.model);
        let run = self.job.prepare(&scene.input, model, sessions, &observer);
        let mut run = run.map_err(|error| errors::job(&error))?;
        for portals in &self.further {
            let with_band = run.with_band(&self.job, &scene.input, Arc::clone(portals));
            run = with_band.map_err(|error| errors::job(&error))?;
        }
        if self.outputs.is_empty() {
            in_memory(run, scene, &observer)
        } else {
            self.stored(run, scene, &observer)
        }
    }

    /// The matrices in stores. An interrupted run is resumed by the next one.
    fn stored(&self, run: Run<'_>, scene: &Scene, observer: &Attended<'_>) -> PyResult<Vec<Matrix>> {
        let places: Vec<StorePlace<'_>> = self
            .outputs
            .iter()
            .map(|directory| StorePlace {
                directory,
                overwrite: self.overwrite,
                shard: None,
            })
            .collect();
        let mut ignored: Vec<_> = places.iter().map(|_| |_: &Part| {}).collect();
        let mut listeners: Vec<PartListener<'_>> = ignored.iter_mut().map(|none| none as PartListener<'_>).collect();
        let store = run
            .open_bands(&scene.input, &places, &mut listeners, observer)
            .map_err(|error| errors::store(&error))?;
        let finished = store
            .compute_bands(&mut listeners, observer)
            .map_err(|error| errors::job(&error))?;
        if finished.iter().any(|finished| finished.summary.cancelled) {
            return Err(interrupted());
        }
        let open = |directory: &PathBuf| match Store::open(directory) {
            Ok(store) => Ok(Matrix::stored(store)),
            Err(error) => Err(errors::store(&error)),
        };
        self.outputs.iter().map(open).collect()
    }
}

/// The matrices in memory.
fn in_memory(run: Run<'_>, scene: &Scene, observer: &Attended<'_>) -> PyResult<Vec<Matrix>> {
    let (input, patches) = (&scene.input, &scene.patches);
    let headers = run.headers(input).map_err(|error| errors::store(&error))?;
    let grouping = run.plan.groups.as_ref().map(|groups| Arc::clone(&groups.grouping));
    let numbers = run.plan.taken.as_ref().map(|taken| taken.numbers().to_vec());
    let mut parts: Vec<Vec<Part>> = headers.iter().map(|_| Vec::new()).collect();
    let mut sinks: Vec<&mut dyn PartSink> = parts.iter_mut().map(|parts| parts as &mut dyn PartSink).collect();
    let summaries = run
        .compute_bands(&mut sinks, observer)
        .map_err(|error| errors::compute(&error))?;
    if summaries.iter().any(|summary| summary.cancelled) {
        return Err(interrupted());
    }
    let matrix = |(header, parts)| {
        let table = PatchTable {
            drawn_by: numbers.clone().unwrap_or_default(),
            ..PatchTable::of(input, patches, grouping.as_deref())
        };
        Matrix::in_memory(header, table, parts)
    };
    headers.into_iter().zip(parts).map(matrix).collect()
}

/// The exception of a cancelled run; the one that cancelled it takes precedence.
pub(crate) fn interrupted() -> PyErr {
    PyKeyboardInterrupt::new_err("the computation was cancelled")
}

/// The form-factor matrix of a scene: F[i, j] is the fraction of the diffuse energy leaving patch i that reaches patch
/// j.
///
/// `tolerance` is the relative Frobenius error to aim at (0.01 is 1 %; by default 0.02); everything else follows from it.
/// `correction="pixel"` sums pixels in its place, the method as published: `resolution` is then the number of pixels along
/// an edge of the hemicube, and `samples` the number of hemicubes of a patch (1, 4, 9…).
///
/// `rows=(start, end)` or `sample_rows` (drawn by `seed`) computes some rows only; `emitters`, `receivers` and
/// `occluders` are lists of globs for names of objects and materials with rows, with columns, or with neither. Form
/// factors below `min_factor` are left out, and their sum is shared by the others of their row.
///
/// `patches='object'`, `'material'` or `'face'` makes rows and columns of those instead of triangles; `Matrix.names`
/// has their names, and `rows` and `sample_rows` count them.
///
/// `specular` follows mirrors and panes, by name: `{"object": {"mirror": {"specular": 0.9}}, "material": {"glass*":
/// {"index": 1.52, "thickness": 0.006, "extinction": 20}}}`; form factors are then of what arrives, and
/// `specular_bound` is the share of a path at which it ends. Of tables with several bands `band="light"` takes one;
/// `band=["light", "heat"]` computes these together, and returns a dictionary of a matrix each, with `output` in
/// stores of its name with `-light` and `-heat` behind it. `symmetry={"x": 0}`, `sector=("z", 12)` and
/// `periodic={"y": (0, 80)}` say that the scene is one side of a plane, a sector, or one cell (`repeats` on either
/// side). `Matrix.specular_reflectance`, `.transmittance`, `.passed` and `.cut_off` tell of it.
///
/// Without `output` the matrix is in memory. With it, it is a store in that directory, with the bytes of the program's
/// `hemicube compute`, and an interrupted run is resumed by the next one; `store='compact'` takes a third of the room,
/// `store='double'` keeps form factors in f64.
///
/// `update` is the store of the scene before a change, computed with the same settings: rows of patches that see nothing
/// of the change are taken over from it, and the others have its random numbers.
///
/// From a million patches on, the store is compact and form factors below 1e-7 are left out, unless `store` and
/// `min_factor` say otherwise, or a tolerance below 0.3 % is asked for.
///
/// `progress(done, total)` is called with numbers of rows some times a second. Ctrl-C ends the run: finished parts stay
/// in the store. Neither `threads` nor `batch` nor `culling` changes a bit of the result. Other Python threads run
/// meanwhile.
#[pyfunction]
#[pyo3(signature = (
    scene, *, tolerance=None, correction=None, resolution=None, samples=None, rotation=true, rows=None,
    sample_rows=None, seed=1, emitters=Vec::new(), receivers=Vec::new(), occluders=Vec::new(), patches=None,
    min_factor=None, output=None, store=None, overwrite=false, update=None, backend="cpu", backend_dir=None,
    backend_options=None, engine="auto", culling=None, batch=0, threads=0, progress=None, specular=None,
    specular_bound=None, symmetry=std::collections::BTreeMap::new(), sector=None,
    periodic=std::collections::BTreeMap::new(), repeats=None, band=None
))]
#[allow(clippy::too_many_arguments, reason = "keywords")]
pub(crate) fn compute(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    tolerance: Option<f64>,
    correction: Option<&str>,
    resolution: Option<u32>,
    samples: Option<u32>,
    rotation: bool,
    rows: Option<(u32, u32)>,
    sample_rows: Option<u32>,
    seed: u64,
    emitters: Vec<String>,
    receivers: Vec<String>,
    occluders: Vec<String>,
    patches: Option<&str>,
    min_factor: Option<f64>,
    output: Option<PathBuf>,
    store: Option<&str>,
    overwrite: bool,
    update: Option<PathBuf>,
    backend: &str,
    backend_dir: Option<PathBuf>,
    backend_options: Option<std::collections::BTreeMap<String, String>>,
    engine: &str,
    culling: Option<bool>,
    batch: usize,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
    specular: Option<&Bound<'_, PyAny>>,
    specular_bound: Option<f64>,
    symmetry: std::collections::BTreeMap<String, f64>,
    sector: Option<(String, u32)>,
    periodic: std::collections::BTreeMap<String, (f64, f64)>,
    repeats: Option<u32>,
    band: Option<AskedBand>,
) -> PyResult<Py<PyAny>> {
    let scene = scene.get();
    let accuracy = asked(tolerance, correction, resolution, samples)?;
    let asked_portals = portals::Asked {
        specular,
        specular_bound,
        symmetry,
        sector,
        periodic,
        repeats,
        tolerance: accuracy.tolerance(),
    };
    let (portals, mut model) = match &band {
        Some(AskedBand::Several(names)) => asked_portals.of_bands(scene, names)?,
        Some(AskedBand::One(name)) => one(asked_portals.portals(scene, Some(name))?),
        None => one(asked_portals.portals(scene, None)?),
    };
    let mut portals = portals.into_iter().map(Arc::new);
    let kind = match patches {
        None => PatchKind::Triangle,
        Some(name) => PatchKind::of_name(name).ok_or_else(|| {
            errors::input(format!(
                "`patches` is `{name}`; triangle, face, object or material is needed"
            ))
        })?,
    };
    let grouping = Grouping::new(&scene.input, &scene.patches, kind);
    let count = grouping.as_ref().map_or(scene.patches.len(), Grouping::len);
    let count = u32::try_from(count).unwrap_or(u32::MAX);
    if let Some(least) = min_factor.filter(|least| !(0.0..1.0).contains(least)) {
        return Err(errors::input(format!(
            "`min_factor` is {least}; a number from 0 up to 1 is needed"
        )));
    }
    let update = match update {
        Some(directory) => {
            let whole = model.take().unwrap_or_else(|| scene.model.clone());
            let update = Update::open(&directory, whole.patches()).map_err(|error| errors::update(&error))?;
            model = Some(update.number(whole));
            Some(Arc::new(update))
        }
        None => None,
    };
    // As of the earlier matrix where none is asked for: a change of the scene may make another engine suit it.
    let earlier = update.as_ref().map(|update| update.backend());
    let engine = match earlier {
        Some([BUILT_IN, version]) if engine == "auto" && backend == BUILT_IN => {
            match EngineChoice::of_version(version) {
                EngineChoice::Order => "order",
                _ => "depth",
            }
        }
        _ => engine,
    }
    .to_owned();
    let job = Job {
        update,
        portals: portals.next().unwrap_or_default(),
        accuracy,
        rotate: rotation,
        rows: row_choice(rows, sample_rows, seed, count)?,
        emitters,
        receivers,
        occluders,
        min_factor,
        patches: kind,
        form: match store {
            None => None,
            Some("plain") => Some(Form::Plain),
            Some("compact") => Some(Form::Compact),
            Some("double") => Some(Form::Double),
            Some(other) => {
                return Err(errors::input(format!(
                    "`store` is `{other}`; plain, compact or double is needed"
                )));
            }
        },
        culling: culling.map(|on| if on { Culling::On } else { Culling::Off }),
        forecasts: false,
        threads,
        batch,
    };
    let options = backend_options.unwrap_or_default().into_iter().collect();
    let request = Request {
        job,
        model,
        backend: BackendChoice::new(backend, backend_dir, options, &engine)?,
        further: portals.collect(),
        outputs: match (output, &band) {
            (None, _) => Vec::new(),
            (Some(whole), Some(AskedBand::Several(names))) => {
                names.iter().map(|name| matrix_of_band(&whole, name)).collect()
            }
            (Some(output), _) => vec![output],
        },
        overwrite,
    };
    let found = attended(py, progress, |attendant| request.run(scene, &attendant))??;
    let mut found = found.into_iter().map(|matrix| Py::new(py, matrix));
    match band {
        Some(AskedBand::Several(names)) => {
            let matrices = PyDict::new(py);
            for (name, matrix) in names.into_iter().zip(found) {
                matrices.set_item(name, matrix?)?;
            }
            Ok(matrices.into_any().unbind())
        }
        _ => found.next().unwrap_or_else(|| Err(interrupted())).map(Py::into_any),
    }
}

/// The portals of one matrix in a list.
fn one((portals, model): (Portals, Option<Model>)) -> (Vec<Portals>, Option<Model>) {
    (vec![portals], model)
}
