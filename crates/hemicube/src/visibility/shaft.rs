//! How much of a triangle another one sees: the shaft between the two lists what may come in between, and rays at those
//! few occluders measure the visible fraction.
//!
//! The shaft (Haines & Wallace 1991) is the convex hull of the two triangles. What lies outside one of its planes
//! cannot come in between; an empty shaft proves that all is visible, and a triangle that all nine segments between
//! corners pass through proves that nothing is. Below the emitter's plane and behind the receiver's nothing occludes;
//! what lies in the receiver's own plane does if its patch has the smaller id, as in a backend's rows.
//!
//! The visible fraction is Σ k V / Σ k over points drawn on both triangles, with the same points above and below and
//! the kernel k = cos φ_i cos φ_j / r² as weight: times the closed form it gives F_ij without the bias of uniform
//! visibility.

use crate::backend::Surface;
use crate::bvh::{INNER, LANES, Tree, UNUSED, overlap};
use crate::geometry::{self, in_front};
use crate::sampling::sobol::{self, Sequence, fold};
use crate::simd::{InstructionSet, cross, dispatch, dot, lanes, least, mask, minus, most};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::segments::{Obstacles, Segments};
use glam::DVec3;
use std::ops::Range;

/// Rays cast together.
pub(crate) const RAYS: usize = sobol::BATCH;

/// What lies within this part of the pair's extent of a side of the shaft counts as outside.
const OUTSIDE: f64 = 4e-6;
/// And no more than this part of what either triangle rises above that side.
const OUTSIDE_OF_RISE: f64 = 0.01;

/// What rises less than this part of the pair's extent above one of the planes, and what has one of the two patches so
/// near to its own plane, is met in f64: rays in f32 are not sure on which side of it they begin and end.
const BESIDE: f64 = 1e-4;

/// See [`Sighting::near`].
const NEAR: f64 = 2.0;

/// What things cost, in steps of about a nanosecond of one core of 2024 with AVX-512: a shaft, a block of the tree that
/// reaches into it, a triangle listed; sixteen rays, and a triangle that they are held against; a segment's way down
/// the tree. Budgets are in steps, so that they depend on the scene and the settings, and on no clock.
const STEPS_A_SHAFT: u64 = 700;
const STEPS_A_BLOCK: u64 = 60;
const STEPS_LISTED: u64 = 30;
const STEPS_A_GROUP: u64 = 100;
const STEPS_A_TEST: u64 = 7;
const STEPS_A_SEGMENT: u64 = 600;
/// And of a direction drawn between near patches, sixteen together.
const STEPS_A_DRAW: u64 = 120;

/// Triangles that a shaft lists, at most: a ray held against more of them costs more than its way down the tree.
const MOST_LISTED: u32 = 256;

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
    sides: Sides,
    found: EdgeSides,
    /// Of all sightings since [`Shaft::clear`].
    occluders: Vec<Occluder>,
    pending: Vec<u32>,
    /// Blocks that reach into the shaft, and which of their triangles may.
    reached: Vec<(u32, u16)>,
}

/// Planes tried together.
const TOGETHER: usize = 8;
/// The two triangles' planes and one for each of 18 edges and opposite corners, in whole groups.
const MOST_SIDES: usize = 24;

/// The planes of a shaft and the box round it: what is inside has n · p > d for each.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Sides {
    normal: [[f64; MOST_SIDES]; 3],
    /// With how far in is still out.
    least: [f64; MOST_SIDES],
    count: usize,
    low: [f64; 3],
    high: [f64; 3],
}

/// Planes through an edge of either triangle and a corner of the other one.
const EDGE_SIDES: usize = 18;
/// And so many lanes.
const EDGE_LANES: usize = 24;

/// Edge and corner of each: the edge's ends and the corner, of six.
const EDGE_CORNERS: [[usize; 3]; EDGE_LANES] = {
    let mut corners = [[0, 1, 3]; EDGE_LANES];
    let mut l = 0;
    while l < EDGE_SIDES {
        let (side, k, e) = (l % 2, l / 6, l / 2 % 3);
        corners[l] = [3 * side + k, 3 * side + (k + 1) % 3, 3 - 3 * side + e];
        l += 1;
    }
    corners
};

/// Which of these planes have all of both triangles on one side, as n · p ≥ d less what is still out.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct EdgeSides {
    normal: [[f64; EDGE_LANES]; 3],
    least: [f64; EDGE_LANES],
    is_side: [u64; EDGE_LANES],
}

impl Default for EdgeSides {
    fn default() -> Self {
        Self {
            normal: [[0.0; EDGE_LANES]; 3],
            least: [0.0; EDGE_LANES],
            is_side: [0; EDGE_LANES],
        }
    }
}

impl Default for Sides {
    fn default() -> Self {
        Self {
            normal: [[0.0; MOST_SIDES]; 3],
            least: [0.0; MOST_SIDES],
            count: 0,
            low: [0.0; 3],
            high: [0.0; 3],
        }
    }
}

impl Sides {
    fn push(&mut self, normal: DVec3, least: f64) {
        if self.count < MOST_SIDES {
            for (a, n) in normal.to_array().into_iter().enumerate() {
                self.normal[a][self.count] = n;
            }
            self.least[self.count] = least;
            self.count += 1;
        }
    }

    /// Fills the last group with planes that everything is inside of.
    fn fill(&mut self) {
        for k in self.count..self.count.next_multiple_of(TOGETHER) {
            for normal in &mut self.normal {
                normal[k] = 0.0;
            }
            self.least[k] = -1.0;
        }
    }

    /// Returns whether a box, by its centre and half its extent, may reach inside.
    #[inline(always)]
    fn reach(&self, c: [f64; 3], h: [f64; 3]) -> bool {
        for a in 0..3 {
            if c[a] + h[a] < self.low[a] || c[a] - h[a] > self.high[a] {
                return false;
            }
        }
        let mut at = 0;
        while at < self.count {
            let mut inside = [false; TOGETHER];
            for (l, inside) in inside.iter_mut().enumerate() {
                let n = [self.normal[0][at + l], self.normal[1][at + l], self.normal[2][at + l]];
                let middle = n[0] * c[0] + n[1] * c[1] + n[2] * c[2];
                let extent = n[0].abs() * h[0] + n[1].abs() * h[1] + n[2].abs() * h[2];
                *inside = middle + extent > self.least[at + l];
            }
            if !inside.iter().fold(true, |all, &one| all & one) {
                return false;
            }
            at += TOGETHER;
        }
        true
    }
}

/// Two triangles that look at each other, and what may be in between.
#[derive(Clone, Debug)]
pub(crate) struct Sighting {
    /// The emitter and the receiver relative to `origin`.
    pub(crate) emitter: [DVec3; 3],
    pub(crate) receiver: [DVec3; 3],
    pub(crate) origin: DVec3,
    /// The middle of the smaller one is near the other, in radii of either: a few segments between evenly drawn points
    /// would carry most of the weight.
    pub(crate) near: bool,
    /// True if the receiver is the smaller of the two.
    pub(crate) receiver_is_smaller: bool,
    /// What is between the two planes.
    between: Range<usize>,
    /// What is so near to one of the planes that rays in f32 cannot tell on which side.
    beside: Vec<[DVec3; 3]>,
    /// What lies in the receiver's plane and hides it, as its id is smaller.
    pub(crate) over: Vec<[DVec3; 3]>,
    /// One triangle hides all of it.
    pub(crate) hidden: bool,
    /// More reaches into the shaft than is listed: nothing is proved, and segments walk the tree.
    pub(crate) crowded: bool,
    /// The walls that the two are part of.
    own_walls: [u32; 2],
    receiver_patch: u32,
    /// n and d of both planes, relative to `origin`.
    planes: [(DVec3, f64); 2],
    /// What listing took, in steps.
    pub(crate) steps: u64,
}

impl Sighting {
    /// Returns whether all is visible: proved, as nothing may come in between.
    pub(crate) fn is_open(&self) -> bool {
        !self.crowded && self.between.is_empty() && self.beside.is_empty() && self.over.is_empty()
    }

    /// Segments of a crowded shaft.
    fn segments<'a>(&self, obstacles: Obstacles<'a>) -> Segments<'a> {
        let planes = self.planes.map(|(n, d)| (n, d + n.dot(self.origin)));
        Segments::new(obstacles, self.own_walls, self.receiver_patch, planes)
    }

    /// Whether a segment between points of the smaller one and of the other, relative to `origin`, is stopped in the
    /// tree.
    fn is_stopped(&self, segments: &mut Segments<'_>, small: DVec3, large: DVec3) -> bool {
        let (small, large) = (small + self.origin, large + self.origin);
        segments.is_stopped(small, large, if self.receiver_is_smaller { small } else { large })
    }

    /// The smaller of the two, and the other.
    fn by_size(&self) -> (&[DVec3; 3], &[DVec3; 3]) {
        if self.receiver_is_smaller {
            (&self.receiver, &self.emitter)
        } else {
            (&self.emitter, &self.receiver)
        }
    }

    /// Lists a surface that lies in the receiver's plane if it hides part of it: of patches there the smaller id is
    /// seen.
    fn lay_over(&mut self, surface: &Surface, receiver: u32, plane: (DVec3, f64), tolerance: f64, side: f64) {
        let triangle = surface.corners.map(|p| p - self.origin);
        let faces = geometry::cross(&triangle).dot(plane.0) > 0.0;
        let Some(id) = (if faces { Some(surface.front) } else { surface.back }) else {
            return;
        };
        if id.0 < receiver
            && triangle.iter().all(|&p| (plane.0.dot(p) - plane.1).abs() <= tolerance)
            && overlap(&triangle, &self.receiver, plane.0, side)
            && !self.over.contains(&triangle)
        {
            self.over.push(triangle);
        }
    }

    /// Which of the segments drawn something beside stops, or something over the receiver is seen at the end of.
    fn stopped(&self, drawn: &Drawn, out: &mut [u64; RAYS]) {
        *out = [0; RAYS];
        if self.beside.is_empty() && self.over.is_empty() {
            return;
        }
        let (from, to) = if self.receiver_is_smaller {
            (&drawn.end, &drawn.start)
        } else {
            (&drawn.start, &drawn.end)
        };
        dispatch_stop(InstructionSet::widest(), &self.beside, &self.over, from, to, out);
    }
}

/// Rays cast at a pair so far, of one sequence.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cast {
    /// The number that were drawn.
    pub(crate) drawn: usize,
    /// Σ k V and Σ k.
    pub(crate) sums: (f64, f64),
    /// Σ of weights and of their squares.
    weights: (f64, f64),
    /// Cost, in steps.
    pub(crate) steps: u64,
}

impl Cast {
    /// The visible fraction; `None` where no ray had weight.
    pub(crate) fn fraction(&self) -> Option<f64> {
        (self.sums.1 > 0.0).then(|| self.sums.0 / self.sums.1)
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
        obstacles: Obstacles<'_>,
        (i, emitter): (u32, &[DVec3; 3]),
        (j, receiver): (u32, &[DVec3; 3]),
    ) -> Sighting {
        let walls = obstacles.walls;
        // The same for both directions of a pair, so that all that follows has the same bits.
        let origin = if i < j { emitter[0] } else { receiver[0] };
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
            let (center, squared_radius) = geometry::sphere(t);
            (center, squared_radius.sqrt())
        };
        let ((c0, r0), (c1, r1)) = (sphere(&emitter), sphere(&receiver));
        let (mut low, mut high) = (DVec3::ZERO, DVec3::ZERO);
        for p in points {
            low = low.min(p);
            high = high.max(p);
        }
        let slack = DVec3::splat(OUTSIDE * size);
        (self.sides.low, self.sides.high) = ((low - slack).to_array(), (high + slack).to_array());
        let planes = self.make_planes(&points, size, walls.tree.plane_tolerance);
        let start = self.occluders.len();
        let area = |t: &[DVec3; 3]| geometry::cross(t).length_squared();
        // Of two of one size, the same one whichever of them emits.
        let receiver_is_smaller = match area(&receiver).total_cmp(&area(&emitter)) {
            std::cmp::Ordering::Less => true,
            std::cmp::Ordering::Equal => j < i,
            std::cmp::Ordering::Greater => false,
        };
        let mut sighting = Sighting {
            emitter,
            receiver,
            origin,
            near: if receiver_is_smaller {
                geometry::distance(c1, &emitter) < (NEAR * r1).max(r0)
            } else {
                geometry::distance(c0, &receiver) < (NEAR * r0).max(r1)
            },
            receiver_is_smaller,
            between: start..start,
            beside: Vec::new(),
            over: Vec::new(),
            hidden: false,
            crowded: false,
            own_walls: [i, j].map(|p| walls.of_patch[p as usize]),
            receiver_patch: j,
            planes,
            steps: 0,
        };
        self.list_occluders(obstacles, size, &mut sighting);
        let listed = self
            .reached
            .iter()
            .map(|&(_, kept)| u64::from(kept.count_ones()))
            .sum::<u64>();
        sighting.steps = STEPS_A_SHAFT + STEPS_A_BLOCK * self.reached.len() as u64 + STEPS_LISTED * listed;
        sighting
    }

    /// Makes the sides; returns the planes (n, d) of the two triangles.
    fn make_planes(&mut self, points: &[DVec3; 6], size: f64, tolerance: f64) -> [(DVec3, f64); 2] {
        self.sides.count = 0;
        // Only what rises above the emitter and lies in front of the receiver can be in the way.
        let own = [([0, 1, 2], tolerance), ([3, 4, 5], -tolerance)].map(|([a, b, c], outside)| {
            let n = (points[b] - points[a]).cross(points[c] - points[a]).normalize_or_zero();
            let d = n.dot(points[a]);
            self.sides.push(n, d + outside);
            (n, d)
        });
        let corners = points.map(|p| p.to_array());
        dispatch_find_sides(InstructionSet::widest(), &corners, size, tolerance, &mut self.found);
        let found = &self.found;
        for l in (0..EDGE_SIDES).filter(|&l| found.is_side[l] != 0) {
            let normal = DVec3::new(found.normal[0][l], found.normal[1][l], found.normal[2][l]);
            self.sides.push(normal, found.least[l]);
        }
        self.sides.fill();
        own
    }

    fn list_occluders(&mut self, Obstacles { surfaces, walls }: Obstacles<'_>, size: f64, sighting: &mut Sighting) {
        let (origin, own_walls, receiver) = (sighting.origin, sighting.own_walls, sighting.receiver_patch);
        let [emitter_plane, receiver_plane] = sighting.planes;
        let side = OUTSIDE * size;
        let tree = &walls.tree;
        let tolerance = tree.plane_tolerance;
        if !dispatch_reached(
            InstructionSet::widest(),
            tree,
            &self.sides,
            origin,
            &mut self.pending,
            &mut self.reached,
        ) {
            sighting.crowded = true;
            return;
        }
        let start = self.occluders.len();
        for &(index, kept) in &self.reached {
            let block = &tree.blocks[index as usize];
            for l in lanes(kept) {
                #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
                let slot = (index as usize * LANES + l) as u32;
                let wall = block.negative[l];
                if wall == UNUSED || own_walls.contains(&wall) {
                    continue;
                }
                let triangle = block.triangle(l).map(|p| p - origin);
                let (least, most) = geometry::bounds(&triangle);
                let (least, most, [a, b, c]) = (least.to_array(), most.to_array(), triangle);
                if (0..3).any(|x| most[x] < self.sides.low[x] || least[x] > self.sides.high[x]) {
                    continue;
                }
                let height = |(n, d): &(DVec3, f64)| {
                    let h = [n.dot(a) - d, n.dot(b) - d, n.dot(c) - d];
                    (h[0].min(h[1]).min(h[2]), h[0].max(h[1]).max(h[2]))
                };
                let (lowest, highest) = height(&receiver_plane);
                if highest <= tolerance {
                    // In the receiver's plane, or below it at one end.
                    if lowest >= -tolerance && overlap(&[a, b, c], &sighting.receiver, receiver_plane.0, side) {
                        for &piece in walls.pieces(wall) {
                            sighting.lay_over(&surfaces[piece as usize], receiver, receiver_plane, tolerance, side);
                        }
                    }
                    continue;
                }
                #[allow(
                    clippy::cast_possible_truncation,
                    reason = "relative to the pair, f32 is enough for rays"
                )]
                let single = |p: DVec3| p.to_array().map(|x| x as f32);
                let normal = geometry::cross(&triangle);
                // From its nearest corner on, as f32 has the fewest digits behind the point for what is far.
                let [p, q, r] = match [a, b, c].map(DVec3::length_squared) {
                    [x, y, z] if x <= y && x <= z => [a, b, c],
                    [_, y, z] if y <= z => [b, c, a],
                    _ => [c, a, b],
                };
                #[allow(clippy::cast_possible_truncation, reason = "only to sort by")]
                let occluder = Occluder {
                    corner: single(p),
                    edges: [single(q - p), single(r - p)],
                    normal: single(normal),
                    slot,
                    size: normal.length_squared() as f32,
                };
                // What rises slowly above a small patch is in front of it by less than what it rises to elsewhere.
                let near = (BESIDE * size).powi(2) * normal.length_squared();
                let all_but_touches = |t: &[DVec3; 3]| t.iter().all(|&p| normal.dot(p - a).powi(2) <= near);
                if highest <= BESIDE * size
                    || height(&emitter_plane).1 <= BESIDE * size
                    || all_but_touches(&sighting.emitter)
                    || all_but_touches(&sighting.receiver)
                {
                    sighting.beside.push([a, b, c]);
                } else {
                    if hides(walls.corners(wall), sighting) {
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

    /// The corners of what may come in between, relative to the sighting's origin, without what is in the receiver's
    /// plane.
    pub(crate) fn triangles<'a>(
        &'a self,
        walls: &'a CoplanarRegions,
        sighting: &'a Sighting,
    ) -> impl Iterator<Item = [DVec3; 3]> + 'a {
        let between = self.occluders[sighting.between.clone()].iter().map(move |occluder| {
            let slot = occluder.slot as usize;
            walls.tree.blocks[slot / LANES]
                .triangle(slot % LANES)
                .map(|p| p - sighting.origin)
        });
        between.chain(sighting.beside.iter().copied())
    }

    /// Casts rays of a sequence until there are `wanted` (a multiple of 16): the same ones in both directions of a
    /// pair. How many there are.
    pub(crate) fn cast(
        &self,
        obstacles: Obstacles<'_>,
        sighting: &Sighting,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
    ) -> usize {
        let (small, large) = sighting.by_size();
        let normal = geometry::cross;
        let span = |t: &[DVec3; 3]| [t[0], t[1] - t[0], t[2] - t[0]].map(|p| p.to_array());
        let pair = Spans {
            from: span(small),
            to: span(large),
            normals: [normal(small), normal(large)].map(|p| p.to_array()),
            sequence: Sequence::new(seed),
        };
        let mut group = Group::new();
        let mut drawn = Drawn::new();
        let mut stopped = [0; RAYS];
        let mut segments = sighting.segments(obstacles);
        let steps = self.steps_a_group(sighting);
        while cast.drawn < wanted {
            cast.steps += steps;
            dispatch_draw_spans(InstructionSet::widest(), &pair, cast.drawn, &mut drawn, &mut group);
            group.hit = [0; RAYS];
            if sighting.crowded {
                for l in (0..RAYS).filter(|&l| group.weight[l] > 0.0) {
                    let (small, large) = drawn.segment(l);
                    group.hit[l] = u32::from(sighting.is_stopped(&mut segments, small, large));
                }
            } else {
                sighting.stopped(&drawn, &mut stopped);
                group.stopped = stopped.map(|s| u32::from(s != 0));
                self.hit(sighting, &mut group);
            }
            let (mut seen, mut whole) = (0.0, 0.0);
            for l in 0..RAYS {
                let weight = f64::from(group.weight[l]);
                whole += weight;
                seen += if group.hit[l] == 0 { weight } else { 0.0 };
            }
            cast.sums.0 += seen;
            cast.sums.1 += whole;
            cast.drawn += RAYS;
        }
        cast.drawn
    }
}

impl Shaft {
    /// Casts rays between a pair so near that segments between evenly drawn points would hardly meet what carries the
    /// weight: cosine-distributed directions from points of the smaller triangle (Malley's method), drawn from about
    /// what the other one fills of the unit disc and weighted with how much that is; those that meet the other one
    /// count. Stops when all so far are worth `wanted` equal ones, or at `most` directions. Returns what those that met
    /// are worth.
    pub(crate) fn cast_near(
        &self,
        obstacles: Obstacles<'_>,
        sighting: &Sighting,
        wanted: usize,
        most: usize,
        seed: u64,
        cast: &mut Cast,
    ) -> usize {
        let (small, large) = sighting.by_size();
        let Some(fan) = Fan::between(small, large, seed) else {
            return 0;
        };
        let mut group = Group::new();
        let mut drawn = Drawn::new();
        let mut stopped = [0; RAYS];
        let mut aim = Aim::new();
        let mut filled = 0;
        let mut segments = sighting.segments(obstacles);
        loop {
            if cast.drawn.is_multiple_of(FROM_A_POINT * RAYS) {
                dispatch_aim(
                    InstructionSet::widest(),
                    &fan,
                    cast.drawn / FROM_A_POINT,
                    &mut drawn,
                    &mut aim,
                );
            }
            cast.steps += STEPS_A_DRAW;
            let mask = dispatch_shoot(
                InstructionSet::widest(),
                &fan,
                cast.drawn / RAYS % FROM_A_POINT,
                &aim,
                &mut drawn,
            );
            cast.drawn += RAYS;
            if mask != 0 && !sighting.crowded {
                sighting.stopped(&drawn, &mut stopped);
            }
            for l in lanes(mask) {
                let (x, y) = drawn.segment(l);
                let weight = drawn.weight[l];
                if sighting.crowded {
                    cast.steps += STEPS_A_SEGMENT;
                    let is_stopped = sighting.is_stopped(&mut segments, x, y);
                    cast.sums.0 += if is_stopped { 0.0 } else { weight };
                    cast.sums.1 += weight;
                    cast.weights.0 += weight;
                    cast.weights.1 += weight * weight;
                    continue;
                }
                group.set(filled, x, y - x, stopped[l] != 0);
                #[allow(clippy::cast_possible_truncation, reason = "at most 4")]
                let single = weight as f32;
                group.weight[filled] = single;
                cast.weights.0 += weight;
                cast.weights.1 += weight * weight;
                filled += 1;
                if filled == RAYS {
                    cast.steps += self.steps_a_group(sighting);
                    self.count(sighting, &mut group, filled, &mut cast.sums);
                    filled = 0;
                }
            }
            let (sum, squares) = cast.weights;
            let is_round = cast.drawn.is_multiple_of(FROM_A_POINT * RAYS);
            if is_round && (cast.drawn >= most || sum * sum >= wanted as f64 * squares && squares > 0.0) {
                break;
            }
        }
        if filled > 0 {
            self.count(sighting, &mut group, filled, &mut cast.sums);
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a number of rays"
        )]
        let worth = if cast.weights.1 > 0.0 {
            (cast.weights.0 * cast.weights.0 / cast.weights.1) as usize
        } else {
            0
        };
        worth
    }

    fn count(&self, sighting: &Sighting, group: &mut Group, filled: usize, sums: &mut (f64, f64)) {
        group.hit = [0; RAYS];
        self.hit(sighting, group);
        for l in 0..filled {
            let weight = f64::from(group.weight[l]);
            sums.0 += if group.hit[l] == 0 { weight } else { 0.0 };
            sums.1 += weight;
        }
    }

    /// What sixteen rays cost.
    fn steps_a_group(&self, sighting: &Sighting) -> u64 {
        if sighting.crowded {
            RAYS as u64 * STEPS_A_SEGMENT
        } else {
            STEPS_A_GROUP + STEPS_A_TEST * (sighting.between.len() + 4 * sighting.beside.len()) as u64
        }
    }

    fn hit(&self, sighting: &Sighting, group: &mut Group) {
        dispatch_hits(
            InstructionSet::widest(),
            &self.occluders[sighting.between.clone()],
            group,
        );
    }
}

/// Whether all nine segments between corners pass through the inside of a convex polygon, whose corners are in the
/// scene's coordinates: then so does every segment between the two, as where they pass its plane is the convex hull of
/// where those do.
fn hides(polygon: &[DVec3], sighting: &Sighting) -> bool {
    let first = polygon[0] - sighting.origin;
    let normal = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
    let heights = |t: &[DVec3; 3]| {
        [
            normal.dot(t[0] - first),
            normal.dot(t[1] - first),
            normal.dot(t[2] - first),
        ]
    };
    let (of_emitter, of_receiver) = (heights(&sighting.emitter), heights(&sighting.receiver));
    let side = of_emitter[0];
    if of_emitter.iter().any(|h| h * side <= 0.0) || of_receiver.iter().any(|h| h * side >= 0.0) {
        return false;
    }
    let is_inside = |at: DVec3| {
        let mut before = polygon[polygon.len() - 1] - sighting.origin;
        for corner in polygon {
            let corner = *corner - sighting.origin;
            if (corner - before).cross(at - before).dot(normal) <= 0.0 {
                return false;
            }
            before = corner;
        }
        true
    };
    for (&p, hp) in sighting.emitter.iter().zip(of_emitter) {
        for (&q, hq) in sighting.receiver.iter().zip(of_receiver) {
            if !is_inside(geometry::crossing(p, q, hp, hq)) {
                return false;
            }
        }
    }
    true
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
    /// Of what sees the other one: a triangle, or two that share the first corner, and the first one's share of the
    /// area.
    corners: [[f64; 3]; 4],
    share: f64,
    axes: [[f64; 3]; 3],
    other: [[f64; 3]; 3],
    /// What of it is above the horizon: three corners or four.
    above: [[f64; 3]; 4],
    above_count: usize,
    sides: [[f64; 3]; 3],
    across: [f64; 3],
    sequence: Sequence,
}

impl Fan {
    /// Nothing where one of the two is behind the other one's plane, or has no area.
    fn between(small: &[DVec3; 3], large: &[DVec3; 3], seed: u64) -> Option<Self> {
        let [tangent, bitangent, normal] = crate::frame::axes(*small, 0.0)?;
        let across = geometry::cross(large);
        let above = in_front(large, small[0], normal, 0.0)?;
        // Points behind the other one see nothing of it.
        let from = in_front(small, large[0], across.normalize_or_zero(), 0.0)?;
        let (above, from) = (above.corners(), from.corners());
        let corners: [DVec3; 4] = std::array::from_fn(|k| from[k.min(from.len() - 1)]);
        let half = |k: usize| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]).length();
        let (first, second) = (half(1), half(2));
        Some(Self {
            corners: corners.map(|p| p.to_array()),
            share: if second > 0.0 { first / (first + second) } else { 1.0 },
            axes: [tangent, bitangent, normal].map(|p| p.to_array()),
            other: large.map(|p| p.to_array()),
            above: std::array::from_fn(|k| above[k.min(above.len() - 1)].to_array()),
            above_count: above.len().min(4),
            // Towards the inside of the other one.
            sides: [0, 1, 2].map(|e| across.cross(large[(e + 1) % 3] - large[e]).to_array()),
            across: across.to_array(),
            sequence: Sequence::new(seed),
        })
    }
}

/// Directions from each point, one in each quarter of what it sees: to bound that costs more than to draw a direction.
const FROM_A_POINT: usize = 4;

/// What sixteen points see of the other triangle: between which p its image on the unit disc lies, and the planes
/// through its edges, which bound q at each p.
#[repr(C, align(64))]
struct Aim {
    low: [f64; RAYS],
    extent: [f64; RAYS],
    /// Normals in the frame, towards the inside.
    edges: [[[f64; RAYS]; 3]; 4],
    /// Where in their quarters of the image directions are drawn.
    within: [[f64; RAYS]; 2],
}

impl Aim {
    const fn new() -> Self {
        Self {
            low: [0.0; RAYS],
            extent: [0.0; RAYS],
            edges: [[[0.0; RAYS]; 3]; 4],
            within: [[0.0; RAYS]; 2],
        }
    }
}

/// What segments between evenly drawn points of two triangles are drawn from.
struct Spans {
    /// A corner and two edges of the smaller one and of the other.
    from: [[f64; 3]; 3],
    to: [[f64; 3]; 3],
    normals: [[f64; 3]; 2],
    sequence: Sequence,
}

/// Sixteen segments.
#[repr(C, align(64))]
struct Drawn {
    start: [[f64; RAYS]; 3],
    end: [[f64; RAYS]; 3],
    weight: [f64; RAYS],
}

impl Drawn {
    const fn new() -> Self {
        Self {
            start: [[0.0; RAYS]; 3],
            end: [[0.0; RAYS]; 3],
            weight: [0.0; RAYS],
        }
    }

    fn segment(&self, l: usize) -> (DVec3, DVec3) {
        let lane = |v: &[[f64; RAYS]; 3]| DVec3::new(v[0][l], v[1][l], v[2][l]);
        (lane(&self.start), lane(&self.end))
    }
}

/// Draws the segments `at..at + 16` of a sequence.
#[inline(always)]
fn draw_spans(pair: &Spans, at: usize, drawn: &mut Drawn, group: &mut Group) {
    let u = pair.sequence.points(at);
    for l in 0..RAYS {
        let ((s, t), (p, q)) = (fold(u[0][l], u[1][l]), fold(u[2][l], u[3][l]));
        let (mut x, mut d) = ([0.0; 3], [0.0; 3]);
        for a in 0..3 {
            x[a] = pair.from[0][a] + pair.from[1][a] * s + pair.from[2][a] * t;
            let y = pair.to[0][a] + pair.to[1][a] * p + pair.to[2][a] * q;
            d[a] = y - x[a];
            drawn.start[a][l] = x[a];
            drawn.end[a][l] = y;
        }
        let squared = dot(d, d);
        let (leaving, arriving) = (dot(pair.normals[0], d), -dot(pair.normals[1], d));
        // In front of both, or no weight.
        let faces = (leaving > 0.0) & (arriving > 0.0) & (squared > 0.0);
        let kernel = leaving * arriving / (squared * squared);
        #[allow(clippy::cast_possible_truncation, reason = "weights relative to the pair")]
        let weight = if faces & (kernel < f64::from(f32::MAX)) {
            kernel as f32
        } else {
            0.0
        };
        group.weight[l] = weight;
        #[allow(clippy::cast_possible_truncation, reason = "rays relative to the pair")]
        for a in 0..3 {
            group.origin[a][l] = x[a] as f32;
            group.direction[a][l] = d[a] as f32;
        }
    }
}

/// Points of one triangle, and what bounds the image of the other one on the unit disc as each of them sees it.
#[inline(always)]
fn aim(fan: &Fan, at: usize, drawn: &mut Drawn, aim: &mut Aim) {
    if fan.above_count == 3 {
        aim_at::<3>(fan, at, drawn, aim);
    } else {
        aim_at::<4>(fan, at, drawn, aim);
    }
}

/// Draws the points `at..at + 16` of a sequence, and looks from them at so many corners.
#[inline(always)]
fn aim_at<const CORNERS: usize>(fan: &Fan, at: usize, drawn: &mut Drawn, aim: &mut Aim) {
    let u = fan.sequence.points(at);
    (aim.within[0], aim.within[1]) = (u[2], u[3]);
    let [first, second, third] = [1, 2, 3].map(|k| minus(fan.corners[k], fan.corners[0]));
    let scales = [fan.share, 1.0 - fan.share].map(|share| 1.0 / most(share, f64::MIN_POSITIVE));
    // The other triangle from each point.
    let mut towards = [[[0.0; RAYS]; 3]; CORNERS];
    for l in 0..RAYS {
        let is_first = u[0][l] < fan.share;
        let within = if is_first {
            u[0][l] * scales[0]
        } else {
            (u[0][l] - fan.share) * scales[1]
        };
        let (s, t) = fold(within, u[1][l]);
        let (mut e, mut f) = (first, second);
        for a in 0..3 {
            e[a] = if is_first { first[a] } else { second[a] };
            f[a] = if is_first { second[a] } else { third[a] };
        }
        let x = [
            fan.corners[0][0] + e[0] * s + f[0] * t,
            fan.corners[0][1] + e[1] * s + f[1] * t,
            fan.corners[0][2] + e[2] * s + f[2] * t,
        ];
        for a in 0..3 {
            drawn.start[a][l] = x[a];
        }
        for k in 0..CORNERS {
            let v = minus(fan.above[k], x);
            for a in 0..3 {
                towards[k][a][l] = dot(fan.axes[a], v);
            }
        }
    }
    // How far its image reaches along p: its corners' do, and its edges' images, which are parts of ellipses whose
    // extremes may lie between their ends.
    let mut low = [1.0f64; RAYS];
    let mut high = [-1.0f64; RAYS];
    for k in 0..CORNERS {
        let (v, w) = (&towards[k], &towards[(k + 1) % CORNERS]);
        let normal = &mut aim.edges[k];
        // Positive where the image rises to an extreme and falls again, negative the other way round.
        let mut turns = [0.0f64; RAYS];
        let mut any = 0u64;
        for l in 0..RAYS {
            let (v, w) = ([v[0][l], v[1][l], v[2][l]], [w[0][l], w[1][l], w[2][l]]);
            let n = cross(w, v);
            for a in 0..3 {
                normal[a][l] = n[a];
            }
            let end = v[0] / dot(v, v).sqrt();
            high[l] = most(high[l], end);
            low[l] = least(low[l], end);
            let (after, before) = (n[2] * v[1] - n[1] * v[2], w[2] * n[1] - w[1] * n[2]);
            let rises = (after > 0.0) & (before > 0.0);
            let falls = (after < 0.0) & (before < 0.0);
            turns[l] = if rises { 1.0 } else { 0.0 } - if falls { 1.0 } else { 0.0 };
            any |= u64::from(rises | falls);
        }
        if any == 0 {
            continue;
        }
        for l in 0..RAYS {
            let n = [normal[0][l], normal[1][l], normal[2][l]];
            let rest = 1.0 - n[0] * n[0] / dot(n, n);
            let extreme = (if rest > 0.0 { rest } else { 0.0 }).sqrt();
            high[l] = most(high[l], if turns[l] > 0.0 { extreme } else { -1.0 });
            low[l] = least(low[l], if turns[l] < 0.0 { -extreme } else { 1.0 });
        }
    }
    for l in 0..RAYS {
        let (from, to) = (most(low[l] - MARGIN, -1.0), least(high[l] + MARGIN, 1.0));
        aim.low[l] = from;
        aim.extent[l] = to - from;
    }
}

/// Draws a direction in a quarter of what each point sees; the mask says which meet the other triangle from its front.
///
/// Where p is known, a direction lies on the half circle q² + up² = 1 − p², and an edge's plane cuts it where a
/// quadratic equation in q is 0: which root bounds q on which side follows from where the plane has the ends of the
/// half circle.
#[inline(always)]
fn shoot(fan: &Fan, quarter: usize, aim: &Aim, drawn: &mut Drawn) -> u16 {
    let corner = [quarter % 2, quarter / 2].map(|q| q as f64);
    let (mut ps, mut ends) = ([0.0f64; RAYS], [0.0f64; RAYS]);
    for l in 0..RAYS {
        ps[l] = aim.low[l] + aim.extent[l] * (0.5 * (aim.within[0][l] + corner[0]));
        ends[l] = most(1.0 - ps[l] * ps[l], 0.0).sqrt();
    }
    let (mut lows, mut highs) = (ends.map(|end| -end), ends);
    for edge in &aim.edges[..fan.above_count] {
        for l in 0..RAYS {
            let (n, p, end) = ([edge[0][l], edge[1][l], edge[2][l]], ps[l], ends[l]);
            let (along, across) = (n[0] * p, n[1] * n[1] + n[2] * n[2]);
            let root = n[2] * most(end * end * across - along * along, 0.0).sqrt();
            let inverse = 1.0 / most(across, f64::MIN_POSITIVE);
            let (from, to) = ((-along * n[1] - root) * inverse, (-along * n[1] + root) * inverse);
            lows[l] = most(lows[l], if along - n[1] * end >= 0.0 { -end } else { from });
            highs[l] = least(highs[l], if along + n[1] * end >= 0.0 { end } else { to });
        }
    }
    let mut met = [0u64; RAYS];
    for l in 0..RAYS {
        let (p, end) = (ps[l], ends[l]);
        let (low, high) = (most(lows[l] - MARGIN, -end), least(highs[l] + MARGIN, end));
        let extent = most(high - low, 0.0);
        let q = low + extent * (0.5 * (aim.within[1][l] + corner[1]));
        let weight = aim.extent[l] * extent;
        let rest = 1.0 - (p * p + q * q);
        let up = (if rest > 0.0 { rest } else { 0.0 }).sqrt();
        let [tangent, bitangent, normal] = fan.axes;
        let d = [
            tangent[0] * p + bitangent[0] * q + normal[0] * up,
            tangent[1] * p + bitangent[1] * q + normal[1] * up,
            tangent[2] * p + bitangent[2] * q + normal[2] * up,
        ];
        let x = [drawn.start[0][l], drawn.start[1][l], drawn.start[2][l]];
        let slope = dot(fan.across, d);
        let length = dot(fan.across, minus(fan.other[0], x)) / slope;
        let y = [x[0] + d[0] * length, x[1] + d[1] * length, x[2] + d[2] * length];
        let within = |k: usize| dot(fan.sides[k], minus(y, fan.other[k])) >= 0.0;
        let meets = (rest > 0.0) & (slope < 0.0) & (length > 0.0) & (weight > 0.0) & within(0) & within(1) & within(2);
        met[l] = u64::from(meets);
        drawn.weight[l] = weight;
        for a in 0..3 {
            drawn.end[a][l] = y[a];
        }
    }
    mask(&met)
}

/// What rounding may take from what bounds an image on the unit disc.
const MARGIN: f64 = 1e-9;

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
}

/// Finds which of the planes through an edge and an opposite corner bound the hull of two triangles of this extent.
#[inline(always)]
fn find_sides(points: &[[f64; 3]; 6], size: f64, tolerance: f64, out: &mut EdgeSides) {
    let mut from = [[0.0; EDGE_LANES]; 3];
    let (mut along, mut across) = (from, from);
    for (l, &[a, b, c]) in EDGE_CORNERS.iter().enumerate() {
        for x in 0..3 {
            from[x][l] = points[a][x];
            along[x][l] = points[b][x] - points[a][x];
            across[x][l] = points[c][x] - points[a][x];
        }
    }
    let flattest = (1e-9 * size * size).powi(2);
    for l in 0..EDGE_LANES {
        let (u, v) = (
            [along[0][l], along[1][l], along[2][l]],
            [across[0][l], across[1][l], across[2][l]],
        );
        let n = cross(u, v);
        let squared = dot(n, n);
        let inverse = 1.0 / squared.sqrt();
        let n = [n[0] * inverse, n[1] * inverse, n[2] * inverse];
        let d = dot(n, [from[0][l], from[1][l], from[2][l]]);
        let (mut lowest, mut highest, mut extents) = (0.0f64, 0.0f64, [0.0f64; 2]);
        for (k, &p) in points.iter().enumerate() {
            let height = dot(n, p) - d;
            lowest = least(lowest, height);
            highest = most(highest, height);
            extents[k / 3] = most(extents[k / 3], height.abs());
        }
        // A plane that all but coincides with one of the triangles, as where they share a corner, must not count as
        // outside what lies a hair above that triangle and hides it.
        let rises = least(extents[0], extents[1]);
        let side = least(OUTSIDE_OF_RISE * rises, OUTSIDE * size);
        let flat = 0.5 * side;
        let is_plane = (squared > flattest) & (side > tolerance);
        let (above, below) = ((lowest >= -flat) & (highest > flat), (highest <= flat) & (lowest < -flat));
        out.is_side[l] = u64::from(is_plane & (above | below));
        let sign = if above { 1.0 } else { -1.0 };
        for x in 0..3 {
            out.normal[x][l] = n[x] * sign;
        }
        out.least[l] = side + d * sign;
    }
}

/// Lists the blocks that reach into a shaft, with those of their triangles that may. False where these are more than
/// [`MOST_LISTED`], and the list is not finished.
#[inline(always)]
fn reached(tree: &Tree, sides: &Sides, origin: DVec3, pending: &mut Vec<u32>, reached: &mut Vec<(u32, u16)>) -> bool {
    pending.clear();
    reached.clear();
    pending.push(0);
    let mut listed = 0;
    while let Some(index) = pending.pop() {
        let node = &tree.nodes[index as usize];
        if !sides.reach((node.center - origin).to_array(), node.half.to_array()) {
            continue;
        }
        if node.block == INNER {
            pending.extend([node.child, node.child + 1]);
            continue;
        }
        let kept = inside(&tree.blocks[node.block as usize].corners, origin.to_array(), sides);
        if kept != 0 {
            reached.push((node.block, kept));
            listed += kept.count_ones();
            if listed > MOST_LISTED {
                return false;
            }
        }
    }
    true
}

/// Marks the segments that a triangle beside cuts, and those that end on a triangle over.
#[inline(always)]
fn stop(
    beside: &[[DVec3; 3]],
    over: &[[DVec3; 3]],
    from: &[[f64; RAYS]; 3],
    to: &[[f64; RAYS]; 3],
    out: &mut [u64; RAYS],
) {
    // Towards the inside of each side, and a point of it.
    let sides =
        |t: &[DVec3; 3], n: DVec3| [0, 1, 2].map(|k| (n.cross(t[(k + 1) % 3] - t[k]).to_array(), t[k].to_array()));
    let normal = geometry::cross;
    for t in over {
        let sides = sides(t, normal(t));
        for l in 0..RAYS {
            let y = [to[0][l], to[1][l], to[2][l]];
            let within = |(inwards, s): ([f64; 3], [f64; 3])| dot(inwards, minus(y, s)) >= 0.0;
            out[l] |= u64::from(within(sides[0]) & within(sides[1]) & within(sides[2]));
        }
    }
    for t in beside {
        let n = normal(t);
        let sides = sides(t, n);
        let (n, first) = (n.to_array(), t[0].to_array());
        for l in 0..RAYS {
            let (x, y) = ([from[0][l], from[1][l], from[2][l]], [to[0][l], to[1][l], to[2][l]]);
            let (hx, hy) = (dot(n, minus(x, first)), dot(n, minus(y, first)));
            let (d, share) = (minus(y, x), hx / (hx - hy));
            let p = [x[0] + d[0] * share, x[1] + d[1] * share, x[2] + d[2] * share];
            let within = |(inwards, s): ([f64; 3], [f64; 3])| dot(inwards, minus(p, s)) >= 0.0;
            out[l] |= u64::from((hx * hy < 0.0) & within(sides[0]) & within(sides[1]) & within(sides[2]));
        }
    }
}

/// Which of 16 triangles reach inside all planes, one bit each.
#[inline(always)]
fn inside(corners: &[[f64; LANES]; 9], origin: [f64; 3], sides: &Sides) -> u16 {
    let mut kept = [1u64; LANES];
    for k in 0..sides.count {
        let n = [sides.normal[0][k], sides.normal[1][k], sides.normal[2][k]];
        let least = sides.least[k];
        let mut any = 0;
        for l in 0..LANES {
            let height = |k: usize| {
                n[0] * (corners[3 * k][l] - origin[0])
                    + n[1] * (corners[3 * k + 1][l] - origin[1])
                    + n[2] * (corners[3 * k + 2][l] - origin[2])
            };
            let (a, b, c) = (height(0), height(1), height(2));
            kept[l] &= u64::from(most(most(a, b), c) > least);
            any |= kept[l];
        }
        if any == 0 {
            return 0;
        }
    }
    mask(&kept)
}

/// Marks the rays of a group that an occluder stops strictly between their ends (Möller & Trumbore 1997), and those
/// that are stopped anyway.
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
            // Everything in terms of the determinant, made positive: no division.
            let determinant = -(d[0] * n[0] + d[1] * n[1] + d[2] * n[2]);
            let (size, sign) = (determinant.abs(), 1.0f32.copysign(determinant));
            let at = (s[0] * n[0] + s[1] * n[1] + s[2] * n[2]) * sign;
            let q = [
                s[1] * d[2] - s[2] * d[1],
                s[2] * d[0] - s[0] * d[2],
                s[0] * d[1] - s[1] * d[0],
            ];
            let u = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) * sign;
            let v = -(e[0] * q[0] + e[1] * q[1] + e[2] * q[2]) * sign;
            let is_between = (at > 1e-6 * size) & (at < (1.0 - 1e-6) * size);
            hit[l] |= u32::from(is_between & (u >= 0.0) & (v >= 0.0) & (u + v <= size));
        }
        // When every ray is stopped, the rest cannot change anything.
        if count % 4 == 3 && hit.iter().all(|&h| h != 0) {
            break;
        }
    }
    group.hit = hit;
}

dispatch! {
    fn dispatch_reached = reached(tree: &Tree, sides: &Sides, origin: DVec3, pending: &mut Vec<u32>, out: &mut Vec<(u32, u16)>) -> bool
}
dispatch! {
    fn dispatch_find_sides = find_sides(points: &[[f64; 3]; 6], size: f64, tolerance: f64, out: &mut EdgeSides)
}
dispatch! {
    fn dispatch_draw_spans = draw_spans(pair: &Spans, at: usize, drawn: &mut Drawn, group: &mut Group)
}
dispatch! {
    fn dispatch_stop = stop(beside: &[[DVec3; 3]], over: &[[DVec3; 3]], from: &[[f64; RAYS]; 3], to: &[[f64; RAYS]; 3], out: &mut [u64; RAYS])
}
dispatch! {
    fn dispatch_aim = aim(fan: &Fan, at: usize, drawn: &mut Drawn, out: &mut Aim)
}
dispatch! {
    fn dispatch_shoot = shoot(fan: &Fan, quarter: usize, aim: &Aim, drawn: &mut Drawn) -> u16
}
dispatch! {
    fn dispatch_hits = hits(occluders: &[Occluder], group: &mut Group)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::refine::MOST_DRAWN;
    use crate::geometry::area;
    use crate::sampling::splitmix;
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
        made(triangles)
    }

    /// One-sided triangles, in this order.
    fn made(triangles: Vec<[DVec3; 3]>) -> Model {
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

    fn city(blocks: u32, split: u32) -> Model {
        let parameters = hemicube_scene::generate::BlockCityParameters {
            blocks,
            split,
            ..hemicube_scene::generate::BlockCityParameters::for_target(1000, 1)
        };
        let patches = Patches::new(&parameters.generate().expect("a city"), Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn obstacles<'a>(model: &'a Model, walls: &'a CoplanarRegions) -> Obstacles<'a> {
        Obstacles {
            surfaces: &model.geometry().surfaces,
            walls,
        }
    }

    fn fraction(model: &Model, i: u32, j: u32, rays: usize) -> (usize, f64) {
        let corners = |p: u32| model.normalised_corners(p);
        let mut shaft = Shaft::default();
        let walls = CoplanarRegions::of(model);
        let obstacles = obstacles(model, &walls);
        let sighting = shaft.sight(obstacles, (i, &corners(i)), (j, &corners(j)));
        if sighting.hidden {
            return (1, 0.0);
        }
        let mut cast = Cast::default();
        shaft.cast(obstacles, &sighting, rays, 1, &mut cast);
        let count = sighting.between.len() + sighting.beside.len() + sighting.over.len();
        (count, cast.sums.0 / cast.sums.1)
    }

    #[test]
    #[allow(clippy::print_stderr, reason = "docs/accuracy.md has these figures")]
    fn walls_hide_what_their_pieces_hide() {
        let model = city(5, 5);
        let (walls, pieces) = (CoplanarRegions::of(&model), CoplanarRegions::pieces_of(&model));
        let count = u64::try_from(model.patches().len()).expect("a number");
        let (mut state, mut partly, mut fewer, mut hidden) = (1, 0, [0, 0], [0, 0]);
        for _ in 0..20_000 {
            let pair = [0, 1].map(|_| u32::try_from(splitmix::next(&mut state) % count).expect("a patch"));
            let [emitter, receiver] = pair.map(|patch| model.normalised_corners(patch));
            let fractions = [&*walls, &pieces].map(|walls| {
                let mut shaft = Shaft::default();
                let obstacles = obstacles(&model, walls);
                let sighting = shaft.sight(obstacles, (pair[0], &emitter), (pair[1], &receiver));
                let at = usize::from(!std::ptr::eq(walls, &pieces));
                hidden[at] += usize::from(sighting.hidden);
                fewer[at] += sighting.between.len();
                let mut cast = Cast::default();
                shaft.cast(obstacles, &sighting, 256, 1, &mut cast);
                if sighting.hidden { Some(0.0) } else { cast.fraction() }
            });
            let [Some(by_walls), Some(by_pieces)] = fractions else {
                continue;
            };
            assert!((by_walls - by_pieces).abs() < 0.02, "{pair:?}: {by_walls} {by_pieces}");
            partly += usize::from(by_walls > 0.0 && by_walls < 1.0);
        }
        assert!(partly > 200, "{partly} pairs partly visible");
        assert!(hidden[1] > hidden[0], "{hidden:?} proved hidden by pieces and walls");
        assert!(fewer[1] < fewer[0], "{fewer:?} occluders of pieces and walls");
        eprintln!(
            "{count} patches, 20,000 pairs: {fewer:?} pieces and walls in between, {hidden:?} pairs proved hidden by them"
        );
    }

    /// Rays that walk the tree of walls are stopped where rays held against the shaft's list are.
    #[test]
    fn a_tree_stops_the_rays_that_a_list_stops() {
        let model = city(5, 2);
        let walls = CoplanarRegions::of(&model);
        let obstacles = obstacles(&model, &walls);
        let count = u64::try_from(model.patches().len()).expect("a number");
        let (mut state, mut partly, mut near) = (3, 0, 0);
        for _ in 0..20_000 {
            let pair = [0, 1].map(|_| u32::try_from(splitmix::next(&mut state) % count).expect("a patch"));
            let [emitter, receiver] = pair.map(|patch| model.normalised_corners(patch));
            let mut shaft = Shaft::default();
            let mut sighting = shaft.sight(obstacles, (pair[0], &emitter), (pair[1], &receiver));
            if sighting.hidden || sighting.is_open() || sighting.crowded {
                continue;
            }
            let fractions = [false, true].map(|crowded| {
                sighting.crowded = crowded;
                let mut cast = Cast::default();
                if sighting.near {
                    shaft.cast_near(obstacles, &sighting, 256, MOST_DRAWN * 256, 1, &mut cast);
                } else {
                    shaft.cast(obstacles, &sighting, 256, 1, &mut cast);
                }
                cast.fraction()
            });
            let [Some(by_list), Some(by_tree)] = fractions else {
                continue;
            };
            // Rays of a list are in f32: one may pass an edge on the other side.
            assert!(
                (by_list - by_tree).abs() < 0.02,
                "{pair:?}: {by_list} by list, {by_tree} by tree"
            );
            partly += usize::from(by_list > 0.0 && by_list < 1.0);
            near += usize::from(sighting.near);
        }
        assert!(partly > 200 && near > 20, "{partly} pairs partly visible, {near} near");
    }

    #[test]
    fn points_of_a_sequence_fill_every_part_alike() {
        let sequence = Sequence::new(3);
        let points: Vec<[f64; 4]> = (0..256)
            .step_by(RAYS)
            .flat_map(|at| {
                let block = sequence.points(at);
                (0..RAYS).map(move |l| block.map(|of| of[l]))
            })
            .collect();
        // One in each of 256 parts of each dimension; and of the first two together, however the parts are shaped.
        let parts = |count: usize, x: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a part")]
            let part = (x * count as f64) as usize;
            part
        };
        for d in 0..4 {
            let found: std::collections::BTreeSet<usize> = points.iter().map(|p| parts(256, p[d])).collect();
            assert_eq!(found.len(), 256, "dimension {d}");
        }
        for across in [2, 8, 16, 64] {
            let found: std::collections::BTreeSet<(usize, usize)> = points
                .iter()
                .map(|p| (parts(across, p[0]), parts(256 / across, p[1])))
                .collect();
            assert_eq!(found.len(), 256, "{across} parts by {}", 256 / across);
        }
        assert_ne!(points[0], {
            let block = Sequence::new(4).points(0);
            block.map(|of| of[0])
        });
    }

    /// What directions are drawn from must be all that a point sees: what they are worth together is the form factor.
    #[test]
    fn directions_between_near_patches_add_up_to_the_form_factor() {
        let model = scene(&[]);
        let rule = crate::factor::FactorRule::for_tolerance(1e-4);
        let mut state = 11;
        let mut unit = || splitmix::unit(splitmix::next(&mut state));
        let mut triangle = |size: f64| -> [DVec3; 3] {
            std::array::from_fn(|_| DVec3::new(unit(), unit(), unit()) * size - DVec3::splat(0.5 * size))
        };
        let (mut tried, mut cut) = (0, 0);
        while tried < 60 {
            let (small, large) = (triangle(0.4), triangle(2.0));
            let factor = crate::factor::exchange(&small, &large, &rule) / area(&small);
            if area(&small) > area(&large) || factor < 0.02 {
                continue;
            }
            tried += 1;
            let mut shaft = Shaft::default();
            let walls = CoplanarRegions::of(&model);
            let obstacles = obstacles(&model, &walls);
            let sighting = shaft.sight(obstacles, (0, &small), (1, &large));
            let mut cast = Cast::default();
            shaft.cast_near(obstacles, &sighting, 1 << 13, 1 << 17, 5, &mut cast);
            let across = (large[1] - large[0]).cross(large[2] - large[0]).normalize();
            let from = in_front(&small, large[0], across, 0.0).expect("it sees something");
            let part: f64 = (1..from.corners().len() - 1)
                .map(|k| area(&[from.corners()[0], from.corners()[k], from.corners()[k + 1]]))
                .sum();
            cut += usize::from(part < 0.999 * area(&small));
            let found = cast.sums.1 / (cast.drawn as f64 * std::f64::consts::PI) * part / area(&small);
            assert!(
                (found / factor - 1.0).abs() < 0.01,
                "{found} for {factor} from {small:?} to {large:?}"
            );
        }
        assert!(
            cut > 5,
            "only {cut} of the smaller ones reach behind the larger one's plane"
        );
    }

    /// What rays are allotted by: n of them leave what n^(5/4) independent ones would, about.
    #[test]
    #[allow(clippy::print_stderr, reason = "docs/accuracy.md has these figures")]
    fn rays_leave_less_than_independent_ones() {
        let model = city(6, 2);
        let walls = CoplanarRegions::of(&model);
        let obstacles = obstacles(&model, &walls);
        let rule = crate::factor::FactorRule::for_tolerance(1e-2);
        let count = u32::try_from(model.patches().len()).expect("few patches");
        let levels = [16, 64, 256, 1024];
        // Σ F² (error)² and what independent rays would leave, of distant pairs and of near ones.
        let mut sums = [[(0.0, 0.0); 4]; 2];
        let (mut pairs, mut drawn, mut worth) = ([0, 0], 0, 0);
        for i in (0..count).step_by(61) {
            let emitter = model.normalised_corners(i);
            for j in (0..count).filter(|&j| j != i) {
                let receiver = model.normalised_corners(j);
                let factor = crate::factor::exchange(&emitter, &receiver, &rule) / area(&emitter);
                if factor < 0.004 {
                    continue;
                }
                let mut shaft = Shaft::default();
                let sighting = shaft.sight(obstacles, (i, &emitter), (j, &receiver));
                if sighting.hidden || sighting.is_open() {
                    continue;
                }
                let cast = |rays: usize, seed: u64| {
                    let mut cast = Cast::default();
                    let rays = if sighting.near {
                        shaft.cast_near(obstacles, &sighting, rays, MOST_DRAWN * rays, seed, &mut cast)
                    } else {
                        shaft.cast(obstacles, &sighting, rays, seed, &mut cast)
                    };
                    (rays, cast)
                };
                let exact: Option<f64> = (0..4).map(|k| cast(1 << 14, k).1.fraction()).sum();
                let Some(exact) = exact.map(|sum| 0.25 * sum) else {
                    continue;
                };
                if !(0.02..=0.98).contains(&exact) {
                    continue;
                }
                let near = usize::from(sighting.near);
                pairs[near] += 1;
                for (level, rays) in levels.into_iter().enumerate() {
                    for seed in 0..4 {
                        let (rays, cast) = cast(rays, splitmix::hash(u64::from(j) * 4 + seed));
                        let Some(fraction) = cast.fraction() else { continue };
                        let sum = &mut sums[near][level];
                        sum.0 += (factor * (fraction - exact)).powi(2);
                        sum.1 += factor * factor * exact * (1.0 - exact) / rays as f64;
                        if sighting.near {
                            (drawn, worth) = (drawn + cast.drawn, worth + rays);
                        }
                    }
                }
            }
        }
        let gains = sums.map(|of| of.map(|(squared, independent)| independent / squared));
        eprintln!(
            "16, 64, 256 and 1,024 rays do as well as {gains:.1?} times as many independent ones, over {pairs:?} distant and near \
             pairs; {:.1} directions for a near ray's worth",
            drawn as f64 / worth as f64
        );
        assert!(pairs[0] > 100 && pairs[1] > 40, "{pairs:?} pairs");
        for of in gains {
            assert!(of[0] > 0.8 && of[2] > 1.8 && of[3] > 2.5, "{gains:?}");
        }
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

    /// A thin plate whose two sides are cut along different diagonals and bent: the back of one is then a hair in front
    /// of the other, and hides it. Found in a model of a ship, where planes through an edge of the emitter and a corner
    /// of the receiver all but coincided with the receiver.
    #[test]
    fn a_crack_hides_what_is_behind_it_however_narrow() {
        let corner = DVec3::new;
        let (r, q, a) = (corner(1.0, 0.0, 0.0), corner(1.1, 1.0, 0.0), corner(0.0, 1.2, 0.0));
        for height in [1e-8, 1e-7, 5e-7, 1e-6, 2e-6, 3e-6, 4e-6, 6e-6, 1e-5, 3e-5, 1e-4, 1e-3] {
            let p = corner(0.0, 0.0, height);
            let emitter = [corner(0.5, -0.3, 0.7), r, p];
            let back = [[q, r, p], [a, q, p]];
            let model = made(vec![emitter, [r, q, a], back[0], back[1]]);
            for (i, j) in [(0, 1), (1, 0)] {
                let (count, fraction) = fraction(&model, i, j, 512);
                assert!(
                    fraction < 0.02,
                    "{height}, {i} to {j}: {fraction} behind {count} occluders"
                );
            }
            // And without it, all is seen.
            let bare = made(vec![emitter, [r, q, a]]);
            assert_eq!(fraction(&bare, 0, 1, 512), (0, 1.0));
        }
    }

    /// A wall that stands before a small patch by next to nothing, but rises to more beyond it, as the walls of two
    /// houses that were measured apart. Found in the real tile.
    #[test]
    fn a_wall_that_rises_slowly_hides_the_small_patch_below_it() {
        let p = DVec3::new;
        let emitter = [p(0.0, 0.0, 0.0), p(0.03, 0.0, 0.0), p(0.0, 0.03, 0.0)];
        let receiver = [p(-0.5, -0.5, 1.0), p(0.0, 0.6, 1.0), p(0.6, -0.4, 1.0)];
        for slope in [1e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3] {
            // It touches two of the corners, so that no proof by corners holds.
            let wall = [p(0.0, -2.0, 0.0), p(6.0, 0.0, 6.0 * slope), p(0.0, 2.0, 0.0)];
            let model = made(vec![emitter, receiver, wall]);
            for (i, j) in [(0, 1), (1, 0)] {
                let (count, fraction) = fraction(&model, i, j, 512);
                assert!(fraction < 0.01, "slope {slope}, {i} to {j}: {fraction} behind {count}");
            }
        }
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
        let walls = CoplanarRegions::of(&model);
        let sighting = shaft.sight(obstacles(&model, &walls), (0, &corners(0)), (2, &corners(2)));
        assert_eq!(sighting.between.len(), 1);
        let (small, large) = sighting.by_size();
        let normal = geometry::cross;
        let span = |t: &[DVec3; 3]| [t[0], t[1] - t[0], t[2] - t[0]].map(|p| p.to_array());
        let spans = Spans {
            from: span(small),
            to: span(large),
            normals: [normal(small), normal(large)].map(|p| p.to_array()),
            sequence: Sequence::new(7),
        };
        for at in (0..512).step_by(RAYS) {
            let (mut a, mut b) = (Group::new(), Group::new());
            let mut drawn = [Drawn::new(), Drawn::new()];
            draw_spans(&spans, at, &mut drawn[0], &mut a);
            dispatch_draw_spans(InstructionSet::widest(), &spans, at, &mut drawn[1], &mut b);
            assert_eq!((a.origin, a.direction, a.weight), (b.origin, b.direction, b.weight));
            hits(&shaft.occluders, &mut a);
            dispatch_hits(InstructionSet::widest(), &shaft.occluders, &mut b);
            assert_eq!(a.hit, b.hit);
        }
    }

    #[test]
    fn every_path_draws_the_same_directions() {
        let p = DVec3::new;
        let small = [p(0.4, 0.1, 0.0), p(0.9, 0.3, 0.0), p(0.5, 0.8, 0.0)];
        // One that stands on the other's plane beside it, one that it cuts, and one whose plane cuts the smaller one.
        let large = [
            [p(1.0, -1.0, 0.0), p(1.0, 0.5, 2.0), p(1.0, 2.0, 0.0)],
            [p(1.2, -1.0, -0.5), p(1.0, 0.5, 2.0), p(0.9, 2.0, -0.5)],
            [p(0.6, 3.0, 2.0), p(0.6, -3.0, 2.0), p(0.7, -3.0, -1.0)],
        ];
        for large in large {
            let fan = Fan::between(&small, &large, 7).expect("they see each other");
            let mut met = 0;
            for at in (0..256).step_by(RAYS) {
                let (mut aims, mut drawn) = ([Aim::new(), Aim::new()], [Drawn::new(), Drawn::new()]);
                aim(&fan, at, &mut drawn[0], &mut aims[0]);
                dispatch_aim(InstructionSet::widest(), &fan, at, &mut drawn[1], &mut aims[1]);
                for quarter in 0..FROM_A_POINT {
                    let masks = [
                        shoot(&fan, quarter, &aims[0], &mut drawn[0]),
                        dispatch_shoot(InstructionSet::widest(), &fan, quarter, &aims[1], &mut drawn[1]),
                    ];
                    assert_eq!(masks[0], masks[1]);
                    let bits = |of: &Drawn| {
                        let all = of.start.iter().chain(&of.end).flatten().chain(&of.weight);
                        all.map(|x| x.to_bits()).collect::<Vec<_>>()
                    };
                    assert_eq!(bits(&drawn[0]), bits(&drawn[1]));
                    met += masks[0].count_ones();
                }
            }
            assert!(met > 256, "{met} of 1024 directions met it");
        }
    }

    #[test]
    fn both_directions_have_the_same_fraction() {
        let p = DVec3::new;
        let model = scene(&[
            [p(0.2, 0.1, 0.5), p(0.9, 0.3, 0.4), p(0.4, 0.8, 0.6)],
            [p(0.1, 0.1, 0.2), p(0.2, 0.1, 0.3), p(0.1, 0.2, 0.25)],
        ]);
        for (i, j) in [(0, 2), (0, 3), (1, 2), (1, 3), (4, 3)] {
            let (there, back) = (fraction(&model, i, j, 256), fraction(&model, j, i, 256));
            assert!(there.1.is_nan() == back.1.is_nan());
            assert!(there.1.is_nan() || there == back, "{i} and {j}: {there:?}, {back:?}");
        }
    }
}
