//! Rows from backends, and the check of every one before its use.

use crate::backend::WHOLE;
use hemicube_scene::InputPatch;

/// Rows of weights, one after the other, in the order of their hemicubes.
///
/// Each entry is (patch, visible weight, covered weight). *Covered* is the weight of the patch alone, by the same
/// rasteriser, and is at least *visible*; it is 0 throughout unless covered weights were asked for. Among covered rows,
/// an entry of two weights 0 and a pixel count of 0 is a *sub-pixel* patch: its whole triangle covers no pixel centre,
/// but it is nearest at its centroid.
///
/// ```
/// use hemicube_contract::InputPatch;
/// use hemicube_contract::backend::WHOLE;
/// use hemicube_contract::row::{RowBlock, RowError};
///
/// let mut rows = RowBlock::default();
/// rows.push(InputPatch(2), WHOLE / 2, 0);
/// rows.push(InputPatch(5), WHOLE / 4, 0);
/// rows.end_row(WHOLE / 4, 0); // a quarter escapes, nothing is blocked
/// assert_eq!(rows.check(1, 6, false), Ok(()));
/// assert_eq!(rows.row(0).visible, [WHOLE / 2, WHOLE / 4]);
///
/// // The driver takes no row that loses light, or names a patch that is not there.
/// assert_eq!(rows.check(1, 5, false), Err(RowError::OutOfRange { row: 0, patch: 5, patch_count: 5 }));
/// rows.escaped[0] -= 1;
/// assert!(matches!(rows.check(1, 6, false), Err(RowError::Sum { row: 0, .. })));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowBlock {
    /// One past the last entry of each row.
    pub row_end: Vec<usize>,
    /// The patch of each entry, strictly ascending within a row.
    pub patches: Vec<u32>,
    /// The visible weight of each entry.
    pub visible: Vec<u32>,
    /// The covered weight of each entry.
    pub covered: Vec<u32>,
    /// Escaped weight of each row.
    pub escaped: Vec<u32>,
    /// Weight blocked by backs of one-sided patches, for each row.
    pub blocked: Vec<u32>,
}

/// One row of a [`RowBlock`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowView<'a> {
    /// The patch of each entry, strictly ascending.
    pub patches: &'a [u32],
    /// The visible weight of each entry.
    pub visible: &'a [u32],
    /// The covered weight of each entry.
    pub covered: &'a [u32],
    /// Escaped weight.
    pub escaped: u32,
    /// Weight blocked by backs of one-sided patches.
    pub blocked: u32,
}

/// A defect of a row.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RowError {
    /// The arrays of a block do not fit together.
    #[error("{what} of a block of rows: {found} entries where {wanted} were due")]
    Shape {
        /// The array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Its proper length.
        wanted: usize,
    },
    /// A patch id beyond the scene's patches.
    #[error("row {row}: patch {patch} of a scene of {patch_count} patches")]
    OutOfRange {
        /// Row within the block.
        row: usize,
        /// The id.
        patch: u32,
        /// Number of patches.
        patch_count: u32,
    },
    /// Patches not strictly ascending.
    #[error("row {row}: patch {second} after patch {first}; patches must be strictly ascending")]
    NotAscending {
        /// Row within the block.
        row: usize,
        /// The earlier id.
        first: u32,
        /// The id after it.
        second: u32,
    },
    /// A patch covering less than it shows.
    #[error("row {row}: patch {patch} shows weight {visible} but covers only {covered}")]
    CoveredBelowVisible {
        /// Row within the block.
        row: usize,
        /// The patch.
        patch: u32,
        /// Its visible weight.
        visible: u32,
        /// Its covered weight.
        covered: u32,
    },
    /// Weight lost or invented.
    #[error("row {row}: visible + escaped + blocked is {found}, not {WHOLE}: the backend lost or invented light")]
    Sum {
        /// Row within the block.
        row: usize,
        /// The sum of the weights.
        found: u64,
    },
}

impl RowBlock {
    /// Empties the block, keeping its memory.
    pub fn clear(&mut self) {
        self.row_end.clear();
        self.patches.clear();
        self.visible.clear();
        self.covered.clear();
        self.escaped.clear();
        self.blocked.clear();
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.row_end.len()
    }

    /// Returns whether it holds no row.
    pub fn is_empty(&self) -> bool {
        self.row_end.is_empty()
    }

    /// Adds an entry to the row being written.
    #[inline]
    pub fn push(&mut self, patch: InputPatch, visible: u32, covered: u32) {
        self.patches.push(patch.0);
        self.visible.push(visible);
        self.covered.push(covered);
    }

    /// Ends the row being written.
    pub fn end_row(&mut self, escaped: u32, blocked: u32) {
        self.row_end.push(self.patches.len());
        self.escaped.push(escaped);
        self.blocked.push(blocked);
    }

    /// Adds a row of another block.
    pub fn push_row(&mut self, row: &RowView<'_>) {
        self.patches.extend_from_slice(row.patches);
        self.visible.extend_from_slice(row.visible);
        self.covered.extend_from_slice(row.covered);
        self.end_row(row.escaped, row.blocked);
    }

    /// Row `row`, from 0.
    ///
    /// # Panics
    /// When there is no such row, or the block's arrays do not fit together ([`RowBlock::check`] finds out).
    pub fn row(&self, row: usize) -> RowView<'_> {
        let start = if row == 0 { 0 } else { self.row_end[row - 1] };
        let range = start..self.row_end[row];
        RowView {
            patches: &self.patches[range.clone()],
            visible: &self.visible[range.clone()],
            covered: &self.covered[range],
            escaped: self.escaped[row],
            blocked: self.blocked[row],
        }
    }

    /// Checks that the block holds `row_count` rows under the contract of [`crate::backend`]. One pass over data in
    /// cache; it stays on in release builds because a wrong matrix is worse than a slow one.
    ///
    /// # Errors
    /// The defect of the first bad row.
    pub fn check(&self, row_count: usize, patch_count: u32, with_covered: bool) -> Result<(), RowError> {
        let entries = self.row_end.last().copied().unwrap_or(0);
        for (what, found, wanted) in [
            ("row ends", self.row_end.len(), row_count),
            ("escaped weights", self.escaped.len(), row_count),
            ("blocked weights", self.blocked.len(), row_count),
            ("patches", self.patches.len(), entries),
            ("visible weights", self.visible.len(), entries),
            ("covered weights", self.covered.len(), entries),
        ] {
            if found != wanted {
                return Err(RowError::Shape { what, found, wanted });
            }
        }
        let mut start = 0;
        for (row, &end) in self.row_end.iter().enumerate() {
            if end < start || end > entries {
                return Err(RowError::Shape {
                    what: "row ends",
                    found: end,
                    wanted: start,
                });
            }
            let patches = &self.patches[start..end];
            if let Some(&patch) = patches.iter().find(|&&p| p >= patch_count) {
                return Err(RowError::OutOfRange {
                    row,
                    patch,
                    patch_count,
                });
            }
            if let Some(pair) = patches.windows(2).find(|pair| pair[0] >= pair[1]) {
                return Err(RowError::NotAscending {
                    row,
                    first: pair[0],
                    second: pair[1],
                });
            }
            let visible = &self.visible[start..end];
            if with_covered {
                let covered = &self.covered[start..end];
                if let Some(k) = (0..patches.len()).find(|&k| covered[k] < visible[k]) {
                    return Err(RowError::CoveredBelowVisible {
                        row,
                        patch: patches[k],
                        visible: visible[k],
                        covered: covered[k],
                    });
                }
            }
            let found = visible.iter().map(|&v| u64::from(v)).sum::<u64>()
                + u64::from(self.escaped[row])
                + u64::from(self.blocked[row]);
            if found != u64::from(WHOLE) {
                return Err(RowError::Sum { row, found });
            }
            start = end;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> RowBlock {
        let mut block = RowBlock::default();
        block.push(InputPatch(3), 1000, 1000);
        block.push(InputPatch(7), WHOLE - 1500, WHOLE - 1400);
        block.end_row(200, 300);
        block.end_row(WHOLE, 0);
        block
    }

    #[test]
    fn a_good_block_passes() {
        assert_eq!(good().check(2, 8, true), Ok(()));
        assert_eq!(good().row(0).patches, &[3, 7]);
        assert!(good().row(1).patches.is_empty());
    }

    #[test]
    fn every_defect_is_found() {
        let broken = |mend: fn(&mut RowBlock)| {
            let mut block = good();
            mend(&mut block);
            block.check(2, 8, true).expect_err("a broken block passed")
        };
        assert!(matches!(
            broken(|b| b.visible[0] += 1),
            RowError::CoveredBelowVisible { patch: 3, .. }
        ));
        assert!(
            matches!(broken(|b| b.escaped[1] -= 1), RowError::Sum { row: 1, found } if found == u64::from(WHOLE) - 1)
        );
        assert!(matches!(broken(|b| b.blocked[0] += 1), RowError::Sum { row: 0, .. }));
        assert!(matches!(
            broken(|b| b.patches[1] = 8),
            RowError::OutOfRange { patch: 8, .. }
        ));
        assert!(matches!(
            broken(|b| b.patches[1] = 3),
            RowError::NotAscending {
                first: 3,
                second: 3,
                ..
            }
        ));
        assert!(matches!(
            broken(|b| b.patches.push(1)),
            RowError::Shape { what: "patches", .. }
        ));
        assert!(matches!(broken(|b| b.row_end[0] = 5), RowError::Shape { .. }));
        assert!(matches!(broken(|b| b.row_end[0] = 1), RowError::Sum { row: 0, .. }));
        assert!(matches!(
            good().check(3, 8, true),
            Err(RowError::Shape { what: "row ends", .. })
        ));
    }
}
