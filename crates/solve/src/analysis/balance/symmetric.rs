//! A symmetric matrix on disk, in the processing order, and its scaling.
//!
//! ```text
//! record  u32 column   f32 q = S / √(Aᵢ Aⱼ)    8 bytes; rows one behind the other, their lengths in memory
//!         or, of a double store, f64           12 bytes
//! ```
//!
//! q is symmetric and, being √(Fᵢⱼ Fⱼᵢ), within f32 whatever the areas are; S = A F need not be. With gᵢ = dᵢ √Aᵢ the
//! condition on a row is gᵢ Σⱼ qᵢⱼ gⱼ = Aᵢ tᵢ, and Fᵢⱼ = gᵢ qᵢⱼ gⱼ / Aᵢ.

use super::exchange::Scratch;
use super::{Areas, BalanceOptions};
use hemicube_store::closure::share_of;
use hemicube_store::{Precision, Result};
use std::path::Path;

/// Bytes of a record.
pub(crate) const fn record_size(precision: Precision) -> usize {
    4 + precision.size()
}

/// Every step goes further than to the minimum along its coordinate (successive over-relaxation, Young 1954): rows that
/// face each other across a street converge in a third of the sweeps. At 2 nothing converges any more.
const RELAXATION: f64 = 1.6;

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 20;

/// A symmetric matrix on disk.
#[derive(Debug)]
pub(crate) struct Symmetric<'a> {
    file: Scratch,
    /// The input patch of each row.
    order: &'a [u32],
    rows_per_part: usize,
    precision: Precision,
    /// Entries of each row.
    lengths: Vec<u32>,
    of_row: u32,
    buffer: Vec<u8>,
    written: u64,
    /// 1 − ρs − τ of each patch; empty without mirrors and panes.
    kept: Vec<f64>,
}

/// The rows of one part.
#[derive(Debug)]
pub(crate) struct Block<'a> {
    bytes: Vec<u8>,
    precision: Precision,
    patches: &'a [u32],
    lengths: &'a [u32],
}

impl Block<'_> {
    /// Its rows: columns and values.
    pub(crate) fn rows(&self) -> impl Iterator<Item = impl Iterator<Item = (u32, f64)> + '_> + '_ {
        let (mut left, size, precision) = (&self.bytes[..], record_size(self.precision), self.precision);
        self.lengths.iter().map(move |&length| {
            let (row, rest) = left.split_at((length as usize * size).min(left.len()));
            left = rest;
            row.chunks_exact(size).map(move |record| decode(precision, record))
        })
    }

    fn with_patches(&self) -> impl Iterator<Item = (u32, impl Iterator<Item = (u32, f64)> + '_)> + '_ {
        self.patches.iter().copied().zip(self.rows())
    }
}

fn decode(precision: Precision, record: &[u8]) -> (u32, f64) {
    let column = record.first_chunk().map_or(0, |&column| u32::from_le_bytes(column));
    (column, precision.get(record.get(4..).unwrap_or_default()))
}

/// Effect of leaving out small entries.
#[derive(Debug)]
pub(crate) struct Dropped {
    /// Entries left out.
    pub(crate) entries: u64,
    /// Share of Σ Aᵢ Fᵢⱼ of the entries left out.
    pub(crate) share: f64,
    /// Rows that kept small entries, having no others.
    pub(crate) rows_kept: u64,
    /// Sum of each row before, by input patch.
    pub(crate) sums: Vec<f64>,
}

/// The scaling of a symmetric matrix.
#[derive(Debug)]
pub(crate) struct Scaling {
    /// dᵢ √Aᵢ by input patch.
    weights: Vec<f64>,
    precision: Precision,
    pub(crate) sweeps: u32,
    pub(crate) converged: bool,
    pub(crate) rows_empty: u64,
    pub(crate) rows_without_target: u64,
    pub(crate) rows_at_bound: u64,
    /// True if a row is one of these, by input patch.
    pub(crate) unmatched: Vec<bool>,
}

impl Scaling {
    /// F\[i, j\] of a symmetric entry.
    pub(crate) fn factor(&self, areas: &Areas, i: u32, j: u32, value: f64) -> f64 {
        // The product of the weights does not depend on their order: both rows have the same exchange area.
        let exchange = value * (at(&self.weights, i) * at(&self.weights, j));
        self.precision.round(exchange / at(&areas.share, i))
    }

    /// dᵢ dⱼ.
    pub(crate) fn of_entry(&self, areas: &Areas, i: u32, j: u32) -> f64 {
        (at(&self.weights, i) * at(&self.weights, j)) / (at(&areas.root, i) * at(&areas.root, j))
    }
}

/// The value of a patch. Columns were held against the patch count when the source was surveyed.
fn at(values: &[f64], patch: u32) -> f64 {
    values.get(patch as usize).copied().unwrap_or(1.0)
}

/// Σ qᵢⱼ gⱼ over a row, times what j keeps: four sums side by side, for the additions not to wait for each other.
fn product(row: impl Iterator<Item = (u32, f64)>, weights: &[f64], kept: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    for (place, (column, value)) in row.enumerate() {
        let weight = at(weights, column) * if kept.is_empty() { 1.0 } else { at(kept, column) };
        sums[place % 4] += value * weight;
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

impl<'a> Symmetric<'a> {
    /// An empty matrix in a file in `directory`.
    pub(crate) fn create(directory: &Path, order: &'a [u32], rows_per_part: u32, precision: Precision) -> Result<Self> {
        Ok(Self {
            file: Scratch::create(directory, "symmetric")?,
            order,
            rows_per_part: rows_per_part.max(1) as usize,
            precision,
            lengths: Vec::with_capacity(order.len()),
            of_row: 0,
            buffer: Vec::with_capacity(BUFFER + record_size(precision)),
            written: 0,
            kept: Vec::new(),
        })
    }

    /// The matrix whose columns count by what their patches keep; all by 1 where `kept` is empty.
    pub(crate) fn keeping(self, kept: Vec<f64>) -> Self {
        Self { kept, ..self }
    }

    /// Adds an entry to the row under way.
    pub(crate) fn push(&mut self, column: u32, value: f64) {
        self.buffer.extend_from_slice(&column.to_le_bytes());
        self.precision.put(value, &mut self.buffer);
        self.of_row += 1;
    }

    /// Ends a row.
    pub(crate) fn end_row(&mut self) -> Result<()> {
        self.lengths.push(std::mem::take(&mut self.of_row));
        if self.buffer.len() >= BUFFER {
            self.finish()?;
        }
        Ok(())
    }

    /// Writes buffered bytes.
    pub(crate) fn finish(&mut self) -> Result<()> {
        self.file.write(self.written, &self.buffer)?;
        self.written += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    fn part_count(&self) -> usize {
        self.order.len().div_ceil(self.rows_per_part)
    }

    fn rows_of(&self, place: usize) -> std::ops::Range<usize> {
        let count = self.lengths.len().min(self.order.len());
        let start = place.saturating_mul(self.rows_per_part).min(count);
        start..start.saturating_add(self.rows_per_part).min(count)
    }

    fn size_of(&self, place: usize) -> u64 {
        let lengths = self.lengths.get(self.rows_of(place)).unwrap_or_default();
        lengths
            .iter()
            .map(|&length| u64::from(length) * record_size(self.precision) as u64)
            .sum()
    }

    /// The rows of a part.
    pub(crate) fn block(&mut self, place: usize) -> Result<Block<'_>> {
        let start = (0..place).map(|before| self.size_of(before)).sum();
        self.block_at(place, start)
    }

    fn block_at(&mut self, place: usize, start: u64) -> Result<Block<'_>> {
        let bytes = self.file.read(start, self.size_of(place))?;
        let rows = self.rows_of(place);
        Ok(Block {
            bytes,
            precision: self.precision,
            patches: self.order.get(rows.clone()).unwrap_or_default(),
            lengths: self.lengths.get(rows).unwrap_or_default(),
        })
    }

    /// Calls `act` with the patch and the entries of every row.
    fn each_row(&mut self, mut act: impl FnMut(u32, &mut dyn Iterator<Item = (u32, f64)>)) -> Result<()> {
        let mut start = 0;
        for place in 0..self.part_count() {
            let block = self.block_at(place, start)?;
            for (patch, mut row) in block.with_patches() {
                act(patch, &mut row);
            }
            start += self.size_of(place);
        }
        Ok(())
    }

    /// Leaves out the pairs with both form factors below `least`. The largest pair of a row stays: without it no entry
    /// could take the row's loss.
    pub(crate) fn keep_from(&mut self, areas: &Areas, least: f64) -> Result<Dropped> {
        let mut largest = vec![0.0f64; areas.share.len()];
        let mut sums = vec![0.0f64; areas.share.len()];
        self.each_row(|patch, row| {
            let (mut most, mut sum) = (0.0f64, 0.0);
            for (column, value) in row {
                let exchange = value * (at(&areas.root, patch) * at(&areas.root, column));
                most = most.max(exchange);
                sum += exchange;
            }
            if let (Some(slot), Some(of_row)) = (largest.get_mut(patch as usize), sums.get_mut(patch as usize)) {
                (*slot, *of_row) = (most, share_of(sum, at(&areas.share, patch)));
            }
        })?;
        let mut dropped = Dropped {
            entries: 0,
            share: 0.0,
            rows_kept: 0,
            sums,
        };
        let (mut mass, mut lost) = (0.0, 0.0);
        let precision = self.precision;
        let (mut read, mut written) = (0, 0);
        for place in 0..self.part_count() {
            let size = self.size_of(place);
            let block = self.block_at(place, read)?;
            let mut kept: Vec<u8> = Vec::with_capacity(block.bytes.len());
            let mut lengths = Vec::with_capacity(block.lengths.len());
            for (patch, row) in block.with_patches() {
                let before = kept.len();
                let mut only_as_largest = 0u64;
                let mut large = 0u64;
                for (column, value) in row {
                    let exchange = value * (at(&areas.root, patch) * at(&areas.root, column));
                    mass += exchange;
                    let is_large = exchange >= least * at(&areas.share, patch).min(at(&areas.share, column));
                    let is_largest =
                        exchange > 0.0 && (exchange >= at(&largest, patch) || exchange >= at(&largest, column));
                    if is_large || is_largest {
                        kept.extend_from_slice(&column.to_le_bytes());
                        precision.put(value, &mut kept);
                    } else {
                        lost += exchange;
                        dropped.entries += 1;
                    }
                    large += u64::from(is_large);
                    only_as_largest += u64::from(is_largest && !is_large);
                }
                dropped.rows_kept += u64::from(large == 0 && only_as_largest > 0);
                lengths.push(u32::try_from((kept.len() - before) / record_size(precision)).unwrap_or(u32::MAX));
            }
            // The end of the kept entries never reaches those still to be read.
            self.file.write(written, &kept)?;
            read += size;
            written += kept.len() as u64;
            let rows = self.rows_of(place);
            if let Some(slots) = self.lengths.get_mut(rows) {
                slots.copy_from_slice(&lengths);
            }
        }
        self.written = written;
        dropped.share = share_of(lost, mass);
        Ok(dropped)
    }

    /// Scales rows and columns until every row sums to its target, by input patch; rows without one stay unchanged.
    pub(crate) fn scale(
        &mut self,
        areas: &Areas,
        targets: &[Option<f64>],
        options: &BalanceOptions,
    ) -> Result<Scaling> {
        let mut scaling = Scaling {
            weights: areas.root.clone(),
            precision: self.precision,
            sweeps: 0,
            converged: targets.iter().all(Option::is_none),
            rows_empty: 0,
            rows_without_target: 0,
            rows_at_bound: 0,
            unmatched: vec![false; targets.len()],
        };
        while !scaling.converged && scaling.sweeps < options.max_sweeps {
            let mut change = 0.0f64;
            let (mut empty, mut without, mut bound) = (0, 0, 0);
            let (weights, unmatched) = (&mut scaling.weights, &mut scaling.unmatched);
            let kept = std::mem::take(&mut self.kept);
            self.each_row(|patch, row| {
                let Some(&Some(target)) = targets.get(patch as usize) else {
                    return;
                };
                let sum = product(row, weights, &kept);
                let mut note = |is_unmatched| {
                    if let Some(slot) = unmatched.get_mut(patch as usize) {
                        *slot = is_unmatched;
                    }
                };
                if sum == 0.0 {
                    note(target > 0.0);
                    empty += u64::from(target > 0.0);
                    return;
                }
                without += u64::from(target == 0.0);
                let root = at(&areas.root, patch);
                let wanted = target * at(&areas.share, patch) / sum;
                let (least, most) = (root / options.max_scale, root * options.max_scale);
                let within = wanted.clamp(least, most);
                note(wanted != within || target == 0.0);
                bound += u64::from(wanted != within && target > 0.0);
                if let Some(weight) = weights.get_mut(patch as usize) {
                    let ratio = within / *weight;
                    change = change.max((ratio - 1.0).abs());
                    *weight = (*weight * ratio.powf(RELAXATION)).clamp(least, most);
                }
            })?;
            self.kept = kept;
            scaling.sweeps += 1;
            scaling.converged = change <= options.tolerance;
            (scaling.rows_empty, scaling.rows_without_target, scaling.rows_at_bound) = (empty, without, bound);
        }
        Ok(scaling)
    }
}
