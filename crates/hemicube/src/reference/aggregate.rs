//! Reference rows of patches that are several elements, from those of their elements.
//!
//! ```text
//! F_IJ = Σ_{i∈I} w_i Σ_{j∈J} F_ij        σ_IJ² = Σ_{i∈I} w_i² Σ_{j∈J} σ_ij²        w_i = A_i / Σ_{i∈I} A_i
//! ```
//!
//! Rays of different pairs are independent, and so are their errors. The part missed is taken for independent, too,
//! which takes less off a measured error than if it were all in one column.

use super::ReferenceRow;
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
