//! Why a store, a matrix file or an export could not be read or written: the path first, then the reason, then the next
//! step.

use std::io;
use std::path::{Path, PathBuf};

/// Why a store, a matrix file or an export could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("`{}` cannot be {action}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The failed action, as a past participle: `read`, `written`, `created`…
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The disk, or the user's share of it, is full.
    #[error(
        "`{}` cannot be written: it needs {wanted} bytes and the disk is full; make room or choose another disk",
        path.display()
    )]
    NoSpace {
        /// The file being written. Its temporary file is removed.
        path: PathBuf,
        /// The file's final size.
        wanted: u64,
        /// The system's reason.
        source: io::Error,
    },
    /// The size of an export is known before it is written, and the disk has less.
    #[error(
        "`{}` would take {wanted} bytes and its disk has {available} left; make room or choose another disk",
        path.display()
    )]
    DiskTooSmall {
        /// The file asked for; nothing was written.
        path: PathBuf,
        /// The file's size.
        wanted: u64,
        /// Free bytes.
        available: u64,
    },
    /// Something other than a store is at the place of the store.
    #[error("`{}` {reason}", path.display())]
    InTheWay {
        /// The file or directory.
        path: PathBuf,
        /// Its kind, and the next step.
        reason: &'static str,
    },
    /// A store or a file lies there already.
    #[error("`{}` exists", path.display())]
    Exists {
        /// The store or file.
        path: PathBuf,
    },
    /// Somebody else is writing the store.
    #[error(
        "`{}` is being written by {holder}; wait for it, or end it: what it computed stays, and the next run goes on \
         there",
        path.display()
    )]
    Locked {
        /// The store.
        path: PathBuf,
        /// The holder of the lock, as far as it is known.
        holder: String,
    },
    /// A store of another run is there: of another scene, with other settings or by another version.
    #[error("`{}` holds another matrix: {difference}", path.display())]
    OtherRun {
        /// The store.
        path: PathBuf,
        /// The difference, theirs and ours.
        difference: String,
    },
    /// The bytes violate the format.
    #[error("`{}` {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The thing and its defect.
        reason: String,
    },
    /// A line of a text file violates the format.
    #[error("{}:{line}: {reason}", path.display())]
    MalformedLine {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: u64,
        /// The defect, and the next step.
        reason: String,
    },
    /// Legal, but not read or written by this version.
    #[error("`{}` {reason}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The thing, and the alternative.
        reason: String,
    },
    /// A file's bytes have changed since they were written.
    #[error(
        "`{}` has changed since it was written: its BLAKE3 checksum is {found}, the manifest says {expected}; compute \
         it again or restore it from a copy",
        path.display()
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// The manifest's checksum.
        expected: String,
        /// The bytes' checksum.
        found: String,
    },
    /// The writer was given something that cannot be stored; nothing was written.
    #[error("`{}` was not written: {reason}", path.display())]
    Refused {
        /// The file that was not written.
        path: PathBuf,
        /// The thing and its defect.
        reason: String,
    },
    /// Parts of the matrix are not there.
    #[error(
        "`{}` is incomplete: {present} of {expected} parts are there; compute the rest, or ask for an incomplete \
         matrix",
        path.display()
    )]
    Incomplete {
        /// The store.
        path: PathBuf,
        /// Number of parts present.
        present: u32,
        /// Parts of the whole.
        expected: u32,
    },
    /// Two matrices cannot be compared.
    #[error("`{}` cannot be compared with `{}`: {reason}", path.display(), reference.display())]
    Incomparable {
        /// The matrix.
        path: PathBuf,
        /// The matrix compared with.
        reference: PathBuf,
        /// Why not.
        reason: String,
    },
}

/// The result of reading or writing a store, a matrix file or an export.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    #[doc(hidden)]
    pub fn malformed(path: &Path, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    #[doc(hidden)]
    pub fn unsupported(path: &Path, reason: impl Into<String>) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    #[doc(hidden)]
    pub fn refused(path: &Path, reason: impl Into<String>) -> Self {
        Self::Refused {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// A system error while a file was being read, opened or created. An early end means a truncated file.
    #[doc(hidden)]
    pub fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::UnexpectedEof => Self::malformed(path, "is truncated"),
            _ => Self::Io {
                path: path.to_owned(),
                action,
                source,
            },
        }
    }

    /// A system error while a file of `wanted` bytes was being written.
    pub fn write(path: &Path, wanted: u64, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => Self::NoSpace {
                path: path.to_owned(),
                wanted,
                source,
            },
            _ => Self::Io {
                path: path.to_owned(),
                action: "written",
                source,
            },
        }
    }
}
