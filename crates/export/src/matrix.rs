//! The matrix in files for other programs: SciPy, Matrix Market, MATLAB and Octave, NumPy, Parquet.
//!
//! F\[i, j\] is from i to j. Rows and columns are input patches; uncomputed rows are empty. Everything streams: one row
//! and the length of each row are in memory.

use crate::formats::Forecast;
use crate::write::{Cancellable, WriteOptions, on_write};
use crate::{Error, ExportFormat, Result};
use hemicube_scene::InputPatch;
use hemicube_solve::analysis::zones::Zone;
use hemicube_store::sky::StoredSky;
use hemicube_store::{self as store, FactorSlice, FactorVec, PATCH_COUNT_MAX, Precision, Row, Store};
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Options of an export.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExportOptions<'a> {
    /// Replace an existing file.
    pub overwrite: bool,
    /// Accept a store with missing parts: their rows are empty.
    pub allow_incomplete: bool,
    /// Set by another thread to cancel.
    pub cancel: Option<&'a AtomicBool>,
}

/// A finished export.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ExportReport {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: ExportFormat,
    /// Rows of the matrix, and its columns without those of the sky.
    pub patch_count: u32,
    /// Columns after those of the patches: the ground and the patches of the sky. 0 without them, `None` for a format
    /// without columns of the sky.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky_columns: Option<u32>,
    /// Computed rows; the others are empty.
    pub rows: u64,
    /// Entries, including those of the sky.
    pub entries: u64,
    /// Size of the file, in bytes.
    pub bytes: u64,
    /// Size expected before writing, in bytes: exact but for text, `None` if only writing tells it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forecast: Option<u64>,
}

/// Writes the matrix of `store` to `path`.
///
/// # Errors
/// [`store::Error::Exists`] without [`ExportOptions::overwrite`]; [`store::Error::Incomplete`] without
/// [`ExportOptions::allow_incomplete`]; [`store::Error::DiskTooSmall`] before anything is written,
/// [`store::Error::NoSpace`] after; [`Error::Interrupted`] when it was cancelled; otherwise what reading and writing
/// give.
///
/// ```
/// use hemicube_store::Matrix;
/// use hemicube_export::{ExportFormat, ExportOptions, export};
/// # use hemicube_scene::InputPatch;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.0)?;
/// # let path = folder.path().join("room.mtx");
///
/// let report = export(&store, &path, ExportFormat::of(&path)?, ExportOptions::default())?;
/// let text = std::fs::read_to_string(&path)?;
/// let size = text.lines().find(|line| !line.starts_with('%'));
/// assert_eq!(size, Some(&*format!("6 6 {}", report.entries)));
///
/// // What was written is what was computed, to the bit.
/// let (row, exported) = (store.row(InputPatch(2))?.ok_or("no row")?, Matrix::open(&path)?.row(2)?.ok_or("no row")?);
/// assert_eq!(exported.columns, row.indices);
/// assert!(exported.values.iter().eq(row.data.iter().collect::<Vec<f64>>().iter()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn export(store: &Store, path: &Path, format: ExportFormat, options: ExportOptions<'_>) -> Result<ExportReport> {
    write(store, Content::default(), path, format, options)
}

/// Writes form factors between zones of `store`: rows and columns are zones, in their order.
///
/// # Errors
/// As [`export`].
pub fn export_zones(
    store: &Store,
    zones: &[Zone],
    path: &Path,
    format: ExportFormat,
    options: ExportOptions<'_>,
) -> Result<ExportReport> {
    let precision = store.manifest().form.precision();
    let row = |zone: &Zone| zone.has_rows().then(|| row_of_zone(zone, precision));
    let rows: Vec<Option<Row>> = zones.iter().map(row).collect();
    let content = Content {
        zones: Some(&rows),
        ..Content::default()
    };
    write(store, content, path, format, options)
}

fn row_of_zone(zone: &Zone, precision: Precision) -> Row {
    let mut data = FactorVec::new(precision);
    zone.factors.iter().for_each(|&(_, factor)| data.push(factor));
    Row {
        indices: zone.factors.iter().map(|&(to, _)| to).collect(),
        data,
    }
}

/// Writes the matrix of `store` with more columns: after those of the patches the ground, and then the patches of the
/// sky, each with its share of the row's view. With blocked shares, rows then sum to 1 up to the closure of the matrix.
///
/// # Errors
/// As [`export`], and when `sky` is of another number of patches or the format takes no sky.
pub fn export_with_sky(
    store: &Store,
    sky: &StoredSky,
    path: &Path,
    format: ExportFormat,
    options: ExportOptions<'_>,
) -> Result<ExportReport> {
    let patches = store.patch_count();
    let unsupported = |path: &Path, reason: String| {
        let path = path.to_owned();
        Err(Error::Store(store::Error::Unsupported { path, reason }))
    };
    if !format.takes_sky() {
        return unsupported(path, "is of a format without columns of the sky".to_owned());
    }
    if sky.rows() != patches as usize {
        let reason = format!("has {patches} patches, and the sky rows are of {}", sky.rows());
        return unsupported(store.directory(), reason);
    }
    let columns = patches.checked_add(sky.columns());
    if columns.is_none_or(|count| count > PATCH_COUNT_MAX) {
        let reason = "has more columns, with those of the sky, than 32 bits count".to_owned();
        return unsupported(store.directory(), reason);
    }
    let content = Content {
        sky: Some(sky),
        ..Content::default()
    };
    write(store, content, path, format, options)
}

/// Columns beside a store's matrix, or rows in its place.
#[derive(Clone, Copy, Default)]
struct Content<'a> {
    /// Columns of the sky.
    sky: Option<&'a StoredSky>,
    /// Rows of zones, in place of those of patches.
    zones: Option<&'a [Option<Row>]>,
}

/// Writes a store's matrix, with the sky's columns, or the rows of its zones.
fn write(
    store: &Store,
    Content { sky, zones }: Content<'_>,
    path: &Path,
    format: ExportFormat,
    options: ExportOptions<'_>,
) -> Result<ExportReport> {
    let writer = format.writer()?;
    if !options.allow_incomplete {
        store.require_complete()?;
    }
    let never = AtomicBool::new(false);
    let cancel = options.cancel.unwrap_or(&never);
    let overwrite = options.overwrite;
    let mut export = Export {
        store,
        sky,
        zones,
        path,
        cancel,
        forecast: None,
    };
    let options = WriteOptions { overwrite, cancel };
    // Created first: an unwritable place is the better thing to be told than a small disk.
    let file = Cancellable::create(path, options)?;
    if let Some(forecast) = writer.forecast(&export)? {
        require_room(path, &forecast)?;
        export.forecast = Some(forecast.bytes);
    }
    let written = writer.write(&export, file);
    let bytes = Cancellable::commit(written, path, options, |error| export.on_write(error))?;
    Ok(ExportReport {
        path: path.to_owned(),
        format,
        patch_count: export.row_count(),
        sky_columns: format.takes_sky().then(|| sky.map_or(0, StoredSky::columns)),
        rows: zones.map_or(store.manifest().rows_present(), |zones| {
            zones.iter().flatten().count() as u64
        }),
        entries: export.entries()?,
        bytes,
        forecast: export.forecast,
    })
}

/// Refuses an export larger than the room on the disk.
pub(crate) fn require_room(path: &Path, forecast: &Forecast) -> Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    // A file system that hides its free room will tell when it is full.
    let Ok(available) = fs4::available_space(directory) else {
        return Ok(());
    };
    if forecast.least > available {
        return Err(Error::Store(store::Error::DiskTooSmall {
            path: path.to_owned(),
            wanted: forecast.bytes,
            available,
        }));
    }
    Ok(())
}

/// An export: the matrix, the columns of the sky if wanted, and the file.
pub(crate) struct Export<'a> {
    pub(crate) store: &'a Store,
    pub(crate) sky: Option<&'a StoredSky>,
    /// Rows of zones, in place of the store's.
    zones: Option<&'a [Option<Row>]>,
    pub(crate) path: &'a Path,
    cancel: &'a AtomicBool,
    /// Size of the file in bytes, if it can be told.
    forecast: Option<u64>,
}

/// Rows and the patches, or zones, that they are of.
type Rows<'a> = Box<dyn Iterator<Item = store::Result<(InputPatch, Row)>> + 'a>;

impl Export<'_> {
    /// The error of writing the file; that of a full disk has the file's size.
    pub(crate) fn on_write(&self, error: io::Error) -> Error {
        match self.forecast {
            Some(bytes) => Error::Store(store::Error::write(self.path, bytes, error)),
            None => on_write(self.path, error),
        }
    }

    /// Every patch of the matrix, computed or not.
    pub(crate) fn patches(&self) -> impl Iterator<Item = InputPatch> + use<> {
        (0..self.row_count()).map(InputPatch)
    }

    /// Patches with a row, ascending.
    pub(crate) fn computed_patches(&self) -> Result<Vec<InputPatch>> {
        Ok(match self.zones {
            Some(_) => self.patches().collect(),
            None => self.store.computed_patches()?,
        })
    }

    /// Width of form factors in the file: that of the store's.
    pub(crate) fn precision(&self) -> Precision {
        self.store.manifest().form.precision()
    }

    pub(crate) fn row_count(&self) -> u32 {
        let zones = self.zones.map(|zones| u32::try_from(zones.len()).unwrap_or(u32::MAX));
        zones.unwrap_or(self.store.patch_count())
    }

    pub(crate) fn column_count(&self) -> u32 {
        self.row_count() + self.sky.map_or(0, StoredSky::columns)
    }

    /// All entries.
    pub(crate) fn entries(&self) -> Result<u64> {
        if let Some(zones) = self.zones {
            return Ok(zones.iter().flatten().map(|row| row.data.len() as u64).sum());
        }
        let mut entries = self.store.manifest().entries;
        if let Some(sky) = self.sky {
            // An uncomputed row is empty: it has no sky either.
            for patch in self.store.computed_patches()? {
                entries += sky.row(patch.0 as usize).0.len() as u64;
            }
        }
        Ok(entries)
    }

    /// Number of entries of a row; 0 if uncomputed.
    pub(crate) fn entries_of_row(&self, patch: InputPatch) -> Result<u64> {
        if self.zones.is_some() {
            return Ok(self.zone(patch).map_or(0, |row| row.data.len() as u64));
        }
        let Some(entries) = self.store.entries_of_row(patch)? else {
            return Ok(0);
        };
        Ok(entries + self.sky.map_or(0, |sky| sky.row(patch.0 as usize).0.len() as u64))
    }

    fn zone(&self, patch: InputPatch) -> Option<&Row> {
        self.zones?.get(patch.0 as usize)?.as_ref()
    }

    fn with_sky(&self, patch: InputPatch, mut row: Row) -> Row {
        if let Some(sky) = self.sky {
            let first = self.row_count();
            let (columns, shares) = sky.row(patch.0 as usize);
            row.indices.extend(columns.iter().map(|column| first + column));
            row.data.extend(FactorSlice::Double(shares));
        }
        row
    }

    /// The row of a patch; `None` if uncomputed.
    pub(crate) fn row(&self, patch: InputPatch) -> Result<Option<Row>> {
        if self.zones.is_some() {
            return Ok(self.zone(patch).cloned());
        }
        Ok(self.store.row(patch)?.map(|row| self.with_sky(patch, row)))
    }

    /// All computed rows, until the export is cancelled.
    pub(crate) fn rows(&self) -> Result<impl Iterator<Item = Result<(InputPatch, Row)>>> {
        let rows: Rows<'_> = match self.zones {
            Some(zones) => {
                let of_zones = self.patches().zip(zones);
                Box::new(of_zones.filter_map(|(zone, row)| Some(Ok((zone, row.clone()?)))))
            }
            None => Box::new(self.store.rows()?),
        };
        Ok(rows.map(|found| {
            if self.cancel.load(Ordering::Relaxed) {
                return Err(Error::Interrupted {
                    path: self.path.to_owned(),
                });
            }
            let (patch, row) = found?;
            Ok((patch, self.with_sky(patch, row)))
        }))
    }
}
