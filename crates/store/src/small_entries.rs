//! Small form factors left out of a row while it is computed, and the rounding of the store's form.
//!
//! The rule of `balance` for rows on their own (`hemicube::analysis::balance`): entries below the least factor are left
//! out, and the others of the row share their sum in proportion. A row that would grow beyond the bound keeps all. Both
//! steps add to the row's expected error, as if independent of it: √(e² + Σ (F' − F)²).
//!
//! Mirrors and panes keep their entries as they are: what they hand on is then as before, and the others still sum to
//! what they did, whatever is left out.

use super::closure::{ClosureTally, narrow, share_of, target_of};
use super::{FactorSlice, FinishedRow, Form, Part, compact};
use hemicube_spatial::whole;
use serde::{Deserialize, Serialize};

/// Default bound on the scaling of a row; an entry is scaled by its square at most.
pub const MAX_SCALE: f64 = 1.1;

/// Changes of a row's entries.
#[derive(Clone, Copy, Debug)]
pub struct SmallEntryRule {
    /// Entries below are left out; 0 where the row would lose too much, and keeps all.
    pub least: f64,
    /// The others are multiplied by this.
    pub scale: f64,
}

impl Default for SmallEntryRule {
    fn default() -> Self {
        Self { least: 0.0, scale: 1.0 }
    }
}

impl SmallEntryRule {
    /// For a row with the sum `whole`, and `kept` without the entries below `least`.
    pub fn new(whole: f64, kept: f64, least: f64, max_scale: f64) -> Self {
        if kept * max_scale * max_scale < whole {
            Self::default()
        } else if kept == whole {
            Self { least, scale: 1.0 }
        } else {
            Self {
                least,
                scale: whole / kept,
            }
        }
    }

    pub fn keeps(self, factor: f64) -> bool {
        factor >= self.least
    }

    /// A form factor after the rule, unrounded; 0 if it is left out.
    pub fn of(self, factor: f64) -> f64 {
        if self.keeps(factor) { factor * self.scale } else { 0.0 }
    }
}

/// Sum of a row, and its sum without the entries below `least`.
pub fn sums(factors: FactorSlice<'_>, least: f64) -> (f64, f64) {
    factors.iter().fold((0.0, 0.0), |(whole, kept), factor| {
        (whole + factor, if factor >= least { kept + factor } else { kept })
    })
}

/// Effect of leaving out small form factors on the rows of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thinning {
    /// Smaller form factors were left out.
    pub min_factor: f64,
    /// Bound on the growth of a row: its entries grow by the square at most, or the row keeps all.
    pub max_scale: f64,
    /// Entries left out.
    pub entries_dropped: u64,
    /// Share of Σ Aᵢ Fᵢⱼ of the entries left out; the others of their rows have it now.
    pub mass_dropped: f64,
    /// Rows that kept entries below the least factor because they would have lost too much.
    pub rows_kept_whole: u64,
    /// Largest scaling factor of an entry.
    pub scale_max: f64,
    /// Largest |Σ F + escaped + blocked + unselected − 1| of a row, before.
    pub closure_max_before: f64,
    /// Root mean square of it over the rows, before.
    pub closure_rms_before: f64,
    /// Largest error, of the rows as stored.
    pub closure_max_after: f64,
    /// Root mean square, of the rows as stored.
    pub closure_rms_after: f64,
}

/// Change of a row.
#[derive(Clone, Copy, Debug)]
pub struct RowChange {
    /// Sum of the entries that may change, and of those that stay.
    whole: f64,
    stays: f64,
    dropped: f64,
    entries_dropped: u64,
    kept_whole: bool,
    scale: f64,
}

/// The rule by which entries of a row are stored.
#[derive(Clone, Copy, Debug)]
pub struct Keeping<'a> {
    /// Smaller entries are left out; 0: none.
    pub min_factor: f64,
    /// The others are rounded to this form.
    pub form: Form,
    /// By column, whether it is a mirror or a pane, whose entries stay as they are; empty without any.
    pub portals: &'a [bool],
}

impl Keeping<'_> {
    /// Returns whether rows change at all.
    pub fn changes(&self) -> bool {
        self.min_factor > 0.0 || self.form == Form::Compact
    }

    fn is_portal(&self, column: i32) -> bool {
        self.portals
            .get(column.cast_unsigned() as usize)
            .copied()
            .unwrap_or(false)
    }

    /// Sum of a row's entries that may change, and their sum without the small ones.
    fn sums(&self, row: &FinishedRow) -> (f64, f64) {
        if self.portals.is_empty() {
            return sums(row.factors.as_slice(), self.min_factor);
        }
        let entries = row.columns.iter().zip(&row.factors);
        let changing = entries.filter(|&(&column, _)| !self.is_portal(column));
        changing.fold((0.0, 0.0), |(whole, kept), (_, factor)| {
            (
                whole + factor,
                if factor >= self.min_factor { kept + factor } else { kept },
            )
        })
    }

    /// A form factor as stored.
    fn stored(&self, factor: f64) -> f64 {
        // The least of any part's codes, where some stand for more.
        let is_raised = self.form == Form::Compact && !self.portals.is_empty() && factor > 0.0;
        let least = if is_raised { compact::LEAST_RAISED } else { 0.0 };
        self.form.round(factor.max(least))
    }
}

/// Leaves small entries out of a row, and rounds the others. Updates the row's standard error of its norm.
pub fn keep(row: &mut FinishedRow, keeping: Keeping<'_>) -> RowChange {
    let min_factor = keeping.min_factor;
    let (whole, kept) = keeping.sums(row);
    let cut = if min_factor > 0.0 {
        SmallEntryRule::new(whole, kept, min_factor, MAX_SCALE)
    } else {
        SmallEntryRule::default()
    };
    let mut end = 0;
    let (mut squares, mut stays) = (0.0, 0.0);
    for place in 0..row.factors.len() {
        let (column, factor) = (row.columns[place], row.factors.at(place));
        let is_portal = keeping.is_portal(column);
        let stored = keeping.stored(if is_portal { factor } else { cut.of(factor) });
        squares += (stored - factor).powi(2);
        stays += if is_portal { factor } else { 0.0 };
        if is_portal || cut.keeps(factor) {
            row.columns[end] = column;
            row.factors.set(end, stored);
            end += 1;
        }
    }
    let entries_dropped = (row.factors.len() - end) as u64;
    row.columns.truncate(end);
    row.factors.truncate(end);
    // NaN stays NaN.
    if squares > 0.0 {
        let norm = &mut row.errors.norm;
        *norm = narrow((f64::from(*norm).powi(2) + squares).sqrt());
    }
    RowChange {
        whole,
        stays,
        dropped: if cut.least > 0.0 { whole - kept } else { 0.0 },
        entries_dropped,
        kept_whole: kept < whole && cut.least == 0.0,
        scale: cut.scale,
    }
}

/// Effect of leaving out small form factors on the rows of one part. A run's figures are added up from the parts', in
/// order, whoever computed them and when.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartThinning {
    entries_dropped: u64,
    rows_kept_whole: u64,
    scale_max: f64,
    /// Σ Aᵢ Fᵢⱼ over all entries, and over those left out.
    mass: f64,
    dropped: f64,
    before: ClosureTally,
    after: ClosureTally,
}

impl PartThinning {
    /// Length of [`Self::numbers`].
    pub(crate) const LENGTH: usize = 11;

    /// Adds a row of a part, in the order of work.
    #[doc(hidden)]
    pub fn add(&mut self, part: &Part, row: usize, area: f64, change: &RowChange) {
        self.mass += area * (change.whole + change.stays);
        self.dropped += area * change.dropped;
        self.entries_dropped += change.entries_dropped;
        self.rows_kept_whole += u64::from(change.kept_whole);
        self.scale_max = self.scale_max.max(change.scale);
        if let Some(target) = target_of(part, row) {
            self.before.add(change.whole + change.stays, target);
            let stored: f64 = part.row(row).1.iter().sum();
            self.after.add(stored, target);
        }
    }

    /// Adds another part, in the order of the parts.
    #[doc(hidden)]
    pub fn merge(&mut self, other: &Self) {
        self.mass += other.mass;
        self.dropped += other.dropped;
        self.entries_dropped += other.entries_dropped;
        self.rows_kept_whole += other.rows_kept_whole;
        self.scale_max = self.scale_max.max(other.scale_max);
        self.before.merge(&other.before);
        self.after.merge(&other.after);
    }

    /// What the summary says of all of them.
    #[doc(hidden)]
    pub fn finish(&self, min_factor: f64) -> Thinning {
        Thinning {
            min_factor,
            max_scale: MAX_SCALE,
            entries_dropped: self.entries_dropped,
            mass_dropped: share_of(self.dropped, self.mass),
            rows_kept_whole: self.rows_kept_whole,
            scale_max: self.scale_max,
            closure_max_before: self.before.max(),
            closure_rms_before: self.before.rms(),
            closure_max_after: self.after.max(),
            closure_rms_after: self.after.rms(),
        }
    }

    /// The record in a part's file. Numbers of entries and rows are exact: they are far below 2⁵³.
    pub(crate) fn numbers(&self) -> [f64; Self::LENGTH] {
        let ([a, b, c], [d, e, f]) = (self.before.sums(), self.after.sums());
        [
            self.entries_dropped as f64,
            self.rows_kept_whole as f64,
            self.scale_max,
            self.mass,
            self.dropped,
            a,
            b,
            c,
            d,
            e,
            f,
        ]
    }

    /// The inverse of [`Self::numbers`].
    pub(crate) fn from_numbers(numbers: [f64; Self::LENGTH]) -> Self {
        let [entries, kept, scale_max, mass, dropped, a, b, c, d, e, f] = numbers;
        Self {
            entries_dropped: whole::to_u64(entries),
            rows_kept_whole: whole::to_u64(kept),
            scale_max,
            mass,
            dropped,
            before: ClosureTally::from_sums([a, b, c]),
            after: ClosureTally::from_sums([d, e, f]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Precision, RowErrors};

    fn of(min_factor: f64, form: Form) -> Keeping<'static> {
        Keeping {
            min_factor,
            form,
            portals: &[],
        }
    }

    /// A row with these form factors in the columns 0, 2, 4…
    fn row_of(factors: &[f32], norm: f32) -> FinishedRow {
        FinishedRow {
            columns: (0..).step_by(2).take(factors.len()).collect(),
            factors: factors.to_vec().into(),
            errors: RowErrors {
                norm,
                ..RowErrors::default()
            },
            ..FinishedRow::new(0, Precision::Single)
        }
    }

    #[test]
    fn the_others_share_what_is_left_out() {
        let mut row = row_of(&[0.5, 0.01, 0.3, 0.02, 0.17], 0.3);
        let change = keep(&mut row, of(0.05, Form::Plain));
        assert_eq!(row.columns, [0, 4, 8]);
        let sum: f64 = row.factors.iter().sum();
        assert!((sum - 1.0).abs() < 1e-7 && (change.whole - 1.0).abs() < 1e-7);
        assert!((row.factors.at(0) / row.factors.at(1) - 5.0 / 3.0).abs() < 1e-6);
        assert_eq!((change.entries_dropped, change.kept_whole), (2, false));
        assert!((change.dropped - 0.03).abs() < 1e-8 && (change.scale - 1.0 / 0.97).abs() < 1e-7);
        let moved = [0.5, 0.3, 0.17].map(|factor| (factor / 0.97 - factor) * (factor / 0.97 - factor));
        let squares = 0.09 + moved.iter().sum::<f64>() + 0.01f64.powi(2) + 0.02f64.powi(2);
        assert!((f64::from(row.errors.norm) - squares.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn a_row_that_would_lose_too_much_keeps_all() {
        let mut row = row_of(&[0.5, 0.04, 0.04, 0.04, 0.04], f32::NAN);
        let change = keep(&mut row, of(0.05, Form::Plain));
        assert_eq!((row.factors.len(), change.kept_whole, change.dropped), (5, true, 0.0));
        assert!(row.errors.norm.is_nan());
    }

    #[test]
    fn nothing_changes_in_the_plain_form_without_a_least_factor() {
        let mut row = row_of(&[0.1, 1e-20, 0.7], 0.25);
        let before = row.clone();
        let change = keep(&mut row, of(0.0, Form::Plain));
        assert_eq!(row, before);
        assert!(!change.kept_whole && change.entries_dropped == 0);
    }

    /// Columns 0, 2, 4, 6: the second is a mirror.
    #[test]
    fn mirrors_keep_their_entries_and_what_they_hand_on() {
        let mut row = row_of(&[0.6, 0.01, 0.02, 3.0], 0.0);
        let portals = [false, false, true, false, false, false, true];
        let keeping = Keeping {
            min_factor: 0.05,
            form: Form::Plain,
            portals: &portals,
        };
        let change = keep(&mut row, keeping);
        assert_eq!(row.columns, [0, 2, 6]);
        assert!(
            (row.factors.at(0) - 0.62).abs() < 1e-7,
            "the others sum to what they did"
        );
        assert_eq!((row.factors.at(1), row.factors.at(2)), (f64::from(0.01f32), 3.0));
        assert_eq!(change.entries_dropped, 1);
    }

    #[test]
    fn rounding_is_in_the_expected_error() {
        let mut row = row_of(&[0.1, 0.2], 0.0);
        keep(&mut row, of(0.0, Form::Compact));
        assert!(row.factors != [0.1, 0.2][..]);
        let off = [0.1f32, 0.2].map(|factor| Form::Compact.round(factor.into()) - f64::from(factor));
        assert!((f64::from(row.errors.norm) - (off[0].powi(2) + off[1].powi(2)).sqrt()).abs() < 1e-10);
    }
}
