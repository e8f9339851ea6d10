//! Reference rows of patches that are several elements, from those of their elements.
//!
//! ```text
//! F_IJ = Σ_{i∈I} w_i Σ_{j∈J} F_ij        σ_IJ² = Σ_{i∈I} w_i² Σ_{j∈J} σ_ij²        w_i = A_i / Σ_{i∈I} A_i
//! ```
//!
//! Rays of different pairs are independent, and so are their errors. The part missed is taken for independent, too,
//! which takes less off a measured error than if it were all in one column.
//!
//! **Samples.** A patch of many elements would take a reference row of each. Of m elements drawn in proportion to their
//! areas, one in each m-th of the area, the rows f as computed and r as traced differ by d = f − r. Rows of a patch
//! differ much from each other, these differences little, so that their mean tells E_I = F_I − (true F_I) with few of
//! them:
//!
//! ```text
//! E_IJ = Σ_k d_kJ / m        σ_IJ² = Σ_k (d_kJ − E_IJ)² / (m (m − 1))        d_kJ = Σ_{j∈J} (f_kj − r_kj)
//! ```
//!
//! σ holds the noise of rays and the spread of the elements; strata make it smaller than that. What F_I − E_I has in
//! place of the reference then rests on F_I being the mean of its elements' rows, as computed: a store is held to that
//! by checksums.

use super::random::Random;
use super::{EstimatedRow, ReferenceRow};
use crate::Grouping;
use hemicube_scene::InputPatch;
use std::collections::BTreeMap;

/// The rows of patches, in the order of their first elements among `rows`, from the rows of all their elements. `area`
/// is that of an element.
///
/// ```
/// use hemicube::reference::{ReferenceRow, rows_of_patches};
/// use hemicube::{Grouping, InputPatch, PatchKind};
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let patches = Patches::new(&scene, Subdivision::None)?;
/// let objects = Grouping::new(&scene, &patches, PatchKind::Object).ok_or("no groups")?;
///
/// // Two elements of one object, which see two elements of another.
/// let row = |emitter, values: [f64; 2]| ReferenceRow {
///     emitter,
///     columns: vec![2, 3],
///     values: values.to_vec(),
///     errors: vec![0.03, 0.04],
///     ..ReferenceRow::default()
/// };
/// let rows = rows_of_patches(&[row(0, [0.1, 0.2]), row(1, [0.2, 0.3])], &objects, |_| 1.0);
/// assert_eq!((rows.len(), rows[0].emitter, &rows[0].columns[..]), (1, 0, &[1][..]));
/// assert!((rows[0].values[0] - 0.4).abs() < 1e-15);
/// assert!((rows[0].errors[0] - 0.05 / 2f64.sqrt()).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn rows_of_patches(
    rows: &[ReferenceRow],
    grouping: &Grouping,
    area: impl Fn(InputPatch) -> f64,
) -> Vec<ReferenceRow> {
    let mut places: BTreeMap<u32, usize> = BTreeMap::new();
    let mut elements: Vec<(u32, Vec<&ReferenceRow>)> = Vec::new();
    for row in rows {
        let patch = grouping.patch_of(InputPatch(row.emitter)).0;
        let place = *places.entry(patch).or_insert(elements.len());
        if place == elements.len() {
            elements.push((patch, Vec::new()));
        }
        elements[place].1.push(row);
    }
    elements
        .into_iter()
        .map(|(patch, rows)| {
            let whole: f64 = rows.iter().map(|row| area(InputPatch(row.emitter))).sum();
            let mut sum = ReferenceRow {
                emitter: patch,
                ..ReferenceRow::default()
            };
            let mut entries: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
            let (mut of_shares, mut of_missed) = (0.0, 0.0);
            for row in rows {
                let weight = area(InputPatch(row.emitter)) / whole;
                for ((&column, &value), &error) in row.columns.iter().zip(&row.values).zip(&row.errors) {
                    let entry = entries.entry(grouping.patch_of(InputPatch(column)).0).or_default();
                    *entry = (entry.0 + weight * value, entry.1 + (weight * error).powi(2));
                }
                sum.escaped += weight * row.escaped;
                sum.blocked += weight * row.blocked;
                sum.passed += weight * row.passed;
                sum.cut_off += weight * row.cut_off;
                sum.missed += weight * row.missed;
                sum.missed_squared += weight * weight * row.missed_squared;
                of_shares += (weight * row.error_of_shares).powi(2);
                of_missed += (weight * row.error_of_missed).powi(2);
                sum.rays += row.rays;
                sum.cut_short |= row.cut_short;
            }
            (sum.error_of_shares, sum.error_of_missed) = (of_shares.sqrt(), of_missed.sqrt());
            for (column, (value, squared)) in entries {
                sum.columns.push(column);
                sum.values.push(value);
                sum.errors.push(squared.sqrt());
            }
            sum
        })
        .collect()
}

/// Draws `most` of a patch's `elements`, or takes all where there are no more: one in each `most`-th of the area, in
/// their order, by the random numbers of `seed`. `area` is that of an element. An element larger than its part may come
/// several times.
pub fn draw_elements(
    elements: &[InputPatch],
    most: usize,
    area: impl Fn(InputPatch) -> f64,
    seed: u64,
) -> Vec<InputPatch> {
    if elements.len() <= most {
        return elements.to_vec();
    }
    let mut ends = Vec::with_capacity(elements.len());
    let mut whole = 0.0;
    for &element in elements {
        whole += area(element);
        ends.push(whole);
    }
    let first = elements.first().map_or(0, |element| element.0);
    let mut random = Random::of(&[seed, first.into()]);
    (0..most)
        .map(|k| {
            let at = (k as f64 + random.unit()) / most as f64 * whole;
            elements[ends.partition_point(|&end| end <= at).min(elements.len() - 1)]
        })
        .collect()
}

/// The reference row of a patch from those of a sample of its elements: `drawn` as computed and as traced, in pairs.
/// `stored` is the patch's row. What escapes is such that the row closes as the elements' rows do on average.
///
/// ```
/// use hemicube::reference::{EstimatedRow, ReferenceRow, row_of_sample};
/// use hemicube::{Grouping, InputPatch, PatchKind};
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let patches = Patches::new(&scene, Subdivision::None)?;
/// let objects = Grouping::new(&scene, &patches, PatchKind::Object).ok_or("no groups")?;
///
/// // Rows far apart, each computed 0.01 too large and traced with some noise.
/// let row = |value: f64| (
///     EstimatedRow { emitter: InputPatch(0), columns: vec![2], values: vec![value] },
///     ReferenceRow { columns: vec![2], values: vec![value - 0.01], ..ReferenceRow::default() },
/// );
/// let drawn = [row(0.1), row(0.5), row(0.3)];
/// let stored = EstimatedRow { emitter: InputPatch(0), columns: vec![1], values: vec![0.29] };
/// let found = row_of_sample(&stored, &drawn, &objects);
/// assert!((found.values[0] - 0.28).abs() < 1e-12 && found.errors[0] < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn row_of_sample(
    stored: &EstimatedRow,
    drawn: &[(EstimatedRow, ReferenceRow)],
    grouping: &Grouping,
) -> ReferenceRow {
    let count = drawn.len().max(1) as f64;
    let mut found = ReferenceRow {
        emitter: stored.emitter.0,
        ..ReferenceRow::default()
    };
    // By patch: Σ d and Σ d² over the elements.
    let mut differences: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    let (mut closure, mut shares, mut of_missed) = (0.0, 0.0, 0.0);
    for (computed, traced) in drawn {
        let mut own: BTreeMap<u32, f64> = BTreeMap::new();
        let mut add = |columns: &[u32], values: &[f64], sign: f64| {
            for (&column, &value) in columns.iter().zip(values) {
                *own.entry(grouping.patch_of(InputPatch(column)).0).or_default() += sign * value;
            }
        };
        add(&computed.columns, &computed.values, 1.0);
        add(&traced.columns, &traced.values, -1.0);
        for (patch, difference) in own {
            let sums = differences.entry(patch).or_default();
            *sums = (sums.0 + difference, sums.1 + difference * difference);
        }
        closure += traced.closure() / count;
        found.blocked += traced.blocked / count;
        found.missed += traced.missed / count;
        found.missed_squared += traced.missed_squared / (count * count);
        shares += (traced.error_of_shares / count).powi(2);
        of_missed += (traced.error_of_missed / count).powi(2);
        found.rays += traced.rays;
        found.cut_short |= traced.cut_short;
    }
    let mut entries: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for (&column, &value) in stored.columns.iter().zip(&stored.values) {
        entries.entry(column).or_default().0 += value;
    }
    for (patch, (sum, squares)) in differences {
        let entry = entries.entry(patch).or_default();
        entry.0 -= sum / count;
        entry.1 = (squares - sum * sum / count).max(0.0) / (count * (count - 1.0).max(1.0));
    }
    for (column, (value, variance)) in entries {
        found.columns.push(column);
        found.values.push(value);
        found.errors.push(variance.sqrt());
    }
    (found.error_of_shares, found.error_of_missed) = (shares.sqrt(), of_missed.sqrt());
    found.escaped = closure - found.blocked - found.values.iter().sum::<f64>();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_drawn_by_their_areas_one_in_each_part() {
        let elements: Vec<InputPatch> = (0..100).map(InputPatch).collect();
        let area = |element: InputPatch| if element.0 == 50 { 99.0 } else { 1.0 };
        assert_eq!(draw_elements(&elements, 100, area, 7), elements);
        let drawn = draw_elements(&elements, 10, area, 7);
        assert_eq!(drawn.len(), 10);
        // Half of the area is one element's.
        let large = drawn.iter().filter(|element| element.0 == 50).count();
        assert!((4..=6).contains(&large), "{drawn:?}");
        assert!(drawn.is_sorted_by_key(|element| element.0));
        assert_ne!(drawn, draw_elements(&elements, 10, area, 8));
    }
}
