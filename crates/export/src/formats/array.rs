//! The matrix as NumPy arrays: the sparse `.npz` and the dense `.npy`.

use super::{Forecast, MatrixWriter};
use crate::matrix::Export;
use crate::write::Cancellable;
use crate::{Error, Result};
use hemicube_store::{self as store, ElementType, FactorSlice, NpzWriter};
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
            member("data", entries, export.precision().size() as u64),
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
        npz.begin("data", export.precision().element(), &[entries])
            .map_err(on_write)?;
        for row in export.rows()? {
            match row?.1.data.as_slice() {
                FactorSlice::Single(factors) => npz.push(factors),
                FactorSlice::Double(factors) => npz.push(factors),
            }
            .map_err(on_write)?;
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
        let precision = export.precision();
        let header = precision.element().npy_header(&[rows, columns]).len() as u64;
        Ok(Some(Forecast::exact(header + precision.size() as u64 * rows * columns)))
    }

    fn write<'a>(&self, export: &Export<'_>, mut file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        let on_write = |error| export.on_write(error);
        let (rows, columns) = (export.row_count(), export.column_count());
        let precision = export.precision();
        file.write_all(&precision.element().npy_header(&[rows.into(), columns.into()]))
            .map_err(on_write)?;
        let size = precision.size();
        let (mut bytes, mut number) = (vec![0; size * columns as usize], Vec::with_capacity(size));
        for patch in export.patches() {
            bytes.fill(0);
            if let Some(row) = export.row(patch)? {
                for (&column, factor) in row.indices.iter().zip(&row.data) {
                    let place = size * column as usize;
                    number.clear();
                    precision.put(factor, &mut number);
                    bytes[place..place + size].copy_from_slice(&number);
                }
            }
            file.write_all(&bytes).map_err(on_write)?;
        }
        Ok(file)
    }
}
