//! Rays of a patch that meet portals first.
//!
//! The row knows which portals it sees, and how much of each. Rays are aimed at them, as many at each as of N rays from
//! all over the patch would meet it: so the row costs what it hands on, and no ray is spent on what is known. A ray
//! has the weight by which its portal was drawn too often or too seldom,
//!
//! ```text
//! w = cos θ Ω(x) / (π F)    a direction evenly of the solid angle Ω that the portal has at the point x (Arvo 1995,
//!                           "Stratified sampling of spherical triangles"), or
//! w = K A / F               a point evenly of a portal of area A that is small for its distance, K = cosθ cosφ / πr²
//! ```
//!
//! and none where something else is met. Portals with few rays share a sequence.

use super::gather::{Column, Found, Gather, Ledger};
use super::motion::{MotionId, Motions};
use super::trace::{Ends, MetAt, Ray, Tracer};
use crate::accuracy::ray_shares;
use crate::accuracy::row::Emitter;
use crate::bvh::LANES;
use crate::geometry::{self, Plane};
use crate::sampling::sobol::{BATCH, Sequence, fold};
use crate::sampling::splitmix;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

/// The weight of a ray of N.
pub(super) const RAY: u64 = 1 << 34;
/// Most that a ray may weigh more. Only near a corner, or where the row errs, is there more.
const HEAVIEST: f64 = 256.0;
/// Rays of a row at least.
const LEAST: f64 = 64.0;
/// The longest edge of a portal, in parts of its distance, up to which points of it are drawn evenly. A choice: with
/// more, rays to near portals differ in weight; with less, distant ones are divided in vain.
const SMALL: f64 = 0.25;
/// The inverse golden ratio: its multiples, without whole parts, are even at any number.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A portal that the row sees.
#[derive(Debug)]
struct Target {
    patch: u32,
    slot: u32,
    corners: [DVec3; 3],
    /// Its form factor in the row.
    factor: f64,
    area: f64,
    normal: DVec3,
    longest: f64,
}

/// A direction drawn.
struct Aimed {
    towards: DVec3,
    distance: f64,
    /// Its expectation is the form factor of what is aimed at, if nothing hides it.
    value: f64,
}

impl Target {
    fn new(tracer: &Tracer, patch: u32, factor: f64) -> Option<Self> {
        let slot = *tracer.tree.slot_of_patch.get(patch as usize)?;
        let corners = tracer
            .tree
            .blocks
            .get(slot as usize / LANES)?
            .triangle(slot as usize % LANES);
        let [a, b, c] = corners;
        let across = geometry::cross(&corners);
        Some(Self {
            patch,
            slot,
            corners,
            factor,
            area: 0.5 * across.length(),
            normal: across.try_normalize()?,
            longest: (b - a).length().max((c - b).length()).max((a - c).length()),
        })
    }

    /// Draws a direction from a point of a surface with that normal.
    fn draw(&self, from: DVec3, normal: DVec3, u: f64, v: f64) -> Option<Aimed> {
        let [a, b, c] = self.corners.map(|corner| corner - from);
        let nearest = a.length().min(b.length()).min(c.length());
        if self.longest < SMALL * nearest {
            let (s, t) = fold(u, v);
            let aim = a + (b - a) * s + (c - a) * t;
            let distance = aim.length();
            let towards = aim / distance;
            let kernel = normal.dot(towards) * self.normal.dot(towards).abs() / (PI * distance * distance);
            return Some(Aimed {
                towards,
                distance,
                value: kernel * self.area,
            });
        }
        let (towards, solid) = spherical([a, b, c], u, v)?;
        let distance = self.normal.dot(a) / self.normal.dot(towards);
        (distance.is_finite() && distance > 0.0).then_some(Aimed {
            towards,
            distance,
            value: normal.dot(towards) * solid / PI,
        })
    }
}

/// A direction evenly of a triangle's solid angle, and the solid angle (Arvo 1995).
fn spherical(corners: [DVec3; 3], u: f64, v: f64) -> Option<(DVec3, f64)> {
    let [a, b, c] = corners.map(DVec3::normalize_or_zero);
    let angle = |at: DVec3, p: DVec3, q: DVec3| {
        let (p, q) = (p - at.dot(p) * at, q - at.dot(q) * at);
        p.cross(q).length().atan2(p.dot(q))
    };
    let alpha = angle(a, b, c);
    let area = alpha + angle(b, c, a) + angle(c, a, b) - PI;
    if area.is_nan() || area < 1e-12 {
        return None;
    }
    let (s, t) = (u * area - alpha).sin_cos();
    let (sin, cos) = alpha.sin_cos();
    let (p, q) = (t - cos, s + sin * a.dot(b));
    let below = (q * s + p * t) * sin;
    let place = (((q * t - p * s) * cos - q) / below).clamp(-1.0, 1.0);
    if !place.is_finite() {
        return None;
    }
    let across = |of: DVec3, from: DVec3| (of - from.dot(of) * from).normalize_or_zero();
    let corner = a * place + across(c, a) * (1.0 - place * place).max(0.0).sqrt();
    let z = 1.0 - v * (1.0 - corner.dot(b));
    let towards = b * z + across(corner, b) * (1.0 - z * z).max(0.0).sqrt();
    Some((towards.try_normalize()?, area))
}

/// Rays at one portal, or at many with few rays each.
#[derive(Debug)]
struct Stratum {
    /// Their targets, and the sums of their form factors up to each.
    targets: Vec<Target>,
    sums: Vec<f64>,
    /// Rays of the first round.
    first: usize,
    sequence: Sequence,
    offset: f64,
}

impl Stratum {
    fn new(targets: Vec<Target>, first: usize, seed: u64) -> Self {
        let mut sum = 0.0;
        let sums = targets.iter().map(|target| {
            sum += target.factor;
            sum
        });
        Self {
            sums: sums.collect(),
            targets,
            first,
            sequence: Sequence::new(splitmix::hash(seed)),
            offset: splitmix::unit(splitmix::hash(seed ^ 1 << 63)),
        }
    }

    fn factor(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The target of a ray.
    fn target(&self, ray: usize) -> Option<&Target> {
        if self.targets.len() < 2 {
            return self.targets.first();
        }
        let at = (self.offset + GOLDEN * ray as f64).fract() * self.factor();
        let place = self.sums.partition_point(|&sum| sum <= at);
        self.targets.get(place.min(self.targets.len() - 1))
    }
}

/// Weight of a ray, and the part of it at which its paths are cut off.
#[derive(Clone, Copy)]
struct Worth {
    weight: f64,
    bound: f64,
}

/// Rays of one emitter.
#[derive(Debug)]
pub(super) struct Casts<'e> {
    pub(super) emitter: &'e Emitter<'e>,
    horizon: Plane,
    strata: Vec<Stratum>,
    /// N: as if that many rays had been cast, in all directions.
    pub(super) count: usize,
    first: usize,
}

impl<'e> Casts<'e> {
    /// Rays at the portals of a row, of which there are (patch, form factor), as if `first` of all directions.
    pub(super) fn new(
        emitter: &'e Emitter<'e>,
        tracer: &Tracer,
        portals: impl Iterator<Item = (u32, f64)>,
        first: usize,
    ) -> Self {
        let normal = geometry::cross(&emitter.corners).normalize_or(DVec3::Z);
        let targets: Vec<Target> = portals
            .filter(|&(_, factor)| factor > 0.0)
            .filter_map(|(patch, factor)| Target::new(tracer, patch, factor))
            .collect();
        let sum: f64 = targets.iter().map(|target| target.factor).sum();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let whole = |rays: f64| rays as usize;
        let first = first.max(whole(LEAST / sum.max(1e-12))).min(1 << 30);
        let rays = |factor: f64| whole(first as f64 * factor) / BATCH * BATCH;
        let seed = (u64::from(emitter.patch.0) + 1) << 32;
        let (many, few): (Vec<_>, Vec<_>) = targets.into_iter().partition(|target| rays(target.factor) > 0);
        let mut strata: Vec<Stratum> = many
            .into_iter()
            .map(|target| {
                let (rays, seed) = (rays(target.factor), seed | u64::from(target.patch));
                Stratum::new(vec![target], rays, seed)
            })
            .collect();
        if !few.is_empty() {
            let sum = few.iter().map(|target| target.factor).sum();
            strata.push(Stratum::new(few, rays(sum).max(BATCH), seed | u64::from(u32::MAX)));
        }
        Self {
            emitter,
            horizon: Plane {
                normal,
                offset: normal.dot(emitter.corners[0]),
            },
            strata,
            count: 0,
            first,
        }
    }

    /// Doubles the rays. Paths are cut off at `bound` of their weight.
    pub(super) fn cast(
        &mut self,
        bound: f64,
        cancel: &AtomicBool,
        tracer: &mut Tracer,
        motions: &mut Motions,
        ledger: &mut Ledger,
        column: impl Fn(u32) -> Column,
    ) {
        let mut gather = Gather { ledger, column };
        let round = self.count / self.first;
        let until = (2 * round).max(1);
        for stratum in &self.strata {
            // By as much as it has fewer rays than its share.
            let worth = Worth {
                weight: RAY as f64 * self.first as f64 * stratum.factor() / stratum.first as f64,
                bound,
            };
            for at in (round * stratum.first..until * stratum.first).step_by(BATCH) {
                // Nobody wants a cancelled row: its weights need not say anything.
                if cancel.load(Ordering::Relaxed) {
                    break;
                }
                let u = stratum.sequence.points(at);
                for l in 0..BATCH {
                    let Some(target) = stratum.target(at + l) else { continue };
                    let u = [u[0][l], u[1][l], u[2][l], u[3][l]];
                    self.shoot(target, u, worth, tracer, motions, &mut gather);
                }
            }
        }
        self.count = until * self.first;
    }

    /// Casts a ray at a portal, if that is what it meets.
    fn shoot(
        &self,
        target: &Target,
        u: [f64; 4],
        Worth { weight, bound }: Worth,
        tracer: &mut Tracer,
        motions: &mut Motions,
        gather: &mut Gather<'_, impl Fn(u32) -> Column>,
    ) {
        let [a, b, c] = self.emitter.corners;
        let (s, t) = fold(u[0], u[1]);
        let from = a + (b - a) * s + (c - a) * t;
        let Some(aimed) = target.draw(from, self.horizon.normal, u[2], u[3]) else {
            return;
        };
        let heavier = (aimed.value / target.factor).min(HEAVIEST);
        if heavier.is_nan() || heavier <= 0.0 {
            return;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "above 0, below 2⁴⁴"
        )]
        let [weight, least] = [weight * heavier, weight * heavier * bound].map(|weight| weight as u64);
        let ray = Ray {
            from,
            towards: aimed.towards,
            horizon: self.horizon,
            weight,
            passes: 0,
            motion: 0,
            length: 0.0,
        };
        tracer.legs += 1;
        // Past it by a hair, so that it is met.
        let end = from + aimed.towards * (aimed.distance * (1.0 + 1e-9) + 1e-9);
        let Some(met) = tracer.nearest([from, end], &self.horizon) else {
            return;
        };
        if met.id == target.patch && met.slot == target.slot {
            let met = MetAt {
                id: met.id,
                slot: met.slot,
                corners: met.corners,
                distance: aimed.distance,
            };
            let ends = Ends {
                reach: f64::INFINITY,
                least,
                only: None,
            };
            tracer.meet(&ray, &met, ends, motions, gather);
            tracer.follow_rest(ends, motions, gather);
        }
    }

    /// Rays cast.
    pub(super) fn rays(&self) -> usize {
        let first: usize = self.strata.iter().map(|stratum| stratum.first).sum();
        first * (self.count / self.first)
    }

    /// A weight as a share of all rays'.
    pub(super) fn share(&self, weight: u64) -> f64 {
        weight as f64 / (self.count as f64 * RAY as f64)
    }

    /// The form factor that a ray stands for where a pair was found, times N.
    fn each(&self, found: &Found) -> f64 {
        self.share(found.weight) / f64::from(found.hits.max(1)) * self.count as f64
    }

    /// The number of hits expected of a pair of that form factor.
    pub(super) fn hits(&self, factor: f64, found: &Found) -> f64 {
        factor * self.count as f64 / self.each(found).max(f64::MIN_POSITIVE)
    }

    /// The variance of a pair known by rays: of hits of the same weight.
    pub(super) fn variance(&self, found: &Found) -> f64 {
        self.variance_at(f64::from(found.hits), found)
    }

    /// Likewise by another number of hits.
    pub(super) fn variance_at(&self, hits: f64, found: &Found) -> f64 {
        let share = (hits / self.count as f64).min(1.0);
        (self.each(found) * ray_shares::error(share * (1.0 - share), self.count)).powi(2)
    }

    /// The form factor that a ray stands for in the mean of these pairs, times N; 1 where rays found none.
    pub(super) fn mean_each<'f>(&self, of: impl Iterator<Item = &'f Found>) -> f64 {
        let add = |(weight, hits): (u64, u64), found: &Found| (weight + found.weight, hits + u64::from(found.hits));
        let (weight, hits) = of.fold((0, 0), add);
        if hits > 0 {
            self.share(weight) / hits as f64 * self.count as f64
        } else {
            1.0
        }
    }

    /// The variance of a share that rays met, of which each stands for `each` / N; 0 where none did.
    pub(super) fn variance_of_share(&self, share: f64, each: f64) -> f64 {
        let met = (share / each).min(1.0);
        if met > 0.0 {
            (each * ray_shares::error(met * (1.0 - met), self.count)).powi(2)
        } else {
            0.0
        }
    }

    /// The variance of all pairs that are not measured: those past the `most` first, and those of fewer than `least`
    /// hits.
    pub(super) fn rest(&self, entries: &[((MotionId, u32), Found)], most: usize, least: f64) -> f64 {
        let rest = entries
            .iter()
            .enumerate()
            .filter(|(place, (_, found))| *place >= most || f64::from(found.hits) < least);
        rest.map(|(_, (_, found))| self.variance(found)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of draws is the form factor of a corner: a right triangle over a point, by the contour integral.
    #[test]
    fn both_ways_of_drawing_have_the_same_mean() {
        let corners = [
            DVec3::new(0.1, 0.2, 0.5),
            DVec3::new(1.1, 0.3, 0.6),
            DVec3::new(0.2, 1.4, 0.9),
        ];
        let normal = geometry::cross(&corners).normalize();
        let [a, b, c] = corners.map(DVec3::normalize);
        let edge = |p: DVec3, q: DVec3| p.cross(q).normalize() * p.dot(q).acos();
        let exact = ((edge(a, b) + edge(b, c) + edge(c, a)).z / (2.0 * PI)).abs();
        let sequence = Sequence::new(7);
        for longest in [0.0, 10.0] {
            let target = Target {
                patch: 0,
                slot: 0,
                corners,
                factor: 1.0,
                area: 0.5 * geometry::cross(&corners).length(),
                normal,
                longest,
            };
            let count = 1_u16 << 14;
            let mut sum = 0.0;
            for at in (0..usize::from(count)).step_by(BATCH) {
                let u = sequence.points(at);
                let drawn = (0..BATCH).filter_map(|l| target.draw(DVec3::ZERO, DVec3::Z, u[0][l], u[1][l]));
                sum += drawn.map(|aimed| aimed.value).sum::<f64>();
            }
            let mean = sum / f64::from(count);
            assert!((mean - exact).abs() < 1e-4 * exact, "{longest}: {mean} {exact}");
        }
    }
}
