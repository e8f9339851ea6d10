//! The shaft between two triangles, and rays through it.
//!
//! The shaft (Haines & Wallace 1991) is the convex hull of the two triangles. Nothing outside one of its planes comes
//! in between. An empty shaft proves full visibility; a region passed by all nine segments between corners proves full
//! occlusion. Otherwise rays against the listed occluders measure the visible fraction.
//!
//! Below the emitter's plane and behind the receiver's nothing occludes. A patch in the receiver's own plane does if
//! its id is smaller, as in a backend's rows.
//!
//! The visible fraction is Σ k V / Σ k over points drawn on both triangles: V is 1 or 0, and the kernel
//! k = cos φ_i cos φ_j / r² weights numerator and denominator. Times the closed form it gives F_ij without the bias of
//! uniform visibility.
//!
//! Work is counted in [`crate::steps`].

use crate::backend::{Rays, Surface};
use crate::bvh::{INNER, LANES, Tree, UNUSED, overlap};
use crate::geometry::{self, Plane, Sphere, in_front};
use crate::sampling::sobol::{self, Sequence, fold};
use crate::simd::{InstructionSet, cross, dispatch, dot, lanes, least, mask, minus, most};
use crate::steps;
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::segments::{HAIR, Obstacles, Segments, TOLD, Walked};
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::ops::Range;

/// Rays cast together.
pub(crate) const RAYS: usize = sobol::BATCH;

/// Depth inside a side of the shaft counted as outside, in parts of the pair's extent. A choice above the rounding of
/// rays in f32.
const OUTSIDE: f64 = 4e-6;
/// Bound of that depth in parts of either triangle's greatest height above that side. A choice: with more, flat pairs
/// leave out occluders that matter; with less, they list those that touch the shaft by rounding.
const OUTSIDE_OF_RISE: f64 = 0.01;

/// Height above one of the pair's planes, in parts of its extent, up to which an occluder is tested in f64; likewise
/// the distance of a patch's corners from the occluder's plane. Rays in f32 do not know on which side of it they begin
/// and end. A choice: with less, rays in f32 decide what they cannot tell; with more, more occluders take f64.
const NEAR_PLANE: f64 = 1e-4;

/// Distance within which a proof takes points for points of a polygon, in radii of the smaller patch, at most. A choice:
/// of a patch so far behind an edge, a thousandth is taken for hidden.
const PROVED_WITHIN: f64 = 1e-3;

/// Width beyond a triangle's edges within which it stops a ray in f32, in barycentric coordinates: a few roundings. A ray
/// through an edge that two triangles share is stopped by one of them.
const SINGLE_HAIR: f32 = 1e-6;

/// Distance of centroids in radii below which a pair [is near](TrianglePair::is_near). A choice: with less, segments
/// between close patches have weights that few of them carry; with more, distant pairs take directions that miss.
const NEAR: f64 = 2.0;

/// Steps of a shaft, of a block of the tree that reaches into it, and of a triangle listed. Measured.
const STEPS_A_SHAFT: u64 = 700;
const STEPS_A_BLOCK: u64 = 60;
const STEPS_LISTED: u64 = 30;
/// Steps of sixteen rays, and of each occluder they are tested against. Measured.
const STEPS_A_BATCH: u64 = 100;
const STEPS_A_TEST: u64 = 7;
/// Steps of a segment down the tree. Measured.
pub(crate) const STEPS_A_SEGMENT: u64 = 600;
/// Steps of sixteen directions drawn between near patches. Measured.
const STEPS_A_DRAW: u64 = 120;

/// Bound of the triangles that a shaft lists: a ray tested against more of them costs more than its way down the tree.
const MOST_LISTED: u32 = 256;

/// Who answers rays beside the processor.
pub(crate) type Asked<'a> = &'a mut dyn FnMut(&Rays<'_>) -> Vec<u32>;

/// Segments of a batch for a device at least. A choice, as for shares: of fewer, handing them over takes longer than
/// they do.
const LEAST_ASKED: usize = TOLD;

/// Bound of the directions drawn for each ray that is wanted between near patches. A choice: with fewer, pairs that few
/// directions meet keep the centroid's fraction; with more, they cost more than points do.
const MOST_DRAWN: usize = 32;

/// A patch and its corners in normalised coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatchTriangle<'a> {
    id: u32,
    corners: &'a [DVec3; 3],
}

impl<'a> PatchTriangle<'a> {
    pub(crate) fn new(id: u32, corners: &'a [DVec3; 3]) -> Self {
        Self { id, corners }
    }
}

/// A triangle that may come in between, relative to the pair's origin.
#[derive(Clone, Copy, Debug)]
struct Occluder {
    corner: [f32; 3],
    edges: [[f32; 3]; 2],
    normal: [f32; 3],
    /// block × 16 + lane in the tree.
    slot: u32,
    /// (2 · area)²: large occluders stop most rays.
    size: f32,
}

/// Lists the occluders between two triangles, for one pair after the other.
#[derive(Debug, Default)]
pub(crate) struct Shaft {
    sides: Sides,
    found: EdgeSides,
    /// The occluders of all pairs since [`Shaft::clear`].
    occluders: Vec<Occluder>,
    pending: Vec<u32>,
    /// Blocks reaching into the shaft, with the mask of triangles that may.
    reached: Vec<(u32, u16)>,
}

/// Number of planes tested together.
const TOGETHER: usize = 8;
/// The two triangles' planes and one for each of 18 edges with opposite corners, rounded up to whole groups.
const MOST_SIDES: usize = 24;

/// The planes of a shaft, n · p > `least` inside, and its box.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Sides {
    normal: [[f64; MOST_SIDES]; 3],
    /// Includes the depth counted as outside.
    least: [f64; MOST_SIDES],
    count: usize,
    low: [f64; 3],
    high: [f64; 3],
}

/// Number of planes through an edge of either triangle and a corner of the other.
const EDGE_SIDES: usize = 18;
/// Number of lanes for them.
const EDGE_LANES: usize = 24;

/// For each of these planes, the edge's ends and the corner, as indices into the six corners.
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

/// These planes, and which of them have both triangles on one side: n · p > `least` inside.
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

    /// Fills the last group with planes that have everything inside.
    fn fill(&mut self) {
        for k in self.count..self.count.next_multiple_of(TOGETHER) {
            for normal in &mut self.normal {
                normal[k] = 0.0;
            }
            self.least[k] = -1.0;
        }
    }

    /// Returns whether a box of centre `c` and half extents `h` may reach inside.
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

/// Two triangles that face each other, and the occluders between them.
#[derive(Clone, Debug)]
pub(crate) struct TrianglePair {
    /// Relative to `origin`.
    pub(crate) emitter: [DVec3; 3],
    pub(crate) receiver: [DVec3; 3],
    pub(crate) origin: DVec3,
    /// True if the centroid of the smaller one is near the other, in radii of either: of segments between evenly drawn
    /// points, a few would carry most of the weight.
    pub(crate) is_near: bool,
    /// True if the receiver has the smaller area.
    pub(crate) receiver_is_smaller: bool,
    /// Between the two planes, in the shaft's list.
    occluders: Range<usize>,
    /// Occluders so near to one of the planes that rays in f32 cannot tell their side.
    near_plane: Vec<[DVec3; 3]>,
    /// The region of each of them.
    near_regions: Vec<u32>,
    /// Patches in the receiver's plane that hide part of it by a smaller id.
    pub(crate) coplanar: Vec<[DVec3; 3]>,
    /// Proved: one region hides all of the receiver.
    pub(crate) is_occluded: bool,
    /// True if more reaches into the shaft than is listed: nothing is proved, and segments walk the tree.
    pub(crate) is_crowded: bool,
    /// The coplanar regions of the two.
    own_regions: [u32; 2],
    emitter_patch: u32,
    receiver_patch: u32,
    /// Planes of the emitter and the receiver, relative to `origin`.
    planes: [Plane; 2],
    /// Work of listing the occluders, in steps.
    pub(crate) steps: u64,
}

impl TrianglePair {
    /// Returns whether all is proved visible: there is no occluder.
    pub(crate) fn is_unoccluded(&self) -> bool {
        !self.is_crowded && self.occluders.is_empty() && self.near_plane.is_empty() && self.coplanar.is_empty()
    }

    /// The visible fraction if proved: 0 or 1.
    pub(crate) fn proved_fraction(&self) -> Option<f64> {
        if self.is_occluded {
            Some(0.0)
        } else {
            self.is_unoccluded().then_some(1.0)
        }
    }

    /// Segments down the tree, for a crowded shaft.
    fn segments<'a>(&self, obstacles: Obstacles<'a>, cast: &Cast) -> Segments<'a> {
        let planes = self.planes.map(|plane| Plane {
            offset: plane.offset + plane.normal.dot(self.origin),
            ..plane
        });
        Segments::new(obstacles, self.own_regions, self.receiver_patch, planes, cast.walked)
    }

    /// Returns whether a segment between a point of the smaller one and one of the other, relative to `origin`, is
    /// stopped in the tree.
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

    /// Lists a surface in the receiver's plane if it hides part of it.
    fn list_coplanar(&mut self, surface: &Surface, regions: &CoplanarRegions, receiver: u32, plane: &Plane, side: f64) {
        let tolerance = regions.tree.plane_tolerance;
        let triangle = surface.corners.map(|p| p - self.origin);
        let faces = geometry::cross(&triangle).dot(plane.normal) > 0.0;
        let Some(id) = (if faces { Some(surface.front) } else { surface.back }) else {
            return;
        };
        if regions.is_seen_before(id, receiver)
            && triangle.iter().all(|&p| plane.height(p).abs() <= tolerance)
            && overlap(&triangle, &self.receiver, plane.normal, side)
            && !self.coplanar.contains(&triangle)
        {
            self.coplanar.push(triangle);
        }
    }

    /// Marks segments stopped by an occluder near a plane or ending on a coplanar patch.
    fn mark_stopped(&self, drawn: &DrawnSegments, out: &mut [u64; RAYS]) {
        *out = [0; RAYS];
        if self.near_plane.is_empty() && self.coplanar.is_empty() {
            return;
        }
        let (from, to) = if self.receiver_is_smaller {
            (&drawn.end, &drawn.start)
        } else {
            (&drawn.start, &drawn.end)
        };
        mark_stopped_by(
            InstructionSet::widest(),
            &self.near_plane,
            &self.coplanar,
            from,
            to,
            out,
        );
    }
}

/// Sums over rays of the kernel k, where V is 1 or 0.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Kernels {
    /// Σ k V.
    pub(crate) visible: f64,
    /// Σ k.
    pub(crate) all: f64,
}

impl Kernels {
    fn add(&mut self, weight: f64, is_visible: bool) {
        self.visible += if is_visible { weight } else { 0.0 };
        self.all += weight;
    }
}

/// Most parts of the rays at a pair that are told apart; there are half as many, and more, from so many units on.
pub(crate) const MOST_PARTS: usize = 32;

/// Sums over equal parts of a sequence, one after the other: their spread tells how rays err.
#[derive(Clone, Copy, Debug)]
struct Parts {
    sums: [Kernels; MOST_PARTS],
    /// Units of a part: a power of two.
    each: usize,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            sums: [Kernels::default(); MOST_PARTS],
            each: 1,
        }
    }
}

impl Parts {
    /// The sums of the part that a unit of the sequence is in.
    fn of(&mut self, unit: usize) -> &mut Kernels {
        self.reach(unit);
        &mut self.sums[unit / self.each]
    }

    /// Merges parts in twos until a unit has one of [`MOST_PARTS`]: all units are parts of the sequence, those without
    /// a ray, too.
    fn reach(&mut self, unit: usize) {
        while unit / self.each >= MOST_PARTS {
            for k in 0..MOST_PARTS {
                self.sums[k] = match self.sums.get(2 * k..2 * k + 2) {
                    Some([a, b]) => Kernels {
                        visible: a.visible + b.visible,
                        all: a.all + b.all,
                    },
                    _ => Kernels::default(),
                };
            }
            self.each *= 2;
        }
    }

    /// What the parts of so many units say of the visible fraction, less what all say.
    fn deviations(&self, units: usize) -> Deviations {
        let parts = &self.sums[..(units / self.each).min(MOST_PARTS)];
        let (mut visible, mut all) = (0.0, 0.0);
        for part in parts {
            visible += part.visible;
            all += part.all;
        }
        let mut found = Deviations {
            of: [0.0; MOST_PARTS],
            count: if all > 0.0 { parts.len() } else { 0 },
            part: self.each as f64 / units.max(1) as f64,
        };
        // The error of Σ k V ÷ Σ k is the mean of k (V − fraction) over the mean of k.
        for (of, part) in found.of.iter_mut().zip(&parts[..found.count]) {
            *of = (part.visible - part.all * visible / all) * parts.len() as f64 / all;
        }
        found
    }
}

/// What parts of the rays say of a visible fraction, less what all of them say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Deviations {
    of: [f64; MOST_PARTS],
    count: usize,
    /// A part in parts of all rays.
    pub(crate) part: f64,
}

impl Deviations {
    /// Half of [`MOST_PARTS`] to all of them, from as many units on: batches of segments, or points that directions
    /// start at.
    pub(crate) fn of(&self) -> &[f64] {
        &self.of[..self.count]
    }
}

/// Rays of one sequence cast at a pair so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cast {
    /// Number of rays drawn.
    pub(crate) drawn: usize,
    pub(crate) sums: Kernels,
    parts: Parts,
    /// Σ w and Σ w² of rays.
    weight: f64,
    squared_weight: f64,
    walked: Walked,
    /// Work, in steps.
    pub(crate) steps: u64,
}

impl Cast {
    /// The visible fraction; `None` where no ray had weight.
    pub(crate) fn fraction(&self) -> Option<f64> {
        (self.sums.all > 0.0).then(|| self.sums.visible / self.sums.all)
    }

    /// What parts of the rays say of the visible fraction.
    pub(crate) fn deviations(&self, pair: &TrianglePair) -> Deviations {
        let unit = if pair.is_near { FROM_A_POINT * RAYS } else { RAYS };
        self.parts.deviations(self.drawn / unit)
    }

    /// Number of equal rays that the cast ones are worth, (Σ w)² / Σ w²: segments behind one of the triangles weigh
    /// nothing.
    pub(crate) fn worth(&self) -> f64 {
        if self.squared_weight > 0.0 {
            self.weight * self.weight / self.squared_weight
        } else {
            0.0
        }
    }

    /// Adds the work of segments down the tree beyond the usual one.
    fn add_walked(&mut self, walked: Walked) {
        self.steps += walked.more_steps() - self.walked.more_steps();
        self.walked = walked;
    }
}

impl Shaft {
    /// Forgets all pairs.
    pub(crate) fn clear(&mut self) {
        self.occluders.clear();
    }

    /// Lists the occluders between an emitting patch and a receiving one.
    pub(crate) fn pair(
        &mut self,
        obstacles: Obstacles<'_>,
        emitter: PatchTriangle<'_>,
        receiver: PatchTriangle<'_>,
    ) -> TrianglePair {
        let regions = obstacles.regions;
        let (i, emitter) = (emitter.id, emitter.corners);
        let (j, receiver) = (receiver.id, receiver.corners);
        // One origin for both directions of a pair, so that both have the same bits.
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
        let (of_emitter, of_receiver) = (Sphere::of(&emitter), Sphere::of(&receiver));
        let (r0, r1) = (of_emitter.radius(), of_receiver.radius());
        let (mut low, mut high) = (DVec3::ZERO, DVec3::ZERO);
        for p in points {
            low = low.min(p);
            high = high.max(p);
        }
        let slack = DVec3::splat(OUTSIDE * size);
        (self.sides.low, self.sides.high) = ((low - slack).to_array(), (high + slack).to_array());
        let planes = self.make_planes(&points, size, regions.tree.plane_tolerance);
        let start = self.occluders.len();
        let area = |t: &[DVec3; 3]| geometry::cross(t).length_squared();
        // Between equal areas, ids decide, whichever of the two emits.
        let receiver_is_smaller = match area(&receiver).total_cmp(&area(&emitter)) {
            std::cmp::Ordering::Less => true,
            std::cmp::Ordering::Equal => j < i,
            std::cmp::Ordering::Greater => false,
        };
        let mut pair = TrianglePair {
            emitter,
            receiver,
            origin,
            is_near: if receiver_is_smaller {
                geometry::distance(of_receiver.center, &emitter) < (NEAR * r1).max(r0)
            } else {
                geometry::distance(of_emitter.center, &receiver) < (NEAR * r0).max(r1)
            },
            receiver_is_smaller,
            occluders: start..start,
            near_plane: Vec::new(),
            near_regions: Vec::new(),
            coplanar: Vec::new(),
            is_occluded: false,
            is_crowded: false,
            own_regions: [i, j].map(|p| regions.of_patch[p as usize]),
            emitter_patch: i,
            receiver_patch: j,
            planes,
            steps: 0,
        };
        self.list_occluders(obstacles, size, &mut pair);
        let listed = self
            .reached
            .iter()
            .map(|&(_, kept)| u64::from(kept.count_ones()))
            .sum::<u64>();
        pair.steps = STEPS_A_SHAFT + STEPS_A_BLOCK * self.reached.len() as u64 + STEPS_LISTED * listed;
        steps::add(pair.steps);
        pair
    }

    /// Makes the sides; returns the planes of the two triangles.
    fn make_planes(&mut self, points: &[DVec3; 6], size: f64, tolerance: f64) -> [Plane; 2] {
        self.sides.count = 0;
        // Occluders rise above the emitter and lie in front of the receiver.
        let own = [([0, 1, 2], tolerance), ([3, 4, 5], -tolerance)].map(|([a, b, c], outside)| {
            let normal = geometry::cross(&[points[a], points[b], points[c]]).normalize_or_zero();
            let offset = normal.dot(points[a]);
            self.sides.push(normal, offset + outside);
            Plane { normal, offset }
        });
        let corners = points.map(|p| p.to_array());
        find_sides_by(InstructionSet::widest(), &corners, size, tolerance, &mut self.found);
        let found = &self.found;
        for l in (0..EDGE_SIDES).filter(|&l| found.is_side[l] != 0) {
            let normal = DVec3::new(found.normal[0][l], found.normal[1][l], found.normal[2][l]);
            self.sides.push(normal, found.least[l]);
        }
        self.sides.fill();
        own
    }

    fn list_occluders(&mut self, Obstacles { surfaces, regions }: Obstacles<'_>, size: f64, pair: &mut TrianglePair) {
        let (origin, own_regions, receiver) = (pair.origin, pair.own_regions, pair.receiver_patch);
        let [emitter_plane, receiver_plane] = pair.planes;
        let side = OUTSIDE * size;
        let tree = &regions.tree;
        let tolerance = tree.plane_tolerance;
        if !list_reached_by(
            InstructionSet::widest(),
            tree,
            &self.sides,
            origin,
            &mut self.pending,
            &mut self.reached,
        ) {
            pair.is_crowded = true;
            return;
        }
        let start = self.occluders.len();
        for &(index, kept) in &self.reached {
            let block = &tree.blocks[index as usize];
            for l in lanes(kept) {
                #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
                let slot = (index as usize * LANES + l) as u32;
                let region = block.negative[l];
                if region == UNUSED || own_regions.contains(&region) {
                    continue;
                }
                let triangle = block.triangle(l).map(|p| p - origin);
                let (least, most) = geometry::bounds(&triangle);
                let (least, most, [a, b, c]) = (least.to_array(), most.to_array(), triangle);
                if (0..3).any(|x| most[x] < self.sides.low[x] || least[x] > self.sides.high[x]) {
                    continue;
                }
                let height = |plane: &Plane| {
                    let h = triangle.map(|p| plane.height(p));
                    (h[0].min(h[1]).min(h[2]), h[0].max(h[1]).max(h[2]))
                };
                let (lowest, highest) = height(&receiver_plane);
                if highest <= tolerance {
                    // In the receiver's plane, or below it at one end.
                    if lowest >= -tolerance && overlap(&[a, b, c], &pair.receiver, receiver_plane.normal, side) {
                        for &piece in regions.pieces(region) {
                            pair.list_coplanar(&surfaces[piece as usize], regions, receiver, &receiver_plane, side);
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
                // Begin at the nearest corner: f32 has the fewest digits behind the point for what is far.
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
                if proves_occluded(regions.corners(region), pair, tolerance) {
                    pair.is_occluded = true;
                    self.occluders.truncate(start);
                    return;
                }
                // An occluder that rises slowly lies nearer to a small patch than its greatest height tells.
                let near = (NEAR_PLANE * size).powi(2) * normal.length_squared();
                let all_but_touches = |t: &[DVec3; 3]| t.iter().all(|&p| normal.dot(p - a).powi(2) <= near);
                if highest <= NEAR_PLANE * size
                    || height(&emitter_plane).1 <= NEAR_PLANE * size
                    || all_but_touches(&pair.emitter)
                    || all_but_touches(&pair.receiver)
                {
                    pair.near_plane.push([a, b, c]);
                    pair.near_regions.push(region);
                } else {
                    self.occluders.push(occluder);
                }
            }
        }
        // The largest first: they stop most rays, and the rest need not be tested then.
        self.occluders[start..].sort_unstable_by(|p, q| q.size.total_cmp(&p.size).then(p.slot.cmp(&q.slot)));
        pair.occluders = start..self.occluders.len();
    }

    /// The corners of the occluders, relative to the pair's origin, without coplanar patches.
    pub(crate) fn triangles<'a>(
        &'a self,
        regions: &'a CoplanarRegions,
        pair: &'a TrianglePair,
    ) -> impl Iterator<Item = [DVec3; 3]> + 'a {
        let listed = self.occluders[pair.occluders.clone()].iter().map(move |occluder| {
            let slot = occluder.slot as usize;
            regions.tree.blocks[slot / LANES]
                .triangle(slot % LANES)
                .map(|p| p - pair.origin)
        });
        listed.chain(pair.near_plane.iter().copied())
    }

    /// The regions of [`Self::triangles`], one for each.
    pub(crate) fn regions<'a>(
        &'a self,
        regions: &'a CoplanarRegions,
        pair: &'a TrianglePair,
    ) -> impl Iterator<Item = u32> + 'a {
        let listed = self.occluders[pair.occluders.clone()].iter().map(|occluder| {
            let slot = occluder.slot as usize;
            regions.tree.blocks[slot / LANES].negative[slot % LANES]
        });
        listed.chain(pair.near_regions.iter().copied())
    }

    /// Casts rays of a sequence until they are worth `wanted` (a multiple of 16), the same in both directions of a
    /// pair; returns what they are worth. Between near patches, [`Self::directions_with`], otherwise
    /// [`Self::cast_segments`].
    pub(crate) fn cast(
        &self,
        obstacles: Obstacles<'_>,
        pair: &TrianglePair,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
    ) -> usize {
        self.cast_asking(obstacles, pair, wanted, seed, cast, None)
    }

    /// [`Self::cast`], where `ask` answers the rays of a crowded shaft beyond the first 256: in rungs of 512 and more, and
    /// at least 256 at once.
    pub(crate) fn cast_asking(
        &self,
        obstacles: Obstacles<'_>,
        pair: &TrianglePair,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
        ask: Option<Asked<'_>>,
    ) -> usize {
        let before = cast.steps;
        let with = |cast: &mut Cast, segments: &mut Segments<'_>| {
            if pair.is_near {
                self.directions_with(pair, wanted, seed, cast, segments)
            } else {
                self.segments_with(pair, wanted, seed, cast, segments)
            }
        };
        let mut segments = pair.segments(obstacles, cast);
        if let Some(ask) = ask
            && pair.is_crowded
            && wanted >= 2 * LEAST_ASKED
            && segments.can_be_given(&pair.emitter.map(|p| p + pair.origin))
        {
            let mut listing = pair.segments(obstacles, cast).listing();
            with(&mut { *cast }, &mut listing);
            let ends = listing.listed();
            if ends.len() >= LEAST_ASKED {
                segments.give(ask(&segments.rays(InputPatch(pair.emitter_patch), &ends)));
            }
        }
        let worth = with(cast, &mut segments);
        steps::add(cast.steps - before);
        worth
    }

    /// Casts segments between evenly drawn points of the two until there are `wanted`; returns their number.
    pub(crate) fn cast_segments(
        &self,
        obstacles: Obstacles<'_>,
        pair: &TrianglePair,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
    ) -> usize {
        self.segments_with(pair, wanted, seed, cast, &mut pair.segments(obstacles, cast))
    }

    fn segments_with(
        &self,
        pair: &TrianglePair,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
        segments: &mut Segments<'_>,
    ) -> usize {
        let (small, large) = pair.by_size();
        let normal = geometry::cross;
        let span = |t: &[DVec3; 3]| [t[0], t[1] - t[0], t[2] - t[0]].map(|p| p.to_array());
        let sampler = SegmentSampler {
            from: span(small),
            to: span(large),
            normals: [normal(small), normal(large)].map(|p| p.to_array()),
            sequence: Sequence::new(seed),
        };
        let mut batch = RayBatch::new();
        let mut drawn = DrawnSegments::new();
        let mut stopped = [0; RAYS];
        let steps = self.steps_a_batch(pair);
        while cast.drawn < wanted {
            cast.steps += steps;
            draw_segments_by(InstructionSet::widest(), &sampler, cast.drawn, &mut drawn, &mut batch);
            batch.hit = [0; RAYS];
            if pair.is_crowded {
                for l in (0..RAYS).filter(|&l| batch.weight[l] > 0.0) {
                    let (small, large) = drawn.segment(l);
                    batch.hit[l] = u32::from(pair.is_stopped(segments, small, large));
                }
            } else {
                pair.mark_stopped(&drawn, &mut stopped);
                batch.stopped = stopped.map(|s| u32::from(s != 0));
                self.hit(pair, &mut batch);
            }
            let (mut seen, mut whole, mut squares) = (0.0, 0.0, 0.0);
            for l in 0..RAYS {
                let weight = f64::from(batch.weight[l]);
                whole += weight;
                squares += weight * weight;
                seen += if batch.hit[l] == 0 { weight } else { 0.0 };
            }
            cast.sums.visible += seen;
            cast.sums.all += whole;
            let part = cast.parts.of(cast.drawn / RAYS);
            part.visible += seen;
            part.all += whole;
            cast.weight += whole;
            cast.squared_weight += squares;
            cast.drawn += RAYS;
        }
        cast.add_walked(segments.walked);
        cast.drawn
    }
}

impl Shaft {
    /// Casts cosine-distributed directions from points of the smaller triangle (Malley's method), for near pairs: a few
    /// of many evenly drawn segments would carry most of the weight.
    ///
    /// Directions are drawn from bounds of the other triangle's image on the unit disc and weighted with the bounds'
    /// area; those that meet the triangle count. Stops when they are worth `wanted` equal ones, (Σ w)² / Σ w², or at
    /// [`MOST_DRAWN`] directions each; returns their worth.
    fn directions_with(
        &self,
        pair: &TrianglePair,
        wanted: usize,
        seed: u64,
        cast: &mut Cast,
        segments: &mut Segments<'_>,
    ) -> usize {
        let (small, large) = pair.by_size();
        let Some(sampler) = DirectionSampler::between(small, large, seed) else {
            return 0;
        };
        let mut batch = RayBatch::new();
        let mut drawn = DrawnSegments::new();
        let mut stopped = [0; RAYS];
        let mut bounds = ProjectedBounds::new();
        let mut filled = 0;
        // The round of each ray of the batch: those of one point.
        let mut rounds = [0; RAYS];
        loop {
            if cast.drawn.is_multiple_of(FROM_A_POINT * RAYS) {
                bound_projections_by(
                    InstructionSet::widest(),
                    &sampler,
                    cast.drawn / FROM_A_POINT,
                    &mut drawn,
                    &mut bounds,
                );
            }
            cast.steps += STEPS_A_DRAW;
            let mask = draw_directions_by(
                InstructionSet::widest(),
                &sampler,
                cast.drawn / RAYS % FROM_A_POINT,
                &bounds,
                &mut drawn,
            );
            let round = cast.drawn / (FROM_A_POINT * RAYS);
            cast.parts.reach(round);
            cast.drawn += RAYS;
            if mask != 0 && !pair.is_crowded {
                pair.mark_stopped(&drawn, &mut stopped);
            }
            for l in lanes(mask) {
                let (x, y) = drawn.segment(l);
                let weight = drawn.weight[l];
                if pair.is_crowded {
                    cast.steps += STEPS_A_SEGMENT;
                    let is_stopped = pair.is_stopped(segments, x, y);
                    cast.sums.add(weight, !is_stopped);
                    cast.parts.of(round).add(weight, !is_stopped);
                    cast.weight += weight;
                    cast.squared_weight += weight * weight;
                    continue;
                }
                batch.set(filled, x, y - x, stopped[l] != 0);
                #[allow(clippy::cast_possible_truncation, reason = "at most 4")]
                let single = weight as f32;
                batch.weight[filled] = single;
                rounds[filled] = round;
                cast.weight += weight;
                cast.squared_weight += weight * weight;
                filled += 1;
                if filled == RAYS {
                    cast.steps += self.steps_a_batch(pair);
                    self.count(pair, &mut batch, &rounds[..filled], cast);
                    filled = 0;
                }
            }
            let (sum, squares) = (cast.weight, cast.squared_weight);
            let is_round = cast.drawn.is_multiple_of(FROM_A_POINT * RAYS);
            if is_round && (cast.drawn >= MOST_DRAWN * wanted || sum * sum >= wanted as f64 * squares && squares > 0.0)
            {
                break;
            }
        }
        cast.add_walked(segments.walked);
        if filled > 0 {
            self.count(pair, &mut batch, &rounds[..filled], cast);
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a number of rays"
        )]
        let worth = cast.worth() as usize;
        worth
    }

    /// Traces the rays of a batch, of these rounds, and adds their weights.
    fn count(&self, pair: &TrianglePair, batch: &mut RayBatch, rounds: &[usize], cast: &mut Cast) {
        batch.hit = [0; RAYS];
        self.hit(pair, batch);
        for (l, &round) in rounds.iter().enumerate() {
            let (weight, is_visible) = (f64::from(batch.weight[l]), batch.hit[l] == 0);
            cast.sums.add(weight, is_visible);
            cast.parts.of(round).add(weight, is_visible);
        }
    }

    /// Steps of a number of rays, about.
    pub(crate) fn steps_of_rays(&self, pair: &TrianglePair, rays: usize) -> u64 {
        (rays / RAYS) as u64 * self.steps_a_batch(pair)
    }

    /// Steps of sixteen rays.
    fn steps_a_batch(&self, pair: &TrianglePair) -> u64 {
        if pair.is_crowded {
            RAYS as u64 * STEPS_A_SEGMENT
        } else {
            STEPS_A_BATCH + STEPS_A_TEST * (pair.occluders.len() + 4 * pair.near_plane.len()) as u64
        }
    }

    fn hit(&self, pair: &TrianglePair, batch: &mut RayBatch) {
        hits_by(InstructionSet::widest(), &self.occluders[pair.occluders.clone()], batch);
    }
}

/// Returns whether all nine segments between corners pass through a convex polygon in the scene's coordinates. Then every
/// segment between the two triangles does: they pass the polygon's plane within the convex hull of those nine points.
///
/// Returns whether a region hides all of the receiver from all of the emitter.
fn proves_occluded(polygon: &[DVec3], pair: &TrianglePair, tolerance: f64) -> bool {
    let (small, _) = pair.by_size();
    hides(polygon, pair.origin, &pair.emitter, &pair.receiver, small, tolerance)
}

/// Returns whether a convex polygon hides all of one body from all of another, each the hull of its corners: each segment
/// between their corners passes it. The two are relative to `origin`, `small` is the smaller one, or a triangle of it.
///
/// The polygon is closed: a wall hides what lies behind it from a patch that it stands on. Corners count as in its plane,
/// and points as on its edge, within the scene's tolerance, or a thousandth of the smaller patch where that is less.
pub(crate) fn hides<const N: usize>(
    polygon: &[DVec3],
    origin: DVec3,
    emitter: &[DVec3; 3],
    receiver: &[DVec3; N],
    small: &[DVec3; 3],
    tolerance: f64,
) -> bool {
    let first = polygon[0] - origin;
    let normal = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
    let length = normal.length();
    let tolerance = tolerance.min(PROVED_WITHIN * Sphere::of(small).radius());
    let slack = tolerance * length;
    let height = |p: DVec3| {
        let h = normal.dot(p - first);
        if h.abs() <= slack { 0.0 } else { h }
    };
    let (of_emitter, of_receiver) = (emitter.map(height), receiver.map(height));
    let is_above =
        |heights: &[f64], sign: f64| heights.iter().all(|h| h * sign >= 0.0) && heights.iter().any(|h| h * sign > 0.0);
    let is_between = |sign: f64| is_above(&of_emitter, sign) && is_above(&of_receiver, -sign);
    if !is_between(1.0) && !is_between(-1.0) {
        return false;
    }
    let is_inside = |at: DVec3| {
        let mut before = polygon[polygon.len() - 1] - origin;
        for corner in polygon {
            let corner = *corner - origin;
            let edge = corner - before;
            if edge.cross(at - before).dot(normal) < -slack * edge.length() {
                return false;
            }
            before = corner;
        }
        true
    };
    for (&p, hp) in emitter.iter().zip(of_emitter) {
        for (&q, hq) in receiver.iter().zip(of_receiver) {
            // Segments in the polygon's plane are the rim of those that pass it.
            if (hp != 0.0 || hq != 0.0) && !is_inside(geometry::crossing(p, q, hp, hq)) {
                return false;
            }
        }
    }
    true
}

/// Sixteen rays from points of one triangle to points of the other, at parameter 1.
#[repr(C, align(64))]
struct RayBatch {
    origin: [[f32; RAYS]; 3],
    direction: [[f32; RAYS]; 3],
    weight: [f32; RAYS],
    /// Not 0 if stopped by an occluder near a plane or a coplanar patch.
    stopped: [u32; RAYS],
    hit: [u32; RAYS],
}

/// Draws directions from points of one triangle to another.
struct DirectionSampler {
    /// The part of the smaller triangle in front of the other: a triangle, or two with a common first corner.
    corners: [[f64; 3]; 4],
    /// The first triangle's share of the area.
    share: f64,
    axes: [[f64; 3]; 3],
    other: [[f64; 3]; 3],
    /// The part of it above the horizon: three corners or four.
    above: [[f64; 3]; 4],
    above_count: usize,
    sides: [[f64; 3]; 3],
    across: [f64; 3],
    sequence: Sequence,
}

impl DirectionSampler {
    /// `None` if one of the two has no area or lies behind the other's plane.
    fn between(small: &[DVec3; 3], large: &[DVec3; 3], seed: u64) -> Option<Self> {
        let [tangent, bitangent, normal] = crate::frame::axes(*small, 0.0)?;
        let across = geometry::cross(large);
        let above = in_front(large, small[0], normal, 0.0)?;
        // Points behind the other see nothing of it.
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
            // Normals towards its inside.
            sides: [0, 1, 2].map(|e| across.cross(large[(e + 1) % 3] - large[e]).to_array()),
            across: across.to_array(),
            sequence: Sequence::new(seed),
        })
    }
}

/// Directions from each point, one in each quarter of the bounds: bounding costs more than drawing a direction.
const FROM_A_POINT: usize = 4;

/// Bounds of the other triangle's image on the unit disc (p, q) from sixteen points: a range of p, and the planes
/// through its edges, bounding q at each p.
#[repr(C, align(64))]
struct ProjectedBounds {
    low: [f64; RAYS],
    extent: [f64; RAYS],
    /// Normals in the frame, towards the inside.
    edges: [[[f64; RAYS]; 3]; 4],
    /// Places of directions in their quarters of the image.
    within: [[f64; RAYS]; 2],
}

impl ProjectedBounds {
    const fn new() -> Self {
        Self {
            low: [0.0; RAYS],
            extent: [0.0; RAYS],
            edges: [[[0.0; RAYS]; 3]; 4],
            within: [[0.0; RAYS]; 2],
        }
    }
}

/// Draws segments between evenly distributed points of two triangles.
struct SegmentSampler {
    /// A corner and two edges of the smaller triangle, then of the other.
    from: [[f64; 3]; 3],
    to: [[f64; 3]; 3],
    normals: [[f64; 3]; 2],
    sequence: Sequence,
}

/// Sixteen segments.
#[repr(C, align(64))]
struct DrawnSegments {
    start: [[f64; RAYS]; 3],
    end: [[f64; RAYS]; 3],
    weight: [f64; RAYS],
}

impl DrawnSegments {
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
fn draw_segments(sampler: &SegmentSampler, at: usize, drawn: &mut DrawnSegments, batch: &mut RayBatch) {
    let u = sampler.sequence.points(at);
    for l in 0..RAYS {
        let ((s, t), (p, q)) = (fold(u[0][l], u[1][l]), fold(u[2][l], u[3][l]));
        let (mut x, mut d) = ([0.0; 3], [0.0; 3]);
        for a in 0..3 {
            x[a] = sampler.from[0][a] + sampler.from[1][a] * s + sampler.from[2][a] * t;
            let y = sampler.to[0][a] + sampler.to[1][a] * p + sampler.to[2][a] * q;
            d[a] = y - x[a];
            drawn.start[a][l] = x[a];
            drawn.end[a][l] = y;
        }
        let squared = dot(d, d);
        let (leaving, arriving) = (dot(sampler.normals[0], d), -dot(sampler.normals[1], d));
        // Only segments in front of both have weight.
        let faces = (leaving > 0.0) & (arriving > 0.0) & (squared > 0.0);
        let kernel = leaving * arriving / (squared * squared);
        #[allow(clippy::cast_possible_truncation, reason = "weights relative to the pair")]
        let weight = if faces & (kernel < f64::from(f32::MAX)) {
            kernel as f32
        } else {
            0.0
        };
        batch.weight[l] = weight;
        #[allow(clippy::cast_possible_truncation, reason = "rays relative to the pair")]
        for a in 0..3 {
            batch.origin[a][l] = x[a] as f32;
            batch.direction[a][l] = d[a] as f32;
        }
    }
}

/// Draws sixteen points of one triangle and bounds the image of the other on the unit disc of each.
#[inline(always)]
fn bound_projections(sampler: &DirectionSampler, at: usize, drawn: &mut DrawnSegments, bounds: &mut ProjectedBounds) {
    if sampler.above_count == 3 {
        bound_projections_of::<3>(sampler, at, drawn, bounds);
    } else {
        bound_projections_of::<4>(sampler, at, drawn, bounds);
    }
}

/// [`bound_projections`] for an image of `CORNERS` corners: the points `at..at + 16` of the sequence.
#[inline(always)]
fn bound_projections_of<const CORNERS: usize>(
    sampler: &DirectionSampler,
    at: usize,
    drawn: &mut DrawnSegments,
    bounds: &mut ProjectedBounds,
) {
    let u = sampler.sequence.points(at);
    (bounds.within[0], bounds.within[1]) = (u[2], u[3]);
    let [first, second, third] = [1, 2, 3].map(|k| minus(sampler.corners[k], sampler.corners[0]));
    let scales = [sampler.share, 1.0 - sampler.share].map(|share| 1.0 / most(share, f64::MIN_POSITIVE));
    // The other triangle from each point.
    let mut towards = [[[0.0; RAYS]; 3]; CORNERS];
    for l in 0..RAYS {
        let is_first = u[0][l] < sampler.share;
        let within = if is_first {
            u[0][l] * scales[0]
        } else {
            (u[0][l] - sampler.share) * scales[1]
        };
        let (s, t) = fold(within, u[1][l]);
        let (mut e, mut f) = (first, second);
        for a in 0..3 {
            e[a] = if is_first { first[a] } else { second[a] };
            f[a] = if is_first { second[a] } else { third[a] };
        }
        let x = [
            sampler.corners[0][0] + e[0] * s + f[0] * t,
            sampler.corners[0][1] + e[1] * s + f[1] * t,
            sampler.corners[0][2] + e[2] * s + f[2] * t,
        ];
        for a in 0..3 {
            drawn.start[a][l] = x[a];
        }
        for k in 0..CORNERS {
            let v = minus(sampler.above[k], x);
            for a in 0..3 {
                towards[k][a][l] = dot(sampler.axes[a], v);
            }
        }
    }
    // Range of the image along p: that of its corners, and of its edges' images, parts of ellipses with extremes that
    // may lie between their ends.
    let mut low = [1.0f64; RAYS];
    let mut high = [-1.0f64; RAYS];
    for k in 0..CORNERS {
        let (v, w) = (&towards[k], &towards[(k + 1) % CORNERS]);
        let normal = &mut bounds.edges[k];
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
        bounds.low[l] = from;
        bounds.extent[l] = to - from;
    }
}

/// Draws a direction in a quarter of the bounds from each point; returns the mask of hits on the other triangle's
/// front.
///
/// At a given p, directions lie on the half circle q² + up² = 1 − p². An edge's plane cuts it at the roots of a
/// quadratic equation in q; the half circle's ends, by their side of the plane, tell the root on either side of q.
#[inline(always)]
fn draw_directions(
    sampler: &DirectionSampler,
    quarter: usize,
    bounds: &ProjectedBounds,
    drawn: &mut DrawnSegments,
) -> u16 {
    let corner = [quarter % 2, quarter / 2].map(|q| q as f64);
    let (mut ps, mut ends) = ([0.0f64; RAYS], [0.0f64; RAYS]);
    for l in 0..RAYS {
        ps[l] = bounds.low[l] + bounds.extent[l] * (0.5 * (bounds.within[0][l] + corner[0]));
        ends[l] = most(1.0 - ps[l] * ps[l], 0.0).sqrt();
    }
    let (mut lows, mut highs) = (ends.map(|end| -end), ends);
    for edge in &bounds.edges[..sampler.above_count] {
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
        let q = low + extent * (0.5 * (bounds.within[1][l] + corner[1]));
        let weight = bounds.extent[l] * extent;
        let rest = 1.0 - (p * p + q * q);
        let up = (if rest > 0.0 { rest } else { 0.0 }).sqrt();
        let [tangent, bitangent, normal] = sampler.axes;
        let d = [
            tangent[0] * p + bitangent[0] * q + normal[0] * up,
            tangent[1] * p + bitangent[1] * q + normal[1] * up,
            tangent[2] * p + bitangent[2] * q + normal[2] * up,
        ];
        let x = [drawn.start[0][l], drawn.start[1][l], drawn.start[2][l]];
        let slope = dot(sampler.across, d);
        let length = dot(sampler.across, minus(sampler.other[0], x)) / slope;
        let y = [x[0] + d[0] * length, x[1] + d[1] * length, x[2] + d[2] * length];
        let within = |k: usize| dot(sampler.sides[k], minus(y, sampler.other[k])) >= 0.0;
        let meets = (rest > 0.0) & (slope < 0.0) & (length > 0.0) & (weight > 0.0) & within(0) & within(1) & within(2);
        met[l] = u64::from(meets);
        drawn.weight[l] = weight;
        for a in 0..3 {
            drawn.end[a][l] = y[a];
        }
    }
    mask(&met)
}

/// Rounding of the bounds of an image on the unit disc.
const MARGIN: f64 = 1e-9;

impl RayBatch {
    fn new() -> Self {
        Self {
            origin: [[0.0; RAYS]; 3],
            direction: [[0.0; RAYS]; 3],
            weight: [0.0; RAYS],
            stopped: [0; RAYS],
            hit: [0; RAYS],
        }
    }

    /// Sets the ray of a lane.
    fn set(&mut self, lane: usize, from: DVec3, direction: DVec3, is_stopped: bool) {
        #[allow(clippy::cast_possible_truncation, reason = "rays relative to the pair")]
        for a in 0..3 {
            self.origin[a][lane] = from[a] as f32;
            self.direction[a][lane] = direction[a] as f32;
        }
        self.stopped[lane] = u32::from(is_stopped);
    }
}

/// Finds the planes through an edge and an opposite corner that bound the hull of two triangles of extent `size`.
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
        let (above, below) = (
            (lowest >= -flat) & (highest > flat),
            (highest <= flat) & (lowest < -flat),
        );
        out.is_side[l] = u64::from(is_plane & (above | below));
        let sign = if above { 1.0 } else { -1.0 };
        for x in 0..3 {
            out.normal[x][l] = n[x] * sign;
        }
        out.least[l] = side + d * sign;
    }
}

/// Lists the blocks reaching into a shaft, with the mask of triangles that may. Returns false, with the list
/// unfinished, at more than [`MOST_LISTED`] triangles.
#[inline(always)]
fn list_reached(
    tree: &Tree,
    sides: &Sides,
    origin: DVec3,
    pending: &mut Vec<u32>,
    reached: &mut Vec<(u32, u16)>,
) -> bool {
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

/// Marks the segments cut by a triangle of `near_plane`, and those ending on one of `coplanar`.
#[inline(always)]
fn mark_stopped(
    near_plane: &[[DVec3; 3]],
    coplanar: &[[DVec3; 3]],
    from: &[[f64; RAYS]; 3],
    to: &[[f64; RAYS]; 3],
    out: &mut [u64; RAYS],
) {
    // For each side, the normal towards the inside, and a point on it.
    let sides =
        |t: &[DVec3; 3], n: DVec3| [0, 1, 2].map(|k| (n.cross(t[(k + 1) % 3] - t[k]).to_array(), t[k].to_array()));
    let normal = geometry::cross;
    for t in coplanar {
        let sides = sides(t, normal(t));
        for l in 0..RAYS {
            let y = [to[0][l], to[1][l], to[2][l]];
            let within = |(inwards, s): ([f64; 3], [f64; 3])| dot(inwards, minus(y, s)) >= 0.0;
            out[l] |= u64::from(within(sides[0]) & within(sides[1]) & within(sides[2]));
        }
    }
    for t in near_plane {
        let n = normal(t);
        let sides = sides(t, n);
        let (n, first, hair) = (n.to_array(), t[0].to_array(), HAIR * n.length_squared());
        for l in 0..RAYS {
            let (x, y) = ([from[0][l], from[1][l], from[2][l]], [to[0][l], to[1][l], to[2][l]]);
            let (hx, hy) = (dot(n, minus(x, first)), dot(n, minus(y, first)));
            let (d, share) = (minus(y, x), hx / (hx - hy));
            let p = [x[0] + d[0] * share, x[1] + d[1] * share, x[2] + d[2] * share];
            let within = |(inwards, s): ([f64; 3], [f64; 3])| dot(inwards, minus(p, s)) >= -hair;
            out[l] |= u64::from((hx * hy < 0.0) & within(sides[0]) & within(sides[1]) & within(sides[2]));
        }
    }
}

/// Mask of 16 triangles that reach inside all planes.
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

/// Marks the rays of a batch stopped by an occluder strictly between their ends (Möller & Trumbore 1997), or already
/// marked as stopped.
#[inline(always)]
fn hits(occluders: &[Occluder], batch: &mut RayBatch) {
    let mut hit = batch.hit;
    for l in 0..RAYS {
        hit[l] |= batch.stopped[l];
    }
    for (count, t) in occluders.iter().enumerate() {
        let ([e, f], n) = (t.edges, t.normal);
        for l in 0..RAYS {
            let d = [batch.direction[0][l], batch.direction[1][l], batch.direction[2][l]];
            let s = [
                batch.origin[0][l] - t.corner[0],
                batch.origin[1][l] - t.corner[1],
                batch.origin[2][l] - t.corner[2],
            ];
            // All in terms of the determinant, made positive: no division.
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
            let hair = SINGLE_HAIR * size;
            hit[l] |= u32::from(is_between & (u >= -hair) & (v >= -hair) & (u + v <= size + hair));
        }
        // With every ray stopped, the rest change nothing.
        if count % 4 == 3 && hit.iter().all(|&h| h != 0) {
            break;
        }
    }
    batch.hit = hit;
}

dispatch! {
    fn list_reached_by = list_reached(
        tree: &Tree,
        sides: &Sides,
        origin: DVec3,
        pending: &mut Vec<u32>,
        out: &mut Vec<(u32, u16)>,
    ) -> bool
}
dispatch! {
    fn find_sides_by = find_sides(points: &[[f64; 3]; 6], size: f64, tolerance: f64, out: &mut EdgeSides)
}
dispatch! {
    fn draw_segments_by = draw_segments(
        sampler: &SegmentSampler,
        at: usize,
        drawn: &mut DrawnSegments,
        batch: &mut RayBatch,
    )
}
dispatch! {
    fn mark_stopped_by = mark_stopped(
        near_plane: &[[DVec3; 3]],
        coplanar: &[[DVec3; 3]],
        from: &[[f64; RAYS]; 3],
        to: &[[f64; RAYS]; 3],
        out: &mut [u64; RAYS],
    )
}
dispatch! {
    fn bound_projections_by = bound_projections(
        sampler: &DirectionSampler,
        at: usize,
        drawn: &mut DrawnSegments,
        out: &mut ProjectedBounds,
    )
}
dispatch! {
    fn draw_directions_by = draw_directions(
        sampler: &DirectionSampler,
        quarter: usize,
        bounds: &ProjectedBounds,
        drawn: &mut DrawnSegments,
    ) -> u16
}
dispatch! {
    fn hits_by = hits(occluders: &[Occluder], batch: &mut RayBatch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::spread::Spread;
    use crate::backend::Geometry;
    use crate::face::Items;
    use crate::geometry::area;
    use crate::model::tests::one_sided;
    use crate::sampling::splitmix;
    use crate::visibility::segments::tests::through_shared_edges;
    use crate::{HierarchyOptions, Model};
    use hemicube_scene::{Patches, Subdivision};

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
        one_sided(&triangles)
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

    fn obstacles<'a>(model: &'a Model, regions: &'a CoplanarRegions) -> Obstacles<'a> {
        Obstacles::new(model, regions)
    }

    fn fraction(model: &Model, i: u32, j: u32, rays: usize) -> (usize, f64) {
        let corners = |p: u32| model.normalised_corners(p);
        let mut shaft = Shaft::default();
        let regions = CoplanarRegions::of(model);
        let obstacles = obstacles(model, &regions);
        let pair = shaft.pair(
            obstacles,
            PatchTriangle::new(i, &corners(i)),
            PatchTriangle::new(j, &corners(j)),
        );
        if pair.is_occluded {
            return (1, 0.0);
        }
        let mut cast = Cast::default();
        shaft.cast_segments(obstacles, &pair, rays, 1, &mut cast);
        let count = pair.occluders.len() + pair.near_plane.len() + pair.coplanar.len();
        (count, cast.sums.visible / cast.sums.all)
    }

    #[test]
    fn parts_of_rays_keep_their_sums_and_deviate_by_what_they_say() {
        let mut parts = Parts::default();
        for unit in 0..200 {
            // The last quarter sees nothing.
            parts.of(unit).add(2.0, unit < 150);
        }
        let sum: f64 = parts.sums.iter().map(|part| part.all).sum();
        assert_eq!((sum, parts.each), (400.0, 8));
        let found = parts.deviations(200);
        assert_eq!((found.of().len(), found.part), (25, 0.04));
        assert!(
            (found.of()[0] - 0.25).abs() < 1e-12 && (found.of()[24] + 0.75).abs() < 1e-12,
            "{found:?}"
        );
        assert!(found.of().iter().sum::<f64>().abs() < 1e-12);
        assert!(
            Parts::default().deviations(64).of().is_empty(),
            "without weight, nothing is told"
        );
    }

    /// Between two plates, a wall with a hole in it, and hundreds of splinters that 1,024 rays do not resolve.
    #[test]
    fn parts_of_rays_tell_splinters_from_a_wall() {
        let p = DVec3::new;
        let mut state = 3;
        let mut draw = || splitmix::unit(splitmix::next(&mut state));
        let mut splinter = || {
            let at = p(draw(), draw(), 0.2 + 0.4 * draw());
            let side = p(draw() - 0.5, draw() - 0.5, 0.0).normalize() * 0.012;
            [at, at + side, at + p(draw() - 0.5, draw() - 0.5, 0.5) * 0.5]
        };
        let splinters: Vec<_> = (0..240).map(|_| splinter()).collect();
        let wall = [[p(-1., 0.4, 0.5), p(2., 0.4, 0.5), p(0.5, 3., 0.5)]];
        let over_stated = |more: &[[DVec3; 3]]| -> [f64; 2] {
            let model = scene(more);
            let regions = CoplanarRegions::of(&model);
            let obstacles = obstacles(&model, &regions);
            let [i, j] = [0, 2].map(|patch| model.normalised_corners(patch));
            let mut shaft = Shaft::default();
            let pair = shaft.pair(obstacles, PatchTriangle::new(0, &i), PatchTriangle::new(2, &j));
            let fraction = |rays: usize, seed: u64| {
                let mut cast = Cast::default();
                let rays = shaft.cast(obstacles, &pair, rays, seed, &mut cast) as f64;
                let fraction = cast.fraction().expect("they face each other");
                (fraction, cast.deviations(&pair), rays)
            };
            let (truth, ..) = fraction(1 << 17, 1);
            let mut sums = [0.0; 2];
            for seed in 2..34 {
                let (found, parts, rays) = fraction(1024, seed);
                let ray = found * (1.0 - found);
                let spread = Spread::of(parts.of(), parts.part * rays, ray, 1.0);
                let law = Spread::resolved(ray, 1.0);
                for (sum, spread) in sums.iter_mut().zip([spread, law]) {
                    *sum += (found - truth).powi(2) / spread.squared_error(rays) / 32.0;
                }
            }
            sums.map(f64::sqrt)
        };
        let [by_parts, by_law] = over_stated(&splinters);
        assert!(
            by_law > 2.0 && (0.5..1.6).contains(&by_parts),
            "{by_parts}, by the law {by_law}"
        );
        let [by_parts, by_law] = over_stated(&wall);
        assert!(
            by_law < 1.2 && (0.5..1.2).contains(&by_parts),
            "{by_parts}, by the law {by_law}"
        );
    }

    /// By rays in f32 against a list, and by the test in f64 of what is near a plane.
    #[test]
    fn a_ray_through_an_edge_that_two_triangles_share_is_stopped() {
        #[allow(clippy::cast_possible_truncation, reason = "rays are in f32")]
        let single = |p: DVec3| p.to_array().map(|x| x as f32);
        let all: Vec<_> = through_shared_edges().collect();
        for (triangles, [start, end]) in &all {
            let mut batch = RayBatch::new();
            batch.set(0, *start, *end - *start, false);
            let occluder = |[a, b, c]: [DVec3; 3]| Occluder {
                corner: single(a),
                edges: [single(b - a), single(c - a)],
                normal: single((b - a).cross(c - a)),
                slot: 0,
                size: 1.0,
            };
            hits(&triangles.map(occluder), &mut batch);
            assert!(batch.hit[0] != 0, "{triangles:?} from {start} to {end}");
            let lanes = |p: DVec3| p.to_array().map(|x| [x; RAYS]);
            let mut stopped = [0; RAYS];
            mark_stopped(triangles, &[], &lanes(*start), &lanes(*end), &mut stopped);
            assert_eq!(stopped, [1; RAYS], "{triangles:?} from {start} to {end}");
        }
    }

    /// Walls that meet at a corner of a room do not hide each other, whichever wall stands on both.
    #[test]
    fn a_wall_hides_what_is_behind_it_and_no_neighbour() {
        let p = DVec3::new;
        // Two squares face each other 1 apart; a wall between them, larger, as large, and smaller by a hair.
        for (beyond, is_hidden) in [(0.5, true), (0.0, true), (-1e-6, false)] {
            let (low, high) = (-beyond, 1.0 + beyond);
            let wall = [
                p(low, low, 0.5),
                p(high, low, 0.5),
                p(high, high, 0.5),
                p(low, high, 0.5),
            ];
            let model = scene(&[[wall[0], wall[1], wall[2]], [wall[0], wall[2], wall[3]]]);
            assert_eq!(proved(&model, 0, 2), is_hidden.then_some(0.0), "{beyond}");
        }
        // A wall in a plane that cuts the first of two neighbours so that its corners' heights add up to 0.
        let cut = [p(1.0, -1.0, 0.0), p(1.0, 0.5, 0.0), p(1.5, 0.5, 0.0)];
        let beside = [p(1.0, 0.5, 0.0), p(0.0, 0.5, 1.5), p(1.0, 0.5, 1.5)];
        let front = [p(0.0, 0.0, 0.0), p(1.0, 0.0, 0.0), p(1.0, 0.0, 3.0)];
        let model = one_sided(&[
            cut,
            beside,
            front,
            [p(0.0, 0.0, 0.0), p(1.0, 0.0, 3.0), p(0.0, 0.0, 3.0)],
        ]);
        assert_ne!(proved(&model, 0, 1), Some(0.0));
        // A wall that stands on the first square, as high as the second: a floor and what lies beyond, hidden from each
        // other; the same floor and the wall, not.
        let wall = [p(0.5, 0.0, 0.0), p(0.5, 1.0, 0.0), p(0.5, 1.0, 1.0), p(0.5, 0.0, 1.0)];
        let floor = [p(0.0, 0.0, 0.0), p(0.5, 0.0, 0.0), p(0.5, 1.0, 0.0)];
        let beyond = [p(1.0, 0.0, 0.0), p(1.0, 0.0, 1.0), p(1.0, 1.0, 1.0)];
        let model = one_sided(&[floor, beyond, [wall[0], wall[2], wall[1]], [wall[0], wall[3], wall[2]]]);
        assert_eq!(proved(&model, 0, 1), Some(0.0));
        assert_eq!(proved(&model, 0, 2), Some(1.0));
    }

    fn proved(model: &Model, i: u32, j: u32) -> Option<f64> {
        let mut shaft = Shaft::default();
        let regions = CoplanarRegions::of(model);
        let (first, second) = (model.normalised_corners(i), model.normalised_corners(j));
        let pair = shaft.pair(
            obstacles(model, &regions),
            PatchTriangle::new(i, &first),
            PatchTriangle::new(j, &second),
        );
        pair.proved_fraction()
    }

    #[test]
    #[allow(clippy::print_stderr, reason = "docs/dev/accuracy.md has these figures")]
    fn walls_hide_what_their_pieces_hide() {
        let model = city(5, 5);
        let (regions, pieces) = (CoplanarRegions::of(&model), CoplanarRegions::pieces_of(&model));
        let count = u64::try_from(model.patches().len()).expect("a number");
        let (mut state, mut partly, mut fewer, mut hidden) = (1, 0, [0, 0], [0, 0]);
        for _ in 0..20_000 {
            let ids = [0, 1].map(|_| u32::try_from(splitmix::next(&mut state) % count).expect("a patch"));
            let [emitter, receiver] = ids.map(|patch| model.normalised_corners(patch));
            let fractions = [&*regions, &pieces].map(|regions| {
                let mut shaft = Shaft::default();
                let obstacles = obstacles(&model, regions);
                let pair = shaft.pair(
                    obstacles,
                    PatchTriangle::new(ids[0], &emitter),
                    PatchTriangle::new(ids[1], &receiver),
                );
                let at = usize::from(!std::ptr::eq(regions, &pieces));
                hidden[at] += usize::from(pair.is_occluded);
                fewer[at] += pair.occluders.len();
                let mut cast = Cast::default();
                shaft.cast_segments(obstacles, &pair, 256, 1, &mut cast);
                if pair.is_occluded { Some(0.0) } else { cast.fraction() }
            });
            let [Some(by_walls), Some(by_pieces)] = fractions else {
                continue;
            };
            assert!((by_walls - by_pieces).abs() < 0.02, "{ids:?}: {by_walls} {by_pieces}");
            partly += usize::from(by_walls > 0.0 && by_walls < 1.0);
        }
        assert!(partly > 200, "{partly} pairs partly visible");
        assert!(hidden[1] > hidden[0], "{hidden:?} proved hidden by pieces and regions");
        assert!(fewer[1] < fewer[0], "{fewer:?} occluders of pieces and regions");
        eprintln!(
            "{count} patches, 20,000 pairs: {fewer:?} pieces and regions in between, {hidden:?} pairs proved hidden by \
             them"
        );
    }

    /// Rays down the tree of regions stop with rays against the shaft's list.
    #[test]
    fn a_tree_stops_the_rays_that_a_list_stops() {
        let model = city(5, 2);
        let regions = CoplanarRegions::of(&model);
        let obstacles = obstacles(&model, &regions);
        let count = u64::try_from(model.patches().len()).expect("a number");
        let (mut state, mut partly, mut near) = (3, 0, 0);
        for _ in 0..20_000 {
            let ids = [0, 1].map(|_| u32::try_from(splitmix::next(&mut state) % count).expect("a patch"));
            let [emitter, receiver] = ids.map(|patch| model.normalised_corners(patch));
            let mut shaft = Shaft::default();
            let mut pair = shaft.pair(
                obstacles,
                PatchTriangle::new(ids[0], &emitter),
                PatchTriangle::new(ids[1], &receiver),
            );
            if pair.is_occluded || pair.is_unoccluded() || pair.is_crowded {
                continue;
            }
            let fractions = [false, true].map(|crowded| {
                pair.is_crowded = crowded;
                let mut cast = Cast::default();
                shaft.cast(obstacles, &pair, 256, 1, &mut cast);
                cast.fraction()
            });
            let [Some(by_list), Some(by_tree)] = fractions else {
                continue;
            };
            // Rays of a list are in f32: one may pass an edge on the other side.
            assert!(
                (by_list - by_tree).abs() < 0.02,
                "{ids:?}: {by_list} by list, {by_tree} by tree"
            );
            partly += usize::from(by_list > 0.0 && by_list < 1.0);
            near += usize::from(pair.is_near);
        }
        assert!(partly > 200 && near > 20, "{partly} pairs partly visible, {near} near");
    }

    /// What a ray certainly meets, in f64, by surfaces alone.
    fn met(geometry: &Geometry, rays: &Rays<'_>, [start, end]: [DVec3; 2]) -> u32 {
        let tie = Rays::TIE * geometry.plane_tolerance / (end - start).length();
        let (mut first, mut others) = ((f64::INFINITY, Items::ESCAPED), f64::INFINITY);
        for surface in &geometry.surfaces {
            let height = |p: DVec3| rays.normal.dot(p) - rays.offset;
            let is_own = surface.front == rays.emitter || surface.back == Some(rays.emitter);
            let [a, b, c] = surface.corners;
            if is_own || height(a).max(height(b)).max(height(c)) <= geometry.plane_tolerance {
                continue;
            }
            let normal = geometry::cross(&surface.corners);
            let [at_start, at_end] = [start, end].map(|p| normal.dot(p - a));
            let (place, along) = (at_start / (at_start - at_end), end - start);
            let sides = [(a, b), (b, c), (c, a)].map(|(p, q)| (q - start).cross(p - start).dot(along));
            let edge = 1e-6 * (sides[0] + sides[1] + sides[2]).abs();
            let is_inside = |edge: f64| sides.iter().all(|&s| s >= edge) || sides.iter().all(|&s| s <= -edge);
            if !is_inside(-edge) || !(-1e-6..=1.0 + 1e-6).contains(&place) {
                continue;
            }
            if is_inside(edge) && (1e-6..1.0 - 1e-6).contains(&place) && place < first.0 {
                others = others.min(first.0);
                let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
                first = (place, if at_start > 0.0 { surface.front.0 } else { back });
            } else {
                others = others.min(place);
            }
        }
        if others <= first.0 + tie {
            Rays::DOUBTFUL
        } else {
            first.1
        }
    }

    /// Who answers segments changes neither sums nor steps.
    #[test]
    fn a_device_stops_the_segments_that_the_tree_stops() {
        let model = city(5, 2);
        let regions = CoplanarRegions::of(&model);
        let obstacles = obstacles(&model, &regions);
        let count = u64::try_from(model.patches().len()).expect("a number");
        let (mut state, mut partly, mut near) = (3, 0, 0);
        let mut answers = [0; 3];
        while partly < 60 || near < 4 {
            let ids = [0, 1].map(|_| u32::try_from(splitmix::next(&mut state) % count).expect("a patch"));
            let [emitter, receiver] = ids.map(|patch| model.normalised_corners(patch));
            let mut shaft = Shaft::default();
            let mut pair = shaft.pair(
                obstacles,
                PatchTriangle::new(ids[0], &emitter),
                PatchTriangle::new(ids[1], &receiver),
            );
            if pair.is_occluded || pair.is_unoccluded() {
                continue;
            }
            pair.is_crowded = true;
            let [mut without, mut with] = [Cast::default(); 2];
            let mut ask = |rays: &Rays<'_>| {
                assert!(rays.emitter.0 == ids[0] && rays.ends.len() >= LEAST_ASKED);
                let met: Vec<u32> = rays
                    .ends
                    .iter()
                    .map(|&ends| met(model.geometry(), rays, ends))
                    .collect();
                for answer in &met {
                    answers[if *answer == ids[1] {
                        0
                    } else {
                        1 + usize::from(*answer == Rays::DOUBTFUL)
                    }] += 1;
                }
                met
            };
            for rays in [RAYS, 256, 1024] {
                shaft.cast(obstacles, &pair, rays, 1, &mut without);
                shaft.cast_asking(obstacles, &pair, rays, 1, &mut with, Some(&mut ask));
            }
            assert_eq!(
                format!("{with:?}"),
                format!("{without:?}"),
                "{ids:?}: the numbers print to the bit"
            );
            let is_partly = with.fraction().is_some_and(|fraction| fraction > 0.0 && fraction < 1.0);
            partly += usize::from(is_partly);
            near += usize::from(is_partly && pair.is_near);
        }
        let [free, stopped, doubtful] = answers;
        assert!(free > 10_000 && stopped > 10_000, "{answers:?}");
        assert!(doubtful * 100 < free + stopped, "{answers:?}");
    }

    /// A device knows pieces of walls, and one may not rise from the emitter where its wall does.
    #[test]
    fn no_device_is_asked_where_a_wall_hardly_rises_from_the_emitter() {
        let p = DVec3::new;
        let asked = |more: &[[DVec3; 3]]| {
            let model = scene(more);
            let regions = CoplanarRegions::of(&model);
            let obstacles = obstacles(&model, &regions);
            let [i, j] = [0, 2].map(|patch| model.normalised_corners(patch));
            let mut shaft = Shaft::default();
            let mut pair = shaft.pair(obstacles, PatchTriangle::new(0, &i), PatchTriangle::new(2, &j));
            pair.is_crowded = true;
            let mut asked = 0;
            let mut ask = |rays: &Rays<'_>| {
                asked += rays.ends.len();
                vec![Rays::DOUBTFUL; rays.ends.len()]
            };
            shaft.cast_asking(obstacles, &pair, 1024, 1, &mut Cast::default(), Some(&mut ask));
            asked
        };
        let rising = |height: f64| [[p(0.5, 0.1, 0.0), p(0.9, 0.1, 0.0), p(0.9, 0.4, height)]];
        assert!(asked(&[]) >= LEAST_ASKED);
        assert_eq!(asked(&rising(1e-5)), 0);
        assert!(
            asked(&rising(0.1)) >= LEAST_ASKED,
            "steep walls are told from the emitter"
        );
    }

    /// Sixteen thousand triangles in one place: a segment to the one that is seen passes the blocks of all, and its
    /// steps say so. Found in a room with twenty thousand, a row of which did not end.
    #[test]
    fn segments_to_thousands_of_triangles_in_one_place_cost_what_they_meet() {
        let p = DVec3::new;
        for height in [0.5, 3.0] {
            let mut triangles = vec![[p(-0.3, -0.3, 0.0), p(0.3, -0.3, 0.0), p(0.0, 0.3, 0.0)]];
            triangles.extend((0..16_000).map(|k| {
                let corner = |e: f64| {
                    let (sin, cos) = (0.37 * f64::from(k) - e * std::f64::consts::TAU / 3.0).sin_cos();
                    p(cos, sin, height)
                };
                [corner(0.0), corner(1.0), corner(2.0)]
            }));
            let model = one_sided(&triangles);
            let regions = CoplanarRegions::of(&model);
            let (obstacles, corners) = (obstacles(&model, &regions), [0, 1].map(|k| model.normalised_corners(k)));
            let mut shaft = Shaft::default();
            let pair = shaft.pair(
                obstacles,
                PatchTriangle::new(0, &corners[0]),
                PatchTriangle::new(1, &corners[1]),
            );
            assert!(pair.is_crowded);
            let mut cast = Cast::default();
            shaft.cast(obstacles, &pair, 64, 1, &mut cast);
            assert_eq!(
                cast.fraction(),
                Some(1.0),
                "of triangles in one plane, the first is seen"
            );
            let blocks = regions.tree.blocks.len() as u64;
            assert!(blocks >= 1_000, "{blocks} blocks");
            // A quarter of the blocks at least lies round any one point.
            let least = 64 * 100 * (blocks / 4 - 64);
            assert!(cast.steps >= least, "{height}: {} steps, {least} at least", cast.steps);
        }
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

    /// The bounds of directions must hold a point's full view: the directions' sum is the form factor.
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
            let regions = CoplanarRegions::of(&model);
            let obstacles = obstacles(&model, &regions);
            let pair = shaft.pair(obstacles, PatchTriangle::new(0, &small), PatchTriangle::new(1, &large));
            let mut cast = Cast::default();
            let mut segments = pair.segments(obstacles, &cast);
            shaft.directions_with(&pair, 1 << 13, 5, &mut cast, &mut segments);
            let across = (large[1] - large[0]).cross(large[2] - large[0]).normalize();
            let from = in_front(&small, large[0], across, 0.0).expect("it sees something");
            let part: f64 = (1..from.corners().len() - 1)
                .map(|k| area(&[from.corners()[0], from.corners()[k], from.corners()[k + 1]]))
                .sum();
            cut += usize::from(part < 0.999 * area(&small));
            let found = cast.sums.all / (cast.drawn as f64 * std::f64::consts::PI) * part / area(&small);
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
            let model = one_sided(&[emitter, [r, q, a], back[0], back[1]]);
            for (i, j) in [(0, 1), (1, 0)] {
                let (count, fraction) = fraction(&model, i, j, 512);
                assert!(
                    fraction < 0.02,
                    "{height}, {i} to {j}: {fraction} behind {count} occluders"
                );
            }
            // And without it, all is seen.
            let bare = one_sided(&[emitter, [r, q, a]]);
            assert_eq!(fraction(&bare, 0, 1, 512), (0, 1.0));
        }
    }

    /// A wall a hair in front of a small patch and farther beyond it, like the regions of two houses measured apart.
    /// Found in the real tile.
    #[test]
    fn a_wall_that_rises_slowly_hides_the_small_patch_below_it() {
        let p = DVec3::new;
        let emitter = [p(0.0, 0.0, 0.0), p(0.03, 0.0, 0.0), p(0.0, 0.03, 0.0)];
        let receiver = [p(-0.5, -0.5, 1.0), p(0.0, 0.6, 1.0), p(0.6, -0.4, 1.0)];
        for slope in [1e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3] {
            // It touches two of the corners, so that no proof by corners holds.
            let wall = [p(0.0, -2.0, 0.0), p(6.0, 0.0, 6.0 * slope), p(0.0, 2.0, 0.0)];
            let model = one_sided(&[emitter, receiver, wall]);
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
        let regions = CoplanarRegions::of(&model);
        let pair = shaft.pair(
            obstacles(&model, &regions),
            PatchTriangle::new(0, &corners(0)),
            PatchTriangle::new(2, &corners(2)),
        );
        assert_eq!(pair.occluders.len(), 1);
        let (small, large) = pair.by_size();
        let normal = geometry::cross;
        let span = |t: &[DVec3; 3]| [t[0], t[1] - t[0], t[2] - t[0]].map(|p| p.to_array());
        let spans = SegmentSampler {
            from: span(small),
            to: span(large),
            normals: [normal(small), normal(large)].map(|p| p.to_array()),
            sequence: Sequence::new(7),
        };
        for at in (0..512).step_by(RAYS) {
            let (mut a, mut b) = (RayBatch::new(), RayBatch::new());
            let mut drawn = [DrawnSegments::new(), DrawnSegments::new()];
            draw_segments(&spans, at, &mut drawn[0], &mut a);
            draw_segments_by(InstructionSet::widest(), &spans, at, &mut drawn[1], &mut b);
            assert_eq!((a.origin, a.direction, a.weight), (b.origin, b.direction, b.weight));
            hits(&shaft.occluders, &mut a);
            hits_by(InstructionSet::widest(), &shaft.occluders, &mut b);
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
            let sampler = DirectionSampler::between(&small, &large, 7).expect("they see each other");
            let mut met = 0;
            for at in (0..256).step_by(RAYS) {
                let (mut aims, mut drawn) = (
                    [ProjectedBounds::new(), ProjectedBounds::new()],
                    [DrawnSegments::new(), DrawnSegments::new()],
                );
                bound_projections(&sampler, at, &mut drawn[0], &mut aims[0]);
                bound_projections_by(InstructionSet::widest(), &sampler, at, &mut drawn[1], &mut aims[1]);
                for quarter in 0..FROM_A_POINT {
                    let masks = [
                        draw_directions(&sampler, quarter, &aims[0], &mut drawn[0]),
                        draw_directions_by(InstructionSet::widest(), &sampler, quarter, &aims[1], &mut drawn[1]),
                    ];
                    assert_eq!(masks[0], masks[1]);
                    let bits = |of: &DrawnSegments| {
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
