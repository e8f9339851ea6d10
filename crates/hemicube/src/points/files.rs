//! Rows of sensors on disk: a `.npz` that `scipy.sparse.load_npz` opens, with further arrays beside the matrix.

use super::SensorRow;
use crate::store::{DurableFile, Element, Error, NpzWriter, Result};
use std::io;
use std::path::Path;

/// An array beside the matrix: its shape, and its elements in C order.
#[derive(Clone, Debug, PartialEq)]
pub enum Table {
    /// Real numbers.
    Real(Vec<u64>, Vec<f64>),
    /// Whole numbers.
    Whole(Vec<u64>, Vec<i64>),
}

/// Writes rows over `patch_count` patches; beside the matrix `sky`, `ground`, `blocked`, `change`, `hemicubes`, a
/// number a row, and `more` arrays by their names.
///
/// # Errors
/// When the file cannot be written.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::points::{SensorRow, Table, write_rows};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("points.npz");
///
/// let row = SensorRow { patches: vec![(InputPatch(3), 0.25)], sky: 0.75, ..SensorRow::default() };
/// let points = Table::Real(vec![1, 3], vec![15.0, 5.0, 1.1]);
/// write_rows(&path, 8, &[row], &[("points", points)])?;
/// assert!(std::fs::metadata(&path)?.len() < 4000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_rows(path: &Path, patch_count: u32, rows: &[SensorRow], more: &[(&str, Table)]) -> Result<()> {
    let entries: u64 = rows.iter().map(|row| row.patches.len() as u64).sum();
    let wanted = 12 * entries + 60 * rows.len() as u64 + 4096;
    let on_write = |error| Error::write(path, wanted, error);
    let mut indptr = vec![0i64];
    for row in rows {
        let end = indptr.last().copied().unwrap_or(0) + i64::try_from(row.patches.len()).unwrap_or(i64::MAX);
        indptr.push(end);
    }
    let count = [rows.len() as u64];
    let of = |value: fn(&SensorRow) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let write = |npz: &mut NpzWriter<DurableFile>| -> io::Result<()> {
        npz.csr_preamble(rows.len() as u64, patch_count.into())?;
        entries_of(npz, "data", entries, rows, |&(_, factor)| factor)?;
        entries_of(npz, "indices", entries, rows, |&(patch, _)| patch.0.cast_signed())?;
        npz.array("indptr", &[indptr.len() as u64], &indptr)?;
        npz.array("sky", &count, &of(|row| row.sky))?;
        npz.array("ground", &count, &of(|row| row.ground))?;
        npz.array("blocked", &count, &of(|row| row.blocked))?;
        npz.array("change", &count, &of(|row| row.change))?;
        let hemicubes: Vec<u32> = rows.iter().map(|row| row.hemicubes).collect();
        npz.array("hemicubes", &count, &hemicubes)?;
        for (name, table) in more {
            match table {
                Table::Real(shape, values) => npz.array(name, shape, values)?,
                Table::Whole(shape, values) => npz.array(name, shape, values)?,
            }
        }
        Ok(())
    };
    let mut npz = NpzWriter::new(DurableFile::create(path)?);
    write(&mut npz)
        .and_then(|()| npz.finish())
        .and_then(DurableFile::commit)
        .map_err(on_write)
}

/// Writes a number of each entry.
fn entries_of<T: Element>(
    npz: &mut NpzWriter<DurableFile>,
    name: &str,
    entries: u64,
    rows: &[SensorRow],
    of: impl Fn(&(hemicube_scene::InputPatch, f64)) -> T,
) -> io::Result<()> {
    npz.begin(name, T::TYPE, &[entries])?;
    for row in rows {
        let values: Vec<T> = row.patches.iter().map(&of).collect();
        npz.push(&values)?;
    }
    Ok(())
}
