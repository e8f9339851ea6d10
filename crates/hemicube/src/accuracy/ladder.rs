//! The ladder of rays: how many a measurement takes next, of a pair or of a row's non-visible shares.
//!
//! After each step the rays so far say, by their spread, how many would do: at a price
//! ([`rays_for`](super::error_model::rays_for)) or for an error ([`rays_to_leave`]). So many are taken next, and at most
//! [`GROWTH`] times as many as there are: most spreads that the first rays leave open, the next resolve.

/// Growth of the number of rays before it is asked again how many are needed. Measured by `scoreboard board`: with 2, a pair
/// is judged by few rays more often and measured exactly in vain: leaves at 0.1 % take 335 million steps a row, not 10.
pub(crate) const GROWTH: usize = 4;

/// The number of rays to have next, a multiple of `step`; `None` where `rays` are as many as `wanted`, or as `most`.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to a number of rays"
)]
pub(crate) fn next(rays: usize, wanted: f64, most: usize, step: usize) -> Option<usize> {
    let wanted = (wanted.clamp(0.0, most as f64) as usize).next_multiple_of(step);
    (wanted > rays).then(|| wanted.min(GROWTH * rays))
}

/// The number of rays n that leave this part of one ray's variance: n^(−5/4) = `part`, the inverse of
/// [`variance_of_rays`](super::error_model::variance_of_rays).
pub(crate) fn rays_to_leave(part: f64) -> f64 {
    // n⁵ = r⁴ by Newton's method from r^(13/16), above the root: roots and products have the same bits everywhere.
    let r = 1.0 / part.clamp(1e-30, 1.0);
    let half = r.sqrt();
    let fourth = half.sqrt();
    let mut rays = half * fourth * fourth.sqrt().sqrt();
    for _ in 0..9 {
        rays = 0.8 * rays + 0.2 * (r / rays).powi(4);
    }
    rays
}

/// The rays of the smallest whole net of a sequence that has so many, from `least`, a power of two, to `most`. Parts of a
/// net leave more than n^(−5/4): shares to the very number asked for took 9 to 14 % fewer steps in a city, and 95 % of the
/// sums of rows were 1.5 to 3.7 times as far off in three of sixteen scenes (`scoreboard board`).
pub(crate) fn whole_net(rays: f64, least: usize, most: usize) -> f64 {
    let mut net = least;
    while (net as f64) < rays && net < most {
        net *= 2;
    }
    net as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::error_model::variance_of_rays;

    #[test]
    fn so_many_rays_leave_that_part() {
        for rays in [1.0, 2.0, 16.0, 1000.0, 131_072.0, 1e9, 1e12] {
            let found = rays_to_leave(variance_of_rays(rays));
            assert!((found / rays - 1.0).abs() < 1e-9, "{rays}: {found}");
        }
        assert_eq!(rays_to_leave(2.0), 1.0, "one ray at least");
        assert!(rays_to_leave(0.0).is_finite());
    }

    #[test]
    fn rays_grow_to_what_is_wanted_and_no_further() {
        assert_eq!(next(64, 10_000.0, 1 << 17, 16), Some(256));
        assert_eq!(next(256, 300.5, 1 << 17, 16), Some(304));
        assert_eq!(next(304, 304.0, 1 << 17, 16), None);
        assert_eq!(next(1024, f64::INFINITY, 2048, 16), Some(2048));
        assert_eq!(next(2048, f64::INFINITY, 2048, 16), None);
        assert_eq!(next(16, f64::NAN, 2048, 16), None);
    }

    #[test]
    fn nets_are_whole() {
        let nets = [0.0, 256.0, 257.0, 5000.0, f64::INFINITY].map(|rays| whole_net(rays, 256, 1 << 17));
        assert_eq!(nets, [256.0, 256.0, 512.0, 8192.0, 131_072.0]);
    }
}
