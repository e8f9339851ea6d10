//! From the command line's settings to an accuracy level.

use crate::args::{RenderSettings, Tolerance};
use crate::exit::hinted;
use crate::report::small_percent;
use anyhow::{Result, anyhow};
use hemicube::Model;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::HemicubeBackend;
use hemicube::driver::calibrate::Calibration;
use hemicube::driver::compute::{Execution, Selection};
pub(crate) use hemicube::driver::level::percentage;
use hemicube::driver::level::{Asked, LevelError};
use hemicube::store::Form;
use std::sync::atomic::AtomicBool;

/// A tolerance in prose: `0.3 %`, where [`percentage`] is the word of an option, `0.3%`.
pub(crate) fn asked(share: f64) -> String {
    percentage(share).replace('%', " %")
}

/// Calibrates a tolerance on a scene. The result does not depend on the rows computed: `compute` and `tradeoff` agree.
pub(crate) fn within(
    model: &Model,
    selection: &Selection,
    rotate: bool,
    tolerance: Tolerance,
    backend: &mut dyn HemicubeBackend,
    threads: usize,
    cancel: &AtomicBool,
) -> Result<Calibration> {
    let execution = Execution {
        threads,
        cancel: Some(cancel),
        ..Execution::default()
    };
    Ok(hemicube::driver::level::within(
        model,
        selection,
        rotate,
        tolerance.0,
        backend,
        execution,
    )?)
}

impl RenderSettings {
    /// The accuracy level asked for.
    pub(crate) fn accuracy(&self) -> Asked {
        match self.tolerance() {
            Some(tolerance) => Asked::Tolerance(tolerance.0),
            None => Asked::Settings {
                correction: Correction::Pixel,
                resolution: self.resolution,
                samples_per_edge: self.samples.per_edge,
            },
        }
    }
}

/// An accuracy level that cannot be kept, with the next step.
pub(crate) fn explain(error: LevelError) -> anyhow::Error {
    match error {
        LevelError::Rounding {
            form,
            rounding,
            tolerance,
        } => hinted(
            anyhow!(
                "`--form {}` rounds form factors by up to {}, which leaves too little of a tolerance of {}",
                form.name(),
                small_percent(rounding),
                percentage(tolerance)
            ),
            match form {
                Form::Compact => "`--form plain` rounds nothing",
                Form::Plain | Form::Double => "below 0.000012% (1.2e-7) `--form double` is needed: form factors in f64",
            },
        ),
        error => error.into(),
    }
}
