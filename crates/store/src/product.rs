//! F·x and Fᵀ·x of a matrix on the disk.
//!
//! Parts are read once, front to back, in pieces that fit a cache, by all threads. In memory are x, y and, for Fᵀ·x,
//! [`SUMS`] more vectors. Sums have a fixed order: the result does not depend on the threads, to the bit.

use super::csr::{Buffers, CsrFile, EncodedRow};
use super::row_product::{Scratch, dot, scatter};
use super::validate::is_plain_row;
use super::{Error, Result, Store};
use std::fs::File;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Vectors that Fᵀ·x is added up in, each over its share of the parts, before they are added to each other: the most
/// threads that can work on it.
const SUMS: usize = 8;

impl Store {
    /// y = F·x: y_i = Σⱼ F_ij x_j, the arrivals at i from radiosities x. NaN for rows not computed. 0 `threads`: all
    /// cores.
    ///
    /// # Errors
    /// [`Error::Incomplete`] when parts are missing, [`Error::Refused`] when `x` is not of all patches; when a part is
    /// damaged.
    pub fn multiply(&self, x: &[f64], threads: usize) -> Result<Vec<f64>> {
        self.require_factor(x)?;
        let y = Mutex::new(vec![f64::NAN; x.len()]);
        let parts = self.manifest().parts.len();
        let threads = thread_count(threads, parts);
        // Each thread asks for its next part before it reads its own: so the disk reads while all of them compute.
        (0..threads).for_each(|place| self.read_ahead(place));
        for_each(threads, parts, &|place, buffers| {
            self.read_ahead(place + threads);
            let (csr, rows, file) = self.matrix_of_part(place)?;
            let mut sums = vec![0.0; rows.len()];
            let mut scratch = Scratch::default();
            self.visit(place, &csr, &file, buffers, &mut |row, encoded| {
                let sum = sums.get_mut(usize::try_from(row).ok()?)?;
                *sum = dot(encoded, x, &mut scratch)?;
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

    /// y = Fᵀ·x: y_j = Σᵢ F_ij x_i. Rows not computed add nothing.
    ///
    /// # Errors
    /// Those of [`Self::multiply`].
    pub fn multiply_transposed(&self, x: &[f64], threads: usize) -> Result<Vec<f64>> {
        self.require_factor(x)?;
        let parts = self.manifest().parts.len();
        let sums: Vec<Mutex<Vec<f64>>> = (0..SUMS.min(parts)).map(|_| Mutex::default()).collect();
        for_each(thread_count(threads, sums.len()), sums.len(), &|share, buffers| {
            self.read_ahead(share);
            let mut y = vec![0.0; x.len()];
            let mut scratch = Scratch::default();
            for place in (share..parts).step_by(SUMS) {
                self.read_ahead(place + SUMS);
                let (csr, rows, file) = self.matrix_of_part(place)?;
                self.visit(place, &csr, &file, buffers, &mut |row, encoded| {
                    let patch = *rows.get(usize::try_from(row).ok()?)?;
                    scatter(encoded, *x.get(patch as usize)?, &mut y, &mut scratch)
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

    /// Goes through the rows of a part, and looks at their columns and form factors the first time.
    fn visit(
        &self,
        place: usize,
        csr: &CsrFile,
        file: &File,
        buffers: &mut Buffers,
        each: &mut dyn FnMut(u64, EncodedRow<'_>) -> Option<()>,
    ) -> Result<()> {
        if self.has_valid_entries(place) {
            return csr.visit(file, buffers, each);
        }
        let (patch_count, end) = (self.patch_count(), self.manifest().factor_end());
        let visited = csr.visit(file, buffers, &mut |row, encoded| {
            let holds = match encoded {
                EncodedRow::Plain { columns, values } => is_plain_row(columns, values, patch_count, end),
                // Runs ascend, codes are form factors, and `each` finds no number for a column beyond the last.
                EncodedRow::Compact { .. } => true,
            };
            holds.then_some(())?;
            each(row, encoded)
        });
        // Reading the whole part names the row and its defect.
        if visited.is_err() {
            self.part(place)?;
        }
        visited?;
        self.note_valid_entries(place);
        Ok(())
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
}

/// The number of threads asked for, or of cores for 0; at most one a piece of work.
fn thread_count(wanted: usize, pieces: usize) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if wanted == 0 { cores } else { wanted }.clamp(1, pieces.max(1))
}

/// Calls `each` with 0, 1… on several threads, until one fails.
fn for_each(threads: usize, count: usize, each: &(dyn Fn(usize, &mut Buffers) -> Result<()> + Sync)) -> Result<()> {
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
