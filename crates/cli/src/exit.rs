//! The end of the program: exit codes, the one error message, and Ctrl-C.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// End of a command without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// The task is complete.
    Done,
    /// A check or a comparison did not hold.
    NotHeld,
    /// Ctrl-C; finished rows are kept.
    Interrupted,
}

/// Wrong usage, unreadable input, or failed output.
const FAILED: u8 = 2;
pub(crate) const INTERRUPTED: u8 = 130;

impl From<Exit> for u8 {
    fn from(exit: Exit) -> Self {
        match exit {
            Exit::Done => 0,
            Exit::NotHeld => 1,
            Exit::Interrupted => INTERRUPTED,
        }
    }
}

/// An error with its next step, on a line of its own.
#[derive(Debug)]
struct Hinted {
    error: anyhow::Error,
    hint: String,
}

impl fmt::Display for Hinted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.error, f)
    }
}

impl std::error::Error for Hinted {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.error.source()
    }
}

/// `error`, with the next step.
pub(crate) fn hinted(error: anyhow::Error, hint: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(Hinted {
        error,
        hint: hint.into(),
    })
}

/// Standard output was closed by its reader: as successful as writing all of it.
#[derive(Debug)]
pub(crate) struct OutputClosed;

impl fmt::Display for OutputClosed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("standard output was closed")
    }
}

impl std::error::Error for OutputClosed {}

/// Joins the chain of an error. Repetitions by libraries that paste their source into their message are dropped.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        // Line ends of the program's own text stay; those in names from files are escaped.
        let has_lines = cause.is::<hemicube_host::OpenError>()
            || cause
                .downcast_ref::<Hinted>()
                .is_some_and(|hinted| hinted.error.is::<hemicube_host::OpenError>());
        let cause = match cause.to_string() {
            text if has_lines => text,
            text => crate::escape::shown(&text).into_owned(),
        };
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

/// The hint of an error, beneath its context: the program's own, otherwise what the library advises.
pub(crate) fn hint(error: &anyhow::Error) -> Option<String> {
    let hinted = error.chain().find_map(|cause| cause.downcast_ref::<Hinted>());
    match hinted {
        Some(hinted) => Some(hinted.hint.clone()),
        None => crate::advice::of_error(error),
    }
}

/// The exit code of what was run; an error is reported.
pub(crate) fn code(ended: anyhow::Result<Exit>) -> u8 {
    ended.map_or_else(|error| failed(&error), u8::from)
}

/// Reports the error, once, and returns its exit code.
pub(crate) fn failed(error: &anyhow::Error) -> u8 {
    if error.is::<OutputClosed>() {
        return Exit::Done.into();
    }
    crate::log::error(&message(error), hint(error).as_deref());
    FAILED
}

/// Set by the first Ctrl-C while rows are computed.
static CANCEL: AtomicBool = AtomicBool::new(false);
/// True while an [`InterruptGuard`] lives.
static FINISHING: AtomicBool = AtomicBool::new(false);
/// A directory to be removed if it stays empty.
static UNUSED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Makes Ctrl-C (and a request to terminate) end the program with code 130: at once, or, while an [`InterruptGuard`]
/// lives, after the current part. The second interrupt always ends it at once.
///
/// # Errors
/// When the system refuses the handler.
pub(crate) fn watch_interrupts() -> anyhow::Result<&'static AtomicBool> {
    ctrlc::set_handler(|| {
        if FINISHING.load(Ordering::SeqCst) && !CANCEL.swap(true, Ordering::SeqCst) {
            crate::log::interrupted("interrupted: finishing what is being computed; once more ends at once");
            return;
        }
        remove_unused();
        std::process::exit(INTERRUPTED.into());
    })?;
    Ok(&CANCEL)
}

/// Defers interrupts while it lives: the first one asks for an end, and the current work is finished.
#[must_use]
#[derive(Debug)]
pub(crate) struct InterruptGuard(());

impl InterruptGuard {
    pub(crate) fn new() -> Self {
        FINISHING.store(true, Ordering::SeqCst);
        Self(())
    }
}

impl Drop for InterruptGuard {
    fn drop(&mut self) {
        FINISHING.store(false, Ordering::SeqCst);
    }
}

/// Registers a directory made for a result that may never come.
pub(crate) fn made_for_later(directory: &Path) {
    *UNUSED.lock().unwrap_or_else(PoisonError::into_inner) = Some(directory.to_owned());
}

/// Removes the registered directory, if it is still empty.
pub(crate) fn remove_unused() {
    if let Some(directory) = UNUSED.lock().unwrap_or_else(PoisonError::into_inner).take() {
        // A directory in use is not empty, and stays.
        let _ = std::fs::remove_dir(directory);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::{Context, anyhow};

    #[derive(Debug)]
    struct Pasted(std::io::Error);

    impl fmt::Display for Pasted {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "disk: {}", self.0)
        }
    }

    impl std::error::Error for Pasted {
        fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
            Some(&self.0)
        }
    }

    #[test]
    fn a_chain_is_said_once() {
        let pasted = anyhow::Error::new(Pasted(std::io::Error::other("full"))).context("`x` was not written");
        assert_eq!(message(&pasted), "`x` was not written: disk: full");
    }

    #[test]
    fn a_name_makes_no_line() {
        let error = anyhow!("`x\nerror: made up\u{1b}[2J` is not read").context("opening");
        assert_eq!(message(&error), "opening: `x\\nerror: made up\\u{1b}[2J` is not read");
    }

    #[test]
    fn a_hint_is_found_beneath_context() {
        let error = Err::<(), _>(hinted(anyhow!("no"), "try yes"))
            .context("asking")
            .unwrap_err();
        assert_eq!(message(&error), "asking: no");
        assert!(error.chain().any(|cause| cause.downcast_ref::<Hinted>().is_some()));
    }
}
