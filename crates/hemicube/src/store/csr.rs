//! A compressed-row matrix in an archive of arrays: as SciPy saves it, and as every part of a store is.
//!
//! Only `indptr` is in memory. A row is two reads at its offset, unless the archive is compressed.

use super::durable::read_exact_at;
use super::npy::{Element, ElementType, decode};
use super::npz::{Elements, Npz};
use super::{Error, Result};
use std::fs::File;
use std::path::{Path, PathBuf};

/// An array whose elements can be read from any place on.
#[derive(Debug)]
struct Sequence {
    element: ElementType,
    elements: Elements,
}

impl Sequence {
    /// The bytes of `count` elements from `start` on. Both were held against the array's length.
    fn read(&self, path: &Path, file: &File, start: u64, count: u64) -> Result<Vec<u8>> {
        let too_large = || Error::unsupported(path, "has a row that is too large for this machine's memory");
        let first = start * self.element.size();
        let size = usize::try_from(count * self.element.size()).map_err(|_| too_large())?;
        match &self.elements {
            Elements::Stored(offset) => {
                let mut bytes = vec![0; size];
                read_exact_at(file, &mut bytes, offset + first).map_err(|error| Error::io(path, "read", error))?;
                Ok(bytes)
            }
            Elements::Memory(bytes) => {
                let first = usize::try_from(first).map_err(|_| too_large())?;
                let range = first..first.saturating_add(size);
                bytes
                    .get(range)
                    .map(<[u8]>::to_vec)
                    .ok_or_else(|| Error::malformed(path, "is truncated"))
            }
        }
    }
}

/// A compressed-row matrix in a file.
#[derive(Debug)]
pub(crate) struct CsrFile {
    path: PathBuf,
    pub(crate) row_count: u64,
    pub(crate) column_count: u64,
    indptr: Vec<u64>,
    indices: Sequence,
    data: Sequence,
}

impl CsrFile {
    /// Reads everything but the entries.
    pub(crate) fn read(path: &Path, npz: &mut Npz) -> Result<Self> {
        let format: Vec<u8> = match npz.header("format")?.element {
            ElementType::Bytes(_) | ElementType::Text(_) => {
                npz.bytes("format")?.into_iter().filter(|&byte| byte != 0).collect()
            }
            _ => Vec::new(),
        };
        if format != b"csr" {
            let format = String::from_utf8_lossy(&format).into_owned();
            return Err(Error::unsupported(
                path,
                format!("is a matrix of format `{format}`; save it with `.tocsr()`"),
            ));
        }
        let shape = npz.counts("shape")?;
        let &[row_count, column_count] = shape.as_slice() else {
            return Err(Error::malformed(path, "has a shape that is not of two lengths"));
        };
        let indptr = npz.counts("indptr")?;
        let entries = npz.count("data")?;
        let divides = (indptr.len() as u64).checked_sub(1) == Some(row_count)
            && indptr.first() == Some(&0)
            && indptr.last() == Some(&entries)
            && indptr.is_sorted();
        if !divides || npz.count("indices")? != entries {
            return Err(Error::malformed(
                path,
                "has an `indptr` that does not divide its entries into rows",
            ));
        }
        let mut sequence = |name| -> Result<Sequence> {
            Ok(Sequence {
                element: npz.header(name)?.element,
                elements: npz.elements(name)?,
            })
        };
        let (indices, data) = (sequence("indices")?, sequence("data")?);
        if !matches!(indices.element, ElementType::I32 | ElementType::I64) {
            return Err(Error::malformed(
                path,
                "has `indices` that are not signed whole numbers",
            ));
        }
        if !matches!(data.element, ElementType::F32 | ElementType::F64) {
            return Err(Error::unsupported(
                path,
                "has `data` that are not f4 or f8; save it as one of these",
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            row_count,
            column_count,
            indptr,
            indices,
            data,
        })
    }

    pub(crate) fn is_store_part(&self) -> bool {
        self.indices.element == ElementType::I32 && self.data.element == ElementType::F32
    }

    pub(crate) fn entries(&self) -> u64 {
        self.indptr.last().copied().unwrap_or(0)
    }

    /// Where a row's entries begin and how many it has; none where there is no such row.
    pub(crate) fn bounds(&self, row: u64) -> (u64, u64) {
        let bound = |row: u64| usize::try_from(row).ok().and_then(|row| self.indptr.get(row)).copied();
        match (bound(row), bound(row.saturating_add(1))) {
            (Some(start), Some(end)) => (start, end - start),
            _ => (0, 0),
        }
    }

    /// The columns and values of a row as they stand in a store's part.
    pub(crate) fn row(&self, file: &File, row: u64) -> Result<(Vec<i32>, Vec<f32>)> {
        let (start, count) = self.bounds(row);
        Ok((
            decode(&self.indices.read(&self.path, file, start, count)?),
            decode(&self.data.read(&self.path, file, start, count)?),
        ))
    }

    /// The columns and values of a row of any matrix, with ascending columns, equal ones added up, all in range.
    pub(crate) fn row_f64(&self, file: &File, row: u64) -> Result<(Vec<u32>, Vec<f64>)> {
        let (start, count) = self.bounds(row);
        let columns = self.indices.read(&self.path, file, start, count)?;
        let columns: Vec<i64> = match self.indices.element {
            ElementType::I32 => columns.chunks_exact(4).map(|chunk| i32::get(chunk).into()).collect(),
            _ => decode(&columns),
        };
        let values = self.data.read(&self.path, file, start, count)?;
        let values: Vec<f64> = match self.data.element {
            ElementType::F32 => values.chunks_exact(4).map(|chunk| f32::get(chunk).into()).collect(),
            _ => decode(&values),
        };
        let mut entries = Vec::with_capacity(columns.len());
        for (column, value) in columns.into_iter().zip(values) {
            match u32::try_from(column) {
                Ok(column) if u64::from(column) < self.column_count => entries.push((column, value)),
                _ => {
                    let reason = format!("has column {column} in row {row}, of {} columns", self.column_count);
                    return Err(Error::malformed(&self.path, reason));
                }
            }
        }
        Ok(super::matrix::gather(entries))
    }
}
