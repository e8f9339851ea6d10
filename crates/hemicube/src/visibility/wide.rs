//! The tree of boxes with eight children a node, for segments: a segment meets eight boxes at once, a SIMD lane each.
//!
//! It holds the boxes and leaves of a binary [`Tree`] and stops the same segments. Where a shaft is crowded, segments
//! take most of a pair's time, and most of that on their way down (Wald, Benthin & Boulos 2008; Ernst & Greiner 2008).

use crate::bvh::{INNER, Node, Tree};
use crate::simd::{InstructionSet, dispatch, least, most};
use crate::visibility::segments::Segment;

/// Children of a node.
const WIDTH: usize = 8;
/// The child of an unused lane.
const NONE: u32 = u32::MAX;
/// Marks a child as a leaf: the rest is its block's index.
const LEAF: u32 = 1 << 31;
/// The bit of each lane.
const BITS: [u64; WIDTH] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Half a side of an unused lane's box: less than any segment's slack can widen to a box.
const INSIDE_OUT: f64 = -1e9;

/// Eight boxes as a structure of arrays.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct WideNode {
    center: [[f64; WIDTH]; 3],
    half: [[f64; WIDTH]; 3],
    child: [u32; WIDTH],
}

/// A tree of [`WideNode`]s; node 0 is the root.
#[derive(Debug, Default)]
pub(crate) struct WideTree {
    nodes: Vec<WideNode>,
}

/// A child of a wide node that a segment meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reached {
    /// Where the segment enters its box, in parts of the segment's length.
    from: f64,
    child: u32,
}

/// The children that a segment is still to look at.
pub(crate) type Pending = Vec<Reached>;

impl WideTree {
    /// Collapses a binary tree: of up to eight descendants of a node, the inner one with the largest surface is opened
    /// until there are eight.
    pub(crate) fn of(tree: &Tree) -> Self {
        let mut wide = Self { nodes: Vec::new() };
        // Wide nodes to fill, with the binary nodes that they begin with.
        let mut to_fill = vec![(wide.add(), vec![0u32])];
        while let Some((at, mut members)) = to_fill.pop() {
            while let Some(place) = largest_inner(tree, &members).filter(|_| members.len() < WIDTH) {
                let child = tree.nodes[members[place] as usize].child;
                members[place] = child;
                members.insert(place + 1, child + 1);
            }
            for (lane, member) in members.into_iter().enumerate() {
                let node = &tree.nodes[member as usize];
                let child = if node.block != INNER {
                    LEAF | node.block
                } else if node.child == 0 {
                    continue;
                } else {
                    let next = wide.add();
                    to_fill.push((next, vec![node.child, node.child + 1]));
                    next
                };
                wide.nodes[at as usize].set(lane, node, child);
            }
        }
        wide
    }

    fn add(&mut self) -> u32 {
        self.nodes.push(WideNode {
            center: [[0.0; WIDTH]; 3],
            half: [[INSIDE_OUT; WIDTH]; 3],
            child: [NONE; WIDTH],
        });
        u32::try_from(self.nodes.len() - 1).unwrap_or(NONE)
    }

    /// Begins a segment's way down.
    pub(crate) fn begin(pending: &mut Pending) {
        pending.clear();
        pending.push(Reached { from: 0.0, child: 0 });
    }

    /// The next block with a box that the segment meets before `until`, in parts of its length; of a node's children, the
    /// nearest first.
    pub(crate) fn next(&self, segment: &Segment, until: f64, pending: &mut Pending) -> Option<u32> {
        next_by(InstructionSet::widest(), self, segment, until, pending)
    }
}

impl WideNode {
    fn set(&mut self, lane: usize, node: &Node, child: u32) {
        let (center, half) = (node.center.to_array(), node.half.to_array());
        for a in 0..3 {
            self.center[a][lane] = center[a];
            self.half[a][lane] = half[a];
        }
        self.child[lane] = child;
    }
}

/// The place of the inner node with the largest surface.
fn largest_inner(tree: &Tree, members: &[u32]) -> Option<usize> {
    let surface = |member: u32| {
        let h = tree.nodes[member as usize].half;
        h.x * h.y + h.y * h.z + h.z * h.x
    };
    let is_inner = |member: u32| {
        let node = &tree.nodes[member as usize];
        node.block == INNER && node.child != 0
    };
    let inner = (0..members.len()).filter(|&place| is_inner(members[place]));
    inner.max_by(|&p, &q| surface(members[p]).total_cmp(&surface(members[q])))
}

/// The body of [`WideTree::next`].
#[inline(always)]
fn next(tree: &WideTree, segment: &Segment, until: f64, pending: &mut Pending) -> Option<u32> {
    while let Some(Reached { from, child: index }) = pending.pop() {
        if from > until {
            continue;
        }
        if index & LEAF != 0 {
            return Some(index & !LEAF);
        }
        let node = &tree.nodes[index as usize];
        let (mut from, mut to) = ([0.0f64; WIDTH], [until; WIDTH]);
        for a in 0..3 {
            let (start, inverse) = (segment.start[a], segment.inverse[a]);
            let size = inverse.abs();
            for l in 0..WIDTH {
                let middle = (node.center[a][l] - start) * inverse;
                // A few roundings more: no box is missed that the segment touches.
                let extent = (node.half[a][l] + segment.slack) * size + 1e-14 * middle.abs();
                from[l] = most(from[l], middle - extent);
                to[l] = least(to[l], middle + extent);
            }
        }
        // A bit of its own for each lane, so that the mask is their sum.
        let mut mask = 0u64;
        for l in 0..WIDTH {
            mask |= if from[l] <= to[l] { BITS[l] } else { 0 };
        }
        let reached = |l: usize| Reached {
            from: from[l],
            child: node.child[l],
        };
        // All but the nearest, then the nearest: it is popped first.
        let mut nearest: Option<usize> = None;
        while mask != 0 {
            let l = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            match nearest {
                Some(best) if from[best] <= from[l] => pending.push(reached(l)),
                Some(best) => {
                    pending.push(reached(best));
                    nearest = Some(l);
                }
                None => nearest = Some(l),
            }
        }
        if let Some(best) = nearest {
            pending.push(reached(best));
        }
    }
    None
}

dispatch! {
    fn next_by = next(tree: &WideTree, segment: &Segment, until: f64, pending: &mut Pending) -> Option<u32>
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::splitmix;
    use crate::visibility::segments::next_block;
    use crate::{HierarchyOptions, Model};
    use glam::DVec3;
    use hemicube_scene::generate::BlockCityParameters;
    use hemicube_scene::{Patches, Subdivision};
    use std::collections::BTreeSet;

    /// The binary tree tests more inner boxes: by rounding, the wide one may meet a leaf more, and never one less.
    #[test]
    fn segments_meet_the_leaves_that_they_meet_in_the_binary_tree() {
        let city = BlockCityParameters::for_target(4_000, 3);
        let patches = Patches::new(&city.generate().expect("a city"), Subdivision::None).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let tree = Tree::of(model.geometry());
        let wide = WideTree::of(&tree);
        let mut state = 7;
        let mut unit = || splitmix::unit(splitmix::next(&mut state)) * 2.0 - 1.0;
        let (mut met, mut more, mut axial) = (0, 0, 0);
        for round in 0..2_000 {
            let [start, mut end] = [0, 1].map(|_| DVec3::new(unit(), unit(), 0.2 * unit()));
            if round % 5 == 0 {
                // Along an axis.
                end = DVec3::new(start.x, end.y, start.z);
                axial += 1;
            }
            let segment = Segment::new(start, end, tree.plane_tolerance);
            let (mut pending, mut of_binary, mut binary) = (Pending::new(), vec![0], BTreeSet::new());
            while let Some(block) = next_block(&tree, &segment, &mut of_binary) {
                binary.insert(block);
            }
            for set in InstructionSet::all() {
                let mut found = BTreeSet::new();
                WideTree::begin(&mut pending);
                while let Some(block) = next_by(set, &wide, &segment, 1.0, &mut pending) {
                    assert!(found.insert(block), "block {block} twice");
                }
                assert!(found.is_superset(&binary), "{start} to {end}: {binary:?}, {found:?}");
                more += found.len() - binary.len();
            }
            met += binary.len();
        }
        assert!(met > 2_000 && axial > 300, "{met} blocks met");
        assert!(more <= met / 1_000, "{more} blocks more than {met}: by rounding alone");
    }

    #[test]
    fn a_tree_without_boxes_meets_nothing() {
        let none = WideTree::of(&Tree::empty(0, 0, 1e-9));
        let segment = Segment::new(DVec3::ZERO, DVec3::ONE, 1e-9);
        let mut pending = Pending::new();
        WideTree::begin(&mut pending);
        assert_eq!(none.next(&segment, 1.0, &mut pending), None);
    }
}
