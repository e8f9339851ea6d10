//! Closure of rows: Σⱼ Fᵢⱼ + escapedᵢ + blockedᵢ + unselectedᵢ = 1, and less what portals passed on of arrivals.

use super::{Part, RowShares};
use hemicube_spatial::whole;

/// The sum of a row's form factors at closure: 1 minus its shares; `None` for a row without hemicubes.
pub fn target_of(part: &Part, row: usize) -> Option<f64> {
    let (sums, hemicubes) = (part.sums.get(row)?, *part.hemicubes.get(row)?);
    let shares = part.shares.get(row)?;
    if hemicubes == 0 {
        return None;
    }
    let passed = part.passages.get(row).map_or(0.0, |passage| passage.passed);
    if passed > 0.0 {
        return Some((1.0 + passed - shares.lost()).max(0.0));
    }
    if *shares != RowShares::of_hemicubes(sums, hemicubes) {
        return Some((1.0 - shares.lost()).max(0.0));
    }
    let whole = u64::from(hemicubes) * super::HEMICUBE_WEIGHT;
    // In whole numbers: without rounding, a row that lost everything sums to 0.
    let left = whole.checked_sub(sums.escaped.checked_add(sums.blocked)?.checked_add(sums.unselected)?)?;
    Some(left as f64 / whole as f64)
}

/// The closure errors of some rows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClosureTally {
    max: f64,
    squares: f64,
    rows: u64,
}

impl ClosureTally {
    /// Adds a row with the sum `sum` and the closed sum `target`. Returns its error.
    pub fn add(&mut self, sum: f64, target: f64) -> f64 {
        let error = (sum - target).abs();
        self.max = self.max.max(error);
        self.squares += error * error;
        self.rows += 1;
        error
    }

    pub fn max(&self) -> f64 {
        self.max
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Largest error, sum of squares, rows.
    pub(crate) fn sums(&self) -> [f64; 3] {
        [self.max, self.squares, self.rows as f64]
    }

    /// The inverse of [`Self::sums`].
    pub(crate) fn from_sums([max, squares, rows]: [f64; 3]) -> Self {
        Self {
            max,
            squares,
            rows: whole::to_u64(rows),
        }
    }

    pub fn merge(&mut self, other: &Self) {
        self.max = self.max.max(other.max);
        self.squares += other.squares;
        self.rows += other.rows;
    }

    pub fn rms(&self) -> f64 {
        share_of(self.squares, self.rows as f64).sqrt()
    }
}

/// A share of something, 0 of nothing.
pub fn share_of(share: f64, whole: f64) -> f64 {
    if whole > 0.0 { share / whole } else { 0.0 }
}

#[allow(clippy::cast_possible_truncation, reason = "form factors are stored as f32")]
pub fn narrow(value: f64) -> f32 {
    value as f32
}
