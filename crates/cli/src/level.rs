//! From the command line's settings to a rung of the accuracy ladder.

use crate::args::{Correction as Name, RenderSettings, Tolerance};
use crate::exit::hinted;
use crate::report::percent;
use anyhow::{Result, anyhow};
use hemicube::Model;
use hemicube::accuracy::calibrate::Calibration;
use hemicube::accuracy::correct::Correction;
use hemicube::accuracy::level::{Asked, LevelError};
pub(crate) use hemicube::accuracy::level::{Level, percentage};
use hemicube::backend::HemicubeBackend;
use hemicube::driver::compute::{Execution, Selection};
use hemicube::store::Form;

/// The correction of a name.
pub(crate) fn correction(name: Name) -> Correction {
    match name {
        Name::Pixel => Correction::Pixel,
        Name::Point => Correction::Point,
        Name::Area => Correction::area(),
    }
}

/// What keeps a tolerance in a scene: the same for `compute` and `tradeoff`, whichever of the rows they compute.
pub(crate) fn within(
    model: &Model,
    selection: &Selection,
    rotate: bool,
    tolerance: Tolerance,
    backend: &mut dyn HemicubeBackend,
    threads: usize,
) -> Result<Calibration> {
    let execution = Execution {
        threads,
        ..Execution::default()
    };
    Ok(hemicube::accuracy::level::within(
        model,
        selection,
        rotate,
        tolerance.0,
        backend,
        execution,
    )?)
}

/// Settles the rung for a scene.
pub(crate) fn choose(
    model: &Model,
    selection: &Selection,
    settings: &RenderSettings,
    rotate: bool,
    form: Form,
    backend: &mut dyn HemicubeBackend,
) -> Result<Level> {
    let asked = match settings.tolerance {
        Some(tolerance) => Asked::Tolerance(tolerance.0),
        None => Asked::Settings {
            correction: correction(settings.correction),
            resolution: settings.resolution,
            samples_per_edge: settings.samples.per_edge,
        },
    };
    let execution = Execution {
        threads: settings.thread_count(),
        ..Execution::default()
    };
    Level::resolve(asked, model, selection, rotate, form, backend, execution).map_err(|error| match error {
        LevelError::Rounding { rounding, tolerance } => hinted(
            anyhow!(
                "`--store compact` rounds form factors by up to {}, which leaves too little of a tolerance of {}",
                percent(rounding),
                percent(tolerance)
            ),
            "`--store plain` rounds nothing",
        ),
        error => error.into(),
    })
}
