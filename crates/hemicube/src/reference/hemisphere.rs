//! Cosine-distributed rays over an emitter's hemisphere: which patches it sees at all, and what it may have missed.
//!
//! With n₁ and n₂ the numbers of patches that exactly one and exactly two of M rays hit, patches that none hit have about
//! Σ F = n₁ / M and Σ F² = 2 n₂ / M² (Good 1953, eqs. 9 and 22).

use super::random::{Random, point_of};
use super::visibility::{Met, Occluders, Sight};
use std::f64::consts::TAU;

/// Strata along an edge of the unit square: as many points of the emitter as rays, for rays that share a point hit the
/// same patches, and their counts scatter more than the estimates above allow for.
const STRATA: u32 = 256;
const ROUND: u64 = (STRATA * STRATA) as u64;

/// Counts what rays hit. Used for one row after the other.
#[derive(Debug)]
pub(super) struct Hemisphere {
    /// Hits of each patch: zero for all that are not in `found`.
    hits: Vec<u32>,
    found: Vec<u32>,
    escaped: u64,
    blocked: u64,
    rays: u64,
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
        }
    }

    /// Casts rays from an emitter until the squares of what they missed are likely less than `share` of the row's, or
    /// there are `max_rays`.
    pub(super) fn cast(&mut self, occluders: &Occluders, emitter: &Sight, seed: u64, share: f64, max_rays: u64) {
        for &patch in &self.found {
            self.hits[patch as usize] = 0;
        }
        self.found.clear();
        (self.escaped, self.blocked, self.rays) = (0, 0, 0);
        let tangent = (emitter.corners[1] - emitter.corners[0]).normalize_or_zero();
        let bitangent = emitter.normal.cross(tangent);
        for round in 0.. {
            let mut random = Random::of(&[seed, u64::from(emitter.patch), u64::MAX, round]);
            let keys = [random.next(), random.next()];
            for index in 0..STRATA * STRATA {
                let mut within = |stratum: u32| {
                    let n = f64::from(STRATA);
                    let (x, y) = (f64::from(stratum % STRATA), f64::from(stratum / STRATA));
                    ((x + random.unit()) / n, (y + random.unit()) / n)
                };
                let (u, v) = within(index);
                let origin = point_of(&emitter.corners, u, v);
                let (u, v) = within(shuffled(index, keys));
                let (sine, cosine) = (TAU * v).sin_cos();
                let radius = u.sqrt();
                let direction =
                    tangent * (radius * cosine) + bitangent * (radius * sine) + emitter.normal * (1.0 - u).sqrt();
                match occluders.first(emitter, origin, direction) {
                    Met::Nothing => self.escaped += 1,
                    Met::Back => self.blocked += 1,
                    Met::Patch(patch) => {
                        let hits = &mut self.hits[patch as usize];
                        if *hits == 0 {
                            self.found.push(patch);
                        }
                        *hits += 1;
                    }
                }
            }
            self.rays += ROUND;
            let is_enough = self.found.is_empty() || self.missed_squared() <= share * self.squared_norm();
            if is_enough || self.rays + ROUND > max_rays {
                break;
            }
        }
        self.found.sort_unstable();
    }

    /// The patches hit, ascending, and how often.
    pub(super) fn found(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.found.iter().map(|&patch| (patch, self.hits[patch as usize]))
    }

    pub(super) fn rays(&self) -> u64 {
        self.rays
    }

    pub(super) fn escaped(&self) -> f64 {
        self.escaped as f64 / self.rays.max(1) as f64
    }

    pub(super) fn blocked(&self) -> f64 {
        self.blocked as f64 / self.rays.max(1) as f64
    }

    pub(super) fn missed(&self) -> f64 {
        self.found().filter(|&(_, hits)| hits == 1).count() as f64 / self.rays.max(1) as f64
    }

    pub(super) fn missed_squared(&self) -> f64 {
        let rays = self.rays.max(1) as f64;
        if self.found.is_empty() {
            // That none met anything proves no more than that few would: a patch worth one of them is missed one time in three.
            return 1.0 / (rays * rays);
        }
        2.0 * self.found().filter(|&(_, hits)| hits == 2).count() as f64 / (rays * rays)
    }

    /// Σ F², from pairs of rays that hit the same patch.
    pub(super) fn squared_norm(&self) -> f64 {
        let rays = self.rays.max(2) as f64;
        let pairs: f64 = self
            .found()
            .map(|(_, hits)| f64::from(hits) * (f64::from(hits) - 1.0))
            .sum();
        pairs / (rays * (rays - 1.0))
    }
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
