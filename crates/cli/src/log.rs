//! Messages on standard error: lines for people, or JSON for programs. Libraries and the stages of a run log through
//! `tracing`, filtered by `HEMICUBE_LOG`.

use crate::args::{Color, LogFormat, Talk};
use crate::escape::{shown, shown_lines};
use crate::style;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::Level;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// True if messages are JSON. Before [`start`] they are not.
static JSON: AtomicBool = AtomicBool::new(false);

/// Target of messages in JSON, in place of a module.
const TARGET: &str = "hemicube";

/// Begins to log, once.
pub(crate) fn start(talk: Talk) {
    let is_json = talk.log_format == LogFormat::Json;
    JSON.store(is_json, Ordering::Relaxed);
    style::choose(talk.color);
    let level = match (talk.quiet, is_json) {
        (true, _) => "warn",
        // Own messages and stages; warnings only of the libraries.
        (false, true) => "warn,hemicube=info",
        (false, false) => "warn",
    };
    let filter = EnvFilter::try_from_env("HEMICUBE_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .with_span_events(FmtSpan::NEW | FmtSpan::CLOSE);
    if is_json {
        log.json().flatten_event(true).init();
    } else {
        log.without_time().init();
    }
}

impl Talk {
    /// Silence, for work done a second time. Nobody can ask for both.
    pub(crate) const SILENT: Self = Self {
        quiet: true,
        verbose: true,
        color: Color::Never,
        log_format: LogFormat::Text,
    };

    /// Informs the user.
    pub(crate) fn say(self, text: &str) {
        if !self.quiet {
            say(Level::INFO, text);
        }
    }

    /// Informs a user who asked for more.
    pub(crate) fn detail(self, text: &str) {
        if self.verbose && !self.quiet {
            say(Level::INFO, text);
        }
    }

    /// Warns the user, whatever `-q` says: results may be wrong.
    pub(crate) fn warn(self, text: &str) {
        if !self.is_silent() {
            say(Level::WARN, text);
        }
    }

    /// True for work done a second time.
    fn is_silent(self) -> bool {
        self.quiet && self.verbose
    }
}

/// Says a message.
fn say(level: Level, text: &str) {
    if JSON.load(Ordering::Relaxed) {
        match level {
            Level::ERROR => tracing::error!(target: TARGET, "{text}"),
            Level::WARN => tracing::warn!(target: TARGET, "{text}"),
            _ => tracing::info!(target: TARGET, "{text}"),
        }
        return;
    }
    // Messages are a courtesy: a closed standard error is no reason to stop.
    let mut stderr = style::stderr();
    let _ = match level {
        Level::WARN => writeln!(stderr, "{} {}", style::WARNING.of("warning:"), shown_lines(text)),
        _ => writeln!(stderr, "{}", shown_lines(text)),
    };
}

/// Acknowledges the first interrupt. A terminal has shown `^C` on the line.
pub(crate) fn interrupted(text: &str) {
    if JSON.load(Ordering::Relaxed) {
        say(Level::WARN, text);
    } else {
        let _ = writeln!(std::io::stderr(), "\n{text}");
    }
}

/// Reports the error that ends the program, and the next step.
pub(crate) fn error(message: &str, hint: Option<&str>) {
    if JSON.load(Ordering::Relaxed) {
        tracing::error!(target: TARGET, hint, "{message}");
        return;
    }
    // A closed standard error leaves no way to report it.
    let mut stderr = style::stderr();
    let _ = writeln!(stderr, "{} {}", style::ERROR.of("error:"), shown_lines(message));
    if let Some(hint) = hint {
        let _ = writeln!(stderr, "{} {}", style::HINT.of("hint:"), shown(hint));
    }
}
