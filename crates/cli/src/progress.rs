//! The progress bar: on standard error, and only where somebody watches.

use crate::args::Talk;
use hemicube::compute::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::io::IsTerminal;
use std::time::Duration;

/// A bar by rows, or nothing.
#[derive(Debug)]
pub(crate) struct Bar(Option<ProgressBar>);

fn is_watched(talk: Talk) -> bool {
    !talk.quiet && !talk.no_progress && std::io::stderr().is_terminal()
}

impl Bar {
    /// A bar of `row_count` rows with rate and time left, if standard error is a terminal.
    pub(crate) fn rows(talk: Talk, row_count: u64) -> Self {
        Self::counting(talk, row_count, "rows")
    }

    /// The same of something else.
    pub(crate) fn counting(talk: Talk, count: u64, what: &str) -> Self {
        if !is_watched(talk) {
            return Self(None);
        }
        let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::stderr_with_hz(10));
        let template = format!("{{wide_bar}} {{human_pos}}/{{human_len}} {what}, {{rate}}/s, {{eta}} left");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            let rate = |state: &ProgressState, out: &mut dyn Write| {
                let _ = write!(out, "{:.0}", state.per_sec());
            };
            bar.set_style(style.progress_chars("=> ").with_key("rate", rate));
        }
        Self(Some(bar))
    }

    /// A sign of life with a word of what is being done.
    pub(crate) fn spinner(talk: Talk, what: &str) -> Self {
        if !is_watched(talk) {
            return Self(None);
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style.tick_chars("|/-\\ "));
        }
        bar.set_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(Some(bar))
    }

    /// Moves the bar.
    pub(crate) fn show(&self, progress: Progress) {
        if let Some(bar) = &self.0 {
            bar.set_position(progress.rows);
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = self.0.take() {
            bar.finish_and_clear();
        }
    }
}
