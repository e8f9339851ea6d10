//! Messages on standard error. Libraries and the stages of a run log through `tracing`, filtered by `HEMICUBE_LOG`.

use crate::args::{Color, Talk};
use crate::escape::{shown, shown_lines};
use crate::style;
use std::io::Write;
use tracing::Level;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// Begins to log, once.
pub(crate) fn start(talk: Talk) {
    style::choose(talk.color);
    let filter = EnvFilter::try_from_env("HEMICUBE_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .with_span_events(FmtSpan::NEW | FmtSpan::CLOSE)
        .without_time()
        .init();
}

impl Talk {
    /// Silence, for work done a second time. Nobody can ask for both.
    pub(crate) const SILENT: Self = Self {
        quiet: true,
        verbose: true,
        color: Color::Never,
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
    // Messages are a courtesy: a closed standard error is no reason to stop.
    let mut stderr = style::stderr();
    let _ = match level {
        Level::WARN => writeln!(stderr, "{} {}", style::WARNING.of("warning:"), shown_lines(text)),
        _ => writeln!(stderr, "{}", shown_lines(text)),
    };
}

/// Acknowledges the first interrupt. A terminal has shown `^C` on the line.
pub(crate) fn interrupted(text: &str) {
    let _ = writeln!(std::io::stderr(), "\n{text}");
}

/// Reports the error that ends the program, and the next step.
pub(crate) fn error(message: &str, hint: Option<&str>) {
    // A closed standard error leaves no way to report it.
    let mut stderr = style::stderr();
    let _ = writeln!(stderr, "{} {}", style::ERROR.of("error:"), shown_lines(message));
    if let Some(hint) = hint {
        let _ = writeln!(stderr, "{} {}", style::HINT.of("hint:"), shown(hint));
    }
}
