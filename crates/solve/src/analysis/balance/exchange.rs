//! Entries sorted by column: for each part a run of the entries in other rows with columns among its rows.
//!
//! ```text
//! record  u32 row of the part (the entry's column)   u32 input patch of the entry's row   f32 form factor    12 bytes
//!         or, of a double store,                                                         f64 form factor    16 bytes
//! ```
//!
//! The runs lie one behind the other in one file, with lengths counted by a first pass, and are filled through small
//! buffers: a file for each run would exceed the number of open files.

use super::require_part;
use hemicube_store::{Error, PatchTable, Precision, Result, Store};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes of a record.
pub(crate) const fn record_size(precision: Precision) -> usize {
    8 + precision.size()
}

/// Bytes of all buffers together, as far as each has room for some records.
const BUFFERS: usize = 64 << 20;

/// An entry, for the row of its column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Record {
    /// Place in the part of the row that is the entry's column.
    pub(crate) row: u32,
    /// The input patch of the entry's row: a column to that row.
    pub(crate) column: u32,
    /// The form factor.
    pub(crate) factor: f64,
}

/// The records of a part's row, and the rest. Records are sorted.
pub(crate) fn split_row(records: &[Record], row: usize) -> (&[Record], &[Record]) {
    records.split_at(records.partition_point(|record| record.row as usize <= row))
}

/// Findings of one pass over a store.
#[derive(Debug)]
pub(crate) struct Survey {
    /// The input patch of each row, in the processing order.
    pub(crate) order: Vec<u32>,
    /// The place of each input patch in that order; out of range for one without a row.
    position: Vec<u32>,
    /// Number of entries with columns among the rows of each part.
    counts: Vec<u64>,
    rows_per_part: u32,
}

impl Survey {
    /// Reads every part, verifies its checksum, and refuses invalid form factors.
    pub(crate) fn new(store: &Store, table: &PatchTable) -> Result<Self> {
        let manifest = store.manifest();
        let most = table.most_of_itself(manifest.patch_kind(), manifest.has_portals());
        let order: Vec<u32> = store.processing_order()?.iter().map(|patch| patch.0).collect();
        let mut position = vec![u32::MAX; manifest.patch_count as usize];
        for (place, &patch) in (0..).zip(&order) {
            match position.get_mut(patch as usize) {
                Some(slot) if *slot == u32::MAX => *slot = place,
                _ => {
                    let reason = format!("has a row of patch {patch}, which does not exist or has a row already");
                    return Err(Error::malformed(store.directory(), reason));
                }
            }
        }
        let mut survey = Self {
            order,
            position,
            counts: vec![0; manifest.parts.len()],
            rows_per_part: manifest.rows_per_part.max(1),
        };
        for place in 0..manifest.parts.len() {
            store.verify_part(place)?;
            let part = require_part(store, place)?;
            for (row, &patch) in part.rows.iter().enumerate() {
                let (columns, factors) = part.row(row);
                let mut before = -1;
                for (&column, factor) in columns.iter().zip(factors) {
                    let exists = u32::try_from(column).is_ok_and(|column| column < manifest.patch_count);
                    let is_own = column == patch.cast_signed();
                    let is_factor = factor >= 0.0
                        && factor.is_finite()
                        && (!is_own || factor <= most.get(patch as usize).copied().unwrap_or(0.0));
                    if !exists || column <= before || !is_factor {
                        let reason = format!("has F[{patch}, {column}] = {factor} where none can be");
                        return Err(Error::malformed(
                            &store.directory().join(&manifest.parts[place].file),
                            reason,
                        ));
                    }
                    before = column;
                    if let Some((other, _)) = survey.position_of(column.cast_unsigned())
                        && let Some(count) = survey.counts.get_mut(other)
                    {
                        *count += 1;
                    }
                }
            }
        }
        Ok(survey)
    }

    /// The part with the row of a patch, and the row's place in it.
    pub(crate) fn position_of(&self, patch: u32) -> Option<(usize, u32)> {
        let position = *self.position.get(patch as usize)?;
        (position != u32::MAX).then(|| ((position / self.rows_per_part) as usize, position % self.rows_per_part))
    }
}

/// The entries of a store by the part of their column's row.
#[derive(Debug)]
pub(crate) struct Exchange {
    file: Scratch,
    precision: Precision,
    /// First record of each part's run, and the end of the last one's.
    starts: Vec<u64>,
}

impl Exchange {
    /// Deals out the entries of `store` into a file in `directory`.
    pub(crate) fn new(store: &Store, survey: &Survey, directory: &Path) -> Result<Self> {
        let mut starts = vec![0u64];
        for count in &survey.counts {
            starts.push(starts.last().copied().unwrap_or(0) + count);
        }
        let mut file = Scratch::create(directory, "exchange")?;
        let precision = store.manifest().form.precision();
        let size = record_size(precision);
        let records = (BUFFERS / size / survey.counts.len().max(1)).clamp(1 << 9, 1 << 16);
        let mut next = starts.clone();
        let mut buffers: Vec<Vec<u8>> = vec![Vec::new(); survey.counts.len()];
        for place in 0..store.manifest().parts.len() {
            let part = require_part(store, place)?;
            for (row, patch) in part.rows.iter().enumerate() {
                let (columns, factors) = part.row(row);
                for (&column, factor) in columns.iter().zip(factors) {
                    let Some((other, other_row)) = survey.position_of(column.cast_unsigned()) else {
                        continue;
                    };
                    let Some(buffer) = buffers.get_mut(other) else { continue };
                    buffer.extend_from_slice(&other_row.to_le_bytes());
                    buffer.extend_from_slice(&patch.to_le_bytes());
                    precision.put(factor, buffer);
                    if buffer.len() >= records * size {
                        file.write_run(buffer, size, &mut next[other])?;
                    }
                }
            }
        }
        for (buffer, next) in buffers.iter_mut().zip(&mut next) {
            file.write_run(buffer, size, next)?;
        }
        // The source is read twice: one that changed meanwhile would leave runs too short or overlapping.
        if next
            .iter()
            .zip(starts.iter().skip(1))
            .any(|(reached, end)| reached != end)
        {
            return Err(Error::malformed(
                store.directory(),
                "changed while it was read; balance it again when nothing writes to it",
            ));
        }
        Ok(Self {
            file,
            precision,
            starts,
        })
    }

    /// The records of a part, by row and column.
    pub(crate) fn part(&mut self, place: usize) -> Result<Vec<Record>> {
        let (Some(&start), Some(&end)) = (self.starts.get(place), self.starts.get(place + 1)) else {
            return Ok(Vec::new());
        };
        let size = record_size(self.precision);
        let bytes = self.file.read(start * size as u64, (end - start) * size as u64)?;
        let word = |bytes: &[u8]| bytes.first_chunk().map_or(0, |&word| u32::from_le_bytes(word));
        let mut records: Vec<Record> = bytes
            .chunks_exact(size)
            .map(|record| Record {
                row: word(record),
                column: word(&record[4..]),
                factor: self.precision.get(&record[8..]),
            })
            .collect();
        records.sort_unstable_by_key(|record| u64::from(record.row) << 32 | u64::from(record.column));
        Ok(records)
    }
}

/// A file for data larger than memory. It is removed when dropped; where the system allows it, also when the program is
/// killed. Errors call it by a name that it does not have in the directory.
#[derive(Debug)]
pub(crate) struct Scratch {
    path: PathBuf,
    file: File,
}

impl Scratch {
    /// Creates it in a store's directory, under a name that the store's writer takes for remains.
    pub(crate) fn create(directory: &Path, name: &str) -> Result<Self> {
        let path = directory.join(name);
        // Nameless where the system allows it, otherwise under a name that is removed at once, or with the file.
        let file = tempfile::tempfile_in(directory).map_err(|error| Error::io(&path, "created", error))?;
        Ok(Self { path, file })
    }

    /// Writes whole records of `size` bytes from record `next` on, and empties the buffer.
    fn write_run(&mut self, buffer: &mut Vec<u8>, size: usize, next: &mut u64) -> Result<()> {
        self.write(*next * size as u64, buffer)?;
        *next += (buffer.len() / size) as u64;
        buffer.clear();
        Ok(())
    }

    /// Writes bytes at an offset.
    pub(crate) fn write(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let path = self.path.clone();
        let file = &mut self.file;
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(bytes))
            .map_err(|error| Error::write(&path, offset + bytes.len() as u64, error))
    }

    /// Reads so many bytes from an offset on.
    pub(crate) fn read(&mut self, offset: u64, size: u64) -> Result<Vec<u8>> {
        let path = self.path.clone();
        let size = usize::try_from(size)
            .map_err(|_| Error::unsupported(&path, "has a part that is too large for this machine's memory"))?;
        let mut bytes = vec![0; size];
        let file = &mut self.file;
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(|error| Error::io(&path, "read", error))?;
        Ok(bytes)
    }
}
