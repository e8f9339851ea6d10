//! Rows of large patches, on which much stands ([`crate::accuracy::grain`]).
//!
//! Most of such a row is nearer to the patch than its hemicubes are to each other: none of them sees it, or from afar
//! only. Their fractions, and prior variances of other rows, say nothing of it. So every pair whose form factor could
//! matter to the row is measured, with a few rays first; a tolerance then spends the rest of the row's steps on all of
//! them in proportion to their part in the error.
//!
//! To the matrix such a row hardly matters: its form factors are small, and the larger one of each pair is measured in
//! the other row. So rays are allotted by the row's own form factors.

use super::sums::NEXT;
use super::{Allowance, Refined, Refiner, STEPS_A_PAIR, smoothed};
use crate::accuracy::caster::Caster;
use crate::accuracy::error_model::{FRACTIONS_SHARE, NEAR_RAY, TREE_RAY, rays_for, variance_of_rays};
use crate::accuracy::row::Emitter;
use crate::visibility::shaft::RAYS;

/// Mean squared error of a fraction that the bound of steps left unmeasured, about: nearly that of even odds between 0
/// and 1, 1/12.
pub(super) const UNMEASURED: f64 = 1.0 / 12.0;

/// Steps of one ray down the tree, about.
const STEPS_A_RAY: f64 = 600.0;

/// The unoccluded form factor from which on pairs matter to the row: a part of Σ F² / Σ F over the seen pairs.
///
/// Other rows take a part of the permitted error. Pairs below that are each small and together much: the ground of a
/// city was 28 % off (`promises::large_patches`).
pub(super) fn least_factor(unoccluded: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = unoccluded.fold((0.0, 0.0), |(sum, squares), factor| {
        (sum + factor, squares + factor * factor)
    });
    if sum > 0.0 { NEXT * squares / sum } else { 0.0 }
}

impl Refiner<'_> {
    /// Measures the row's pairs within `most_steps`, those with the largest unoccluded form factors first: all with a
    /// few rays, then with as many as leave Σ (F − true F)² ≤ `tolerance`² Σ F².
    pub(super) fn measure_all(
        &mut self,
        emitter: &Emitter<'_>,
        tolerance: f64,
        most_steps: u64,
        caster: &mut Caster<'_>,
    ) -> Refined {
        let mut refined = Refined::default();
        for pair in &mut self.pairs {
            pair.per_area = 1.0 / emitter.area;
        }
        let mut places: Vec<usize> = (0..self.pairs.len())
            .filter(|&place| self.pairs[place].unoccluded > 0.0)
            .collect();
        places.sort_by(|&p, &q| {
            let (first, second) = (self.pairs[p].unoccluded, self.pairs[q].unoccluded);
            second.total_cmp(&first).then(p.cmp(&q))
        });
        let unmeasured = self.pairs.iter().map(|p| UNMEASURED * p.unoccluded * p.unoccluded);
        let mut errors: Vec<f64> = unmeasured.collect();
        let mut measure = |refiner: &mut Self, place: usize, multiplier: f64, refined: &mut Refined| {
            if refined.steps >= most_steps || refiner.is_cancelled() {
                refined.cut_short = true;
                return false;
            }
            let allowed = Allowance {
                multiplier,
                steps: most_steps - refined.steps,
            };
            let mut cost = refiner.measure_anew(emitter, place, allowed, caster);
            errors[place] = std::mem::take(&mut cost.squared_error);
            refined.add(cost);
            true
        };
        let mut done = 0;
        while done < places.len() && measure(self, places[done], 0.0, &mut refined) {
            done += 1;
        }
        if !refined.cut_short {
            let budget = FRACTIONS_SHARE * tolerance * tolerance * self.squared_norm();
            let (multiplier, fits) = self.multiplier_within(budget, most_steps.saturating_sub(refined.steps));
            refined.cut_short = !fits;
            for &place in &places {
                let spread = self.first_spread(place);
                let value = (spread * self.pairs[place].unoccluded).powi(2) * multiplier;
                let needs_more = spread > 0.0 && rays_for(value, NEAR_RAY) > RAYS as f64;
                if needs_more && !measure(self, place, multiplier, &mut refined) {
                    break;
                }
            }
        }
        refined.squared_error = errors.iter().sum();
        refined
    }

    /// The spread of a pair's rays by the first of them; 0 if all, or nothing, was proved visible.
    fn first_spread(&self, place: usize) -> f64 {
        let fraction = self.pairs[place].fraction;
        if fraction <= 0.0 || fraction >= 1.0 {
            0.0
        } else {
            let smooth = smoothed(fraction, RAYS as f64);
            (smooth * (1.0 - smooth)).sqrt()
        }
    }

    /// The multiplier at which the row's pairs leave `budget` of squared error, or the largest that `steps` pay for;
    /// and whether it leaves no more than `budget`.
    fn multiplier_within(&self, budget: f64, steps: u64) -> (f64, bool) {
        let at = |multiplier: f64| {
            let (mut left, mut cost) = (0.0, 0.0);
            for (place, pair) in self.pairs.iter().enumerate() {
                let own = (self.first_spread(place) * pair.unoccluded).powi(2);
                if own > 0.0 {
                    let rays = rays_for(own * multiplier, TREE_RAY).max(2.0 * RAYS as f64);
                    left += own * variance_of_rays(rays);
                    cost += rays * STEPS_A_RAY + STEPS_A_PAIR as f64 / 10.0;
                }
            }
            (left, cost)
        };
        // Bisect the logarithm by square roots, the same bits everywhere.
        let (mut low, mut high) = (1e-10f64, 1e40f64);
        let mut fits = true;
        while high > 1.09 * low {
            let middle = (low * high).sqrt();
            let (left, cost) = at(middle);
            let is_dear = cost > steps as f64;
            if left <= budget || is_dear {
                high = middle;
                fits = !is_dear || left <= budget;
            } else {
                low = middle;
            }
        }
        (low, fits)
    }
}
