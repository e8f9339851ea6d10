//! The error model of visible fractions: prior variances, the variance that rays leave, and the multiplier λ between
//! squared error and rays.
//!
//! Errors of different pairs are independent, so squared errors add up. Let λ be the number of rays that a unit of
//! squared error is worth. A pair left with its hemicube's fraction contributes z² d, with z² = (F_ij² + F_ji²) / 2 of
//! its unoccluded form factors and the prior variance d of its cell in [`PriorVariances`]. Measured by n rays of spread
//! s it contributes z² s² n^(−5/4), so that n = (5/4 λ z² s²)^(4/9) is the cheapest number (`rays_for`). It is measured
//! where λ z² d exceeds the cost of a shaft and its rays.
//!
//! `scripts/fit-error-model` measures the tables and the exponent anew and prints how far the committed ones are off.

use crate::geometry::Sphere;
use crate::store::ERRORS;
use crate::visibility::shaft::RAYS;
use glam::DVec3;

/// Classes of visible fractions by a hemicube: partly visible, all visible, not visible.
pub(crate) const CLASSES: usize = 3;
/// The class of patches that no hemicube sees.
pub(crate) const UNSEEN: usize = 2;
/// Steps of nearness, by factors of 2 in the distance of centroids in √(r_i² + r_j²): below 2, 2 to 4, … 128 and more.
pub(crate) const NEARNESSES: usize = 8;
/// Groups of pairs whose errors have one cause in a row, see [`PriorCell::group`].
pub(crate) const GROUPS: usize = CLASSES + 2;

/// Mean squared errors of visible fractions from one hemicube at the centroid, by the fraction it found (three classes)
/// and by the distance of the two patches (eight steps).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PriorVariances([[f32; NEARNESSES]; CLASSES]);

impl Default for PriorVariances {
    /// For scenes of which nothing is measured: a choice on the large side of rooms, cities and machines. A pair that
    /// the sample of rows did not meet is rare, and not known to be harmless.
    fn default() -> Self {
        Self([
            [0.08, 0.06, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05],
            [0.02, 0.01, 0.005, 0.003, 0.002, 0.002, 0.002, 0.002],
            [0.1, 0.05, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01],
        ])
    }
}

impl PriorVariances {
    /// Variances by class and nearness, one after the other; `None` where they are not as many.
    pub(crate) fn of_table(variances: &[f64]) -> Option<Self> {
        let mut table = [[0.0; NEARNESSES]; CLASSES];
        if variances.len() != CLASSES * NEARNESSES {
            return None;
        }
        for (to, &variance) in table.as_flattened_mut().iter_mut().zip(variances) {
            #[allow(clippy::cast_possible_truncation, reason = "it was an f32")]
            let variance = variance as f32;
            *to = variance;
        }
        Some(Self(table))
    }

    /// The variances by class and nearness.
    pub fn table(&self) -> &[[f32; NEARNESSES]; CLASSES] {
        &self.0
    }

    pub(crate) fn of(&self, cell: PriorCell) -> f64 {
        f64::from(self.0[cell.class as usize][cell.nearness as usize])
    }
}

/// A pair's cell in the table of prior variances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PriorCell {
    pub(crate) class: u8,
    pub(crate) nearness: u8,
}

impl PriorCell {
    /// A patch that no hemicube sees.
    pub(crate) fn unseen(nearness: u8) -> Self {
        Self {
            class: class_of(0.0),
            nearness,
        }
    }

    /// Group of pairs with a common cause of error, a point standing badly for a patch: those of a class; unseen ones,
    /// from near neighbours to a whole street, also by nearness.
    pub(crate) fn group(self) -> usize {
        match (usize::from(self.class), self.nearness) {
            (UNSEEN, 0) => CLASSES,
            (UNSEEN, 1 | 2) => CLASSES + 1,
            (class, _) => class,
        }
    }
}

/// The class of a visible fraction.
pub(crate) fn class_of(fraction: f64) -> u8 {
    if fraction >= 1.0 {
        1
    } else if fraction <= 0.0 {
        2
    } else {
        0
    }
}

/// The step of nearness of two triangles, 0 for the nearest.
pub(crate) fn nearness_of(i: &[DVec3; 3], j: &[DVec3; 3]) -> u8 {
    let (i, j) = (Sphere::of(i), Sphere::of(j));
    let radii = i.center.distance_squared(j.center) / (i.squared_radius + j.squared_radius);
    // The exponent of a power of 4.
    let exponent = (radii.to_bits() >> 52) as i64 - 1023;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let step = exponent.div_euclid(2).clamp(0, NEARNESSES as i64 - 1) as u8;
    step
}

/// One cell of [`PriorSums`].
#[derive(Clone, Copy, Debug, Default)]
struct PriorSum {
    /// Σ w (error)², with w = F² over the chance of being drawn.
    squared_error: f64,
    /// Σ w.
    weight: f64,
    /// Number of pairs.
    count: f64,
}

/// Sums from which prior variances are estimated, over pairs drawn from a scene's rows and measured by rays.
#[derive(Clone, Copy, Debug, Default)]
pub struct PriorSums {
    cells: [[PriorSum; NEARNESSES]; CLASSES],
    /// Squared errors of a pair's first rays by all of its rays, in those of usual ones.
    rays: PriorSum,
}

/// Factor of the variance that rays leave in a scene to that of usual ones, n^(−5/4): above 1 where many
/// small occluders lie between two patches, and rays err like independent ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayGain(f32);

impl Default for RayGain {
    fn default() -> Self {
        Self(1.0)
    }
}

impl RayGain {
    /// A factor as [`Self::factor`] tells it.
    pub(crate) fn of(factor: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "it was an f32")]
        let factor = factor as f32;
        Self(factor)
    }

    pub(crate) fn factor(self) -> f64 {
        f64::from(self.0)
    }
}

/// Number of pairs with which the default prior variance is averaged into a measured one. A choice: with 1, a row of a
/// block city sums 0.7 % off at 0.3 %; with 5, the board's rows take a tenth more steps at 1 % (`scoreboard board`).
const DEFAULT_PAIRS: f64 = 3.0;

impl PriorSums {
    /// Adds a pair: the squared error of its fraction, and its weight.
    pub(crate) fn add(&mut self, cell: PriorCell, squared_error: f64, weight: f64) {
        let sum = &mut self.cells[usize::from(cell.class)][usize::from(cell.nearness)];
        sum.squared_error += weight * squared_error;
        sum.weight += weight;
        sum.count += 1.0;
    }

    /// Adds the squared error of a pair's first rays, and what usual rays would leave, with the pair's weight.
    pub(crate) fn add_rays(&mut self, squared_error: f64, usual: f64, weight: f64) {
        self.rays.squared_error += weight * squared_error;
        self.rays.weight += weight * usual;
        self.rays.count += 1.0;
    }

    /// The factor of rays' variance to that of usual ones, averaged with 1 as if this came from [`DEFAULT_PAIRS`] pairs
    /// more.
    pub(crate) fn ray_gain(&self) -> RayGain {
        if self.rays.weight <= 0.0 {
            return RayGain::default();
        }
        let usual = DEFAULT_PAIRS * self.rays.weight / self.rays.count;
        #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
        let found = ((self.rays.squared_error + usual) / (self.rays.weight + usual)) as f32;
        RayGain(found)
    }

    /// Measured variances, averaged with the default ones as if these came from [`DEFAULT_PAIRS`] pairs more.
    pub(crate) fn priors(&self) -> PriorVariances {
        let mut priors = PriorVariances::default();
        for (prior, sum) in priors.0.iter_mut().flatten().zip(self.cells.iter().flatten()) {
            if sum.count > 0.0 {
                let usual = DEFAULT_PAIRS * sum.weight / sum.count;
                #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
                let found = ((sum.squared_error + usual * f64::from(*prior)) / (sum.weight + usual)) as f32;
                *prior = found;
            }
        }
        priors
    }

    /// By class and nearness: the measured variance, NaN where no pair was drawn, and the number of pairs.
    pub fn measured(&self) -> [[(f64, f64); NEARNESSES]; CLASSES] {
        self.cells
            .map(|of| of.map(|sum| (sum.squared_error / sum.weight, sum.count)))
    }
}

/// Expected error of a pair left with its hemicube's fraction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ErrorContribution {
    /// z √d.
    pub(crate) both: f64,
    /// F √d.
    pub(crate) own: f64,
    pub(crate) is_near: bool,
}

impl ErrorContribution {
    /// The expected squared error in the own row with multiplier λ, where pairs of z √d √λ ≤ [`MEASURED_FROM`] are not
    /// measured, and rays leave `gain` of what usual ones do.
    pub(crate) fn left(&self, multiplier: f64, gain: RayGain) -> f64 {
        let (own, both) = (self.own * self.own, self.both * self.both * multiplier);
        if both <= MEASURED_FROM * MEASURED_FROM {
            return own;
        }
        let ray = if self.is_near { NEAR_RAY } else { 1.0 };
        let gain = gain.factor();
        own * gain * variance_of_rays(rays_for(both * gain, ray).max(RAYS as f64))
    }
}

/// The multiplier λ at which pairs leave about `budget` of squared error, within 9 %; the least positive number if they
/// leave no more at λ = 0.
pub(crate) fn multiplier_for<'a>(
    contributions: impl Iterator<Item = &'a ErrorContribution> + Clone,
    budget: f64,
    gain: RayGain,
) -> f64 {
    let error = |multiplier: f64| {
        contributions
            .clone()
            .map(|pair| pair.left(multiplier, gain))
            .sum::<f64>()
    };
    if budget.is_infinite() || error(0.0) <= budget {
        return f64::MIN_POSITIVE;
    }
    // Bisect the logarithm by square roots: they have the same bits everywhere, unlike powers.
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

/// Variance of the mean of n rays of a Sobol sequence relative to one ray's: n^(−5/4), with 1/n for independent rays.
///
/// Measured between pairs of large form factors (`rays_leave_less_than_independent_ones`): from 16 to 1,024 rays,
/// `scripts/fit-error-model` finds the exponents 1.30 for distant pairs and 1.14 for near ones. For rows at
/// 1 % of the Cornell box, an aeroplane and a city, 1.14 for all takes a fifth to a quarter more rays, 1.30 up to 3 %
/// fewer, and errors change by 5 % at most: the one between them stays.
pub(crate) fn variance_of_rays(rays: f64) -> f64 {
    1.0 / (rays * rays.sqrt().sqrt())
}

/// Number of rays n that minimises `ray` · n + `value` · n^(−5/4): `value` is the squared error of one ray in terms of
/// usual rays, λ z² s², and `ray` the cost of a ray relative to a usual one.
pub(crate) fn rays_for(value: f64, ray: f64) -> f64 {
    // To the power of 7/16, for 4/9: roots have the same bits everywhere.
    let fourth = (1.25 * value / ray).sqrt().sqrt();
    let eighth = fourth.sqrt();
    fourth * eighth * eighth.sqrt()
}

/// Cost of a shaft and of beginning to measure a pair, in rays. `scripts/fit-error-model` prints the shaft's part.
pub(crate) const SHAFT_RAYS: f64 = 800.0;
/// z √d √λ from which a pair is measured: with √d for the spread, a shaft of [`SHAFT_RAYS`] and the rays then cost what
/// they save: 30² is 800 rays and some more.
pub(crate) const MEASURED_FROM: f64 = 30.0;
/// Share of the squared error aimed at that visible fractions may leave, and pairs that no ray measures: closed forms are
/// evaluated to T / 2 ([`crate::accuracy::refine::Refinement::for_tolerance`]), a quarter of T².
pub(crate) const FRACTIONS_SHARE: f64 = 0.75;
/// Standard error of a row's sum in tolerances, at most: three of them stay within the tolerance.
pub(crate) const ROW_SUM: f64 = 1.0 / ERRORS;
/// Share of a row's permitted error from which on unseen pairs are looked for: three such errors are permitted.
pub(crate) const REACH: f64 = 1.0 / ERRORS;
/// Cost of a ray between near patches relative to a usual one. `scripts/fit-error-model` measures 1.5.
pub(crate) const NEAR_RAY: f64 = 1.5;
/// Cost of a ray down the tree relative to a usual one. `scripts/fit-error-model` measures 11.
pub(crate) const TREE_RAY: f64 = 11.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_that_leave_more_than_usual_ones_are_known_by_their_first() {
        let gain = |squared_error: f64, pairs: usize| {
            let mut sums = PriorSums::default();
            (0..pairs).for_each(|_| sums.add_rays(squared_error, 1e-4, 1.0));
            sums.ray_gain().factor()
        };
        assert_eq!(gain(0.0, 0), 1.0, "of nothing measured, they are usual ones");
        assert_eq!(gain(1e-4, 50), 1.0);
        assert!((gain(3e-4, 50) - 3.0).abs() < 0.15, "{}", gain(3e-4, 50));
        assert!(gain(3e-4, 1) < 1.6, "one pair is believed a quarter");
        let usual = multiplier_for([pair()].iter(), 1e-7, RayGain::default());
        let more = multiplier_for([pair()].iter(), 1e-7, RayGain(3.0));
        assert!(more > 2.0 * usual, "so more rays are paid for: {usual} {more}");
    }

    fn pair() -> ErrorContribution {
        ErrorContribution {
            both: 0.1,
            own: 0.1,
            is_near: false,
        }
    }
}
