//! Refinement of visible fractions: rays and exact points go to the pairs that a row's error is made of.
//!
//! A row begins with one hemicube at the centroid and the area-to-area closed form of every pair. What is wrong then is
//! the visible fraction of a few pairs. Candidates are the patches seen by the hemicube, and unseen ones with a
//! possibly large form factor ([`Candidates`]). Each has a prior variance ([`super::error_model`]); a pair whose prior
//! variance hardly matters to the row keeps its fraction. For the others, list the shaft between the two patches: an
//! empty one proves full visibility, a single region in front of all of it full occlusion. Otherwise cast a few rays
//! for the spread, then rays in proportion to the pair's part in the error, or measure exactly from points
//! ([`ExactVisibility`]), whichever is cheaper. The multiplier λ between rays and squared error is one for the scene,
//! from a sample of its rows ([`Refinement::with_multiplier_of`]).
//!
//! Spread, rays and points are the same in both directions of a pair, and so is the measured fraction, to the bit. Only
//! fractions left as a row's own centroid has them are not reciprocal.
//!
//! No table of fractions shared between rows, because rows would then depend on each other. Instead, a pair's samples
//! and their number follow from quantities that are the same in both directions.

pub(crate) mod exact;
mod large;
mod prove;
pub(crate) mod sums;

use crate::Model;
use crate::accuracy::caster::Caster;
use crate::accuracy::error_model::{
    CLASSES, ErrorContribution, FRACTIONS_SHARE, GROUPS, MEASURED_FROM, NEAR_RAY, PriorCell, PriorSums, PriorVariances,
    REACH, ROW_SUM, RayGain, TREE_RAY, class_of, multiplier_for, nearness_of, variance_of_rays,
};
use crate::accuracy::ladder;
use crate::accuracy::row::Emitter;
use crate::accuracy::spread::Spread;
use crate::backend::Rays;
use crate::bvh::Tree;
use crate::factor::{self, Exchanges, FactorRule};
use crate::geometry::{area, centroid, cross};
use crate::sampling::splitmix;
use crate::visibility::candidates::{Candidates, Least};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::exact::critical::CriticalCells;
use crate::visibility::exact::{ExactVisibility, Precision};
use crate::visibility::segments::Obstacles;
use crate::visibility::shaft::{Asked, Cast, PatchTriangle, RAYS, Shaft};
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicBool, Ordering};

/// Extent to which the visible fractions of a row are refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The relative Frobenius error to aim at.
    pub tolerance: f64,
    /// Quadrature of the closed form.
    pub rule: FactorRule,
    /// Share of `tolerance` to aim at, as the scene needs to keep it.
    pub effort: f64,
    /// The mean of Σ F² over the scene's rows; 0 if unknown.
    ///
    /// The tolerance is for the matrix, not for each row: half of a row's permitted squared error is in proportion to
    /// its own Σ F², half to this mean, so that rows with next to nothing in them get next to no rays.
    pub mean_squared_norm: f64,
    /// λ, the number of rays that a unit of squared error is worth; 0 if unknown: each row finds its own.
    pub multiplier: f64,
    /// Mean squared errors of fractions from one hemicube.
    pub priors: PriorVariances,
    /// Factor of the variance that rays leave in this scene to that of usual ones.
    pub gain: RayGain,
    /// True if each pair keeps the tolerance by itself: for scenes so small that all pairs can be looked at.
    pub each: bool,
    /// True if seen pairs that no ray measures are proved visible or occluded, where a shaft can.
    pub proves: bool,
    /// True if much of what leaves the scene's patches meets nothing. Otherwise sums of rows are known, and a row whose
    /// sum is off by more than the tolerance is computed again, strictly.
    pub is_open: bool,
}

impl Refinement {
    /// The refinement for a relative Frobenius error, without knowledge of the scene.
    pub fn for_tolerance(tolerance: f64) -> Self {
        Self {
            tolerance,
            rule: FactorRule::for_tolerance(tolerance * 0.5),
            effort: 1.0,
            mean_squared_norm: 0.0,
            multiplier: 0.0,
            priors: PriorVariances::default(),
            gain: RayGain::default(),
            each: false,
            proves: false,
            is_open: false,
        }
    }

    /// What was found of the scene, as numbers in words; [`Self::of_price`] reads it to the bit.
    pub(crate) fn price(&self) -> String {
        let flags = [self.each, self.is_open].map(|flag| f64::from(u8::from(flag)));
        let found = [self.effort, self.mean_squared_norm, self.multiplier, self.gain.factor()];
        let priors = self
            .priors
            .table()
            .iter()
            .flatten()
            .map(|&variance| f64::from(variance));
        let numbers: Vec<String> = flags
            .into_iter()
            .chain(found)
            .chain(priors)
            .map(|number| number.to_string())
            .collect();
        numbers.join(" ")
    }

    /// The refinement for a tolerance at the price of another scene; `None` where the words are no price.
    pub(crate) fn of_price(tolerance: f64, price: &str) -> Option<Self> {
        let numbers = price
            .split_whitespace()
            .map(|word| word.parse().ok().filter(|number: &f64| number.is_finite()));
        let numbers = numbers.collect::<Option<Vec<f64>>>()?;
        let (&[each, is_open, effort, mean_squared_norm, multiplier, gain], priors) = numbers.split_first_chunk()?;
        let refinement = Self::for_tolerance(tolerance);
        Some(Self {
            rule: if each == 1.0 {
                FactorRule::exact()
            } else {
                refinement.rule
            },
            each: each == 1.0,
            is_open: is_open == 1.0,
            effort,
            mean_squared_norm,
            multiplier,
            gain: RayGain::of(gain),
            priors: PriorVariances::of_table(priors)?,
            ..refinement
        })
    }

    /// Sets the multiplier at which a sample of rows leaves the effort's Σ (F − true F)².
    pub(crate) fn with_multiplier_of(self, rows: &[Vec<ErrorContribution>]) -> Self {
        let squared = (self.tolerance * self.effort).powi(2);
        let budget = FRACTIONS_SHARE * squared * self.mean_squared_norm * rows.len() as f64;
        let multiplier = multiplier_for(rows.iter().flatten(), budget, self.gain);
        Self { multiplier, ..self }
    }

    /// Bound of one row's work, in steps ([`crate::visibility::shaft`]): 10⁹ · 0.01 / T, at most 10¹¹.
    pub(crate) fn most_steps(&self) -> u64 {
        most_steps(self.tolerance)
    }

    /// Permitted Σ (F − true F)² of a row with this Σ F².
    fn budget(&self, squared_norm: f64) -> f64 {
        let norm = if self.mean_squared_norm > 0.0 {
            0.5 * (squared_norm + self.mean_squared_norm)
        } else {
            squared_norm
        };
        (self.tolerance * self.effort).powi(2) * norm
    }
}

/// A pair of the row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) patch: u32,
    /// The unoccluded form factor.
    pub(crate) unoccluded: f64,
    /// The visible fraction, 0 to 1.
    pub(crate) fraction: f64,
    /// Unoccluded A_i F_ij, the same bits from both sides.
    pub(crate) exchange_area: f64,
    /// z = `exchange_area` · `per_area`: √((1/A_i² + 1/A_j²) / 2), or 1/A_i where the own row alone counts.
    per_area: f64,
    cell: PriorCell,
    /// True if `unoccluded` is an estimate from centroids: enough while nothing of the pair is seen.
    is_rough: bool,
}

impl Pair {
    /// A patch of which nothing is known.
    fn unseen(patch: u32) -> Self {
        Self {
            patch,
            unoccluded: 0.0,
            fraction: 0.0,
            exchange_area: 0.0,
            per_area: 0.0,
            cell: PriorCell::unseen(0),
            is_rough: false,
        }
    }

    /// The form factor.
    pub(crate) fn factor(&self) -> f64 {
        self.fraction * self.unoccluded
    }
}

/// Σ F of a row.
pub(crate) fn sum_of(row: &[Pair]) -> f64 {
    row.iter().map(Pair::factor).sum()
}

/// Returns whether something of a patch is visible in a row, ascending.
pub(crate) fn sees(row: &[Pair], patch: u32) -> bool {
    let place = row.binary_search_by_key(&patch, |pair| pair.patch);
    place.is_ok_and(|place| row[place].fraction > 0.0)
}

/// Inserts pairs into a row, ascending, or replaces the entries of their patches.
pub(crate) fn insert(row: &mut Vec<Pair>, pairs: &[Pair]) {
    let listed = row.len();
    for pair in pairs {
        match row[..listed].binary_search_by_key(&pair.patch, |pair| pair.patch) {
            Ok(place) => row[place] = *pair,
            Err(_) => row.push(*pair),
        }
    }
    row.sort_unstable_by_key(|pair| pair.patch);
}

/// Refines rows one after the other; one a thread.
#[derive(Debug)]
pub(crate) struct Refiner<'c> {
    refinement: Refinement,
    /// When this becomes true, rows are left as they are.
    cancel: Option<&'c AtomicBool>,
    pub(crate) pairs: Vec<Pair>,
    candidates: Candidates,
    exchanges: Exchanges,
    exchange_areas: Vec<f64>,
    /// Unseen pairs far from each other.
    far: Vec<Pair>,
    /// Found by [`Refiner::find_unseen`], ascending.
    pub(crate) unseen: Vec<Pair>,
    /// Expected error of each pair.
    contributions: Vec<ErrorContribution>,
    is_measured: Vec<bool>,
    /// Pairs that are measured in any case.
    is_probe: Vec<bool>,
    shaft: Shaft,
    exact: ExactVisibility,
    critical: CriticalCells,
    /// Measurements of this emitter's pairs; the first `measured_before`, of an earlier attempt at the row, ascending.
    measured: Vec<Measured>,
    measured_before: usize,
    measured_of: Option<InputPatch>,
}

/// The measurement of a pair.
#[derive(Clone, Copy, Debug)]
struct Measured {
    patch: u32,
    fraction: f64,
    unoccluded: f64,
    exchange_area: f64,
    cost: Refined,
}

/// Errors of a group's measured pairs: Σ F² (error)² found, and Σ F² d expected.
#[derive(Clone, Copy, Debug, Default)]
struct GroupErrors {
    squared: f64,
    expected: f64,
}

impl GroupErrors {
    /// Factor on the group's prior variances in this row, at least 1: the mean of 1 and of found over expected.
    fn inflation(self) -> f64 {
        if self.expected > 0.0 {
            (0.5 + 0.5 * self.squared / self.expected).max(1.0)
        } else {
            1.0
        }
    }
}

/// Limits of a row's measurements.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// λ.
    multiplier: f64,
    /// z √d above which a pair is measured.
    least: f64,
    /// Bound of the row's work, in steps.
    steps: u64,
}

/// Allowance of one pair's measurement.
#[derive(Clone, Copy, Debug)]
struct Allowance {
    /// λ.
    multiplier: f64,
    /// Bound of its work, in steps: what is left of the row's.
    steps: u64,
}

/// Result and cost of refining a row or a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Refined {
    /// Expected Σ (F − true F)².
    pub(crate) squared_error: f64,
    /// Σ v² over the pairs' expected squared errors v: half the variance of their sum, if errors are normal.
    pub(crate) squared_variances: f64,
    /// Σ F².
    pub(crate) squared_norm: f64,
    pub(crate) rays: u64,
    pub(crate) points: u64,
    pub(crate) shafts: u64,
    /// Work, in steps ([`crate::visibility::shaft`]).
    pub(crate) steps: u64,
    /// True if the bound of work ended the row with pairs unmeasured.
    pub(crate) cut_short: bool,
}

impl Refined {
    /// Adds the result and cost of a pair.
    fn add(&mut self, pair: Self) {
        self.squared_error += pair.squared_error;
        self.squared_variances += pair.squared_error * pair.squared_error;
        self.rays += pair.rays;
        self.points += pair.points;
        self.shafts += pair.shafts;
        self.steps += pair.steps;
        self.cut_short |= pair.cut_short;
    }
}

/// Bound of a row's steps at a tolerance of 1 %; of a finer one more in proportion, up to a hundred times, of a coarser
/// one less. A choice: about a second of one thread. With less, rows of many occluders end before they keep the
/// tolerance; with more, a scene takes longer than anyone waits.
const TOLERANCE_STEPS: f64 = 1e9;
/// Part of that bound for what is looked for beside a row: its prior variances, pairs that it lacks, its non-visible
/// shares. A choice: with more, searches in vain cost more; with less, they end before they find.
const BESIDE: u64 = 128;

/// Bound of one row's work at a tolerance T, in steps ([`crate::visibility::shaft`]): 10⁹ · 0.01 / T, at most 10¹¹.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10¹¹")]
fn most_steps(tolerance: f64) -> u64 {
    (TOLERANCE_STEPS * (0.01 / tolerance).min(100.0)) as u64
}

/// Bound of the steps of one search beside a row.
pub(crate) fn steps_beside(tolerance: f64) -> u64 {
    most_steps(tolerance) / BESIDE
}
/// Steps of a pair, about. If a row's bound leaves so many for each pair, their order does not matter.
const STEPS_A_PAIR: u64 = 30_000;
/// Number of rays that tell well enough how many more are needed.
const KNOWN_RAYS: usize = 256;
/// Number of rays from which on points are cheaper.
const MANY_RAYS: f64 = 131_072.0;
/// Bound of the points at one pair, about.
const MOST_POINTS: usize = 6_000;
/// Bound of the pairs of each group that are measured in any case. A choice: with fewer, a row whose centroid stands
/// badly for its patch is found less often; with more, every row pays for looking.
const PROBES: f64 = 6.0;
/// Nearness from which on centroids tell a form factor well enough to see whether it matters: 8 radii.
const FAR: u8 = 3;
/// Bound of the rays at one pair.
const MOST_RAYS: usize = 262_144;

impl<'c> Refiner<'c> {
    pub(crate) fn new(refinement: Refinement, cancel: Option<&'c AtomicBool>) -> Self {
        Self {
            refinement,
            cancel,
            pairs: Vec::new(),
            candidates: Candidates::default(),
            exchanges: Exchanges::new(refinement.rule),
            exchange_areas: Vec::new(),
            far: Vec::new(),
            unseen: Vec::new(),
            contributions: Vec::new(),
            is_measured: Vec::new(),
            is_probe: Vec::new(),
            shaft: Shaft::default(),
            exact: ExactVisibility::default(),
            critical: CriticalCells::default(),
            measured: Vec::new(),
            measured_before: 0,
            measured_of: None,
        }
    }

    /// Returns whether each pair is measured to the tolerance by itself: nothing of a row is unseen or uncertain then.
    pub(crate) fn measures_each(&self) -> bool {
        self.refinement.each
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }

    /// If `strict`, takes no prior variance for measured and aims at half the error from now on. Returns the refinement
    /// before, for [`Self::set`].
    pub(crate) fn make_strict(&mut self, strict: bool) -> Refinement {
        let before = self.refinement;
        if strict {
            self.refinement.priors = PriorVariances::default();
            self.refinement.effort *= 0.5;
            self.refinement.multiplier *= 16.0;
            self.measured_of = None;
        }
        before
    }

    /// Sets the refinement of the rows to come.
    pub(crate) fn set(&mut self, refinement: Refinement) {
        self.refinement = refinement;
    }

    /// Refines a row of the patches that its hemicubes saw, ascending, with their visible fractions. Afterwards
    /// `self.pairs` is the row, ascending.
    ///
    /// `is_large`: the emitter has several hemicubes for its size. Another attempt at the last emitter's row takes over
    /// what was measured.
    pub(crate) fn row(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        is_large: bool,
        receives: impl Fn(u32) -> bool,
        caster: &mut Caster<'_>,
    ) -> Refined {
        let emitter = &Emitter::new(model, emitter);
        if self.refinement.each {
            return self.measure_exactly(emitter, receives);
        }
        let budget = self.begin(emitter, seen, is_large, receives);
        self.begin_measuring(emitter.patch);
        let most_steps = self.refinement.most_steps();
        if is_large {
            let tolerance = self.refinement.tolerance * self.refinement.effort;
            let mut refined = self.measure_all(emitter, tolerance, most_steps, caster);
            self.pairs.sort_unstable_by_key(|pair| pair.patch);
            refined.squared_norm = self.squared_norm();
            return refined;
        }
        self.find_contributions(emitter.area);
        let limits = self.limits(budget, most_steps);
        let mut refined = Refined::default();
        self.find_probes(emitter.number());
        self.measure(emitter, limits, &mut refined, caster);
        if self.refinement.proves {
            self.prove_seen(emitter, most_steps, &mut refined);
        }
        self.pairs.sort_unstable_by_key(|pair| pair.patch);
        refined.squared_norm = self.squared_norm();
        refined
    }

    /// Orders the measurements, to be looked up.
    fn sort_measured(&mut self) {
        self.measured.sort_unstable_by_key(|measured| measured.patch);
    }

    /// Keeps the measurements of an earlier attempt at the same emitter, and forgets those of another.
    fn begin_measuring(&mut self, emitter: InputPatch) {
        if self.measured_of == Some(emitter) {
            self.sort_measured();
        } else {
            self.measured.clear();
        }
        self.measured_before = self.measured.len();
        self.unseen.clear();
        self.measured_of = Some(emitter);
    }

    /// Expected errors of a row's pairs, from the hemicube's fractions.
    pub(crate) fn expected_errors(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
    ) -> Vec<ErrorContribution> {
        let emitter = Emitter::new(model, emitter);
        self.begin(&emitter, seen, false, receives);
        self.find_contributions(emitter.area);
        self.contributions.clone()
    }

    fn find_contributions(&mut self, own_area: f64) {
        let priors = self.refinement.priors;
        self.contributions.clear();
        self.contributions.extend(self.pairs.iter().map(|pair| {
            let own = pair.unoccluded * priors.of(pair.cell).sqrt();
            ErrorContribution {
                both: own * pair.per_area * own_area,
                own,
                is_near: pair.cell.nearness == 0,
            }
        }));
    }

    /// The row's multiplier: the scene's, or a larger one where the row by itself would be too far off. And the z √d
    /// from which on pairs are measured.
    fn limits(&self, budget: f64, steps: u64) -> Limits {
        let gain = self.refinement.gain;
        let mut multiplier = self.refinement.multiplier;
        if multiplier <= 0.0 {
            multiplier = multiplier_for(self.contributions.iter(), FRACTIONS_SHARE * budget, gain);
            let least = MEASURED_FROM / multiplier.sqrt();
            return Limits {
                multiplier,
                least,
                steps,
            };
        }
        let most = FRACTIONS_SHARE * (ROW_SUM * self.refinement.tolerance).powi(2);
        let left = self.contributions.iter().map(|pair| pair.left(multiplier, gain));
        if left.sum::<f64>() > most {
            multiplier = multiplier_for(self.contributions.iter(), most, gain).max(multiplier);
        }
        let mut least = MEASURED_FROM / multiplier.sqrt();
        let unmeasured = |least: f64| -> f64 {
            let kept = self.contributions.iter().filter(|pair| pair.both <= least);
            kept.map(|pair| pair.own * pair.own).sum()
        };
        while unmeasured(least) > FRACTIONS_SHARE * budget {
            least *= 0.7;
        }
        Limits {
            multiplier,
            least,
            steps,
        }
    }

    /// Lists the pairs: the seen ones, and unseen ones that could be large. Returns the row's permitted squared error.
    fn begin(
        &mut self,
        emitter: &Emitter<'_>,
        seen: impl Iterator<Item = (u32, f64)>,
        is_large: bool,
        receives: impl Fn(u32) -> bool,
    ) -> f64 {
        self.pairs.clear();
        self.pairs.extend(seen.map(|(patch, fraction)| Pair {
            fraction,
            cell: PriorCell {
                class: class_of(fraction),
                nearness: 0,
            },
            ..Pair::unseen(patch)
        }));
        let seen_count = self.pairs.len();
        self.exchanges.begin(&emitter.corners);
        self.evaluate_from(emitter, 0);
        let budget = self.refinement.budget(self.squared_norm());
        let least = if is_large {
            large::least_factor(self.pairs.iter().map(|pair| pair.unoccluded))
        } else {
            REACH * budget.sqrt()
        };
        if least > 0.0 && least < 1.0 {
            let from = Least {
                near: least,
                far: least,
            };
            let tree = Tree::of(emitter.model.geometry());
            self.candidates.find(&tree, emitter.patch.0, &emitter.corners, from);
            let mut known = 0;
            for &patch in &self.candidates.patches {
                while known < seen_count && self.pairs[known].patch < patch {
                    known += 1;
                }
                let is_known = known < seen_count && self.pairs[known].patch == patch;
                if is_known || !receives(patch) {
                    continue;
                }
                let corners = emitter.model.normalised_corners(patch);
                let nearness = nearness_of(&emitter.corners, &corners);
                let mut pair = Pair {
                    per_area: inverse_area(emitter.area, area(&corners)),
                    cell: PriorCell::unseen(nearness),
                    ..Pair::unseen(patch)
                };
                if nearness >= FAR {
                    pair.is_rough = true;
                    pair.unoccluded = by_centroids(&emitter.corners, &corners);
                    self.far.push(pair);
                } else {
                    self.pairs.push(pair);
                }
            }
            self.evaluate_from(emitter, seen_count);
            self.pairs.append(&mut self.far);
        }
        budget
    }

    fn squared_norm(&self) -> f64 {
        self.pairs.iter().map(|p| (p.unoccluded * p.fraction).powi(2)).sum()
    }

    /// Measures by rays how far the hemicube's fractions of some of a row's pairs are off, and adds to `sums`. Returns
    /// Σ F² of the row by the hemicube's fractions.
    ///
    /// Pairs of each class are drawn in proportion to F, about [`PRIOR_PAIRS`] of them, and weighted by F² over their
    /// chance.
    pub(crate) fn measure_priors(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
        sums: &mut PriorSums,
    ) -> f64 {
        let emitter = Emitter::new(model, emitter);
        self.begin(&emitter, seen, false, receives);
        let regions = CoplanarRegions::of(model);
        let obstacles = Obstacles::new(model, &regions);
        for class in 0..CLASSES {
            let mut steps = 0;
            let of_class = |pair: &&Pair| usize::from(pair.cell.class) == class;
            let total: f64 = self.pairs.iter().filter(of_class).map(|pair| pair.unoccluded).sum();
            for pair in self.pairs.iter().filter(of_class).filter(|pair| pair.unoccluded > 0.0) {
                let chance = (PRIOR_PAIRS * pair.unoccluded / total).min(1.0);
                if steps >= steps_beside(self.refinement.tolerance) {
                    break;
                }
                let seed = seed(&emitter, pair.patch);
                if splitmix::unit(splitmix::hash(seed.wrapping_add(splitmix::STEP))) >= chance {
                    continue;
                }
                let corners = model.normalised_corners(pair.patch);
                self.shaft.clear();
                let triangles =
                    self.shaft
                        .pair(obstacles, emitter.triangle(), PatchTriangle::new(pair.patch, &corners));
                steps += triangles.steps;
                let fraction = if let Some(fraction) = triangles.proved_fraction() {
                    fraction
                } else {
                    let mut cast = Cast::default();
                    let first = self
                        .shaft
                        .cast(obstacles, &triangles, PRIOR_FIRST_RAYS, seed, &mut cast);
                    let by_first = cast.fraction();
                    let rays = self.shaft.cast(obstacles, &triangles, PRIOR_RAYS, seed, &mut cast);
                    steps += cast.steps;
                    let Some(fraction) = cast.fraction() else { continue };
                    if let (Some(by_first), true) = (by_first, rays > first) {
                        let usual = variance_of_rays(first as f64) - variance_of_rays(rays as f64);
                        let spread = fraction * (1.0 - fraction) * usual;
                        sums.add_rays(
                            (by_first - fraction).powi(2),
                            spread,
                            pair.unoccluded * pair.unoccluded / chance,
                        );
                    }
                    fraction
                };
                let weight = pair.unoccluded * pair.unoccluded / chance;
                sums.add(pair.cell, (fraction - pair.fraction).powi(2), weight);
            }
        }
        self.squared_norm()
    }

    /// Evaluates the closed forms of the pairs from place `start` on.
    fn evaluate_from(&mut self, emitter: &Emitter<'_>, start: usize) {
        self.exchange_areas.clear();
        self.exchange_areas.resize(self.pairs.len() - start, 0.0);
        for (place, pair) in self.pairs[start..].iter_mut().enumerate() {
            let corners = emitter.model.normalised_corners(pair.patch);
            self.exchanges.add(place, &corners, &mut self.exchange_areas);
            pair.cell.nearness = nearness_of(&emitter.corners, &corners);
            pair.per_area = inverse_area(emitter.area, area(&corners));
        }
        self.exchanges.finish(&mut self.exchange_areas);
        for (pair, exchange_area) in self.pairs[start..].iter_mut().zip(&self.exchange_areas) {
            pair.unoccluded = exchange_area / emitter.area;
            pair.exchange_area = *exchange_area;
        }
    }

    /// Measures the fractions of the pairs whose z √d exceeds `limits.least`, and of the probes.
    fn measure(&mut self, emitter: &Emitter<'_>, limits: Limits, refined: &mut Refined, caster: &mut Caster<'_>) {
        // Where one point stands badly for a patch, all fractions of a group are off at once. So some pairs of each
        // group are measured in any case, and if they are off, so may be others.
        let mut found = [GroupErrors::default(); GROUPS];
        self.is_measured.clear();
        self.is_measured.resize(self.pairs.len(), false);
        let mut is_first = true;
        loop {
            let inflation = found.map(|f| f.inflation());
            let expected =
                |place: usize| self.contributions[place].both * inflation[self.pairs[place].cell.group()].sqrt();
            let mut wanted: Vec<(f64, usize)> = (0..self.pairs.len())
                .filter(|&place| !self.is_measured[place])
                .map(|place| (expected(place), place))
                .filter(|&(error, place)| error > limits.least || (is_first && self.is_probe[place]))
                .collect();
            if wanted.is_empty() || refined.cut_short {
                break;
            }
            is_first = false;
            // Where the steps may not do for all, the largest errors first.
            if refined.steps + wanted.len() as u64 * STEPS_A_PAIR > limits.steps {
                wanted.sort_by(|p, q| q.0.total_cmp(&p.0).then(p.1.cmp(&q.1)));
            }
            for (_, place) in wanted {
                if refined.steps >= limits.steps || self.is_cancelled() {
                    refined.cut_short = true;
                    break;
                }
                let (group, contribution) = (self.pairs[place].cell.group(), self.contributions[place]);
                let before = self.pairs[place].fraction;
                self.measure_pair(emitter, place, limits, refined, caster);
                let pair = &self.pairs[place];
                found[group].squared += (pair.unoccluded * (pair.fraction - before)).powi(2);
                found[group].expected += contribution.own * contribution.own;
                self.is_measured[place] = true;
            }
        }
        for (place, contribution) in self.contributions.iter().enumerate() {
            if !self.is_measured[place] {
                let inflation = found[self.pairs[place].cell.group()].inflation();
                let squared = inflation * contribution.own.powi(2);
                refined.squared_error += squared;
                refined.squared_variances += squared * squared;
            }
        }
    }

    /// Draws probes: pairs of each group in proportion to their part in its expected squared error, evenly through the
    /// row.
    fn find_probes(&mut self, number: u32) {
        let mut totals = [0.0; GROUPS];
        for (contribution, pair) in self.contributions.iter().zip(&self.pairs) {
            totals[pair.cell.group()] += contribution.own * contribution.own;
        }
        let steps = totals.map(|total| total / PROBES);
        let first = splitmix::unit(splitmix::hash(u64::from(number).wrapping_add(splitmix::STEP)));
        let mut next = steps.map(|step| first * step);
        let mut sums = [0.0; GROUPS];
        self.is_probe.clear();
        for (contribution, pair) in self.contributions.iter().zip(&self.pairs) {
            let group = pair.cell.group();
            sums[group] += contribution.own * contribution.own;
            let is_probe = contribution.own > 0.0 && sums[group] > next[group];
            while steps[group] > 0.0 && next[group] < sums[group] {
                next[group] += steps[group];
            }
            self.is_probe.push(is_probe);
        }
    }

    /// Measures the fraction of a pair, or takes it over from an earlier attempt at the row.
    fn measure_pair(
        &mut self,
        emitter: &Emitter<'_>,
        place: usize,
        limits: Limits,
        refined: &mut Refined,
        caster: &mut Caster<'_>,
    ) {
        let patch = self.pairs[place].patch;
        let before = self.measured[..self.measured_before].binary_search_by_key(&patch, |measured| measured.patch);
        if let Ok(at) = before {
            let (measured, pair) = (self.measured[at], &mut self.pairs[place]);
            pair.fraction = measured.fraction;
            if pair.is_rough {
                pair.unoccluded = measured.unoccluded;
                pair.exchange_area = measured.exchange_area;
                pair.is_rough = false;
            }
            refined.add(measured.cost);
            return;
        }
        let allowed = Allowance {
            multiplier: limits.multiplier,
            steps: limits.steps.saturating_sub(refined.steps),
        };
        let cost = self.measure_anew(emitter, place, allowed, caster);
        refined.add(cost);
        let pair = &self.pairs[place];
        self.measured.push(Measured {
            patch,
            fraction: pair.fraction,
            unoccluded: pair.unoccluded,
            exchange_area: pair.exchange_area,
            cost,
        });
    }

    /// Measures the fraction of a pair: by proof, by rays, or exactly from points. Returns its error and cost. A pair
    /// that meets its allowance keeps what its rays and points so far say, by their error.
    fn measure_anew(
        &mut self,
        emitter: &Emitter<'_>,
        place: usize,
        allowed: Allowance,
        caster: &mut Caster<'_>,
    ) -> Refined {
        let mut refined = Refined::default();
        let regions = CoplanarRegions::of(emitter.model);
        let obstacles = Obstacles::new(emitter.model, &regions);
        let pair = &mut self.pairs[place];
        let corners = emitter.model.normalised_corners(pair.patch);
        self.shaft.clear();
        let triangles = self
            .shaft
            .pair(obstacles, emitter.triangle(), PatchTriangle::new(pair.patch, &corners));
        refined.shafts += 1;
        refined.steps += triangles.steps;
        if triangles.is_occluded {
            pair.fraction = 0.0;
            return refined;
        }
        if pair.is_rough {
            pair.exchange_area = factor::exchange(&emitter.corners, &corners, &self.refinement.rule);
            pair.unoccluded = pair.exchange_area / emitter.area;
            pair.is_rough = false;
        }
        if triangles.is_unoccluded() {
            pair.fraction = 1.0;
            return refined;
        }
        let seed = seed(emitter, pair.patch);
        let z = pair.exchange_area * pair.per_area;
        let ray = match (triangles.is_crowded, triangles.is_near) {
            (true, _) => TREE_RAY,
            (false, true) => NEAR_RAY,
            (false, false) => 1.0,
        };
        let mut cast = Cast::default();
        let mut next = if triangles.is_near { 2 * RAYS } else { RAYS };
        let is_there = caster.is_there();
        let (rays, spread) = loop {
            let mut ask = |rays: &Rays<'_>| caster.cast(rays);
            let ask = is_there.then_some(&mut ask as Asked<'_>);
            let rays = self
                .shaft
                .cast_asking(obstacles, &triangles, next, seed, &mut cast, ask);
            let smooth = smoothed(cast.fraction().unwrap_or(0.5), rays as f64);
            let gain = self.refinement.gain.factor();
            let parts = cast.deviations(&triangles);
            let spread = Spread::of(parts.of(), parts.part * rays as f64, smooth * (1.0 - smooth), gain);
            let wanted = spread.rays_worth(z * z * allowed.multiplier, ray);
            let is_poor = cast.sums.all <= 0.0 || (triangles.is_near && rays < RAYS);
            if is_poor || (wanted > MANY_RAYS && rays >= KNOWN_RAYS) {
                let precision = Precision {
                    // As much as those rays would leave.
                    enough: spread.squared_error(wanted).sqrt(),
                    most_points: MOST_POINTS,
                    most_steps: allowed.steps.saturating_sub(refined.steps + cast.steps),
                    along_contacts: false,
                };
                let exact = self.exact.measure(&self.shaft, &regions, &triangles, precision);
                refined.steps += self.exact.steps();
                refined.cut_short |= self.exact.steps() >= precision.most_steps;
                if let Some(exact) = exact {
                    refined.steps += cast.steps;
                    // Below its own error, it is no evidence that anything is visible.
                    pair.fraction = if exact.fraction > exact.error {
                        exact.fraction
                    } else {
                        0.0
                    };
                    refined.rays += rays as u64;
                    refined.points += exact.points as u64;
                    refined.squared_error += (exact.error * pair.unoccluded).powi(2);
                    return refined;
                }
            }
            let Some(more) = ladder::next(next, wanted, MOST_RAYS, RAYS).filter(|&more| more > rays) else {
                break (rays, spread);
            };
            next = more;
            // The next rays cost what the rays so far did, about.
            let dear = cast.steps / rays.max(1) as u64 * next.saturating_sub(rays) as u64;
            if refined.steps + cast.steps + dear > allowed.steps {
                refined.cut_short = true;
                break (rays, spread);
            }
        };
        refined.rays += rays as u64;
        refined.steps += cast.steps;
        // Where no ray had weight, as between planes that all but coincide, the centroid's fraction is all there is.
        if let Some(fraction) = cast.fraction() {
            pair.fraction = fraction;
        }
        refined.squared_error += pair.unoccluded.powi(2) * spread.squared_error(rays.max(1) as f64);
        refined
    }
}

/// A visible fraction that so many rays found, for their spread: a few rays that agree do not prove that all would
/// (Laplace's rule of succession, for half a ray).
fn smoothed(fraction: f64, rays: f64) -> f64 {
    (fraction * rays + 0.5) / (rays + 1.0)
}

/// A form factor by the kernel between centroids, with the greatest height of either triangle above the other's plane.
fn by_centroids(i: &[DVec3; 3], j: &[DVec3; 3]) -> f64 {
    let (n, m) = (cross(i), cross(j));
    let between = centroid(j) - centroid(i);
    let square = between.length_squared();
    let highest = |n: DVec3, from: DVec3, t: &[DVec3; 3]| t.iter().map(|&p| n.dot(p - from)).fold(0.0, f64::max);
    let (up, back) = (highest(n, i[0], j) / n.length(), highest(m, j[0], i));
    0.5 * up * back / (std::f64::consts::PI * square * square)
}

/// √((1/A_i² + 1/A_j²) / 2), the same bits in both directions: z = √((F_ij² + F_ji²) / 2) = `inverse_area` · A_i F_ij.
fn inverse_area(i: f64, j: f64) -> f64 {
    (0.5 / (i * i) + 0.5 / (j * j)).sqrt()
}

/// Number of pairs of each class, about, at which prior variances are measured in a row.
const PRIOR_PAIRS: f64 = 16.0;
/// Rays at each of them, and the first of them: their difference tells what rays leave in this scene. All of them leave
/// n^(−5/4) / 4 ≤ 10⁻⁴ of squared error, a twentieth of the least prior variance.
const PRIOR_RAYS: usize = 512;
const PRIOR_FIRST_RAYS: usize = 64;

/// The seed of a pair, the same in both directions.
fn seed(emitter: &Emitter<'_>, patch: u32) -> u64 {
    let [i, j] = [emitter.patch.0, patch].map(|patch| emitter.model.number_of(patch));
    (u64::from(i.min(j)) << 32 | u64::from(i.max(j))).wrapping_mul(splitmix::STEP)
}
