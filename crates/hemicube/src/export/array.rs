//! Exports as NumPy arrays: the sparse `.npz` and the dense `.npy`.

use super::patches;
use crate::store::{DurableFile, ElementType, Error, NpyHeader, NpzWriter, Result, Store};
use std::io::{self, Write};
use std::path::Path;

/// Rows of `indptr` that are written at a time.
const BOUNDS: usize = 1 << 14;

/// The size of the `.npz`, to a few hundred bytes.
pub(super) fn npz_size(store: &Store) -> u64 {
    let (count, entries) = (u64::from(store.patch_count()), store.manifest().entries);
    let member = |name, elements: u64, size: u64| (name, elements.saturating_mul(size).saturating_add(128));
    NpzWriter::<io::Cursor<Vec<u8>>>::size(&[
        member("format", 3, 1),
        member("shape", 2, 8),
        member("data", entries, 4),
        member("indices", entries, 4),
        member("indptr", count + 1, 8),
    ])
}

/// The size of the `.npy`.
pub(super) fn npy_size(store: &Store) -> u64 {
    let count = u64::from(store.patch_count());
    NpyHeader::bytes(ElementType::F32, &[count, count]).len() as u64 + 4 * count * count
}

/// Three passes, for a zip member can only be written after the one before it: factors, columns, bounds.
pub(super) fn write_npz(store: &Store, path: &Path, file: DurableFile, forecast: u64) -> Result<DurableFile> {
    let on_write = |error| Error::write(path, forecast, error);
    let (count, entries) = (u64::from(store.patch_count()), store.manifest().entries);
    let mut npz = NpzWriter::new(file);
    npz.csr_preamble(count, count).map_err(on_write)?;
    npz.begin("data", ElementType::F32, &[entries]).map_err(on_write)?;
    for row in store.rows()? {
        npz.push(&row?.1.data).map_err(on_write)?;
    }
    npz.begin("indices", ElementType::I32, &[entries]).map_err(on_write)?;
    let mut columns: Vec<i32> = Vec::new();
    for row in store.rows()? {
        columns.clear();
        // A matrix has fewer than 2³¹ columns, and a row that was read has none beyond them.
        columns.extend(row?.1.indices.iter().map(|&column| column.cast_signed()));
        npz.push(&columns).map_err(on_write)?;
    }
    npz.begin("indptr", ElementType::I64, &[count + 1]).map_err(on_write)?;
    let mut bounds: Vec<u64> = vec![0];
    let mut bound = 0;
    for patch in patches(store) {
        bound += store.entries_of_row(patch)?.unwrap_or(0);
        bounds.push(bound);
        if bounds.len() >= BOUNDS {
            npz.push(&bounds).map_err(on_write)?;
            bounds.clear();
        }
    }
    npz.push(&bounds).map_err(on_write)?;
    if bound != entries {
        return Err(Error::malformed(
            store.directory(),
            format!("has {bound} entries and says {entries}"),
        ));
    }
    npz.finish().map_err(on_write)
}

pub(super) fn write_npy(store: &Store, path: &Path, mut file: DurableFile, forecast: u64) -> Result<DurableFile> {
    let on_write = |error| Error::write(path, forecast, error);
    let count = store.patch_count();
    file.write_all(&NpyHeader::bytes(ElementType::F32, &[count.into(), count.into()]))
        .map_err(on_write)?;
    let mut bytes = vec![0; 4 * count as usize];
    for patch in patches(store) {
        bytes.fill(0);
        if let Some(row) = store.row(patch)? {
            for (&column, factor) in row.indices.iter().zip(&row.data) {
                let place = 4 * column as usize;
                bytes[place..place + 4].copy_from_slice(&factor.to_le_bytes());
            }
        }
        file.write_all(&bytes).map_err(on_write)?;
    }
    Ok(file)
}
