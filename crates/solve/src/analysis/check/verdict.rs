//! Three verdicts on a store, by the question that each answers:
//!
//! ```text
//! integrity     is it what was written?   files, table, manifest, columns, range, diagonal, all parts there
//! conservation  does energy add up?       weights, visible, sky, reciprocity with a bound
//! quality       is it good enough?        closure error, blocked share, rows that look at backs, no entries, winding
//! ```
//!
//! Integrity and conservation fail. Quality fails where a bound was asked for, and is doubtful where a row's closure
//! error or the reciprocity residual is above the tolerance of the run ([`LIMIT`] without one), more than [`BLOCKED`] of
//! the view is blocked, or more than [`WARNED_ROWS`] of the rows look at backs with more than [`WARNED`] of their view.

use super::{Check, CheckReport, Failure};
use serde::Serialize;

/// Closure error of a row, and reciprocity residual, from which on the quality is doubtful, where neither a bound nor a
/// tolerance was asked for. A choice: less doubts what a default run has in rows near corners, more says nothing of
/// factors that are a twentieth off.
pub const LIMIT: f64 = 0.02;
/// Mean blocked share from which on the quality is doubtful.
pub const BLOCKED: f64 = 0.01;
/// Blocked share of a row from which on `compute` warns of it.
pub const WARNED: f64 = 0.5;
/// Share of rows that look at backs from which on the quality is doubtful. Floors under furniture are below it.
pub const WARNED_ROWS: f64 = 0.01;

/// The question that a verdict answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// Files and structure are those that were written.
    Integrity,
    /// All that leaves a patch is accounted for.
    Conservation,
    /// Form factors are near enough to be used.
    Quality,
}

impl Check {
    /// The subject that it belongs to.
    pub fn subject(self) -> Subject {
        match self {
            Self::Complete
            | Self::Files
            | Self::Manifest
            | Self::Table
            | Self::Range
            | Self::Columns
            | Self::Diagonal => Subject::Integrity,
            Self::Weights | Self::Visible | Self::Passed | Self::Reciprocity | Self::Sky => Subject::Conservation,
            Self::Closure | Self::Escaped | Self::Entries | Self::Winding => Subject::Quality,
        }
    }
}

/// The outcome of a verdict, from good to bad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It holds.
    #[default]
    Ok,
    /// No bound is broken, and a reader should look.
    Doubtful,
    /// Parts are still to be computed; what is there holds.
    Unfinished,
    /// A law or a bound is broken.
    Failed,
}

/// A reason to doubt the quality though no bound is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Doubt {
    /// [`Quality::closure_rows`] is above 0.
    Closure,
    /// The reciprocity residual is above [`Quality::reciprocity_limit`].
    Reciprocity,
    /// [`CheckReport::blocked`] is above [`BLOCKED`].
    Blocked,
    /// [`Quality::warned_rows`] is above [`WARNED_ROWS`] of the rows.
    Warned,
}

/// A verdict and its reasons.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// The outcome.
    pub state: State,
    /// The failed checks.
    pub failed: Vec<Check>,
    /// Reasons to doubt it besides.
    pub doubts: Vec<Doubt>,
}

/// The verdicts on a store.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdicts {
    /// Files and structure.
    pub integrity: Verdict,
    /// Sums of weights, the sky's sums, reciprocity against a bound.
    pub conservation: Verdict,
    /// Closure, blocked share, rows warned of.
    pub quality: Verdict,
}

impl Verdicts {
    /// Judges a finished report.
    pub(super) fn of(found: &CheckReport) -> Self {
        Self {
            integrity: by_failures(&found.failures, Subject::Integrity),
            conservation: by_failures(&found.failures, Subject::Conservation),
            quality: quality(found),
        }
    }

    /// The verdicts in order, with their subjects.
    pub fn each(&self) -> [(Subject, &Verdict); 3] {
        [
            (Subject::Integrity, &self.integrity),
            (Subject::Conservation, &self.conservation),
            (Subject::Quality, &self.quality),
        ]
    }

    /// Returns whether all three are [`State::Ok`].
    pub fn are_ok(&self) -> bool {
        self.each().iter().all(|(_, verdict)| verdict.state == State::Ok)
    }
}

/// The counts from which quality is judged, besides bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quality {
    /// Closure error from which on a row is doubtful: the bound asked for, the run's tolerance, or [`LIMIT`].
    pub closure_limit: f64,
    /// Rows beyond it.
    pub closure_rows: u64,
    /// Reciprocity residual from which on the matrix is doubtful: the bound asked for, or twice the run's
    /// tolerance or [`LIMIT`], as either of two readings may be off by as much, or three standard errors of both
    /// readings where these are more.
    pub reciprocity_limit: f64,
    /// Rows of which more than [`WARNED`] is blocked.
    pub warned_rows: u64,
}

fn by_failures(failures: &[Failure], subject: Subject) -> Verdict {
    let mut verdict = Verdict::default();
    for failure in failures.iter().filter(|failure| failure.check.subject() == subject) {
        let state = if failure.check == Check::Complete {
            State::Unfinished
        } else {
            State::Failed
        };
        verdict.state = verdict.state.max(state);
        verdict.failed.push(failure.check);
    }
    verdict
}

fn quality(found: &CheckReport) -> Verdict {
    let mut verdict = by_failures(&found.failures, Subject::Quality);
    let is_told = |check| found.failures.iter().any(|failure| failure.check == check);
    let closes = found.quality.closure_rows == 0 || is_told(Check::Closure);
    let is_reciprocal = found.reciprocity.residual <= found.quality.reciprocity_limit || is_told(Check::Reciprocity);
    verdict.doubts = [
        (Doubt::Closure, !closes),
        // Also NaN.
        (Doubt::Reciprocity, !is_reciprocal),
        (Doubt::Blocked, found.blocked > BLOCKED),
        (
            Doubt::Warned,
            found.quality.warned_rows as f64 > WARNED_ROWS * found.closure.rows as f64,
        ),
    ]
    .into_iter()
    .filter_map(|(doubt, holds)| holds.then_some(doubt))
    .collect();
    if !verdict.doubts.is_empty() {
        verdict.state = verdict.state.max(State::Doubtful);
    }
    verdict
}
