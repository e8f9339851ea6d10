//! Distance of a matrix from closure and reciprocity.
//!
//! ```text
//! closure      |Σⱼ Fᵢⱼ + escapedᵢ + blockedᵢ + unselectedᵢ − 1|                 largest and root mean square
//! reciprocity  ‖A F − (A F)ᵀ‖ / ‖A F‖, Frobenius, A diagonal; and the largest |Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ| / min(Aᵢ, Aⱼ)
//! ```
//!
//! `check` measures reciprocity over the entries of each row; here a pair missing in one row counts in both.

use super::Areas;
use super::exchange::Record;
use hemicube_store::Residuals;
use hemicube_store::closure::{ClosureTally, share_of, target_of};
use hemicube_store::{FactorSlice, Part};

/// Sums of the residuals.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    closure: ClosureTally,
    difference: f64,
    total: f64,
    worst: f64,
}

impl Tally {
    /// Adds a row of a part to the closure error. Returns the row's.
    pub(crate) fn row(&mut self, part: &Part, row: usize) -> f64 {
        let Some(target) = target_of(part, row) else { return 0.0 };
        let sum: f64 = part.row(row).1.iter().sum();
        self.closure.add(sum, target)
    }

    /// Adds F\[i, j\] and F\[j, i\]; each pair comes twice, once from either row.
    pub(crate) fn pair(&mut self, areas: &Areas, i: u32, j: u32, forward: f64, backward: f64) {
        let (Some(&area_i), Some(&area_j)) = (areas.share.get(i as usize), areas.share.get(j as usize)) else {
            return;
        };
        let (forward, backward) = (area_i * forward, area_j * backward);
        let difference = forward - backward;
        self.difference += difference * difference;
        self.total += forward * forward;
        let smaller = area_i.min(area_j);
        self.worst = self.worst.max(share_of(difference.abs(), smaller));
    }

    pub(crate) fn finish(&self) -> Residuals {
        Residuals {
            closure_max: self.closure.max(),
            closure_rms: self.closure.rms(),
            closure_rows: self.closure.rows(),
            reciprocity: share_of(self.difference, self.total).sqrt(),
            reciprocity_worst: self.worst,
        }
    }
}

/// The columns that a row has, or that have the row, ascending: column, F\[row, column\], F\[column, row\].
pub(crate) fn merge<'a>(
    row: (&'a [i32], FactorSlice<'a>),
    records: &'a [Record],
) -> impl Iterator<Item = (u32, Option<f64>, Option<f64>)> + 'a {
    let (columns, factors) = row;
    let mut forward = columns
        .iter()
        .map(|column| column.cast_unsigned())
        .zip(factors.iter())
        .peekable();
    let mut backward = records.iter().peekable();
    std::iter::from_fn(move || {
        let from_row = forward.peek().copied();
        let from_column = backward.peek().map(|record| (record.column, record.factor));
        let column = match (from_row, from_column) {
            (Some((one, _)), Some((other, _))) => one.min(other),
            (Some((one, _)), None) => one,
            (None, Some((other, _))) => other,
            (None, None) => return None,
        };
        let take = |found: Option<(u32, f64)>| found.filter(|&(other, _)| other == column).map(|(_, factor)| factor);
        let (there, back) = (take(from_row), take(from_column));
        if there.is_some() {
            forward.next();
        }
        if back.is_some() {
            backward.next();
        }
        Some((column, there, back))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_merge_has_every_column_once() {
        let record = |column, factor| Record { row: 0, column, factor };
        let records = [record(1, 0.1), record(4, 0.4), record(5, 0.5)];
        let merged: Vec<_> = merge((&[0, 4, 9], FactorSlice::Double(&[1.0, 2.0, 3.0])), &records).collect();
        let wanted = [
            (0, Some(1.0), None),
            (1, None, Some(0.1)),
            (4, Some(2.0), Some(0.4)),
            (5, None, Some(0.5)),
            (9, Some(3.0), None),
        ];
        assert_eq!(merged, wanted);
        assert_eq!(merge((&[], FactorSlice::default()), &[]).count(), 0);
    }

    #[test]
    fn what_is_not_reciprocal_shows() {
        let areas = Areas {
            share: vec![1.0, 0.25],
            root: vec![1.0, 0.5],
        };
        let tally = |back: f64| {
            let mut tally = Tally::default();
            tally.pair(&areas, 0, 1, 0.1, back);
            tally.pair(&areas, 1, 0, back, 0.1);
            tally.finish()
        };
        assert!(tally(0.4).reciprocity < 1e-7 && tally(0.4).reciprocity_worst < 1e-7);
        let off = tally(0.2);
        // 0.1 against 0.05, both ways, over the root of 0.1² + 0.05².
        assert!((off.reciprocity - (2.0f64 * 0.0025 / 0.0125).sqrt()).abs() < 1e-6);
        assert!((off.reciprocity_worst - 0.2).abs() < 1e-6);
    }
}
