//! Measures the constants of [`super::error_model`] anew.
//!
//! `scripts/fit-error-model` runs it over a block city and a real tile, uncut and cut, and prints each committed value
//! beside the measured one. Values that are choices are not here: [`super::error_model`] says which.

use crate::Model;
use crate::accuracy::error_model::{NEAR_RAY, SHAFT_RAYS, TREE_RAY, variance_of_rays};
use crate::accuracy::row::Emitter;
use crate::factor::{FactorRule, exchange};
use crate::sampling::splitmix;
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::segments::Obstacles;
use crate::visibility::shaft::{Cast, PatchTriangle, STEPS_A_SEGMENT, Shaft};
use hemicube_scene::InputPatch;
use std::time::{Duration, Instant};

/// A committed value and its measurement.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Name and unit.
    pub name: String,
    /// The value in the source.
    pub committed: f64,
    /// The value measured; NaN if nothing was.
    pub measured: f64,
    /// Number of pairs that it was measured on.
    pub pairs: f64,
}

/// Numbers of rays at which their gain is measured.
pub const LEVELS: [usize; 4] = [16, 64, 256, 1024];

/// Rays of Sobol sequences against independent ones, and their cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayMeasurements {
    /// Σ F² (error)² and Σ F² v (1 − v) / n, of distant pairs and of near ones, by [`LEVELS`].
    sums: [[(f64, f64); LEVELS.len()]; 2],
    /// Number of pairs, distant and near.
    pub pairs: [usize; 2],
    /// Directions drawn between near pairs, and the rays that they were worth.
    drawn: usize,
    worth: usize,
    /// Time of shafts, and of rays against a list, between near patches, and down the tree; with their numbers.
    shafts: Timed,
    listed: Timed,
    near: Timed,
    tree: Timed,
}

#[derive(Clone, Copy, Debug, Default)]
struct Timed {
    time: Duration,
    count: usize,
}

impl Timed {
    fn add(&mut self, began: Instant, count: usize) {
        self.time += began.elapsed();
        self.count += count;
    }

    fn seconds(&self) -> f64 {
        self.time.as_secs_f64() / self.count as f64
    }
}

/// Least form factor of the pairs measured, and the range of their visible fractions.
const LEAST_FACTOR: f64 = 0.004;
const FRACTIONS: std::ops::RangeInclusive<f64> = 0.02..=0.98;

impl RayMeasurements {
    /// Measures the partly visible pairs of every `stride`th patch.
    pub fn add(&mut self, model: &Model, stride: usize) {
        let regions = CoplanarRegions::of(model);
        let obstacles = Obstacles::new(model, &regions);
        let rule = FactorRule::for_tolerance(1e-2);
        let count = model.geometry().patch_count;
        let mut shaft = Shaft::default();
        for i in (0..count).step_by(stride.max(1)) {
            let emitter = Emitter::new(model, InputPatch(i));
            for j in (0..count).filter(|&j| j != i) {
                let receiver = model.normalised_corners(j);
                let factor = exchange(&emitter.corners, &receiver, &rule) / emitter.area;
                if factor < LEAST_FACTOR {
                    continue;
                }
                shaft.clear();
                let began = Instant::now();
                let mut pair = shaft.pair(obstacles, emitter.triangle(), PatchTriangle::new(j, &receiver));
                self.shafts.add(began, 1);
                if pair.proved_fraction().is_some() {
                    continue;
                }
                let cast = |rays: usize, seed: u64| {
                    let mut cast = Cast::default();
                    let rays = shaft.cast(obstacles, &pair, rays, seed, &mut cast);
                    (rays, cast)
                };
                let exact: Option<f64> = (0..4).map(|k| cast(1 << 14, k).1.fraction()).sum();
                let Some(exact) = exact.map(|sum| 0.25 * sum) else {
                    continue;
                };
                if !FRACTIONS.contains(&exact) {
                    continue;
                }
                let near = usize::from(pair.is_near);
                self.pairs[near] += 1;
                for (level, rays) in LEVELS.into_iter().enumerate() {
                    for seed in 0..4 {
                        let (rays, cast) = cast(rays, splitmix::hash(u64::from(j) * 4 + seed));
                        let Some(fraction) = cast.fraction() else { continue };
                        let sum = &mut self.sums[near][level];
                        sum.0 += (factor * (fraction - exact)).powi(2);
                        sum.1 += factor * factor * exact * (1.0 - exact) / rays as f64;
                        if pair.is_near {
                            (self.drawn, self.worth) = (self.drawn + cast.drawn, self.worth + rays);
                        }
                    }
                }
                if pair.is_crowded {
                    continue;
                }
                let most = LEVELS[LEVELS.len() - 1];
                let began = Instant::now();
                let rays = shaft.cast(obstacles, &pair, most, 1, &mut Cast::default());
                let timed = if pair.is_near { &mut self.near } else { &mut self.listed };
                timed.add(began, rays);
                pair.is_crowded = true;
                let began = Instant::now();
                let rays = shaft.cast_segments(obstacles, &pair, most, 1, &mut Cast::default());
                self.tree.add(began, rays);
            }
        }
    }

    /// Number of independent rays that one of a sequence is worth, of distant pairs and of near ones, by [`LEVELS`].
    pub fn gains(&self) -> [[f64; LEVELS.len()]; 2] {
        self.sums
            .map(|of| of.map(|(squared, independent)| independent / squared))
    }

    /// Directions drawn for each ray's worth between near patches.
    pub fn directions_a_ray(&self) -> f64 {
        self.drawn as f64 / self.worth as f64
    }

    /// The constants of rays and their measurements. Times are of this machine.
    pub fn fitted(&self) -> Vec<Fitted> {
        let gains = self.gains();
        // Gain n^(e − 1): its logarithm between the first and the last level.
        let last = LEVELS.len() - 1;
        let ratio = LEVELS[last] as f64 / LEVELS[0] as f64;
        let exponent = |of: [f64; LEVELS.len()]| 1.0 + (of[last] / of[0]).ln() / ratio.ln();
        let committed = -variance_of_rays(ratio).ln() / ratio.ln();
        let [distant, near] = self.pairs.map(|pairs| pairs as f64);
        let of = |name: &str, committed, measured, pairs| Fitted {
            name: name.to_owned(),
            committed,
            measured,
            pairs,
        };
        let listed = self.listed.seconds();
        vec![
            of("exponent of rays, distant", committed, exponent(gains[0]), distant),
            of("exponent of rays, near", committed, exponent(gains[1]), near),
            of("NEAR_RAY, in rays", NEAR_RAY, self.near.seconds() / listed, near),
            of(
                "TREE_RAY, in rays",
                TREE_RAY,
                self.tree.seconds() / listed,
                distant + near,
            ),
            of(
                "STEPS_A_SEGMENT, in ns",
                STEPS_A_SEGMENT as f64,
                1e9 * self.tree.seconds(),
                distant + near,
            ),
            of(
                "SHAFT_RAYS, in rays",
                SHAFT_RAYS,
                self.shafts.seconds() / listed,
                self.shafts.count as f64,
            ),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use hemicube_scene::{Patches, Subdivision};

    /// n rays leave about the error of n^(5/4) independent ones.
    #[test]
    #[allow(clippy::print_stderr, reason = "docs/dev/accuracy.md has these figures")]
    fn rays_leave_less_than_independent_ones() {
        let parameters = hemicube_scene::generate::BlockCityParameters {
            blocks: 6,
            split: 2,
            ..hemicube_scene::generate::BlockCityParameters::for_target(1000, 1)
        };
        let patches = Patches::new(&parameters.generate().expect("a city"), Subdivision::None).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let mut measured = RayMeasurements::default();
        measured.add(&model, 61);
        let (gains, pairs) = (measured.gains(), measured.pairs);
        eprintln!(
            "16, 64, 256 and 1,024 rays do as well as {gains:.1?} times as many independent ones, over {pairs:?} \
             distant and near pairs; {:.1} directions for a near ray's worth",
            measured.directions_a_ray()
        );
        assert!(pairs[0] > 100 && pairs[1] > 40, "{pairs:?} pairs");
        for of in gains {
            assert!(of[0] > 0.8 && of[2] > 1.8 && of[3] > 2.5, "{gains:?}");
        }
    }
}
