//! The report of `tradeoff --json`, and the source of its text.

use super::trial::Trial;
use crate::report::{BackendReport, Input};
use serde::Serialize;

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Skipped {
    pub(crate) name: String,
    /// Nominal seconds for the sampled rows.
    pub(crate) nominal_seconds: f64,
}

#[derive(Debug, Serialize)]
pub(crate) struct ReferenceReport {
    pub(crate) target: f64,
    pub(crate) noise: f64,
    pub(crate) rays: u64,
}

#[derive(Debug, Serialize)]
pub(crate) struct Recommendation {
    pub(crate) name: String,
    pub(crate) command: String,
    /// Upper end of the error, within the tolerance.
    pub(crate) error: f64,
    pub(crate) milliseconds_per_row: f64,
    pub(crate) seconds_for_all_rows: f64,
    /// Upper end of the matrix's error, by the sampled rows.
    pub(crate) error_of_matrix: f64,
}

/// The report of `--json`.
#[derive(Serialize)]
pub(crate) struct Report {
    pub(crate) schema: u32,
    pub(crate) program: &'static str,
    pub(crate) version: &'static str,
    pub(crate) inputs: Vec<Input>,
    pub(crate) patches: u64,
    pub(crate) backend: BackendReport,
    pub(crate) threads: usize,
    pub(crate) tolerance: f64,
    pub(crate) sampled_rows: usize,
    pub(crate) seed: u64,
    pub(crate) reference: ReferenceReport,
    pub(crate) trials: Vec<Trial>,
    pub(crate) skipped: Vec<Skipped>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) recommended: Option<Recommendation>,
}
