//! Cosine-distributed rays over an emitter's hemisphere: the patches it sees, and an estimate of those they missed.
//!
//! With n₁ and n₂ the numbers of patches hit by exactly one and exactly two of M rays, patches without a hit have about
//! Σ F = n₁ / M and Σ F² = 2 n₂ / M² (Good 1953, eqs. 9 and 22). This holds for any class of patches defined by the
//! scene alone, such as those with a bound of F below some least.
//!
//! Directions are stratified: the variance of a share is its variance within strata, estimated from neighbouring strata
//! (collapsed strata; Cochran 1977, § 5A.12), Σ (y₁ − y₂)² / M² over pairs of neighbours.

use super::facing::Facing;
use super::random::{Random, point_of};
use super::visibility::{Met, Occluders, Sight};
use glam::DVec3;
use std::f64::consts::TAU;

/// Strata along an edge of the unit square. Each ray has a point of its own: rays from one point hit the same patches,
/// and their counts would scatter more than the estimates above allow for.
const STRATA: u32 = 256;
const ROUND: u64 = (STRATA * STRATA) as u64;

/// Counts the hits of rays, for one row after the other.
#[derive(Debug)]
pub(super) struct Hemisphere {
    /// Hits of each patch; 0 for all but those in `found`.
    hits: Vec<u32>,
    found: Vec<u32>,
    escaped: u64,
    blocked: u64,
    rays: u64,
    /// Triangles that rays were held against.
    tests: u64,
    /// Result of each ray of a round, by the stratum of its direction.
    met: Vec<Share>,
    /// Numbers of neighbouring strata that differ in having escaped, in being blocked, and in either.
    differing: [u64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Share {
    Escaped,
    Blocked,
    Found,
}

/// The likely missing part of a row, in patches no ray met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Missing {
    /// Σ F.
    pub(super) sum: f64,
    /// Σ F².
    pub(super) squared: f64,
    /// The variance of `sum`.
    pub(super) variance: f64,
}

impl Hemisphere {
    /// The rays of one round, the fewest of a row.
    pub(super) const RAYS: u64 = ROUND;

    pub(super) fn new(patch_count: usize) -> Self {
        Self {
            hits: vec![0; patch_count],
            found: Vec::new(),
            escaped: 0,
            blocked: 0,
            rays: 0,
            tests: 0,
            met: vec![Share::Found; (STRATA * STRATA) as usize],
            differing: [0; 3],
        }
    }

    /// Forgets the row before.
    pub(super) fn begin(&mut self) {
        for &patch in &self.found {
            self.hits[patch as usize] = 0;
        }
        self.found.clear();
        (self.escaped, self.blocked, self.rays, self.tests) = (0, 0, 0, 0);
        self.differing = [0; 3];
    }

    /// Casts a round of rays from an emitter. `is_apart` tells patches that a closed surface keeps from it: a ray that
    /// meets one began on that surface, in contact with it, and is blocked there.
    pub(super) fn round(&mut self, occluders: &Occluders, emitter: &Sight, seed: u64, is_apart: impl Fn(u32) -> bool) {
        let round = self.rays / ROUND;
        each_stratum(emitter, [seed, u64::MAX, round], |stratum, origin, direction| {
            self.met[stratum as usize] =
                match occluders.first_counted(emitter, [origin, direction], &is_apart, &mut self.tests) {
                    Met::Nothing => {
                        self.escaped += 1;
                        Share::Escaped
                    }
                    Met::Back => {
                        self.blocked += 1;
                        Share::Blocked
                    }
                    Met::Patch(patch) if is_apart(patch) => {
                        self.blocked += 1;
                        Share::Blocked
                    }
                    Met::Patch(patch) => {
                        let hits = &mut self.hits[patch as usize];
                        if *hits == 0 {
                            self.found.push(patch);
                        }
                        *hits += 1;
                        Share::Found
                    }
                };
        });
        for pair in self.met.chunks_exact(2) {
            let differs = |is: fn(Share) -> bool| u64::from(is(pair[0]) != is(pair[1]));
            self.differing[0] += differs(|share| share == Share::Escaped);
            self.differing[1] += differs(|share| share == Share::Blocked);
            self.differing[2] += differs(|share| share == Share::Found);
        }
        self.rays += ROUND;
        self.found.sort_unstable();
    }

    /// The patches hit, ascending, and how often.
    pub(super) fn found(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.found.iter().map(|&patch| (patch, self.hits[patch as usize]))
    }

    pub(super) fn has_met(&self, patch: u32) -> bool {
        self.hits[patch as usize] > 0
    }

    pub(super) fn rays(&self) -> u64 {
        self.rays
    }

    /// Triangles that a ray was held against, on average.
    pub(super) fn tests_a_ray(&self) -> u64 {
        self.tests / self.rays.max(1)
    }

    pub(super) fn escaped(&self) -> f64 {
        self.escaped as f64 / self.rays.max(1) as f64
    }

    pub(super) fn blocked(&self) -> f64 {
        self.blocked as f64 / self.rays.max(1) as f64
    }

    /// The largest standard error of the escaped share, the blocked one, and the two together; at least one ray's
    /// share.
    pub(super) fn error_of_shares(&self) -> f64 {
        let most = self.differing.into_iter().max().unwrap_or(0).max(1);
        (most as f64).sqrt() / self.rays.max(1) as f64
    }

    /// The bounds of patches with so many hits, ascending.
    pub(super) fn bounds_of_hit(&self, times: u32, facing: &Facing) -> Vec<f64> {
        let mut bounds: Vec<f64> = self
            .found()
            .filter(|&(_, hits)| hits == times)
            .map(|(patch, _)| facing.bound(patch))
            .collect();
        bounds.sort_unstable_by(f64::total_cmp);
        bounds
    }

    /// The likely missing part in patches with a bound below `least`.
    pub(super) fn missing(&self, facing: &Facing, least: f64) -> Missing {
        if facing.are_all_from(least) {
            return Missing::default();
        }
        let rays = self.rays.max(1) as f64;
        let count = |times| {
            self.bounds_of_hit(times, facing)
                .partition_point(|&bound| bound < least) as f64
        };
        let (once, twice) = (count(1), count(2));
        // Rays without a hit prove little: a patch worth one of them is missed one time in three.
        let least_squared = if self.found.is_empty() { 1.0 } else { 0.0 };
        Missing {
            sum: once / rays,
            squared: (2.0 * twice).max(least_squared) / (rays * rays),
            variance: (once + 2.0 * twice).max(1.0) / (rays * rays),
        }
    }

    /// Σ F², from pairs of rays to the same patch.
    pub(super) fn squared_norm(&self) -> f64 {
        let rays = self.rays.max(2) as f64;
        let pairs: f64 = self
            .found()
            .map(|(_, hits)| f64::from(hits) * (f64::from(hits) - 1.0))
            .sum();
        pairs / (rays * (rays - 1.0))
    }
}

/// A round of rays from an emitter: stratum of the direction, origin, direction. `[seed, stream, round]` are its
/// numbers.
fn each_stratum(emitter: &Sight, [seed, stream, round]: [u64; 3], mut act: impl FnMut(u32, DVec3, DVec3)) {
    let tangent = (emitter.corners[1] - emitter.corners[0]).normalize_or_zero();
    let bitangent = emitter.normal.cross(tangent);
    let mut random = Random::of(&[seed, u64::from(emitter.patch), stream, round]);
    let keys = [random.next(), random.next()];
    for index in 0..STRATA * STRATA {
        let mut within = |stratum: u32| {
            let n = f64::from(STRATA);
            let (x, y) = (f64::from(stratum % STRATA), f64::from(stratum / STRATA));
            ((x + random.unit()) / n, (y + random.unit()) / n)
        };
        let (u, v) = within(index);
        let origin = point_of(&emitter.corners, u, v);
        let stratum = shuffled(index, keys);
        let (u, v) = within(stratum);
        let (sine, cosine) = (TAU * v).sin_cos();
        let radius = u.sqrt();
        let direction = tangent * (radius * cosine) + bitangent * (radius * sine) + emitter.normal * (1.0 - u).sqrt();
        act(stratum, origin, direction);
    }
}

/// A round of rays from an emitter, 2¹⁶: origin and direction of each.
pub(super) fn directions(emitter: &Sight, numbers: [u64; 3], mut act: impl FnMut(DVec3, DVec3)) {
    each_stratum(emitter, numbers, |_, origin, direction| act(origin, direction));
}

/// A permutation of the numbers below 2¹⁶: odd multipliers and shifts undo.
fn shuffled(index: u32, keys: [u64; 2]) -> u32 {
    let mut z = u64::from(index);
    for key in keys {
        z ^= key & 0xFFFF;
        z = z.wrapping_mul((key >> 16) | 1) & 0xFFFF;
        z ^= z >> 7;
        z = z.wrapping_mul((key >> 40) | 1) & 0xFFFF;
        z ^= z >> 9;
    }
    // Masked to 16 bits above.
    #[allow(clippy::cast_possible_truncation, reason = "below 2¹⁶")]
    let shuffled = z as u32;
    shuffled
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stratum_once() {
        for keys in [[1, 2], [u64::MAX, 0], [0x0123_4567_89AB_CDEF, 0xFEDC_BA98_7654_3210]] {
            let mut seen = vec![false; 1 << 16];
            for index in 0..STRATA * STRATA {
                seen[shuffled(index, keys) as usize] = true;
            }
            assert!(seen.iter().all(|&s| s));
        }
    }
}
