//! Rows that do not add up, though what they lose is known.
//!
//! Pairs may be missing: each too small to be looked for by itself, as between the far ends of a flat space, and
//! together a good part of the row. They are looked for by falling bounds, the largest first, until the row has what it
//! lacks. And fractions that one point has may all be off to one side. They are moved together, in proportion to their
//! standard errors σ: F + λσ for all pairs of the row, with one λ of at most three, and what was measured exactly
//! stays.

use super::{Kind, Mended, Pair, Refined, Refiner};
use crate::Model;
use crate::bvh::Tree;
use crate::geometry::area;
use crate::visibility::candidates::Least;
use glam::DVec3;
use hemicube_scene::InputPatch;

/// The first bound on the form factor of a missing pair, in what the row lacks, and the next one's share of each bound.
const FIRST: f64 = 1.0 / 16.0;
const NEXT: f64 = 1.0 / 8.0;
/// Number of bounds that are tried.
const ROUNDS: usize = 7;
/// What is left to look for in the end, in what the row lacked.
const ENOUGH: f64 = 0.05;
/// Steps that looking for a row's missing pairs may take at 1 % and above; at finer tolerances, more in proportion, up
/// to a hundred times as many.
const STEPS: f64 = 4e6;
/// Steps that it takes to list a candidate, and to find its open form factor, about.
const STEPS_A_CANDIDATE: u64 = 300;
/// So many pairs, one after the other, must bring this part of what the row lacks, or no more are looked at: it lacks
/// something else.
const BATCH: usize = 64;
const WORTH: f64 = 0.02;
/// Number of standard errors that a form factor is moved at most.
const ERRORS: f64 = 3.0;

/// A form factor that may be off.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertain {
    pub(crate) factor: f64,
    /// What it is if all is visible.
    pub(crate) open: f64,
    /// Its standard error.
    pub(crate) error: f64,
}

impl Uncertain {
    fn moved(self, errors: f64) -> f64 {
        (self.factor + errors * self.error).clamp(0.0, self.open.max(self.factor))
    }
}

/// Moves form factors that sum to `lacking` too little, a number that has a standard error of its own: all by the same
/// number of their standard errors. As if these were one error, so much is due to them: S² / (S² + e²), S = Σ σ.
pub(crate) fn move_all(factors: &mut [Uncertain], (lacking, error): (f64, f64)) {
    let own: f64 = factors.iter().map(|factor| factor.error).sum();
    if own <= 0.0 {
        return;
    }
    let wanted = lacking * (own * own) / (own * own + error * error);
    let gained = |errors: f64| -> f64 { factors.iter().map(|factor| factor.moved(errors) - factor.factor).sum() };
    let (mut low, mut high) = (-ERRORS, ERRORS);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if gained(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    let errors = 0.5 * (low + high);
    for factor in factors {
        factor.factor = factor.moved(errors);
    }
}

impl Refiner<'_> {
    /// Looks for pairs that a row lacks, which sums to `lacking` too little; `is_known` says which patches are in it.
    /// They are in `unseen` afterwards, ascending.
    pub(crate) fn find_unseen(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        lacking: f64,
        is_known: impl Fn(u32) -> bool,
    ) -> Refined {
        let own = model.normalised_corners(emitter.0);
        let tree = Tree::of(model.geometry());
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 4 · 10⁸")]
        let most_steps = (STEPS * (0.01 / self.refinement.tolerance).clamp(1.0, 100.0)) as u64;
        let mut refined = Refined::default();
        let row = std::mem::take(&mut self.pairs);
        self.unseen.clear();
        self.exchanges.begin(&own);
        self.own_area = area(&own);
        self.sort_measured();
        let (mut left, mut least) = (lacking, FIRST * lacking);
        let (mut looked_at, mut left_before) = (0, lacking);
        // What was listed, and what of it is too small by now.
        let mut listed: Vec<u32> = Vec::new();
        let mut smaller: Vec<Pair> = Vec::new();
        'rounds: for _ in 0..ROUNDS {
            let from = Least {
                near: least,
                far: least,
            };
            self.candidates.find(&tree, emitter.0, &own, from);
            refined.steps += STEPS_A_CANDIDATE * self.candidates.patches.len() as u64;
            if refined.steps >= most_steps {
                break;
            }
            let is_new = |&patch: &u32| {
                let was_measured = || {
                    self.measured
                        .binary_search_by_key(&patch, |measured| measured.patch)
                        .is_ok()
                };
                listed.binary_search(&patch).is_err() && !is_known(patch) && !was_measured()
            };
            self.pairs.clear();
            let new = self.candidates.patches.iter().copied().filter(is_new).map(Pair::unseen);
            self.pairs.extend(new);
            self.close(model, &own, 0);
            listed.clone_from(&self.candidates.patches);
            self.pairs.append(&mut smaller);
            let is_small = |pair: &mut Pair| pair.open < least * NEXT;
            smaller.extend(self.pairs.extract_if(.., is_small));
            self.pairs
                .sort_unstable_by(|p, q| q.open.total_cmp(&p.open).then(p.patch.cmp(&q.patch)));
            for place in 0..self.pairs.len() {
                if refined.steps >= most_steps || self.is_cancelled() {
                    break 'rounds;
                }
                let mut cost = Refined::default();
                self.measure_anew(model, (emitter, &own), place, 0.0, &mut cost);
                refined.add(cost);
                looked_at += 1;
                let pair = self.pairs[place];
                if pair.fraction > 0.0 {
                    self.unseen.push(pair);
                    left -= pair.open * pair.fraction;
                    if left <= ENOUGH * lacking {
                        break 'rounds;
                    }
                }
                if looked_at % BATCH == 0 {
                    if left_before - left < WORTH * lacking {
                        break 'rounds;
                    }
                    left_before = left;
                }
            }
            least *= NEXT;
        }
        self.pairs = row;
        self.unseen.sort_unstable_by_key(|pair| pair.patch);
        // A row that looks for pairs in vain is not cut short: nobody knows that there are any.
        refined.cut_short = false;
        refined
    }

    /// Puts the pairs of `unseen` into the row.
    pub(crate) fn take_unseen(&mut self) {
        let listed = self.pairs.len();
        for pair in &self.unseen {
            match self.pairs[..listed].binary_search_by_key(&pair.patch, |pair| pair.patch) {
                Ok(place) => self.pairs[place] = *pair,
                Err(_) => self.pairs.push(*pair),
            }
        }
        self.pairs.sort_unstable_by_key(|pair| pair.patch);
    }

    /// The standard error of the form factor of a pair whose open form factor and fraction are these; 0 of one that
    /// nobody saw, as nothing says where it is.
    fn error_of(&self, model: &Model, own: &[DVec3; 3], patch: u32, open: f64, fraction: f64) -> f64 {
        if fraction <= 0.0 {
            return 0.0;
        }
        if let Ok(at) = self.measured.binary_search_by_key(&patch, |measured| measured.patch) {
            return self.measured[at].cost.squared_error.sqrt();
        }
        if self.unseen.binary_search_by_key(&patch, |pair| pair.patch).is_ok() {
            return 0.0;
        }
        let kind = Kind {
            class: Kind::class(fraction),
            nearness: Kind::nearness(own, &model.normalised_corners(patch)),
        };
        open * self.refinement.priors.of(kind).sqrt()
    }

    /// Moves the pairs of a row that lacks so much, known with this standard error.
    pub(crate) fn move_pairs(&mut self, model: &Model, emitter: InputPatch, lacking: (f64, f64)) {
        self.sort_measured();
        let own = model.normalised_corners(emitter.0);
        let mut factors: Vec<Uncertain> = self
            .pairs
            .iter()
            .map(|pair| Uncertain {
                factor: pair.open * pair.fraction,
                open: pair.open,
                error: self.error_of(model, &own, pair.patch, pair.open, pair.fraction),
            })
            .collect();
        move_all(&mut factors, lacking);
        for (pair, factor) in self.pairs.iter_mut().zip(factors) {
            if pair.open > 0.0 {
                pair.fraction = factor.factor / pair.open;
            }
        }
    }

    /// Moves a row that stands in three lists: patches, ascending, their fractions, and A_i F_ij if all were visible; seen by
    /// so many hemicubes.
    pub(crate) fn move_fractions(&mut self, model: &Model, emitter: InputPatch, row: Mended<'_>, lacking: (f64, f64)) {
        self.sort_measured();
        let own = model.normalised_corners(emitter.0);
        let per_area = 1.0 / area(&own);
        let independent = (row.samples.max(1) as f64).sqrt().recip();
        let entries = row.patches.iter().zip(&*row.fractions).zip(&*row.exchanges);
        let mut factors: Vec<Uncertain> = entries
            .map(|((&patch, &fraction), &exchange)| {
                let open = exchange * per_area;
                Uncertain {
                    factor: open * fraction,
                    open,
                    error: independent * self.error_of(model, &own, patch, open, fraction),
                }
            })
            .collect();
        move_all(&mut factors, lacking);
        for (fraction, factor) in row.fractions.iter_mut().zip(factors) {
            if factor.open > 0.0 {
                *fraction = factor.factor / factor.open;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factors(of: &[(f64, f64, f64)]) -> Vec<Uncertain> {
        of.iter()
            .map(|&(factor, open, error)| Uncertain { factor, open, error })
            .collect()
    }

    fn sum(of: &[Uncertain]) -> f64 {
        of.iter().map(|factor| factor.factor).sum()
    }

    #[test]
    fn what_is_uncertain_takes_the_difference_and_what_is_exact_stays() {
        let mut row = factors(&[(0.5, 0.5, 0.0), (0.2, 0.3, 0.02), (0.1, 0.3, 0.01)]);
        move_all(&mut row, (0.03, 0.0));
        assert_eq!(row[0].factor, 0.5);
        assert!(
            (row[1].factor - 0.22).abs() < 1e-9 && (row[2].factor - 0.11).abs() < 1e-9,
            "{row:?}"
        );
        // As uncertain as they are together, a known sum is believed half.
        let mut row = factors(&[(0.2, 0.3, 0.02), (0.1, 0.3, 0.01)]);
        move_all(&mut row, (-0.03, 0.03));
        assert!((sum(&row) - 0.285).abs() < 1e-9, "{row:?}");
    }

    #[test]
    fn none_moves_by_more_than_three_errors_or_beyond_what_it_can_be() {
        let mut row = factors(&[(0.2, 0.3, 0.01), (0.299, 0.3, 0.01), (0.001, 0.3, 0.01)]);
        move_all(&mut row, (0.5, 0.0));
        assert!((row[0].factor - 0.23).abs() < 1e-9 && row[1].factor == 0.3, "{row:?}");
        move_all(&mut row, (-5.0, 0.0));
        assert!(row.iter().all(|factor| factor.factor >= 0.0), "{row:?}");
        let mut exact = factors(&[(0.2, 0.3, 0.0)]);
        move_all(&mut exact, (0.1, 0.0));
        assert_eq!(exact[0].factor, 0.2);
    }
}
