//! Files written whole or not at all, and the errors of writing them.

use crate::{Colors, Named, PatchFormat, PatchResults, listed};
use hemicube_store::{self as store, DurableFile};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The store could not be read, or the file not created.
    #[error(transparent)]
    Store(#[from] store::Error),
    /// The extension names no format.
    #[error("`{}` does not say which format is wanted; end it in {}", path.display(), alternatives(known))]
    Format {
        /// The file asked for.
        path: PathBuf,
        /// The extensions and the label of each format.
        known: Vec<Named>,
    },
    /// The format's writer is not compiled in.
    #[error("this program was built without the feature `{feature}`")]
    NotBuilt {
        /// The feature of `hemicube-export`.
        feature: &'static str,
    },
    /// Columns make no table.
    #[error("the columns make no table: {0}")]
    Table(String),
    /// The format needs corners or colours, and none were given.
    #[error("`{}` cannot be written without {what}", path.display())]
    Missing {
        /// The file asked for.
        path: PathBuf,
        /// The missing thing.
        what: &'static str,
    },
    /// The result is too large for the format.
    #[error("`{}` cannot be written: {reason}", path.display())]
    TooLarge {
        /// The file asked for.
        path: PathBuf,
        /// The limit, and a format without it.
        reason: String,
    },
    /// The number of patches differs from the matrix's.
    #[error("{what} is of {found} patches, and the matrix of {expected}")]
    OtherPatches {
        /// The thing with the other number.
        what: String,
        /// Its number.
        found: usize,
        /// The matrix's number.
        expected: usize,
    },
    /// The solution has too many right-hand sides for columns.
    #[error(
        "the solution `{solution}` has {rows} right-hand sides, more than the {most} that become columns; name another \
         solution, or solve into an `.npz` file"
    )]
    TooManyRightHandSides {
        /// Its name.
        solution: String,
        /// Its number.
        rows: u64,
        /// The limit.
        most: u64,
    },
    /// The matrix lacks what the solver needs.
    #[error("`{}` has no matrix for {program}: {reason}", store.display())]
    Unfit {
        /// The store.
        store: PathBuf,
        /// The solver.
        program: &'static str,
        /// The thing and the bound.
        reason: String,
        /// The next step.
        next: UnfitStep,
    },
    /// Writing was cancelled; nothing is left of the file.
    #[error("`{}` was not written: it was interrupted", path.display())]
    Interrupted {
        /// The file asked for.
        path: PathBuf,
    },
}

/// What helps against [`Error::Unfit`]; front ends have their own words for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UnfitStep {
    /// In words.
    Words(String),
    /// Name the zone or enclosure.
    NameZone,
    /// Compute each zone by itself, and export it with its own name.
    ZoneByZone,
    /// Compute rows and columns of the same patches.
    SameRowsAndColumns,
    /// Compute without mirrors and panes; or ask for what surfaces exchange by them.
    WithoutMirrors,
    /// Balance the matrix until its rows close.
    Close,
    /// Balance the matrix until pairs agree.
    Reciprocate,
    /// See what the matrix has.
    Check,
    /// Close the scene: see where its holes are.
    CloseScene,
    /// Compute sky rows beside the matrix.
    ComputeSky,
    /// Take surfaces by objects or materials, which have names.
    ByName,
    /// Cut facets that others cover in part, leave them out, or turn those that face inwards.
    CutOrExclude,
}

impl From<&str> for UnfitStep {
    fn from(words: &str) -> Self {
        Self::Words(words.to_owned())
    }
}

impl From<String> for UnfitStep {
    fn from(words: String) -> Self {
        Self::Words(words)
    }
}

/// Formats listed for a message: `.txt` or `.dat` (MATLAB's `spconvert`), `.npy` (dense) or `.parquet` (triplets).
fn alternatives(known: &[Named]) -> String {
    let mut words = listed(known.iter().copied(), "`");
    let last = words.pop().unwrap_or_default();
    format!("{} or {last}", words.join(", "))
}

/// The result of writing a file.
pub type Result<T> = std::result::Result<T, Error>;

/// Options of writing a file.
#[derive(Clone, Copy, Debug)]
pub struct WriteOptions<'a> {
    /// Replace an existing file.
    pub overwrite: bool,
    /// Set by another thread to cancel.
    pub cancel: &'a AtomicBool,
}

/// A file with writing that can be cancelled.
pub(crate) struct Cancellable<'a> {
    file: DurableFile,
    cancel: &'a AtomicBool,
}

impl Cancellable<'_> {
    fn check(&self) -> io::Result<()> {
        if self.cancel.load(Ordering::Relaxed) {
            return Err(io::Error::other("cancelled"));
        }
        Ok(())
    }
}

impl Write for Cancellable<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.check()?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Cancellable<'_> {
    fn seek(&mut self, target: SeekFrom) -> io::Result<u64> {
        self.file.seek(target)
    }
}

impl<'a> Cancellable<'a> {
    /// Creates the file for `path`; it gets that name when it is committed.
    pub(crate) fn create(path: &Path, options: WriteOptions<'a>) -> Result<Self> {
        match std::fs::symlink_metadata(path) {
            Ok(metadata) if metadata.is_dir() => {
                return Err(Error::Store(store::Error::InTheWay {
                    path: path.to_owned(),
                    reason: "is a directory; choose another name",
                }));
            }
            Ok(_) if !options.overwrite => return Err(Error::Store(store::Error::Exists { path: path.to_owned() })),
            // What else is wrong with it, creating the file says.
            _ => {}
        }
        let file = DurableFile::create(path)?;
        let cancel = options.cancel;
        Ok(Self { file, cancel })
    }

    /// Puts the file in its place; returns its size. A cancelled one leaves nothing.
    pub(crate) fn commit(
        written: Result<Self>,
        path: &Path,
        options: WriteOptions<'_>,
        on_write: impl Fn(io::Error) -> Error,
    ) -> Result<u64> {
        if options.cancel.load(Ordering::Relaxed) {
            return Err(Error::Interrupted { path: path.to_owned() });
        }
        written?.file.commit().map_err(&on_write)?;
        Ok(std::fs::metadata(path).map_err(&on_write)?.len())
    }
}

/// Writes a whole file, or none. Returns its size.
pub(crate) fn write_file<'a>(
    path: &Path,
    options: WriteOptions<'a>,
    write: impl FnOnce(Cancellable<'a>) -> Result<Cancellable<'a>>,
) -> Result<u64> {
    let file = Cancellable::create(path, options)?;
    Cancellable::commit(write(file), path, options, |error| on_write(path, error))
}

pub(crate) fn on_write(path: &Path, source: io::Error) -> Error {
    Error::Store(store::Error::Io {
        path: path.to_owned(),
        action: "written",
        source,
    })
}

pub(crate) fn too_large(path: &Path, reason: &str) -> Error {
    Error::TooLarge {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

impl PatchResults {
    /// The corners of the patches, for a file in need of them.
    pub(crate) fn corners_for(&self, path: &Path) -> Result<&[[[f64; 3]; 3]]> {
        self.corners.as_deref().ok_or_else(|| Error::Missing {
            path: path.to_owned(),
            what: "the scene that the patches are of",
        })
    }

    /// The colours of the patches, for a file in need of them.
    pub(crate) fn colors_for(&self, path: &Path) -> Result<&Colors> {
        self.colors.as_ref().ok_or_else(|| Error::Missing {
            path: path.to_owned(),
            what: "colours",
        })
    }
}

/// Writes the results of each patch to `path`; returns the file's size in bytes.
///
/// # Errors
/// When the format needs corners or colours that are not there, or cannot hold as many patches; when the file exists
/// and is not to be replaced, cannot be written, or was cancelled.
pub fn write_patches(
    results: &PatchResults,
    path: &Path,
    format: PatchFormat,
    options: WriteOptions<'_>,
) -> Result<u64> {
    format.writer()?.write(results, path, options)
}
