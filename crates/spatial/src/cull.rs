//! Walks over an octree: by frustum, giving contiguous ranges of items, and outwards from a point.

use crate::frustum::ALL_PLANES;
use crate::octree::{Node, Octree};
use crate::{Containment, Frustum};
use glam::DVec3;
use std::ops::{AddAssign, Range};

/// Counters of a walk. The own items of a node with children are tested by their own bounds and count as a node more.
///
/// Items neither culled nor inside straddled. Counters add up over walks with `+=`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullCounters {
    /// Nodes tested against the frustum.
    pub nodes_tested: u64,
    /// Tested nodes found outside.
    pub nodes_culled: u64,
    /// Tested nodes found wholly inside: nothing beneath them was tested.
    pub nodes_inside: u64,
    /// Items beneath the culled nodes.
    pub items_culled: u64,
}

impl AddAssign for CullCounters {
    fn add_assign(&mut self, other: Self) {
        self.nodes_tested += other.nodes_tested;
        self.nodes_culled += other.nodes_culled;
        self.nodes_inside += other.nodes_inside;
        self.items_culled += other.items_culled;
    }
}

impl CullCounters {
    fn count(&mut self, containment: Containment, items: &Range<u32>) {
        self.nodes_tested += 1;
        match containment {
            Containment::Inside => self.nodes_inside += 1,
            Containment::Straddling => {}
            Containment::Outside => {
                self.nodes_culled += 1;
                self.items_culled += items.len() as u64;
            }
        }
    }
}

/// The next step after a node of a front-to-back walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visit {
    /// Go on with its children, if it has any.
    Descend,
    /// Leave out all beneath it.
    Skip,
    /// End the walk.
    Stop,
}

/// Joins adjacent ranges with the same outcome.
struct Ranges<F> {
    pending: Option<(Range<u32>, Containment)>,
    visit: F,
}

impl<F: FnMut(Range<u32>, Containment)> Ranges<F> {
    fn add(&mut self, items: Range<u32>, containment: Containment) {
        match &mut self.pending {
            Some((pending, same)) if pending.end == items.start && *same == containment => pending.end = items.end,
            _ => {
                self.flush();
                self.pending = Some((items, containment));
            }
        }
    }

    fn flush(&mut self) {
        if let Some((items, containment)) = self.pending.take() {
            (self.visit)(items, containment);
        }
    }
}

/// Never exceeded: a walk has at most seven waiting siblings on each of 21 levels, and one node in hand.
const STACK_CAPACITY: usize = 7 * 21 + 1;

impl Octree {
    /// Gives the items not proved to be outside a frustum as ascending, disjoint, nowhere adjacent-and-equal ranges of
    /// places in [`order`](Self::order): [`Inside`](Containment::Inside) when all of a range is inside, otherwise
    /// [`Straddling`](Containment::Straddling). Leaves out no item that shares a point with the frustum.
    ///
    /// ```
    /// # use hemicube_spatial::{Aabb, Containment, Frustum, Octree, OctreeOptions, Plane, glam::DVec3};
    /// # let boxes: Vec<Aabb> = (0..100).map(|i| Aabb::from_points([DVec3::splat(f64::from(i))])).collect();
    /// # let octree = Octree::build(&boxes, OctreeOptions { max_level: 21, min_items: 1 })?;
    /// let upwards_of_50 = Frustum::from_planes(&[Plane { point: DVec3::splat(49.5), normal: DVec3::Z }]);
    /// let mut ranges = Vec::new();
    /// octree.cull(&upwards_of_50, |items, containment| ranges.push((items, containment)));
    /// assert_eq!(ranges, [(50..100, Containment::Inside)]);
    /// # Ok::<(), hemicube_spatial::OctreeError>(())
    /// ```
    pub fn cull(&self, frustum: &Frustum, visit: impl FnMut(Range<u32>, Containment)) -> CullCounters {
        let mut counters = CullCounters::default();
        let mut ranges = Ranges { pending: None, visit };
        let mut stack: Vec<(u32, u64)> = Vec::with_capacity(STACK_CAPACITY);
        if !self.nodes.is_empty() {
            stack.push((0, ALL_PLANES));
        }
        while let Some((index, mask)) = stack.pop() {
            let node = &self.nodes[index as usize];
            let (containment, mask) = frustum.classify_masked(&node.bounds, mask);
            counters.count(containment, &node.all());
            match containment {
                Containment::Outside => {}
                Containment::Inside => ranges.add(node.all(), containment),
                Containment::Straddling if node.is_leaf() => ranges.add(node.all(), containment),
                Containment::Straddling => {
                    let own = node.own();
                    if !own.is_empty() {
                        let (containment, _) = frustum.classify_masked(&node.own_bounds, mask);
                        counters.count(containment, &own);
                        if containment != Containment::Outside {
                            ranges.add(own, containment);
                        }
                    }
                    stack.extend(node.children().rev().map(|child| (child, mask)));
                }
            }
        }
        ranges.flush();
        counters
    }

    /// Walks the nodes outwards from an eye: a node comes before every other node whose cell its own can hide, unless
    /// one is beneath the other. `visit` gets a node's number and the node, before its children, and returns the next
    /// step.
    ///
    /// A node's own items are due at its visit. With children they lie astride its middle planes, so nearer items may
    /// still follow: sort or test them if that matters.
    ///
    /// ```
    /// # use hemicube_spatial::{Aabb, Octree, OctreeOptions, Visit, glam::DVec3};
    /// # let boxes: Vec<Aabb> = (0..100).map(|i| Aabb::from_points([DVec3::splat(f64::from(i))])).collect();
    /// # let octree = Octree::build(&boxes, OctreeOptions { max_level: 21, min_items: 1 })?;
    /// let mut nearest_first = Vec::new();
    /// octree.visit_front_to_back(DVec3::splat(200.0), |_, node| {
    ///     nearest_first.extend(node.own());
    ///     if nearest_first.len() < 3 { Visit::Descend } else { Visit::Stop }
    /// });
    /// assert_eq!(nearest_first, [99, 98, 97]);
    /// # Ok::<(), hemicube_spatial::OctreeError>(())
    /// ```
    pub fn visit_front_to_back(&self, eye: DVec3, mut visit: impl FnMut(u32, &Node) -> Visit) {
        let eye = self.cube.unit_position(eye);
        let mut stack: Vec<u32> = Vec::with_capacity(STACK_CAPACITY);
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            match visit(index, node) {
                Visit::Stop => return,
                Visit::Skip => continue,
                Visit::Descend => {}
            }
            let scale = (-f64::from(node.level)).exp2();
            let [x, y, z] = node.cell.map(|c| (f64::from(c) + 0.5) * scale);
            let nearest = usize::from(eye.x >= x) | usize::from(eye.y >= y) << 1 | usize::from(eye.z >= z) << 2;
            // Counting up o in `nearest ^ o` visits the near half first, at each of the three middle planes.
            let mut by_distance = [None; 8];
            for child in node.children() {
                let octant = self.nodes[child as usize].octant_beneath(node.level);
                if let Some(slot) = octant.and_then(|octant| by_distance.get_mut(octant ^ nearest)) {
                    *slot = Some(child);
                }
            }
            stack.extend(by_distance.into_iter().rev().flatten());
        }
    }
}
