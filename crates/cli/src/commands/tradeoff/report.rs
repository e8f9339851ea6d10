//! The report of `tradeoff --json`, and the source of its text.

use super::trial::Trial;
use crate::report::{BackendReport, Input};
use serde::Serialize;

#[derive(Clone, Debug, Serialize)]
pub(super) struct Skipped {
    pub(super) name: String,
    /// Nominal seconds for the sampled rows.
    pub(super) nominal_seconds: f64,
}

#[derive(Debug, Serialize)]
pub(in crate::commands) struct ReferenceReport {
    pub(super) target: f64,
    pub(in crate::commands) noise: f64,
    pub(super) rays: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct Recommendation {
    pub(super) name: String,
    pub(super) command: String,
    /// Upper end of the error, within the tolerance.
    pub(super) error: f64,
    pub(super) milliseconds_per_row: f64,
    pub(super) seconds_for_all_rows: f64,
    /// Upper end of the matrix's error, by the sampled rows.
    pub(super) error_of_matrix: f64,
}

/// The report of `--json`.
#[derive(Serialize)]
pub(in crate::commands) struct Report {
    pub(super) schema: u32,
    pub(super) program: &'static str,
    pub(super) version: &'static str,
    pub(super) inputs: Vec<Input>,
    pub(in crate::commands) patches: u64,
    pub(super) backend: BackendReport,
    pub(super) threads: usize,
    pub(super) tolerance: f64,
    pub(in crate::commands) sampled_rows: usize,
    pub(super) seed: u64,
    pub(in crate::commands) reference: ReferenceReport,
    pub(in crate::commands) trials: Vec<Trial>,
    pub(super) skipped: Vec<Skipped>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) recommended: Option<Recommendation>,
}
