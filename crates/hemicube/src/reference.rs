//! Reference rows: form factors from area to area by rays, with their own error, and no hemicube anywhere.
//!
//! ```text
//! F_ij = v_ij · A_i F⁰_ij / A_i        F⁰ the closed form with nothing in between, v the visible fraction
//! v_ij = Σ w V / Σ w                   over segments between the two patches, w in proportion to cos φ_i cos φ_j / r²
//! ```
//!
//! Both sums run over the *same* segments: the mean visibility of evenly drawn segments times the closed form is biased
//! exactly between near patches. Segments are drawn as points of the smaller patch and directions over the solid angle
//! of the other (Arvo 1995). Only a cosine is left as weight: nothing is singular between touching patches.
//!
//! Cosine-distributed rays from stratified points of the emitter find the pairs. Their hits are also a row by
//! themselves, without closed form and without visible fractions: the two must agree ([`ReferenceRow::agreement`]).
//!
//! The row's rest is estimated from patches hit once or twice (Good 1953). Patches without a hit are then taken up by a
//! bound of their form factor, all from some least bound on: so low, in the row's norm and in its sum, that the rest is
//! likely less than the target. Segments measure their visibility, too. If more rays are cheaper than looking at so
//! many patches, rays are cast first. If both would take more than [`ReferenceSettings::max_rays`] allows, the largest
//! bounds are looked at, and [`ReferenceRow::missed`] holds the rest.
//!
//! Visibility is that of backends ([`crate::backend`]): never the emitter's own surface, nor anything in or below its
//! plane; of surfaces in one plane the patch with the smaller id; the back of a one-sided surface occludes, and loses
//! to any patch in its own plane. What rests on a closed surface sees nothing of its inside, as for rows
//! (`visibility::spaces`): by coordinates alone, either may be in front. Rays are traced through a hierarchy with f32
//! boxes, widened by more than their rounding, and meet triangles in f64.
//!
//! Rows through mirrors, panes and images of a cell are those of [`Reference::with_portals`].
//!
//! Rows depend on the scene, the settings and the emitter only.

mod aggregate;
mod facing;
mod hemisphere;
mod measure;
mod pair;
mod portals;
mod random;
mod sensors;
mod visibility;

pub use aggregate::{draw_elements, row_of_sample, rows_of_patches};
pub use measure::{EstimatedRow, Interval, Measured, errors_against};
pub use sensors::{PointReference, PointReferenceRow};

use crate::Model;
use crate::visibility::spaces::Spaces;
use facing::Facing;
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::whole;
use hemisphere::{Hemisphere, Missing};
use pair::{BATCHES, Pair};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use visibility::{Met, Occluders, Sight};

/// Raised whenever the same settings give other rows: rows kept in files are of one version.
pub const VERSION: u32 = 1;

/// Precision of reference rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceSettings {
    /// The standard error aimed at, as a share of a row's Euclidean norm. The part likely missing of a row is as small
    /// a share of its sum, and the error of the escaped share is no larger.
    pub target: f64,
    /// Number of rays at which a row ends even off the target; its error says so. Where a ray is held against 64 n
    /// triangles on average, as where thousands of them lie in one place, it counts as n, rounded down.
    pub max_rays: u64,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            target: 3e-3,
            max_rays: 8_000_000,
            seed: 1,
        }
    }
}

/// The end of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayEnd {
    /// It meets nothing.
    Nothing,
    /// The back of a one-sided surface.
    Back,
    /// This patch.
    Patch(InputPatch),
}

/// Reason for which there are no reference rows.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum ReferenceError {
    /// The scene has no such patch.
    #[error("patch {patch} has no reference row: the scene has {count} patches, numbered from 0")]
    NoSuchPatch {
        /// The patch asked for.
        patch: u32,
        /// Number of patches.
        count: u32,
    },
    /// A target beyond any number of rays, or without meaning.
    #[error("reference target `{target}` is not between 0.00001 and 1; ask for 0.003, say")]
    Target {
        /// The target asked for.
        target: f64,
    },
    /// A row was asked for with hardly any rays.
    #[error("{max_rays} rays are too few for a reference row; allow at least {least}")]
    TooFewRays {
        /// The rays allowed.
        max_rays: u64,
        /// The least meaningful number.
        least: u64,
    },
}

/// A row of the reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceRow {
    /// The emitter.
    pub emitter: u32,
    /// The patches seen, ascending.
    pub columns: Vec<u32>,
    /// Their form factors.
    pub values: Vec<f64>,
    /// Standard errors of the form factors, from independent batches of rays and from the closed form's own error.
    pub errors: Vec<f64>,
    /// Share of rays without a hit.
    pub escaped: f64,
    /// Share of rays that meet the back of a one-sided patch.
    pub blocked: f64,
    /// Share that mirrors and panes hand on of arrivals; form factors are then of arrivals.
    pub passed: f64,
    /// Share that goes beyond the last image of a cell, or the last portal followed.
    pub cut_off: f64,
    /// The largest standard error of `escaped`, of `blocked` and of the two together.
    pub error_of_shares: f64,
    /// Estimated share of patches not found by rays.
    pub missed: f64,
    /// Standard error of `missed`.
    pub error_of_missed: f64,
    /// Estimated Σ F² over patches not found by rays.
    pub missed_squared: f64,
    /// Mean squared difference of the row from the counts of rays over the hemisphere, in squared standard errors, over
    /// patches with 16 hits or more. About 1 or less if both are right; much more if one is wrong.
    pub agreement: f64,
    /// Number of patches in `agreement`.
    pub agreement_count: u32,
    /// Rays traced.
    pub rays: u64,
    /// True if the bound on rays ended the row off its target.
    pub cut_short: bool,
}

impl ReferenceRow {
    /// Σ F².
    pub fn squared_norm(&self) -> f64 {
        self.values.iter().map(|f| f * f).sum()
    }

    /// The expected Σ (F − true F)², with the patches not found by rays.
    pub fn squared_error(&self) -> f64 {
        self.errors.iter().map(|e| e * e).sum::<f64>() + self.missed_squared
    }

    /// The row's standard error as a share of its norm; 0 for an empty row.
    pub fn noise(&self) -> f64 {
        let norm = self.squared_norm();
        if norm > 0.0 {
            (self.squared_error() / norm).sqrt()
        } else {
            0.0
        }
    }

    /// Σ F − passed + escaped + blocked + cut off, 1 but for errors.
    pub fn closure(&self) -> f64 {
        self.sum() - self.passed + self.escaped + self.blocked + self.cut_off
    }

    /// Σ F, with the likely missing part.
    pub fn sum(&self) -> f64 {
        self.values.iter().sum::<f64>() + self.missed
    }

    /// The standard error of [`Self::sum`].
    pub fn sum_noise(&self) -> f64 {
        let squares: f64 = self.errors.iter().map(|e| e * e).sum();
        (squares + self.error_of_missed.powi(2)).sqrt()
    }

    /// The standard error of [`Self::closure`].
    pub fn closure_noise(&self) -> f64 {
        self.sum_noise().hypot(self.error_of_shares)
    }
}

/// The standard error of rows together, as a share of their norm together.
pub fn noise_of(rows: &[ReferenceRow]) -> f64 {
    let norm: f64 = rows.iter().map(ReferenceRow::squared_norm).sum();
    let error: f64 = rows.iter().map(ReferenceRow::squared_error).sum();
    if norm > 0.0 { (error / norm).sqrt() } else { 0.0 }
}

/// Buffers, used for one row after the other.
#[derive(Debug)]
struct Scratch {
    hemisphere: Hemisphere,
    facing: Facing,
}

impl Scratch {
    fn new(model: &Model) -> Self {
        Self {
            hemisphere: Hemisphere::new(model.patches().len()),
            facing: Facing::default(),
        }
    }
}

/// A scene made ready for reference rows.
///
/// The error of hemicubes' rows, without a closed form for the scene:
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::accuracy::correct::{Correction, Refinement};
/// use hemicube::reference::{EstimatedRow, Reference, ReferenceSettings, errors_against};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// let settings = ReferenceSettings { target: 0.02, ..ReferenceSettings::default() };
/// let emitters = [4, 32, 90].map(InputPatch);
/// let reference = Reference::new(&model, settings)?.rows(&emitters, 0, &mut |_| ())?;
/// assert!(reference.iter().all(|row| row.noise() < 0.03 && (row.closure() - 1.0).abs() < 0.02));
///
/// // `parts` computes the rows of the room, here at two accuracy levels.
/// let error = |correction: Correction| -> room::Result<f64> {
///     let parts = room::parts(&model, correction)?;
///     let estimated: Vec<EstimatedRow> = parts.iter().flat_map(EstimatedRow::of_part).collect();
///     Ok(errors_against(&reference, &estimated).relative_frobenius)
/// };
/// let within = Correction::Tolerance(Refinement::for_tolerance(0.02));
/// assert!(error(within)? < error(Correction::Pixel)?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Reference<'m> {
    model: &'m Model,
    occluders: Occluders,
    spaces: Arc<Spaces>,
    settings: ReferenceSettings,
    through: Option<portals::Through>,
    cancel: Option<&'m AtomicBool>,
}

/// Share of patches not found by rays in the squared error aimed at, and in the error of the sum.
const SHARE_OF_MISSED: f64 = 0.3;
/// A row's rays over the bound of segments to patches not met over the hemisphere.
const SHARE_OF_UNMET: u64 = 4;
/// Triangles that a ray is held against on average, up to which `max_rays` is what it says: several times those of a
/// city or a machine. A choice: with more, stacks of triangles take longer than asked; with fewer, usual scenes get
/// fewer rays than asked.
const USUAL_TESTS: u64 = 64;
/// Cost of looking at a patch, in rays: a segment of each batch and the closed form.
const RAYS_OF_A_LOOK: u64 = 48;
/// Number of patches that are looked at even if rays are cheaper.
const LOOKS_FOR_NOTHING: u64 = 4096;
/// Number of doublings of the segments to patches hardly any segment reached.
const LOOKS: usize = 4;
/// Share of a pair's closed form in the error aimed at.
const SHARE_OF_CLOSED_FORM: f64 = 0.1;
/// Rounds of refinement; each at most quadruples a pair's rays.
const ROUNDS: usize = 10;

impl<'m> Reference<'m> {
    /// Builds the hierarchy over all surfaces of `model`.
    ///
    /// # Errors
    /// If the settings are out of range.
    pub fn new(model: &'m Model, settings: ReferenceSettings) -> Result<Self, ReferenceError> {
        let ReferenceSettings { target, max_rays, .. } = settings;
        if !(1e-5..=1.0).contains(&target) {
            return Err(ReferenceError::Target { target });
        }
        let least = 2 * Hemisphere::RAYS;
        if max_rays < least {
            return Err(ReferenceError::TooFewRays { max_rays, least });
        }
        Ok(Self {
            model,
            occluders: Occluders::new(model),
            spaces: Spaces::of(model),
            settings,
            through: None,
            cancel: None,
        })
    }

    /// Ends rows within a moment once `cancel` is set; a row that it ended means nothing.
    #[must_use]
    pub fn cancelled_by(self, cancel: &'m AtomicBool) -> Self {
        Self {
            cancel: Some(cancel),
            ..self
        }
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }

    /// The settings.
    pub fn settings(&self) -> &ReferenceSettings {
        &self.settings
    }

    /// Returns whether the point `to` of the receiver, in the file's unit, is seen from the point `from` of the
    /// emitter.
    ///
    /// # Errors
    /// When there is no such emitter or receiver.
    pub fn sees(
        &self,
        emitter: InputPatch,
        from: DVec3,
        receiver: InputPatch,
        to: DVec3,
    ) -> Result<bool, ReferenceError> {
        self.check(emitter)?;
        self.check(receiver)?;
        let (Some(emitter), Some(receiver)) = (Sight::new(self.model, emitter), Sight::new(self.model, receiver))
        else {
            return Ok(false);
        };
        let (from, to) = (self.model.normalise(from), self.model.normalise(to));
        Ok(self.occluders.sees(&emitter, from, &receiver, to, &mut None))
    }

    /// Returns whether a ray from a point, of a patch or free, in a direction meets nothing; all in the scene's
    /// coordinates. Neither surfaces in or below the plane through the point across `normal` nor the patch's own
    /// surface are met.
    ///
    /// # Errors
    /// When there is no such patch.
    pub fn is_open(
        &self,
        patch: Option<InputPatch>,
        from: DVec3,
        normal: DVec3,
        direction: DVec3,
    ) -> Result<bool, ReferenceError> {
        let from = self.model.normalise(from);
        let sight = match patch {
            Some(patch) => {
                self.check(patch)?;
                Sight::new(self.model, patch)
            }
            None => Some(Sight::free(from, normal)),
        };
        let Some((sight, direction)) = sight.zip(direction.try_normalize()) else {
            return Ok(false);
        };
        Ok(sight.normal.dot(direction) > 0.0 && self.occluders.first(&sight, from, direction) == Met::Nothing)
    }

    /// The end of a ray from a free point; both in the scene's coordinates, the direction of any length but 0. Of
    /// surfaces in one plane the patch with the smaller id is met, and any patch before a back.
    pub fn first(&self, from: DVec3, direction: DVec3) -> RayEnd {
        let (from, direction) = (self.model.normalise(from), direction.normalize_or_zero());
        // Nothing behind the point is met.
        match self.occluders.first(&Sight::free(from, direction), from, direction) {
            Met::Nothing => RayEnd::Nothing,
            Met::Back => RayEnd::Back,
            Met::Patch(patch) => RayEnd::Patch(InputPatch(patch)),
        }
    }

    /// The row of one emitter.
    ///
    /// # Errors
    /// When there is no such patch.
    pub fn row(&self, emitter: InputPatch) -> Result<ReferenceRow, ReferenceError> {
        self.check(emitter)?;
        Ok(self.compute(emitter, &mut Scratch::new(self.model)))
    }

    /// The rows of several emitters, in order, by several threads (0: one a core). `progress` is called with the number
    /// done.
    ///
    /// # Errors
    /// When there is no such patch.
    pub fn rows(
        &self,
        emitters: &[InputPatch],
        threads: usize,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Vec<ReferenceRow>, ReferenceError> {
        for &emitter in emitters {
            self.check(emitter)?;
        }
        let threads = match threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
        .clamp(1, emitters.len().max(1));
        let next = AtomicUsize::new(0);
        let (sender, receiver) = mpsc::channel();
        let mut rows = vec![ReferenceRow::default(); emitters.len()];
        std::thread::scope(|scope| {
            for _ in 0..threads {
                let (sender, next) = (sender.clone(), &next);
                scope.spawn(move || {
                    let mut scratch = Scratch::new(self.model);
                    loop {
                        let place = next.fetch_add(1, Ordering::Relaxed);
                        let Some(&emitter) = emitters.get(place) else { break };
                        if sender.send((place, self.compute(emitter, &mut scratch))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (done, (place, row)) in (1..).zip(receiver) {
                rows[place] = row;
                progress(done);
            }
        });
        Ok(rows)
    }

    fn check(&self, patch: InputPatch) -> Result<(), ReferenceError> {
        let count = self.model.geometry().patch_count;
        if patch.0 < count {
            Ok(())
        } else {
            Err(ReferenceError::NoSuchPatch { patch: patch.0, count })
        }
    }

    /// The row of one emitter; without entries for a patch without area.
    fn compute(&self, emitter: InputPatch, scratch: &mut Scratch) -> ReferenceRow {
        let mut row = ReferenceRow {
            emitter: emitter.0,
            ..ReferenceRow::default()
        };
        let Some(sight) = Sight::new(self.model, emitter) else {
            return row;
        };
        let ReferenceSettings { target, seed, .. } = self.settings;
        let (least, is_found) = self.find(&sight, scratch);
        let Scratch { hemisphere, facing } = scratch;
        let enough = SHARE_OF_CLOSED_FORM * target * hemisphere.squared_norm().sqrt();
        let pair = |(patch, hits)| {
            let receiver = Sight::new(self.model, InputPatch(patch))?;
            Pair::new(&sight, &receiver, hits, seed, enough)
        };
        let mut pairs: Vec<Pair> = hemisphere.found().filter_map(pair).collect();
        let unmet = facing.from(least).iter().filter(|&&patch| !hemisphere.has_met(patch));
        let mut unmet: Vec<Pair> = unmet.filter_map(|&patch| pair((patch, 0))).collect();
        let hidden = self.look(&sight, &mut unmet, hemisphere);
        let looked: u64 = unmet.iter().map(Pair::rays).sum();
        // Pairs that stay hidden are in no row; their segments count.
        row.rays = unmet.iter().filter(|pair| pair.is_hidden()).map(Pair::rays).sum();
        pairs.extend(unmet.into_iter().filter(|pair| !pair.is_hidden()));
        pairs.sort_unstable_by_key(Pair::receiver);
        let rays = hemisphere.rays();
        let left = self.most_rays(hemisphere).saturating_sub(rays + looked);
        row.cut_short = !self.refine(&sight, &mut pairs, rays, left) || !is_found;

        let share_partly = share_partly_visible(&pairs);
        let total = rays as f64;
        let mut disagreement = 0.0;
        for pair in &pairs {
            let (value, error) = (pair.value(), pair.error(share_partly));
            row.rays += pair.rays();
            if pair.hits >= 16 || value * total >= 16.0 {
                let counted = f64::from(pair.hits) / total;
                disagreement += (counted - value).powi(2) / (counted.max(value) / total + error * error);
                row.agreement_count += 1;
            }
            if value > 0.0 || error > 0.0 {
                row.columns.push(pair.receiver());
                row.values.push(value);
                row.errors.push(error);
            }
        }
        row.agreement = disagreement / f64::from(row.agreement_count.max(1));
        row.rays += rays;
        (row.escaped, row.blocked) = (hemisphere.escaped(), hemisphere.blocked());
        row.error_of_shares = hemisphere.error_of_shares();
        let below = hemisphere.missing(facing, least);
        row.missed = below.sum + hidden.sum;
        row.missed_squared = below.squared + hidden.squared;
        row.error_of_missed = (below.variance + hidden.variance).sqrt();
        self.extend(&sight, &mut row);
        row
    }

    /// Bound of a row's rays, by the triangles that those over the hemisphere were held against.
    fn most_rays(&self, hemisphere: &Hemisphere) -> u64 {
        let usual = hemisphere.tests_a_ray() / USUAL_TESTS;
        (self.settings.max_rays / usual.max(1)).max(2 * Hemisphere::RAYS)
    }

    /// Casts rays over the hemisphere until looking at the unmet patches costs no more than the rays did. Returns the
    /// bound from which on patches must be looked at for the target, or can be if there are no more rays; and whether
    /// it is the target's.
    fn find(&self, sight: &Sight, Scratch { hemisphere, facing }: &mut Scratch) -> (f64, bool) {
        let ReferenceSettings { target, seed, .. } = self.settings;
        let is_apart = |patch: u32| self.spaces.separate(sight.patch, patch);
        facing.find(self.model, sight, is_apart);
        hemisphere.begin();
        loop {
            hemisphere.round(&self.occluders, sight, seed, is_apart);
            if self.is_cancelled() {
                return (f64::INFINITY, false);
            }
            let rays = hemisphere.rays();
            let wanted = self.least(hemisphere, facing);
            // Both numbers are small enough for either type.
            let cost = facing.from(wanted).len() as u64 * RAYS_OF_A_LOOK;
            let max_rays = self.most_rays(hemisphere);
            let most = max_rays / SHARE_OF_UNMET;
            if hemisphere.error_of_shares() <= target && cost <= rays.max(LOOKS_FOR_NOTHING * RAYS_OF_A_LOOK).min(most)
            {
                return (wanted, true);
            }
            if rays + Hemisphere::RAYS > max_rays / 2 {
                let count = usize::try_from(most / RAYS_OF_A_LOOK).unwrap_or(usize::MAX);
                return (wanted.max(facing.least_of(count)), false);
            }
        }
    }

    /// The bound from which on patches must be looked at: by hits of once or twice met patches below it, the unmet part
    /// is less than the target.
    fn least(&self, hemisphere: &Hemisphere, facing: &Facing) -> f64 {
        let target = self.settings.target;
        let rays = hemisphere.rays() as f64;
        let sum = 1.0 - hemisphere.escaped() - hemisphere.blocked();
        let once = SHARE_OF_MISSED * target * sum * rays;
        let twice = 0.5 * SHARE_OF_MISSED * target * target * hemisphere.squared_norm() * rays * rays;
        let limit = |times, allowed: f64| {
            let bounds = hemisphere.bounds_of_hit(times, facing);
            let first = bounds.get(whole::to_usize(allowed));
            // Below that patch's own bound: the rays chose it.
            first.map_or(f64::INFINITY, |bound| 0.5 * bound)
        };
        if hemisphere.found().next().is_none() {
            // Without a hit, nothing is known of the row.
            return 0.0;
        }
        limit(1, once).min(limit(2, twice))
    }

    /// Casts the first segments to patches not met over the hemisphere, more to those with a larger form factor.
    /// Returns the likely missing part in those that no segment reached: with n segments a pair, Σ F = Σ F⁰ / n over
    /// pairs reached by one, Σ F² = Σ 2 F⁰² / (n (n − 1)) over pairs reached by two.
    fn look(&self, sight: &Sight, unmet: &mut [Pair], hemisphere: &Hemisphere) -> Missing {
        let (target, max_rays) = (self.settings.target, self.most_rays(hemisphere));
        let batches = BATCHES as f64;
        let rays = hemisphere.rays() as f64;
        // A segment to a pair is to be worth a few rays over the hemisphere, within the bound.
        let whole: f64 = unmet.iter().map(Pair::most).sum();
        let most = max_rays / (2 * SHARE_OF_UNMET);
        let each = (0.25 * rays).min(most as f64 / whole.max(f64::MIN_POSITIVE));
        let mut left = max_rays / SHARE_OF_UNMET;
        for pair in unmet.iter_mut() {
            if self.is_cancelled() {
                break;
            }
            let count = whole::to_u64(each * pair.most() / batches).max(1);
            pair.cast(&self.occluders, sight, count);
            left = left.saturating_sub(count * BATCHES as u64);
        }
        let sum = 1.0 - hemisphere.escaped() - hemisphere.blocked();
        for _ in 0..LOOKS {
            let missing = missing_of(unmet);
            let again: u64 = unmet.iter().filter(|pair| pair.passed().0 <= 1).map(Pair::rays).sum();
            if missing.sum <= SHARE_OF_MISSED * target * sum || again > left || self.is_cancelled() {
                break;
            }
            left -= again;
            for pair in unmet.iter_mut().filter(|pair| pair.passed().0 <= 1) {
                if self.is_cancelled() {
                    break;
                }
                pair.cast(&self.occluders, sight, pair.rays() / BATCHES as u64);
            }
        }
        missing_of(unmet)
    }

    /// Casts rays between pairs, in proportion to their part in the row's error, until the row is good enough. Returns
    /// whether `max_rays` did for that.
    fn refine(&self, sight: &Sight, pairs: &mut [Pair], before: u64, max_rays: u64) -> bool {
        let target = self.settings.target * self.settings.target;
        // Begin with one ray a batch for small pairs, four for the others. The norm is not known yet: take the counted
        // or the unoccluded form factor, the lesser of the two.
        let counted = |pair: &Pair| pair.most().min(2.0 * f64::from(pair.hits) / before.max(1) as f64);
        let norm: f64 = pairs.iter().map(|pair| counted(pair).powi(2)).sum();
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&p, &q| pairs[p].most().total_cmp(&pairs[q].most()).then(p.cmp(&q)));
        let mut left = max_rays;
        let mut sum = 0.0;
        for index in order {
            let pair = &mut pairs[index];
            if self.is_cancelled() {
                return false;
            }
            if pair.hits == 0 {
                // Looked at before.
                continue;
            }
            sum += 0.25 * pair.most().powi(2) / BATCHES as f64;
            let rays = if sum <= 0.05 * target * norm { 1 } else { 4 };
            if left < rays * BATCHES as u64 {
                // Without a ray, a pair's error is half of its unoccluded form factor.
                continue;
            }
            left -= rays * BATCHES as u64;
            pair.cast(&self.occluders, sight, rays);
        }
        for _ in 0..ROUNDS {
            let share_partly = share_partly_visible(pairs);
            let norm: f64 = pairs.iter().map(|pair| pair.value().powi(2)).sum();
            let budget = (1.0 - SHARE_OF_MISSED) * target * norm;
            let error: f64 = pairs.iter().map(|pair| pair.sampling_error(share_partly).powi(2)).sum();
            if error <= budget || budget <= 0.0 {
                break;
            }
            // The least rays for a sum of squares Σ c²/n are in proportion to c.
            let spread: f64 = pairs.iter().map(|pair| pair.spread(share_partly)).sum();
            let mut more = false;
            for pair in pairs.iter_mut() {
                let wanted = pair.spread(share_partly) * spread / budget;
                let rays = pair.rays() as f64;
                let extra = ((wanted - rays).min(3.0 * rays + 64.0) / BATCHES as f64).ceil();
                if extra < 1.0 {
                    continue;
                }
                let extra = whole::to_u64(extra).min(left / BATCHES as u64);
                if extra == 0 || self.is_cancelled() {
                    return false;
                }
                left -= extra * BATCHES as u64;
                pair.cast(&self.occluders, sight, extra);
                more = true;
            }
            if !more {
                break;
            }
        }
        true
    }
}

/// The likely missing part in pairs no segment passed between.
fn missing_of(unmet: &[Pair]) -> Missing {
    let mut missing = Missing::default();
    for pair in unmet {
        let (passed, all) = pair.passed();
        let n = all.max(2) as f64;
        let whole = pair.most();
        if passed == 1 {
            missing.sum += whole / n;
            missing.variance += (whole / n).powi(2);
        } else if passed == 2 {
            missing.squared += 2.0 * whole * whole / (n * (n - 1.0));
        }
    }
    missing
}

/// The share of a row, by squares, in partly visible pairs: the chance that a pair all rays pass is partly visible
/// nevertheless.
fn share_partly_visible(pairs: &[Pair]) -> f64 {
    let mut sums = [0.0, 0.0];
    for pair in pairs {
        let squared = pair.most().powi(2);
        sums[0] += squared;
        if pair.is_partly_visible() {
            sums[1] += squared;
        }
    }
    if sums[0] > 0.0 { sums[1] / sums[0] } else { 0.0 }
}
