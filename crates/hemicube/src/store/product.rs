//! F·x and Fᵀ·x of a matrix that stays on the disk.
//!
//! Parts are read once, front to back, in pieces that stay in a cache, by as many threads as there are; in memory are x, y
//! and, for Fᵀ·x, [`SUMS`] vectors more. Sums have a fixed order: the result is the same to the bit whatever the threads.

use super::csr::{Buffers, EncodedRow};
use super::{Error, Result, Store, compact};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Vectors that Fᵀ·x is added up in, each from its share of the parts, before they are added to each other. So many threads
/// can work on it.
const SUMS: usize = 8;

/// Sums of a row that do not wait for each other.
const LANES: usize = 8;
/// Columns that are looked at together: seven follow each other on average in a city of 1.5 million patches.
const RUN: usize = 4;

impl Store {
    /// y = F·x: what each patch receives of what all others have, or sees of what they show. Rows that were not computed
    /// give NaN. With 0 `threads` every core works.
    ///
    /// # Errors
    /// [`Error::Incomplete`] when parts are missing, [`Error::Refused`] when `x` is not of all patches; when a part is damaged.
    pub fn multiply(&self, x: &[f64], threads: usize) -> Result<Vec<f64>> {
        self.require_factor(x)?;
        let y = Mutex::new(vec![f64::NAN; x.len()]);
        self.for_each_part(threads, self.manifest().parts.len(), &|place, buffers| {
            let (csr, rows, file) = self.matrix_of_part(place)?;
            let mut sums = vec![0.0; rows.len()];
            let mut of_row = Vec::new();
            csr.visit(&file, buffers, &mut |row, encoded| {
                let sum = sums.get_mut(usize::try_from(row).ok()?)?;
                *sum = dot(encoded, x, &mut of_row)?;
                Some(())
            })?;
            let mut y = y.lock().unwrap_or_else(PoisonError::into_inner);
            for (&patch, sum) in rows.iter().zip(sums) {
                if let Some(slot) = y.get_mut(patch as usize) {
                    *slot = sum;
                }
            }
            Ok(())
        })?;
        Ok(y.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// y = Fᵀ·x: what arrives at each patch of what all others send. Rows that were not computed send nothing.
    ///
    /// # Errors
    /// As [`Self::multiply`].
    pub fn multiply_transposed(&self, x: &[f64], threads: usize) -> Result<Vec<f64>> {
        self.require_factor(x)?;
        let parts = self.manifest().parts.len();
        let sums: Vec<Mutex<Vec<f64>>> = (0..SUMS.min(parts)).map(|_| Mutex::default()).collect();
        self.for_each_part(threads, sums.len(), &|share, buffers| {
            let mut y = vec![0.0; x.len()];
            for place in (share..parts).step_by(SUMS) {
                let (csr, rows, file) = self.matrix_of_part(place)?;
                csr.visit(&file, buffers, &mut |row, encoded| {
                    let patch = *rows.get(usize::try_from(row).ok()?)?;
                    scatter(encoded, *x.get(patch as usize)?, &mut y)
                })?;
            }
            *sums[share].lock().unwrap_or_else(PoisonError::into_inner) = y;
            Ok(())
        })?;
        let mut y = vec![0.0; x.len()];
        for sum in sums {
            let sum = sum.into_inner().unwrap_or_else(PoisonError::into_inner);
            y.iter_mut().zip(sum).for_each(|(y, sum)| *y += sum);
        }
        Ok(y)
    }

    fn require_factor(&self, x: &[f64]) -> Result<()> {
        self.require_complete()?;
        if x.len() == self.patch_count() as usize {
            return Ok(());
        }
        Err(Error::refused(
            self.directory(),
            format!(
                "its product with {} numbers: it has {} patches",
                x.len(),
                self.patch_count()
            ),
        ))
    }

    /// Calls `each` with 0, 1… on several threads, until one fails.
    fn for_each_part(
        &self,
        threads: usize,
        count: usize,
        each: &(dyn Fn(usize, &mut Buffers) -> Result<()> + Sync),
    ) -> Result<()> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = if threads == 0 { cores } else { threads }.clamp(1, count.max(1));
        let next = AtomicUsize::new(0);
        let work = || {
            let mut buffers = Buffers::default();
            loop {
                let place = next.fetch_add(1, Ordering::Relaxed);
                if place >= count {
                    return Ok(());
                }
                each(place, &mut buffers).inspect_err(|_| next.store(count, Ordering::Relaxed))?;
            }
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
            let mut result = work();
            for worker in workers {
                let ended = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                result = result.and(ended);
            }
            result
        })
    }
}

fn column(bytes: [u8; 4]) -> usize {
    // A negative column is beyond every vector.
    i32::from_le_bytes(bytes).cast_unsigned() as usize
}

/// The first of columns that follow each other without a gap.
fn run(columns: &[[u8; 4]; RUN]) -> Option<usize> {
    let first = i32::from_le_bytes(columns[0]);
    let mut differs = 0;
    let mut wanted = first;
    for &column in columns {
        differs |= i32::from_le_bytes(column) ^ wanted;
        wanted = wanted.wrapping_add(1);
    }
    (differs == 0 && first >= 0).then_some(first.cast_unsigned() as usize)
}

/// Σ F x of a row, with room for what it takes of x; `None` when a column is none.
fn dot(row: EncodedRow<'_>, x: &[f64], of_row: &mut Vec<f64>) -> Option<f64> {
    let mut sums = [0.0; LANES];
    match row {
        EncodedRow::Plain { columns, values } => {
            let (columns, values) = (columns.as_chunks::<4>().0, values.as_chunks::<4>().0);
            let (whole, rest) = columns.as_chunks::<LANES>();
            let (of_whole, of_rest) = values.as_chunks::<LANES>();
            for (columns, values) in whole.iter().zip(of_whole) {
                let (sums, of_sums) = (sums.as_chunks_mut::<RUN>().0, values.as_chunks::<RUN>().0);
                for ((columns, values), sums) in columns.as_chunks::<RUN>().0.iter().zip(of_sums).zip(sums) {
                    // The same sums either way; most columns of most rows are in runs.
                    let x: [f64; RUN] = match run(columns) {
                        Some(first) => x.get(first..first + RUN)?.try_into().ok()?,
                        None => [
                            *x.get(column(columns[0]))?,
                            *x.get(column(columns[1]))?,
                            *x.get(column(columns[2]))?,
                            *x.get(column(columns[3]))?,
                        ],
                    };
                    for lane in 0..RUN {
                        sums[lane] += f64::from(f32::from_le_bytes(values[lane])) * x[lane];
                    }
                }
            }
            for ((&columns, &values), sum) in rest.iter().zip(of_rest).zip(&mut sums) {
                *sum += f64::from(f32::from_le_bytes(values)) * x.get(column(columns))?;
            }
        }
        EncodedRow::Compact { codes, .. } => {
            // Runs are short. So what they take of x is put together first, LANES at a time: what a run does not have of these is
            // written over by the next.
            let codes = codes.as_chunks::<2>().0;
            of_row.resize(of_row.len().max(codes.len() + LANES), 0.0);
            let mut at = 0;
            for_each_run(row, x.len(), |first, codes| {
                let (mut column, end) = (first, first + codes.len());
                let last = at + codes.len();
                while column < end {
                    if let Some(several) = x.get(column..column + LANES) {
                        of_row.get_mut(at..at + LANES)?.copy_from_slice(several);
                    } else {
                        of_row.get_mut(at..last)?.copy_from_slice(x.get(column..end)?);
                    }
                    (column, at) = (column + LANES, at + LANES);
                }
                at = last;
                Some(())
            })?;
            let (whole, rest) = codes.as_chunks::<LANES>();
            let (of_whole, of_rest) = of_row.get(..codes.len())?.as_chunks::<LANES>();
            for (codes, x) in whole.iter().zip(of_whole) {
                for lane in 0..LANES {
                    sums[lane] += f64::from(compact::factor(u16::from_le_bytes(codes[lane]))) * x[lane];
                }
            }
            for ((&code, x), sum) in rest.iter().zip(of_rest).zip(&mut sums) {
                *sum += f64::from(compact::factor(u16::from_le_bytes(code))) * x;
            }
        }
    }
    Some(sums.iter().sum())
}

/// Adds F x to what arrives at the patches that a row sees; `None` when a column is none.
fn scatter(row: EncodedRow<'_>, x: f64, y: &mut [f64]) -> Option<()> {
    match row {
        EncodedRow::Plain { columns, values } => {
            let (columns, values) = (columns.as_chunks::<4>().0, values.as_chunks::<4>().0);
            let (whole, rest) = columns.as_chunks::<RUN>();
            let (of_whole, of_rest) = values.as_chunks::<RUN>();
            for (columns, values) in whole.iter().zip(of_whole) {
                if let Some(first) = run(columns) {
                    let y: &mut [f64; RUN] = y.get_mut(first..first + RUN)?.try_into().ok()?;
                    for lane in 0..RUN {
                        y[lane] += f64::from(f32::from_le_bytes(values[lane])) * x;
                    }
                } else {
                    for lane in 0..RUN {
                        *y.get_mut(column(columns[lane]))? += f64::from(f32::from_le_bytes(values[lane])) * x;
                    }
                }
            }
            for (&columns, &values) in rest.iter().zip(of_rest) {
                *y.get_mut(column(columns))? += f64::from(f32::from_le_bytes(values)) * x;
            }
            Some(())
        }
        EncodedRow::Compact { .. } => {
            let count = y.len();
            for_each_run(row, count, |first, codes| {
                let y = y.get_mut(first..first + codes.len())?;
                for (y, &code) in y.iter_mut().zip(codes) {
                    *y += f64::from(compact::factor(u16::from_le_bytes(code))) * x;
                }
                Some(())
            })
        }
    }
}

/// Calls `each` with the first column of each run of a compact row, and its codes.
fn for_each_run<'a>(
    row: EncodedRow<'a>,
    column_count: usize,
    mut each: impl FnMut(usize, &'a [[u8; 2]]) -> Option<()>,
) -> Option<()> {
    let EncodedRow::Compact { gaps, lengths, codes } = row else {
        return Some(());
    };
    let mut codes = codes.as_chunks::<2>().0;
    let mut next = 0usize;
    for (&gap, &length) in gaps.as_chunks::<2>().0.iter().zip(lengths) {
        let first = next + usize::from(u16::from_le_bytes(gap));
        let (of_run, rest) = codes.split_at_checked(length.into())?;
        codes = rest;
        next = first + of_run.len();
        if next > column_count {
            return None;
        }
        if !of_run.is_empty() {
            each(first, of_run)?;
        }
    }
    codes.is_empty().then_some(())
}
