//! A compressed-row matrix in an archive of arrays: SciPy's, and every part of a store in either form.
//!
//! Only `indptr` (and `runptr`) is in memory. A row is two or three reads at its offset, unless the archive is
//! compressed.

use super::durable::read_exact_at;
use super::npy::{Element, ElementType, decode};
use super::npz::{Elements, Npz};
use super::{Error, FactorVec, Form, Result, compact};
use std::fs::File;
use std::path::{Path, PathBuf};

/// An array with elements that can be read from any place on.
#[derive(Debug)]
struct Sequence {
    element: ElementType,
    elements: Elements,
}

impl Sequence {
    fn of(npz: &mut Npz, name: &str) -> Result<Self> {
        npz.require_vector(name)?;
        Ok(Self {
            element: npz.header(name)?.element,
            elements: npz.elements(name)?,
        })
    }

    /// [`Self::read`] into a buffer.
    fn read_into(&self, path: &Path, file: &File, start: u64, count: u64, bytes: &mut Vec<u8>) -> Result<()> {
        let Elements::Stored(offset) = &self.elements else {
            *bytes = self.read(path, file, start, count)?;
            return Ok(());
        };
        let size = usize::try_from(count * self.element.size())
            .map_err(|_| Error::unsupported(path, "has a row that is too large for this machine's memory"))?;
        bytes.resize(size, 0);
        read_exact_at(file, bytes, offset + start * self.element.size()).map_err(|error| Error::io(path, "read", error))
    }

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

/// Entries read at a time when rows are visited: 128 kB in the plain form, leaving most of a core's cache to x.
const ENTRIES_AT_A_TIME: u64 = 1 << 14;

/// Buffers for rows.
#[derive(Debug, Default)]
pub(crate) struct Buffers([Vec<u8>; 3]);

/// A row in its file's form.
#[derive(Clone, Copy, Debug)]
pub(crate) enum EncodedRow<'a> {
    /// i4, and f4 or f8.
    Plain {
        columns: &'a [u8],
        values: EncodedValues<'a>,
    },
    /// u2, u1 and u2.
    Compact {
        gaps: &'a [u8],
        lengths: &'a [u8],
        codes: &'a [u8],
        /// By how much a code stands for more: a power of two.
        scale: f32,
    },
}

/// Form factors of a row in their file's width, little-endian.
#[derive(Clone, Copy, Debug)]
pub(crate) enum EncodedValues<'a> {
    /// f4.
    Single(&'a [u8]),
    /// f8.
    Double(&'a [u8]),
}

/// A compressed-row matrix in a file.
#[derive(Debug)]
pub(crate) struct CsrFile {
    path: PathBuf,
    pub(crate) row_count: u64,
    pub(crate) column_count: u64,
    indptr: Vec<u64>,
    entries: Entries,
}

/// Columns and values in the file's form.
#[derive(Debug)]
enum Entries {
    Plain {
        indices: Sequence,
        data: Sequence,
    },
    Compact {
        runptr: Vec<u64>,
        gaps: Sequence,
        lengths: Sequence,
        codes: Sequence,
        /// By how much a code stands for more: 1, or [`compact::RAISED`].
        scale: f32,
    },
}

/// The form factors of codes.
fn decoded(codes: Vec<u16>, scale: f32) -> FactorVec {
    FactorVec::Single(codes.into_iter().map(|code| compact::factor(code) * scale).collect())
}

/// Asks the system to read a whole file ahead, where it can be asked. Arrays of a part are read by turns in pieces, and
/// systems do not take that for one file read in order.
pub(super) fn will_read(file: &File) {
    #[cfg(target_os = "linux")]
    {
        // Advice only: without it, reads wait longer.
        let _ = rustix::fs::fadvise(file, 0, None, rustix::fs::Advice::WillNeed);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = file;
}

/// Form factors from their bytes.
fn factors(element: ElementType, bytes: &[u8]) -> FactorVec {
    match element {
        ElementType::F64 => FactorVec::Double(decode(bytes)),
        _ => FactorVec::Single(decode(bytes)),
    }
}

/// Start and number of a row's entries; none beyond the last row.
fn bounds(bounds: &[u64], row: u64) -> (u64, u64) {
    let bound = |row: u64| usize::try_from(row).ok().and_then(|row| bounds.get(row)).copied();
    match (bound(row), bound(row.saturating_add(1))) {
        (Some(start), Some(end)) => (start, end - start),
        _ => (0, 0),
    }
}

/// Returns whether `bounds` divides `count` elements into rows.
fn divides(bounds: &[u64], rows: u64, count: u64) -> bool {
    (bounds.len() as u64).checked_sub(1) == Some(rows)
        && bounds.first() == Some(&0)
        && bounds.last() == Some(&count)
        && bounds.is_sorted()
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
        let (form, scale) = match format.as_slice() {
            b"csr" => (Form::Plain, 1.0),
            b"run" => (Form::Compact, 1.0),
            b"r15" => (Form::Compact, compact::RAISED),
            _ => {
                let format = String::from_utf8_lossy(&format).into_owned();
                return Err(Error::unsupported(
                    path,
                    format!("is a matrix of format `{format}`; save it with `.tocsr()`"),
                ));
            }
        };
        let shape = npz.counts("shape")?;
        let &[row_count, column_count] = shape.as_slice() else {
            return Err(Error::malformed(path, "has a shape that is not of two lengths"));
        };
        let indptr = npz.counts("indptr")?;
        let wrong =
            |name: &str| Error::malformed(path, format!("has `{name}` that do not divide its entries into rows"));
        let values = if form == Form::Compact { "codes" } else { "data" };
        if !divides(&indptr, row_count, npz.count(values)?) {
            return Err(wrong("indptr"));
        }
        let entries = match form {
            Form::Plain | Form::Double => Self::read_plain(path, npz, &wrong)?,
            Form::Compact => Self::read_compact(path, npz, row_count, scale, &wrong)?,
        };
        Ok(Self {
            path: path.to_owned(),
            row_count,
            column_count,
            indptr,
            entries,
        })
    }

    fn read_plain(path: &Path, npz: &mut Npz, wrong: &dyn Fn(&str) -> Error) -> Result<Entries> {
        if npz.count("indices")? != npz.count("data")? {
            return Err(wrong("indices"));
        }
        let (indices, data) = (Sequence::of(npz, "indices")?, Sequence::of(npz, "data")?);
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
        Ok(Entries::Plain { indices, data })
    }

    fn read_compact(
        path: &Path,
        npz: &mut Npz,
        row_count: u64,
        scale: f32,
        wrong: &dyn Fn(&str) -> Error,
    ) -> Result<Entries> {
        let runptr = npz.counts("runptr")?;
        let runs = npz.count("gaps")?;
        if !divides(&runptr, row_count, runs) || npz.count("lengths")? != runs {
            return Err(wrong("runptr"));
        }
        let (gaps, lengths, codes) = (
            Sequence::of(npz, "gaps")?,
            Sequence::of(npz, "lengths")?,
            Sequence::of(npz, "codes")?,
        );
        let elements = [gaps.element, lengths.element, codes.element];
        if elements != [ElementType::U16, ElementType::U8, ElementType::U16] {
            return Err(Error::malformed(
                path,
                "has `gaps`, `lengths` and `codes` that are not u2, u1 and u2",
            ));
        }
        Ok(Entries::Compact {
            runptr,
            gaps,
            lengths,
            codes,
            scale,
        })
    }

    /// Returns whether its arrays are those of a part of this form, `is_of_arrivals` if form factors may be 2 and more.
    pub(crate) fn is_store_part(&self, form: Form, is_of_arrivals: bool) -> bool {
        match &self.entries {
            Entries::Plain { indices, data } => {
                let is_of_form = form != Form::Compact && data.element == form.precision().element();
                is_of_form && indices.element == ElementType::I32
            }
            Entries::Compact { scale, .. } => form == Form::Compact && (*scale == 1.0 || is_of_arrivals),
        }
    }

    pub(crate) fn entries(&self) -> u64 {
        self.indptr.last().copied().unwrap_or(0)
    }

    /// Start and number of a row's entries; none beyond the last row.
    pub(crate) fn bounds(&self, row: u64) -> (u64, u64) {
        bounds(&self.indptr, row)
    }

    /// The columns and values of a row in a store's part, in the file's form.
    pub(crate) fn row(&self, file: &File, row: u64) -> Result<(Vec<i32>, FactorVec)> {
        let (start, count) = self.bounds(row);
        let read = |sequence: &Sequence, (start, count)| sequence.read(&self.path, file, start, count);
        match &self.entries {
            Entries::Plain { indices, data } => Ok((
                decode(&read(indices, (start, count))?),
                factors(data.element, &read(data, (start, count))?),
            )),
            Entries::Compact {
                runptr,
                gaps,
                lengths,
                codes,
                scale,
            } => {
                let runs = bounds(runptr, row);
                let mut columns = Vec::new();
                let (gaps, lengths) = (decode(&read(gaps, runs)?), read(lengths, runs)?);
                if !compact::columns(&gaps, &lengths, count, &mut columns) {
                    return Err(self.no_columns(row));
                }
                let codes: Vec<u16> = decode(&read(codes, (start, count))?);
                Ok((columns, decoded(codes, *scale)))
            }
        }
    }

    /// Hands the rows of a store's part to `each` in order, as bytes of the file, in pieces that fit a cache.
    pub(crate) fn visit(
        &self,
        file: &File,
        buffers: &mut Buffers,
        each: &mut dyn FnMut(u64, EncodedRow<'_>) -> Option<()>,
    ) -> Result<()> {
        let [first, second, third] = &mut buffers.0;
        // Each array by a file of its own: systems read ahead in files read in order, and these take turns.
        let open = || hemicube_scene::open_regular(&self.path).map_err(|error| Error::io(&self.path, "opened", error));
        let (file_of_second, file_of_third) = (open()?, open()?);
        let mut row = 0;
        while row < self.row_count {
            let start = self.bounds(row).0;
            let mut end = row + 1;
            while end < self.row_count && self.bounds(end).0 + self.bounds(end).1 - start <= ENTRIES_AT_A_TIME {
                end += 1;
            }
            let count = self.bounds(end - 1).0 + self.bounds(end - 1).1 - start;
            // Bounds of one row within the bytes read.
            let part = |bytes: &[u8], (of_row, length): (u64, u64), start: u64, size: u64| -> std::ops::Range<usize> {
                let at =
                    |place: u64| usize::try_from((place - start) * size).map_or(bytes.len(), |at| at.min(bytes.len()));
                at(of_row)..at(of_row + length)
            };
            let accepted = match &self.entries {
                Entries::Plain { indices, data } => {
                    indices.read_into(&self.path, file, start, count, first)?;
                    data.read_into(&self.path, &file_of_second, start, count, second)?;
                    (row..end).all(|row| {
                        let columns = &first[part(first, self.bounds(row), start, 4)];
                        let values = &second[part(second, self.bounds(row), start, data.element.size())];
                        let values = match data.element {
                            ElementType::F64 => EncodedValues::Double(values),
                            _ => EncodedValues::Single(values),
                        };
                        each(row, EncodedRow::Plain { columns, values }).is_some()
                    })
                }
                Entries::Compact {
                    runptr,
                    gaps,
                    lengths,
                    codes,
                    scale,
                } => {
                    let runs = bounds(runptr, row).0;
                    let last = bounds(runptr, end - 1);
                    let run_count = last.0 + last.1 - runs;
                    gaps.read_into(&self.path, file, runs, run_count, first)?;
                    lengths.read_into(&self.path, &file_of_second, runs, run_count, second)?;
                    codes.read_into(&self.path, &file_of_third, start, count, third)?;
                    (row..end).all(|row| {
                        let of_row = bounds(runptr, row);
                        let encoded = EncodedRow::Compact {
                            gaps: &first[part(first, of_row, runs, 2)],
                            lengths: &second[part(second, of_row, runs, 1)],
                            codes: &third[part(third, self.bounds(row), start, 2)],
                            scale: *scale,
                        };
                        each(row, encoded).is_some()
                    })
                }
            };
            if !accepted {
                return Err(Error::malformed(
                    &self.path,
                    "has columns that are not of the matrix: it is damaged",
                ));
            }
            row = end;
        }
        Ok(())
    }

    /// The columns and values of all rows of a store's part, from its open archive.
    pub(crate) fn rows(&self, npz: &mut Npz) -> Result<(Vec<i32>, FactorVec)> {
        let (runptr, scale) = match &self.entries {
            Entries::Compact { runptr, scale, .. } => (runptr, *scale),
            Entries::Plain { data, .. } => {
                let factors = match data.element {
                    ElementType::F64 => FactorVec::Double(npz.array("data")?),
                    _ => FactorVec::Single(npz.array("data")?),
                };
                return Ok((npz.array("indices")?, factors));
            }
        };
        let codes: Vec<u16> = npz.array("codes")?;
        let (gaps, lengths): (Vec<u16>, Vec<u8>) = (npz.array("gaps")?, npz.array("lengths")?);
        let mut columns = Vec::with_capacity(codes.len());
        for row in 0..self.row_count {
            let (start, count) = bounds(runptr, row);
            let range = |bound: u64| usize::try_from(bound).unwrap_or(usize::MAX);
            let runs = range(start)..range(start.saturating_add(count));
            let (gaps, lengths) = (gaps.get(runs.clone()).unwrap_or(&[]), lengths.get(runs).unwrap_or(&[]));
            if !compact::columns(gaps, lengths, self.bounds(row).1, &mut columns) {
                return Err(self.no_columns(row));
            }
        }
        Ok((columns, decoded(codes, scale)))
    }

    fn no_columns(&self, row: u64) -> Error {
        Error::malformed(
            &self.path,
            format!("has runs of columns in row {row} that are not of its entries: it is damaged"),
        )
    }

    /// The columns and values of a row of any matrix, with ascending columns, equal ones added up, all in range.
    pub(crate) fn row_f64(&self, file: &File, row: u64) -> Result<(Vec<u32>, Vec<f64>)> {
        let (start, count) = self.bounds(row);
        let (columns, values): (Vec<i64>, Vec<f64>) = match &self.entries {
            Entries::Plain { indices, data } => {
                let columns = indices.read(&self.path, file, start, count)?;
                let columns = match indices.element {
                    ElementType::I32 => columns.chunks_exact(4).map(|chunk| i32::get(chunk).into()).collect(),
                    _ => decode(&columns),
                };
                let values = data.read(&self.path, file, start, count)?;
                let values = match data.element {
                    ElementType::F32 => values.chunks_exact(4).map(|chunk| f32::get(chunk).into()).collect(),
                    _ => decode(&values),
                };
                (columns, values)
            }
            Entries::Compact { .. } => {
                let (columns, values) = self.row(file, row)?;
                (columns.into_iter().map(i64::from).collect(), values.into_f64())
            }
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
