//! The error of a matrix of patches that are several elements, from rows of some elements.
//!
//! With w_i = A_i / A_I, e_i the errors of an element's row and E_I those of its patch's, columns added up by patch in
//! both,
//!
//! ```text
//! E_I = Σ_{i∈I} w_i e_i        Σ_I |E_I|² ≤ Σ_I Σ_{i∈I} w_i |e_i|²        (Jensen)
//! F_I = Σ_{i∈I} w_i f_i        Σ_I |F_I|² = Σ_I Σ_{i,k∈I} w_i w_k f_i·f_k
//! ```
//!
//! With independent errors |E_I| would be |e_i| / √n for n equal elements, and with errors that all elements share, |e_i|:
//! neighbours look past the same edges, so the bound takes them for shared. What evens out is counted only among the
//! columns of a row, where it is measured: random parts of m equal columns fall by √m beside their sum, and parts that point
//! one way do not.
//!
//! Patches are drawn in turn, and in each an element i in proportion to its area, for |e_i|² and f_i, and another one k,
//! independently, for f_k: then E |e_i|² is the bound's inner sum, and E f_i·f_k is |F_I|².

use super::Row;
use crate::Grouping;
use crate::sampling::splitmix;
use hemicube_scene::{InputPatch, Patches};
use std::collections::BTreeMap;

/// Elements drawn: `rows` and `twins`, of one patch each pair, pairs of a patch side by side.
#[derive(Clone, Debug, Default)]
pub(super) struct Draw {
    pub(super) rows: Vec<InputPatch>,
    pub(super) twins: Vec<InputPatch>,
}

impl Draw {
    /// Draws `count` pairs among `emitters`, as many from each patch as from any other, but for one. O(emitters).
    pub(super) fn new(
        grouping: &Grouping,
        patches: &Patches,
        emitters: &[InputPatch],
        count: usize,
        seed: u64,
    ) -> Self {
        // Areas up to and with each element, by patch; patches in the order of work.
        let mut order: Vec<u32> = Vec::new();
        let mut elements: BTreeMap<u32, Vec<(InputPatch, f64)>> = BTreeMap::new();
        for &emitter in emitters {
            let patch = grouping.patch_of(emitter).0;
            let own = elements.entry(patch).or_insert_with(|| {
                order.push(patch);
                Vec::new()
            });
            let before = own.last().map_or(0.0, |(_, area)| *area);
            own.push((emitter, before + patches.area(emitter)));
        }
        let mut state = seed;
        let mut draw = |own: &[(InputPatch, f64)]| {
            let whole = own.last().map_or(0.0, |(_, area)| *area);
            let at = splitmix::unit(splitmix::next(&mut state)) * whole;
            let place = own
                .partition_point(|&(_, area)| area <= at)
                .min(own.len().saturating_sub(1));
            own.get(place).map(|(element, _)| *element)
        };
        let mut found = Self::default();
        let (all, count) = (order.len(), count.max(order.len().min(count)));
        for (place, patch) in order.iter().enumerate() {
            // count / all of each, spread evenly where there are more patches than draws.
            for _ in (place * count / all)..((place + 1) * count / all) {
                let own = &elements[patch];
                if let (Some(row), Some(twin)) = (draw(own), draw(own)) {
                    found.rows.push(row);
                    found.twins.push(twin);
                }
            }
        }
        found
    }
}

/// The row with its columns added up by patch.
pub(super) fn added_up(row: &Row, grouping: &Grouping) -> Row {
    let mut sums: BTreeMap<u32, f64> = BTreeMap::new();
    for &(column, factor) in row {
        *sums.entry(grouping.patch_of(InputPatch(column)).0).or_default() += factor;
    }
    sums.into_iter().collect()
}

/// Σ a b over the common columns of two rows with ascending columns.
pub(super) fn product(a: &Row, b: &Row) -> f64 {
    let other: BTreeMap<u32, f64> = b.iter().copied().collect();
    a.iter()
        .map(|(column, factor)| factor * other.get(column).copied().unwrap_or(0.0))
        .sum()
}

/// The mean of |F_I|² from products of pairs, less 1.5 standard errors, but no less than a quarter of the mean: 0 where
/// rows have nothing.
pub(super) fn mean_norm(products: &[f64]) -> f64 {
    let count = products.len().max(1) as f64;
    let mean = products.iter().sum::<f64>() / count;
    let variance =
        products.iter().map(|product| (product - mean).powi(2)).sum::<f64>() / (count * (count - 1.0).max(1.0));
    (mean - super::SURE * variance.sqrt()).max(0.25 * mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PatchKind;
    use hemicube_scene::{Subdivision, generate};

    #[test]
    fn every_patch_is_drawn_as_often_as_any_other_and_elements_by_area() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::Split(4)).unwrap();
        let grouping = Grouping::new(&scene, &patches, PatchKind::Object).unwrap();
        let emitters: Vec<InputPatch> = patches.iter().collect();
        let draw = Draw::new(&grouping, &patches, &emitters, 256, 1);
        assert_eq!((draw.rows.len(), draw.twins.len()), (256, 256));
        let mut counts = vec![0; grouping.len()];
        for (row, twin) in draw.rows.iter().zip(&draw.twins) {
            assert_eq!(grouping.patch_of(*row), grouping.patch_of(*twin));
            counts[grouping.patch_of(*row).0 as usize] += 1;
        }
        assert!(counts.iter().all(|count| (28..=29).contains(count)), "{counts:?}");
        // Fewer draws than patches: some of them, all over the order of work.
        let faces = Grouping::new(&scene, &patches, PatchKind::Face).unwrap();
        let draw = Draw::new(&faces, &patches, &emitters, 5, 1);
        assert_eq!(draw.rows.len(), 5);
        assert!(draw.rows[4].0 > patches.len() as u32 / 2);
    }

    #[test]
    fn sums_and_products_of_rows() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::None).unwrap();
        let grouping = Grouping::new(&scene, &patches, PatchKind::Object).unwrap();
        let row: Row = vec![(0, 0.1), (1, 0.2), (4, 0.3)];
        let sums = added_up(&row, &grouping);
        let total: f64 = sums.iter().map(|(_, sum)| sum).sum();
        assert!(sums.len() == 2 && (total - 0.6).abs() < 1e-15, "{sums:?}");
        assert_eq!(product(&row, &vec![(1, 0.5), (3, 9.0)]), 0.1);
        assert_eq!(mean_norm(&[2.0, 2.0, 2.0]), 2.0);
        assert!(mean_norm(&[0.0, 8.0]) < 4.0 && mean_norm(&[0.0, 8.0]) >= 1.0);
        assert_eq!(mean_norm(&[]), 0.0);
    }
}
