//! Rows whose sum is off, though their non-visible share is known.
//!
//! Pairs may be missing: each too small to be looked for by itself, as between the far ends of a flat space, and
//! together a good part of the row. They are looked for by falling bounds, the largest first, until the row has what it
//! lacks. And fractions may be off, those of one point all to one side. They are moved together, in proportion to their
//! variances: F + μ · variance for all pairs of the row, with one μ. Exact measurements stay.

use super::{Allowance, Pair, Refined, Refiner, steps_beside};
use crate::accuracy::caster::Caster;
use crate::accuracy::closing::{Lacking, Uncertain, project};
use crate::accuracy::row::Emitter;
use crate::bvh::Tree;
use crate::visibility::candidates::Least;

/// First bound on the form factor of a missing pair, in parts of what the row lacks, each bound's part of the one before,
/// and the rest at which the search ends. Large patches take the same part of Σ F² / Σ F. A choice: with a quarter, a row
/// of a flat cavity is off by 1.01 T at 0.1 % (`light::rows_of_a_flat_cavity…`); with less, candidates are listed more
/// often.
pub(super) const NEXT: f64 = 1.0 / 8.0;
/// Steps of listing a candidate and of its unoccluded form factor, about.
const STEPS_A_CANDIDATE: u64 = 300;
/// Each batch of so many pairs must bring this part of what the row lacks, or the search ends: the row lacks something
/// else. A choice: with more, rows end before they have what many small pairs would bring; with less, searches in vain
/// cost more.
const BATCH: usize = 64;
const LEAST_GAIN: f64 = 0.02;

impl Refiner<'_> {
    /// Looks for pairs of a row whose sum lacks `lacking`; `is_known` tells the patches in it. Afterwards they are in
    /// `self.unseen`, ascending.
    pub(crate) fn find_unseen(
        &mut self,
        emitter: &Emitter<'_>,
        lacking: f64,
        is_known: impl Fn(u32) -> bool,
    ) -> Refined {
        let tree = Tree::of(emitter.model.geometry());
        let most_steps = steps_beside(self.refinement.tolerance);
        let mut refined = Refined::default();
        let row = std::mem::take(&mut self.pairs);
        self.unseen.clear();
        self.exchanges.begin(&emitter.corners);
        self.sort_measured();
        let (mut left, mut least) = (lacking, NEXT * lacking);
        let (mut looked_at, mut left_before) = (0, lacking);
        // Candidates so far, and those of them that are too small by now.
        let mut listed: Vec<u32> = Vec::new();
        let mut smaller: Vec<Pair> = Vec::new();
        'rounds: while least > 0.0 {
            let from = Least {
                near: least,
                far: least,
            };
            self.candidates.find(&tree, emitter.patch.0, &emitter.corners, from);
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
            self.evaluate_from(emitter, 0);
            listed.clone_from(&self.candidates.patches);
            self.pairs.append(&mut smaller);
            let is_small = |pair: &mut Pair| pair.unoccluded < least * NEXT;
            smaller.extend(self.pairs.extract_if(.., is_small));
            self.pairs.sort_unstable_by(|p, q| {
                let by_factor = q.unoccluded.total_cmp(&p.unoccluded);
                by_factor.then(p.patch.cmp(&q.patch))
            });
            for place in 0..self.pairs.len() {
                if refined.steps >= most_steps || self.is_cancelled() {
                    break 'rounds;
                }
                let allowed = Allowance {
                    multiplier: 0.0,
                    steps: most_steps - refined.steps,
                };
                refined.add(self.measure_anew(emitter, place, allowed, &mut Caster::none()));
                looked_at += 1;
                let pair = self.pairs[place];
                if pair.fraction > 0.0 {
                    self.unseen.push(pair);
                    left -= pair.unoccluded * pair.fraction;
                    if left <= NEXT * lacking {
                        break 'rounds;
                    }
                }
                if looked_at % BATCH == 0 {
                    if left_before - left < LEAST_GAIN * lacking {
                        break 'rounds;
                    }
                    left_before = left;
                }
            }
            least *= NEXT;
        }
        self.pairs = row;
        self.unseen.sort_unstable_by_key(|pair| pair.patch);
        // A search in vain does not cut the row short: nobody knows that there are pairs to find.
        refined.cut_short = false;
        refined
    }

    /// The variance of a pair's form factor; 0 for an unseen one: nothing tells its error.
    fn variance_of(&self, pair: &Pair) -> f64 {
        if pair.fraction <= 0.0 {
            return 0.0;
        }
        if let Ok(at) = self
            .measured
            .binary_search_by_key(&pair.patch, |measured| measured.patch)
        {
            return self.measured[at].cost.squared_error;
        }
        if self
            .unseen
            .binary_search_by_key(&pair.patch, |unseen| unseen.patch)
            .is_ok()
        {
            return 0.0;
        }
        pair.unoccluded * pair.unoccluded * self.refinement.priors.of(pair.cell)
    }

    /// Moves the fractions of a row towards its known sum.
    pub(crate) fn move_fractions(&mut self, row: &mut [Pair], lacking: Lacking, most: f64) {
        self.sort_measured();
        let uncertain = row.iter().map(|pair| Uncertain {
            value: pair.factor(),
            ceiling: pair.unoccluded.max(pair.factor()),
            variance: self.variance_of(pair),
        });
        let mut factors: Vec<Uncertain> = uncertain.collect();
        project(&mut factors, lacking, most);
        for (pair, factor) in row.iter_mut().zip(factors) {
            if pair.unoccluded > 0.0 {
                pair.fraction = factor.value / pair.unoccluded;
            }
        }
    }
}
