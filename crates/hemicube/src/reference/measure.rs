//! Error of estimated rows against the reference, with intervals.
//!
//! The measured Σ d² holds the reference's own Σ σ² on top of the true one, so it is subtracted. The difference has the
//! standard deviation √(Σ 4 d² σ² + 2 σ⁴). Drawing the rows again with repetition (the bootstrap, Efron 1979) gives the
//! interval of the whole matrix's figure.

use super::ReferenceRow;
use super::random::Random;
use crate::analysis::compare::{OverRows, WorstEntry};
use crate::store::Part;
use hemicube_scene::InputPatch;
use serde::Serialize;
use std::collections::BTreeMap;

/// A row to be compared with the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedRow {
    /// The emitter.
    pub emitter: InputPatch,
    /// The patches with entries, ascending.
    pub columns: Vec<u32>,
    /// Their form factors.
    pub values: Vec<f64>,
}

impl EstimatedRow {
    /// The rows of a part.
    pub fn of_part(part: &Part) -> Vec<Self> {
        part.rows
            .iter()
            .enumerate()
            .map(|(place, &row)| {
                let (columns, values) = part.row(place);
                Self {
                    emitter: InputPatch(row),
                    columns: columns.iter().map(|&column| column.cast_unsigned()).collect(),
                    values: values.iter().collect(),
                }
            })
            .collect()
    }
}

/// An interval of about 95 % probability.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Distance of estimated rows from the reference.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    /// Number of rows in both.
    pub rows: u64,
    /// Number of rows of the reference without an estimate.
    pub rows_without_estimate: u64,
    /// Number of estimated rows not in the reference.
    pub rows_without_reference: u64,
    /// √(Σ d²) / √(Σ b²), the reference's own noise subtracted.
    pub relative_frobenius: f64,
    /// `relative_frobenius` with the reference's noise in it.
    pub relative_frobenius_with_noise: f64,
    /// The reference's own √(Σ σ²) / √(Σ b²).
    pub reference_noise: f64,
    /// Interval of `relative_frobenius` of these rows, by the reference's noise.
    pub interval_of_rows: Interval,
    /// Interval of `relative_frobenius` of the matrix from which these rows were drawn.
    pub interval_of_matrix: Interval,
    /// ‖dᵢ‖₂ / ‖bᵢ‖₂ over the rows, noise included.
    pub row_error: OverRows,
    /// Σⱼ |dᵢⱼ| / Σⱼ bᵢⱼ over the rows, noise included.
    pub row_l1: OverRows,
    /// Σ b where the estimate has nothing, over Σ b.
    pub missed_mass: f64,
    /// Σ a where the reference has nothing, over Σ b.
    pub spurious_mass: f64,
    /// |Σⱼ aᵢⱼ − Σⱼ bᵢⱼ| over the rows, noise included, with the reference's likely missing part in Σⱼ bᵢⱼ.
    pub row_sum_error: OverRows,
    /// The reference's own standard error of Σⱼ bᵢⱼ over the rows.
    pub row_sum_noise: OverRows,
    /// The reference's likely missing part of Σⱼ bᵢⱼ, over the rows.
    pub reference_missed: OverRows,
    /// The entry of the largest difference, if any.
    pub worst_entry: Option<WorstEntry>,
}

/// Sums of one row.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Σ d², with the reference's expected Σ σ² in it.
    difference: f64,
    noise: f64,
    norm: f64,
}

/// Compares `estimated` rows with reference rows, matched by emitter.
pub fn errors_against(reference: &[ReferenceRow], estimated: &[EstimatedRow]) -> Measured {
    let by_emitter: BTreeMap<u32, &EstimatedRow> = estimated.iter().map(|row| (row.emitter.0, row)).collect();
    let mut measured = Measured::default();
    let mut rows = Vec::new();
    let (mut row_error, mut row_l1, mut row_sum_error) = (Vec::new(), Vec::new(), Vec::new());
    let (mut row_sum_noise, mut reference_missed) = (Vec::new(), Vec::new());
    let (mut mass, mut missed, mut spurious, mut variance) = (0.0, 0.0, 0.0, 0.0);
    let mut worst = 0.0;
    for row in reference {
        let Some(estimate) = by_emitter.get(&row.emitter) else {
            measured.rows_without_estimate += 1;
            continue;
        };
        measured.rows += 1;
        let mut sums = Sums::default();
        // Two empty rows agree, whatever both may have missed.
        if !(row.values.is_empty() && estimate.values.is_empty()) {
            sums.noise = row.squared_error();
            sums.norm = row.squared_norm();
            variance += 2.0 * row.missed_squared.powi(2);
        }
        let mut l1 = 0.0;
        for (j, a, b, error) in merged(estimate, row) {
            let d = a - b;
            sums.difference += d * d;
            variance += 4.0 * d * d * error * error + 2.0 * error.powi(4);
            l1 += d.abs();
            if a == 0.0 {
                missed += b;
            }
            if b == 0.0 {
                spurious += a;
            }
            // NaN must show.
            if d.abs() > worst || d.is_nan() {
                worst = d.abs();
                measured.worst_entry = Some(WorstEntry {
                    i: row.emitter,
                    j,
                    a,
                    b,
                });
            }
        }
        let (sum_a, sum_b): (f64, f64) = (estimate.values.iter().sum(), row.values.iter().sum());
        mass += sum_b;
        row_sum_error.push((sum_a - row.sum()).abs());
        row_sum_noise.push(row.sum_noise());
        reference_missed.push(row.missed);
        row_error.push(over(sums.difference.sqrt(), sums.norm.sqrt()));
        row_l1.push(over(l1, sum_b));
        rows.push(sums);
    }
    measured.rows_without_reference = (estimated.len() as u64).saturating_sub(measured.rows);
    let difference: f64 = rows.iter().map(|r| r.difference).sum();
    let noise: f64 = rows.iter().map(|r| r.noise).sum();
    let norm: f64 = rows.iter().map(|r| r.norm).sum();
    let relative = |squared: f64| over(root(squared), norm.sqrt());
    measured.relative_frobenius = relative(difference - noise);
    measured.relative_frobenius_with_noise = relative(difference);
    measured.reference_noise = relative(noise);
    let margin = 1.96 * variance.sqrt();
    measured.interval_of_rows = Interval {
        low: relative(difference - noise - margin),
        high: relative(difference - noise + margin),
    };
    let drawn = redrawn(&rows);
    measured.interval_of_matrix = Interval {
        low: lesser(drawn.low, measured.interval_of_rows.low),
        high: -lesser(-drawn.high, -measured.interval_of_rows.high),
    };
    measured.row_error = over_rows(row_error);
    measured.row_l1 = over_rows(row_l1);
    measured.row_sum_error = over_rows(row_sum_error);
    measured.row_sum_noise = over_rows(row_sum_noise);
    measured.reference_missed = over_rows(reference_missed);
    measured.missed_mass = over(missed, mass);
    measured.spurious_mass = over(spurious, mass);
    measured
}

/// The lesser of two; NaN if either is NaN.
fn lesser(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) }
}

/// The square root, of negative numbers 0; NaN of NaN.
fn root(squared: f64) -> f64 {
    if squared < 0.0 { 0.0 } else { squared.sqrt() }
}

/// The ratio, with 0 / 0 = 0; infinite for another part over 0.
fn over(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole.abs() }
}

/// The middle 95 % of the relative error of as many rows drawn from `rows` with repetition.
fn redrawn(rows: &[Sums]) -> Interval {
    const DRAWS: usize = 1000;
    if rows.is_empty() {
        return Interval::default();
    }
    let mut random = Random::of(&[rows.len() as u64]);
    let mut errors: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let (mut difference, mut norm) = (0.0, 0.0);
            for _ in rows {
                let place = (u128::from(random.next()) * rows.len() as u128) >> 64;
                let row = usize::try_from(place).map_or(Sums::default(), |place| rows[place]);
                difference += row.difference - row.noise;
                norm += row.norm;
            }
            over(root(difference), norm.sqrt())
        })
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    Interval {
        low: errors[DRAWS / 40],
        high: errors[DRAWS - 1 - DRAWS / 40],
    }
}

fn over_rows(mut values: Vec<f64>) -> OverRows {
    values.sort_unstable_by(f64::total_cmp);
    let at = |percent: usize| {
        let rank = (values.len() * percent).div_ceil(100);
        values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
    };
    OverRows {
        median: at(50),
        percentile_90: at(90),
        max: at(100),
        mean: values.iter().sum::<f64>() / values.len().max(1) as f64,
    }
}

/// The entries of both side by side: column, estimate, reference, the reference's error.
fn merged(estimate: &EstimatedRow, row: &ReferenceRow) -> impl Iterator<Item = (u32, f64, f64, f64)> {
    let mut entries: BTreeMap<u32, (f64, f64, f64)> = BTreeMap::new();
    for ((&column, &value), &error) in row.columns.iter().zip(&row.values).zip(&row.errors) {
        entries.insert(column, (0.0, value, error));
    }
    for (&column, &value) in estimate.columns.iter().zip(&estimate.values) {
        entries.entry(column).or_default().0 += value;
    }
    entries.into_iter().map(|(column, (a, b, error))| (column, a, b, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> Vec<ReferenceRow> {
        vec![
            ReferenceRow {
                emitter: 3,
                columns: vec![1, 2],
                values: vec![0.3, 0.4],
                errors: vec![0.0, 0.0],
                ..ReferenceRow::default()
            },
            ReferenceRow {
                emitter: 5,
                ..ReferenceRow::default()
            },
        ]
    }

    #[test]
    fn what_the_reference_cannot_see_is_not_held_against_a_row() {
        // Nothing met in 65,536 rays: a factor of 10⁻⁶ may be there or not, one of a thousandth may not.
        let reference = [ReferenceRow {
            emitter: 3,
            missed_squared: 65_536f64.powi(-2),
            ..ReferenceRow::default()
        }];
        let of = |columns: &[u32], values: &[f64]| {
            let row = EstimatedRow {
                emitter: InputPatch(3),
                columns: columns.to_vec(),
                values: values.to_vec(),
            };
            errors_against(&reference, &[row]).interval_of_rows
        };
        let tiny = of(&[1], &[1e-6]);
        assert!(tiny.low == 0.0 && tiny.high == f64::INFINITY, "{tiny:?}");
        assert_eq!(of(&[1], &[1e-3]).low, f64::INFINITY);
        assert_eq!(of(&[], &[]), Interval::default());
    }

    #[test]
    fn figures_of_a_small_row() {
        let row = |emitter, columns: &[u32], values: &[f64]| EstimatedRow {
            emitter: InputPatch(emitter),
            columns: columns.to_vec(),
            values: values.to_vec(),
        };
        let measured = errors_against(&reference(), &[row(3, &[2, 7], &[0.4, 0.4]), row(9, &[], &[])]);
        assert_eq!(
            (
                measured.rows,
                measured.rows_without_estimate,
                measured.rows_without_reference
            ),
            (1, 1, 1)
        );
        assert!((measured.relative_frobenius - 1.0).abs() < 1e-12);
        assert!((measured.row_l1.max - 1.0).abs() < 1e-12);
        assert!((measured.missed_mass - 3.0 / 7.0).abs() < 1e-12);
        assert!((measured.spurious_mass - 4.0 / 7.0).abs() < 1e-12);
        assert!((measured.row_sum_error.max - 0.1).abs() < 1e-12);
        assert_eq!(measured.worst_entry.map(|w| (w.i, w.j)), Some((3, 7)));

        let same = errors_against(&reference(), &[row(3, &[1, 2], &[0.3, 0.4])]);
        assert_eq!(same.relative_frobenius, 0.0);
        assert_eq!(same.worst_entry, None);
        let broken = errors_against(&reference(), &[row(3, &[1, 2], &[f64::NAN, 0.4])]);
        assert!(broken.relative_frobenius.is_nan() && broken.interval_of_matrix.high.is_nan());
        assert_eq!(broken.worst_entry.map(|w| w.j), Some(1));
    }

    #[test]
    fn the_reference_s_own_noise_is_taken_off() {
        let mut random = Random::of(&[1]);
        // Entries of 1 with an error of 0.1, the estimate off by 0.05: together 0.11.
        let count = 4000u32;
        let mut deviation = || ((0..12).map(|_| random.unit()).sum::<f64>() - 6.0) * 0.1;
        let row = ReferenceRow {
            columns: (0..count).collect(),
            values: (0..count).map(|_| 1.0 + deviation()).collect(),
            errors: vec![0.1; count as usize],
            ..ReferenceRow::default()
        };
        let estimate = EstimatedRow {
            emitter: InputPatch(0),
            columns: row.columns.clone(),
            values: (0..count).map(|j| if j % 2 == 0 { 1.05 } else { 0.95 }).collect(),
        };
        let measured = errors_against(&[row], &[estimate]);
        assert!(measured.relative_frobenius_with_noise > 0.1);
        let Interval { low, high } = measured.interval_of_rows;
        assert!(low < 0.05 && 0.05 < high && high - low < 0.02, "{measured:?}");
    }
}
