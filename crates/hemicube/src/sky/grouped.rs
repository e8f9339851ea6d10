//! Sky rows of patches that are several elements.
//!
//! ```text
//! f_Ic = Σ_{i∈I} A_i f_ic / Σ_{i∈I} A_i        weights w_Ic = round(f_Ic · n_I · 2³¹), n_I the elements' hemicubes
//! ```
//!
//! Rounding is by half a unit of 2⁻³¹ / n_I of the hemisphere; files keep integer weights with their sums. Elements
//! without a hemicube have a negligible area and are left out, as in the rows of the matrix.

use super::SkyRow;
use crate::Grouping;
use crate::Model;
use crate::accuracy::grain::Grain;
use crate::backend::WHOLE;
use hemicube_scene::InputPatch;
use hemicube_spatial::whole;
use std::collections::BTreeMap;

/// Sums over the elements of a patch.
#[derive(Clone, Debug, Default)]
struct Sums {
    area: f64,
    columns: BTreeMap<u32, f64>,
    blocked: f64,
    hemicubes: u32,
    change: f64,
    change_below: f64,
}

/// The rows of a grouping's patches: means of their elements' `rows`, by area; changes are the means of theirs, at
/// least those of the mean. O(entries).
///
/// ```
/// use hemicube::backend::WHOLE;
/// use hemicube::sky::{SkyRow, sky_of_groups};
/// use hemicube::{Grouping, PatchKind};
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let patches = Patches::new(&scene, Subdivision::None)?;
/// let objects = Grouping::new(&scene, &patches, PatchKind::Object).ok_or("no groups")?;
/// let half = u64::from(WHOLE) / 2;
/// let row = SkyRow { columns: vec![(7, half)], escaped: half, hemicubes: 1, ..SkyRow::default() };
/// let areas: Vec<f64> = patches.iter().map(|element| patches.area(element)).collect();
/// let rows = sky_of_groups(&vec![row; patches.len()], &objects, &areas);
/// assert_eq!(rows.len(), objects.len());
/// assert!(rows.iter().all(|row| row.sky_view_factor() == 0.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Panics
/// When there are fewer rows or areas than elements.
pub fn sky_of_groups(rows: &[SkyRow], grouping: &Grouping, areas: &[f64]) -> Vec<SkyRow> {
    let mut sums = vec![Sums::default(); grouping.len()];
    for (element, &patch) in grouping.patches().iter().enumerate() {
        let (row, area, own) = (&rows[element], areas[element], &mut sums[patch as usize]);
        if row.hemicubes == 0 {
            continue;
        }
        let unit = area / row.whole() as f64;
        own.area += area;
        own.blocked += unit * row.blocked as f64;
        own.change += area * row.change;
        own.change_below += area * row.change_below;
        own.hemicubes = own.hemicubes.saturating_add(row.hemicubes);
        for &(column, weight) in &row.columns {
            *own.columns.entry(column).or_default() += unit * row.scale() * weight as f64;
        }
    }
    sums.into_iter().map(Sums::row).collect()
}

impl Sums {
    fn row(self) -> SkyRow {
        let whole = u64::from(self.hemicubes) * u64::from(WHOLE);
        if whole == 0 {
            return SkyRow {
                change: f64::NAN,
                change_below: f64::NAN,
                ..SkyRow::default()
            };
        }
        let units = |sum: f64| whole::to_u64((sum / self.area * whole as f64).round());
        let mut left = whole;
        let mut columns = Vec::with_capacity(self.columns.len());
        for (&column, &sum) in &self.columns {
            // Rounded up in every column, they may come to more than the whole.
            let weight = units(sum).min(left);
            left -= weight;
            if weight > 0 {
                columns.push((column, weight));
            }
        }
        SkyRow {
            columns,
            escaped: whole - left,
            blocked: units(self.blocked).min(left),
            hemicubes: self.hemicubes,
            change: self.change / self.area,
            change_below: self.change_below / self.area,
            refined: None,
        }
    }
}

/// n of the n² hemicubes of an element, at least `least`, more for large elements with much on them: as in rows of a
/// matrix by any correction but pixel sums. Depends on the scene alone.
pub fn hemicubes_along(model: &Model, element: InputPatch, least: u32) -> u32 {
    Grain::of(model.geometry()).per_edge(model, element).max(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PatchKind;
    use hemicube_scene::{Patches, Subdivision, generate};

    #[test]
    fn rows_of_all_that_escapes_are_a_whole_and_without_a_hemicube_nothing() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::Split(3)).unwrap();
        let grouping = Grouping::new(&scene, &patches, PatchKind::Object).unwrap();
        let areas: Vec<f64> = patches.iter().map(|element| patches.area(element)).collect();
        let whole = u64::from(WHOLE);
        let rows: Vec<SkyRow> = (0..patches.len() as u64)
            .map(|k| SkyRow {
                columns: vec![(0, k * 1001), (3, whole - k * 1001)],
                escaped: whole,
                hemicubes: 1,
                ..SkyRow::default()
            })
            .collect();
        for row in sky_of_groups(&rows, &grouping, &areas) {
            assert!(row.escaped.abs_diff(row.whole()) <= 1, "{row:?}");
            assert_eq!(row.columns.iter().map(|(_, weight)| weight).sum::<u64>(), row.escaped);
        }
        let none = sky_of_groups(&vec![SkyRow::default(); rows.len()], &grouping, &areas);
        assert!(
            none.iter()
                .all(|row| row.hemicubes == 0 && row.sky_view_factor().is_nan())
        );
    }
}
