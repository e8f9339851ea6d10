//! The matrix as NumPy arrays: the sparse `.npz` and the dense `.npy`.

use super::{Forecast, MatrixWriter};
use crate::matrix::Export;
use crate::write::Cancellable;
use crate::{Error, Result};
use hemicube::store::{self, ElementType, NpzWriter};
use std::io::{self, Write};

/// Rows of `indptr` written at a time.
const BOUNDS: usize = 1 << 14;

pub(super) struct Npz;

impl MatrixWriter for Npz {
    /// To a few hundred bytes.
    fn forecast(&self, export: &Export<'_>) -> Result<Option<Forecast>> {
        let (count, entries) = (u64::from(export.row_count()), export.entries()?);
        let member = |name, elements: u64, size: u64| (name, elements.saturating_mul(size).saturating_add(128));
        Ok(Some(Forecast::exact(NpzWriter::<io::Cursor<Vec<u8>>>::size(&[
            member("format", 3, 1),
            member("shape", 2, 8),
            member("data", entries, 4),
            member("indices", entries, 4),
            member("indptr", count + 1, 8),
        ]))))
    }

    /// Three passes, for a zip member can only be written after the one before it: factors, columns, bounds.
    fn write<'a>(&self, export: &Export<'_>, file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        let on_write = |error| export.on_write(error);
        let (count, entries) = (u64::from(export.row_count()), export.entries()?);
        let mut npz = NpzWriter::new(file);
        npz.csr_preamble(count, export.column_count().into())
            .map_err(on_write)?;
        npz.begin("data", ElementType::F32, &[entries]).map_err(on_write)?;
        for row in export.rows()? {
            npz.push(&row?.1.data).map_err(on_write)?;
        }
        npz.begin("indices", ElementType::I32, &[entries]).map_err(on_write)?;
        let mut columns: Vec<i32> = Vec::new();
        for row in export.rows()? {
            columns.clear();
            // Columns are below 2³¹, and reading a row has checked them.
            columns.extend(row?.1.indices.iter().map(|&column| column.cast_signed()));
            npz.push(&columns).map_err(on_write)?;
        }
        npz.begin("indptr", ElementType::I64, &[count + 1]).map_err(on_write)?;
        let mut bounds: Vec<u64> = vec![0];
        let mut bound = 0;
        for patch in export.patches() {
            bound += export.entries_of_row(patch)?;
            bounds.push(bound);
            if bounds.len() >= BOUNDS {
                npz.push(&bounds).map_err(on_write)?;
                bounds.clear();
            }
        }
        npz.push(&bounds).map_err(on_write)?;
        if bound != entries {
            return Err(Error::Store(store::Error::Malformed {
                path: export.store.directory().to_owned(),
                reason: format!("has {bound} entries and says {entries}"),
            }));
        }
        npz.finish().map_err(on_write)
    }
}

pub(super) struct Npy;

impl MatrixWriter for Npy {
    fn forecast(&self, export: &Export<'_>) -> Result<Option<Forecast>> {
        let (rows, columns) = (u64::from(export.row_count()), u64::from(export.column_count()));
        let header = ElementType::F32.npy_header(&[rows, columns]).len() as u64;
        Ok(Some(Forecast::exact(header + 4 * rows * columns)))
    }

    fn write<'a>(&self, export: &Export<'_>, mut file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        let on_write = |error| export.on_write(error);
        let (rows, columns) = (export.row_count(), export.column_count());
        file.write_all(&ElementType::F32.npy_header(&[rows.into(), columns.into()]))
            .map_err(on_write)?;
        let mut bytes = vec![0; 4 * columns as usize];
        for patch in export.patches() {
            bytes.fill(0);
            if let Some(row) = export.row(patch)? {
                for (&column, factor) in row.indices.iter().zip(&row.data) {
                    let place = 4 * column as usize;
                    bytes[place..place + 4].copy_from_slice(&factor.to_le_bytes());
                }
            }
            file.write_all(&bytes).map_err(on_write)?;
        }
        Ok(file)
    }
}
