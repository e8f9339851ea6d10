//! Exports as NumPy arrays: the sparse `.npz` and the dense `.npy`.

use super::Source;
use crate::store::{DurableFile, ElementType, Error, NpyHeader, NpzWriter, Result};
use std::io::{self, Write};
use std::path::Path;

/// Rows of `indptr` written at a time.
const BOUNDS: usize = 1 << 14;

/// The size of the `.npz`, to a few hundred bytes.
pub(super) fn npz_size(source: &Source<'_>) -> Result<u64> {
    let (count, entries) = (u64::from(source.row_count()), source.entries()?);
    let member = |name, elements: u64, size: u64| (name, elements.saturating_mul(size).saturating_add(128));
    Ok(NpzWriter::<io::Cursor<Vec<u8>>>::size(&[
        member("format", 3, 1),
        member("shape", 2, 8),
        member("data", entries, 4),
        member("indices", entries, 4),
        member("indptr", count + 1, 8),
    ]))
}

/// The size of the `.npy`.
pub(super) fn npy_size(source: &Source<'_>) -> u64 {
    let (rows, columns) = (u64::from(source.row_count()), u64::from(source.column_count()));
    NpyHeader::bytes(ElementType::F32, &[rows, columns]).len() as u64 + 4 * rows * columns
}

/// Three passes, for a zip member can only be written after the one before it: factors, columns, bounds.
pub(super) fn write_npz(source: &Source<'_>, path: &Path, file: DurableFile, forecast: u64) -> Result<DurableFile> {
    let on_write = |error| Error::write(path, forecast, error);
    let (count, entries) = (u64::from(source.row_count()), source.entries()?);
    let mut npz = NpzWriter::new(file);
    npz.csr_preamble(count, source.column_count().into())
        .map_err(on_write)?;
    npz.begin("data", ElementType::F32, &[entries]).map_err(on_write)?;
    for row in source.rows()? {
        npz.push(&row?.1.data).map_err(on_write)?;
    }
    npz.begin("indices", ElementType::I32, &[entries]).map_err(on_write)?;
    let mut columns: Vec<i32> = Vec::new();
    for row in source.rows()? {
        columns.clear();
        // A matrix has fewer than 2³¹ columns, and a row has none beyond them.
        columns.extend(row?.1.indices.iter().map(|&column| column.cast_signed()));
        npz.push(&columns).map_err(on_write)?;
    }
    npz.begin("indptr", ElementType::I64, &[count + 1]).map_err(on_write)?;
    let mut bounds: Vec<u64> = vec![0];
    let mut bound = 0;
    for patch in source.patches() {
        bound += source.entries_of_row(patch)?;
        bounds.push(bound);
        if bounds.len() >= BOUNDS {
            npz.push(&bounds).map_err(on_write)?;
            bounds.clear();
        }
    }
    npz.push(&bounds).map_err(on_write)?;
    if bound != entries {
        return Err(Error::malformed(
            source.store.directory(),
            format!("has {bound} entries and says {entries}"),
        ));
    }
    npz.finish().map_err(on_write)
}

pub(super) fn write_npy(source: &Source<'_>, path: &Path, mut file: DurableFile, forecast: u64) -> Result<DurableFile> {
    let on_write = |error| Error::write(path, forecast, error);
    let (rows, columns) = (source.row_count(), source.column_count());
    file.write_all(&NpyHeader::bytes(ElementType::F32, &[rows.into(), columns.into()]))
        .map_err(on_write)?;
    let mut bytes = vec![0; 4 * columns as usize];
    for patch in source.patches() {
        bytes.fill(0);
        if let Some(row) = source.row(patch)? {
            for (&column, factor) in row.indices.iter().zip(&row.data) {
                let place = 4 * column as usize;
                bytes[place..place + 4].copy_from_slice(&factor.to_le_bytes());
            }
        }
        file.write_all(&bytes).map_err(on_write)?;
    }
    Ok(file)
}
