//! The norm and the error of a matrix of patches that are several elements, from rows of some elements.
//!
//! With w_i = A_i / A_I and f_i an element's form factors, columns added up by patch, i drawn in proportion to w, and
//! k, among the others, too,
//!
//! ```text
//! |Σ_{i∈I} w_i f_i|² = Σ_i w_i² |f_i|² + Σ_{i≠k} w_i w_k f_i·f_k = E_i [ w_i |f_i|² + (1 − w_i) f_i·f_k ]
//! ```
//!
//! is the squared norm of a patch's row. Of the errors e_i of its elements' rows, those that are independent leave
//! E_i w_i |e_i|², 1/n of |e|² with n equal elements; errors that all elements share, as neighbours look past the same
//! edges, leave |e|² (Jensen's bound). [`share_of_elements`] stands between the two. Patches are drawn in turn.

use super::Row;
use crate::Grouping;
use crate::sampling::splitmix;
use crate::store::ERRORS;
use hemicube_scene::{InputPatch, Patches};
use std::collections::BTreeMap;

/// Elements drawn: `rows` and `twins`, of one patch each pair, pairs of a patch side by side; and w of each row. The
/// twin of a patch's only element is itself.
#[derive(Clone, Debug, Default)]
pub(super) struct Draw {
    pub(super) rows: Vec<InputPatch>,
    pub(super) twins: Vec<InputPatch>,
    pub(super) weights: Vec<f64>,
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
        // A place in proportion to the area, but not `without`.
        let mut draw = |own: &[(InputPatch, f64)], without: Option<usize>| {
            let end = |place: usize| own.get(place).map_or(0.0, |(_, area)| *area);
            let begin = |place: usize| place.checked_sub(1).map_or(0.0, end);
            let (skipped, from) =
                without.map_or((0.0, f64::INFINITY), |place| (end(place) - begin(place), begin(place)));
            let at = splitmix::unit(splitmix::next(&mut state)) * (end(own.len() - 1) - skipped);
            let at = if at < from { at } else { at + skipped };
            own.partition_point(|&(_, area)| area <= at).min(own.len() - 1)
        };
        let mut found = Self::default();
        let all = order.len();
        for (place, patch) in order.iter().enumerate() {
            // count / all of each, spread evenly where there are more patches than draws.
            for _ in (place * count / all)..((place + 1) * count / all) {
                let own = &elements[patch];
                let row = draw(own, None);
                let twin = if own.len() > 1 { draw(own, Some(row)) } else { row };
                found.rows.push(own[row].0);
                found.twins.push(own[twin].0);
                let whole = own.last().map_or(1.0, |(_, area)| *area);
                found.weights.push(patches.area(own[row].0) / whole);
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
fn product(a: &Row, b: &Row) -> f64 {
    let other: BTreeMap<u32, f64> = b.iter().copied().collect();
    a.iter()
        .map(|(column, factor)| factor * other.get(column).copied().unwrap_or(0.0))
        .sum()
}

/// The part of an element's squared error that its patch has, √w. A choice, the geometric mean of independent errors,
/// w, and of shared ones, 1: with w, patches whose elements look past the same edges would be farther off than asked
/// for; with 1, of a hundred equal elements a tenth of the squared error would be asked.
pub(super) fn share_of_elements(weight: f64) -> f64 {
    weight.clamp(0.0, 1.0).sqrt()
}

/// w |a|² + (1 − w) a·b, of which |Σ w a|² is the mean.
pub(super) fn of_patch(weight: f64, a: &Row, b: &Row) -> f64 {
    let square: f64 = a.iter().map(|(_, value)| value * value).sum();
    weight * square + (1.0 - weight) * product(a, b)
}

/// The mean of |F_I|² from a value each pair, less three standard errors, but no less than a quarter of the mean.
pub(super) fn mean_norm(values: &[f64]) -> f64 {
    let (mean, error) = mean_and_error(values);
    (mean - ERRORS * error).max(0.25 * mean)
}

/// The mean, and its standard error.
pub(super) fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count * (count - 1.0).max(1.0));
    (mean, variance.sqrt())
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
            assert_ne!(row, twin);
            counts[grouping.patch_of(*row).0 as usize] += 1;
        }
        assert!(counts.iter().all(|count| (28..=29).contains(count)), "{counts:?}");
        assert!(draw.weights.iter().all(|weight| (0.0..1.0).contains(weight)));
        // Fewer draws than patches: some of them, all over the order of work.
        let faces = Grouping::new(&scene, &patches, PatchKind::Face).unwrap();
        let draw = Draw::new(&faces, &patches, &emitters, 5, 1);
        assert_eq!(draw.rows.len(), 5);
        assert!(2 * draw.rows[4].0 as usize > patches.len());
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

    /// Over all pairs of three elements, the mean is the square of the weighted sum.
    #[test]
    fn pairs_tell_the_square_of_the_sum() {
        let weights = [0.5, 0.3, 0.2];
        let errors: [Row; 3] = [vec![(0, 0.2), (1, -0.1)], vec![(0, 0.1), (2, 0.3)], vec![(1, 0.4)]];
        let mut mean = 0.0;
        for (i, a) in errors.iter().enumerate() {
            for (k, b) in errors.iter().enumerate().filter(|(k, _)| *k != i) {
                mean += weights[i] * weights[k] / (1.0 - weights[i]) * of_patch(weights[i], a, b);
            }
        }
        let sum = |column: u32| -> f64 {
            let of = |row: &Row| {
                row.iter()
                    .find(|(found, _)| *found == column)
                    .map_or(0.0, |(_, value)| *value)
            };
            errors.iter().zip(weights).map(|(row, weight)| weight * of(row)).sum()
        };
        let square: f64 = (0..3).map(|column| sum(column).powi(2)).sum();
        assert!((mean / square - 1.0).abs() < 1e-12, "{mean} {square}");
    }
}
