//! Progress of a run: a bar on standard error, on terminals only; a progress file, for schedulers and for later; and a
//! `tracing` span of each stage.

use crate::args::Talk;
use crate::report::SCHEMA;
use anyhow::{Context, Result};
use hemicube::driver::compute::Progress;
use hemicube::store::TemporaryFile;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::ffi::OsStr;
use std::fmt::Write;
use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tracing::span::EnteredSpan;

/// A bar by rows, or nothing.
#[derive(Debug)]
pub(crate) struct Bar {
    bar: Option<ProgressBar>,
    /// Rows of an earlier run.
    kept: u64,
}

fn is_watched(talk: Talk) -> bool {
    let is_dumb = is_dumb(std::env::var_os("TERM").as_deref());
    !talk.quiet && !is_dumb && std::io::stderr().is_terminal()
}

/// Returns whether a kind of terminal can only write lines, without moving the cursor.
pub(crate) fn is_dumb(term: Option<&OsStr>) -> bool {
    match term {
        Some(term) => term.is_empty() || term == "dumb",
        // Windows has none.
        None => !cfg!(windows),
    }
}

impl Bar {
    /// A bar of `row_count` rows with rate and time left, if standard error is a terminal. `kept` rows are done.
    pub(crate) fn rows(talk: Talk, row_count: u64, kept: u64) -> Self {
        let bar = Self::counting_from(talk, row_count, kept, "rows");
        if let Some(bar) = &bar.bar {
            bar.set_position(kept);
            bar.reset_eta();
        }
        bar
    }

    /// A bar that counts `what`.
    pub(crate) fn counting(talk: Talk, count: u64, what: &str) -> Self {
        Self::counting_from(talk, count, 0, what)
    }

    fn counting_from(talk: Talk, count: u64, kept: u64, what: &str) -> Self {
        if !is_watched(talk) {
            return Self { bar: None, kept: 0 };
        }
        let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::stderr_with_hz(10));
        let template = format!("{{wide_bar}} {{human_pos}}/{{human_len}} {what}, {{rate}}/s, {{left}} left");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            let rate = |state: &ProgressState, out: &mut dyn Write| {
                let _ = write!(out, "{:.0}", state.per_sec());
            };
            let left = move |state: &ProgressState, out: &mut dyn Write| {
                let (done, count) = (state.pos(), state.len().unwrap_or(0));
                let _ = match seconds_left(
                    state.elapsed().as_secs_f64(),
                    done.saturating_sub(kept),
                    count - done.min(count),
                ) {
                    Some(seconds) => write!(
                        out,
                        "{:#}",
                        HumanDuration(Duration::from_secs_f64(seconds.min(MOST_SECONDS)))
                    ),
                    None => write!(out, "?"),
                };
            };
            bar.set_style(
                style
                    .progress_chars("=> ")
                    .with_key("rate", rate)
                    .with_key("left", left),
            );
        }
        Self { bar: Some(bar), kept }
    }

    /// A spinner with a word on the current task.
    pub(crate) fn spinner(talk: Talk, what: &str) -> Self {
        if !is_watched(talk) {
            return Self { bar: None, kept: 0 };
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style.tick_chars("|/-\\ "));
        }
        bar.set_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        Self {
            bar: Some(bar),
            kept: 0,
        }
    }

    /// Moves the bar to a number.
    pub(crate) fn at(&self, done: u64) {
        if let Some(bar) = &self.bar {
            bar.set_position(done);
        }
    }

    /// Says how far it is.
    pub(crate) fn message(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(text.to_owned());
        }
    }

    /// Moves the bar.
    pub(crate) fn show(&self, progress: Progress) {
        if let Some(bar) = &self.bar {
            bar.set_position(self.kept + progress.rows);
        }
    }
}

/// Longest time left that a bar shows.
const MOST_SECONDS: f64 = 1e9;

/// Seconds left at the mean rate since the start. They grow while nothing is done: a slow row is no reason to foretell
/// that the next ones are as fast as those before.
fn seconds_left(elapsed: f64, done: u64, left: u64) -> Option<f64> {
    (done > 0).then(|| elapsed * left as f64 / done as f64)
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// Interval between two writes of the progress file.
const WRITTEN_EVERY: Duration = Duration::from_secs(1);

/// Content of the progress file.
#[derive(Clone, Debug, Default, Serialize)]
struct Reached {
    schema: u32,
    process: u32,
    /// The current stage, or the end: `done`, `interrupted`, `failed`.
    stage: &'static str,
    rows: u64,
    /// Rows of an earlier run among them.
    rows_kept: u64,
    row_count: u64,
    /// Entries of this run's rows.
    entries: u64,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds_left: Option<f64>,
}

/// The current stage of a run, for the progress file and for `tracing`.
#[derive(Debug)]
pub(crate) struct Status {
    file: Option<PathBuf>,
    started: Instant,
    reached: RefCell<Reached>,
    written: Cell<Option<Instant>>,
}

impl Status {
    /// Opens the progress file, if there is to be one.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn open(file: Option<&Path>) -> Result<Self> {
        let status = Self {
            file: file.map(Path::to_owned),
            started: Instant::now(),
            reached: RefCell::new(Reached {
                schema: SCHEMA,
                process: std::process::id(),
                stage: "start",
                ..Reached::default()
            }),
            written: Cell::new(None),
        };
        if let Some(file) = file {
            status
                .write()
                .with_context(|| format!("`{}` cannot be written", file.display()))?;
        }
        Ok(status)
    }

    /// A stage begins, and ends when this is dropped.
    pub(crate) fn stage(&self, name: &'static str) -> Stage<'_> {
        self.reached.borrow_mut().stage = name;
        self.tell();
        Stage {
            status: self,
            started: Instant::now(),
            _span: tracing::info_span!("run", stage = name).entered(),
        }
    }

    /// Begins the stage of computing rows.
    pub(crate) fn rows(&self, row_count: u64, kept: u64) -> Stage<'_> {
        {
            let mut reached = self.reached.borrow_mut();
            (reached.rows, reached.rows_kept, reached.row_count) = (kept, kept, row_count);
        }
        self.stage("rows")
    }

    /// The run is over.
    pub(crate) fn end(&self, how: &'static str) {
        {
            let mut reached = self.reached.borrow_mut();
            reached.stage = how;
            reached.seconds_left = None;
        }
        self.tell();
    }

    /// Writes the file. A failed write is left to the next: the store reports a full disk.
    fn tell(&self) {
        if let Err(error) = self.write() {
            tracing::debug!(%error, "the progress file cannot be written");
        }
    }

    fn write(&self) -> std::io::Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        self.written.set(Some(Instant::now()));
        let mut reached = self.reached.borrow_mut();
        reached.seconds = self.started.elapsed().as_secs_f64();
        let text = serde_json::to_string(&*reached)?;
        // Written under another name first, so that no reader finds half of it. Not synced: it is of this moment.
        let mut temporary = TemporaryFile::create(file).map_err(std::io::Error::other)?;
        temporary.write_all((text + "\n").as_bytes())?;
        temporary.rename()
    }
}

/// A stage, until it is dropped.
#[derive(Debug)]
pub(crate) struct Stage<'a> {
    status: &'a Status,
    started: Instant,
    _span: EnteredSpan,
}

impl Stage<'_> {
    /// Updates the number of rows.
    pub(crate) fn show(&self, progress: Progress) {
        if self.status.file.is_none() {
            return;
        }
        {
            let mut reached = self.status.reached.borrow_mut();
            reached.rows = reached.rows_kept + progress.rows;
            reached.entries = progress.entries;
            let left = progress.row_count.saturating_sub(progress.rows);
            reached.seconds_left = seconds_left(self.started.elapsed().as_secs_f64(), progress.rows, left);
        }
        let is_due = self.status.written.get().is_none_or(|at| at.elapsed() >= WRITTEN_EVERY);
        if is_due || progress.rows == progress.row_count {
            self.status.tell();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_grows_while_a_row_is_slow() {
        assert_eq!(seconds_left(1.0, 0, 10), None);
        assert_eq!(seconds_left(10.0, 5, 10), Some(20.0));
        assert_eq!(seconds_left(15.0, 5, 10), Some(30.0));
        assert_eq!(seconds_left(15.0, 15, 0), Some(0.0));
    }

    #[test]
    fn terminals_that_can_write_lines_only() {
        assert!(is_dumb(Some("dumb".as_ref())) && is_dumb(Some("".as_ref())));
        assert!(!is_dumb(Some("xterm-256color".as_ref())));
        assert_eq!(is_dumb(None), !cfg!(windows));
    }
}
