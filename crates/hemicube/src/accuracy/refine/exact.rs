//! Rows of which every entry keeps the tolerance: exact visibility, pair by pair.
//!
//! A pair that its shaft proves unoccluded has its closed form to 1e-10 ([`FactorRule::exact`]), a hidden one has none.
//! Otherwise what its occluders block is integrated to an error bound ([`CriticalCells`]):
//!
//! ```text
//! |F − true F| ≤ 0.3 T max(F, 0.01)
//! ```
//!
//! in both directions. Rays come first where they are cheaper, by steps: between patches of a city or round a sphere,
//! with many occluders and small factors. They do if their expected error is a third of that. Between near patches they
//! come first with many occluders only.
//! They are also what a pair with more occluders falls back to than shadows are taken of; its expected error is in the
//! row's.
//!
//! Quantities of a pair are the same bits from both of its patches. So a table keeps them for the other row: what a row
//! holds does not depend on which of the two came first.
//!
//! [`FactorRule::exact`]: crate::factor::FactorRule::exact

use super::{Pair, Refined, Refiner, inverse_area, seed, smoothed};
use crate::Model;
use crate::accuracy::error_model::variance_of_rays;
use crate::accuracy::ladder::{self, GROWTH, rays_to_leave, whole_net};
use crate::accuracy::row::Emitter;
use crate::accuracy::spread::Spread;
use crate::bvh::Tree;
use crate::factor::exchange;
use crate::geometry::{Plane, area, bounds, cross};
use crate::store::ERRORS;
use crate::visibility::bodies::Bodies;
use crate::visibility::candidates::Least;
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::exact::critical::Bound;
use crate::visibility::segments::Obstacles;
use crate::visibility::shaft::{Cast, PatchTriangle, RAYS, TrianglePair};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Tolerance up to which larger scenes measure entries to a bound: rays at the same error take half the time at 0.04 %
/// and twice the time at 0.01 % (room of 864 patches).
const FINEST_OF_LARGE: f64 = 1e-4;
/// Error permitted of a pair, in tolerances: three of them are within it.
const EACH_SHARE: f64 = 1.0 / ERRORS;
/// Form factor below which a pair's error is relative to this instead of to the factor: part of what is promised of pairs
/// at a fine tolerance (docs/accuracy.md), T/3 max(F, 0.01).
const SMALL_FACTOR: f64 = 1e-2;
/// Bound of the rays at a pair.
const EACH_RAYS: usize = 1 << 18;
/// Patches a wall, on average, from which larger scenes have few occluders between two patches.
const PATCHES_A_WALL: usize = 4;
/// Number of patches up to which pairs are kept for their other row: 24 bytes a pair, 50 MB.
const MOST_KEPT: usize = 2_048;
/// Bound of the points at one pair at 0.01 %, times the square of the number of its occluders and one: a point's cost
/// grows so. At a finer tolerance T, more by 0.01 % / T, up to a hundred times: few pairs meet the bound, and the finer
/// one says how far a pair that does is off.
const MOST_POINTS: f64 = 2e6;
/// Tolerance from which on pairs may take more points.
const FINE: f64 = 1e-4;
/// Rays at a pair before it is asked how many it needs.
const FIRST_RAYS: usize = 256;
/// Steps of exact visibility for the square of the number of occluders: of 100 points, each with a test of every shadow
/// against every other. Measured, within a factor of three.
const STEPS_OF_SHADOWS: u64 = 500;
/// Number of occluders up to which no rays come first between near patches. A few of these rays have most of the
/// weight, and may not have been drawn yet where all others agree: of a pair a hundredth as high as far apart, 4,096
/// did, and all of its factor was wrong.
const MOST_SHADOWS: u64 = 24;
/// Part of a pair's closed form that the sums of its shadows may be off by rounding. Measured: cells come to 10⁻¹¹ where
/// nothing is visible; ten times that.
const ROUNDING: f64 = 1e-10;
/// Share of the permitted error that rays may be expected to have: theirs is no bound.
const RAYS_SHARE: f64 = 1.0 / 3.0;

/// Returns whether a scene too large to have every pair measured at any fine tolerance has it at this one.
pub(crate) fn is_worth(model: &Model, tolerance: f64) -> bool {
    tolerance <= FINEST_OF_LARGE
        && model.patches().len() <= MOST_KEPT
        && CoplanarRegions::of(model).len() as usize * PATCHES_A_WALL <= model.geometry().surfaces.len()
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "at most 10¹⁰, and positive"
)]
fn most_points(tolerance: f64) -> usize {
    (MOST_POINTS * (FINE / tolerance).clamp(1.0, 100.0)) as usize
}

/// A pair, measured.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MeasuredPair {
    /// Unoccluded A_i F_ij.
    exchange_area: f64,
    fraction: f64,
    /// Error of A_i F_ij: a bound, or an expectation by rays.
    error: f32,
    /// Number of points or rays.
    points: u32,
}

impl MeasuredPair {
    const HIDDEN: Self = Self {
        exchange_area: 0.0,
        fraction: 0.0,
        error: 0.0,
        points: 0,
    };
}

/// A pair whose fraction rays measure, to an expected error of its exchange area.
struct PairOfRays {
    pair: TrianglePair,
    seed: u64,
    bound: Bound,
}

/// Pairs measured so far at a tolerance, by patches.
#[derive(Debug)]
pub(super) struct PairTable {
    /// Bits of the tolerance.
    tolerance: u64,
    /// True for patches of which something in their plane may hide a part: their pairs differ by direction.
    is_covered: Vec<bool>,
    pairs: Vec<[AtomicU64; 3]>,
}

/// The last table of a scene.
#[derive(Debug, Default)]
struct LastTable(Mutex<Option<Arc<PairTable>>>);

/// In place of a fraction: not measured. No fraction has these bits.
const UNKNOWN: u64 = u64::MAX;

impl PairTable {
    /// The table of a scene for a tolerance, shared by the threads of a run; `None` where it would be too large.
    fn of(model: &Model, tolerance: f64) -> Option<Arc<Self>> {
        if model.patches().len() > MOST_KEPT {
            return None;
        }
        let last = model.geometry().kept(|_| LastTable::default());
        let mut last = last.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = last.take().filter(|table| table.tolerance == tolerance.to_bits());
        let table = known.unwrap_or_else(|| Arc::new(Self::new(model, tolerance)));
        *last = Some(Arc::clone(&table));
        Some(table)
    }

    fn new(model: &Model, tolerance: f64) -> Self {
        let count = model.patches().len();
        let unknown = || [AtomicU64::new(UNKNOWN), AtomicU64::new(0), AtomicU64::new(0)];
        Self {
            tolerance: tolerance.to_bits(),
            is_covered: covered(model),
            pairs: (0..count * count.saturating_sub(1) / 2).map(|_| unknown()).collect(),
        }
    }

    /// The place of a pair that is the same in both directions.
    fn place(&self, i: u32, j: u32) -> Option<usize> {
        let (low, high) = (i.min(j) as usize, i.max(j) as usize);
        let is_symmetric = low != high && !self.is_covered[low] && !self.is_covered[high];
        is_symmetric.then(|| high * (high - 1) / 2 + low)
    }

    fn get(&self, place: usize) -> Option<MeasuredPair> {
        let [fraction, exchange_area, rest] = &self.pairs[place];
        let fraction = fraction.load(Ordering::Acquire);
        if fraction == UNKNOWN {
            return None;
        }
        let rest = rest.load(Ordering::Relaxed);
        #[allow(clippy::cast_possible_truncation, reason = "two halves")]
        Some(MeasuredPair {
            exchange_area: f64::from_bits(exchange_area.load(Ordering::Relaxed)),
            fraction: f64::from_bits(fraction),
            error: f32::from_bits(rest as u32),
            points: (rest >> 32) as u32,
        })
    }

    fn set(&self, place: usize, pair: MeasuredPair) {
        let [fraction, exchange_area, rest] = &self.pairs[place];
        exchange_area.store(pair.exchange_area.to_bits(), Ordering::Relaxed);
        let both = u64::from(pair.points) << 32 | u64::from(pair.error.to_bits());
        rest.store(both, Ordering::Relaxed);
        fraction.store(pair.fraction.to_bits(), Ordering::Release);
    }
}

/// Marks patches with another region in their plane whose box overlaps theirs.
fn covered(model: &Model) -> Vec<bool> {
    let regions = CoplanarRegions::of(model);
    let tolerance = model.geometry().plane_tolerance;
    let patches: Vec<_> = model
        .patches()
        .iter()
        .map(|patch| {
            let corners = model.normalised_corners(patch.0);
            let normal = cross(&corners).normalize_or_zero();
            let plane = Plane {
                normal,
                offset: normal.dot(corners[0]),
            };
            (regions.of_patch[patch.0 as usize], plane, corners, bounds(&corners))
        })
        .collect();
    let mut marks = vec![false; patches.len()];
    for (i, (region, plane, _, (low, high))) in patches.iter().enumerate() {
        marks[i] = patches.iter().any(|(other_region, other, corners, (least, most))| {
            region != other_region
                && plane.normal.dot(other.normal).abs() > 0.99
                && corners.iter().all(|&p| plane.height(p).abs() <= 2.0 * tolerance)
                && {
                    let overlap = (high.min(*most) - low.max(*least)).to_array();
                    overlap.iter().all(|&x| x >= -tolerance) && overlap.iter().filter(|&&x| x > tolerance).count() >= 2
                }
        });
    }
    marks
}

impl Refiner<'_> {
    /// Measures every pair of a row to the tolerance by itself.
    pub(super) fn measure_exactly(&mut self, emitter: &Emitter<'_>, receives: impl Fn(u32) -> bool) -> Refined {
        let model = emitter.model;
        let tree = Tree::of(model.geometry());
        let regions = CoplanarRegions::of(model);
        let obstacles = Obstacles::new(model, &regions);
        let bodies = model.geometry().kept(|_| Bodies::new(&regions));
        let table = PairTable::of(model, self.refinement.tolerance);
        let all = Least {
            near: f64::MIN_POSITIVE,
            far: f64::MIN_POSITIVE,
        };
        self.candidates.find(&tree, emitter.patch.0, &emitter.corners, all);
        let patches = std::mem::take(&mut self.candidates.patches);
        self.pairs.clear();
        let mut refined = Refined::default();
        for &patch in patches.iter().filter(|&&patch| receives(patch)) {
            if self.is_cancelled() {
                refined.cut_short = true;
                break;
            }
            let place = table.as_ref().and_then(|table| table.place(emitter.patch.0, patch));
            let known = place.and_then(|place| table.as_ref()?.get(place));
            let measured = known.unwrap_or_else(|| self.measure_to_a_bound(emitter, obstacles, &bodies, patch));
            if let (None, Some(place), Some(table)) = (known, place, &table) {
                table.set(place, measured);
            }
            refined.points += u64::from(measured.points);
            if measured.exchange_area <= 0.0 {
                continue;
            }
            refined.squared_error += (f64::from(measured.error) / emitter.area).powi(2);
            self.pairs.push(Pair {
                unoccluded: measured.exchange_area / emitter.area,
                fraction: measured.fraction,
                exchange_area: measured.exchange_area,
                per_area: inverse_area(emitter.area, area(&model.normalised_corners(patch))),
                ..Pair::unseen(patch)
            });
        }
        self.candidates.patches = patches;
        refined.squared_norm = self.squared_norm();
        refined
    }

    fn measure_to_a_bound(
        &mut self,
        emitter: &Emitter<'_>,
        obstacles: Obstacles<'_>,
        bodies: &Bodies,
        patch: u32,
    ) -> MeasuredPair {
        let corners = emitter.model.normalised_corners(patch);
        self.shaft.clear();
        let pair = self
            .shaft
            .pair(obstacles, emitter.triangle(), PatchTriangle::new(patch, &corners));
        if pair.is_occluded {
            return MeasuredPair::HIDDEN;
        }
        let exchange_area = exchange(&emitter.corners, &corners, &self.refinement.rule);
        let mut measured = MeasuredPair {
            exchange_area,
            fraction: 1.0,
            ..MeasuredPair::HIDDEN
        };
        if pair.is_unoccluded() || exchange_area <= 0.0 {
            return measured;
        }
        let least = SMALL_FACTOR * emitter.area.min(area(&corners));
        let bound = Bound {
            unoccluded: exchange_area,
            share: EACH_SHARE * self.refinement.tolerance,
            least,
            most_points: most_points(self.refinement.tolerance),
        };
        // By rays as long as they are cheaper: with many occluders and a small factor.
        let listed = self.shaft.regions(obstacles.regions, &pair).count() as u64;
        let most_steps = if pair.is_crowded {
            u64::MAX
        } else if pair.is_near && listed <= MOST_SHADOWS {
            0
        } else {
            STEPS_OF_SHADOWS * listed * listed
        };
        let by_rays = PairOfRays {
            pair,
            seed: seed(emitter, patch),
            bound,
        };
        if self.cast_to(obstacles, &by_rays, most_steps, &mut measured) {
            return measured;
        }
        let pair = &by_rays.pair;
        #[allow(clippy::cast_possible_truncation, reason = "an estimate, and a bounded number")]
        if let Some(blocked) = self
            .critical
            .measure(&self.shaft, obstacles.regions, bodies, pair, bound)
        {
            let visible = exchange_area - blocked.exchange;
            // Below its own error, it is no evidence that anything is visible.
            measured.fraction = if visible > blocked.error.max(ROUNDING * exchange_area) {
                (visible / exchange_area).min(1.0)
            } else {
                0.0
            };
            measured.error = blocked.error as f32;
            measured.points = blocked.points as u32;
            return measured;
        }
        self.cast_to(obstacles, &by_rays, u64::MAX, &mut measured);
        measured
    }

    /// Measures a fraction by rays to an expected error of the exchange area, with [`EACH_RAYS`] rays at most; returns
    /// whether rays of `most_steps` did.
    fn cast_to(
        &self,
        obstacles: Obstacles<'_>,
        by_rays: &PairOfRays,
        most_steps: u64,
        measured: &mut MeasuredPair,
    ) -> bool {
        let PairOfRays { pair, seed, bound } = by_rays;
        let mut cast = Cast::default();
        let mut wanted = FIRST_RAYS;
        // At first, a quarter of what all may cost: most of these rays are lost where they do not do.
        let mut all_steps = self.shaft.steps_of_rays(pair, wanted).saturating_mul(GROWTH as u64);
        while all_steps <= most_steps {
            self.shaft.cast(obstacles, pair, wanted, *seed, &mut cast);
            // Of two triangles that all but lie behind each other most segments weigh nothing.
            let rays = cast.worth().max(1.0);
            let seen = cast.fraction().unwrap_or(0.5);
            let smooth = smoothed(seen, rays);
            let variance = smooth * (1.0 - smooth);
            let parts = cast.deviations(pair);
            let squared = Spread::of(parts.of(), parts.part * rays, variance, 1.0).squared_error(rays);
            let error = squared.sqrt() * measured.exchange_area;
            measured.fraction = seen;
            #[allow(clippy::cast_possible_truncation, reason = "an estimate, and a bounded number")]
            {
                measured.error = error as f32;
                measured.points = cast.drawn as u32;
            }
            let enough = RAYS_SHARE * bound.enough((1.0 - smooth) * measured.exchange_area);
            if error <= enough {
                return true;
            }
            let one = squared / variance_of_rays(rays);
            let growth = rays_to_leave((enough / measured.exchange_area).powi(2) / one) / rays;
            let net = whole_net(wanted as f64 * growth, FIRST_RAYS, EACH_RAYS);
            let Some(more) = ladder::next(wanted, net, EACH_RAYS, RAYS) else {
                break;
            };
            wanted = more;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            {
                all_steps = (cast.steps as f64 * growth) as u64;
            }
        }
        false
    }
}
