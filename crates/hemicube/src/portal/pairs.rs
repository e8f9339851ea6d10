//! Pairs through portals: the closed form between the moved emitter and a receiver, times the share that comes through.
//!
//! ```text
//! F_ij,g = F⁰(g⁻¹ i, j) Σ K W / Σ K         K = cos φ_i cos φ_j / r², W the weight that comes through
//! ```
//!
//! over segments between evenly drawn points of i and of the image g j. Each segment is the ray that starts towards the
//! image: it goes through whatever portals it meets, and W is what arrives at the point of j under the motion g. If all
//! W are equal, the pair is as exact as the closed form.

use super::motion::{Motion, MotionId, Motions};
use super::trace::{Arrival, Ends, Ray, Tally, Tracer};
use crate::accuracy::ray_shares;
use crate::accuracy::row::Emitter;
use crate::geometry::{self, Plane};
use crate::sampling::sobol::{BATCH, Sequence, fold};
use crate::sampling::splitmix;
use glam::DVec3;

/// The weight of a segment.
const UNIT: u64 = 1 << 40;
/// Distance of an arrival from the point aimed at, in normalised units.
const AT: f64 = 1e-6;

/// Factor on the error of shares of one dimension more than rays have: measured on a mirror of half the height.
const CAUTION: f64 = 2.0;

/// A measured share of a closed form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Share {
    /// Σ K W / Σ K.
    pub(super) share: f64,
    /// The part of arrivals handed on.
    pub(super) passed: f64,
    /// Its standard error.
    pub(super) error: f64,
    pub(super) segments: usize,
}

/// Arrivals at the point that a segment aims at.
struct Aim {
    at: DVec3,
    motion: MotionId,
    length: f64,
    arrived: u64,
    passed: u64,
}

impl Tally for Aim {
    fn arrive(&mut self, ray: &Ray, arrival: &Arrival) {
        let is_there = ray.passes > 0
            && ray.motion == self.motion
            && (arrival.length - self.length).abs() < AT
            && arrival.at.distance(self.at) < AT;
        if is_there && arrival.patch.is_some() {
            self.arrived += ray.weight;
            self.passed += arrival.passed;
        }
    }

    fn escape(&mut self, _ray: &Ray) {}

    fn cut(&mut self, _ray: &Ray, _weight: u64) {}
}

/// A pair to measure: an emitter, and a patch under a motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Through<'e> {
    pub(super) emitter: &'e Emitter<'e>,
    pub(super) motion: MotionId,
    pub(super) patch: u32,
    /// Segments, at least and at most; multiples of 16.
    pub(super) least: usize,
    pub(super) most: usize,
    /// The tracer's legs after which no further segments are drawn.
    pub(super) until: u64,
    /// Share of the weight at which paths end.
    pub(super) bound: f64,
}

impl Through<'_> {
    /// Measures the share to a standard error of `wanted`.
    pub(super) fn measure(&self, wanted: f64, tracer: &mut Tracer, motions: &mut Motions) -> Option<Share> {
        let motion: Motion = *motions.get(self.motion);
        let own = self.emitter.corners;
        let corners = self.emitter.model.normalised_corners(self.patch);
        let image = motion.triangle(corners);
        let normal = geometry::cross(&own).try_normalize()?;
        let facing = geometry::cross(&image).try_normalize()?;
        let horizon = Plane {
            normal,
            offset: normal.dot(own[0]),
        };
        let seed = u64::from(self.emitter.patch.0) << 32 | u64::from(self.patch);
        let sequence = Sequence::new(splitmix::hash(seed ^ u64::from(self.motion) << 17));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share")]
        let least = (UNIT as f64 * self.bound) as u64;
        let ends = |length: f64| Ends {
            reach: length + AT,
            least,
            only: Some(self.motion),
        };
        let (mut sum, mut arrived, mut passed) = (0.0, 0.0, 0.0);
        let mut found: Vec<(f64, f64)> = Vec::with_capacity(self.least);
        let mut count = 0;
        loop {
            let until = if count == 0 { self.least } else { 2 * count };
            for at in (count..until).step_by(BATCH) {
                let u = sequence.points(at);
                for l in 0..BATCH {
                    let from = on(&own, u[0][l], u[1][l]);
                    let to = on(&corners, u[2][l], u[3][l]);
                    let aim = motion.point(to) - from;
                    let length = aim.length();
                    let towards = aim / length;
                    let kernel = normal.dot(towards).max(0.0) * (-facing.dot(towards)).max(0.0) / (length * length);
                    if kernel.is_nan() || kernel <= 0.0 {
                        continue;
                    }
                    let ray = Ray {
                        from,
                        towards,
                        horizon,
                        weight: UNIT,
                        passes: 0,
                        motion: 0,
                        length: 0.0,
                    };
                    let mut aimed = Aim {
                        at: to,
                        motion: self.motion,
                        length,
                        arrived: 0,
                        passed: 0,
                    };
                    tracer.follow(ray, ends(length), motions, &mut aimed);
                    let weight = aimed.arrived as f64 / UNIT as f64;
                    sum += kernel;
                    arrived += kernel * weight;
                    passed += kernel * (aimed.passed as f64 / UNIT as f64);
                    found.push((kernel, weight));
                }
            }
            count = until;
            if found.is_empty() {
                return None;
            }
            let share = arrived / sum;
            let all_alike = found.iter().all(|&(_, weight)| (weight - found[0].1).abs() < 1e-9);
            let squares: f64 = found
                .iter()
                .map(|&(kernel, weight)| (kernel * (weight - share)).powi(2))
                .sum();
            let number = found.len() as f64;
            let spread = squares * number / (sum * sum);
            let error = if all_alike {
                0.0
            } else {
                CAUTION * ray_shares::error(spread, count)
            };
            if error <= wanted || count >= self.most || tracer.legs >= self.until {
                return Some(Share {
                    share,
                    passed: if arrived > 0.0 { passed / arrived } else { 0.0 },
                    error,
                    segments: count,
                });
            }
        }
    }
}

/// A point of a triangle.
fn on([a, b, c]: &[DVec3; 3], u: f64, v: f64) -> DVec3 {
    let (s, t) = fold(u, v);
    *a + (*b - *a) * s + (*c - *a) * t
}
