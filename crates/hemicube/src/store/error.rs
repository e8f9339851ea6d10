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
        /// What was being done, as a past participle: `read`, `written`, `created`…
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
        /// The file that was being written. Its temporary file is gone.
        path: PathBuf,
        /// The size that the file would have had.
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
        /// The file that was asked for; nothing was written.
        path: PathBuf,
        /// The size that the file would have.
        wanted: u64,
        /// What is free.
        available: u64,
    },
    /// Something that is no store lies where one was to be written.
    #[error("`{}` {reason}", path.display())]
    InTheWay {
        /// The file or directory.
        path: PathBuf,
        /// What it is, and what to do.
        reason: &'static str,
    },
    /// A store or a file lies there already.
    #[error("`{}` exists; `--overwrite` replaces it", path.display())]
    Exists {
        /// The store or file.
        path: PathBuf,
    },
    /// Somebody else is writing the store.
    #[error(
        "`{}` is being written by {holder}; wait for it, or end it: what it computed stays, and the next run goes on there",
        path.display()
    )]
    Locked {
        /// The store.
        path: PathBuf,
        /// Who it is, as far as is known.
        holder: String,
    },
    /// A store lies there that another run makes: of another scene, with other settings or by another version.
    #[error("`{}` holds another matrix: {difference}", path.display())]
    OtherRun {
        /// The store.
        path: PathBuf,
        /// What differs, theirs and ours.
        difference: String,
    },
    /// The bytes are not what the format allows.
    #[error("`{}` {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The thing and what is wrong with it.
        reason: String,
    },
    /// Legal, but not read or written by this version.
    #[error("`{}` {reason}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The thing, and what to do instead.
        reason: String,
    },
    /// A file's bytes have changed since they were written.
    #[error(
        "`{}` has changed since it was written: its BLAKE3 checksum is {found}, the manifest says {expected}; compute it \
         again or restore it from a copy",
        path.display()
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// What the manifest says.
        expected: String,
        /// What the bytes give.
        found: String,
    },
    /// What was handed to the writer cannot be stored; nothing was written.
    #[error("`{}` was not written: {reason}", path.display())]
    Refused {
        /// The file that would have been written.
        path: PathBuf,
        /// The thing and what is wrong with it.
        reason: String,
    },
    /// Parts of the matrix are not there.
    #[error(
        "`{}` is incomplete: {present} of {expected} parts are there; compute the rest, or ask for an incomplete matrix",
        path.display()
    )]
    Incomplete {
        /// The store.
        path: PathBuf,
        /// Parts that are there.
        present: u32,
        /// Parts of the whole.
        expected: u32,
    },
    /// Two matrices cannot be compared.
    #[error("`{}` cannot be compared with `{}`: {reason}", path.display(), reference.display())]
    Incomparable {
        /// The matrix.
        path: PathBuf,
        /// What it was to be compared with.
        reference: PathBuf,
        /// Why not.
        reason: String,
    },
}

/// The result of reading or writing a store, a matrix file or an export.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    pub(crate) fn unsupported(path: &Path, reason: impl Into<String>) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    pub(crate) fn refused(path: &Path, reason: impl Into<String>) -> Self {
        Self::Refused {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    /// A system error while a file was being read, opened or created. An early end means a truncated file.
    pub(crate) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
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
