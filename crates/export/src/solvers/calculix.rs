//! CalculiX's `.vwf`, for `*VIEWFACTOR, READ`.
//!
//! Read: CalculiX, development sources of August 2026, `src/readview.f`, `writeview.f` (the records), `mastructrad.c`
//! (which entries, in which order), `postview.f` (orientation, share of the environment), `radmatrix.f` (use),
//! `radiates.f`, `loadaddt.f` and `envtemp.f` (order of the faces); held against ccx 2.20.
//!
//! ```text
//! record 1   80 characters: the version, which must be the program's
//! record 2   F[i, i] of each face, f64
//! record 3   F[j, i] for i ascending and j > i ascending, then F[i, j] in the same order, f64
//! record 4   1 − Σ_j F[i, j], the share of the environment, f64
//! ```
//!
//! Records are Fortran's, unformatted and sequential: their length in bytes before and after them, i32, little-endian,
//! in pieces of at most 2³¹ − 9 bytes (GNU Fortran). Faces are those named by `*RADIATE` with a label `R1CR` to `R6CR`,
//! ordered by element whatever the order in the deck; faces of one element come last named first. Entries between
//! cavities of other names are not in the records: this writer does one cavity.

use super::{SolverJob, SolverWriter};
use crate::Result;
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::{Cancellable, too_large};
use hemicube_solve::analysis::zones::GroupBy;
use std::path::{Path, PathBuf};

/// Version unless another is named: Debian 12's.
const VERSION: &str = "2.20";
/// Bytes of a piece of a record, at most: GNU Fortran's.
const PIECE: u64 = 2_147_483_639;
/// Faces of a matrix whose entries 32 bits count: n (n − 1) < 2³¹.
const FACES_MAX: usize = 46_341;

pub(crate) struct Calculix;

impl SolverWriter for Calculix {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Face),
            sums: Sums::AtMostOne,
            reciprocal: false,
        }
    }

    fn paths(&self, _: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        Ok(vec![path.to_owned()])
    }

    fn forecast(&self, faces: &Faces<'_>, _: &Found, path: &Path) -> Result<Option<u64>> {
        if faces.len() > FACES_MAX {
            return Err(too_large(
                path,
                "CalculiX counts no more than 46,341 faces of a cavity, as a full matrix",
            ));
        }
        let count = faces.len() as u64;
        Ok(Some(8 * count * (count + 1) + 112))
    }

    /// The transpose of the lower triangle is in memory, at 12 bytes an entry: below 1.5 times the file.
    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let count = job.faces.len();
        let mut version = format!("Version {}", job.options.version.unwrap_or(VERSION)).into_bytes();
        version.resize(80, b' ');
        let mut put = |bytes: &[u8]| job.put(files, 0, bytes);
        let mut record = Record::begin(&mut put, 80, PIECE)?;
        record.push(&version)?;
        record.end()?;
        // Entries below the diagonal by column.
        let mut lower: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
        let (mut diagonal, mut outside) = (Vec::with_capacity(8 * count), Vec::with_capacity(8 * count));
        for (place, number) in (0..count).zip(0_u32..) {
            let (mut own, mut sum) = (0.0, 0.0);
            for (column, factor) in job.faces.row(place)? {
                sum += factor;
                match column.cmp(&number) {
                    std::cmp::Ordering::Less => lower[column as usize].push((number, factor)),
                    std::cmp::Ordering::Equal => own = factor,
                    std::cmp::Ordering::Greater => {}
                }
            }
            diagonal.extend(f64::to_le_bytes(own));
            outside.extend(f64::to_le_bytes(f64::max(1.0 - sum, 0.0)));
        }
        let mut record = Record::begin(&mut put, diagonal.len() as u64, PIECE)?;
        record.push(&diagonal)?;
        record.end()?;
        let entries = count as u64 * (count as u64 - 1);
        let mut record = Record::begin(&mut put, 8 * entries, PIECE)?;
        let mut bytes = Vec::new();
        let dense = |entries: &[(u32, f64)], place: usize, bytes: &mut Vec<u8>| {
            let first = place + 1;
            bytes.clear();
            bytes.resize(8 * (count - first), 0);
            for &(other, factor) in entries.iter().filter(|&&(other, _)| other as usize >= first) {
                bytes[8 * (other as usize - first)..][..8].copy_from_slice(&factor.to_le_bytes());
            }
        };
        for (place, column) in lower.iter().enumerate() {
            dense(column, place, &mut bytes);
            record.push(&bytes)?;
        }
        for place in 0..count {
            dense(&job.faces.row(place)?, place, &mut bytes);
            record.push(&bytes)?;
        }
        record.end()?;
        let mut record = Record::begin(&mut put, outside.len() as u64, PIECE)?;
        record.push(&outside)?;
        record.end()
    }

    fn next(&self, _: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
        format!(
            "CalculiX: `*VIEWFACTOR, READ, INPUT={}` in the step; CalculiX must have the \
             version that the file is written for",
            paths[0].display()
        )
    }
}

/// A record of Fortran, written in pieces.
struct Record<'a> {
    put: &'a mut dyn FnMut(&[u8]) -> Result<()>,
    /// Bytes of the record still to come, those of the present piece included.
    left: u64,
    /// Bytes of the present piece still to come.
    in_piece: u64,
    /// Length of the present piece.
    piece: u64,
    piece_max: u64,
    is_first: bool,
}

impl<'a> Record<'a> {
    /// Begins a record of so many bytes, in pieces of at most `piece_max` below 2³¹.
    fn begin(put: &'a mut dyn FnMut(&[u8]) -> Result<()>, bytes: u64, piece_max: u64) -> Result<Self> {
        let mut record = Self {
            put,
            left: bytes,
            in_piece: 0,
            piece: 0,
            piece_max,
            is_first: true,
        };
        record.open()?;
        Ok(record)
    }

    /// The length before a piece: negative if another follows.
    fn open(&mut self) -> Result<()> {
        self.piece = self.left.min(self.piece_max);
        self.in_piece = self.piece;
        self.mark(self.piece < self.left)
    }

    /// The length after a piece: negative if another comes before.
    fn close(&mut self) -> Result<()> {
        self.mark(!self.is_first)
    }

    fn mark(&mut self, is_negative: bool) -> Result<()> {
        #[allow(clippy::cast_possible_truncation, reason = "a piece is below 2³¹ bytes")]
        let length = self.piece as i32;
        let length = if is_negative { -length } else { length };
        (self.put)(&length.to_le_bytes())
    }

    fn push(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            if self.in_piece == 0 {
                self.close()?;
                self.is_first = false;
                self.open()?;
            }
            let count = bytes.len().min(usize::try_from(self.in_piece).unwrap_or(usize::MAX));
            let (now, later) = bytes.split_at(count);
            (self.put)(now)?;
            self.in_piece -= count as u64;
            self.left -= count as u64;
            bytes = later;
        }
        Ok(())
    }

    fn end(mut self) -> Result<()> {
        self.close()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_record_is_in_pieces() {
        let written = |piece_max| {
            let mut bytes = Vec::new();
            let mut put = |more: &[u8]| {
                bytes.extend_from_slice(more);
                Ok(())
            };
            let mut record = Record::begin(&mut put, 10, piece_max).unwrap();
            record.push(b"abc").unwrap();
            record.push(b"defghij").unwrap();
            record.end().unwrap();
            bytes
        };
        let of = |parts: &[(i32, &[u8], i32)]| -> Vec<u8> {
            let each = |&(before, bytes, after): &(i32, &[u8], i32)| {
                [&before.to_le_bytes()[..], bytes, &after.to_le_bytes()[..]].concat()
            };
            parts.iter().flat_map(each).collect()
        };
        assert_eq!(written(PIECE), of(&[(10, b"abcdefghij", 10)]));
        // GNU Fortran: the sign before says that another follows, after that another came before.
        assert_eq!(written(4), of(&[(-4, b"abcd", 4), (-4, b"efgh", -4), (2, b"ij", -2)]));
    }
}
