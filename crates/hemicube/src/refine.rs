//! Rows to a tolerance: effort goes where the error is.
//!
//! A row begins with one hemicube at the centroid and the area-to-area closed form of every pair. What is wrong then is the
//! visible fraction of some pairs, and few of them matter. Candidates are what the hemicube saw and what it did not see but
//! could be large ([`Candidates`]). Each has a doubt, the mean squared error that fractions are known to have in such a case;
//! those whose doubt hardly matters for the row keep their fraction. For the others the shaft between the two patches is
//! listed: an empty one proves that all is visible, one blocked by a single triangle that nothing is. A few rays tell how
//! the rest stand, and then each pair gets rays in proportion to its part in the error, or is measured exactly from points
//! ([`Clipper`]) where that is cheaper.
//!
//! Errors of different pairs are independent, so squares add up. With spreads s, form factors f, n rays each with variance
//! s² / (g n), the least rays for Σ f² s² / (g n) ≤ B are n = f s Σ f s / (g B).

use crate::Model;
use crate::candidates::Candidates;
use crate::clip::Clipper;
use crate::factor::{Exchanges, FactorRule};
use crate::random;
use crate::shaft::{RAYS, Shaft, Sighting};
use glam::DVec3;
use hemicube_scene::InputPatch;

/// How far the visible fractions of a row are refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The relative Frobenius error to aim at.
    pub tolerance: f64,
    /// How the closed form is integrated.
    pub rule: FactorRule,
    /// The error aimed at as a share of `tolerance`: what a scene needs to keep it.
    pub effort: f64,
    /// The mean of Σ F² over the scene's rows; 0 where it is not known.
    ///
    /// The tolerance is for the matrix, not for each row: half of what a row may err by is in proportion to itself, half is
    /// the same for all, so that rows with next to nothing in them get next to no rays.
    pub mean_squared_norm: f64,
    /// How far a fraction that one hemicube has may be off.
    pub doubts: Doubts,
    /// Whether each pair is to have the tolerance by itself: for scenes so small that all pairs can be looked at.
    pub each: bool,
}

impl Refinement {
    /// The refinement for a relative Frobenius error, nothing known of the scene.
    pub fn for_tolerance(tolerance: f64) -> Self {
        Self {
            tolerance,
            rule: FactorRule::for_tolerance(tolerance * 0.5),
            effort: 1.0,
            mean_squared_norm: 0.0,
            doubts: Doubts::default(),
            each: false,
        }
    }

    /// What Σ (F − true F)² of a row may be.
    fn budget(&self, squared_norm: f64) -> f64 {
        let norm = if self.mean_squared_norm > 0.0 {
            0.5 * (squared_norm + self.mean_squared_norm)
        } else {
            squared_norm
        };
        (self.tolerance * self.effort).powi(2) * norm
    }
}

/// Mean squared errors of visible fractions from one hemicube at the centroid, by what it says (between 0 and 1, 1, 0 or
/// nothing) and by how near the pair is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubts([[f32; NEARNESSES]; CLASSES]);

/// What a hemicube says of a patch: partly visible, all visible, not visible.
const CLASSES: usize = 3;
/// Steps of a factor 2 in the distance, measured in radii.
const NEARNESSES: usize = 8;

impl Default for Doubts {
    /// What rooms, cities and machines have, on the large side: a pair that a sample of rows did not meet is rare, and not
    /// known to be harmless.
    fn default() -> Self {
        Self([
            [0.08, 0.06, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05],
            [0.02, 0.01, 0.005, 0.003, 0.002, 0.002, 0.002, 0.002],
            [0.1, 0.05, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01],
        ])
    }
}

impl Doubts {
    fn of(&self, kind: Kind) -> f64 {
        f64::from(self.0[kind.class as usize][kind.nearness as usize])
    }
}

/// Which of the doubts is a pair's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Kind {
    class: u8,
    nearness: u8,
}

impl Kind {
    fn class(fraction: f64) -> u8 {
        if fraction >= 1.0 {
            1
        } else if fraction > 0.0 {
            0
        } else {
            2
        }
    }

    fn nearness(i: &[DVec3; 3], j: &[DVec3; 3]) -> u8 {
        let sphere = |t: &[DVec3; 3]| {
            let center = (t[0] + t[1] + t[2]) / 3.0;
            (center, t.iter().map(|p| p.distance_squared(center)).fold(0.0, f64::max))
        };
        let ((c0, r0), (c1, r1)) = (sphere(i), sphere(j));
        let radii = c0.distance_squared(c1) / (r0 + r1);
        // The exponent of a power of 4.
        let exponent = (radii.to_bits() >> 52) as i64 - 1023;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let step = exponent.div_euclid(2).clamp(0, NEARNESSES as i64 - 1) as u8;
        step
    }
}

/// Sums that doubts are estimated from: Σ f² (error)², Σ f² and how many.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DoubtSums([[(f64, f64, f64); NEARNESSES]; CLASSES]);

impl DoubtSums {
    /// The doubts: what is usual counts as much as a few pairs.
    pub(crate) fn doubts(&self) -> Doubts {
        let mut doubts = Doubts::default();
        for (doubt, &(error, weight, count)) in doubts.0.iter_mut().flatten().zip(self.0.iter().flatten()) {
            if count > 0.0 {
                let usual = USUAL * weight / count;
                #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
                let found = ((error + usual * f64::from(*doubt)) / (weight + usual)) as f32;
                *doubt = found;
            }
        }
        doubts
    }
}

/// Pairs that the usual doubt counts as much as.
const USUAL: f64 = 5.0;

/// A pair of the row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) patch: u32,
    /// F if all were visible.
    pub(crate) open: f64,
    pub(crate) fraction: f64,
    kind: Kind,
}

/// Refines the rows of one patch at a time. One a thread.
#[derive(Debug)]
pub(crate) struct Refiner {
    refinement: Refinement,
    pub(crate) pairs: Vec<Pair>,
    candidates: Candidates,
    exchanges: Exchanges,
    open: Vec<f64>,
    order: Vec<u32>,
    doubtful: Vec<Doubtful>,
    shaft: Shaft,
    clipper: Clipper,
}

/// A pair whose fraction is being measured.
#[derive(Debug)]
struct Doubtful {
    place: usize,
    /// Whether rays are drawn by direction.
    near: bool,
    /// F from the smaller of the two, nothing in between.
    filled: f64,
    sighting: Sighting,
    /// Σ k V and Σ k of the first rays.
    sums: (f64, f64),
    rays: usize,
    spread: f64,
}

/// What a row's refinement came to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Refined {
    /// Expected Σ (F − true F)².
    pub(crate) squared_error: f64,
    /// Σ F².
    pub(crate) squared_norm: f64,
    pub(crate) rays: u64,
    pub(crate) points: u64,
    pub(crate) shafts: u64,
}

/// Shares of the squared error for what stays as the centroid has it, and for rays.
const ROUGH_SHARE: f64 = 0.3;
const RAY_SHARE: f64 = 0.5;
/// Unseen pairs are looked for down to this share of the row's permitted error.
const REACH: f64 = 0.3;
/// How much smaller the squared error of the additive sequence is than that of independent rays.
const QUASI_GAIN: f64 = 4.0;
/// From this many rays on, points are cheaper.
const MANY_RAYS: f64 = 65_536.0;
/// Points at one pair, about, at most; and where each pair is to have the tolerance by itself.
const MOST_POINTS: usize = 6_000;
const MOST_POINTS_EACH: usize = 20_000;
/// Below this share of the view, drawing rays by direction is a waste.
const FILLED: f64 = 0.004;
/// Rays at one pair, at most.
const MOST_RAYS: f64 = 262_144.0;

impl Refiner {
    pub(crate) fn new(refinement: Refinement) -> Self {
        Self {
            refinement,
            pairs: Vec::new(),
            candidates: Candidates::default(),
            exchanges: Exchanges::new(refinement.rule),
            open: Vec::new(),
            order: Vec::new(),
            doubtful: Vec::new(),
            shaft: Shaft::default(),
            clipper: Clipper::default(),
        }
    }

    /// From now on takes nothing for known, and half of the error, if it is to take care; returns what it did before.
    pub(crate) fn with_care(&mut self, care: bool) -> Refinement {
        let before = self.refinement;
        if care {
            self.refinement.doubts = Doubts::default();
            self.refinement.effort *= 0.5;
        }
        before
    }

    /// Refines so from now on.
    pub(crate) fn set(&mut self, refinement: Refinement) {
        self.refinement = refinement;
    }

    /// Refines a row: `seen` are the patches that the centroid's hemicube saw, ascending, with their visible fractions.
    /// Afterwards `pairs` is the row, ascending.
    pub(crate) fn row(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let own = model.normalised_corners(emitter.0);
        let budget = self.begin(model, emitter, &own, seen, receives);
        if self.refinement.each {
            let refined = self.measure_each(model, emitter, &own);
            self.pairs.sort_unstable_by_key(|pair| pair.patch);
            return refined;
        }

        // The least doubtful keep what they have while that takes no more than its share.
        self.order.clear();
        #[allow(clippy::cast_possible_truncation, reason = "fewer pairs than patches")]
        self.order
            .extend((0..self.pairs.len() as u32).filter(|&k| self.pairs[k as usize].open > 0.0));
        let doubts = self.refinement.doubts;
        let weight = |pair: &Pair| pair.open * pair.open * doubts.of(pair.kind);
        self.order.sort_unstable_by(|&p, &q| {
            let (p, q) = (&self.pairs[p as usize], &self.pairs[q as usize]);
            weight(p).total_cmp(&weight(q)).then(p.patch.cmp(&q.patch))
        });
        let mut refined = Refined::default();
        let mut first = 0;
        for &k in &self.order {
            let error = weight(&self.pairs[k as usize]);
            if refined.squared_error + error > ROUGH_SHARE * budget {
                break;
            }
            refined.squared_error += error;
            first += 1;
        }
        self.measure(model, emitter, &own, first, budget, &mut refined);
        self.pairs.sort_unstable_by_key(|pair| pair.patch);
        refined.squared_norm = self.squared_norm();
        refined
    }

    /// Makes the list of pairs: what was seen, and what was not but could be large. Returns what the row may err by.
    fn begin(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        own: &[DVec3; 3],
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
    ) -> f64 {
        self.pairs.clear();
        self.pairs.extend(seen.map(|(patch, fraction)| Pair {
            patch,
            open: 0.0,
            fraction,
            kind: Kind {
                class: Kind::class(fraction),
                nearness: 0,
            },
        }));
        let seen_count = self.pairs.len();
        self.exchanges.begin(own);
        self.close(model, own, 0);
        let budget = self.refinement.budget(self.squared_norm());
        let least = if self.refinement.each {
            f64::MIN_POSITIVE
        } else {
            REACH * budget.sqrt()
        };
        if least > 0.0 && least < 1.0 {
            self.candidates.find(model.geometry().tree(), emitter.0, own, least);
            let mut known = 0;
            for &patch in &self.candidates.patches {
                while known < seen_count && self.pairs[known].patch < patch {
                    known += 1;
                }
                let is_known = known < seen_count && self.pairs[known].patch == patch;
                if !is_known && receives(patch) {
                    self.pairs.push(Pair {
                        patch,
                        open: 0.0,
                        fraction: 0.0,
                        kind: Kind {
                            class: Kind::class(0.0),
                            nearness: 0,
                        },
                    });
                }
            }
            self.close(model, own, seen_count);
        }
        budget
    }

    fn squared_norm(&self) -> f64 {
        self.pairs.iter().map(|p| (p.open * p.fraction).powi(2)).sum()
    }

    /// Compares what a hemicube says of some of a row's pairs with rays; adds to `sums`. Returns Σ F² of the row as the
    /// hemicube has it.
    pub(crate) fn survey(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
        sums: &mut DoubtSums,
    ) -> f64 {
        let own = model.normalised_corners(emitter.0);
        self.begin(model, emitter, &own, seen, receives);
        let tree = model.geometry().tree();
        for class in 0..CLASSES {
            let of_class = |pair: &&Pair| usize::from(pair.kind.class) == class;
            let total: f64 = self.pairs.iter().filter(of_class).map(|pair| pair.open).sum();
            for pair in self.pairs.iter().filter(of_class).filter(|pair| pair.open > 0.0) {
                // Drawn in proportion to F, and weighted by what that leaves out.
                let chance = (SURVEYED * pair.open / total).min(1.0);
                if random::unit(random::hash(seed(emitter.0, pair.patch).wrapping_add(random::STEP))) >= chance {
                    continue;
                }
                let corners = model.normalised_corners(pair.patch);
                self.shaft.clear();
                let sighting = self.shaft.sight(tree, (emitter.0, &own), (pair.patch, &corners));
                let fraction = if sighting.hidden {
                    0.0
                } else if sighting.is_open() {
                    1.0
                } else {
                    let mut rays = (0.0, 0.0);
                    let seed = seed(emitter.0, pair.patch);
                    let filled = pair.open * sighting.emitter_share;
                    if sighting.near && filled <= FILLED {
                        match self.clipper.measure(&self.shaft, tree, &sighting, 0.05, MOST_POINTS) {
                            Some(clipped) => rays = (clipped.fraction, 1.0),
                            None => continue,
                        }
                    } else if sighting.near {
                        self.shaft
                            .cast_near(&sighting, SURVEY_RAYS, 64 * SURVEY_RAYS, seed, &mut rays);
                    } else {
                        self.shaft.cast(&sighting, 0, SURVEY_RAYS, seed, &mut rays);
                    }
                    if rays.1 > 0.0 { rays.0 / rays.1 } else { continue }
                };
                let weight = pair.open * pair.open / chance;
                let sum = &mut sums.0[class][usize::from(pair.kind.nearness)];
                sum.0 += weight * (fraction - pair.fraction).powi(2);
                sum.1 += weight;
                sum.2 += 1.0;
            }
        }
        self.squared_norm()
    }

    /// The closed forms of the pairs from `start` on.
    fn close(&mut self, model: &Model, own: &[DVec3; 3], start: usize) {
        let per_area = 2.0 / (own[1] - own[0]).cross(own[2] - own[0]).length();
        self.open.clear();
        self.open.resize(self.pairs.len() - start, 0.0);
        for (place, pair) in self.pairs[start..].iter_mut().enumerate() {
            let corners = model.normalised_corners(pair.patch);
            self.exchanges.add(place, &corners, &mut self.open);
            pair.kind.nearness = Kind::nearness(own, &corners);
        }
        self.exchanges.finish(&mut self.open);
        for (pair, exchange) in self.pairs[start..].iter_mut().zip(&self.open) {
            pair.open = exchange * per_area;
        }
    }

    /// Measures the fraction of every pair to the tolerance.
    fn measure_each(&mut self, model: &Model, emitter: InputPatch, own: &[DVec3; 3]) -> Refined {
        let tree = model.geometry().tree();
        let mut refined = Refined::default();
        for pair in self.pairs.iter_mut().filter(|pair| pair.open > 0.0) {
            self.shaft.clear();
            let corners = model.normalised_corners(pair.patch);
            let sighting = self.shaft.sight(tree, (emitter.0, own), (pair.patch, &corners));
            refined.shafts += 1;
            if sighting.hidden || sighting.is_open() {
                pair.fraction = f64::from(u8::from(!sighting.hidden));
                continue;
            }
            // Of a factor under a hundredth, a hundredth of the tolerance.
            let enough = EACH_SHARE * self.refinement.tolerance * (SMALL_FACTOR / pair.open).max(1.0);
            let measured = self
                .clipper
                .measure(&self.shaft, tree, &sighting, enough, MOST_POINTS_EACH);
            if let Some(clipped) = measured {
                pair.fraction = clipped.fraction;
                refined.points += clipped.points as u64;
                refined.squared_error += (clipped.change * pair.open).powi(2);
                continue;
            }
            let seed = seed(emitter.0, pair.patch);
            let mut sums = (0.0, 0.0);
            if sighting.near {
                self.shaft
                    .cast_near(&sighting, EACH_RAYS, 64 * EACH_RAYS, seed, &mut sums);
            } else {
                self.shaft.cast(&sighting, 0, EACH_RAYS, seed, &mut sums);
            }
            refined.rays += EACH_RAYS as u64;
            if sums.1 > 0.0 {
                pair.fraction = sums.0 / sums.1;
            }
            let variance = pair.fraction * (1.0 - pair.fraction) / (QUASI_GAIN * EACH_RAYS as f64);
            refined.squared_error += pair.open * pair.open * variance;
        }
        refined.squared_norm = self.squared_norm();
        refined
    }

    /// Measures the fractions of the pairs from `first` on in the order of doubt.
    fn measure(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        own: &[DVec3; 3],
        first: usize,
        budget: f64,
        refined: &mut Refined,
    ) {
        let tree = model.geometry().tree();
        self.shaft.clear();
        self.doubtful.clear();
        for &place in &self.order[first..] {
            let place = place as usize;
            let pair = &mut self.pairs[place];
            let corners = model.normalised_corners(pair.patch);
            let sighting = self.shaft.sight(tree, (emitter.0, own), (pair.patch, &corners));
            refined.shafts += 1;
            if sighting.hidden {
                pair.fraction = 0.0;
                continue;
            }
            if sighting.is_open() {
                pair.fraction = 1.0;
                continue;
            }
            let seed = seed(emitter.0, pair.patch);
            let mut sums = (0.0, 0.0);
            // From the smaller one, how much of the view the other fills.
            let filled = pair.open * sighting.emitter_share;
            let near = sighting.near && filled > FILLED;
            let rays = if near {
                self.shaft.cast_near(&sighting, 2 * RAYS, 8192, seed, &mut sums)
            } else {
                self.shaft.cast(&sighting, 0, RAYS, seed, &mut sums);
                RAYS
            };
            refined.rays += rays as u64;
            // A few rays that agree do not prove that all would (Laplace's rule of succession, for half a ray).
            let count = rays as f64;
            let pilot = if sums.1 > 0.0 { sums.0 / sums.1 } else { 0.5 };
            let smooth = (pilot * count + 0.5) / (count + 1.0);
            self.doubtful.push(Doubtful {
                place,
                near,
                filled,
                sighting,
                sums,
                rays,
                spread: (smooth * (1.0 - smooth)).sqrt(),
            });
        }
        let total: f64 = self.doubtful.iter().map(|d| self.pairs[d.place].open * d.spread).sum();
        for doubtful in &self.doubtful {
            let Doubtful {
                place,
                near,
                filled,
                ref sighting,
                mut sums,
                mut rays,
                spread,
            } = *doubtful;
            let pair = &mut self.pairs[place];
            let wanted = spread * pair.open * total / (RAY_SHARE * budget * QUASI_GAIN);
            if wanted > MANY_RAYS || (sighting.near && !near && wanted > RAYS as f64) || sums.1 <= 0.0 {
                // Its part of the budget, in terms of the fraction.
                let variance = RAY_SHARE * budget * (spread * pair.open / total);
                let enough = variance.sqrt() / pair.open;
                if let Some(clipped) = self.clipper.measure(&self.shaft, tree, sighting, enough, MOST_POINTS) {
                    pair.fraction = clipped.fraction;
                    refined.points += clipped.points as u64;
                    refined.squared_error += (clipped.change * pair.open).powi(2);
                    continue;
                }
            }
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped, then a number of rays"
            )]
            let count = |x: f64| (x.clamp(0.0, MOST_RAYS) as usize).next_multiple_of(RAYS);
            let wanted = count(wanted);
            let seed = seed(emitter.0, pair.patch);
            if wanted > rays && near {
                sums = (0.0, 0.0);
                rays = self
                    .shaft
                    .cast_near(sighting, wanted, count(4.0 * wanted as f64 / filled), seed, &mut sums);
                refined.rays += rays as u64;
            } else if wanted > rays {
                self.shaft.cast(sighting, rays, wanted, seed, &mut sums);
                refined.rays += (wanted - rays) as u64;
                rays = wanted;
            }
            // Where no ray had weight, as between planes that all but coincide, the centroid's fraction is all there is.
            if sums.1 > 0.0 {
                pair.fraction = sums.0 / sums.1;
            }
            refined.squared_error += (spread * pair.open).powi(2) / (QUASI_GAIN * rays.max(1) as f64);
        }
    }
}

/// Where each pair is measured: the share of the tolerance that points may leave, and rays where points will not do.
const EACH_SHARE: f64 = 0.3;
const SMALL_FACTOR: f64 = 1e-2;
const EACH_RAYS: usize = 1 << 18;

/// Pairs of each class that are surveyed in a row, about.
const SURVEYED: f64 = 24.0;
/// Rays at each of them.
const SURVEY_RAYS: usize = 512;

/// The same in both directions.
fn seed(i: u32, j: u32) -> u64 {
    (u64::from(i.min(j)) << 32 | u64::from(i.max(j))).wrapping_mul(random::STEP)
}
