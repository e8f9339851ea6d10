//! The matrix in files of other programs: SciPy, Matrix Market, MATLAB and Octave, NumPy.
//!
//! F\[i, j\] is from i to j. Rows and columns are input patches; a row that was not computed is empty. Everything
//! streams: in memory are one row, and the length of each. Files appear whole or not at all.

mod array;
mod text;

use crate::sky::StoredSky;
use crate::store::{DurableFile, Error, PATCH_COUNT_MAX, Result, Row, Store};
use hemicube_scene::InputPatch;
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};

/// Rows measured to forecast the size of a text file.
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
    /// `.txt`, `.dat`: `row column value` lines, 1-based, for MATLAB's and Octave's `spconvert`; the last line gives
    /// the size.
    Triplets,
    /// `.npy`: a dense array of f32.
    Npy,
}

impl ExportFormat {
    /// The format of a file's extension.
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
                "does not say which format is wanted; end it in `.npz` (SciPy), `.mtx` (Matrix Market), `.txt` or \
                 `.dat` (MATLAB's `spconvert`) or `.npy` (dense NumPy)",
            )),
        }
    }
}

/// Options of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// Replace a file that is there.
    pub overwrite: bool,
    /// Accept a store with missing parts: their rows are empty.
    pub allow_incomplete: bool,
}

/// Figures of an export.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ExportReport {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: ExportFormat,
    /// Rows of the matrix, and columns without those of the sky.
    pub patch_count: u32,
    /// Columns after those of the patches: the ground and the patches of the sky; 0 without them.
    pub sky_columns: u32,
    /// Computed rows; the others are empty.
    pub rows: u64,
    /// Entries of the matrix, those of the sky included.
    pub entries: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Forecast of the size, in bytes; exact except for text.
    pub forecast: u64,
}

/// Writes the matrix of `store` to `path`.
///
/// # Errors
/// [`Error::Exists`] without [`ExportOptions::overwrite`]; [`Error::Incomplete`] without
/// [`ExportOptions::allow_incomplete`]; [`Error::DiskTooSmall`] before anything is written, [`Error::NoSpace`] after;
/// otherwise errors of reading and writing.
///
/// ```
/// use hemicube::export::{ExportFormat, ExportOptions, export};
/// use hemicube::store::Matrix;
/// # use hemicube::InputPatch;
/// # use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), Correction::Pixel)?;
/// # let path = folder.path().join("room.mtx");
///
/// let report = export(&store, &path, ExportFormat::of(&path)?, ExportOptions::default())?;
/// let text = std::fs::read_to_string(&path)?;
/// let size = text.lines().find(|line| !line.starts_with('%'));
/// assert_eq!(size, Some(&*format!("160 160 {}", report.entries)));
///
/// // What was written is what was computed, to the bit.
/// let (row, exported) = (store.row(InputPatch(9))?.ok_or("no row")?, Matrix::open(&path)?.row(9)?.ok_or("no row")?);
/// assert_eq!(exported.columns, row.indices);
/// assert!(exported.values.iter().eq(row.data.iter().map(|&factor| f64::from(factor)).collect::<Vec<_>>().iter()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn export(store: &Store, path: &Path, format: ExportFormat, options: ExportOptions) -> Result<ExportReport> {
    write(&Source { store, sky: None }, path, format, options)
}

/// Writes the matrix of `store` with more columns: after those of the patches the ground, then the patches of the sky,
/// each with its share of the row's view. With the blocked share, rows then sum to 1 as far as the matrix is closed.
///
/// # Errors
/// Those of [`export`], and when `sky` is of another number of patches.
pub fn export_with_sky(
    store: &Store,
    sky: &StoredSky,
    path: &Path,
    format: ExportFormat,
    options: ExportOptions,
) -> Result<ExportReport> {
    let patches = store.patch_count();
    if sky.rows() != patches as usize {
        return Err(Error::unsupported(
            store.directory(),
            format!("has {patches} patches, and the sky rows are of {}", sky.rows()),
        ));
    }
    if patches
        .checked_add(sky.columns())
        .is_none_or(|count| count > PATCH_COUNT_MAX)
    {
        return Err(Error::unsupported(
            store.directory(),
            "has more columns, with those of the sky, than 32 bits count",
        ));
    }
    write(&Source { store, sky: Some(sky) }, path, format, options)
}

fn write(source: &Source<'_>, path: &Path, format: ExportFormat, options: ExportOptions) -> Result<ExportReport> {
    let store = source.store;
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
        ExportFormat::Npz => array::npz_size(source)?,
        ExportFormat::Npy => array::npy_size(source),
        ExportFormat::MatrixMarket | ExportFormat::Triplets => text::forecast(source, FORECAST_ROWS)?,
    };
    // Created first: of two errors, the place that cannot be written is the better one to tell.
    let file = DurableFile::create(path)?;
    require_room(path, format, forecast)?;
    let file = match format {
        ExportFormat::Npz => array::write_npz(source, path, file, forecast),
        ExportFormat::Npy => array::write_npy(source, path, file, forecast),
        ExportFormat::MatrixMarket => text::write_market(source, path, file, forecast),
        ExportFormat::Triplets => text::write_triplets(source, path, file, forecast),
    }?;
    file.commit().map_err(|error| Error::write(path, forecast, error))?;
    let bytes = std::fs::metadata(path)
        .map_err(|error| Error::io(path, "read", error))?
        .len();
    Ok(ExportReport {
        path: path.to_owned(),
        format,
        patch_count: store.patch_count(),
        sky_columns: source.sky.map_or(0, StoredSky::columns),
        rows: store.manifest().rows_present(),
        entries: source.entries()?,
        bytes,
        forecast,
    })
}

/// Refuses an export larger than the disk's free space.
fn require_room(path: &Path, format: ExportFormat, forecast: u64) -> Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    // Without the disk's free space, a full disk is an error of writing.
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

/// Content of an export: the matrix, and the columns of the sky where they are wanted.
struct Source<'a> {
    store: &'a Store,
    sky: Option<&'a StoredSky>,
}

impl Source<'_> {
    /// Every patch of the matrix, whether its row was computed or not.
    fn patches(&self) -> impl Iterator<Item = InputPatch> + use<> {
        (0..self.store.patch_count()).map(InputPatch)
    }

    fn row_count(&self) -> u32 {
        self.store.patch_count()
    }

    fn column_count(&self) -> u32 {
        self.row_count() + self.sky.map_or(0, StoredSky::columns)
    }

    /// All entries.
    fn entries(&self) -> Result<u64> {
        let mut entries = self.store.manifest().entries;
        if let Some(sky) = self.sky {
            // A row that was not computed is empty: it has no sky either.
            for patch in self.store.computed_patches()? {
                entries += sky.row(patch.0 as usize).0.len() as u64;
            }
        }
        Ok(entries)
    }

    /// Number of a row's entries; 0 for one that was not computed.
    fn entries_of_row(&self, patch: InputPatch) -> Result<u64> {
        let Some(entries) = self.store.entries_of_row(patch)? else {
            return Ok(0);
        };
        Ok(entries + self.sky.map_or(0, |sky| sky.row(patch.0 as usize).0.len() as u64))
    }

    fn with_sky(&self, patch: InputPatch, mut row: Row) -> Row {
        if let Some(sky) = self.sky {
            let first = self.row_count();
            let (columns, shares) = sky.row(patch.0 as usize);
            row.indices.extend(columns.iter().map(|column| first + column));
            #[allow(clippy::cast_possible_truncation, reason = "a matrix has f32")]
            row.data.extend(shares.iter().map(|&share| share as f32));
        }
        row
    }

    /// The row of a patch; `None` when it was not computed.
    fn row(&self, patch: InputPatch) -> Result<Option<Row>> {
        Ok(self.store.row(patch)?.map(|row| self.with_sky(patch, row)))
    }

    /// All computed rows.
    fn rows(&self) -> Result<impl Iterator<Item = Result<(InputPatch, Row)>>> {
        Ok(self
            .store
            .rows()?
            .map(|found| found.map(|(patch, row)| (patch, self.with_sky(patch, row)))))
    }
}
