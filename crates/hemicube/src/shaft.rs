//! How much of a triangle another one sees: the shaft between the two lists what may come in between, and rays at those
//! few occluders measure the visible fraction.
//!
//! The shaft (Haines & Wallace 1991) is the convex hull of the two triangles. What lies outside one of its planes cannot
//! come in between; an empty shaft proves that all is visible, and a triangle that all nine segments between corners pass
//! through proves that nothing is. Below the emitter's plane and behind the receiver's nothing occludes; what lies in the
//! receiver's own plane does if its patch has the smaller id, as in a backend's rows.
//!
//! The visible fraction is Σ k V / Σ k over points drawn on both triangles, with the same points above and below and the
//! kernel k = cos φ_i cos φ_j / r² as weight: times the closed form it gives F_ij without the bias of uniform visibility.
#![allow(
    unsafe_code,
    reason = "functions compiled for an instruction set are called after it was found"
)]

use crate::random;
use crate::tree::{INNER, LANES, Tree, UNUSED};
use glam::DVec3;
use std::ops::Range;

/// Rays cast together.
pub(crate) const RAYS: usize = 16;

/// What lies within this part of the pair's extent of a side of the shaft counts as outside.
const OUTSIDE: f64 = 4e-6;

/// What rises less than this part of the pair's extent above one of the planes is met in f64: rays in f32 are not sure on
/// which side of it they begin and end.
const BESIDE: f64 = 1e-4;

/// See [`Sighting::near`].
const NEAR: f64 = 2.0;

/// A triangle that may come in between, relative to the sighting's origin.
#[derive(Clone, Copy, Debug)]
struct Occluder {
    corner: [f32; 3],
    edges: [[f32; 3]; 2],
    normal: [f32; 3],
    /// block × 16 + lane in the tree.
    slot: u32,
    /// Squared twice its area: the large ones stop most rays.
    size: f32,
}

/// Lists what may come in between two triangles, for many pairs one after the other.
#[derive(Debug, Default)]
pub(crate) struct Shaft {
    /// n · p ≥ d inside.
    planes: Vec<([f64; 3], f64)>,
    /// Of all sightings since [`Shaft::clear`].
    occluders: Vec<Occluder>,
    pending: Vec<u32>,
    low: [f64; 3],
    high: [f64; 3],
}

/// Two triangles that look at each other, and what may be in between.
#[derive(Clone, Debug)]
pub(crate) struct Sighting {
    /// The emitter and the receiver relative to `origin`.
    pub(crate) emitter: [DVec3; 3],
    pub(crate) receiver: [DVec3; 3],
    pub(crate) origin: DVec3,
    /// The middle of the smaller one is near the other, in radii of either: a few segments between evenly drawn points would
    /// carry most of the weight.
    pub(crate) near: bool,
    /// Whether the receiver is the smaller of the two.
    pub(crate) receiver_is_smaller: bool,
    /// The emitter's area in areas of the smaller of the two.
    pub(crate) emitter_share: f64,
    /// What is between the two planes.
    between: Range<usize>,
    /// What is so near to one of the planes that rays in f32 cannot tell on which side.
    beside: Vec<[DVec3; 3]>,
    /// What lies in the receiver's plane and hides it, as its id is smaller.
    pub(crate) over: Vec<[DVec3; 3]>,
    /// One triangle hides all of it.
    pub(crate) hidden: bool,
}

impl Sighting {
    /// Whether all is visible: proved, as nothing may come in between.
    pub(crate) fn is_open(&self) -> bool {
        self.between.is_empty() && self.beside.is_empty() && self.over.is_empty()
    }

    /// Whether something beside stops the segment from `x` to `y`, or something over the receiver is seen at its end.
    fn is_stopped(&self, x: DVec3, y: DVec3) -> bool {
        let within = |[a, b, c]: &[DVec3; 3], n: DVec3, p: DVec3| {
            [(a, b), (b, c), (c, a)]
                .iter()
                .all(|&(s, t)| (*t - *s).cross(p - *s).dot(n) >= 0.0)
        };
        let normal = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]);
        self.over.iter().any(|t| within(t, normal(t), y))
            || self.beside.iter().any(|t| {
                let n = normal(t);
                let (hx, hy) = (n.dot(x - t[0]), n.dot(y - t[0]));
                hx * hy < 0.0 && within(t, n, x + (y - x) * (hx / (hx - hy)))
            })
    }
}

impl Shaft {
    /// Forgets all sightings.
    pub(crate) fn clear(&mut self) {
        self.occluders.clear();
    }

    /// Lists what may come in between an emitting patch and a receiving one.
    pub(crate) fn sight(
        &mut self,
        tree: &Tree,
        (i, emitter): (u32, &[DVec3; 3]),
        (j, receiver): (u32, &[DVec3; 3]),
    ) -> Sighting {
        let origin = emitter[0];
        let local = |t: &[DVec3; 3]| t.map(|p| p - origin);
        let (emitter, receiver) = (local(emitter), local(receiver));
        let points = [
            emitter[0],
            emitter[1],
            emitter[2],
            receiver[0],
            receiver[1],
            receiver[2],
        ];
        let size = points.iter().map(|p| p.length_squared()).fold(0.0, f64::max).sqrt();
        let sphere = |t: &[DVec3; 3]| {
            let center = (t[0] + t[1] + t[2]) / 3.0;
            (
                center,
                t.iter().map(|p| p.distance_squared(center)).fold(0.0, f64::max).sqrt(),
            )
        };
        let ((c0, r0), (c1, r1)) = (sphere(&emitter), sphere(&receiver));
        let (mut low, mut high) = (DVec3::ZERO, DVec3::ZERO);
        for p in points {
            low = low.min(p);
            high = high.max(p);
        }
        let slack = DVec3::splat(OUTSIDE * size);
        (self.low, self.high) = ((low - slack).to_array(), (high + slack).to_array());
        self.make_planes(&points, size);
        let start = self.occluders.len();
        let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length_squared();
        let receiver_is_smaller = area(&receiver) < area(&emitter);
        let mut sighting = Sighting {
            emitter,
            receiver,
            origin,
            near: if receiver_is_smaller {
                crate::factor::distance(c1, &emitter) < (NEAR * r1).max(r0)
            } else {
                crate::factor::distance(c0, &receiver) < (NEAR * r0).max(r1)
            },
            receiver_is_smaller,
            emitter_share: (area(&emitter) / area(&receiver).min(area(&emitter)).max(f64::MIN_POSITIVE)).sqrt(),
            between: start..start,
            beside: Vec::new(),
            over: Vec::new(),
            hidden: false,
        };
        self.list_occluders(tree, [i, j], size, &mut sighting);
        sighting
    }

    fn make_planes(&mut self, points: &[DVec3; 6], size: f64) {
        self.planes.clear();
        // Only what rises above the emitter and lies in front of the receiver can be in the way.
        for [a, b, c] in [[0, 1, 2], [3, 4, 5]] {
            let n = (points[b] - points[a]).cross(points[c] - points[a]).normalize_or_zero();
            self.planes.push((n.to_array(), n.dot(points[a])));
        }
        let flat = 2e-6 * size;
        let mut add = |a: usize, b: usize, c: usize| {
            let n = (points[b] - points[a]).cross(points[c] - points[a]);
            if n.length_squared() <= (1e-9 * size * size).powi(2) {
                return;
            }
            let n = n.normalize();
            let d = n.dot(points[a]);
            let heights = points.map(|p| n.dot(p) - d);
            // A plane of one of the triangles themselves, found again where they share a corner, would count as outside what
            // lies a hair above it.
            let lies_in = |t: &[f64]| t.iter().all(|h| h.abs() <= flat);
            if lies_in(&heights[..3]) || lies_in(&heights[3..]) {
                return;
            }
            let (least, most) = heights.iter().fold((0.0f64, 0.0f64), |(l, m), &h| (l.min(h), m.max(h)));
            if least >= -flat && most > flat {
                self.planes.push((n.to_array(), d));
            } else if most <= flat && least < -flat {
                self.planes.push(((-n).to_array(), -d));
            }
        };
        for k in 0..3 {
            let next = (k + 1) % 3;
            for e in 0..3 {
                add(k, next, 3 + e);
                add(3 + k, 3 + next, e);
            }
        }
    }

    fn list_occluders(&mut self, tree: &Tree, own: [u32; 2], size: f64, sighting: &mut Sighting) {
        let origin = sighting.origin;
        let side = OUTSIDE * size;
        let tolerance = tree.plane_tolerance;
        // The emitter's plane, the receiver's, the sides.
        let outside = |plane: usize| match plane {
            0 => tolerance,
            1 => -tolerance,
            _ => side,
        };
        let [emitter_plane, receiver_plane] = [self.planes[0], self.planes[1]];
        self.pending.clear();
        self.pending.push(0);
        let own_slots = own.map(|p| tree.slot_of_patch[p as usize]);
        let start = self.occluders.len();
        'nodes: while let Some(index) = self.pending.pop() {
            let node = &tree.nodes[index as usize];
            let c = (node.center - origin).to_array();
            let h = node.half.to_array();
            for a in 0..3 {
                if c[a] + h[a] < self.low[a] || c[a] - h[a] > self.high[a] {
                    continue 'nodes;
                }
            }
            for (k, (n, d)) in self.planes.iter().enumerate() {
                let most = n[0] * c[0] + n[1] * c[1] + n[2] * c[2] - d
                    + n[0].abs() * h[0]
                    + n[1].abs() * h[1]
                    + n[2].abs() * h[2];
                if most <= outside(k) {
                    continue 'nodes;
                }
            }
            if node.block == INNER {
                self.pending.extend([node.child, node.child + 1]);
                continue;
            }
            let block = &tree.blocks[node.block as usize];
            let mut kept = dispatch_inside(
                &block.corners,
                origin.to_array(),
                &self.planes,
                [tolerance, -tolerance, side],
            );
            while kept != 0 {
                let l = kept.trailing_zeros() as usize;
                kept &= kept - 1;
                #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
                let slot = (node.block as usize * LANES + l) as u32;
                if block.negative[l] == UNUSED || own_slots.contains(&slot) {
                    continue;
                }
                let [a, b, c] = block.triangle(l).map(|p| p - origin);
                let (least, most) = (a.min(b).min(c).to_array(), a.max(b).max(c).to_array());
                if (0..3).any(|x| most[x] < self.low[x] || least[x] > self.high[x]) {
                    continue;
                }
                let height = |(n, d): &([f64; 3], f64)| {
                    let n = DVec3::from_array(*n);
                    let h = [n.dot(a) - d, n.dot(b) - d, n.dot(c) - d];
                    (h[0].min(h[1]).min(h[2]), h[0].max(h[1]).max(h[2]))
                };
                let (lowest, highest) = height(&receiver_plane);
                if highest <= tolerance {
                    // In the receiver's plane, or below it at one end: of patches there the smaller id is seen.
                    let n = (b - a).cross(c - a);
                    let faces = n.dot(DVec3::from_array(receiver_plane.0)) > 0.0;
                    let id = if faces { block.negative[l] } else { block.positive[l] };
                    let triangle = [a, b, c];
                    if lowest >= -tolerance
                        && id < own[1]
                        && id < tree.patch_count
                        && overlap(&triangle, &sighting.receiver, DVec3::from_array(receiver_plane.0), side)
                    {
                        sighting.over.push(triangle);
                    }
                    continue;
                }
                #[allow(
                    clippy::cast_possible_truncation,
                    reason = "relative to the pair, f32 is enough for rays"
                )]
                let single = |p: DVec3| p.to_array().map(|x| x as f32);
                let (e, f) = (b - a, c - a);
                let normal = e.cross(f);
                #[allow(clippy::cast_possible_truncation, reason = "only to sort by")]
                let occluder = Occluder {
                    corner: single(a),
                    edges: [single(e), single(f)],
                    normal: single(normal),
                    slot,
                    size: normal.length_squared() as f32,
                };
                if highest <= BESIDE * size || height(&emitter_plane).1 <= BESIDE * size {
                    sighting.beside.push([a, b, c]);
                } else {
                    if hides([a, b, c], normal, sighting) {
                        sighting.hidden = true;
                        self.occluders.truncate(start);
                        return;
                    }
                    self.occluders.push(occluder);
                }
            }
        }
        // The largest first: they stop most rays, and then the rest need not be tried.
        self.occluders[start..].sort_unstable_by(|p, q| q.size.total_cmp(&p.size).then(p.slot.cmp(&q.slot)));
        sighting.between = start..self.occluders.len();
    }

    /// The corners of what may come in between, relative to the sighting's origin, without what is in the receiver's plane.
    pub(crate) fn triangles<'a>(
        &'a self,
        tree: &'a Tree,
        sighting: &'a Sighting,
    ) -> impl Iterator<Item = [DVec3; 3]> + 'a {
        let between = self.occluders[sighting.between.clone()].iter().map(move |occluder| {
            let slot = occluder.slot as usize;
            tree.blocks[slot / LANES]
                .triangle(slot % LANES)
                .map(|p| p - sighting.origin)
        });
        between.chain(sighting.beside.iter().copied())
    }

    /// Casts the rays `start..end` of a sequence (multiples of 16) and adds (Σ k V, Σ k) to `sums`.
    pub(crate) fn cast(&self, sighting: &Sighting, start: usize, end: usize, seed: u64, sums: &mut (f64, f64)) {
        let shift = shifts(seed);
        let mut group = Group::new();
        let mut at = start;
        while at < end {
            group.draw(sighting, at, &shift);
            group.hit = [0; RAYS];
            self.hit(sighting, &mut group);
            let (mut seen, mut whole) = (0.0, 0.0);
            for l in 0..RAYS {
                let weight = f64::from(group.weight[l]);
                whole += weight;
                seen += if group.hit[l] == 0 { weight } else { 0.0 };
            }
            sums.0 += seen;
            sums.1 += whole;
            at += RAYS;
        }
    }
}

impl Shaft {
    /// Casts rays between a pair so near that segments between evenly drawn points would hardly meet what carries the
    /// weight: cosine-distributed directions from points of the smaller triangle (Malley's method, with the corners of the
    /// square left out), of which those that meet the other one count, each as much as any. Stops at `wanted` of these, or
    /// at `most` directions. Adds (seen, met) to `sums`; returns how many met the other triangle.
    pub(crate) fn cast_near(
        &self,
        sighting: &Sighting,
        wanted: usize,
        most: usize,
        seed: u64,
        sums: &mut (f64, f64),
    ) -> usize {
        let (small, large) = if sighting.receiver_is_smaller {
            (&sighting.receiver, &sighting.emitter)
        } else {
            (&sighting.emitter, &sighting.receiver)
        };
        let Some([tangent, bitangent, normal]) = crate::frame::axes(*small, 0.0) else {
            return 0;
        };
        let across = (large[1] - large[0]).cross(large[2] - large[0]);
        let fan = Fan {
            corners: small.map(|p| p.to_array()),
            axes: [tangent, bitangent, normal].map(|p| p.to_array()),
            other: large.map(|p| p.to_array()),
            // Towards the inside of the other one.
            sides: [0, 1, 2].map(|e| across.cross(large[(e + 1) % 3] - large[e]).to_array()),
            across: across.to_array(),
            shift: shifts(seed),
        };
        let mut group = Group::new();
        let mut drawn = Drawn::new();
        let (mut filled, mut met) = (0, 0);
        let mut at = 0;
        loop {
            let mut mask = dispatch_draw_fan(&fan, at, &mut drawn);
            at += RAYS;
            while mask != 0 && met < wanted {
                let l = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let lane = |v: &[[f64; RAYS]; 3]| DVec3::new(v[0][l], v[1][l], v[2][l]);
                let (x, y) = (lane(&drawn.start), lane(&drawn.end));
                let (from, to) = if sighting.receiver_is_smaller { (y, x) } else { (x, y) };
                group.set(filled, from, to - from, sighting.is_stopped(from, to));
                filled += 1;
                met += 1;
                if filled == RAYS {
                    self.count(sighting, &mut group, filled, sums);
                    filled = 0;
                }
            }
            if met >= wanted || at >= most {
                break;
            }
        }
        if filled > 0 {
            self.count(sighting, &mut group, filled, sums);
        }
        met
    }

    fn count(&self, sighting: &Sighting, group: &mut Group, filled: usize, sums: &mut (f64, f64)) {
        group.hit = [0; RAYS];
        self.hit(sighting, group);
        sums.0 += group.hit[..filled].iter().filter(|&&h| h == 0).count() as f64;
        sums.1 += filled as f64;
    }

    fn hit(&self, sighting: &Sighting, group: &mut Group) {
        dispatch_hits(&self.occluders[sighting.between.clone()], group);
    }
}

fn fold(u: f64, v: f64) -> (f64, f64) {
    if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) }
}

/// The fractional part of a number from 0 to 2⁵³.
#[inline(always)]
fn wrapped(x: f64) -> f64 {
    // No call of a library's floor on processors that lack the instruction.
    #[allow(clippy::cast_possible_truncation, reason = "within 2⁵³")]
    let whole = x as i64;
    x - whole as f64
}

fn point(t: &[DVec3; 3], (u, v): (f64, f64)) -> DVec3 {
    t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v
}

/// Whether two triangles in one plane with this normal have more than `touch` of an overlap: no line along one of their
/// edges keeps them apart.
fn overlap(p: &[DVec3; 3], q: &[DVec3; 3], normal: DVec3, touch: f64) -> bool {
    let apart = |of: &[DVec3; 3], other: &[DVec3; 3]| {
        (0..3).any(|k| {
            let (a, b, c) = (of[k], of[(k + 1) % 3], of[(k + 2) % 3]);
            let mut across = normal.cross(b - a).normalize_or_zero();
            if across.dot(c - a) < 0.0 {
                across = -across;
            }
            other.iter().all(|&x| across.dot(x - a) <= touch)
        })
    };
    !apart(p, q) && !apart(q, p)
}

/// Whether all nine segments between corners pass through the inside of a triangle: then so does every segment between the
/// two, as where they pass its plane is the convex hull of where those do.
fn hides([a, b, c]: [DVec3; 3], normal: DVec3, sighting: &Sighting) -> bool {
    let edges = [(a, b), (b, c), (c, a)];
    let d = normal.dot(a);
    sighting.emitter.iter().all(|&p| {
        let hp = normal.dot(p) - d;
        hp != 0.0
            && sighting.receiver.iter().all(|&q| {
                let hq = normal.dot(q) - d;
                if hp * hq >= 0.0 {
                    return false;
                }
                let at = p + (q - p) * (hp / (hp - hq));
                edges.iter().all(|&(s, t)| (t - s).cross(at - s).dot(normal) > 0.0)
            })
    })
}

/// Sixteen rays from points of one triangle to points of the other; the other point at parameter 1.
#[repr(C, align(64))]
struct Group {
    origin: [[f32; RAYS]; 3],
    direction: [[f32; RAYS]; 3],
    weight: [f32; RAYS],
    /// Stopped by what is beside or over.
    stopped: [u32; RAYS],
    hit: [u32; RAYS],
}

/// What directions from points of one triangle to another are drawn from.
struct Fan {
    corners: [[f64; 3]; 3],
    axes: [[f64; 3]; 3],
    other: [[f64; 3]; 3],
    sides: [[f64; 3]; 3],
    across: [f64; 3],
    shift: [f64; 4],
}

/// Sixteen segments.
#[repr(C, align(64))]
struct Drawn {
    start: [[f64; RAYS]; 3],
    end: [[f64; RAYS]; 3],
}

impl Drawn {
    const fn new() -> Self {
        Self {
            start: [[0.0; RAYS]; 3],
            end: [[0.0; RAYS]; 3],
        }
    }
}

/// Draws the directions `at + 1..= at + 16` of a sequence; the mask says which meet the other triangle from its front.
#[inline(always)]
fn draw_fan(fan: &Fan, at: usize, drawn: &mut Drawn) -> u16 {
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let minus = |p: [f64; 3], q: [f64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let mut met = [0u64; RAYS];
    let start = at as f64 + 1.0;
    let (e, f) = (
        minus(fan.corners[1], fan.corners[0]),
        minus(fan.corners[2], fan.corners[0]),
    );
    for l in 0..RAYS {
        let k = start + LANE[l];
        // Positive and below 2³¹: adding and taking off 2⁵² leaves the nearest whole number.
        let fraction = |x: f64| {
            let nearest = (x + 4_503_599_627_370_496.0) - 4_503_599_627_370_496.0;
            let rest = x - nearest;
            rest + if rest < 0.0 { 1.0 } else { 0.0 }
        };
        let u: [f64; 4] = [
            fraction(fan.shift[0] + STEPS_4[0] * k),
            fraction(fan.shift[1] + STEPS_4[1] * k),
            fraction(fan.shift[2] + STEPS_4[2] * k),
            fraction(fan.shift[3] + STEPS_4[3] * k),
        ];
        let outside = u[0] + u[1] > 1.0;
        let (s, t) = (
            if outside { 1.0 - u[0] } else { u[0] },
            if outside { 1.0 - u[1] } else { u[1] },
        );
        let (p, q) = (2.0 * u[2] - 1.0, 2.0 * u[3] - 1.0);
        let squared = p * p + q * q;
        let rest = 1.0 - squared;
        let up = (if rest > 0.0 { rest } else { 0.0 }).sqrt();
        let (mut x, mut d) = ([0.0; 3], [0.0; 3]);
        for a in 0..3 {
            x[a] = fan.corners[0][a] + e[a] * s + f[a] * t;
            d[a] = fan.axes[0][a] * p + fan.axes[1][a] * q + fan.axes[2][a] * up;
        }
        let slope = dot(fan.across, d);
        let length = dot(fan.across, minus(fan.other[0], x)) / slope;
        let y = [x[0] + d[0] * length, x[1] + d[1] * length, x[2] + d[2] * length];
        let within = |k: usize| dot(fan.sides[k], minus(y, fan.other[k])) >= 0.0;
        let meets = (rest > 0.0) & (slope < 0.0) & (length > 0.0) & within(0) & within(1) & within(2);
        met[l] = u64::from(meets);
        for a in 0..3 {
            drawn.start[a][l] = x[a];
            drawn.end[a][l] = y[a];
        }
    }
    let mut mask = 0;
    for (l, &k) in met.iter().enumerate() {
        mask |= u16::from(k != 0) << l;
    }
    mask
}

const LANE: [f64; RAYS] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Steps of an additive sequence in four dimensions: powers of the root of x⁵ = x + 1 (Roberts 2018).
const STEPS_4: [f64; 4] = [
    0.856_674_883_854_502_9,
    0.733_891_856_627_126,
    0.628_706_721_037_808_7,
    0.538_597_257_223_610_1,
];

fn shifts(seed: u64) -> [f64; 4] {
    let mut state = seed;
    std::array::from_fn(|_| random::unit(random::next(&mut state)))
}

impl Group {
    fn new() -> Self {
        Self {
            origin: [[0.0; RAYS]; 3],
            direction: [[0.0; RAYS]; 3],
            weight: [0.0; RAYS],
            stopped: [0; RAYS],
            hit: [0; RAYS],
        }
    }

    /// Sets a ray.
    fn set(&mut self, lane: usize, from: DVec3, direction: DVec3, is_stopped: bool) {
        #[allow(clippy::cast_possible_truncation, reason = "rays relative to the pair")]
        for a in 0..3 {
            self.origin[a][lane] = from[a] as f32;
            self.direction[a][lane] = direction[a] as f32;
        }
        self.stopped[lane] = u32::from(is_stopped);
    }

    /// Draws the rays `at..at + 16`: the same segments in both directions of a pair.
    fn draw(&mut self, pair: &Sighting, at: usize, shift: &[f64; 4]) {
        let normal = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]);
        let (n_from, n_to) = (normal(&pair.emitter), normal(&pair.receiver));
        for l in 0..RAYS {
            let k = (at + l + 1) as f64;
            let u: [f64; 4] = std::array::from_fn(|a| wrapped(shift[a] + STEPS_4[a] * k));
            let (small, large) = (fold(u[0], u[1]), fold(u[2], u[3]));
            let (on_emitter, on_receiver) = if pair.receiver_is_smaller {
                (large, small)
            } else {
                (small, large)
            };
            let (x, y) = (point(&pair.emitter, on_emitter), point(&pair.receiver, on_receiver));
            let d = y - x;
            let r2 = d.length_squared();
            // In front of both, or no weight.
            let kernel = n_from.dot(d).max(0.0) * (-n_to.dot(d)).max(0.0) / (r2 * r2);
            #[allow(clippy::cast_possible_truncation, reason = "weights relative to the pair")]
            let weight = if kernel.is_finite() { kernel as f32 } else { 0.0 };
            self.weight[l] = weight;
            self.set(l, x, d, pair.is_stopped(x, y));
        }
    }
}

/// Which of 16 triangles reach inside all planes, one bit each. `outside`: how far in is still out, for the first plane,
/// the second and the others.
#[inline(always)]
fn inside(corners: &[[f64; LANES]; 9], origin: [f64; 3], planes: &[([f64; 3], f64)], outside: [f64; 3]) -> u16 {
    let mut kept = [1u64; LANES];
    for (k, (n, d)) in planes.iter().enumerate() {
        let outside = outside[if k < 2 { k } else { 2 }];
        for l in 0..LANES {
            let height = |k: usize| {
                n[0] * (corners[3 * k][l] - origin[0])
                    + n[1] * (corners[3 * k + 1][l] - origin[1])
                    + n[2] * (corners[3 * k + 2][l] - origin[2])
            };
            let (a, b, c) = (height(0), height(1), height(2));
            let most = if a > b { a } else { b };
            let most = if most > c { most } else { c };
            kept[l] &= u64::from(most - d > outside);
        }
    }
    let mut mask = 0;
    for (l, &k) in kept.iter().enumerate() {
        mask |= u16::from(k != 0) << l;
    }
    mask
}

/// Marks the rays of a group that an occluder stops strictly between their ends (Möller & Trumbore 1997), and those that
/// are stopped anyway.
#[inline(always)]
fn hits(occluders: &[Occluder], group: &mut Group) {
    let mut hit = group.hit;
    for l in 0..RAYS {
        hit[l] |= group.stopped[l];
    }
    for (count, t) in occluders.iter().enumerate() {
        let ([e, f], n) = (t.edges, t.normal);
        for l in 0..RAYS {
            let d = [group.direction[0][l], group.direction[1][l], group.direction[2][l]];
            let s = [
                group.origin[0][l] - t.corner[0],
                group.origin[1][l] - t.corner[1],
                group.origin[2][l] - t.corner[2],
            ];
            let inverse = -1.0 / (d[0] * n[0] + d[1] * n[1] + d[2] * n[2]);
            let at = (s[0] * n[0] + s[1] * n[1] + s[2] * n[2]) * inverse;
            let q = [
                s[1] * d[2] - s[2] * d[1],
                s[2] * d[0] - s[0] * d[2],
                s[0] * d[1] - s[1] * d[0],
            ];
            let u = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) * inverse;
            let v = -(e[0] * q[0] + e[1] * q[1] + e[2] * q[2]) * inverse;
            hit[l] |= u32::from((at > 1e-6) & (at < 1.0 - 1e-6) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0));
        }
        // When every ray is stopped, the rest cannot change anything.
        if count % 4 == 3 && hit.iter().all(|&h| h != 0) {
            break;
        }
    }
    group.hit = hit;
}

macro_rules! dispatch {
    ($name:ident, $body:ident, ($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        fn $name($($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
                fn avx512($($arg: $type),*) $(-> $out)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body($($arg),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                {
                    // SAFETY: the processor has the instruction set.
                    return unsafe { avx512($($arg),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

dispatch!(
    dispatch_inside,
    inside,
    (corners: &[[f64; LANES]; 9], origin: [f64; 3], planes: &[([f64; 3], f64)], outside: [f64; 3]) -> u16
);
dispatch!(dispatch_draw_fan, draw_fan, (fan: &Fan, at: usize, drawn: &mut Drawn) -> u16);
dispatch!(dispatch_hits, hits, (occluders: &[Occluder], group: &mut Group));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HierarchyOptions, Model};
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    /// A unit square at z = 0 facing up, one at z = 1 facing down, and whatever else.
    fn scene(more: &[[DVec3; 3]]) -> Model {
        let p = DVec3::new;
        let mut triangles = vec![
            [p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.)],
            [p(0., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)],
            [p(0., 0., 1.), p(1., 1., 1.), p(1., 0., 1.)],
            [p(0., 0., 1.), p(0., 1., 1.), p(1., 1., 1.)],
        ];
        triangles.extend_from_slice(more);
        let scene = Scene {
            triangles: triangles
                .into_iter()
                .map(|corners| Triangle {
                    corners,
                    object: 0,
                    material: 0,
                    face: 0,
                    two_sided: false,
                })
                .collect(),
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn fraction(model: &Model, i: u32, j: u32, rays: usize) -> (usize, f64) {
        let corners = |p: u32| model.normalised_corners(p);
        let mut shaft = Shaft::default();
        let sighting = shaft.sight(model.geometry().tree(), (i, &corners(i)), (j, &corners(j)));
        if sighting.hidden {
            return (1, 0.0);
        }
        let mut sums = (0.0, 0.0);
        shaft.cast(&sighting, 0, rays, 1, &mut sums);
        let count = sighting.between.len() + sighting.beside.len() + sighting.over.len();
        (count, sums.0 / sums.1)
    }

    #[test]
    fn nothing_between_is_proved() {
        let model = scene(&[]);
        assert_eq!(fraction(&model, 0, 2, 16), (0, 1.0));
    }

    #[test]
    fn what_is_beside_above_or_below_is_not_between() {
        let p = DVec3::new;
        let model = scene(&[
            [p(2., 0., 0.5), p(3., 0., 0.5), p(2., 1., 0.5)],
            [p(0., 0., 1.5), p(1., 0., 1.5), p(0., 1., 1.5)],
            [p(0., 0., -0.5), p(1., 0., -0.5), p(0., 1., -0.5)],
        ]);
        assert_eq!(fraction(&model, 0, 2, 16).0, 0);
    }

    #[test]
    fn half_an_obstruction_hides_half() {
        let p = DVec3::new;
        // The View3D square obstruction: a quarter of the middle plane; F falls from 0.199825 to 0.149869.
        let (a, b, c, d) = (p(0., 0., 0.5), p(0.5, 0., 0.5), p(0.5, 0.5, 0.5), p(0., 0.5, 0.5));
        let model = scene(&[[a, b, c], [a, c, d]]);
        let rule = crate::factor::FactorRule::for_tolerance(1e-4);
        let corners = |p: u32| model.normalised_corners(p);
        let (mut open, mut seen) = (0.0, 0.0);
        for i in 0..2 {
            for j in 2..4 {
                let (_, v) = fraction(&model, i, j, 1 << 14);
                let exchange = crate::factor::exchange(&corners(i), &corners(j), &rule);
                open += exchange;
                seen += v * exchange;
            }
        }
        let ratio = 0.149_868_671_773_8 / 0.199_824_895_698_387;
        assert!((seen / open / ratio - 1.0).abs() < 2e-3, "{} {ratio}", seen / open);
    }

    #[test]
    fn a_wall_hides_everything() {
        let p = DVec3::new;
        let model = scene(&[[p(-9., -9., 0.5), p(9., -9., 0.5), p(0., 20., 0.5)]]);
        assert_eq!(fraction(&model, 0, 2, 64), (1, 0.0));
    }

    #[test]
    fn every_path_gives_the_same_hits() {
        let p = DVec3::new;
        let model = scene(&[[p(0.2, 0.1, 0.5), p(0.9, 0.3, 0.4), p(0.4, 0.8, 0.6)]]);
        let corners = |k: u32| model.normalised_corners(k);
        let mut shaft = Shaft::default();
        let sighting = shaft.sight(model.geometry().tree(), (0, &corners(0)), (2, &corners(2)));
        assert_eq!(sighting.between.len(), 1);
        for at in (0..512).step_by(RAYS) {
            let (mut a, mut b) = (Group::new(), Group::new());
            a.draw(&sighting, at, &shifts(7));
            b.draw(&sighting, at, &shifts(7));
            hits(&shaft.occluders, &mut a);
            dispatch_hits(&shaft.occluders, &mut b);
            assert_eq!(a.hit, b.hit);
        }
    }
}
