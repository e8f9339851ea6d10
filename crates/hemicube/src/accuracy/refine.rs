//! Rows to a tolerance: effort goes where the error is.
//!
//! A row begins with one hemicube at the centroid and the area-to-area closed form of every pair. What is wrong then is
//! the visible fraction of some pairs, and few of them matter. Candidates are what the hemicube saw and what it did not
//! see but could be large ([`Candidates`]). Each has a prior variance, the mean squared error that fractions are known
//! to have in such a case; those whose prior variance hardly matters for the row keep their fraction. For the others
//! the shaft between the two patches is listed: an empty one proves that all is visible, one blocked by a single
//! triangle that nothing is. A few rays tell how the rest stand, and then each pair gets rays in proportion to its part
//! in the error, or is measured exactly from points ([`ExactVisibility`]) where that is cheaper.
//!
//! Errors of different pairs are independent, so squares add up. Let one unit of squared error be worth μ rays, the
//! same all over the scene. n rays of a sequence that fills four dimensions evenly leave z² s² n^(−5/4) of a pair with
//! the stake z and the spread s, so that the pair gets n = (5/4 μ z² s²)^(4/9) of them; one whose prior variance is d
//! is left as it is where μ z² d is less than the shaft and its rays would cost. μ follows from the error that is asked
//! for, over a sample of the scene's rows ([`Refinement::priced`]).
//!
//! Where no tolerance is asked for, the same is done for the few pairs that are most of what a row may be off by: those
//! that touch or all but touch, and large ones that are partly seen ([`Refiner::mend`]).
//!
//! The stake is what the pair's visible fraction moves in both its rows: z² = (F_ij² + F_ji²) / 2. Spread, rays and
//! points are the same in both directions, and so is the fraction that is measured, to the bit: what is not reciprocal
//! is what one of the two rows leaves as its centroid has it.
//!
//! No table of fractions shared between rows, because rows would then depend on each other. Instead a pair's samples
//! and their number follow from what is the same in both directions, and so does the fraction.

mod large;
mod sums;

use crate::Model;
use crate::bvh::Tree;
use crate::factor::{self, Exchanges, FactorRule};
use crate::geometry::{area, centroid, cross, sphere};
use crate::sampling::splitmix;
use crate::visibility::candidates::{Candidates, Least};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::exact::ExactVisibility;
use crate::visibility::segments::Obstacles;
use crate::visibility::shaft::{Cast, RAYS, Shaft};
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicBool, Ordering};

/// Extent to which the visible fractions of a row are refined.
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
    /// The tolerance is for the matrix, not for each row: half of what a row may err by is in proportion to itself,
    /// half is the same for all, so that rows with next to nothing in them get next to no rays.
    pub mean_squared_norm: f64,
    /// Number of rays that a unit of squared error is worth; 0 where it is not known, and each row finds its own price.
    pub price: f64,
    /// Error bound of a fraction that one hemicube has.
    pub priors: PriorVariances,
    /// How large the squared error of rows is as a multiple of what prior variances and rays let expect: found on rows
    /// that were tried.
    pub estimate: f32,
    /// Whether all pairs are measured, and none stays as the centroid has it: for scenes so small that it takes no
    /// time.
    pub all: bool,
    /// True if each pair is to have the tolerance by itself: for scenes so small that all pairs can be looked at.
    pub each: bool,
    /// Whether much of what leaves the scene's patches meets nothing. Where little does, the sums of rows are known,
    /// and one that is off by more than the tolerance is done again with care.
    pub open: bool,
}

impl Refinement {
    /// The refinement for a relative Frobenius error, nothing known of the scene.
    pub fn for_tolerance(tolerance: f64) -> Self {
        Self {
            tolerance,
            rule: FactorRule::for_tolerance(tolerance * 0.5),
            effort: 1.0,
            mean_squared_norm: 0.0,
            price: 0.0,
            priors: PriorVariances::default(),
            estimate: 1.0,
            all: false,
            each: false,
            open: false,
        }
    }

    /// For rows that are mended ([`Refiner::mend`]), nothing known of the scene.
    pub(crate) fn without_tolerance(rule: FactorRule) -> Self {
        Self {
            rule,
            priors: PriorVariances::found(),
            ..Self::for_tolerance(f64::INFINITY)
        }
    }

    /// The price of what is expected of a sample of rows, so that Σ (F − true F)² is what the effort stands for.
    pub(crate) fn priced(self, rows: &[Vec<ErrorContribution>]) -> Self {
        let worth = self.worth();
        let budget = SHARE * (self.tolerance * self.effort).powi(2) * self.mean_squared_norm * rows.len() as f64;
        let mut price = price_of(rows.iter().flatten(), budget, worth);
        if self.all {
            // Rows have no price of their own then, so this one must do for their sums.
            let most = SHARE * (ROW_SUM * self.tolerance).powi(2);
            price = rows
                .iter()
                .map(|row| price_of(row.iter(), most, worth))
                .fold(price, f64::max);
        }
        Self { price, ..self }
    }

    /// Steps that one row may take.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10¹¹")]
    fn most_steps(&self) -> u64 {
        (TOLERANCE_STEPS * (0.01 / self.tolerance).clamp(1.0, 100.0)) as u64
    }

    /// What z √d √μ must be for a pair to be measured.
    fn worth(&self) -> f64 {
        if self.all { 0.0 } else { WORTH_A_SHAFT }
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

/// What is expected of a pair that stays as the centroid has it: z √d and F √d.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ErrorContribution {
    both: f64,
    own: f64,
    is_near: bool,
}

/// See [`Refinement::worth`]: with √d for the spread, a shaft, as dear as 800 rays, and the rays then
/// cost what they save.
const WORTH_A_SHAFT: f64 = 30.0;

impl ErrorContribution {
    /// The squared error that is expected at this price, where pairs worth less than `worth` are not measured.
    fn left(&self, price: f64, worth: f64) -> f64 {
        let (own, both) = (self.own * self.own, self.both * self.both * price);
        if both <= worth * worth {
            return own;
        }
        let ray = if self.is_near { NEAR_RAY } else { 1.0 };
        own * left_by(rays_for(both, ray).max(RAYS as f64))
    }
}

/// The price at which these pairs leave no more than `budget` of squared error, about; next to nothing where they do so
/// anyway.
fn price_of<'a>(contributions: impl Iterator<Item = &'a ErrorContribution> + Clone, budget: f64, worth: f64) -> f64 {
    let error = |price: f64| contributions.clone().map(|stake| stake.left(price, worth)).sum::<f64>();
    if budget.is_infinite() || error(0.0) <= budget {
        return f64::MIN_POSITIVE;
    }
    // By halves of the logarithm; a root has the same bits everywhere, which a power has not.
    let (mut low, mut high) = (1e-10f64, 1e40f64);
    while high > 1.09 * low {
        let middle = (low * high).sqrt();
        if error(middle) <= budget {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Mean squared errors of visible fractions from one hemicube at the centroid, by what it says and by how near the pair
/// is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PriorVariances([[f32; NEARNESSES]; CLASSES]);

/// See [`Kind::group`].
const GROUPS: usize = CLASSES + 2;
/// What a hemicube says of a patch: partly visible, all visible, not visible, nearly all, hardly at all.
const CLASSES: usize = 5;
const UNSEEN: usize = 2;
/// Nearly all, and the rest of it hardly at all.
const NEARLY: f64 = 0.85;
/// Steps of a factor 2 in the distance, measured in radii.
const NEARNESSES: usize = 8;

impl Default for PriorVariances {
    /// What rooms, cities and machines have, on the large side: a pair that a sample of rows did not meet is rare, and
    /// not known to be harmless.
    fn default() -> Self {
        Self([
            [0.08, 0.06, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05],
            [0.02, 0.01, 0.005, 0.003, 0.002, 0.002, 0.002, 0.002],
            [0.1, 0.05, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01],
            [0.04, 0.03, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02],
            [0.08, 0.05, 0.03, 0.02, 0.02, 0.02, 0.02, 0.02],
        ])
    }
}

impl PriorVariances {
    /// What rows of a block city, uncut and cut, and of a real tile, uncut and cut, were found to have, by F² and
    /// rounded: where no sample of the scene's rows is held against rays.
    pub(crate) fn found() -> Self {
        Self([
            [0.01, 0.008, 0.006, 0.005, 0.004, 0.004, 0.004, 0.004],
            [0.0003, 0.0001, 0.00005, 0.00005, 0.00005, 0.00005, 0.00005, 0.00005],
            [0.1, 0.0004, 0.0003, 0.0003, 0.0003, 0.0003, 0.0003, 0.0003],
            [0.003, 0.002, 0.002, 0.002, 0.002, 0.002, 0.002, 0.002],
            [0.02, 0.005, 0.004, 0.003, 0.003, 0.003, 0.003, 0.003],
        ])
    }

    /// What several hemicubes say of a patch that they see is off by less, as independent points would be.
    fn lower(&mut self, samples: usize) {
        let share = (samples as f32).recip();
        for (class, of) in self.0.iter_mut().enumerate() {
            if class != UNSEEN {
                of.iter_mut().for_each(|prior| *prior *= share);
            }
        }
    }

    fn of(&self, kind: Kind) -> f64 {
        f64::from(self.0[kind.class as usize][kind.nearness as usize])
    }
}

/// Which of the prior variances is a pair's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Kind {
    class: u8,
    nearness: u8,
}

impl Kind {
    fn class(fraction: f64) -> u8 {
        if fraction >= 1.0 {
            1
        } else if fraction <= 0.0 {
            2
        } else if fraction >= NEARLY {
            3
        } else if fraction <= 1.0 - NEARLY {
            4
        } else {
            0
        }
    }

    /// Pairs that are off together where one point stands badly for a patch: those of a class, and of unseen ones,
    /// which may be near neighbours or a whole street, those that are about as near.
    fn group(self) -> usize {
        match (usize::from(self.class), self.nearness) {
            (UNSEEN, 0) => CLASSES,
            (UNSEEN, 1 | 2) => CLASSES + 1,
            (class, _) => class,
        }
    }

    fn nearness(i: &[DVec3; 3], j: &[DVec3; 3]) -> u8 {
        let ((c0, r0), (c1, r1)) = (sphere(i), sphere(j));
        let radii = c0.distance_squared(c1) / (r0 + r1);
        // The exponent of a power of 4.
        let exponent = (radii.to_bits() >> 52) as i64 - 1023;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let step = exponent.div_euclid(2).clamp(0, NEARNESSES as i64 - 1) as u8;
        step
    }
}

/// Sums that prior variances are estimated from: Σ f² (error)², Σ f² and how many.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PriorSums([[(f64, f64, f64); NEARNESSES]; CLASSES]);

impl PriorSums {
    /// The prior variances: what is usual counts as much as a few pairs.
    pub(crate) fn priors(&self) -> PriorVariances {
        let mut priors = PriorVariances::default();
        for (prior, &(error, weight, count)) in priors.0.iter_mut().flatten().zip(self.0.iter().flatten()) {
            if count > 0.0 {
                let usual = USUAL * weight / count;
                #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
                let found = ((error + usual * f64::from(*prior)) / (weight + usual)) as f32;
                *prior = found;
            }
        }
        priors
    }
}

/// Pairs that the usual prior variance counts as much as.
const USUAL: f64 = 5.0;

/// A pair of the row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) patch: u32,
    /// F if all were visible.
    pub(crate) open: f64,
    pub(crate) fraction: f64,
    /// A_i F if all were visible, the same bits from both sides; and what it is multiplied by for z.
    exchange: f64,
    stake: f64,
    kind: Kind,
    /// F is only what the middles of the two have it for: enough as long as nothing of it is seen.
    is_rough: bool,
}

impl Pair {
    /// Nothing known but the patch.
    fn unseen(patch: u32) -> Self {
        Self {
            patch,
            open: 0.0,
            fraction: 0.0,
            exchange: 0.0,
            stake: 0.0,
            kind: Kind {
                class: Kind::class(0.0),
                nearness: 0,
            },
            is_rough: false,
        }
    }
}

/// Refines the rows of one patch at a time. One a thread.
#[derive(Debug)]
pub(crate) struct Refiner<'c> {
    refinement: Refinement,
    /// When this becomes true, the row is left as it is: nobody wants it any more.
    cancel: Option<&'c AtomicBool>,
    pub(crate) pairs: Vec<Pair>,
    candidates: Candidates,
    exchanges: Exchanges,
    open: Vec<f64>,
    /// Unseen pairs far from each other.
    far: Vec<Pair>,
    /// What [`Refiner::find_unseen`] found, ascending.
    pub(crate) unseen: Vec<Pair>,
    /// Where pairs lie in the row that is mended.
    places: Vec<usize>,
    /// What is expected of each pair.
    contributions: Vec<ErrorContribution>,
    own_area: f64,
    is_measured: Vec<bool>,
    /// Which pairs are measured in any case.
    is_probe: Vec<bool>,
    shaft: Shaft,
    clipper: ExactVisibility,
    /// What was measured of this emitter's pairs; ascending as far as it was measured for another row of it.
    measured: Vec<Measured>,
    measured_before: usize,
    measured_of: Option<InputPatch>,
}

/// What was measured of a pair.
#[derive(Clone, Copy, Debug)]
struct Measured {
    patch: u32,
    fraction: f64,
    open: f64,
    exchange: f64,
    cost: Refined,
}

/// How far the measured pairs of a group were off, and how far they were expected to be: Σ z² (error)² and Σ z² d.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    squared: f64,
    expected: f64,
}

impl Found {
    /// How much larger the group's prior variances are in this row than elsewhere: what is usual counts as much as what
    /// was found.
    fn larger(self) -> f64 {
        if self.expected > 0.0 {
            (0.5 + 0.5 * self.squared / self.expected).max(1.0)
        } else {
            1.0
        }
    }
}

/// A row from one hemicube or several that is looked at again.
pub(crate) struct Mended<'r> {
    /// Ascending.
    pub(crate) patches: &'r mut Vec<u32>,
    pub(crate) fractions: &'r mut Vec<f64>,
    /// A_i F_ij if all were visible.
    pub(crate) exchanges: &'r mut Vec<f64>,
    /// Number of hemicubes.
    pub(crate) samples: usize,
    /// True if they are so many for the patch's size ([`crate::accuracy::grain`]).
    pub(crate) is_large: bool,
}

impl Mended<'_> {
    /// How many times as much work as a row of one hemicube it is worth: the hemicubes along an edge, or a quarter of
    /// all of them.
    fn worth(&self) -> u64 {
        self.samples.isqrt().max(self.samples / 4) as u64
    }

    /// Puts pairs of which something is visible into the row.
    pub(crate) fn insert(&mut self, pairs: &[Pair]) {
        for pair in pairs.iter().filter(|pair| pair.fraction > 0.0) {
            match self.patches.binary_search(&pair.patch) {
                Ok(place) => self.fractions[place] = pair.fraction,
                Err(place) => {
                    self.patches.insert(place, pair.patch);
                    self.fractions.insert(place, pair.fraction);
                    self.exchanges.insert(place, pair.exchange);
                }
            }
        }
    }
}

/// From what share of a row's √Σ F² on the expected error of a pair is worth a shaft where no tolerance is asked for.
const MENDED: f64 = 0.0016;
/// More hemicubes than this ask for no more precision.
const MOST_ODD: usize = 4;
/// So many rays the square of that is worth then.
const MENDING: f64 = 60.0;
/// How much larger than usual the prior variances of a row may prove there.
const LARGER: f64 = 4.0;
/// Steps that mending a row may take: so many, and so many for each of its entries, times [`Mended::worth`]. About what
/// its hemicubes take, for most rows twice over.
const MENDING_STEPS: u64 = 400_000;
const MENDING_STEPS_AN_ENTRY: u64 = 1_000;
/// Steps that a row of a tolerance of 1 % may take; of a finer one, more in proportion, up to a hundred times as many.
const TOLERANCE_STEPS: f64 = 1e9;
/// Steps that a pair takes about: if a row's budget does for so many a pair, their order does not matter.
const STEPS_A_PAIR: u64 = 30_000;
/// What a form factor is taken for in a row of which hemicubes saw nothing.
const USUAL_FACTOR: f64 = 0.01;

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
    /// Cost, in steps (`shaft.rs`).
    pub(crate) steps: u64,
    /// True if the row's budget ended it before all was measured that was worth it.
    pub(crate) cut_short: bool,
}

impl Refined {
    /// Adds what a pair came to.
    fn add(&mut self, pair: Self) {
        self.squared_error += pair.squared_error;
        self.rays += pair.rays;
        self.points += pair.points;
        self.shafts += pair.shafts;
        self.steps += pair.steps;
        self.cut_short |= pair.cut_short;
    }
}

/// The share of the squared error for visible fractions.
const SHARE: f64 = 0.8;
/// The share of its part of the squared error that a row may have from pairs that stay as the centroid has them: prior
/// variances are what is usual, and where one point stands badly for a patch, all of its pairs are off at once.
const ROUGH_SHARE: f64 = 0.5;
/// The standard error of a row's sum in tolerances, at most.
const ROW_SUM: f64 = 0.33;
/// The spread that a pair is not believed to have less of where rows' sums depend on it.
const LEAST_SPREAD: f64 = 0.25;
/// How much better than independent rays those are taken to be.
const SUM_GAIN: f64 = 4.0;
/// The root of how many pairs have a part in that, with a margin.
const PAIRS_OF_A_SUM: f64 = 6.0;
/// Unseen pairs are looked for down to this share of the row's permitted error.
const REACH: f64 = 0.3;
/// What a ray between near patches costs, in others.
const NEAR_RAY: f64 = 2.0;
/// What a ray that walks the tree costs, in others.
const CROWDED_RAY: f64 = 10.0;
/// Rays that are cast at a pair before it is asked again how many it takes, as a multiple of those it had.
const GROWTH: usize = 4;
/// So many rays say well enough how many more it would take.
const KNOWN_RAYS: usize = 256;
/// From this many rays on, points are cheaper.
const MANY_RAYS: f64 = 131_072.0;
/// Points at one pair, about, at most; and where each pair is to have the tolerance by itself.
const MOST_POINTS: usize = 6_000;
const MOST_POINTS_EACH: usize = 20_000;
/// Pairs of each group that are measured in any case, at most.
const PROBES: f64 = 6.0;
/// Number of times that what was found may lead to more.
const PASSES: usize = 4;
/// From this nearness on, the middles of two patches tell their factor well enough to see whether it matters.
const FAR: u8 = 3;
/// Directions that are drawn for a ray between near patches, at most.
pub(crate) const MOST_DRAWN: usize = 32;
/// Rays at one pair, at most.
const MOST_RAYS: f64 = 262_144.0;

impl<'c> Refiner<'c> {
    pub(crate) fn new(refinement: Refinement, cancel: Option<&'c AtomicBool>) -> Self {
        Self {
            refinement,
            cancel,
            pairs: Vec::new(),
            candidates: Candidates::default(),
            exchanges: Exchanges::new(refinement.rule),
            open: Vec::new(),
            far: Vec::new(),
            unseen: Vec::new(),
            places: Vec::new(),
            contributions: Vec::new(),
            own_area: 0.0,
            is_measured: Vec::new(),
            is_probe: Vec::new(),
            shaft: Shaft::default(),
            clipper: ExactVisibility::default(),
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

    /// From now on takes nothing for known, and half of the error, if it is to take care; returns what it did before.
    pub(crate) fn with_care(&mut self, care: bool) -> Refinement {
        let before = self.refinement;
        // Where all pairs are measured, hemicubes tell nothing that could be doubted.
        if care && !self.refinement.all {
            self.refinement.priors = PriorVariances::default();
            self.refinement.effort *= 0.5;
            self.refinement.price *= 16.0;
            self.measured_of = None;
        }
        before
    }

    /// Refines so from now on.
    pub(crate) fn set(&mut self, refinement: Refinement) {
        self.refinement = refinement;
    }

    /// Refines a row: `seen` are the patches that its hemicubes saw, ascending, with their visible fractions; whether
    /// it is that of a large patch. Afterwards `pairs` is the row, ascending. Where it is the row of the last emitter
    /// again, with more hemicubes, what was measured of it is not measured again.
    pub(crate) fn row(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        is_large: bool,
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let own = model.normalised_corners(emitter.0);
        let budget = self.begin(model, emitter, &own, (seen, is_large), receives);
        if self.refinement.each {
            let refined = self.measure_each(model, emitter, &own);
            self.pairs.sort_unstable_by_key(|pair| pair.patch);
            return refined;
        }

        self.remember(self.measured_of == Some(emitter));
        self.measured_of = Some(emitter);
        let most_steps = self.refinement.most_steps();
        if is_large {
            let tolerance = self.refinement.tolerance * self.refinement.effort;
            let mut refined = self.measure_all(model, (emitter, &own), Some(tolerance), most_steps);
            self.pairs.sort_unstable_by_key(|pair| pair.patch);
            refined.squared_norm = self.squared_norm();
            return refined;
        }
        self.find_contributions();
        let (price, least) = self.price(budget);
        let mut refined = Refined::default();
        self.find_probes(emitter);
        self.measure(model, emitter, &own, (price, least), most_steps, &mut refined);
        refined.squared_error *= f64::from(self.refinement.estimate);
        self.pairs.sort_unstable_by_key(|pair| pair.patch);
        refined.squared_norm = self.squared_norm();
        refined
    }

    /// Orders what was measured, so that it can be looked up.
    fn sort_measured(&mut self) {
        self.measured.sort_unstable_by_key(|measured| measured.patch);
    }

    /// Keeps what was measured for the row before, or forgets it.
    fn remember(&mut self, keep: bool) {
        if keep {
            self.sort_measured();
        } else {
            self.measured.clear();
        }
        self.measured_before = self.measured.len();
        self.unseen.clear();
    }

    /// Looks again at those pairs of a row that are a good part of what it may be off by, with the prior variances that
    /// pairs were found to have elsewhere, and adds those of them that no hemicube saw.
    ///
    /// A pair is worth it from a share of √Σ F² on: of a row that sees little, of what it would be if it saw as much as
    /// it can, on half the way there (the geometric mean), for it has the smaller part in the matrix. Of n hemicubes
    /// less is expected to be wrong: there the share is a √n-th of that.
    pub(crate) fn mend(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        row: Mended<'_>,
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let mut refined = Refined::default();
        self.remember(self.measured_of == Some(emitter));
        self.measured_of = Some(emitter);
        let own = model.normalised_corners(emitter.0);
        self.own_area = area(&own);
        let per_area = 1.0 / self.own_area;
        let (mut squares, mut sum) = (0.0, 0.0);
        for (fraction, exchange) in row.fractions.iter().zip(&*row.exchanges) {
            let factor = fraction * exchange * per_area;
            squares += factor * factor;
            sum += factor;
        }
        // With what it says, as long as it says anything.
        let usual = if squares > 0.0 {
            squares / sum.min(1.0)
        } else {
            USUAL_FACTOR
        };
        let is_large = row.is_large;
        let mut least = MENDED * (usual / row.samples.min(MOST_ODD) as f64).sqrt();
        let mut priors = self.refinement.priors;
        if row.samples > 1 {
            priors.lower(row.samples);
        }
        if is_large {
            // From this form factor on, whatever the prior variance.
            priors = PriorVariances([[1.0; NEARNESSES]; CLASSES]);
            least = large::least_factor(row.exchanges.iter().map(|exchange| exchange * per_area));
        }
        let most = priors.0.map(|of| f64::from(of.into_iter().fold(0.0, f32::max)).sqrt());
        self.pairs.clear();
        self.places.clear();
        let pairs = row.patches.iter().zip(&*row.fractions).zip(&*row.exchanges);
        for (place, ((&patch, &fraction), &exchange)) in pairs.enumerate() {
            let class = Kind::class(fraction);
            let open = exchange * per_area;
            let larger = if is_large { 1.0 } else { LARGER.sqrt() };
            if open * most[usize::from(class)] * larger <= least {
                continue;
            }
            let corners = model.normalised_corners(patch);
            self.places.push(place);
            self.pairs.push(Pair {
                patch,
                open,
                fraction,
                exchange,
                stake: per_area,
                kind: Kind {
                    class,
                    nearness: Kind::nearness(&own, &corners),
                },
                is_rough: false,
            });
        }
        let seen_count = self.pairs.len();
        let tree = Tree::of(model.geometry());
        let from = |nearness| {
            let kind = Kind {
                class: Kind::class(0.0),
                nearness,
            };
            least / priors.of(kind).sqrt()
        };
        let from = Least {
            near: from(0),
            far: from(1),
        };
        self.candidates.find(&tree, emitter.0, &own, from);
        for &patch in &self.candidates.patches {
            if row.patches.binary_search(&patch).is_ok() || !receives(patch) {
                continue;
            }
            let corners = model.normalised_corners(patch);
            let kind = Kind {
                class: Kind::class(0.0),
                nearness: Kind::nearness(&own, &corners),
            };
            // Of those that all but touch, the middles tell nothing.
            let is_rough = kind.nearness > 0;
            let (open, exchange) = if is_rough {
                (by_middles(&own, &corners), 0.0)
            } else {
                let exchange = factor::exchange(&own, &corners, &self.refinement.rule);
                (exchange * per_area, exchange)
            };
            if open * priors.of(kind).sqrt() > least {
                self.pairs.push(Pair {
                    patch,
                    open,
                    fraction: 0.0,
                    exchange,
                    stake: per_area,
                    kind,
                    is_rough,
                });
            }
        }
        // What a pair is worth to the other row is found there: z is F_ij alone, here and where rays are allotted.
        let stake = |pair: &Pair| {
            let own = pair.open * priors.of(pair.kind).sqrt();
            ErrorContribution {
                both: own,
                own,
                is_near: pair.kind.nearness == 0,
            }
        };
        self.contributions.clear();
        self.contributions.extend(self.pairs.iter().map(stake));
        self.is_probe.clear();
        self.is_probe.resize(self.pairs.len(), false);
        let price = MENDING / (least * least);
        let entries = row.patches.len() as u64;
        let most_steps = (MENDING_STEPS + MENDING_STEPS_AN_ENTRY * entries) * row.worth();
        if is_large {
            refined = self.measure_all(model, (emitter, &own), None, most_steps);
        } else {
            self.measure(model, emitter, &own, (price, least), most_steps, &mut refined);
        }
        for (pair, &place) in self.pairs.iter().zip(&self.places) {
            row.fractions[place] = pair.fraction;
        }
        let mut row = row;
        row.insert(&self.pairs[seen_count..]);
        refined
    }

    /// What is expected of a row's pairs.
    pub(crate) fn expected_errors(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: impl Iterator<Item = (u32, f64)>,
        receives: impl Fn(u32) -> bool,
    ) -> Vec<ErrorContribution> {
        let own = model.normalised_corners(emitter.0);
        self.begin(model, emitter, &own, (seen, false), receives);
        self.find_contributions();
        self.contributions.clone()
    }

    fn find_contributions(&mut self) {
        let priors = self.refinement.priors;
        self.contributions.clear();
        self.contributions.extend(self.pairs.iter().map(|pair| {
            let own = pair.open * priors.of(pair.kind).sqrt();
            ErrorContribution {
                both: own * pair.stake * self.own_area,
                own,
                is_near: pair.kind.nearness == 0,
            }
        }));
    }

    /// What a squared error is worth in this row: what it is all over the scene, or more where the row by itself would
    /// be too far off. And the z √d from which on pairs are measured.
    fn price(&self, budget: f64) -> (f64, f64) {
        let worth = self.refinement.worth();
        let mut price = self.refinement.price;
        if price <= 0.0 {
            price = price_of(self.contributions.iter(), SHARE * budget, worth);
            return (price, worth / price.sqrt());
        }
        if self.refinement.all {
            // The same price for all rows, so that both of a pair have the same rays.
            return (price, 0.0);
        }
        let most = SHARE * (ROW_SUM * self.refinement.tolerance).powi(2);
        if self
            .contributions
            .iter()
            .map(|stake| stake.left(price, worth))
            .sum::<f64>()
            > most
        {
            price = price_of(self.contributions.iter(), most, worth).max(price);
        }
        let mut least = worth / price.sqrt();
        let rough = |least: f64| -> f64 {
            let kept = self.contributions.iter().filter(|stake| stake.both <= least);
            kept.map(|stake| stake.own * stake.own).sum()
        };
        while rough(least) > ROUGH_SHARE * budget {
            least *= 0.7;
        }
        (price, least)
    }

    /// Makes the list of pairs: what was seen, and what was not but could be large. Returns what the row may err by.
    fn begin(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        own: &[DVec3; 3],
        (seen, is_large): (impl Iterator<Item = (u32, f64)>, bool),
        receives: impl Fn(u32) -> bool,
    ) -> f64 {
        self.pairs.clear();
        self.pairs.extend(seen.map(|(patch, fraction)| Pair {
            fraction,
            kind: Kind {
                class: Kind::class(fraction),
                nearness: 0,
            },
            ..Pair::unseen(patch)
        }));
        let seen_count = self.pairs.len();
        self.exchanges.begin(own);
        self.own_area = area(own);
        self.close(model, own, 0);
        let budget = self.refinement.budget(self.squared_norm());
        let least = if self.refinement.each || self.refinement.all {
            f64::MIN_POSITIVE
        } else if is_large {
            large::least_factor(self.pairs.iter().map(|pair| pair.open))
        } else {
            REACH * budget.sqrt()
        };
        if least > 0.0 && least < 1.0 {
            let from = Least {
                near: least,
                far: least,
            };
            self.candidates.find(&Tree::of(model.geometry()), emitter.0, own, from);
            let mut known = 0;
            for &patch in &self.candidates.patches {
                while known < seen_count && self.pairs[known].patch < patch {
                    known += 1;
                }
                let is_known = known < seen_count && self.pairs[known].patch == patch;
                if is_known || !receives(patch) {
                    continue;
                }
                let corners = model.normalised_corners(patch);
                let nearness = Kind::nearness(own, &corners);
                let is_rough = nearness >= FAR && !self.refinement.each && !self.refinement.all;
                let mut pair = Pair {
                    stake: stake(area(own), area(&corners)),
                    is_rough,
                    ..Pair::unseen(patch)
                };
                pair.kind.nearness = nearness;
                if is_rough {
                    pair.open = by_middles(own, &corners);
                }
                if is_rough {
                    self.far.push(pair);
                } else {
                    self.pairs.push(pair);
                }
            }
            self.close(model, own, seen_count);
            self.pairs.append(&mut self.far);
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
        sums: &mut PriorSums,
    ) -> f64 {
        let own = model.normalised_corners(emitter.0);
        self.begin(model, emitter, &own, (seen, false), receives);
        let walls = &*CoplanarRegions::of(model);
        let obstacles = Obstacles {
            surfaces: &model.geometry().surfaces,
            walls,
        };
        for class in 0..CLASSES {
            let of_class = |pair: &&Pair| usize::from(pair.kind.class) == class;
            let total: f64 = self.pairs.iter().filter(of_class).map(|pair| pair.open).sum();
            for pair in self.pairs.iter().filter(of_class).filter(|pair| pair.open > 0.0) {
                // Drawn in proportion to F, and weighted by what that leaves out.
                let chance = (SURVEYED * pair.open / total).min(1.0);
                if splitmix::unit(splitmix::hash(seed(emitter.0, pair.patch).wrapping_add(splitmix::STEP))) >= chance {
                    continue;
                }
                let corners = model.normalised_corners(pair.patch);
                self.shaft.clear();
                let sighting = self.shaft.sight(obstacles, (emitter.0, &own), (pair.patch, &corners));
                let fraction = if sighting.hidden {
                    0.0
                } else if sighting.is_open() {
                    1.0
                } else {
                    let mut cast = Cast::default();
                    let seed = seed(emitter.0, pair.patch);
                    if sighting.near {
                        self.shaft.cast_near(
                            obstacles,
                            &sighting,
                            SURVEY_RAYS,
                            MOST_DRAWN * SURVEY_RAYS,
                            seed,
                            &mut cast,
                        );
                    } else {
                        self.shaft.cast(obstacles, &sighting, SURVEY_RAYS, seed, &mut cast);
                    }
                    let Some(fraction) = cast.fraction() else { continue };
                    fraction
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
        let own_area = area(own);
        self.open.clear();
        self.open.resize(self.pairs.len() - start, 0.0);
        for (place, pair) in self.pairs[start..].iter_mut().enumerate() {
            let corners = model.normalised_corners(pair.patch);
            self.exchanges.add(place, &corners, &mut self.open);
            pair.kind.nearness = Kind::nearness(own, &corners);
            pair.stake = stake(own_area, area(&corners));
        }
        self.exchanges.finish(&mut self.open);
        for (pair, exchange) in self.pairs[start..].iter_mut().zip(&self.open) {
            pair.open = exchange / own_area;
            pair.exchange = *exchange;
        }
    }

    /// Measures the fraction of every pair to the tolerance.
    fn measure_each(&mut self, model: &Model, emitter: InputPatch, own: &[DVec3; 3]) -> Refined {
        let walls = &*CoplanarRegions::of(model);
        let obstacles = Obstacles {
            surfaces: &model.geometry().surfaces,
            walls,
        };
        let mut refined = Refined::default();
        let cancel = self.cancel;
        for pair in self.pairs.iter_mut().filter(|pair| pair.open > 0.0) {
            if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
                refined.cut_short = true;
                break;
            }
            self.shaft.clear();
            let corners = model.normalised_corners(pair.patch);
            let sighting = self.shaft.sight(obstacles, (emitter.0, own), (pair.patch, &corners));
            refined.shafts += 1;
            if sighting.hidden || sighting.is_open() {
                pair.fraction = f64::from(u8::from(!sighting.hidden));
                continue;
            }
            // Of a factor under a hundredth, a hundredth of the tolerance.
            let enough = EACH_SHARE * self.refinement.tolerance * (SMALL_FACTOR / pair.open).max(1.0);
            let measured = self
                .clipper
                .measure(&self.shaft, walls, &sighting, enough, MOST_POINTS_EACH, true);
            if let Some(clipped) = measured {
                pair.fraction = clipped.fraction;
                refined.points += clipped.points as u64;
                refined.squared_error += (clipped.change * pair.open).powi(2);
                continue;
            }
            let seed = seed(emitter.0, pair.patch);
            let mut cast = Cast::default();
            if sighting.near {
                self.shaft
                    .cast_near(obstacles, &sighting, EACH_RAYS, MOST_DRAWN * EACH_RAYS, seed, &mut cast);
            } else {
                self.shaft.cast(obstacles, &sighting, EACH_RAYS, seed, &mut cast);
            }
            refined.rays += EACH_RAYS as u64;
            if let Some(fraction) = cast.fraction() {
                pair.fraction = fraction;
            }
            let variance = pair.fraction * (1.0 - pair.fraction) * left_by(EACH_RAYS as f64);
            refined.squared_error += pair.open * pair.open * variance;
        }
        refined.squared_norm = self.squared_norm();
        refined
    }

    /// Measures the fractions of the pairs whose z √d is more than `least`, at this price of a squared error.
    fn measure(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        own: &[DVec3; 3],
        (price, least): (f64, f64),
        most_steps: u64,
        refined: &mut Refined,
    ) {
        // Prior variances of the groups in this row: where one point stands badly for a patch, all that it says is off
        // at once. So some pairs of each group are tried in any case, and where they are off, so may be others.
        let mut found = [Found::default(); GROUPS];
        self.is_measured.clear();
        self.is_measured.resize(self.pairs.len(), false);
        for pass in 0..PASSES {
            let larger = found.map(|f| f.larger());
            let expected =
                |place: usize| self.contributions[place].both * larger[self.pairs[place].kind.group()].sqrt();
            let mut wanted: Vec<(f64, usize)> = (0..self.pairs.len())
                .filter(|&place| !self.is_measured[place])
                .map(|place| (expected(place), place))
                .filter(|&(worth, place)| worth > least || (pass == 0 && self.is_probe[place]))
                .collect();
            if wanted.is_empty() {
                break;
            }
            // Where the budget may not do for all, those first that matter most.
            if refined.steps + wanted.len() as u64 * STEPS_A_PAIR > most_steps {
                wanted.sort_by(|p, q| q.0.total_cmp(&p.0).then(p.1.cmp(&q.1)));
            }
            for (_, place) in wanted {
                if refined.steps >= most_steps || self.is_cancelled() {
                    refined.cut_short = true;
                    break;
                }
                let (group, stake) = (self.pairs[place].kind.group(), self.contributions[place]);
                let before = self.pairs[place].fraction;
                self.measure_pair(model, (emitter, own), place, price, refined);
                let pair = &self.pairs[place];
                found[group].squared += (pair.open * (pair.fraction - before)).powi(2);
                found[group].expected += stake.own * stake.own;
                self.is_measured[place] = true;
            }
        }
        for (place, stake) in self.contributions.iter().enumerate() {
            if !self.is_measured[place] {
                let larger = found[self.pairs[place].kind.group()].larger();
                refined.squared_error += larger * stake.own.powi(2);
            }
        }
    }

    /// Draws pairs of each group in proportion to their part in its prior variance, evenly through the row.
    fn find_probes(&mut self, emitter: InputPatch) {
        let mut totals = [0.0; GROUPS];
        for (stake, pair) in self.contributions.iter().zip(&self.pairs) {
            totals[pair.kind.group()] += stake.own * stake.own;
        }
        let steps = totals.map(|total| total / PROBES);
        let first = splitmix::unit(splitmix::hash(u64::from(emitter.0).wrapping_add(splitmix::STEP)));
        let mut next = steps.map(|step| first * step);
        let mut sums = [0.0; GROUPS];
        self.is_probe.clear();
        for (stake, pair) in self.contributions.iter().zip(&self.pairs) {
            let group = pair.kind.group();
            sums[group] += stake.own * stake.own;
            let is_probe = stake.own > 0.0 && sums[group] > next[group];
            while steps[group] > 0.0 && next[group] < sums[group] {
                next[group] += steps[group];
            }
            self.is_probe.push(is_probe);
        }
    }

    /// Measures the fraction of a pair, or takes it from when that was done for this row before.
    fn measure_pair(
        &mut self,
        model: &Model,
        (emitter, own): (InputPatch, &[DVec3; 3]),
        place: usize,
        price: f64,
        refined: &mut Refined,
    ) {
        let patch = self.pairs[place].patch;
        let before = self.measured[..self.measured_before].binary_search_by_key(&patch, |measured| measured.patch);
        if let Ok(at) = before {
            let (measured, pair) = (self.measured[at], &mut self.pairs[place]);
            pair.fraction = measured.fraction;
            if pair.is_rough {
                (pair.open, pair.exchange, pair.is_rough) = (measured.open, measured.exchange, false);
            }
            refined.add(measured.cost);
            return;
        }
        let mut cost = Refined::default();
        self.measure_anew(model, (emitter, own), place, price, &mut cost);
        refined.add(cost);
        let pair = &self.pairs[place];
        self.measured.push(Measured {
            patch,
            fraction: pair.fraction,
            open: pair.open,
            exchange: pair.exchange,
            cost,
        });
    }

    /// Measures the fraction of a pair.
    fn measure_anew(
        &mut self,
        model: &Model,
        (emitter, own): (InputPatch, &[DVec3; 3]),
        place: usize,
        price: f64,
        refined: &mut Refined,
    ) {
        let walls = &*CoplanarRegions::of(model);
        let obstacles = Obstacles {
            surfaces: &model.geometry().surfaces,
            walls,
        };
        let pair = &mut self.pairs[place];
        let corners = model.normalised_corners(pair.patch);
        self.shaft.clear();
        let sighting = self.shaft.sight(obstacles, (emitter.0, own), (pair.patch, &corners));
        refined.shafts += 1;
        refined.steps += sighting.steps;
        if sighting.hidden {
            pair.fraction = 0.0;
            return;
        }
        if pair.is_rough {
            let exchange = factor::exchange(own, &corners, &self.refinement.rule);
            (pair.open, pair.exchange, pair.is_rough) = (exchange / area(own), exchange, false);
        }
        if sighting.is_open() {
            pair.fraction = 1.0;
            return;
        }
        let seed = seed(emitter.0, pair.patch);
        let exchanged = pair.exchange * pair.stake;
        let ray = match (sighting.crowded, sighting.near) {
            (true, _) => CROWDED_RAY,
            (false, true) => NEAR_RAY,
            (false, false) => 1.0,
        };
        let mut cast = Cast::default();
        let mut next = if sighting.near { 2 * RAYS } else { RAYS };
        let (rays, spread) = loop {
            let rays = if sighting.near {
                self.shaft
                    .cast_near(obstacles, &sighting, next, MOST_DRAWN * next, seed, &mut cast)
            } else {
                self.shaft.cast(obstacles, &sighting, next, seed, &mut cast)
            };
            // A few rays that agree do not prove that all would (Laplace's rule of succession, for half a ray).
            let count = rays as f64;
            let seen = cast.fraction().unwrap_or(0.5);
            let smooth = (seen * count + 0.5) / (count + 1.0);
            let spread = (smooth * (1.0 - smooth)).sqrt();
            let mut wanted = rays_for((spread * exchanged).powi(2) * price, ray);
            if self.refinement.all {
                // A row's sum may be off by what a few dozen such pairs leave, even where their first rays agree by
                // chance. The larger factor of the two is at most √2 z.
                let larger = std::f64::consts::SQRT_2 * exchanged;
                let error = PAIRS_OF_A_SUM * larger * spread.max(LEAST_SPREAD) / (ROW_SUM * self.refinement.tolerance);
                wanted = wanted.max(error * error / SUM_GAIN);
            }
            let is_poor = cast.sums.1 <= 0.0 || (sighting.near && rays < RAYS);
            if is_poor || (wanted > MANY_RAYS && rays >= KNOWN_RAYS) {
                // What so many rays would leave.
                let enough = spread * left_by(wanted.max(1.0)).sqrt();
                let clipped = self
                    .clipper
                    .measure(&self.shaft, walls, &sighting, enough, MOST_POINTS, false);
                refined.steps += self.clipper.steps();
                if let Some(clipped) = clipped {
                    refined.steps += cast.steps;
                    pair.fraction = clipped.fraction;
                    refined.rays += rays as u64;
                    refined.points += clipped.points as u64;
                    refined.squared_error += (clipped.change * pair.open).powi(2);
                    return;
                }
            }
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped, then a number of rays"
            )]
            let wanted = (wanted.clamp(0.0, MOST_RAYS) as usize).next_multiple_of(RAYS);
            // No more than a few times as many at once: most of those that the first are in doubt about, the next
            // settle.
            if wanted <= rays || next >= wanted {
                break (rays, spread);
            }
            next = wanted.min(GROWTH * next);
        };
        refined.rays += rays as u64;
        refined.steps += cast.steps;
        // Where no ray had weight, as between planes that all but coincide, the centroid's fraction is all there is.
        if let Some(fraction) = cast.fraction() {
            pair.fraction = fraction;
        }
        refined.squared_error += (spread * pair.open).powi(2) * left_by(rays.max(1) as f64);
    }
}

/// The factor from patch to patch as their middles have it, by the parts of either in front of the other.
fn by_middles(i: &[DVec3; 3], j: &[DVec3; 3]) -> f64 {
    let (n, m) = (cross(i), cross(j));
    let between = centroid(j) - centroid(i);
    let square = between.length_squared();
    let highest = |n: DVec3, from: DVec3, t: &[DVec3; 3]| t.iter().map(|&p| n.dot(p - from)).fold(0.0, f64::max);
    let (up, back) = (highest(n, i[0], j) / n.length(), highest(m, j[0], i));
    0.5 * up * back / (std::f64::consts::PI * square * square)
}

/// z in terms of the exchange A_i F_ij: both factors count, and both directions have the same bits.
fn stake(i: f64, j: f64) -> f64 {
    (0.5 / (i * i) + 0.5 / (j * j)).sqrt()
}

/// Where each pair is measured: the share of the tolerance that points may leave, and rays where points will not do.
const EACH_SHARE: f64 = 0.3;
const SMALL_FACTOR: f64 = 1e-2;
const EACH_RAYS: usize = 1 << 18;

/// Pairs of each class that are surveyed in a row, about.
const SURVEYED: f64 = 16.0;
/// Rays at each of them.
const SURVEY_RAYS: usize = 512;

/// What so many rays of a sequence leave of a squared spread of 1, where independent ones would leave 1/n: about so
/// between pairs that matter to their rows, near and far (`rays_leave_less_than_independent_ones`).
fn left_by(rays: f64) -> f64 {
    1.0 / (rays * rays.sqrt().sqrt())
}

/// So many rays, each as dear as `ray` usual ones, that what they cost and what they leave of a squared error, which is
/// worth `worth` usual rays, come to the least.
fn rays_for(worth: f64, ray: f64) -> f64 {
    // To the power of 7/16, for 4/9: roots have the same bits everywhere.
    let fourth = (1.25 * worth / ray).sqrt().sqrt();
    let eighth = fourth.sqrt();
    fourth * eighth * eighth.sqrt()
}

/// The same in both directions.
fn seed(i: u32, j: u32) -> u64 {
    (u64::from(i.min(j)) << 32 | u64::from(i.max(j))).wrapping_mul(splitmix::STEP)
}
