//! Rows for a page: their largest entries, and the objects with the largest sums.
//!
//! ```text
//! row       count + 1 (0: no row), gaps between the patches, ascending, 16 bits of each form factor;
//!           count, numbers of the objects and 16 bits of the sum to each, largest first
//! ```
//!
//! Counts, gaps and numbers have 7 bits a byte, lowest first; the eighth bit marks a continuation. Form factors have
//! the store's compact form: f32 without the last 13 bits of the mantissa.

use super::blocks::Blocks;
use anyhow::{Result, bail};
use hemicube::store::{FactorSlice, Form, PatchTable};
use serde::Serialize;

/// Most rows deflated together, and about the most entries: one click unpacks all of them.
const PER_BLOCK: usize = 1024;
const ENTRIES_PER_BLOCK: usize = 1 << 16;
/// Objects named for a row.
const OBJECTS: usize = 8;

/// Description of the rows, for the viewer.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Packed {
    per_block: usize,
    pub(super) entries: usize,
    pub(super) objects: usize,
}

/// Packs rows, in any order.
pub(super) struct RowPacker<'a> {
    table: &'a PatchTable,
    entries: usize,
    /// Range in `bytes` of each patch's row.
    places: Vec<(usize, usize)>,
    bytes: Vec<u8>,
    /// Entries packed.
    packed: usize,
    /// Σ F by object of the current row, and the objects with any.
    sums: Vec<f64>,
    reached: Vec<u32>,
    largest: Vec<(u32, f32)>,
}

fn put(bytes: &mut Vec<u8>, mut number: u32) {
    loop {
        let low = (number & 127) as u8;
        number >>= 7;
        if number == 0 {
            bytes.push(low);
            return;
        }
        bytes.push(low | 128);
    }
}

/// The 16 bits of a form factor in the store's compact form.
fn code(factor: f32) -> u16 {
    #[allow(clippy::cast_possible_truncation, reason = "a number of the compact form")]
    let rounded = Form::Compact.round(factor.into()) as f32;
    let bits = (rounded.to_bits() >> 13).saturating_sub(64 << 10);
    u16::try_from(bits).unwrap_or(u16::MAX)
}

impl<'a> RowPacker<'a> {
    /// Keeps the largest `entries` of each row; 0 for no rows.
    pub(super) fn new(table: &'a PatchTable, objects: usize, entries: usize) -> Self {
        Self {
            table,
            entries,
            places: vec![(0, 0); table.len()],
            bytes: Vec::new(),
            packed: 0,
            sums: vec![0.0; objects],
            reached: Vec::new(),
            largest: Vec::new(),
        }
    }

    /// Packs the row of a patch.
    ///
    /// # Errors
    /// When it has a column that does not exist.
    pub(super) fn add(&mut self, patch: u32, columns: &[i32], factors: FactorSlice<'_>) -> Result<()> {
        if self.entries == 0 {
            return Ok(());
        }
        self.largest.clear();
        for (&column, factor) in columns.iter().zip(factors) {
            let found = u32::try_from(column)
                .ok()
                .and_then(|column| Some((column, *self.table.object.get(column as usize)?)));
            let Some((column, object)) = found else {
                bail!("the row of patch {patch} has the column {column}, which does not exist")
            };
            #[allow(clippy::cast_possible_truncation, reason = "the page has 16 bits of it")]
            self.largest.push((column, factor as f32));
            if let Some(sum) = self.sums.get_mut(object as usize)
                && factor > 0.0
            {
                if *sum == 0.0 {
                    self.reached.push(object);
                }
                *sum += factor;
            }
        }
        // The largest; of equal ones, the first.
        let order = |a: &(u32, f32), b: &(u32, f32)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
        if self.largest.len() > self.entries {
            self.largest.select_nth_unstable_by(self.entries - 1, order);
            self.largest.truncate(self.entries);
        }
        self.packed += self.largest.len();
        self.largest.sort_unstable_by_key(|&(column, _)| column);
        let begin = self.bytes.len();
        put(
            &mut self.bytes,
            u32::try_from(self.largest.len()).unwrap_or(u32::MAX - 1) + 1,
        );
        let mut next = 0;
        for &(column, _) in &self.largest {
            put(&mut self.bytes, column - next);
            next = column + 1;
        }
        for &(_, factor) in &self.largest {
            self.bytes.extend_from_slice(&code(factor).to_le_bytes());
        }
        let sums = &mut self.sums;
        self.reached
            .sort_unstable_by(|&a, &b| sums[b as usize].total_cmp(&sums[a as usize]).then(a.cmp(&b)));
        let named = &self.reached[..self.reached.len().min(OBJECTS)];
        put(&mut self.bytes, u32::try_from(named.len()).unwrap_or(0));
        for &object in named {
            put(&mut self.bytes, object);
        }
        for &object in named {
            #[allow(clippy::cast_possible_truncation, reason = "16 bits are kept")]
            let sum = sums[object as usize] as f32;
            self.bytes.extend_from_slice(&code(sum).to_le_bytes());
        }
        for object in self.reached.drain(..) {
            sums[object as usize] = 0.0;
        }
        self.places[patch as usize] = (begin, self.bytes.len());
        Ok(())
    }

    /// Writes the rows in the order of the patches; `None` if none were wanted.
    pub(super) fn finish(self, blocks: &mut Blocks) -> Option<Packed> {
        if self.entries == 0 {
            return None;
        }
        let per_row = (self.packed / self.places.len().max(1)).max(1);
        let per_block = (ENTRIES_PER_BLOCK / per_row).clamp(1, PER_BLOCK);
        for (number, places) in self.places.chunks(per_block).enumerate() {
            let mut bytes = Vec::new();
            for &(begin, end) in places {
                if begin == end {
                    put(&mut bytes, 0);
                } else {
                    bytes.extend_from_slice(&self.bytes[begin..end]);
                }
            }
            blocks.bytes(&format!("rows-{number}"), &bytes);
        }
        Some(Packed {
            per_block,
            entries: self.entries,
            objects: OBJECTS,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_seven_bits_a_byte() {
        for (number, expected) in [(0, vec![0]), (127, vec![127]), (128, vec![128, 1]), (300, vec![172, 2])] {
            let mut bytes = Vec::new();
            put(&mut bytes, number);
            assert_eq!(bytes, expected);
        }
    }

    #[test]
    fn codes_are_those_of_the_compact_form() {
        for factor in [0.0f32, 1.0, 0.36, 1e-7, 3.3e-12] {
            let code = code(factor);
            let back = if code == 0 {
                0.0
            } else {
                f32::from_bits((u32::from(code) << 13) + (64 << 23))
            };
            assert!((back - factor).abs() <= factor * 2f32.powi(-11), "{factor} {back}");
        }
    }

    #[test]
    fn the_largest_entries_are_kept_in_the_order_of_patches() {
        let table = PatchTable {
            object: vec![0, 0, 1, 1, 1],
            ..PatchTable::default()
        };
        let mut packer = RowPacker::new(&table, 2, 2);
        packer.places = vec![(0, 0); 5];
        packer
            .add(0, &[1, 2, 3, 4], FactorSlice::Single(&[0.25, 0.0, 0.5, 0.125]))
            .expect("sound columns");
        let mut expected = vec![3, 1, 1];
        for factor in [0.25, 0.5] {
            expected.extend_from_slice(&code(factor).to_le_bytes());
        }
        expected.extend([2, 1, 0]);
        for factor in [0.625, 0.25] {
            expected.extend_from_slice(&code(factor).to_le_bytes());
        }
        assert_eq!(packer.bytes, expected);
        assert!(packer.add(1, &[5], FactorSlice::Single(&[0.1])).is_err());
    }
}
