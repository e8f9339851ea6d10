//! The matrix in the files that other programs read: SciPy, Matrix Market, MATLAB and Octave, NumPy.
//!
//! F\[i, j\] is from i to j. Rows and columns are input patches; a row that was not computed is empty. Everything streams:
//! a row is in memory, and what each row's length is. Files appear whole or not at all.

mod array;
mod text;

use crate::store::{DurableFile, Error, Result, Store};
use hemicube_scene::InputPatch;
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};

/// Rows whose text is measured to forecast the size of a file.
const FORECAST_ROWS: usize = 256;

/// A file format for matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ExportFormat {
    /// `.npz`: one CSR matrix for `scipy.sparse.load_npz`, uncompressed; f32 values, i32 columns, i64 `indptr`.
    Npz,
    /// `.mtx`: Matrix Market, coordinate real general, 1-based.
    MatrixMarket,
    /// `.txt`, `.dat`: `row column value` lines, 1-based, for MATLAB's and Octave's `spconvert`; the last line gives the
    /// size.
    Triplets,
    /// `.npy`: a dense array of f32.
    Npy,
}

impl ExportFormat {
    /// The format that a file's extension asks for.
    ///
    /// # Errors
    /// [`Error::Unsupported`] when it asks for none.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path
            .extension()
            .map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("npz") => Ok(Self::Npz),
            Some("mtx") => Ok(Self::MatrixMarket),
            Some("txt" | "dat") => Ok(Self::Triplets),
            Some("npy") => Ok(Self::Npy),
            _ => Err(Error::unsupported(
                path,
                "does not say which format is wanted; end it in `.npz` (SciPy), `.mtx` (Matrix Market), `.txt` or `.dat` \
                 (MATLAB's `spconvert`) or `.npy` (dense NumPy)",
            )),
        }
    }
}

/// How to export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// Replace a file that is there.
    pub overwrite: bool,
    /// Accept a store of which parts are missing: their rows are empty.
    pub allow_incomplete: bool,
}

/// What was exported.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExportReport {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: ExportFormat,
    /// Rows and columns of the matrix.
    pub patch_count: u32,
    /// Rows that were computed; the others are empty.
    pub rows: u64,
    /// Entries of the matrix.
    pub entries: u64,
    /// Size of the file.
    pub bytes: u64,
    /// What the size was thought to become, before; exact but for text.
    pub forecast: u64,
}

/// Writes the matrix of `store` to `path`.
///
/// # Errors
/// [`Error::Exists`] without [`ExportOptions::overwrite`]; [`Error::Incomplete`] without
/// [`ExportOptions::allow_incomplete`]; [`Error::DiskTooSmall`] before anything is written, [`Error::NoSpace`] after;
/// otherwise what reading and writing give.
pub fn export(store: &Store, path: &Path, format: ExportFormat, options: ExportOptions) -> Result<ExportReport> {
    if !options.allow_incomplete {
        store.require_complete()?;
    }
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_dir() => {
            return Err(Error::InTheWay {
                path: path.to_owned(),
                reason: "is a directory; choose another name",
            });
        }
        Ok(_) if !options.overwrite => return Err(Error::Exists { path: path.to_owned() }),
        Ok(_) => {}
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(Error::io(path, "created", error)),
    }
    let forecast = match format {
        ExportFormat::Npz => array::npz_size(store),
        ExportFormat::Npy => array::npy_size(store),
        ExportFormat::MatrixMarket | ExportFormat::Triplets => text::forecast(store, FORECAST_ROWS)?,
    };
    // Created first: a place that cannot be written is the better thing to be told than one that is too small.
    let file = DurableFile::create(path)?;
    require_room(path, format, forecast)?;
    let file = match format {
        ExportFormat::Npz => array::write_npz(store, path, file, forecast),
        ExportFormat::Npy => array::write_npy(store, path, file, forecast),
        ExportFormat::MatrixMarket => text::write_market(store, path, file, forecast),
        ExportFormat::Triplets => text::write_triplets(store, path, file, forecast),
    }?;
    file.commit().map_err(|error| Error::write(path, forecast, error))?;
    let bytes = std::fs::metadata(path)
        .map_err(|error| Error::io(path, "read", error))?
        .len();
    Ok(ExportReport {
        path: path.to_owned(),
        format,
        patch_count: store.patch_count(),
        rows: store.manifest().rows_present(),
        entries: store.manifest().entries,
        bytes,
        forecast,
    })
}

/// Refuses an export that the disk cannot hold.
fn require_room(path: &Path, format: ExportFormat, forecast: u64) -> Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    // A file system that does not say how full it is will say so when it is.
    let Ok(available) = fs4::available_space(directory) else {
        return Ok(());
    };
    // A forecast of text may be somewhat too high.
    let certain = match format {
        ExportFormat::Npz | ExportFormat::Npy => forecast,
        ExportFormat::MatrixMarket | ExportFormat::Triplets => forecast - forecast / 8,
    };
    if certain > available {
        return Err(Error::DiskTooSmall {
            path: path.to_owned(),
            wanted: forecast,
            available,
        });
    }
    Ok(())
}

/// Every patch of the matrix, whether its row was computed or not.
fn patches(store: &Store) -> impl Iterator<Item = InputPatch> + use<> {
    (0..store.patch_count()).map(InputPatch)
}
