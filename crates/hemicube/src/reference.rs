//! Reference rows: form factors from area to area by rays, with their own error, and no hemicube anywhere.
//!
//! ```text
//! F_ij = v_ij · A_i F⁰_ij / A_i        F⁰ the closed form with nothing in between, v the visible fraction
//! v_ij = Σ w V / Σ w                   over segments between the two patches, w in proportion to cos φ_i cos φ_j / r²
//! ```
//!
//! Both sums run over the *same* segments: the mean visibility of evenly drawn segments times the closed form is biased
//! exactly where patches are near each other. Segments are drawn as points of the smaller patch and directions over the
//! solid angle of the other (Arvo 1995), which leaves only a cosine as weight: nothing is singular where patches touch.
//!
//! Which pairs there are is found by cosine-distributed rays from stratified points of the emitter. What these rays hit
//! is also a row by itself, without closed form and without visible fractions: the two must agree
//! ([`ReferenceRow::agreement`]).
//!
//! What they did not hit is estimated from what they hit once or twice (Good 1953). Patches that no ray met are then
//! taken up by a bound of their form factor, all from some least bound on: so low that what is below it is likely less
//! than the target, of the row's norm and of its sum. Segments measure their visibility as that of the others. Where
//! more rays are cheaper than looking at that many patches, rays are cast first; where both would take more than
//! [`ReferenceSettings::max_rays`] allows, the largest bounds are looked at, and [`ReferenceRow::missed`] holds the
//! rest.
//!
//! What is seen is what backends are told to see ([`crate::backend`]): the emitter's own surface never, nor anything
//! that lies in or below its plane; of surfaces in one plane the patch with the smaller id; the back of a one-sided
//! surface occludes, and loses to any patch in its own plane. Rays are traced through a hierarchy with f32 boxes,
//! widened by more than their rounding, and meet triangles in f64.
//!
//! Rows depend on the scene, the settings and the emitter only.

mod facing;
mod hemisphere;
mod measure;
mod pair;
mod random;
mod visibility;

pub use measure::{EstimatedRow, Interval, Measured, errors_against};

use crate::Model;
use facing::Facing;
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemisphere::{Hemisphere, Missing};
use pair::{BATCHES, Pair};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use visibility::{Met, Occluders, Sight};

/// How carefully reference rows are computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceSettings {
    /// The standard error of a row that is aimed at, as a share of its Euclidean norm. What is likely missing of a row
    /// is as small a share of its sum, and the error of what escaped is no larger.
    pub target: f64,
    /// Where a row stops even if it has not reached the target; its error says so.
    pub max_rays: u64,
    /// Which random numbers.
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

/// Why there are no reference rows.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum ReferenceError {
    /// There is no such patch.
    #[error("patch {patch} has no reference row: the scene has {count} patches, numbered from 0")]
    NoSuchPatch {
        /// The patch asked for.
        patch: u32,
        /// The number that there are.
        count: u32,
    },
    /// A target that no number of rays reaches, or that says nothing.
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
        /// The fewest that mean something.
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
    /// The share that meets nothing.
    pub escaped: f64,
    /// The share that meets the back of a one-sided patch.
    pub blocked: f64,
    /// Standard error of `escaped`, of `blocked` and of the two together, at most.
    pub error_of_shares: f64,
    /// The share that goes to patches which no ray found: an estimate.
    pub missed: f64,
    /// Standard error of `missed`.
    pub error_of_missed: f64,
    /// Σ F² over patches which no ray found: an estimate.
    pub missed_squared: f64,
    /// How far the row is from what the rays over the hemisphere counted: mean square, in squares of a standard error,
    /// over patches with 16 hits or more. About 1 or less when both are right; much more when one is wrong.
    pub agreement: f64,
    /// Patches that `agreement` is over.
    pub agreement_count: u32,
    /// Rays traced.
    pub rays: u64,
}

impl ReferenceRow {
    /// Σ F².
    pub fn squared_norm(&self) -> f64 {
        self.values.iter().map(|f| f * f).sum()
    }

    /// The expected Σ (F − true F)², with the patches that no ray found.
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

    /// Σ F + escaped + blocked, 1 but for errors.
    pub fn closure(&self) -> f64 {
        self.sum() + self.escaped + self.blocked
    }

    /// Σ F, with what is likely missing.
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

/// What is used for one row after the other.
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
/// What rows of hemicubes are worth, without a closed form for the scene:
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::accuracy::correct::Correction;
/// use hemicube::reference::{EstimatedRow, Reference, ReferenceSettings, errors_against};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// let settings = ReferenceSettings { target: 0.02, ..ReferenceSettings::default() };
/// let emitters = [4, 32, 90].map(InputPatch);
/// let reference = Reference::new(&model, settings)?.rows(&emitters, 0, &mut |_| ())?;
/// assert!(reference.iter().all(|row| row.noise() < 0.03 && (row.closure() - 1.0).abs() < 0.02));
///
/// // `parts` computes the rows of the room, here by each rung of the ladder.
/// let error = |correction: Correction| -> room::Result<f64> {
///     let parts = room::parts(&model, correction)?;
///     let estimated: Vec<EstimatedRow> = parts.iter().flat_map(EstimatedRow::of_part).collect();
///     Ok(errors_against(&reference, &estimated).relative_frobenius)
/// };
/// assert!(error(Correction::area())? < error(Correction::Pixel)?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Reference<'m> {
    model: &'m Model,
    occluders: Occluders,
    settings: ReferenceSettings,
}

/// The share of the squared error aimed at, and of the error of the sum, that patches which no ray finds may have.
const SHARE_OF_MISSED: f64 = 0.3;
/// The share of a row's rays that segments to patches which no ray over the hemisphere met may have.
const SHARE_OF_UNMET: u64 = 4;
/// What it costs to look at a patch, in rays: a segment of each batch and the closed form.
const RAYS_OF_A_LOOK: u64 = 48;
/// As many patches are looked at without asking whether rays are cheaper.
const LOOKS_FOR_NOTHING: u64 = 4096;
/// Number of times that segments to patches that hardly any reached are doubled.
const LOOKS: usize = 4;
/// The share of the error aimed at that a pair's closed form may have.
const SHARE_OF_CLOSED_FORM: f64 = 0.1;
/// Rounds of refinement, each of which at most quadruples a pair's rays.
const ROUNDS: usize = 10;

impl<'m> Reference<'m> {
    /// Builds the hierarchy over all surfaces of `model`.
    ///
    /// # Errors
    /// When the settings ask for what cannot be done.
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
            settings,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &ReferenceSettings {
        &self.settings
    }

    /// Whether the point `to` of the receiver, in the file's unit, is seen from the point `from` of the emitter.
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

    /// Whether a ray from a point, of a patch or free, in a direction meets nothing; all in the scene's coordinates.
    /// What lies in or below the plane through the point across `normal` is out of the way, and so is the patch's own
    /// surface.
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

    /// The row of one emitter.
    ///
    /// # Errors
    /// When there is no such patch.
    pub fn row(&self, emitter: InputPatch) -> Result<ReferenceRow, ReferenceError> {
        self.check(emitter)?;
        Ok(self.compute(emitter, &mut Scratch::new(self.model)))
    }

    /// The rows of several emitters, in order, by several threads (0: one a core). `progress` is told how many are
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

    /// A row without anything but the emitter where the patch has no area.
    fn compute(&self, emitter: InputPatch, scratch: &mut Scratch) -> ReferenceRow {
        let mut row = ReferenceRow {
            emitter: emitter.0,
            ..ReferenceRow::default()
        };
        let Some(sight) = Sight::new(self.model, emitter) else {
            return row;
        };
        let ReferenceSettings { target, max_rays, seed } = self.settings;
        let least = self.find(&sight, scratch);
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
        self.refine(&sight, &mut pairs, rays, max_rays.saturating_sub(rays + looked));

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
        row
    }

    /// Casts rays over the hemisphere until patches that none met can be looked at for no more than the rays took, and
    /// says from which bound on that must be done for the target; from which it can be done where there are no more
    /// rays.
    fn find(&self, sight: &Sight, Scratch { hemisphere, facing }: &mut Scratch) -> f64 {
        let ReferenceSettings { target, max_rays, seed } = self.settings;
        facing.find(self.model, sight);
        hemisphere.begin();
        loop {
            hemisphere.round(&self.occluders, sight, seed);
            let rays = hemisphere.rays();
            let wanted = self.least(hemisphere, facing);
            // Both numbers are small enough for either type.
            let cost = facing.from(wanted).len() as u64 * RAYS_OF_A_LOOK;
            let most = max_rays / SHARE_OF_UNMET;
            if hemisphere.error_of_shares() <= target && cost <= rays.max(LOOKS_FOR_NOTHING * RAYS_OF_A_LOOK).min(most)
            {
                return wanted;
            }
            if rays + Hemisphere::RAYS > max_rays / 2 {
                let count = usize::try_from(most / RAYS_OF_A_LOOK).unwrap_or(usize::MAX);
                return wanted.max(facing.least_of(count));
            }
        }
    }

    /// The bound from which on patches must be looked at: what rays met once or twice below it says that what they did
    /// not meet is less than the target.
    fn least(&self, hemisphere: &Hemisphere, facing: &Facing) -> f64 {
        let target = self.settings.target;
        let rays = hemisphere.rays() as f64;
        let sum = 1.0 - hemisphere.escaped() - hemisphere.blocked();
        let once = SHARE_OF_MISSED * target * sum * rays;
        let twice = 0.5 * SHARE_OF_MISSED * target * target * hemisphere.squared_norm() * rays * rays;
        let limit = |times, allowed: f64| {
            let bounds = hemisphere.bounds_of_hit(times, facing);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "saturation is wanted"
            )]
            let first = bounds.get(allowed as usize);
            // Not at that patch's own bound, which the rays chose.
            first.map_or(f64::INFINITY, |bound| 0.5 * bound)
        };
        if hemisphere.found().next().is_none() {
            // Nothing is known of a row of which nothing was met.
            return 0.0;
        }
        limit(1, once).min(limit(2, twice))
    }

    /// Casts the first segments to patches that no ray over the hemisphere met, more to those with a larger form
    /// factor, and says what is likely missing in those that no segment reached: of pairs with n segments each, Σ F = Σ
    /// F⁰ / n over pairs that one reached, Σ F² = Σ 2 F⁰² / (n (n − 1)) over pairs that two reached.
    fn look(&self, sight: &Sight, unmet: &mut [Pair], hemisphere: &Hemisphere) -> Missing {
        let ReferenceSettings { target, max_rays, .. } = self.settings;
        let batches = BATCHES as f64;
        let rays = hemisphere.rays() as f64;
        // A segment that reaches a pair is to be worth a few rays over the hemisphere, unless that takes too many.
        let whole: f64 = unmet.iter().map(Pair::most).sum();
        let most = max_rays / (2 * SHARE_OF_UNMET);
        let each = (0.25 * rays).min(most as f64 / whole.max(f64::MIN_POSITIVE));
        let mut left = max_rays / SHARE_OF_UNMET;
        for pair in unmet.iter_mut() {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most as many as are left"
            )]
            let count = ((each * pair.most() / batches) as u64).max(1);
            pair.cast(&self.occluders, sight, count);
            left = left.saturating_sub(count * BATCHES as u64);
        }
        let sum = 1.0 - hemisphere.escaped() - hemisphere.blocked();
        for _ in 0..LOOKS {
            let missing = missing_of(unmet);
            let again: u64 = unmet.iter().filter(|pair| pair.passed().0 <= 1).map(Pair::rays).sum();
            if missing.sum <= SHARE_OF_MISSED * target * sum || again > left {
                break;
            }
            left -= again;
            for pair in unmet.iter_mut().filter(|pair| pair.passed().0 <= 1) {
                pair.cast(&self.occluders, sight, pair.rays() / BATCHES as u64);
            }
        }
        missing_of(unmet)
    }

    /// Casts rays between pairs, more where a pair has more part in the row's error, until the row is good enough.
    fn refine(&self, sight: &Sight, pairs: &mut [Pair], before: u64, max_rays: u64) {
        let target = self.settings.target * self.settings.target;
        // Small pairs whose visible fraction hardly matters begin with one ray a batch, the others with four. The norm
        // is not known yet: what was counted, or what could be seen at most, whichever is less.
        let counted = |pair: &Pair| pair.most().min(2.0 * f64::from(pair.hits) / before.max(1) as f64);
        let norm: f64 = pairs.iter().map(|pair| counted(pair).powi(2)).sum();
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&p, &q| pairs[p].most().total_cmp(&pairs[q].most()).then(p.cmp(&q)));
        let mut left = max_rays;
        let mut sum = 0.0;
        for index in order {
            let pair = &mut pairs[index];
            if pair.hits == 0 {
                // It has been looked at.
                continue;
            }
            sum += 0.25 * pair.most().powi(2) / BATCHES as f64;
            let rays = if sum <= 0.05 * target * norm { 1 } else { 4 };
            if left < rays * BATCHES as u64 {
                // Without a single ray a pair says nothing: its error then is half of what it could be.
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
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "saturation is wanted"
                )]
                let extra = (extra as u64).min(left / BATCHES as u64);
                if extra == 0 {
                    return;
                }
                left -= extra * BATCHES as u64;
                pair.cast(&self.occluders, sight, extra);
                more = true;
            }
            if !more {
                break;
            }
        }
    }
}

/// What is likely missing in pairs of which no segment passed.
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

/// Which share of a row, by squares, is in pairs that some rays pass and others do not: how likely it is that a pair
/// which all rays pass is partly visible nevertheless.
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
