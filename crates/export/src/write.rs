//! Which format, under which name, and that a file is whole.

use crate::{PatchResults, gltf, ply, table, vtk};
use hemicube::store::{self, DurableFile};
use serde::Serialize;
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
    /// The extension is that of no format of patches.
    #[error(
        "`{}` does not say which format is wanted; end it in `.vtp`, `.vtu` (ParaView), `.glb` (glTF), `.ply`, `.csv` or `.npz`",
        path.display()
    )]
    Format {
        /// The file that was asked for.
        path: PathBuf,
    },
    /// The format is one of places or colours, and none were given.
    #[error("`{}` cannot be written without {what}", path.display())]
    Missing {
        /// The file that was asked for.
        path: PathBuf,
        /// What there is none of.
        what: &'static str,
    },
    /// The result is too large for the format.
    #[error("`{}` cannot be written: {reason}", path.display())]
    TooLarge {
        /// The file that was asked for.
        path: PathBuf,
        /// What is too large, and what to write instead.
        reason: String,
    },
    /// Two things that were to be of the same patches are not.
    #[error("{what} is of {found} patches, and the matrix of {expected}")]
    OtherPatches {
        /// What does not fit.
        what: String,
        /// The number that it has.
        found: usize,
        /// The number that it should have.
        expected: usize,
    },
    /// A solution of thousands of right-hand sides is no table of patches.
    #[error(
        "the solution `{solution}` has {rows} right-hand sides, more than the {most} that become columns; name another \
         solution, or write this one with `hemicube solve -o FILE.npz`"
    )]
    TooManyRightHandSides {
        /// Its name.
        solution: String,
        /// The number that it has.
        rows: u64,
        /// The number that it might have.
        most: u64,
    },
    /// It was cancelled; nothing is left of the file.
    #[error("`{}` was not written: it was interrupted", path.display())]
    Interrupted {
        /// The file that was asked for.
        path: PathBuf,
    },
}

/// The result of writing a file.
pub type Result<T> = std::result::Result<T, Error>;

/// A file format for what is known of each patch.
///
/// ```
/// use hemicube_export::PatchFormat;
///
/// assert_eq!(PatchFormat::of("room.GLB".as_ref()), Some(PatchFormat::Glb));
/// assert_eq!(PatchFormat::of("room.mtx".as_ref()), None, "a matrix is exported by `hemicube::export`");
/// assert!(PatchFormat::Glb.needs_corners() && PatchFormat::Glb.has_colors());
/// assert!(!PatchFormat::Csv.needs_corners());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum PatchFormat {
    /// VTK's PolyData: triangles that share their points, an array for each result.
    Vtp,
    /// VTK's UnstructuredGrid: the same as cells.
    Vtu,
    /// Binary glTF 2.0: a mesh for each object, three vertices of their own and one colour for each patch.
    Glb,
    /// Binary PLY: the same as one mesh, all results as properties of faces.
    Ply,
    /// Text, a line a patch.
    Csv,
    /// NumPy arrays, a row a patch.
    Npz,
}

impl PatchFormat {
    /// The format that a file's extension asks for, if it is one of these.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_string_lossy().to_ascii_lowercase();
        Some(match extension.as_str() {
            "vtp" => Self::Vtp,
            "vtu" => Self::Vtu,
            "glb" => Self::Glb,
            "ply" => Self::Ply,
            "csv" => Self::Csv,
            "npz" => Self::Npz,
            _ => return None,
        })
    }

    /// Returns whether it is nothing without the corners of patches.
    pub fn needs_corners(self) -> bool {
        !matches!(self, Self::Csv | Self::Npz)
    }

    /// Returns whether it shows patches in colours.
    pub fn has_colors(self) -> bool {
        matches!(self, Self::Glb | Self::Ply)
    }
}

/// How a file is written.
#[derive(Clone, Copy, Debug)]
pub struct WriteOptions<'a> {
    /// Replace a file that is there.
    pub overwrite: bool,
    /// Set by another thread when the file is not wanted any more.
    pub cancel: &'a AtomicBool,
}

/// A file that stops being written when it is cancelled.
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

/// Writes a whole file, or none. Returns its size.
pub(crate) fn write_file<'a>(
    path: &Path,
    options: WriteOptions<'a>,
    write: impl FnOnce(Cancellable<'a>) -> Result<Cancellable<'a>>,
) -> Result<u64> {
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_dir() => {
            return Err(Error::Store(store::Error::InTheWay {
                path: path.to_owned(),
                reason: "is a directory; choose another name",
            }));
        }
        Ok(_) if !options.overwrite => return Err(Error::Store(store::Error::Exists { path: path.to_owned() })),
        _ => {}
    }
    let file = DurableFile::create(path)?;
    let cancel = options.cancel;
    let written = write(Cancellable { file, cancel });
    if cancel.load(Ordering::Relaxed) {
        return Err(Error::Interrupted { path: path.to_owned() });
    }
    written?.file.commit().map_err(|error| on_write(path, error))?;
    let metadata = std::fs::metadata(path).map_err(|error| on_write(path, error))?;
    Ok(metadata.len())
}

pub(crate) fn on_write(path: &Path, source: io::Error) -> Error {
    Error::Store(store::Error::Io {
        path: path.to_owned(),
        action: "written",
        source,
    })
}

/// Writes what is known of each patch to `path`; returns the file's size.
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
    let missing = |what| Error::Missing {
        path: path.to_owned(),
        what,
    };
    let corners = || {
        let corners = results.corners.as_deref();
        corners.ok_or_else(|| missing("the scene that the patches are of"))
    };
    let colors = || results.colors.as_ref().ok_or_else(|| missing("colours"));
    let too_large = |reason: &str| Error::TooLarge {
        path: path.to_owned(),
        reason: reason.to_owned(),
    };
    // All that can be refused is refused before there is a file.
    match format {
        PatchFormat::Vtp | PatchFormat::Vtu => {
            let corners = corners()?;
            write_file(path, options, |mut file| {
                vtk::write(results, corners, format == PatchFormat::Vtp, &mut file).map_err(|e| on_write(path, e))?;
                Ok(file)
            })
        }
        PatchFormat::Glb => {
            let glb = gltf::Glb::new(results, corners()?, colors()?).map_err(too_large)?;
            write_file(path, options, |mut file| {
                glb.write(&mut file).map_err(|error| on_write(path, error))?;
                Ok(file)
            })
        }
        PatchFormat::Ply => {
            let (corners, colors) = (corners()?, colors()?);
            if i32::try_from(3 * corners.len()).is_err() {
                return Err(too_large(
                    "PLY counts vertices in 32 bits, and these are more; `.vtp` has room",
                ));
            }
            write_file(path, options, |mut file| {
                ply::write(results, corners, colors, &mut file).map_err(|error| on_write(path, error))?;
                Ok(file)
            })
        }
        PatchFormat::Csv => write_file(path, options, |mut file| {
            table::write_csv(results, &mut file).map_err(|error| on_write(path, error))?;
            Ok(file)
        }),
        PatchFormat::Npz => write_file(path, options, |file| {
            table::write_npz(results, file).map_err(|error| on_write(path, error))
        }),
    }
}
