//! Segments between points of two triangles against the tree of coplanar regions: for pairs whose shaft holds too many
//! triangles to list.
//!
//! Against a list, a ray costs the list's length; down the tree, the tree's depth. So a ray's cost is bounded whatever
//! lies between the two. All is in f64: what lies a hair from one of the two planes needs no list of its own, unlike
//! with rays in f32.
//!
//! A device may answer them, as rays from the emitter that go on beyond the receiver: where it is certain that the
//! receiver is the first surface on one, nothing stops the segment. Those of a listed shaft are not asked for, because
//! they take 20 to 40 ns each, about as long as handing them over, and are in f32 themselves, with errors of their own.

use crate::Model;
use crate::backend::{Rays, Surface};
use crate::bvh::{Block, Bounds, INNER, LANES, Tree, UNUSED};
use crate::face::Items;
use crate::geometry::{self, Plane};
use crate::simd::{InstructionSet, cross, dispatch, dot, lanes, least, mask, minus, most};
use crate::visibility::coplanar::{CoplanarRegions, ROUGH};
use crate::visibility::shaft::STEPS_A_SEGMENT;
use crate::visibility::wide::{Pending, WideTree};
use glam::DVec3;
use hemicube_scene::InputPatch;

/// Everything in a scene that occludes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Obstacles<'a> {
    pub(crate) surfaces: &'a [Surface],
    pub(crate) regions: &'a CoplanarRegions,
}

impl<'a> Obstacles<'a> {
    pub(crate) fn new(model: &'a Model, regions: &'a CoplanarRegions) -> Self {
        Self {
            surfaces: &model.geometry().surfaces,
            regions,
        }
    }
}

/// Segments between two triangles, in the scene's coordinates.
#[derive(Debug)]
pub(crate) struct Segments<'a> {
    obstacles: Obstacles<'a>,
    /// The coplanar regions of the two.
    own: [u32; 2],
    receiver: u32,
    /// The planes of the emitter and of the receiver.
    planes: [Plane; 2],
    tolerance: f64,
    pending: Pending,
    /// The block that stopped the segment before: it often stops the next.
    last: Option<u32>,
    /// Rays for a device, where segments are only listed.
    listed: Option<Vec<[DVec3; 2]>>,
    /// A device's answers to the segments after the first [`TOLD`].
    given: std::vec::IntoIter<u32>,
    /// The segments of the pair so far, those of earlier rungs among them.
    pub(crate) walked: Walked,
}

/// Segments that tell what the others of a pair cost, whoever answers those. As many as shares are told by, see
/// `accuracy::ray_shares`: more leave less to a device, of fewer a device would get batches too small to fill it.
pub(crate) const TOLD: usize = 256;

/// Length of a ray that is to meet a segment's end, in lengths of the segment. A choice: with less, rounding may end
/// the ray before the receiver; with more, rays go on in vain where they miss the receiver by rounding.
const BEYOND: f64 = 2.0;
/// Sine of the angle to either plane up to which a device is not believed: surfaces of one plane are a tolerance apart,
/// and [`Rays::TIE`] tells them from each other from 5 · 10⁻⁵ on.
const FLATTEST: f64 = 1e-4;
/// Height above the emitter's plane up to which its own region is flat. A choice: far below what f32 tells from the
/// plane, 10⁻⁶; with less, patches whose corners are rounded are the processor's.
const LEVEL: f64 = 1e-7;
/// Blocks of regions at the emitter that are looked at; with more, a pair's segments are the processor's.
const MOST_BESIDE: usize = 1024;
/// Bound of the segments listed for a device at once, 48 bytes each: those beyond are the processor's.
const MOST_ASKED: usize = 1 << 17;

/// Segments down the tree, and their work.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Walked {
    segments: usize,
    /// Work of the first [`TOLD`] beyond [`STEPS_A_SEGMENT`] each, in steps.
    more_steps: u64,
}

impl Walked {
    /// Work beyond [`STEPS_A_SEGMENT`] of each, in steps: that of the first [`TOLD`], and their mean for each further
    /// one.
    pub(crate) fn more_steps(&self) -> u64 {
        let further = self.segments.saturating_sub(TOLD) as u64;
        self.more_steps + further * (self.more_steps / TOLD as u64)
    }
}

/// Blocks on a segment's way that [`STEPS_A_SEGMENT`] pays for, and steps of each further one: where
/// thousands of triangles lie in one place, every segment to it meets all their blocks. The steps are measured.
const USUAL_BLOCKS: u64 = STEPS_A_SEGMENT / STEPS_A_FURTHER_BLOCK;
const STEPS_A_FURTHER_BLOCK: u64 = 100;

impl<'a> Segments<'a> {
    /// Segments from a patch to the patch `receiver`; `own` are their coplanar regions, `planes` their planes.
    pub(crate) fn new(
        obstacles: Obstacles<'a>,
        own: [u32; 2],
        receiver: u32,
        planes: [Plane; 2],
        walked: Walked,
    ) -> Self {
        Self {
            obstacles,
            own,
            receiver,
            planes,
            tolerance: obstacles.regions.tree.plane_tolerance,
            pending: Pending::new(),
            last: None,
            listed: None,
            given: Vec::new().into_iter(),
            walked,
        }
    }

    /// Lists segments from now on, and stops none.
    pub(crate) fn listing(mut self) -> Self {
        self.listed = Some(Vec::new());
        self
    }

    /// The rays that were listed.
    pub(crate) fn listed(self) -> Vec<[DVec3; 2]> {
        self.listed.unwrap_or_default()
    }

    /// Takes a device's answers to the segments after the first [`TOLD`], see [`Self::listing`].
    pub(crate) fn give(&mut self, answers: Vec<u32>) {
        self.given = answers.into_iter();
    }

    /// Rays of an emitter's patch for a device.
    pub(crate) fn rays<'r>(&self, emitter: InputPatch, ends: &'r [[DVec3; 2]]) -> Rays<'r> {
        let Plane { normal, offset } = self.planes[0];
        Rays {
            emitter,
            normal,
            offset,
            ends,
        }
    }

    /// Returns whether a device, which knows surfaces and no regions, answers for the regions, too: not where the
    /// emitter's own region rises above its plane, as its back has no name, nor where one that rises lies on the
    /// emitter, as a piece of it may not rise, nor where more than [`MOST_BESIDE`] blocks lie at the emitter.
    pub(crate) fn can_be_given(&self, emitter: &[DVec3; 3]) -> bool {
        let (regions, plane) = (self.obstacles.regions, &self.planes[0]);
        // Within this distance of the emitter, a segment at the flattest has not risen a tolerance yet.
        let beside = self.tolerance / FLATTEST;
        let is_flat = |p: &DVec3| plane.height(*p).abs() <= LEVEL;
        // Far from the origin the tolerance is larger, and rough regions may be off by more than `LEVEL`.
        if ROUGH * self.tolerance > LEVEL || !regions.corners(self.own[0]).iter().all(is_flat) {
            return false;
        }
        let mut pending = Vec::new();
        let near = regions
            .tree
            .blocks_in(Bounds::of(*emitter).widened(beside), &mut pending);
        !near.enumerate().any(|(number, block)| {
            let block = &regions.tree.blocks[block as usize];
            let lies_on = |l: usize| {
                let triangle = block.triangle(l);
                let heights = triangle.map(|p| plane.height(p));
                let normal = geometry::cross(&triangle);
                let rises = heights.iter().any(|&h| h > self.tolerance) && heights.iter().any(|&h| h <= LEVEL);
                rises && normal.cross(plane.normal).length() <= FLATTEST * normal.length()
            };
            let is_other = |l: usize| block.negative[l] != UNUSED && block.negative[l] != self.own[0];
            number >= MOST_BESIDE || (0..LANES).filter(|&l| is_other(l)).any(lies_on)
        })
    }

    /// Returns whether an answer says that a segment from a point of the emitter to one of the receiver is stopped;
    /// `None` if it leaves that open.
    fn is_stopped_by(&self, answer: u32, from: DVec3, at: DVec3) -> Option<bool> {
        let way = at - from;
        let is_flat = |plane: &Plane| plane.normal.dot(way).abs() < FLATTEST * way.length();
        if self.planes.iter().any(is_flat) {
            return None;
        }
        if answer == self.receiver {
            return Some(false);
        }
        let is_other = || {
            let region = self.obstacles.regions.of_patch.get(answer as usize);
            region.is_some_and(|region| !self.own.contains(region))
        };
        (answer == Items::BLOCKED || is_other()).then_some(true)
    }

    /// Returns whether a region crosses the segment from `start` to `end`, or hides `at`, its end on the receiver, by
    /// lying in the receiver's plane and being seen before it. Walks down the tree along the segment.
    pub(crate) fn is_stopped(&mut self, start: DVec3, end: DVec3, at: DVec3) -> bool {
        self.walked.segments += 1;
        if self.walked.segments > TOLD {
            let from = if at == end { start } else { end };
            if let Some(listed) = &mut self.listed {
                if listed.len() < MOST_ASKED {
                    listed.push([from, from + (at - from) * BEYOND]);
                }
            } else if let Some(answer) = self.given.next()
                && let Some(is_stopped) = self.is_stopped_by(answer, from, at)
            {
                return is_stopped;
            }
        }
        if self.listed.is_some() {
            return false;
        }
        let wide = &self.obstacles.regions.wide;
        let segment = Segment::new(start, end, self.tolerance);
        if let Some(block) = self.last
            && self.stops(block, &segment, at)
        {
            return true;
        }
        let mut pending = std::mem::take(&mut self.pending);
        WideTree::begin(&mut pending);
        let mut stopped = false;
        let mut met = 0u64;
        while let Some(leaf) = wide.next(&segment, 1.0, &mut pending) {
            met += 1;
            if self.last != Some(leaf) && self.stops(leaf, &segment, at) {
                self.last = Some(leaf);
                stopped = true;
                break;
            }
        }
        self.pending = pending;
        if self.walked.segments <= TOLD {
            self.walked.more_steps += STEPS_A_FURTHER_BLOCK * met.saturating_sub(USUAL_BLOCKS);
        }
        stopped
    }

    fn stops(&self, block: u32, segment: &Segment, at: DVec3) -> bool {
        let regions = self.obstacles.regions;
        let block = &regions.tree.blocks[block as usize];
        let (crossed, flat) = dispatch_crossed(InstructionSet::widest(), block, segment, &self.planes, self.tolerance);
        let is_other = |l: usize| block.negative[l] != UNUSED && !self.own.contains(&block.negative[l]);
        if lanes(crossed).any(is_other) {
            return true;
        }
        lanes(flat).filter(|&l| is_other(l)).any(|l| {
            let mut pieces = regions.pieces(block.negative[l]).iter();
            pieces.any(|&piece| self.lies_over(&self.obstacles.surfaces[piece as usize], at))
        })
    }

    /// Returns whether a surface in the receiver's plane hides a point of it.
    fn lies_over(&self, surface: &Surface, at: DVec3) -> bool {
        let plane = &self.planes[1];
        let [a, b, c] = surface.corners;
        let own = geometry::cross(&surface.corners);
        let id = if own.dot(plane.normal) > 0.0 {
            Some(surface.front)
        } else {
            surface.back
        };
        id.is_some_and(|id| self.obstacles.regions.is_seen_before(id, self.receiver))
            && surface.corners.iter().all(|&p| plane.height(p).abs() <= self.tolerance)
            && [(a, b), (b, c), (c, a)]
                .iter()
                .all(|&(p, q)| own.cross(q - p).dot(at - p) >= 0.0)
    }
}

/// A segment, prepared for tests against boxes and triangles.
#[derive(Debug)]
pub(crate) struct Segment {
    pub(super) start: [f64; 3],
    end: [f64; 3],
    direction: [f64; 3],
    pub(super) inverse: [f64; 3],
    /// Margin by which boxes are widened.
    pub(super) slack: f64,
}

impl Segment {
    pub(crate) fn new(start: DVec3, end: DVec3, slack: f64) -> Self {
        let direction = (end - start).to_array();
        Self {
            start: start.to_array(),
            end: end.to_array(),
            direction,
            // No division by 0: along such an axis a box is met everywhere or nowhere, as with this large number.
            inverse: direction.map(|x| if x.abs() < 1e-200 { 1e200 } else { 1.0 / x }),
            slack,
        }
    }
}

/// The next block whose box the segment meets; the nearer child first.
#[inline(always)]
fn next_leaf(tree: &Tree, segment: &Segment, pending: &mut Vec<u32>) -> Option<u32> {
    while let Some(index) = pending.pop() {
        let node = &tree.nodes[index as usize];
        let (center, half) = (node.center.to_array(), node.half.to_array());
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for a in 0..3 {
            let middle = (center[a] - segment.start[a]) * segment.inverse[a];
            let extent = (half[a] + segment.slack) * segment.inverse[a].abs();
            // A few roundings more: no box is missed that the segment touches.
            let extent = extent + 1e-14 * middle.abs();
            from = most(from, middle - extent);
            to = least(to, middle + extent);
        }
        if from > to {
            continue;
        }
        if node.block != INNER {
            return Some(node.block);
        }
        if node.child == 0 {
            continue;
        }
        let [first, second] = [0, 1].map(|k| tree.nodes[node.child as usize + k].center.to_array());
        let mut ahead = 0.0;
        for a in 0..3 {
            ahead += (second[a] - first[a]) * segment.direction[a];
        }
        // The nearer child is popped first.
        let nearer = u32::from(ahead < 0.0);
        pending.extend([node.child + (1 - nearer), node.child + nearer]);
    }
    None
}

/// Width beyond a triangle's edges within which it stops a segment, in barycentric coordinates: a thousand roundings.
pub(crate) const HAIR: f64 = 1e-12;

/// The crossing of a segment's line with a triangle's plane.
pub(crate) struct Crossing {
    /// True if the segment crosses the triangle, strictly between its ends.
    pub(crate) hits: bool,
    /// Height of the start above the plane times twice the triangle's area: positive if its front is seen.
    pub(crate) at_start: f64,
    /// `at_start` less its counterpart at the end: the crossing is at `at_start / determinant` of the length.
    pub(crate) determinant: f64,
}

/// Crosses a segment with a triangle (Möller & Trumbore 1997), `direction` its end less its start.
#[inline(always)]
pub(crate) fn crossing([a, b, c]: [[f64; 3]; 3], start: [f64; 3], end: [f64; 3], direction: [f64; 3]) -> Crossing {
    let (e, f, s) = (minus(b, a), minus(c, a), minus(start, a));
    let n = cross(e, f);
    let (at_start, at_end) = (dot(n, s), dot(n, minus(end, a)));
    let determinant = at_start - at_end;
    let sign = if determinant < 0.0 { -1.0 } else { 1.0 };
    let q = cross(s, direction);
    let u = dot(f, q) * sign;
    let v = -dot(e, q) * sign;
    // A hair beyond its edges, too: a segment through an edge that two triangles share is stopped by one of them.
    let (size, hair) = (determinant * sign, determinant * sign * HAIR);
    let within = (u >= -hair) & (v >= -hair) & (u + v <= size + hair);
    let between = (at_start > 0.0) & (at_end < 0.0) | (at_start < 0.0) & (at_end > 0.0);
    Crossing {
        hits: within & between,
        at_start,
        determinant,
    }
}

/// Masks of 16 triangles: those rising above both planes and crossing the segment strictly between its ends, and those
/// in the receiver's plane.
#[inline(always)]
fn crossed(block: &Block, segment: &Segment, planes: &[Plane; 2], tolerance: f64) -> (u16, u16) {
    let (d, x, y) = (segment.direction, segment.start, segment.end);
    let (mut hit, mut flat) = ([0u64; LANES], [0u64; LANES]);
    for l in 0..LANES {
        let [a, b, c] = block.corners_of(l);
        let height = |plane: &Plane, p: [f64; 3]| dot(plane.normal.to_array(), p) - plane.offset;
        let of_emitter = [a, b, c].map(|p| height(&planes[0], p));
        let of_receiver = [a, b, c].map(|p| height(&planes[1], p));
        let above = most(of_emitter[0], most(of_emitter[1], of_emitter[2])) > tolerance;
        let highest = most(of_receiver[0], most(of_receiver[1], of_receiver[2]));
        let lowest = least(of_receiver[0], least(of_receiver[1], of_receiver[2]));
        let crossing = crossing([a, b, c], x, y, d);
        hit[l] = u64::from(crossing.hits & above & (highest > tolerance));
        flat[l] = u64::from(above & (highest <= tolerance) & (lowest >= -tolerance));
    }
    (mask(&hit), mask(&flat))
}

/// Mask of 16 triangles: those that a segment crosses strictly between its ends.
#[inline(always)]
fn hit(block: &Block, segment: &Segment) -> u16 {
    let mut hit = [0u64; LANES];
    for (l, hit) in hit.iter_mut().enumerate() {
        *hit = u64::from(crossing(block.corners_of(l), segment.start, segment.end, segment.direction).hits);
    }
    mask(&hit)
}

/// The lanes of a block whose triangles a segment crosses strictly between its ends.
pub(crate) fn lanes_crossed(block: &Block, segment: &Segment) -> impl Iterator<Item = usize> {
    lanes(dispatch_hit(InstructionSet::widest(), block, segment))
}

/// Steps of the way to a block, and of its test. Measured.
pub(crate) const STEPS_A_MET_BLOCK: u64 = 100;

/// The next block whose box a segment meets. `pending` are the nodes still to look at, at first the root, 0.
pub(crate) fn next_block(tree: &Tree, segment: &Segment, pending: &mut Vec<u32>) -> Option<u32> {
    dispatch_next_leaf(InstructionSet::widest(), tree, segment, pending)
}

dispatch! {
    fn dispatch_next_leaf = next_leaf(tree: &Tree, segment: &Segment, pending: &mut Vec<u32>) -> Option<u32>
}
dispatch! {
    fn dispatch_hit = hit(block: &Block, segment: &Segment) -> u16
}
dispatch! {
    fn dispatch_crossed = crossed(block: &Block, segment: &Segment, planes: &[Plane; 2], tolerance: f64) -> (u16, u16)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sampling::splitmix;

    /// Two triangles with a common edge, and a segment through a point of that edge: pairs of them, all turned another way.
    pub(crate) fn through_shared_edges() -> impl Iterator<Item = ([[DVec3; 3]; 2], [DVec3; 2])> {
        let mut state = 7;
        let mut random = move || splitmix::unit(splitmix::next(&mut state)) - 0.5;
        std::iter::repeat_with(move || {
            let mut point = || DVec3::new(random(), random(), random());
            let [a, b, c, d] = [point(), point(), point(), point()];
            let (start, share) = (point() + DVec3::Z, 0.5 + point().x);
            let through = a + (b - a) * share;
            // The third corners stand on either side of the edge as the segment sees it.
            let along = through - start;
            let aside = (b - a).cross(along).normalize();
            let [c, d] = [
                c - aside * (aside.dot(c - a) - 0.4),
                d - aside * (aside.dot(d - a) + 0.4),
            ];
            ([[a, b, c], [b, a, d]], [start, start + along * 2.0])
        })
        .take(20_000)
    }

    #[test]
    fn a_segment_through_an_edge_that_two_triangles_share_is_stopped() {
        for (triangles, [start, end]) in through_shared_edges() {
            let is_stopped = triangles.iter().any(|triangle| {
                let corners = triangle.map(|corner| corner.to_array());
                crossing(corners, start.to_array(), end.to_array(), (end - start).to_array()).hits
            });
            assert!(is_stopped, "{triangles:?} from {start} to {end}");
        }
    }
}
