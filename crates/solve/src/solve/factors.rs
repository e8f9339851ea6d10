//! The matrix for solvers: run by run, from memory or from a store.

use super::Block;
use super::pairs::{self, Weights};
use hemicube_store::{Error, FactorSlice, Number, Part, Result, Store};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};

/// The rows of a form-factor matrix, in runs read again and again. The order of the runs is fixed, and no two have a
/// row of the same patch.
pub trait Factors: Sync {
    /// Rows and columns of the matrix.
    fn patch_count(&self) -> usize;

    /// Number of runs.
    fn run_count(&self) -> usize;

    /// The rows of a run.
    ///
    /// # Errors
    /// When they cannot be read.
    fn run(&self, index: usize) -> Result<Arc<Part>>;

    /// What the two readings of a pair count, where products are of both ([`super::Pairs`]).
    fn weights(&self) -> Option<&Weights> {
        None
    }

    /// True if runs are read once and then stay in memory: going through them again costs no reading.
    fn is_in_memory(&self) -> bool {
        false
    }
}

/// A matrix in memory: for small scenes, and for embedders.
#[derive(Clone, Debug, Default)]
pub struct InMemory {
    patch_count: usize,
    parts: Vec<Arc<Part>>,
}

impl InMemory {
    /// The matrix of some parts, such as the driver's.
    pub fn new(patch_count: usize, parts: Vec<Part>) -> Self {
        Self {
            patch_count,
            parts: parts.into_iter().map(Arc::new).collect(),
        }
    }

    /// A small matrix, row by row: a textbook's enclosure of some surfaces.
    pub fn dense(rows: &[Vec<f64>]) -> Self {
        let mut part = Part {
            indptr: vec![0],
            ..Part::default()
        };
        for (patch, row) in (0u32..).zip(rows) {
            for (column, &factor) in (0i32..).zip(row).filter(|(_, factor)| **factor != 0.0) {
                part.indices.push(column);
                part.data.push(factor);
            }
            part.rows.push(patch);
            part.indptr.push(i64::try_from(part.data.len()).unwrap_or(i64::MAX));
        }
        Self::new(rows.len(), vec![part])
    }
}

impl Factors for InMemory {
    fn patch_count(&self) -> usize {
        self.patch_count
    }

    fn run_count(&self) -> usize {
        self.parts.len()
    }

    fn run(&self, index: usize) -> Result<Arc<Part>> {
        Ok(Arc::clone(&self.parts[index]))
    }

    fn is_in_memory(&self) -> bool {
        true
    }
}

/// A stored matrix. Parts are read again each time, except for the first ones, up to a budget of memory: they are
/// cached.
#[derive(Debug)]
pub struct OutOfCore<'s> {
    store: &'s Store,
    budget: u64,
    cache: Mutex<Cache>,
}

#[derive(Debug)]
struct Cache {
    bytes: u64,
    parts: Vec<Option<Arc<Part>>>,
}

/// Parts that the system reads ahead.
const PARTS_AHEAD: usize = 4;

/// Refuses a matrix in which a patch has no row.
///
/// # Errors
/// [`Error::Incomplete`] when parts are missing, [`Error::Unsupported`] for a matrix of some rows.
fn require_all_rows(store: &Store) -> Result<()> {
    store.require_complete()?;
    let (rows, patches) = (store.manifest().rows_present(), store.patch_count());
    if rows == u64::from(patches) {
        return Ok(());
    }
    Err(Error::unsupported(
        store.directory(),
        format!(
            "has rows of {rows} patches only, of {patches}; what the others send is not known: compute it with \
             all rows"
        ),
    ))
}

impl<'s> OutOfCore<'s> {
    /// The matrix of a store, with at most `budget` bytes of it cached in memory.
    ///
    /// # Errors
    /// When parts or rows are missing: every patch must have a row.
    pub fn new(store: &'s Store, budget: u64) -> Result<Self> {
        require_all_rows(store)?;
        Ok(Self {
            store,
            budget,
            cache: Mutex::new(Cache {
                bytes: 0,
                parts: vec![None; store.manifest().parts.len()],
            }),
        })
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Cache> {
        // A slot and a sum that only grow: a panic elsewhere leaves them usable.
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Factors for OutOfCore<'_> {
    fn patch_count(&self) -> usize {
        self.store.patch_count() as usize
    }

    fn run_count(&self) -> usize {
        self.store.manifest().parts.len()
    }

    fn is_in_memory(&self) -> bool {
        let manifest = self.store.manifest();
        // As parts are counted below, at their largest.
        manifest.entries.saturating_mul(12) + 64 * u64::from(self.store.patch_count()) <= self.budget
    }

    fn run(&self, index: usize) -> Result<Arc<Part>> {
        if let Some(Some(part)) = self.lock().parts.get(index) {
            return Ok(Arc::clone(part));
        }
        let missing = || Error::malformed(self.store.directory(), format!("has no part at place {index}"));
        self.store.read_ahead(index.saturating_add(PARTS_AHEAD));
        let part = self.store.part(index)?.ok_or_else(missing)?;
        let part = Arc::new(part);
        let size = (4 + part.data.precision().size() as u64) * part.data.len() as u64 + 64 * part.rows.len() as u64;
        let mut kept = self.lock();
        if kept.bytes + size <= self.budget && kept.parts[index].is_none() {
            kept.bytes += size;
            kept.parts[index] = Some(Arc::clone(&part));
        }
        Ok(part)
    }
}

/// Σⱼ Fᵢⱼ xⱼ for one row and all columns of `x`.
#[inline]
pub(super) fn row_product(columns: &[i32], factors: FactorSlice<'_>, x: &Block, out: &mut [f64]) {
    match factors {
        FactorSlice::Single(factors) => row_product_of(columns, factors, x, out),
        FactorSlice::Double(factors) => row_product_of(columns, factors, x, out),
    }
}

#[inline]
fn row_product_of<F: Number>(columns: &[i32], factors: &[F], x: &Block, out: &mut [f64]) {
    match out.len() {
        1 => fixed::<1>(columns, factors, x, out),
        3 => fixed::<3>(columns, factors, x, out),
        8 => fixed::<8>(columns, factors, x, out),
        _ => {
            let (lanes, rest) = out.as_chunks_mut::<LANES>();
            let first_of_rest = LANES * lanes.len();
            for (place, out) in lanes.iter_mut().enumerate() {
                *out = some_columns(columns, factors, x, LANES * place);
            }
            rest.fill(0.0);
            for (&column, &factor) in columns.iter().zip(factors) {
                let factor: f64 = factor.into();
                let values = &x.of(column.cast_unsigned() as usize)[first_of_rest..];
                for (sum, value) in rest.iter_mut().zip(values) {
                    *sum += factor * value;
                }
            }
        }
    }
}

/// Columns whose sums stay in registers: those of the least instruction set hold twice as many.
const LANES: usize = 16;

/// A row's product with so many columns of `x` from `first` on.
#[inline]
fn some_columns<F: Number>(columns: &[i32], factors: &[F], x: &Block, first: usize) -> [f64; LANES] {
    let mut sums = [0.0; LANES];
    for (&column, &factor) in columns.iter().zip(factors) {
        let factor: f64 = factor.into();
        let values = x.of(column.cast_unsigned() as usize)[first..].first_chunk::<LANES>();
        for (sum, value) in sums.iter_mut().zip(values.into_iter().flatten()) {
            *sum += factor * value;
        }
    }
    sums
}

#[inline]
fn fixed<const N: usize>(columns: &[i32], factors: &[impl Number], x: &Block, out: &mut [f64]) {
    let mut sums = [0.0; N];
    let rows = x.values().as_chunks::<N>().0;
    for (&column, &factor) in columns.iter().zip(factors) {
        let (factor, values): (f64, _) = (factor.into(), &rows[column.cast_unsigned() as usize]);
        for lane in 0..N {
            sums[lane] += factor * values[lane];
        }
    }
    out.copy_from_slice(&sums);
}

/// F X, by several threads. Each row is one sum in the order of its entries, so the result does not depend on them. Of
/// [`super::Pairs`], F' X.
///
/// # Errors
/// When a run cannot be read, or a patch has two rows.
pub fn multiply(factors: &dyn Factors, x: &Block, threads: usize) -> Result<Block> {
    if let Some(weights) = factors.weights() {
        return pairs::multiply(factors, weights, x, threads);
    }
    let columns = x.columns();
    let mut product = Block::zeros(factors.patch_count(), columns);
    let mut has_row = vec![false; factors.patch_count()];
    let mut take = |patch: u32| match has_row.get_mut(patch as usize) {
        Some(has_row @ false) => {
            *has_row = true;
            Ok(())
        }
        _ => {
            let reason = format!("has a row of patch {patch}, which does not exist or has a row already");
            Err(Error::malformed(Path::new("the matrix"), reason))
        }
    };
    let run_count = factors.run_count();
    if threads <= 1 && factors.is_in_memory() {
        // No thread for each of many products.
        for run in 0..run_count {
            let part = factors.run(run)?;
            for (row, &patch) in part.rows.iter().enumerate() {
                take(patch)?;
                let (indices, data) = part.row(row);
                row_product(indices, data, x, product.of_mut(patch as usize));
            }
        }
        return Ok(product);
    }
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(2 * threads.max(1));
        for _ in 0..threads.clamp(1, run_count.max(1)) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= run_count {
                        break;
                    }
                    let result = factors.run(index).map(|part| {
                        let mut values = vec![0.0; part.rows.len() * columns];
                        for (row, out) in values.chunks_exact_mut(columns.max(1)).enumerate() {
                            let (indices, data) = part.row(row);
                            row_product(indices, data, x, out);
                        }
                        (part, values)
                    });
                    let failed = result.is_err();
                    if sender.send(result).is_err() || failed {
                        break;
                    }
                }
            });
        }
        drop(sender);
        for result in receiver {
            let (part, values) = result?;
            for (&patch, value) in part.rows.iter().zip(values.chunks_exact(columns.max(1))) {
                take(patch)?;
                product.of_mut(patch as usize).copy_from_slice(value);
            }
        }
        Ok(())
    })?;
    Ok(product)
}

/// Goes through the runs in their order, each read while the one before is worked on.
pub(super) fn in_order(factors: &dyn Factors, mut visit: impl FnMut(&Part)) -> Result<()> {
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(1);
        scope.spawn(move || {
            for index in 0..factors.run_count() {
                let part = factors.run(index);
                let failed = part.is_err();
                if sender.send(part).is_err() || failed {
                    break;
                }
            }
        });
        for part in receiver {
            visit(&*part?);
        }
        Ok(())
    })
}
