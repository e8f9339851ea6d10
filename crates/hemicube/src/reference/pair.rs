//! One pair of patches: its closed form, and its visible fraction from kernel-weighted segments.
//!
//! Segments are points of the smaller patch, evenly, and directions evenly over the solid angle of the larger (Arvo
//! 1995), weighted by solid angle × cosine; for tiny solid angles, points of both, weighted by area × cos cos / r².
//! Both weights estimate the same integral, the closed form, and may be mixed. Points are an additive sequence in four
//! dimensions (Roberts 2018) with a random shift for each of sixteen independent batches; the batches' scatter is the
//! error.

use super::random::{Random, point_of};
use super::visibility::{Occluders, Sight};
use crate::factor::{FactorRule, exchange};
use crate::geometry::{Sphere, area, clip, quarters};
use glam::DVec3;

/// Independent batches of segments of a pair.
pub(super) const BATCHES: usize = 16;

/// 1/φ, 1/φ², … of the root of φ⁵ = φ + 1.
const STEPS: [f64; 4] = [
    0.856_674_883_854_502_9,
    0.733_891_856_627_126,
    0.628_706_721_037_808_7,
    0.538_597_257_223_610_1,
];

/// Distance of centroids, in sums of both radii, below which a pair is sampled by solid angle.
const NEAR: f64 = 4.0;
/// Least solid angle of a spherical triangle above rounding.
const LEAST_SOLID_ANGLE: f64 = 1e-6;

/// A receiver seen from the emitter.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    receiver: Sight,
    /// Hits by rays over the hemisphere.
    pub(super) hits: u32,
    /// The unoccluded form factor, and its own error.
    whole: f64,
    whole_error: f64,
    is_near: bool,
    /// The parts of the two in front of each other's plane, the smaller patch's first.
    outer: Pieces,
    inner: Pieces,
    shifts: [[f64; 4]; BATCHES],
    /// Segments of each batch.
    count: u64,
    seen: [f64; BATCHES],
    all: [f64; BATCHES],
    passed: u64,
    stopped: u64,
    last: Option<u32>,
}

impl Pair {
    /// `None` when neither faces the other. The closed form need not be surer than `enough`.
    pub(super) fn new(emitter: &Sight, receiver: &Sight, hits: u32, seed: u64, enough: f64) -> Option<Self> {
        let (outer, inner) = if emitter.area <= receiver.area {
            (emitter, receiver)
        } else {
            (receiver, emitter)
        };
        let (outer, inner) = (Pieces::new(outer, inner)?, Pieces::new(inner, outer)?);
        let distance = emitter.centroid().distance(receiver.centroid());
        let radii = radius(emitter) + radius(receiver);
        let (exchange, error) = unoccluded(&outer, &inner, distance < 10.0 * radii, enough * emitter.area);
        if exchange <= 0.0 {
            return None;
        }
        let mut random = Random::of(&[seed, u64::from(emitter.patch), u64::from(receiver.patch)]);
        Some(Self {
            receiver: receiver.clone(),
            hits,
            whole: exchange / emitter.area,
            whole_error: error / emitter.area,
            is_near: distance < NEAR * radii,
            outer,
            inner,
            shifts: std::array::from_fn(|_| std::array::from_fn(|_| random.unit())),
            count: 0,
            seen: [0.0; BATCHES],
            all: [0.0; BATCHES],
            passed: 0,
            stopped: 0,
            last: None,
        })
    }

    pub(super) fn receiver(&self) -> u32 {
        self.receiver.patch
    }

    /// The unoccluded form factor.
    pub(super) fn most(&self) -> f64 {
        self.whole
    }

    pub(super) fn rays(&self) -> u64 {
        self.count * BATCHES as u64
    }

    /// Numbers of segments: unoccluded, and all.
    pub(super) fn passed(&self) -> (u64, u64) {
        (self.passed, self.passed + self.stopped)
    }

    /// Returns whether neither a ray over the hemisphere nor a segment reached it.
    pub(super) fn is_hidden(&self) -> bool {
        self.hits == 0 && self.passed == 0
    }

    pub(super) fn is_partly_visible(&self) -> bool {
        self.passed > 0 && self.stopped > 0
    }

    /// The visible fraction; one half without a segment.
    fn fraction(&self) -> f64 {
        let all: f64 = self.all.iter().sum();
        if all > 0.0 {
            self.seen.iter().sum::<f64>() / all
        } else {
            0.5
        }
    }

    /// The form factor.
    pub(super) fn value(&self) -> f64 {
        self.fraction() * self.whole
    }

    /// The standard error of the form factor by sampling. `share_partly` is the chance of a pair of this row to be
    /// partly visible.
    pub(super) fn sampling_error(&self, share_partly: f64) -> f64 {
        let all: f64 = self.all.iter().sum();
        if all <= 0.0 {
            return 0.5 * self.whole;
        }
        let fraction = self.fraction();
        let scatter: f64 = self
            .seen
            .iter()
            .zip(&self.all)
            .map(|(seen, all)| (seen - fraction * all).powi(2))
            .sum();
        // Two more than the fraction's one degree of freedom: value over error then has variance 1, by Student's
        // distribution.
        let batches = BATCHES as f64;
        let measured = (scatter * batches / (batches - 3.0)).sqrt() / all;
        let rays = (self.passed + self.stopped).max(1) as f64;
        let floor = match (self.passed, self.stopped) {
            // A ray's worth may be occluded between rays that passed.
            (_, 0) => share_partly.sqrt() / rays,
            // A ray over the hemisphere met it: it is not wholly hidden. Pairs neither met nor reached are accounted
            // for together.
            (0, _) => f64::from(u8::from(self.hits > 0)) / rays,
            // Batches may agree by chance.
            _ => 0.5 / rays,
        };
        self.whole * measured.max(floor)
    }

    /// The standard error of the form factor.
    pub(super) fn error(&self, share_partly: f64) -> f64 {
        (self.sampling_error(share_partly).powi(2) + (self.fraction() * self.whole_error).powi(2)).sqrt()
    }

    /// c of the error c/√n of n rays.
    pub(super) fn spread(&self, share_partly: f64) -> f64 {
        self.sampling_error(share_partly) * (self.rays().max(1) as f64).sqrt()
    }

    /// Adds `count` segments to each batch.
    pub(super) fn cast(&mut self, occluders: &Occluders, emitter: &Sight, count: u64) {
        let emitter_first = emitter.area <= self.receiver.area;
        let (outer, inner) = if emitter_first {
            (emitter, &self.receiver)
        } else {
            (&self.receiver, emitter)
        };
        for (batch, shift) in self.shifts.iter().enumerate() {
            for k in self.count..self.count + count {
                let u: [f64; 4] = std::array::from_fn(|d| (shift[d] + k as f64 * STEPS[d]).fract());
                let (piece, v, _) = self.outer.pick(u[0]);
                let from = point_of(piece, v, u[1]);
                let (piece, v, share) = self.inner.pick(u[2]);
                let Some((to, weight)) = target(outer, inner, piece, from, self.is_near, v, u[3]) else {
                    continue;
                };
                let weight = weight / share;
                self.all[batch] += weight;
                let (from, to) = if emitter_first { (from, to) } else { (to, from) };
                if occluders.sees(emitter, from, &self.receiver, to, &mut self.last) {
                    self.seen[batch] += weight;
                    self.passed += 1;
                } else {
                    self.stopped += 1;
                }
            }
        }
        self.count += count;
    }
}

fn radius(sight: &Sight) -> f64 {
    Sphere::of(&sight.corners).radius()
}

/// The part of a triangle in front of a plane: one or two triangles.
#[derive(Clone, Debug)]
struct Pieces {
    first: [DVec3; 3],
    second: Option<[DVec3; 3]>,
    /// The first one's share of the area.
    share: f64,
}

impl Pieces {
    /// The part of a triangle in front of another's plane.
    fn new(of: &Sight, plane: &Sight) -> Option<Self> {
        let heights = of.corners.map(|corner| plane.height(corner));
        let least = 1e-12 * radius(of);
        if heights.iter().all(|&h| h >= -least) {
            return Some(Self {
                first: of.corners,
                second: None,
                share: 1.0,
            });
        }
        let mut outline = Vec::with_capacity(4);
        clip(&of.corners, |corner| plane.height(corner), &mut outline);
        match outline[..] {
            [a, b, c] => Some(Self {
                first: [a, b, c],
                second: None,
                share: 1.0,
            }),
            [a, b, c, d] => {
                let (first, second) = ([a, b, c], [a, c, d]);
                let (p, q) = (area(&first), area(&second));
                (p + q > 0.0).then(|| Self {
                    first,
                    second: Some(second),
                    share: p / (p + q),
                })
            }
            _ => None,
        }
    }

    fn iter(&self) -> impl Iterator<Item = &[DVec3; 3]> {
        std::iter::once(&self.first).chain(&self.second)
    }

    /// The piece at a number in 0..1, the number's place in that piece's part, and the piece's share.
    fn pick(&self, u: f64) -> (&[DVec3; 3], f64, f64) {
        match &self.second {
            Some(second) if u >= self.share => (second, (u - self.share) / (1.0 - self.share), 1.0 - self.share),
            _ => (&self.first, u / self.share, self.share),
        }
    }
}

/// A point of `piece`, a part of `inner`, and the weight of the segment to it; `None` if one of the two is seen from
/// behind.
fn target(
    outer: &Sight,
    inner: &Sight,
    piece: &[DVec3; 3],
    from: DVec3,
    is_near: bool,
    u: f64,
    v: f64,
) -> Option<(DVec3, f64)> {
    let depth = inner.height(from);
    if depth <= 0.0 {
        return None;
    }
    if is_near && let Some((direction, solid_angle)) = direction_over(piece, from, u, v) {
        let cosine = outer.normal.dot(direction);
        let approach = -inner.normal.dot(direction);
        if cosine <= 0.0 || approach <= 0.0 {
            return None;
        }
        return Some((from + direction * (depth / approach), solid_angle * cosine));
    }
    let to = point_of(piece, u, v);
    let segment = to - from;
    let squared = segment.length_squared();
    let (cosine, approach) = (outer.normal.dot(segment), -inner.normal.dot(segment));
    // Both cosines carry a length: r⁴ below.
    (cosine > 0.0 && approach > 0.0).then(|| (to, area(piece) * cosine * approach / (squared * squared)))
}

/// A direction from `point` evenly over the solid angle of a triangle, and the solid angle (Arvo 1995; Van Oosterom &
/// Strackee 1983). `None` if the angle is lost in rounding.
fn direction_over(corners: &[DVec3; 3], point: DVec3, u: f64, v: f64) -> Option<(DVec3, f64)> {
    let [a, b, c] = corners.map(|corner| (corner - point).normalize_or_zero());
    let volume = a.dot(b.cross(c)).abs();
    let solid_angle = 2.0 * volume.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
    if !(LEAST_SOLID_ANGLE..).contains(&solid_angle) {
        return None;
    }
    // The angle at a, between the planes through b and through c.
    let (ab, ac) = (a.cross(b).try_normalize()?, a.cross(c).try_normalize()?);
    let cos_alpha = ab.dot(ac).clamp(-1.0, 1.0);
    let sin_alpha = ab.cross(ac).length();
    let alpha = sin_alpha.atan2(cos_alpha);
    let (s, t) = (u * solid_angle - alpha).sin_cos();
    let p = t - cos_alpha;
    let q = s + sin_alpha * a.dot(b);
    let denominator = (q * s + p * t) * sin_alpha;
    if denominator == 0.0 {
        return None;
    }
    let along = (((q * t - p * s) * cos_alpha - q) / denominator).clamp(-1.0, 1.0);
    let middle = a * along + (c - a * c.dot(a)).try_normalize()? * (1.0 - along * along).max(0.0).sqrt();
    let z = 1.0 - v * (1.0 - middle.dot(b));
    let direction = b * z + (middle - b * middle.dot(b)).try_normalize()? * (1.0 - z * z).max(0.0).sqrt();
    Some((direction, solid_angle))
}

/// The unoccluded exchange area A_i F_ij, and its own error.
///
/// Each is first cut at the other's plane: a quadrature would smear the closed form's kink between crossing surfaces.
/// If the two are near each other, the outer triangle is divided into four, and the pieces with the largest change
/// again (plates a hair apart have factors like steps), until the changes add up to little.
fn unoccluded(outer: &Pieces, inner: &Pieces, is_near: bool, enough: f64) -> (f64, f64) {
    let rule = FactorRule::for_tolerance(1e-4);
    let (mut value, mut error) = (0.0, 0.0);
    for p in outer.iter() {
        for q in inner.iter() {
            if !is_near {
                value += exchange(p, q, &rule);
                continue;
            }
            let (small, large) = if area(p) <= area(q) { (p, q) } else { (q, p) };
            let (v, e) = divided(small, large, &rule, enough);
            value += v;
            error += e;
        }
    }
    (value, error.max(1e-7 * value))
}

/// A piece of the outer triangle, the exchange areas of its quarters, and their sum's difference from its own.
struct Piece {
    corners: [DVec3; 3],
    quarters: [f64; 4],
    change: f64,
}

impl Piece {
    fn new(corners: [DVec3; 3], coarse: f64, inner: &[DVec3; 3], rule: &FactorRule) -> Self {
        let quarters = quarters(&corners).map(|part| exchange(&part, inner, rule));
        Self {
            corners,
            quarters,
            change: (quarters.iter().sum::<f64>() - coarse).abs(),
        }
    }
}

/// The exchange area of two triangles near each other, and a bound of its error, by adaptive division of the outer one.
fn divided(outer: &[DVec3; 3], inner: &[DVec3; 3], rule: &FactorRule, enough: f64) -> (f64, f64) {
    let mut pieces = vec![Piece::new(*outer, exchange(outer, inner, rule), inner, rule)];
    loop {
        let value: f64 = pieces.iter().flat_map(|piece| piece.quarters).sum();
        let error: f64 = pieces.iter().map(|piece| piece.change).sum();
        let enough = enough.max(ENOUGH * value);
        if error <= enough || pieces.len() >= MOST_PIECES {
            return (value, error);
        }
        // All pieces with more than their part in the error at once: sorting out the worst one by one is quadratic.
        let least = 0.5 * enough / pieces.len() as f64;
        let mut next = Vec::with_capacity(4 * pieces.len());
        for piece in pieces {
            if piece.change <= least {
                next.push(piece);
                continue;
            }
            for (corners, coarse) in quarters(&piece.corners).into_iter().zip(piece.quarters) {
                next.push(Piece::new(corners, coarse, inner, rule));
            }
        }
        pieces = next;
    }
}

/// Relative error of a closed form at which division ends.
const ENOUGH: f64 = 1e-5;
/// Number of pieces at which division ends: some hundred milliseconds.
const MOST_PIECES: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions over a solid angle, weighted by the cosine, give the closed form from a point.
    #[test]
    fn directions_are_even_over_the_solid_angle() {
        let corners = [
            DVec3::new(0.1, 0.0, 0.3),
            DVec3::new(0.2, 1.0, 0.5),
            DVec3::new(1.5, 0.2, 0.4),
        ];
        let exact = crate::factor::point_to_triangle(DVec3::ZERO, DVec3::Z, &corners);
        let n = 400;
        let (mut sum, mut low) = (0.0, 0.0);
        for x in 0..n {
            for y in 0..n {
                let (u, v) = ((f64::from(x) + 0.5) / f64::from(n), (f64::from(y) + 0.5) / f64::from(n));
                let (direction, solid_angle) = direction_over(&corners, DVec3::ZERO, u, v).expect("a large triangle");
                let weight = solid_angle * direction.z / std::f64::consts::PI / f64::from(n * n);
                sum += weight;
                // The part to the left of the plane x = y, an uneven share.
                if direction.x < direction.y {
                    low += weight;
                }
            }
        }
        assert!((sum / exact - 1.0).abs() < 1e-4, "{sum} {exact}");
        let cut = |p: DVec3, q: DVec3| p + (q - p) * ((p.x - p.y) / ((p.x - p.y) - (q.x - q.y)));
        let [a, b, c] = corners;
        let part = [cut(a, b), b, cut(b, c)];
        let exact = crate::factor::point_to_triangle(DVec3::ZERO, DVec3::Z, &part);
        assert!((low / exact - 1.0).abs() < 5e-3, "{low} {exact}");
    }
}
