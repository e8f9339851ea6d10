//! The first surface on a segment.

use crate::bvh::{Block, LANES, Tree, UNUSED};
use crate::geometry::{self, Plane};
use crate::simd::{InstructionSet, dispatch, dot, minus, most};
use crate::steps;
use crate::visibility::segments::{STEPS_A_MET_BLOCK, Segment, crossing, next_block};
use glam::DVec3;

/// A triangle on a segment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Met {
    /// Place along the segment, 0 to 1.
    pub(crate) place: f64,
    /// The side seen: a patch, or the tree's patch count for the back of a one-sided one.
    pub(crate) id: u32,
    /// Its block and lane, as in [`Tree::slot_of_patch`].
    pub(crate) slot: u32,
    pub(crate) corners: [DVec3; 3],
}

/// The first triangle on a segment, of those rising above `horizon`. Of triangles in one plane at one place,
/// as the walls of neighbouring buildings, the smallest id: ids of patches are smaller than those of backs. Ids that
/// `is_apart` names come after all others there.
pub(crate) fn nearest(
    tree: &Tree,
    [start, end]: [DVec3; 2],
    horizon: &Plane,
    is_apart: impl Fn(u32) -> bool,
    pending: &mut Vec<u32>,
) -> Option<Met> {
    pending.clear();
    pending.push(0);
    let mut segment = Segment::new(start, end, tree.plane_tolerance);
    let mut length = 1.0;
    let next = |until: f64| {
        if until < length {
            length = until;
            segment = Segment::new(start, start + (end - start) * until, tree.plane_tolerance);
        }
        next_block(tree, &segment, pending)
    };
    let mut blocks = 0;
    let met = nearest_of(tree, [start, end], horizon, is_apart, next, &mut blocks);
    // And the way to where there is none.
    steps::add(STEPS_A_MET_BLOCK * (blocks + 1));
    met
}

/// [`nearest`], of the blocks of triangles that `next` finds on the way up to a place; adds them to `blocks`.
pub(crate) fn nearest_of(
    tree: &Tree,
    [start, end]: [DVec3; 2],
    horizon: &Plane,
    is_apart: impl Fn(u32) -> bool,
    mut next: impl FnMut(f64) -> Option<u32>,
    blocks: &mut u64,
) -> Option<Met> {
    let along = end - start;
    let mut until = 1.0;
    let mut first: Option<Met> = None;
    let ends = [start.to_array(), end.to_array()];
    while let Some(leaf) = next(until) {
        *blocks += 1;
        let block = &tree.blocks[leaf as usize];
        let mut places = [f64::INFINITY; LANES];
        let tolerance = tree.plane_tolerance;
        places_by(InstructionSet::widest(), block, &ends, horizon, tolerance, &mut places);
        for (l, &place) in places.iter().enumerate() {
            if place.abs() > 1.0 || block.negative[l] == UNUSED {
                continue;
            }
            let ids = if place.is_sign_negative() {
                &block.positive
            } else {
                &block.negative
            };
            #[allow(clippy::cast_possible_truncation, reason = "a lane of 16")]
            let slot = leaf * LANES as u32 + l as u32;
            let found = Met {
                place: place.abs(),
                id: ids[l],
                slot,
                corners: block.triangle(l),
            };
            let tie = found.tie(along, tree.plane_tolerance);
            let wins = first.is_none_or(|first| {
                if (found.place - first.place).abs() <= tie && found.is_in_plane_with(&first, tree.plane_tolerance) {
                    (is_apart(found.id), found.id) < (is_apart(first.id), first.id)
                } else {
                    found.place < first.place
                }
            });
            if wins {
                first = Some(found);
                // Triangles at the same place are still looked at.
                until = (found.place + tie).min(1.0);
            }
        }
    }
    first
}

impl Met {
    /// Distance along the segment, in parts of it, within which surfaces of one plane may appear.
    fn tie(&self, along: DVec3, tolerance: f64) -> f64 {
        let across = self.normal().dot(along).abs();
        4.0 * tolerance / across.max(1e-4 * along.length())
    }

    fn normal(&self) -> DVec3 {
        geometry::cross(&self.corners).normalize_or_zero()
    }

    /// Returns whether one of two triangles lies in the plane of the other.
    fn is_in_plane_with(&self, other: &Self, tolerance: f64) -> bool {
        let lies_in = |p: &Self, q: &Self| {
            let normal = q.normal();
            p.corners
                .iter()
                .all(|&corner| normal.dot(corner - q.corners[0]).abs() <= tolerance)
        };
        lies_in(self, other) || lies_in(other, self)
    }
}

/// Places along a segment where it crosses each of 16 triangles, in parts of its length: negative if it comes from the
/// side on which determinants are positive, infinite if it does not cross or the triangle lies below `horizon`.
#[inline(always)]
fn places(block: &Block, ends: &[[f64; 3]; 2], horizon: &Plane, tolerance: f64, out: &mut [f64; LANES]) {
    let [x, y] = *ends;
    let (normal, offset) = (horizon.normal.to_array(), horizon.offset);
    let d = minus(y, x);
    for l in 0..LANES {
        let [a, b, c] = block.corners_of(l);
        let highest = most(dot(normal, a), most(dot(normal, b), dot(normal, c))) - offset;
        let crossing = crossing([a, b, c], x, y, d);
        let place = crossing.at_start / crossing.determinant;
        out[l] = if crossing.hits & (highest > tolerance) {
            if crossing.at_start < 0.0 { -place } else { place }
        } else {
            f64::INFINITY
        };
    }
}

dispatch! {
    fn places_by = places(block: &Block, ends: &[[f64; 3]; 2], horizon: &Plane, tolerance: f64, out: &mut [f64; LANES])
}
