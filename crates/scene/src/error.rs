//! The one error type of this crate: file and line first, then the reason, then the next step.

use crate::NoRoom;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why a scene could not be read or cut into patches.
#[derive(Debug)]
pub struct Error {
    /// The file, if the scene came from one.
    pub path: Option<PathBuf>,
    /// Line in the file from 1, for text formats.
    pub line: Option<u64>,
    /// The defect.
    pub kind: ErrorKind,
}

/// The defect, without its place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The file could not be opened or read.
    #[error("{}", unreadable(.0))]
    Io(std::io::Error),
    /// The bytes break the format; the message names the thing and the reason.
    #[error("{0}")]
    Malformed(String),
    /// Legal input that this crate does not read; the message gives the alternative.
    #[error("{0}")]
    Unsupported(String),
    /// The file holds no triangle.
    #[error("holds no triangle; a scene needs at least one face with three corners")]
    Empty,
    /// More patches than ids, or than memory could hold; the message names the count.
    #[error("{0}")]
    TooLarge(String),
    /// More than a file of its size may become; [`ReadOptions::allow_large`](crate::ReadOptions) lifts the limit.
    #[error("{0}")]
    OverLimit(String),
    /// More memory than is left.
    #[error("{0}")]
    NoRoom(NoRoom),
}

/// Why a file could not be read, as the end of a sentence; a reader's own words where it has some.
fn unreadable(error: &std::io::Error) -> String {
    match error.kind() {
        _ if error.get_ref().is_some() => format!("cannot be read: {error}"),
        std::io::ErrorKind::NotFound => "does not exist".to_owned(),
        _ => format!("cannot be read: {error}"),
    }
}

impl Error {
    /// An error without a place; see [`Error::at`] and [`Error::in_file`].
    pub fn new(kind: ErrorKind) -> Self {
        Self {
            path: None,
            line: None,
            kind,
        }
    }

    /// A malformed-input error without a place.
    pub fn malformed(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Malformed(message.into()))
    }

    /// An unsupported-input error without a place.
    pub fn unsupported(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported(message.into()))
    }

    /// Sets the line (from 1).
    #[must_use]
    pub fn at(mut self, line: u64) -> Self {
        self.line = Some(line);
        self
    }

    /// Sets the file, unless the error already names one.
    #[must_use]
    pub fn in_file(mut self, path: &Path) -> Self {
        self.path.get_or_insert_with(|| path.to_owned());
        self
    }
}

impl From<NoRoom> for Error {
    fn from(refused: NoRoom) -> Self {
        Self::new(ErrorKind::NoRoom(refused))
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.path, self.line) {
            (Some(path), Some(line)) => write!(f, "{}:{line}: {}", path.display(), self.kind),
            (Some(path), None) => write!(f, "{}: {}", path.display(), self.kind),
            (None, Some(line)) => write!(f, "line {line}: {}", self.kind),
            (None, None) => write!(f, "{}", self.kind),
        }
    }
}

// The kind's text is part of this error's own, so the source begins beneath it.
impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(&self.kind)
    }
}
