//! A setting's measurements: its rows against the reference, and its time.

use super::setting::{Rung, Setting};
use crate::args::{EngineSettings, Talk};
use anyhow::Result;
use hemicube::Model;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, compute};
use hemicube::reference::{EstimatedRow, Measured, ReferenceRow, errors_against};
use hemicube::store::Part;
use serde::Serialize;
use std::sync::atomic::AtomicBool;

/// Largest ratio of a cheaper setting's error to a dearer one's at which it is as good: less is chance.
const AS_GOOD: f64 = 1.05;

/// A setting with its measurements.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Trial {
    pub(crate) name: String,
    pub(crate) rung: &'static str,
    pub(crate) tolerance: Option<f64>,
    /// Hemicubes a patch.
    pub(crate) samples: u32,
    pub(crate) resolution: u32,
    /// Options of `compute` for this setting.
    pub(crate) words: String,
    pub(crate) entries: u64,
    pub(crate) measured: Measured,
    /// Only with `-v`: a clock decides it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) timing: Option<Timing>,
    #[serde(skip)]
    pub(super) setting: Setting,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Timing {
    pub(crate) milliseconds_per_row: f64,
    /// Forecast for all rows with all threads.
    pub(crate) seconds_for_all_rows: f64,
    pub(crate) repeats: u32,
    /// True if no cheaper setting is as good.
    pub(crate) front: bool,
}

impl Trial {
    /// Upper end of the error, within the reference's noise.
    pub(crate) fn bound(&self) -> f64 {
        let high = self.measured.interval_of_rows.high;
        if high.is_nan() { f64::INFINITY } else { high }
    }

    pub(crate) fn milliseconds(&self) -> f64 {
        self.timing.map_or(f64::INFINITY, |timing| timing.milliseconds_per_row)
    }

    pub(crate) fn is_on_front(&self) -> bool {
        self.timing.is_some_and(|timing| timing.front)
    }
}

/// A setting being timed.
pub(crate) struct Timed {
    pub(super) setting: Setting,
    pub(crate) plan: Plan,
    /// Number of times so far.
    pub(crate) repeats: u32,
    /// The rows, equal in every repetition.
    pub(crate) parts: Vec<Part>,
    /// The least so far.
    pub(crate) milliseconds_per_row: f64,
}

/// The size of a whole run, for its forecast.
#[derive(Clone, Copy)]
pub(crate) struct ForAllRows {
    pub(crate) patches: u64,
    pub(crate) threads: usize,
}

impl Timed {
    /// Seconds of the sampled rows.
    pub(crate) fn seconds(&self) -> f64 {
        self.milliseconds_per_row * self.plan.rows.len() as f64 * 1e-3
    }

    /// Compares the rows with the reference.
    pub(crate) fn trial(self, exact: &[ReferenceRow], all: ForAllRows) -> Trial {
        let estimated: Vec<EstimatedRow> = self.parts.iter().flat_map(EstimatedRow::of_part).collect();
        let (rung, tolerance) = match self.setting.rung {
            Rung::Pixel => ("pixel", None),
            Rung::Tolerance(tolerance) => ("tolerance", Some(tolerance)),
        };
        Trial {
            name: self.setting.name(),
            rung,
            tolerance,
            samples: u32::try_from(self.plan.hemicubes_per_row()).unwrap_or(u32::MAX),
            resolution: self.setting.resolution,
            words: self.setting.words(),
            entries: self.parts.iter().map(|part| part.indices.len() as u64).sum(),
            measured: errors_against(exact, &estimated),
            timing: Some(Timing {
                milliseconds_per_row: self.milliseconds_per_row,
                seconds_for_all_rows: self.milliseconds_per_row * 1e-3 * all.patches as f64 / all.threads as f64,
                repeats: self.repeats,
                front: false,
            }),
            setting: self.setting,
        }
    }

    /// Computes the rows once more.
    pub(crate) fn run(&mut self, model: &Model, engine: &EngineSettings, cancel: &AtomicBool) -> Result<()> {
        let settings = RenderSettings {
            resolution: self.setting.resolution,
            culling: Culling::On,
            covered: false,
        };
        let execution = Execution {
            threads: 1,
            batch: 0,
            cancel: Some(cancel),
        };
        let backend = engine.open_backend(Talk::SILENT)?;
        self.parts.clear();
        self.plan.correction.prepare(model);
        let summary = compute(
            model,
            &self.plan,
            settings,
            backend,
            execution,
            &mut self.parts,
            &mut |_| {},
        )?;
        self.repeats += 1;
        let milliseconds = summary.elapsed.as_secs_f64() * 1e3 / summary.rows.max(1) as f64;
        self.milliseconds_per_row = self.milliseconds_per_row.min(milliseconds);
        Ok(())
    }
}

/// Sorts trials by time, and marks those with no cheaper one as good.
pub(crate) fn mark_front(trials: &mut [Trial]) {
    trials.sort_by(|a, b| a.milliseconds().total_cmp(&b.milliseconds()));
    let mut best = f64::INFINITY;
    for trial in trials {
        let bound = trial.bound();
        let front = bound * AS_GOOD < best || (best > 0.0 && bound == 0.0);
        if let Some(timing) = &mut trial.timing {
            timing.front = front;
        }
        best = best.min(bound);
    }
}
