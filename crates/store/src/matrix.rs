//! A form-factor matrix from wherever it comes: a store, SciPy's `.npz`, Matrix Market, a dense `.npy`. For
//! comparisons.
//!
//! Rows of a store, of an uncompressed `.npz` and of a `.npy` are read when they are asked for; a compressed `.npz` and
//! a Matrix Market file are held in memory.

use super::csr::CsrFile;
use super::durable::read_exact_at;
use super::npy::{Element, ElementType, Header, decode};
use super::npz::Npz;
use super::{Error, Result, Store};
use hemicube_scene::InputPatch;
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

/// The longest line of a Matrix Market file. The format allows 1024 characters.
const LINE_MAX: u64 = 4096;

/// The comment in a Matrix Market file of ours by which its values are read as what they were.
pub const F32_COMMENT: &str = "% values are f32, in the fewest digits that read back to the same f32";

/// A row of a matrix, in f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MatrixRow {
    /// Ascending column numbers, from 0.
    pub columns: Vec<u32>,
    /// The value of each. All finite.
    pub values: Vec<f64>,
}

#[derive(Debug)]
enum Source {
    Store(Box<Store>),
    Csr {
        csr: CsrFile,
        file: File,
    },
    /// By row, then column. No array as long as the matrix is high: its height is only a claim of the file.
    Triplets(Vec<(u32, u32, f64)>),
    Dense {
        element: ElementType,
        offset: u64,
        file: File,
    },
}

/// A square matrix that rows can be read of.
///
/// ```
/// use hemicube_store::Matrix;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("plates.mtx");
///
/// std::fs::write(&path, "%%MatrixMarket matrix coordinate real general\n2 2 2\n1 2 0.25\n2 1 0.75\n")?;
/// let matrix = Matrix::open(&path)?;
/// let row = matrix.row(1)?.ok_or("no such row")?;
/// assert_eq!((matrix.patch_count(), row.columns, row.values), (2, vec![0], vec![0.75]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Matrix {
    path: PathBuf,
    patch_count: u32,
    source: Source,
}

/// Sorts a row's entries by column and adds equal columns up, as sparse formats have it.
pub(super) fn gather(mut entries: Vec<(u32, f64)>) -> (Vec<u32>, Vec<f64>) {
    if !entries.is_sorted_by_key(|&(column, _)| column) {
        // Stable, so that the sum does not depend on anything but the file.
        entries.sort_by_key(|&(column, _)| column);
    }
    let (mut columns, mut values): (Vec<u32>, Vec<f64>) = (Vec::new(), Vec::new());
    columns.reserve_exact(entries.len());
    values.reserve_exact(entries.len());
    for (column, value) in entries {
        match (columns.last(), values.last_mut()) {
            (Some(&last), Some(sum)) if last == column => *sum += value,
            _ => {
                columns.push(column);
                values.push(value);
            }
        }
    }
    (columns, values)
}

impl Matrix {
    /// Opens a store (a directory), a CSR matrix that SciPy saved (`.npz`), a Matrix Market file (`.mtx`) or a dense
    /// array (`.npy`).
    ///
    /// # Errors
    /// [`Error::Unsupported`] for another kind of file; [`Error::Malformed`] for a damaged one.
    pub fn open(path: &Path) -> Result<Self> {
        if path.is_dir() {
            let store = Store::open(path)?;
            return Ok(Self {
                path: path.to_owned(),
                patch_count: store.patch_count(),
                source: Source::Store(Box::new(store)),
            });
        }
        let extension = path
            .extension()
            .map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("npz") => Self::open_csr(path),
            Some("npy") => Self::open_dense(path),
            Some("mtx") => Self::open_market(path),
            _ => Err(Error::unsupported(
                path,
                "is no matrix that can be read; give a store's directory, or a `.npz`, `.mtx` or `.npy` file",
            )),
        }
    }

    /// The file or directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of rows and of columns.
    pub fn patch_count(&self) -> u32 {
        self.patch_count
    }

    /// The store, if it is one.
    pub fn store(&self) -> Option<&Store> {
        match &self.source {
            Source::Store(store) => Some(store),
            _ => None,
        }
    }

    /// A row, from 0. `None` when a store does not have it, which only a store can tell: elsewhere it is empty.
    ///
    /// # Errors
    /// When the file is damaged, or a value is not finite.
    pub fn row(&self, row: u32) -> Result<Option<MatrixRow>> {
        if row >= self.patch_count {
            return Ok(None);
        }
        let (columns, values) = match &self.source {
            Source::Store(store) => match store.row(InputPatch(row))? {
                Some(row) => (row.indices, row.data.into_f64()),
                None => return Ok(None),
            },
            Source::Csr { csr, file } => csr.row_f64(file, row.into())?,
            Source::Triplets(entries) => {
                let start = entries.partition_point(|&(other, ..)| other < row);
                let of_row = entries[start..].iter().take_while(|&&(other, ..)| other == row);
                of_row.map(|&(_, column, value)| (column, value)).unzip()
            }
            Source::Dense { element, offset, file } => self.dense_row(*element, *offset, file, row)?,
        };
        if let Some((column, value)) = columns.iter().zip(&values).find(|(_, value)| !value.is_finite()) {
            return Err(Error::malformed(
                &self.path,
                format!("has {value} at row {row}, column {column}"),
            ));
        }
        Ok(Some(MatrixRow { columns, values }))
    }

    /// The first row at or after `row` that can have entries.
    #[doc(hidden)]
    pub fn next_row(&self, row: u32) -> Option<u32> {
        match &self.source {
            Source::Triplets(entries) => entries
                .get(entries.partition_point(|&(other, ..)| other < row))
                .map(|e| e.0),
            _ => (row < self.patch_count).then_some(row),
        }
    }

    fn dense_row(&self, element: ElementType, offset: u64, file: &File, row: u32) -> Result<(Vec<u32>, Vec<f64>)> {
        let row_size = u64::from(self.patch_count) * element.size();
        let size = usize::try_from(row_size)
            .map_err(|_| Error::unsupported(&self.path, "has a row that is too large for this machine's memory"))?;
        let mut bytes = vec![0; size];
        read_exact_at(file, &mut bytes, offset + u64::from(row) * row_size)
            .map_err(|error| Error::io(&self.path, "read", error))?;
        let values: Vec<f64> = match element {
            ElementType::F32 => bytes.chunks_exact(4).map(|chunk| f32::get(chunk).into()).collect(),
            _ => decode(&bytes),
        };
        Ok((0..).zip(values).filter(|&(_, value)| value != 0.0).unzip())
    }

    /// The size of a matrix that must be square.
    fn square(path: &Path, rows: u64, columns: u64) -> Result<u32> {
        let size = u32::try_from(rows).ok().filter(|&size| size <= super::PATCH_COUNT_MAX);
        size.filter(|_| rows == columns).ok_or_else(|| {
            Error::malformed(
                path,
                format!("has {rows} rows and {columns} columns; a form-factor matrix is square"),
            )
        })
    }

    fn open_csr(path: &Path) -> Result<Self> {
        let mut npz = Npz::open(path)?;
        let csr = CsrFile::read(path, &mut npz)?;
        // Rows are read at their offsets, where nothing holds them against the archive's CRC.
        npz.verify()?;
        let patch_count = Self::square(path, csr.row_count, csr.column_count)?;
        Ok(Self {
            path: path.to_owned(),
            patch_count,
            source: Source::Csr {
                csr,
                file: npz.into_file(),
            },
        })
    }

    fn open_dense(path: &Path) -> Result<Self> {
        let mut file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
        let header = Header::read(&mut file)
            .map_err(|error| Error::io(path, "read", error))?
            .map_err(|reason| Error::malformed(path, reason))?;
        let length = file.metadata().map_err(|error| Error::io(path, "read", error))?.len();
        if header.fortran_order || !matches!(header.element, ElementType::F32 | ElementType::F64) {
            return Err(Error::unsupported(
                path,
                "is not an array of f4 or f8 in C order; save it as one",
            ));
        }
        let &[rows, columns] = header.shape.as_slice() else {
            return Err(Error::malformed(path, "is no matrix: its shape is not of two lengths"));
        };
        let patch_count = Self::square(path, rows, columns)?;
        if header.total_size() != Some(length) {
            return Err(Error::malformed(
                path,
                "is not as long as its shape says: it is truncated or damaged",
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            patch_count,
            source: Source::Dense {
                element: header.element,
                offset: header.size,
                file,
            },
        })
    }

    fn open_market(path: &Path) -> Result<Self> {
        let file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
        let length = file.metadata().map_err(|error| Error::io(path, "read", error))?.len();
        let mut lines = Lines {
            path,
            reader: BufReader::with_capacity(1 << 18, file),
            number: 0,
            text: String::new(),
        };
        let banner = lines.next()?.unwrap_or("").to_ascii_lowercase();
        let words: Vec<&str> = banner.split_ascii_whitespace().collect();
        let symmetric = match words.as_slice() {
            [
                "%%matrixmarket",
                "matrix",
                "coordinate",
                "real" | "integer",
                symmetry @ ("general" | "symmetric"),
            ] => *symmetry == "symmetric",
            ["%%matrixmarket", ..] => {
                return Err(Error::unsupported(
                    path,
                    "is not a `matrix coordinate real general` or `symmetric` of Matrix Market; write it as one",
                ));
            }
            _ => return Err(Error::malformed(path, "does not begin with `%%MatrixMarket`")),
        };
        // An f32 printed in few digits is another number when it is read as f64.
        let mut is_f32 = false;
        let sizes = loop {
            match lines.next()? {
                None => break String::new(),
                Some(line) if line.starts_with('%') => is_f32 |= line == F32_COMMENT,
                Some("") => {}
                Some(line) => break line.to_owned(),
            }
        };
        let sizes: Vec<u64> = sizes
            .split_ascii_whitespace()
            .filter_map(|word| word.parse().ok())
            .collect();
        let &[rows, columns, count] = sizes.as_slice() else {
            return Err(lines.malformed("should have rows, columns and entries"));
        };
        let patch_count = Self::square(path, rows, columns)?;
        // The shortest line is `1 1 0` and its end.
        if count > length / 6 + 1 {
            return Err(lines.malformed("claims more entries than the file has room for"));
        }
        let mut triplets: Vec<(u32, u32, f64)> = Vec::new();
        let mut seen = 0u64;
        while let Some(line) = lines.next_entry()? {
            let mut words = line.split_ascii_whitespace();
            let mut place = || -> Option<u32> {
                let place: u32 = words.next()?.parse().ok()?;
                place.checked_sub(1).filter(|&place| place < patch_count)
            };
            let entry = place().zip(place());
            let value = words.next().and_then(|word| {
                if is_f32 {
                    word.parse().ok().map(|value: f32| value.into())
                } else {
                    word.parse::<f64>().ok()
                }
            });
            let (Some((row, column)), Some(value), None) = (entry, value, words.next()) else {
                return Err(lines.malformed(&format!(
                    "should have a row and a column from 1 to {patch_count}, and a number"
                )));
            };
            seen += 1;
            if seen > count {
                return Err(lines.malformed("is one entry more than the file claims"));
            }
            triplets.push((row, column, value));
            if symmetric && row != column {
                triplets.push((column, row, value));
            }
        }
        if seen != count {
            return Err(Error::malformed(
                path,
                format!("has {seen} entries of {count}: it is truncated"),
            ));
        }
        triplets.sort_by_key(|&(row, column, _)| (row, column));
        let place = |&(row, column, _): &(u32, u32, f64)| (row, column);
        if let Some(twice) = triplets.windows(2).find(|pair| place(&pair[0]) == place(&pair[1])) {
            return Err(lines.doubled(place(&twice[0]), symmetric));
        }
        Ok(Self {
            path: path.to_owned(),
            patch_count,
            source: Source::Triplets(triplets),
        })
    }
}

/// The lines of a text file, none of them longer than [`LINE_MAX`].
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    number: u64,
    text: String,
}

impl Lines<'_> {
    fn next(&mut self) -> Result<Option<&str>> {
        use std::io::Read;
        self.text.clear();
        self.number += 1;
        let count = self
            .reader
            .by_ref()
            .take(LINE_MAX)
            .read_line(&mut self.text)
            .map_err(|error| Error::io(self.path, "read as text", error))?;
        if count as u64 == LINE_MAX && !self.text.ends_with('\n') {
            return Err(self.malformed("is too long"));
        }
        Ok((count > 0).then(|| self.text.trim()))
    }

    /// The next line that is neither empty nor a comment.
    fn next_entry(&mut self) -> Result<Option<&str>> {
        loop {
            match self.next()? {
                None => return Ok(None),
                Some(line) if line.is_empty() || line.starts_with('%') => {}
                Some(_) => return Ok(Some(self.text.trim())),
            }
        }
    }

    fn malformed(&self, reason: &str) -> Error {
        Error::MalformedLine {
            path: self.path.to_owned(),
            line: self.number,
            reason: reason.to_owned(),
        }
    }

    /// The error of a place with two entries, at the line of the second. Read again, because triplets keep no lines.
    fn doubled(mut self, (row, column): (u32, u32), symmetric: bool) -> Error {
        if let Err(error) = self.reader.rewind() {
            return Error::io(self.path, "read", error);
        }
        self.number = 0;
        let (mut has_sizes, mut has_one) = (false, false);
        loop {
            let words = match self.next_entry() {
                Ok(Some(line)) => line.split_ascii_whitespace(),
                Ok(None) => return Error::malformed(self.path, "has changed while it was read"),
                Err(error) => return error,
            };
            let mut numbers = words.map_while(|word| word.parse::<u32>().ok()?.checked_sub(1));
            let found = numbers.next().zip(numbers.next());
            // The first line that is no comment has the sizes.
            let is_entry = std::mem::replace(&mut has_sizes, true);
            let is_it = found == Some((row, column)) || symmetric && found == Some((column, row));
            if is_entry && is_it && std::mem::replace(&mut has_one, true) {
                let (row, column) = found.unwrap_or((row, column));
                return self.malformed(&format!(
                    "row {}, column {} has an entry before; leave one of the two out, or write their sum{}",
                    u64::from(row) + 1,
                    u64::from(column) + 1,
                    if symmetric {
                        ": a symmetric file has one of each pair"
                    } else {
                        ""
                    }
                ));
            }
        }
    }
}
