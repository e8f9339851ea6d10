//! A matrix whose pairs are read once for both directions.
//!
//! A pair of patches is one thing with two readings, Aᵢ Fᵢⱼ of row i and Aⱼ Fⱼᵢ of row j. Their mean, weighted by the
//! square of the other patch's area, stands for both:
//!
//! ```text
//! Gᵢⱼ = Gⱼᵢ = wᵢⱼ Aᵢ Fᵢⱼ + wⱼᵢ Aⱼ Fⱼᵢ        wᵢⱼ = Aⱼ² / (Aᵢ² + Aⱼ²)        F'ᵢⱼ = Gᵢⱼ / Aᵢ
//! ```
//!
//! These weights are the inverse of the readings' variances where all form factors have the same error: var (Aᵢ Fᵢⱼ) ∝
//! Aᵢ². A small patch sees a large one better from its few points than it is seen from there: where a wall's factor to a
//! tube was 4.7 % low, the tube's to the wall was right. A pair in one row only is averaged with the other's 0, which
//! saw nothing; a row whose counterparts were not computed, because its patch has no column, counts alone.
//!
//! Nothing is stored twice: with t = wᵢⱼ Aᵢ Fᵢⱼ, a stored entry adds t xⱼ to the product of row i and t xᵢ to that of
//! row j. One pass over the entries gives A F' x. The same t is added both ways, so that Σ Aᵢ (F' x)ᵢ yᵢ =
//! Σ Aᵢ (F' y)ᵢ xᵢ but for rounding: what is given off is taken up. The sum of a row of F' is its own: what it lacks of 1,
//! or has too much, is the row's error ([`Pairs::rows`]).
//!
//! Where many right-hand sides are solved for, F' is made once and lies in memory ([`merged`]), if it is small. Otherwise in
//! memory are [`SUMS`] more vectors a column of x, each over its share of the runs. They are added up in their order,
//! so the result does not depend on the threads.

use super::factors::in_order;
use super::{Block, Factors, InMemory};
use hemicube_store::{Error, FactorSlice, FactorVec, Number, Part, Result, RowTable};
use serde::Serialize;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Vectors that a product is added up in, each over its share of the runs: the most threads that can work on it.
pub const SUMS: usize = 8;

/// What of a stored matrix stands for a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reading {
    /// One Aᵢ Fᵢⱼ for both directions, of both rows ([`Pairs`]).
    #[default]
    Pairs,
    /// Each row as it is stored.
    AsStored,
}

/// A matrix read by pairs.
///
/// ```
/// use hemicube_solve::solve::{Block, InMemory, Pairs, multiply};
/// use hemicube_store::RowTable;
/// // A ball of 1 m² in a room of 4 m², whose row for the ball is a fifth low.
/// let stored = InMemory::dense(&[vec![0.0, 1.0], vec![0.2, 0.75]]);
/// let room = Pairs::new(&stored, &[1.0, 4.0], &RowTable::unknown(2), 1)?;
/// let seen = multiply(&room, &Block::from_fn(2, 1, |patch, _| [1.0, 0.0][patch]), 1)?;
/// // The ball's row, 1, counts 16 times as much as the room's, 4 × 0.2: they agree on 16.8 / 17, as far as f32
/// // holds 0.2.
/// assert!((4.0 * seen.of(1)[0] - 16.8 / 17.0).abs() < 1e-8);
/// # Ok::<(), hemicube_store::Error>(())
/// ```
pub struct Pairs<'f> {
    factors: &'f dyn Factors,
    weights: Weights,
}

/// What a pair's two readings count.
#[derive(Clone, Debug, Default)]
pub struct Weights {
    /// The largest area.
    largest: f64,
    /// Areas as shares of the largest, and their squares.
    area: Vec<f64>,
    square: Vec<f64>,
    /// The square, or 0 where the patch has no column: its row then counts alone.
    counted: Vec<f64>,
}

impl Weights {
    /// Of patch i with the area and `counted`: wᵢⱼ Aᵢ Fᵢⱼ.
    #[inline(always)]
    fn reading(&self, (area, counted): (f64, f64), column: usize, factor: f64) -> f64 {
        let other = self.square[column];
        area * factor * (other / (counted + other))
    }

    fn of(&self, patch: usize) -> (f64, f64) {
        (self.area[patch], self.counted[patch])
    }
}

impl std::fmt::Debug for Pairs<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pairs")
            .field("weights", &self.weights)
            .finish_non_exhaustive()
    }
}

impl Factors for Pairs<'_> {
    fn patch_count(&self) -> usize {
        self.factors.patch_count()
    }

    fn run_count(&self) -> usize {
        self.factors.run_count()
    }

    fn run(&self, index: usize) -> Result<Arc<Part>> {
        self.factors.run(index)
    }

    fn weights(&self) -> Option<&Weights> {
        Some(&self.weights)
    }

    fn is_in_memory(&self) -> bool {
        self.factors.is_in_memory()
    }
}

impl<'f> Pairs<'f> {
    /// The pairs of `factors`. `areas` and `rows` are of its patches. Where rows lost something to patches without a
    /// column, the matrix is read once for which these are.
    ///
    /// # Errors
    /// [`Error::Refused`] for areas of other patches; when a run cannot be read.
    pub fn new(factors: &'f dyn Factors, areas: &[f64], rows: &RowTable, threads: usize) -> Result<Self> {
        let count = factors.patch_count();
        if areas.len() != count || areas.iter().any(|area| !(area.is_finite() && *area >= 0.0)) {
            return Err(Error::refused(
                Path::new("the matrix"),
                format!("{} areas for its {count} patches, each from 0 on", areas.len()),
            ));
        }
        let largest = areas.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let area: Vec<f64> = areas.iter().map(|area| area / largest).collect();
        let square: Vec<f64> = area.iter().map(|area| area * area).collect();
        let mut weights = Weights {
            largest,
            counted: square.clone(),
            square,
            area,
        };
        let cut_off = |patch: usize| rows.cut_off.get(patch).copied().unwrap_or(0.0);
        // What is cut off after the last portal is counted with them.
        let lacks_columns = (rows.unselected.iter().enumerate()).any(|(patch, share)| *share > cut_off(patch).max(0.0));
        if lacks_columns {
            let seen = columns_seen(factors, threads)?;
            for (counted, seen) in weights.counted.iter_mut().zip(seen) {
                *counted = if seen { *counted } else { 0.0 };
            }
        }
        Ok(Self { factors, weights })
    }

    /// wᵢⱼ Aᵢ Fᵢⱼ of a stored entry. Gᵢⱼ is the sum of the pair's two.
    pub fn reading(&self, row: usize, column: usize, factor: f64) -> f64 {
        self.weights.largest * self.weights.reading(self.weights.of(row), column, factor)
    }

    /// The table of the rows of F': their sums, and what mirrors and panes hand on of them. The shares are the stored
    /// rows'; [`RowTable::returned`] then has what a row of F' lacks.
    ///
    /// # Errors
    /// When a run cannot be read.
    pub fn rows(&self, rows: &RowTable, threads: usize) -> Result<RowTable> {
        let columns = if rows.handed_on.is_empty() { 1 } else { 2 };
        let x = Block::from_fn(self.patch_count(), columns, |patch, column| match column {
            0 => 1.0,
            _ => rows.handed_on[patch],
        });
        let sums = multiply(self, &self.weights, &x, threads)?;
        let mut table = rows.clone();
        table.row_sum = sums.column(0).collect();
        if columns > 1 {
            table.passed = sums.column(1).collect();
        }
        Ok(table)
    }
}

/// By how much the two readings of a stored matrix disagree about the heat of each patch, in the unit of `sent` times
/// area: what its own row says that it gives off, Σⱼ Aᵢ Fᵢⱼ (Bᵢ − Bⱼ), less what the others' rows say,
/// Σⱼ Aⱼ Fⱼᵢ (Bᵢ − Bⱼ). `kept` are 1 − ρs − τ, `sent` the radiosities over them. The sum over a closed enclosure is twice
/// the energy that it loses or makes up.
///
/// # Errors
/// When a run cannot be read.
pub fn disagreement(factors: &dyn Factors, areas: &[f64], kept: &[f64], sent: &[f64]) -> Result<Vec<f64>> {
    let mut heat = vec![0.0; sent.len()];
    in_order(factors, |part| {
        for (row, &patch) in part.rows.iter().enumerate() {
            let patch = patch as usize;
            let mut sum = 0.0;
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let other = column.cast_unsigned() as usize;
                let flow = areas[patch] * kept[patch] * factor * kept[other] * (sent[patch] - sent[other]);
                sum += flow;
                // By this row the other gives off −flow.
                heat[other] += flow;
            }
            heat[patch] += sum;
        }
    })?;
    Ok(heat)
}

/// Whether each column has an entry.
fn columns_seen(factors: &dyn Factors, threads: usize) -> Result<Vec<bool>> {
    let all = Mutex::new(vec![false; factors.patch_count()]);
    by_shares(factors, threads, &|runs| {
        let mut seen = vec![false; factors.patch_count()];
        for part in runs {
            for &column in &part?.indices {
                if let Some(seen) = seen.get_mut(column.cast_unsigned() as usize) {
                    *seen = true;
                }
            }
        }
        let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
        all.iter_mut().zip(seen).for_each(|(all, seen)| *all |= seen);
        Ok(())
    })?;
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// The runs of a share, as they are read.
type Runs<'r> = &'r mut dyn Iterator<Item = Result<Arc<Part>>>;

/// Calls `each` with the runs of every share, on some threads; the results in the order of shares.
fn by_shares<T: Send>(
    factors: &dyn Factors,
    threads: usize,
    each: &(dyn Fn(Runs<'_>) -> Result<T> + Sync),
) -> Result<Vec<T>> {
    let shares = SUMS.min(factors.run_count());
    let results: Vec<Mutex<Option<Result<T>>>> = (0..shares).map(|_| Mutex::default()).collect();
    let next = AtomicUsize::new(0);
    let work = || {
        loop {
            let share = next.fetch_add(1, Ordering::Relaxed);
            let Some(slot) = results.get(share) else { break };
            let mut runs = (share..factors.run_count()).step_by(SUMS).map(|run| factors.run(run));
            let result = each(&mut runs);
            let failed = result.is_err();
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            if failed {
                next.store(shares, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.clamp(1, shares.max(1)) {
            scope.spawn(work);
        }
        work();
    });
    let results = results
        .into_iter()
        .map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner));
    // After a failure, shares that nobody began have no result.
    results.flatten().collect()
}

/// F' X.
pub(super) fn multiply(factors: &dyn Factors, weights: &Weights, x: &Block, threads: usize) -> Result<Block> {
    let (count, columns) = (factors.patch_count(), x.columns());
    let sums = by_shares(factors, threads, &|runs| {
        let mut y = Block::zeros(count, columns);
        let mut rows = Vec::new();
        let mut of_row = vec![0.0; columns];
        for part in runs {
            let part = part?;
            for (row, &patch) in part.rows.iter().enumerate() {
                if patch as usize >= count {
                    return Err(twice(patch));
                }
                let (indices, data) = part.row(row);
                row_of(weights, patch as usize, (indices, data), x, &mut y, &mut of_row);
                for (y, sum) in y.of_mut(patch as usize).iter_mut().zip(&of_row) {
                    *y += sum;
                }
            }
            rows.extend_from_slice(&part.rows);
        }
        Ok((y, rows))
    })?;
    let mut has_row = vec![false; count];
    let mut product = Block::zeros(count, columns);
    let ones = vec![1.0; columns];
    for (sum, rows) in sums {
        for patch in rows {
            if std::mem::replace(&mut has_row[patch as usize], true) {
                return Err(twice(patch));
            }
        }
        product.add_scaled(&ones, &sum);
    }
    for (patch, area) in weights.area.iter().enumerate() {
        let scale = if *area > 0.0 { 1.0 / area } else { 0.0 };
        product.of_mut(patch).iter_mut().for_each(|value| *value *= scale);
    }
    Ok(product)
}

/// Entries of a matrix of pairs made once for all right-hand sides, at most: 256 MB. A choice: with more, a
/// solution takes memory nobody gave it; with fewer, larger matrices are read again for each step.
const MERGED_MOST: usize = 1 << 24;
/// Runs of such a matrix: the most threads that can work on a product.
const MERGED_RUNS: usize = 64;

/// The rows of F' in memory, by which a product takes each pair once a row and adds nothing to other rows: for many
/// products. `None` where that takes too much room.
///
/// # Errors
/// When a run cannot be read, or a patch has two rows.
pub(super) fn merged(factors: &dyn Factors, weights: &Weights) -> Result<Option<InMemory>> {
    let count = factors.patch_count();
    let runs = (0..factors.run_count()).map(|run| factors.run(run));
    let parts = runs.collect::<Result<Vec<Arc<Part>>>>()?;
    // Each entry is one of its row and one of its column's row.
    let mut begins = vec![0usize; count + 1];
    let mut has_row = vec![false; count];
    for part in &parts {
        for (row, &patch) in part.rows.iter().enumerate() {
            match has_row.get_mut(patch as usize) {
                Some(has_row @ false) => *has_row = true,
                _ => return Err(twice(patch)),
            }
            let (columns, _) = part.row(row);
            begins[patch as usize + 1] += columns.len();
            for &column in columns {
                begins[column.cast_unsigned() as usize + 1] += 1;
            }
        }
    }
    for patch in 0..count {
        begins[patch + 1] += begins[patch];
    }
    if begins[count] > MERGED_MOST {
        return Ok(None);
    }
    let mut entries = vec![(0i32, 0.0f64); begins[count]];
    let mut next = begins.clone();
    let mut put = |row: usize, column: i32, reading: f64| {
        entries[next[row]] = (column, reading);
        next[row] += 1;
    };
    for part in &parts {
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, data) = part.row(row);
            let own = weights.of(patch as usize);
            for (&column, factor) in columns.iter().zip(data) {
                let other = column.cast_unsigned() as usize;
                let reading = weights.reading(own, other, factor);
                put(patch as usize, column, reading);
                put(other, patch.cast_signed(), reading);
            }
        }
    }
    let patches: Vec<usize> = (0..count).collect();
    let parts = patches.chunks(count.div_ceil(MERGED_RUNS).max(1)).map(|patches| {
        let mut part = Part {
            indptr: vec![0],
            // Sums of two readings over an area, which are no numbers of the store's.
            data: FactorVec::Double(Vec::new()),
            ..Part::default()
        };
        for &patch in patches {
            let row = &mut entries[begins[patch]..begins[patch + 1]];
            // Readings of one pair stay in their order.
            row.sort_by_key(|(column, _)| *column);
            let area = weights.area[patch];
            let scale = if area > 0.0 { 1.0 / area } else { 0.0 };
            for pair in row.chunk_by(|a, b| a.0 == b.0) {
                part.indices.push(pair[0].0);
                part.data
                    .push(pair.iter().map(|(_, reading)| reading).sum::<f64>() * scale);
            }
            part.rows.push(u32::try_from(patch).unwrap_or(u32::MAX));
            part.indptr.push(i64::try_from(part.indices.len()).unwrap_or(i64::MAX));
        }
        part
    });
    Ok(Some(InMemory::new(count, parts.collect())))
}

fn twice(patch: u32) -> Error {
    let reason = format!("has a row of patch {patch}, which does not exist or has a row already");
    Error::malformed(Path::new("the matrix"), reason)
}

/// Of one row's entries: sets `of_row` to Σⱼ t xⱼ, and adds t xᵢ to `y` at each column.
#[inline]
fn row_of(
    weights: &Weights,
    patch: usize,
    (columns, factors): (&[i32], FactorSlice<'_>),
    x: &Block,
    y: &mut Block,
    of_row: &mut [f64],
) {
    match factors {
        FactorSlice::Single(factors) => row_in(weights, patch, columns, factors, x, y, of_row),
        FactorSlice::Double(factors) => row_in(weights, patch, columns, factors, x, y, of_row),
    }
}

#[inline]
fn row_in<F: Number>(
    weights: &Weights,
    patch: usize,
    columns: &[i32],
    factors: &[F],
    x: &Block,
    y: &mut Block,
    of_row: &mut [f64],
) {
    match of_row.len() {
        1 => fixed::<1>(weights, patch, columns, factors, x, y, of_row),
        2 => fixed::<2>(weights, patch, columns, factors, x, y, of_row),
        3 => fixed::<3>(weights, patch, columns, factors, x, y, of_row),
        8 => fixed::<8>(weights, patch, columns, factors, x, y, of_row),
        _ => {
            let own = weights.of(patch);
            of_row.fill(0.0);
            for (&column, &factor) in columns.iter().zip(factors) {
                let column = column.cast_unsigned() as usize;
                let reading = weights.reading(own, column, factor.into());
                for (sum, x) in of_row.iter_mut().zip(x.of(column)) {
                    *sum += reading * x;
                }
                for (y, x) in y.of_mut(column).iter_mut().zip(x.of(patch)) {
                    *y += reading * x;
                }
            }
        }
    }
}

#[inline]
fn fixed<const N: usize>(
    weights: &Weights,
    patch: usize,
    columns: &[i32],
    factors: &[impl Number],
    x: &Block,
    y: &mut Block,
    of_row: &mut [f64],
) {
    let own = weights.of(patch);
    let mut sums = [0.0; N];
    let x = x.values().as_chunks::<N>().0;
    let y = y.values_mut().as_chunks_mut::<N>().0;
    let sent = x[patch];
    for (&column, &factor) in columns.iter().zip(factors) {
        let column = column.cast_unsigned() as usize;
        let reading = weights.reading(own, column, factor.into());
        let (seen, y) = (&x[column], &mut y[column]);
        for lane in 0..N {
            sums[lane] += reading * seen[lane];
            y[lane] += reading * sent[lane];
        }
    }
    of_row.copy_from_slice(&sums);
}

/// Sweeps over the rows of F' that take the newest values (Gauss–Seidel).
///
/// A row's product has a part from its own entries, and a part from other rows' entries. The latter is kept, and a
/// change of x after a row is added to the parts of its columns: each sum is of the newest values, in one pass over
/// the stored entries.
pub(super) struct Sweeps<'w> {
    weights: &'w Weights,
    /// A times the part of each row's product that other rows' entries give.
    from_others: Block,
}

impl<'w> Sweeps<'w> {
    pub(super) fn new(factors: &dyn Factors, weights: &'w Weights, x: &Block) -> Result<Self> {
        let mut from_others = Block::zeros(x.patches(), x.columns());
        let mut of_row = vec![0.0; x.columns()];
        in_order(factors, |part| {
            for (row, &patch) in part.rows.iter().enumerate() {
                row_of(weights, patch as usize, part.row(row), x, &mut from_others, &mut of_row);
            }
        })?;
        Ok(Self { weights, from_others })
    }

    /// Sets `sums` to the product of a row with `x`.
    pub(super) fn product(
        &self,
        patch: usize,
        (columns, factors): (&[i32], FactorSlice<'_>),
        x: &Block,
        sums: &mut [f64],
    ) {
        sums.fill(0.0);
        let own = self.weights.of(patch);
        for (&column, factor) in columns.iter().zip(factors) {
            let column = column.cast_unsigned() as usize;
            let reading = self.weights.reading(own, column, factor);
            for (sum, x) in sums.iter_mut().zip(x.of(column)) {
                *sum += reading * x;
            }
        }
        let scale = if own.0 > 0.0 { 1.0 / own.0 } else { 0.0 };
        for (sum, others) in sums.iter_mut().zip(self.from_others.of(patch)) {
            *sum = (*sum + others) * scale;
        }
    }

    /// Takes note that x of a row's patch changed by `change`.
    pub(super) fn changed(&mut self, patch: usize, (columns, factors): (&[i32], FactorSlice<'_>), change: &[f64]) {
        let own = self.weights.of(patch);
        for (&column, factor) in columns.iter().zip(factors) {
            let column = column.cast_unsigned() as usize;
            let reading = self.weights.reading(own, column, factor);
            for (others, change) in self.from_others.of_mut(column).iter_mut().zip(change) {
                *others += reading * change;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{InMemory, Method, Problem, SolveOptions, solve};

    /// Rows of small and large patches, of which each pair has two different readings.
    fn rows(count: usize) -> Vec<Vec<f64>> {
        let entry = |i: usize, j: usize| match (i * 7 + j * 5) % 4 {
            0 => 0.0,
            // As f32 has them.
            other => other as f64 / 128.0,
        };
        (0..count)
            .map(|i| (0..count).map(|j| if i == j { 0.0 } else { entry(i, j) }).collect())
            .collect()
    }

    fn areas(count: usize) -> Vec<f64> {
        (0..count).map(|patch| 0.1 + ((patch * 37) % 11) as f64).collect()
    }

    /// One run a row.
    fn in_runs(rows: &[Vec<f64>]) -> InMemory {
        let parts = rows.iter().enumerate().map(|(patch, row)| {
            let one = InMemory::dense(std::slice::from_ref(row)).run(0).expect("a run");
            Part {
                rows: vec![u32::try_from(patch).unwrap()],
                ..Part::clone(&one)
            }
        });
        InMemory::new(rows.len(), parts.collect())
    }

    #[test]
    fn the_product_is_that_of_the_weighted_mean_on_any_threads() {
        let (rows, areas) = (rows(23), areas(23));
        let runs = in_runs(&rows);
        let pairs = Pairs::new(&runs, &areas, &RowTable::unknown(23), 2).unwrap();
        for columns in [1, 2, 3, 4, 8] {
            let x = Block::from_fn(23, columns, |patch, column| {
                ((patch * 13 + column * 5) % 17) as f64 - 8.0
            });
            let y = multiply(&pairs, &pairs.weights, &x, 1).unwrap();
            for threads in [2, 5] {
                assert_eq!(multiply(&pairs, &pairs.weights, &x, threads).unwrap(), y);
            }
            for i in 0..23 {
                for column in 0..columns {
                    let wanted: f64 = (0..23)
                        .map(|j| {
                            let (a, b) = (areas[i] * areas[i], areas[j] * areas[j]);
                            let pair = (b * areas[i] * rows[i][j] + a * areas[j] * rows[j][i]) / (a + b);
                            pair / areas[i] * x.of(j)[column]
                        })
                        .sum();
                    assert!(
                        (y.of(i)[column] - wanted).abs() < 1e-12 * (1.0 + wanted.abs()),
                        "{i} {wanted}"
                    );
                }
            }
        }
    }

    #[test]
    fn all_methods_solve_the_same_system_and_what_is_put_in_comes_out() {
        let (rows, areas) = (rows(23), areas(23));
        let runs = in_runs(&rows);
        let mut table = RowTable::unknown(23);
        table.escaped = vec![0.0; 23];
        table.row_sum = rows.iter().map(|row| row.iter().sum()).collect();
        let pairs = Pairs::new(&runs, &areas, &table, 1).unwrap();
        let of_pairs = pairs.rows(&table, 1).unwrap();
        let solved = |factors: &dyn Factors, table: &RowTable, method| {
            let problem = Problem {
                reflectance: Block::from_fn(23, 1, |_, _| 0.6),
                bands: vec![0],
                emission: Block::from_fn(23, 1, |patch, _| (patch % 3) as f64),
                outside: None,
                returned: Some(table.returned()),
            };
            let options = SolveOptions {
                method,
                tolerance: 1e-13,
                ..SolveOptions::default()
            };
            solve(factors, &problem, options, &mut |_| true).unwrap()
        };
        let net = |solution: &crate::solve::Solution| -> f64 {
            (0..23)
                .map(|i| areas[i] * (solution.radiosity.of(i)[0] - solution.irradiance.of(i)[0]))
                .sum()
        };
        let gmres = solved(&pairs, &of_pairs, Method::Gmres { restart: 20 });
        assert!(net(&gmres).abs() < 1e-9, "{}", net(&gmres));
        for method in [Method::Jacobi, Method::GaussSeidel] {
            let other = solved(&pairs, &of_pairs, method);
            for i in 0..23 {
                let (a, b) = (gmres.radiosity.of(i)[0], other.radiosity.of(i)[0]);
                assert!((a - b).abs() < 1e-9 * a.abs(), "{method:?} {i} {a} {b}");
            }
        }
        // As stored, it does not; the readings' disagreement is what is missing, once for who sends and for who receives.
        let stored = solved(&runs, &table, Method::Gmres { restart: 20 });
        let off = net(&stored);
        let sent: Vec<f64> = stored.radiosity.column(0).collect();
        let named = disagreement(&runs, &areas, &[1.0; 23], &sent).unwrap();
        assert!(
            off.abs() > 0.1 && (named.iter().sum::<f64>() / 2.0 - off).abs() < 1e-9 * off.abs().max(1.0),
            "{off}"
        );
    }

    #[test]
    fn the_merged_matrix_has_the_products_of_the_pairs() {
        let (rows, areas) = (rows(23), areas(23));
        let runs = in_runs(&rows);
        let pairs = Pairs::new(&runs, &areas, &RowTable::unknown(23), 1).unwrap();
        let merged = merged(&pairs, &pairs.weights).unwrap().expect("a small matrix");
        for columns in [1, 3, 16, 40] {
            let x = Block::from_fn(23, columns, |patch, column| {
                ((patch * 7 + column * 3) % 11) as f64 - 5.0
            });
            let wanted = multiply(&pairs, &pairs.weights, &x, 1).unwrap();
            let found = crate::solve::multiply(&merged, &x, 1).unwrap();
            assert_eq!(found, crate::solve::multiply(&merged, &x, 5).unwrap());
            for (found, wanted) in found.values().iter().zip(wanted.values()) {
                assert!(
                    (found - wanted).abs() < 1e-13 * (1.0 + wanted.abs()),
                    "{columns}: {found} {wanted}"
                );
            }
        }
        let twice = InMemory::new(2, vec![Part::clone(&InMemory::dense(&[vec![0.5]]).run(0).unwrap()); 2]);
        let areas = Pairs::new(&twice, &[1.0; 2], &RowTable::unknown(2), 1).unwrap();
        assert!(super::merged(&areas, &areas.weights).is_err());
    }

    #[test]
    fn many_right_hand_sides_have_the_solutions_of_each_alone_on_any_threads() {
        let (rows, areas) = (rows(23), areas(23));
        let runs = in_runs(&rows);
        let mut table = RowTable::unknown(23);
        table.escaped = vec![0.0; 23];
        table.row_sum = rows.iter().map(|row| row.iter().sum()).collect();
        let pairs = Pairs::new(&runs, &areas, &table, 1).unwrap();
        let returned = pairs.rows(&table, 1).unwrap().returned();
        let problem = |columns: std::ops::Range<usize>| Problem {
            reflectance: Block::from_fn(23, 1, |patch, _| 0.3 + 0.02 * patch as f64),
            bands: vec![0; columns.len()],
            emission: Block::from_fn(23, columns.len(), |patch, column| {
                ((patch + 3 * (columns.start + column)) % 7) as f64
            }),
            outside: None,
            returned: Some(returned.clone()),
        };
        let solved = |columns, threads| {
            let options = SolveOptions {
                tolerance: 1e-12,
                threads,
                ..SolveOptions::default()
            };
            solve(&pairs, &problem(columns), options, &mut |_| true).unwrap()
        };
        let all = solved(0..600, 1);
        assert!(all.converged);
        for threads in [2, 5] {
            assert_eq!(solved(0..600, threads).radiosity, all.radiosity);
        }
        for column in [0, 31, 32, 599] {
            let alone = solved(column..column + 1, 1);
            for patch in 0..23 {
                let (a, b) = (alone.radiosity.of(patch)[0], all.radiosity.of(patch)[column]);
                assert!((a - b).abs() < 1e-9 * a.abs().max(1.0), "{column} {patch}: {a} {b}");
            }
        }
    }

    #[test]
    fn a_patch_without_a_column_is_read_from_its_own_row_alone() {
        let matrix = InMemory::dense(&[vec![0.0, 0.5], vec![0.0, 0.0]]);
        let mut table = RowTable::unknown(2);
        table.unselected = vec![0.0, 0.25];
        let pairs = Pairs::new(&matrix, &[2.0, 4.0], &table, 1).unwrap();
        let seen = multiply(&pairs, &pairs.weights, &Block::from_fn(2, 1, |_, _| 1.0), 1).unwrap();
        assert_eq!((seen.of(0)[0], seen.of(1)[0]), (0.5, 0.25));
        let refused = Pairs::new(&matrix, &[1.0], &table, 1);
        assert!(refused.is_err());
    }
}
