//! `hemicube.compute`.

use crate::attended::{Attendant, attended};
use crate::errors;
use crate::matrix::Matrix;
use crate::scene::Scene;
use crate::session::Wanted;
use hemicube::accuracy::correct::Correction;
use hemicube::accuracy::level::{Asked, Level};
use hemicube::backend::{Culling, RESOLUTIONS, RenderSettings};
use hemicube::driver::compute::{
    ComputeError, Execution, PartSink, Plan, RowChoice, Selection, compute as compute_rows,
};
use hemicube::driver::probe::Probe;
use hemicube::driver::selection::Names;
use hemicube::driver::settings::{RowSettings, axis_name};
use hemicube::driver::storage_policy::StoragePolicy;
use hemicube::store::{Form, Part, PatchTable, Store, StoreWriter};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Pixels along an edge where nobody says: sums of pixels need more than fractions of them.
const RESOLUTION_OF_PIXEL: u32 = 256;
const RESOLUTION_OF_FRACTIONS: u32 = 128;

/// Rows done, and rows in all.
type Rows = (u64, u64);

/// Everything that was asked for but the scene.
#[derive(Debug)]
struct Request {
    asked: Asked,
    rotate: bool,
    choice: RowChoice,
    emitters: Vec<String>,
    receivers: Vec<String>,
    occluders: Vec<String>,
    min_factor: Option<f64>,
    form: Option<Form>,
    culling: Option<Culling>,
    batch: usize,
    threads: usize,
    output: Option<PathBuf>,
    overwrite: bool,
    backend: Wanted,
}

/// Where a run's parts go.
enum Sink {
    Memory(Vec<Part>),
    Store(Box<StoreWriter>),
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
    if let Some(tolerance) = tolerance {
        if correction.is_some() || wanted.is_some() || samples.is_some() {
            return Err(errors::input(
                "`tolerance` chooses what keeps it; `correction`, `resolution` and `samples` are for runs without",
            ));
        }
        if !(1e-5..=0.5).contains(&tolerance) {
            return Err(errors::input(format!(
                "`tolerance` is {tolerance}; a share from 0.00001 to 0.5 is needed"
            )));
        }
        return Ok(Asked::Tolerance(tolerance));
    }
    let correction = match correction.unwrap_or("area") {
        "pixel" => Correction::Pixel,
        "point" => Correction::Point,
        "area" => Correction::area(),
        other => {
            return Err(errors::input(format!(
                "`correction` is `{other}`; pixel, point or area is needed"
            )));
        }
    };
    Ok(Asked::Settings {
        resolution: match wanted {
            Some(wanted) => resolution(wanted)?,
            None if correction == Correction::Pixel => RESOLUTION_OF_PIXEL,
            None => RESOLUTION_OF_FRACTIONS,
        },
        samples_per_edge: samples_per_edge(samples.unwrap_or(1))?,
        correction,
    })
}

impl Request {
    fn settings(&self, scene: &Scene, plan: &Plan, rung: &Level) -> RowSettings {
        RowSettings {
            resolution: rung.resolution,
            samples: u32::try_from(plan.hemicubes_per_row()).unwrap_or(u32::MAX),
            correction: rung.correction.name(),
            tolerance: match self.asked {
                Asked::Tolerance(tolerance) => Some(tolerance),
                Asked::Settings { .. } => None,
            },
            reason: rung.reason.clone(),
            rotation: self.rotate,
            subdivision: scene.subdivision.into(),
            two_sided: scene.two_sided,
            flip: scene.flip.clone(),
            keep_duplicates: scene.keep_duplicates,
            scale: scene.scale,
            up: scene.triangles.up.map(axis_name),
            rows: self.choice.into(),
            emitters: self.emitters.clone(),
            receivers: self.receivers.clone(),
            occluders: self.occluders.clone(),
            min_factor: (plan.min_factor > 0.0).then_some(plan.min_factor),
        }
    }

    /// The matrix, on a thread without the interpreter's lock.
    fn run(&self, scene: &Scene, attendant: &Attendant<'_, Rows>) -> PyResult<Matrix> {
        let execution = Execution {
            threads: self.threads,
            batch: self.batch,
            cancel: Some(attendant.cancel()),
        };
        let failed = |error: ComputeError| errors::compute(&error);
        let names = Names {
            emitters: &self.emitters,
            receivers: &self.receivers,
            occluders: &self.occluders,
        };
        let selection =
            Selection::by_name(&scene.triangles, &scene.patches, names).map_err(|error| errors::no_match(&error))?;
        let mut backend = self.backend.open()?;
        let keep = StoragePolicy::choose(
            self.form,
            self.min_factor,
            scene.model.geometry().patch_count,
            match self.asked {
                Asked::Tolerance(tolerance) => Some(tolerance),
                Asked::Settings { .. } => None,
            },
        );
        let rung = Level::resolve(
            self.asked,
            &scene.model,
            &selection,
            self.rotate,
            keep.form,
            self.backend.open()?.as_mut(),
            execution,
        )
        .map_err(|error| errors::rung(&error))?;
        let mut plan = Plan::new(&scene.model, self.choice, selection, rung.samples_per_edge, self.rotate)
            .with_correction(rung.correction)
            .with_min_factor(keep.min_factor)
            .with_form(keep.form);
        if plan.rows.is_empty() {
            return Err(errors::input(
                "no row is left to compute: `rows`, `emitters` and `occluders` together exclude every patch",
            ));
        }
        let mut render = RenderSettings {
            resolution: rung.resolution,
            culling: self.culling.unwrap_or(Culling::On),
            covered: false,
        };
        if self.culling.is_none() {
            let probe = Probe::render(&scene.model, &plan, render, backend.as_mut()).map_err(failed)?;
            render.culling = probe.culling();
        }
        // What it chooses by the scene is part of what the store is made with.
        hemicube::driver::compute::load(&scene.model, &plan.correction, render, backend.as_mut()).map_err(failed)?;
        let settings = self.settings(scene, &plan, &rung);
        let header = settings
            .header(&scene.triangles, &scene.patches, &scene.file, &plan, backend.info())
            .map_err(|error| errors::store(&error))?;
        let value = header.settings.clone();
        let mut kept_rows = 0;
        let mut sink = match &self.output {
            None => Sink::Memory(Vec::new()),
            Some(directory) => {
                let table = PatchTable::new(&scene.triangles, &scene.patches);
                let writer = if self.overwrite {
                    StoreWriter::create(directory, header, &table, true)
                } else {
                    StoreWriter::resume(directory, header, &table, None, self.threads, &mut |_| {}).map(
                        |(writer, kept)| {
                            kept_rows = kept.rows;
                            writer
                        },
                    )
                };
                let writer = writer.map_err(|error| errors::store(&error))?;
                let missing = writer.missing_parts();
                plan = plan.with_parts(|part| missing.binary_search(&part).is_ok());
                Sink::Store(Box::new(writer))
            }
        };
        let taking: &mut dyn PartSink = match &mut sink {
            Sink::Memory(parts) => parts,
            Sink::Store(writer) => writer.as_mut(),
        };
        let computed = compute_rows(
            &scene.model,
            &plan,
            render,
            backend,
            execution,
            taking,
            &mut |progress| {
                attendant.tell((kept_rows + progress.rows, kept_rows + progress.row_count));
            },
        );
        let cancelled = computed.as_ref().is_ok_and(|summary| summary.cancelled);
        match sink {
            Sink::Memory(parts) => {
                computed.map_err(failed)?;
                if cancelled {
                    return Err(interrupted());
                }
                let areas = scene.patches.iter().map(|patch| scene.patches.area(patch)).collect();
                Matrix::in_memory(areas, parts, keep.form, value)
            }
            Sink::Store(writer) => {
                let directory = writer.directory().to_owned();
                if cancelled || computed.is_err() {
                    // The next run goes on with the parts that are there, even if the manifest cannot name them.
                    let _ = writer.interrupt();
                    computed.map_err(failed)?;
                    return Err(interrupted());
                }
                writer.finish().map_err(|error| errors::store(&error))?;
                Ok(Matrix::stored(
                    Store::open(&directory).map_err(|error| errors::store(&error))?,
                ))
            }
        }
    }
}

/// What ends a run that was told to; the exception that told it goes before.
fn interrupted() -> PyErr {
    PyKeyboardInterrupt::new_err("the computation was cancelled")
}

/// The form-factor matrix of a scene: F[i, j] is the fraction of what leaves patch i that reaches patch j.
///
/// `tolerance` names the relative Frobenius error to aim at (0.01 is 1 %), and everything else follows from it. Without
/// it, `correction` says what form factors are made of ('pixel', 'point' or 'area'), `resolution` how many pixels an
/// edge of the hemicube has, and `samples` how many hemicubes a patch gets (1, 4, 9…).
///
/// `rows=(start, end)` or `sample_rows` (drawn by `seed`) computes some rows only; `emitters`, `receivers` and
/// `occluders` are lists of globs for names of objects and materials that have rows, have columns, or have neither.
/// `min_factor` leaves smaller form factors out, and the others of their row share what they carried.
///
/// Without `output` the matrix is in memory. With it, it is a store in that directory, the same bytes that the program
/// `hemicube compute` writes, and an interrupted run goes on where it stopped; `store='compact'` takes a third of the
/// room.
///
/// From a million patches on, the store is compact and form factors below 1e-7 are left out, unless `store` and
/// `min_factor` say otherwise, or a tolerance below 0.3 % is asked for.
///
/// `progress(done, total)` is called with rows every now and then. Ctrl-C ends the run: parts that are finished stay in
/// the store. Neither `threads` nor `batch` nor `culling` changes a bit of the result. Other Python threads run
/// meanwhile.
#[pyfunction]
#[pyo3(signature = (scene, *, tolerance=None, correction=None, resolution=None, samples=None, rotation=true, rows=None, sample_rows=None, seed=1, emitters=Vec::new(), receivers=Vec::new(), occluders=Vec::new(), min_factor=None, output=None, store=None, overwrite=false, backend="cpu", backend_dir=None, backend_options=None, engine="auto", culling=None, batch=0, threads=0, progress=None))]
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
    min_factor: Option<f64>,
    output: Option<PathBuf>,
    store: Option<&str>,
    overwrite: bool,
    backend: &str,
    backend_dir: Option<PathBuf>,
    backend_options: Option<std::collections::BTreeMap<String, String>>,
    engine: &str,
    culling: Option<bool>,
    batch: usize,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Matrix> {
    let scene = scene.get();
    let count = u32::try_from(scene.patches.len()).unwrap_or(u32::MAX);
    let choice = match (rows, sample_rows) {
        (None, None) => RowChoice::All,
        (Some((start, end)), None) if start < end && end <= count => RowChoice::Range { start, end },
        (Some((start, end)), None) => {
            return Err(errors::input(format!(
                "`rows` is ({start}, {end}); the scene has {count} patches, from 0 on"
            )));
        }
        (None, Some(0)) => return Err(errors::input("`sample_rows` is 0; 1 or more is needed")),
        (None, Some(wanted)) => RowChoice::Sample {
            count: wanted.min(count),
            seed,
        },
        (Some(_), Some(_)) => return Err(errors::input("`rows` and `sample_rows` exclude each other")),
    };
    if let Some(least) = min_factor.filter(|least| !(0.0..1.0).contains(least)) {
        return Err(errors::input(format!(
            "`min_factor` is {least}; a number from 0 up to 1 is needed"
        )));
    }
    let request = Request {
        asked: asked(tolerance, correction, resolution, samples)?,
        rotate: rotation,
        choice,
        emitters,
        receivers,
        occluders,
        min_factor,
        form: match store {
            None => None,
            Some("plain") => Some(Form::Plain),
            Some("compact") => Some(Form::Compact),
            Some(other) => {
                return Err(errors::input(format!(
                    "`store` is `{other}`; plain or compact is needed"
                )));
            }
        },
        culling: culling.map(|on| if on { Culling::On } else { Culling::Off }),
        batch,
        threads,
        output,
        overwrite,
        backend: Wanted::new(
            backend,
            backend_dir,
            backend_options.unwrap_or_default().into_iter().collect(),
            engine,
        )?,
    };
    attended(py, progress, |attendant| request.run(scene, &attendant))?
}
