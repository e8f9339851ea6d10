//! Rows of large patches, on which much stands ([`crate::accuracy::grain`]).
//!
//! What stands nearer to such a patch than its hemicubes are to each other is seen by none of them, or from afar only:
//! their fractions, and the prior variances that other rows have, say nothing of it. Most of the row is of that kind.
//! So every pair whose form factor could matter to the row is measured, with a few rays first; a tolerance then spends
//! what is left of the row's budget on all of them in proportion to their part in the error.
//!
//! To the matrix such a row hardly matters: its form factors are small, the larger ones of the pairs are in the other
//! rows, and are measured there. So rays are allotted by the row's own form factors.

use super::{CROWDED_RAY, LEAST_SPREAD, NEAR_RAY, Refined, Refiner, SHARE, STEPS_A_PAIR, rays_for};
use crate::Model;
use crate::visibility::shaft::RAYS;
use glam::DVec3;
use hemicube_scene::InputPatch;

/// Pairs whose open form factor is less than this share of Σ F² / Σ F over the pairs that hemicubes saw are left as
/// these have them.
const LEAST_SHARE: f64 = 0.1;
/// The mean squared error of a fraction that was to be measured and is not.
const UNMEASURED: f64 = 0.1;
/// Steps that one ray down the tree takes, about.
const STEPS_A_RAY: f64 = 600.0;

/// From which open form factor on pairs of such a row matter to it, by those of the pairs that were seen.
pub(super) fn least_factor(open: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = open.fold((0.0, 0.0), |(sum, squares), open| (sum + open, squares + open * open));
    if sum > 0.0 { LEAST_SHARE * squares / sum } else { 0.0 }
}

impl Refiner<'_> {
    /// Measures the row's pairs, those with the largest open form factors first, until `most_steps` are taken: all with
    /// a few rays, then as many rays as leave Σ (F − true F)² ≤ `(tolerance)²` Σ F², where a tolerance is given.
    pub(super) fn measure_all(
        &mut self,
        model: &Model,
        emitter: (InputPatch, &[DVec3; 3]),
        tolerance: Option<f64>,
        most_steps: u64,
    ) -> Refined {
        let mut refined = Refined::default();
        for pair in &mut self.pairs {
            pair.stake = 1.0 / self.own_area;
        }
        let mut places: Vec<usize> = (0..self.pairs.len())
            .filter(|&place| self.pairs[place].open > 0.0)
            .collect();
        places.sort_by(|&p, &q| self.pairs[q].open.total_cmp(&self.pairs[p].open).then(p.cmp(&q)));
        let mut errors: Vec<f64> = self
            .pairs
            .iter()
            .map(|pair| UNMEASURED * pair.open * pair.open)
            .collect();
        let mut measure = |refiner: &mut Self, place: usize, price: f64, refined: &mut Refined| {
            if refined.steps >= most_steps || refiner.is_cancelled() {
                refined.cut_short = true;
                return false;
            }
            let mut cost = Refined::default();
            refiner.measure_anew(model, emitter, place, price, &mut cost);
            errors[place] = std::mem::take(&mut cost.squared_error);
            refined.add(cost);
            true
        };
        let mut done = 0;
        while done < places.len() && measure(self, places[done], 0.0, &mut refined) {
            done += 1;
        }
        if let (Some(tolerance), false) = (tolerance, refined.cut_short) {
            let budget = SHARE * tolerance * tolerance * self.squared_norm();
            let (price, fits) = self.price_within(budget, most_steps.saturating_sub(refined.steps));
            refined.cut_short = !fits;
            for &place in &places {
                if self.first_spread(place) > 0.0
                    && rays_for(
                        (self.first_spread(place) * self.pairs[place].open).powi(2) * price,
                        NEAR_RAY,
                    ) > RAYS as f64
                    && !measure(self, place, price, &mut refined)
                {
                    break;
                }
            }
        }
        refined.squared_error = errors.iter().sum();
        refined
    }

    /// The spread of a pair's rays as the first of them leave it; 0 where all, or nothing, was proved visible.
    fn first_spread(&self, place: usize) -> f64 {
        let fraction = self.pairs[place].fraction;
        if fraction <= 0.0 || fraction >= 1.0 {
            0.0
        } else {
            (fraction * (1.0 - fraction)).sqrt().max(LEAST_SPREAD)
        }
    }

    /// The price at which the row's pairs leave `budget` of squared error, or the most that so many steps pay for; and
    /// whether they do.
    fn price_within(&self, budget: f64, steps: u64) -> (f64, bool) {
        let at = |price: f64| {
            let (mut left, mut cost) = (0.0, 0.0);
            for (place, pair) in self.pairs.iter().enumerate() {
                let own = (self.first_spread(place) * pair.open).powi(2);
                if own > 0.0 {
                    let rays = rays_for(own * price, CROWDED_RAY).max(2.0 * RAYS as f64);
                    left += own * super::left_by(rays);
                    cost += rays * STEPS_A_RAY + STEPS_A_PAIR as f64 / 10.0;
                }
            }
            (left, cost)
        };
        // By halves of the logarithm; a root has the same bits everywhere.
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
