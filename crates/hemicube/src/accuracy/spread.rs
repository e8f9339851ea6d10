//! How the mean of a measurement's rays errs, told by the spread of parts of them.

use crate::accuracy::error_model::{rays_for, variance_of_rays};
use crate::visibility::shaft::MOST_PARTS;

/// Least number of parts whose spread tells how rays err. A choice: with fewer, the spread is known worse, 1 ÷ √8 of
/// itself now; with more, parts are too small to tell n^(−5/4) from 1 ÷ n.
pub(crate) const PARTS: usize = 16;
const _: () = assert!(
    2 * PARTS == MOST_PARTS,
    "a pair's parts are merged where there are twice as many"
);

/// How the mean of rays errs: the part q of a ray's variance lies in what is too small for the rays to resolve.
///
/// ```text
/// variance of n rays = w · ((1 − q) n^(−5/4) + q ÷ n),   w = X (1 − X)
/// ```
///
/// and at least w g n^(−5/4), where g is what rays leave in the scene's pairs in the mean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spread {
    /// w, the variance of one ray.
    ray: f64,
    /// g: [`RayGain`](super::error_model::RayGain), or 1.
    gain: f64,
    /// q, from 0 to 1.
    unresolved: f64,
}

impl Spread {
    /// Rays that resolve all.
    pub(crate) fn resolved(ray: f64, gain: f64) -> Self {
        Self {
            ray,
            gain,
            unresolved: 0.0,
        }
    }

    /// Rays that resolve nothing.
    pub(crate) const fn independent(ray: f64) -> Self {
        Self {
            ray,
            gain: 1.0,
            unresolved: 1.0,
        }
    }

    /// By the means of at least [`PARTS`] parts, of so many rays each; of fewer, all is taken for resolved. The part q
    /// is the one that explains their variance, less the standard error that this has at q = 0: most rows have none.
    pub(crate) fn of(means: &[f64], rays: f64, ray: f64, gain: f64) -> Self {
        if means.len() < PARTS || rays <= 1.0 {
            return Self::resolved(ray, gain);
        }
        let resolved = variance_of_rays(rays);
        let more = 1.0 / rays - resolved;
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        let freedom = (means.len() - 1) as f64;
        let found = means.iter().map(|of| (of - mean).powi(2)).sum::<f64>() / freedom;
        let noise = (2.0 / freedom).sqrt() * resolved;
        let unresolved = (found / ray - resolved - noise) / more;
        Self {
            ray,
            gain,
            unresolved: if unresolved > 0.0 { unresolved.min(1.0) } else { 0.0 },
        }
    }

    /// The squared standard error of the mean of so many rays.
    pub(crate) fn squared_error(self, rays: f64) -> f64 {
        let resolved = variance_of_rays(rays);
        let usual = self.gain * resolved;
        if self.unresolved <= 0.0 {
            return self.ray * usual;
        }
        let told = (1.0 - self.unresolved) * resolved + self.unresolved / rays;
        self.ray * if told > usual { told } else { usual }
    }

    /// The standard error of the mean of so many rays.
    pub(crate) fn error(self, rays: usize) -> f64 {
        self.squared_error(rays as f64).sqrt()
    }

    /// About the number of rays n that minimises `ray` · n + `value` · error², see [`rays_for`]. What a ray is worth
    /// follows from the number, and changes little with it: three rounds find it.
    pub(crate) fn rays_worth(self, value: f64, ray: f64) -> f64 {
        let mut rays = rays_for(value * self.ray * self.gain, ray).max(1.0);
        if self.unresolved > 0.0 {
            for _ in 0..3 {
                let one = self.squared_error(rays) / variance_of_rays(rays);
                rays = rays_for(value * one, ray).max(1.0);
            }
        }
        rays
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::splitmix;

    #[test]
    fn the_spread_of_parts_tells_rays_that_err_independently() {
        let mut state = 7;
        let mut draw = || splitmix::unit(splitmix::next(&mut state));
        // Means of 64 rays each of variance 1: uniform draws of the standard deviation asked for.
        let mut found = |deviation: f64| -> Vec<f64> {
            let mut parts = || -> Vec<f64> { (0..PARTS).map(|_| deviation * 12f64.sqrt() * (draw() - 0.5)).collect() };
            (0..200)
                .map(|_| Spread::of(&parts(), 64.0, 1.0, 1.0).unresolved)
                .collect()
        };
        let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
        let resolved = found(variance_of_rays(64.0).sqrt());
        let independent = found(0.125);
        assert!(mean(&resolved) < 0.1, "{}", mean(&resolved));
        assert!(mean(&independent) > 0.6, "{}", mean(&independent));
        assert!(resolved.iter().filter(|&&of| of == 0.0).count() > 150);
        let alike = Spread::of(&[0.5; PARTS], 64.0, 0.25, 1.0);
        assert_eq!(
            alike.squared_error(1024.0),
            0.25 * variance_of_rays(1024.0),
            "the law alone"
        );
        let few = Spread::of(&[0.0, 1.0], 64.0, 0.25, 1.0);
        assert_eq!(few.unresolved, 0.0, "too few parts tell nothing");
        // Where the scene's rays leave three times as much in the mean, and this pair's err independently.
        let apart: [f64; PARTS] = std::array::from_fn(|k| 0.5 + 0.0625 * if k % 2 == 0 { 1.0 } else { -1.0 });
        let leaves = Spread::of(&apart, 64.0, 0.25, 3.0);
        assert!(leaves.unresolved > 0.6, "{leaves:?}");
        assert_eq!(
            leaves.squared_error(16.0),
            0.75 * variance_of_rays(16.0),
            "the scene's at first"
        );
        assert!(leaves.squared_error(4096.0) > 0.6 * 0.25 / 4096.0, "{leaves:?}");
    }

    #[test]
    fn so_many_rays_are_worth_their_price() {
        for (spread, value, ray) in [
            (Spread::resolved(0.25, 1.0), 1e6, 1.0),
            (Spread::resolved(0.1, 2.5), 1e8, 11.0),
            (Spread::independent(0.25), 1e6, 1.5),
            (
                Spread {
                    unresolved: 0.2,
                    ..Spread::resolved(0.25, 1.0)
                },
                1e9,
                1.0,
            ),
        ] {
            let cost = |rays: f64| ray * rays + value * spread.squared_error(rays);
            let found = spread.rays_worth(value, ray);
            let least = (0..400)
                .map(|step| cost(1.05f64.powi(step)))
                .fold(f64::INFINITY, f64::min);
            assert!(
                cost(found) < 1.02 * least,
                "{spread:?}: {found} rays, {} of {least}",
                cost(found)
            );
        }
    }
}
