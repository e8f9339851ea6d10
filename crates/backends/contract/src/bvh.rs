//! Surfaces in blocks of 16, one a SIMD lane, under a binary tree of boxes in f64. The CPU backend walks it, and shafts
//! between two patches are tested against it.
//!
//! The tree is cut by the surface area heuristic (MacDonald & Booth 1990, "Heuristics for ray tracing using space
//! subdivision", with Wald's binning of 2007). The scene's octree can be packed into blocks instead; bench `engine` of
//! the CPU backend compares the two. The heuristic's tight boxes make fuller blocks, and more of them are skipped than
//! cells of an octree.
//!
//! No octree in the CPU backend, because a tree cut by the surface area heuristic is as fast or faster on every scene
//! of `docs/dev/engines.md`, with the comparison. The octree comes with every scene for backends drawing ranges of it.

use crate::backend::{Geometry, Surface};
use glam::DVec3;
use std::sync::Arc;

/// The way of forming blocks under a tree. Rows are equal to the bit with either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hierarchy {
    /// A binary tree cut by the surface area heuristic.
    #[default]
    SurfaceArea,
    /// The scene's octree, its nodes' children paired to a binary tree.
    Octree,
}

/// Triangles a block holds, one a SIMD lane.
pub const LANES: usize = 16;

/// The patch id of an unused lane. Real ids, and the id for blocked, are smaller.
pub const UNUSED: u32 = u32::MAX;

/// Up to 16 triangles in a structure of arrays, ready for SIMD.
///
/// Corners are sorted by coordinates: a triangle given twice, in any vertex order or winding, has the same arithmetic
/// and thus the same depth to the bit. `negative` and `positive` keep the winding: one is the front.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Block {
    /// x, y, z of corner 0, then of 1, then of 2.
    pub corners: [[f64; LANES]; 9],
    /// The id seen if det(v0, v1, v2) < 0, with the eye as origin.
    pub negative: [u32; LANES],
    /// The id seen if det > 0.
    pub positive: [u32; LANES],
}

impl Block {
    /// One without triangles.
    pub fn empty() -> Self {
        Self {
            corners: [[0.0; LANES]; 9],
            negative: [UNUSED; LANES],
            positive: [UNUSED; LANES],
        }
    }

    /// Packs up to 16 surfaces. The back of a one-sided one shows `blocked`: an id above all patches, so that any patch
    /// at the same depth wins.
    ///
    /// # Panics
    /// When `lanes` is empty.
    pub fn of(surfaces: &[Surface], lanes: &[u32], blocked: u32) -> Self {
        let mut block = Self::empty();
        for lane in 0..LANES {
            // Unused lanes repeat the last triangle's first corner: no area, so nothing is drawn.
            let surface = &surfaces[lanes[lane.min(lanes.len() - 1)] as usize];
            let (corners, flipped) = sorted_corners(surface.corners);
            let used = lane < lanes.len();
            for (k, corner) in corners.iter().enumerate() {
                let corner = if used { corner } else { &corners[0] };
                block.corners[3 * k][lane] = corner.x;
                block.corners[3 * k + 1][lane] = corner.y;
                block.corners[3 * k + 2][lane] = corner.z;
            }
            if !used {
                continue;
            }
            let back = surface.back.map_or(blocked, |p| p.0);
            // The determinant is negative for an eye on the front of counter-clockwise corners.
            let (negative, positive) = if flipped {
                (back, surface.front.0)
            } else {
                (surface.front.0, back)
            };
            block.negative[lane] = negative;
            block.positive[lane] = positive;
        }
        block
    }

    /// The corners of the triangle in a lane, ascending.
    #[inline(always)]
    pub fn triangle(&self, lane: usize) -> [DVec3; 3] {
        self.corners_of(lane).map(DVec3::from_array)
    }

    /// [`Block::triangle`], for loops over the lanes.
    #[inline(always)]
    pub fn corners_of(&self, lane: usize) -> [[f64; 3]; 3] {
        std::array::from_fn(|k| std::array::from_fn(|axis| self.corners[3 * k + axis][lane]))
    }
}

/// A node of the tree: one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Node {
    /// The middle of its box.
    pub center: DVec3,
    /// Half the sides of its box, a hair wider than its contents.
    pub half: DVec3,
    /// Index of the first of two neighbouring children; meaningless in a leaf.
    pub child: u32,
    /// Index of the leaf's block, or [`INNER`].
    pub block: u32,
    /// The largest area of a triangle in it, rounded up.
    pub largest: f32,
}

/// The block of a node with children: none.
pub const INNER: u32 = u32::MAX;

/// A scene's surfaces in blocks under a tree; node 0 is the root.
///
/// ```
/// use hemicube_contract::InputPatch;
/// use hemicube_contract::backend::{Geometry, Surface};
/// use hemicube_contract::bvh::{Hierarchy, LANES, Tree, sorted_corners};
/// use hemicube_spatial::{Aabb, Octree, OctreeOptions, glam::DVec3};
///
/// let corners = [[DVec3::ZERO, DVec3::X, DVec3::Y], [DVec3::Z, DVec3::Y + DVec3::Z, DVec3::X + DVec3::Z]];
/// let octree = Octree::build(&corners.map(Aabb::from_points), OctreeOptions { max_level: 4, min_items: 4 })?;
/// let surface = |&place: &u32| Surface { corners: corners[place as usize], front: InputPatch(place), back: None };
/// let surfaces = octree.order().iter().map(surface).collect();
/// let geometry = Geometry::new(surfaces, octree, 2, 1e-10);
///
/// let tree = Tree::new(&geometry, Hierarchy::SurfaceArea);
/// assert!(tree.blocks.len() * LANES >= geometry.surfaces.len());
/// for surface in &geometry.surfaces {
///     let slot = tree.slot_of_patch[surface.front.0 as usize] as usize;
///     let (corners, _turned) = sorted_corners(surface.corners);
///     assert_eq!(tree.blocks[slot / LANES].triangle(slot % LANES), corners);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Tree {
    /// The nodes; children are neighbours.
    pub nodes: Vec<Node>,
    /// The leaves' blocks.
    pub blocks: Vec<Block>,
    /// block × 16 + lane of each patch's surface.
    pub slot_of_patch: Vec<u32>,
    /// Number of patches, also the id for blocked.
    pub patch_count: u32,
    /// See [`Geometry::plane_tolerance`].
    pub plane_tolerance: f64,
}

/// A growing box of numbers that are finite.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The least coordinates.
    pub low: DVec3,
    /// The greatest coordinates.
    pub high: DVec3,
}

impl Bounds {
    /// The box of nothing.
    pub const EMPTY: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    /// The box of a triangle.
    pub fn of([a, b, c]: [DVec3; 3]) -> Self {
        Self {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
        }
    }

    /// The box widened by so much on each side.
    #[must_use]
    pub fn widened(self, by: f64) -> Self {
        Self {
            low: self.low - by,
            high: self.high + by,
        }
    }

    /// The box of both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    fn of_nodes(a: &Node, b: &Node) -> Self {
        let of = |n: &Node| Self {
            low: n.center - n.half,
            high: n.center + n.half,
        };
        of(a).union(of(b))
    }

    fn node(self, child: u32, block: u32) -> Node {
        Node {
            center: (self.low + self.high) * 0.5,
            // A hair wider than the corners, because the middle and the half side are rounded.
            half: (self.high - self.low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15),
            child,
            block,
            largest: f32::INFINITY,
        }
    }

    /// Half the surface area; 0 for the empty box.
    pub fn half_area(self) -> f64 {
        let d = (self.high - self.low).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

const BINS: usize = 32;

impl Tree {
    /// The blocks whose nodes a box meets, its faces included. `pending` is the walk's memory, of any content.
    pub fn blocks_in<'t>(&'t self, bounds: Bounds, pending: &'t mut Vec<u32>) -> impl Iterator<Item = u32> + 't {
        pending.clear();
        pending.push(0);
        std::iter::from_fn(move || {
            while let Some(index) = pending.pop() {
                let node = &self.nodes[index as usize];
                let (low, high) = (node.center - node.half, node.center + node.half);
                if bounds.low.cmpgt(high).any() || low.cmpgt(bounds.high).any() {
                    continue;
                }
                if node.block != INNER {
                    return Some(node.block);
                }
                if node.child > 0 {
                    pending.extend([node.child, node.child + 1]);
                }
            }
            None
        })
    }

    /// The tree of a scene by the surface area heuristic, made when first asked for and shared from then on.
    pub fn of(geometry: &Geometry) -> Arc<Self> {
        geometry.kept(|geometry| Self::new(geometry, Hierarchy::SurfaceArea))
    }

    /// Packs a scene's surfaces.
    pub fn new(geometry: &Geometry, hierarchy: Hierarchy) -> Self {
        match hierarchy {
            Hierarchy::SurfaceArea => {
                Self::of_surfaces(&geometry.surfaces, geometry.patch_count, geometry.plane_tolerance)
            }
            Hierarchy::Octree => {
                let mut tree = Self::by_octree(geometry);
                tree.measure();
                tree
            }
        }
    }

    /// A tree of any surfaces with ids below `patch_count`, by the surface area heuristic.
    pub fn of_surfaces(surfaces: &[Surface], patch_count: u32, plane_tolerance: f64) -> Self {
        let mut tree = Self::empty(surfaces.len(), patch_count, plane_tolerance);
        tree.cut_by_surface_area(surfaces);
        tree.measure();
        tree
    }

    /// Notes in each node the largest area below it.
    fn measure(&mut self) {
        // Every node after its children: the reverse of an order with each before them.
        let mut order = vec![0u32];
        let mut at = 0;
        while at < order.len() {
            let node = &self.nodes[order[at] as usize];
            if node.block == INNER && node.child != 0 {
                order.extend([node.child, node.child + 1]);
            }
            at += 1;
        }
        for &index in order.iter().rev() {
            let node = &self.nodes[index as usize];
            let largest = if node.block != INNER {
                let block = &self.blocks[node.block as usize];
                let area = (0..LANES).map(|l| {
                    let [a, b, c] = block.triangle(l);
                    0.5 * (b - a).cross(c - a).length()
                });
                #[allow(clippy::cast_possible_truncation, reason = "rounded up")]
                let largest = (area.fold(0.0, f64::max) as f32).next_up();
                largest
            } else if node.child == 0 {
                0.0
            } else {
                let child = node.child as usize;
                self.nodes[child].largest.max(self.nodes[child + 1].largest)
            };
            self.nodes[index as usize].largest = largest;
        }
    }

    /// Pairs up each octree node's own blocks and its children, in order, until one is left. The octree's surfaces are
    /// already in the order of its nodes.
    fn by_octree(geometry: &Geometry) -> Self {
        let surfaces = &geometry.surfaces;
        let mut tree = Self::empty(surfaces.len(), geometry.patch_count, geometry.plane_tolerance);
        let octree = geometry.octree.nodes();
        // Children come after their parents, so walking backwards has every child's node ready.
        let mut built: Vec<Option<Node>> = vec![None; octree.len()];
        for (index, node) in octree.iter().enumerate().rev() {
            let own: Vec<u32> = node.own().collect();
            let mut row: Vec<Node> = own
                .chunks(LANES)
                .map(|chunk| {
                    let bounds = chunk
                        .iter()
                        .fold(Bounds::EMPTY, |b, &s| b.union(Bounds::of(surfaces[s as usize].corners)));
                    #[allow(clippy::cast_possible_truncation, reason = "fewer blocks than surfaces")]
                    let block = tree.blocks.len() as u32;
                    tree.push_block(surfaces, chunk);
                    bounds.node(0, block)
                })
                .collect();
            row.extend(node.children().filter_map(|child| built[child as usize]));
            while row.len() > 1 {
                row = row
                    .chunks(2)
                    .map(|pair| match *pair {
                        [a, b] => {
                            #[allow(clippy::cast_possible_truncation, reason = "fewer nodes than surfaces")]
                            let child = tree.nodes.len() as u32;
                            tree.nodes.extend([a, b]);
                            Bounds::of_nodes(&a, &b).node(child, INNER)
                        }
                        ref rest => rest[0],
                    })
                    .collect();
            }
            built[index] = row.pop();
        }
        if let Some(root) = built.first().copied().flatten() {
            tree.nodes[0] = root;
        }
        tree
    }

    /// Makes room for a tree of so many surfaces, with an empty root.
    pub fn empty(count: usize, patch_count: u32, plane_tolerance: f64) -> Self {
        let mut tree = Self {
            nodes: Vec::with_capacity(count / 6 + 1),
            blocks: Vec::with_capacity(count / 12 + 1),
            slot_of_patch: vec![u32::MAX; patch_count as usize],
            patch_count,
            plane_tolerance,
        };
        tree.nodes.push(Node {
            center: DVec3::ZERO,
            half: DVec3::ZERO,
            child: 0,
            block: INNER,
            largest: f32::INFINITY,
        });
        tree
    }

    fn cut_by_surface_area(&mut self, surfaces: &[Surface]) {
        let count = surfaces.len();
        #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ surfaces")]
        let mut order: Vec<u32> = (0..count as u32).collect();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        // By patch, not in the octree's order, so that every octree leads to the same tree.
        order.sort_unstable_by_key(|&s| surfaces[s as usize].front);
        let boxes: Vec<Bounds> = surfaces.iter().map(|surface| Bounds::of(surface.corners)).collect();
        // Twice the number of threads, because the halves of a scene are not equally expensive.
        let id = |s: u32| surfaces[s as usize].front.0;
        let whole = cut(&boxes, &id, &mut order, 2 * threads.next_power_of_two());
        self.nodes = whole.nodes;
        let mut start = 0;
        for lanes in whole.leaves {
            self.push_block(surfaces, &order[start..start + lanes]);
            start += lanes;
        }
    }

    fn push_block(&mut self, surfaces: &[Surface], lanes: &[u32]) {
        let index = self.blocks.len();
        for (lane, &surface) in lanes.iter().enumerate() {
            let surface = &surfaces[surface as usize];
            #[allow(
                clippy::cast_possible_truncation,
                reason = "fewer blocks than surfaces, of which there are < 2³¹"
            )]
            let slot = (index * LANES + lane) as u32;
            self.slot_of_patch[surface.front.0 as usize] = slot;
            if let Some(back) = surface.back {
                self.slot_of_patch[back.0 as usize] = slot;
            }
        }
        self.blocks.push(Block::of(surfaces, lanes, self.patch_count));
    }
}

/// Returns true if two triangles in one plane of that normal overlap by more than `touch`: no edge of either separates
/// them.
pub fn overlap(p: &[DVec3; 3], q: &[DVec3; 3], normal: DVec3, touch: f64) -> bool {
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

/// A part of the tree by itself: its root first, children and blocks counted from its own first.
struct Piece {
    nodes: Vec<Node>,
    /// Number of surfaces of each leaf, in the order of the surfaces.
    leaves: Vec<usize>,
}

impl Node {
    /// Returns the node for a tree with so many more nodes and blocks before its children.
    fn moved(mut self, nodes: usize, blocks: usize) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "fewer nodes and blocks than surfaces")]
        if self.block == INNER {
            self.child += nodes as u32;
        } else {
            self.block += blocks as u32;
        }
        self
    }
}

/// Fewer surfaces are cut sooner than a thread is started.
const PARALLEL_FROM: usize = 1 << 13;

/// The box of some surfaces, and the box of their doubled middles.
fn bounds_of(boxes: &[Bounds], range: &[u32]) -> (Bounds, Bounds) {
    range
        .iter()
        .fold((Bounds::EMPTY, Bounds::EMPTY), |(bounds, centers), &s| {
            let b = boxes[s as usize];
            let c = b.low + b.high;
            (bounds.union(b), centers.union(Bounds { low: c, high: c }))
        })
}

/// Sorts the surfaces of `range` into leaves and puts a tree over them, in up to about `pieces` pieces at the same
/// time. `id` names a surface's patch. Neither half of a node looks at the other, so the tree is the same whatever the
/// pieces.
fn cut(boxes: &[Bounds], id: &(impl Fn(u32) -> u32 + Sync), range: &mut [u32], pieces: usize) -> Piece {
    if pieces <= 1 || range.len() < PARALLEL_FROM {
        return cut_alone(boxes, id, range);
    }
    let (bounds, centers) = bounds_of(boxes, range);
    let middle = split(boxes, range, centers);
    let (first, second) = range.split_at_mut(middle);
    let (first, second) = std::thread::scope(|scope| {
        let second = scope.spawn(|| cut(boxes, id, second, pieces / 2));
        let first = cut(boxes, id, first, pieces / 2);
        let second = second.join();
        (
            first,
            second.unwrap_or_else(|payload| std::panic::resume_unwind(payload)),
        )
    });
    // The pair of children, then the nodes below the first, then those below the second.
    let (below, leaves) = (first.nodes.len(), first.leaves.len());
    let mut nodes = Vec::with_capacity(1 + below + second.nodes.len());
    nodes.push(bounds.node(1, INNER));
    nodes.push(first.nodes[0].moved(2, 0));
    nodes.push(second.nodes[0].moved(below + 1, leaves));
    nodes.extend(first.nodes[1..].iter().map(|node| node.moved(2, 0)));
    nodes.extend(second.nodes[1..].iter().map(|node| node.moved(below + 1, leaves)));
    let mut all = first.leaves;
    all.extend(second.leaves);
    Piece { nodes, leaves: all }
}

/// Cuts on this thread, without recursion: a scene can make the tree as deep as its number of leaves.
fn cut_alone(boxes: &[Bounds], id: &impl Fn(u32) -> u32, range: &mut [u32]) -> Piece {
    let empty = Bounds::EMPTY.node(0, INNER);
    let mut piece = Piece {
        nodes: vec![empty],
        leaves: Vec::new(),
    };
    let mut pending = vec![(0usize, 0usize, range.len())];
    while let Some((node, start, end)) = pending.pop() {
        let range = &mut range[start..end];
        let (bounds, centers) = bounds_of(boxes, range);
        if range.len() <= LANES {
            #[allow(clippy::cast_possible_truncation, reason = "fewer blocks than surfaces")]
            let block = piece.leaves.len() as u32;
            piece.nodes[node] = bounds.node(0, block);
            // Ids in ascending lanes: the tree then depends on the set of triangles only.
            range.sort_unstable_by_key(|&s| id(s));
            piece.leaves.push(range.len());
            continue;
        }
        let split = split(boxes, range, centers);
        #[allow(clippy::cast_possible_truncation, reason = "fewer nodes than surfaces")]
        let child = piece.nodes.len() as u32;
        piece.nodes[node] = bounds.node(child, INNER);
        piece.nodes.extend([empty, empty]);
        pending.push((child as usize + 1, start + split, end));
        pending.push((child as usize, start, start + split));
    }
    piece
}

/// The distance from a point to a triangle (Ericson 2005, §5.1.5, by Voronoi regions).
pub fn distance(p: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (*b - *a, *c - *a, p - *a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length();
    }
    let bp = p - *b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).length();
    }
    let cp = p - *c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).length();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (bp - (*c - *b) * w).length();
    }
    let n = ab.cross(ac);
    n.dot(ap).abs() / n.length()
}

/// Sorts corners by (x, y, z). Returns true, too, if the winding turned around.
pub fn sorted_corners(mut corners: [DVec3; 3]) -> ([DVec3; 3], bool) {
    // −0 and 0 are one position: adding 0 makes them the same bits.
    corners = corners.map(|p| p + DVec3::ZERO);
    let above = |p: DVec3, q: DVec3| {
        p.x.total_cmp(&q.x)
            .then(p.y.total_cmp(&q.y))
            .then(p.z.total_cmp(&q.z))
            .is_gt()
    };
    let mut flipped = false;
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if above(corners[i], corners[j]) {
            corners.swap(i, j);
            flipped = !flipped;
        }
    }
    (corners, flipped)
}

/// Partitions `range` in two by the cheapest of the binned planes; returns the size of the first part.
fn split(surfaces: &[Bounds], range: &mut [u32], centers: Bounds) -> usize {
    let extent = centers.high - centers.low;
    let bin_of: [_; 3] = std::array::from_fn(|axis| binning(centers.low[axis], extent[axis]));
    let mut boxes = [[Bounds::EMPTY; BINS]; 3];
    let mut counts = [[0usize; BINS]; 3];
    // One pass for the three axes, because fetching the boxes is the cost.
    for &s in range.iter() {
        let b = surfaces[s as usize];
        for axis in 0..3 {
            let bin = bin_of[axis](b.low[axis] + b.high[axis]);
            boxes[axis][bin] = boxes[axis][bin].union(b);
            counts[axis][bin] += 1;
        }
    }
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        if extent[axis] <= 0.0 {
            continue;
        }
        let (boxes, counts) = (&boxes[axis], &counts[axis]);
        let mut left = [(0.0, 0usize); BINS];
        let (mut bounds, mut count) = (Bounds::EMPTY, 0);
        for bin in 0..BINS {
            bounds = bounds.union(boxes[bin]);
            count += counts[bin];
            left[bin] = (bounds.half_area(), count);
        }
        let (mut bounds, mut count) = (Bounds::EMPTY, 0);
        for bin in (1..BINS).rev() {
            bounds = bounds.union(boxes[bin]);
            count += counts[bin];
            let (left_area, left_count) = left[bin - 1];
            if left_count == 0 || count == 0 {
                continue;
            }
            // The cost of a leaf is its blocks, not its triangles.
            let blocks = |n: usize| n.div_ceil(LANES) as f64;
            let cost = left_area * blocks(left_count) + bounds.half_area() * blocks(count);
            if best.is_none_or(|(c, _, _)| cost < c) {
                best = Some((cost, axis, left_count));
            }
        }
    }
    let len = range.len();
    let (axis, mut first) = best.map_or((0, len / 2), |(_, axis, first)| (axis, first));
    // Whole blocks on one side keep the lanes full.
    first = ((first + LANES / 2) / LANES * LANES).clamp(LANES, (len - 1) / LANES * LANES);
    range.select_nth_unstable_by(first, |&p, &q| {
        let center = |s: u32| {
            let b = surfaces[s as usize];
            b.low[axis] + b.high[axis]
        };
        center(p).total_cmp(&center(q)).then(p.cmp(&q))
    });
    first
}

fn binning(low: f64, extent: f64) -> impl Fn(f64) -> usize {
    let scale = BINS as f64 / extent;
    move |center| {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates, then clamped"
        )]
        let bin = ((center - low) * scale) as usize;
        bin.min(BINS - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::generate::{Generate, Kind, generate};
    use hemicube_spatial::{Aabb, Octree, OctreeOptions};

    #[test]
    fn distances_to_a_triangle() {
        let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (p, d) in [
            (DVec3::new(0.2, 0.2, 3.0), 3.0),
            (DVec3::new(-3.0, -4.0, 0.0), 5.0),
            (DVec3::new(0.5, -2.0, 0.0), 2.0),
            (DVec3::new(3.0, 0.0, 0.0), 2.0),
            (DVec3::new(1.0, 1.0, 0.0), 0.5f64.sqrt()),
            (DVec3::new(0.0, 0.0, 0.0), 0.0),
        ] {
            assert!((distance(p, &t) - d).abs() < 1e-15, "{p}");
        }
    }

    /// A city of blocks, all of it one-sided.
    fn geometry(target_patches: u64) -> Geometry {
        let city = Generate {
            kind: Kind::BlockCity,
            target_patches,
            seed: 1,
        };
        let triangles: Vec<[DVec3; 3]> = generate(city)
            .expect("a city")
            .triangles
            .iter()
            .map(|t| t.corners)
            .collect();
        let largest = triangles
            .iter()
            .flatten()
            .fold(0.0, |most: f64, p| most.max(p.abs().max_element()));
        let corners: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|p| p / largest)).collect();
        let boxes: Vec<Aabb> = corners.iter().map(|&t| Aabb::from_points(t)).collect();
        let options = OctreeOptions {
            max_level: 6,
            min_items: 40,
        };
        let octree = Octree::build(&boxes, options).expect("an octree");
        let surface = |&place: &u32| Surface {
            corners: corners[place as usize],
            front: hemicube_scene::InputPatch(place),
            back: None,
        };
        let surfaces: Vec<Surface> = octree.order().iter().map(surface).collect();
        let patch_count = u32::try_from(surfaces.len()).expect("few");
        Geometry::new(surfaces, octree, patch_count, 1e-10)
    }

    #[test]
    fn every_surface_is_in_one_lane_and_every_box_holds_its_own() {
        let geometry = geometry(3000);
        for hierarchy in [Hierarchy::SurfaceArea, Hierarchy::Octree] {
            let tree = Tree::new(&geometry, hierarchy);
            let mut lanes_used = 0;
            let mut blocks_met = 0;
            let mut pending = vec![(0u32, None::<Node>)];
            while let Some((index, parent)) = pending.pop() {
                let node = tree.nodes[index as usize];
                if let Some(parent) = parent {
                    let over = (node.center - parent.center).abs() + node.half - parent.half;
                    assert!(over.max_element() < 1e-13, "a child sticks out of its parent");
                }
                if node.block == INNER {
                    pending.extend([(node.child, Some(node)), (node.child + 1, Some(node))]);
                    continue;
                }
                blocks_met += 1;
                let block = &tree.blocks[node.block as usize];
                for lane in (0..LANES).filter(|&l| block.negative[l] != UNUSED) {
                    lanes_used += 1;
                    for k in 0..3 {
                        let corner = DVec3::new(
                            block.corners[3 * k][lane],
                            block.corners[3 * k + 1][lane],
                            block.corners[3 * k + 2][lane],
                        );
                        assert!(((corner - node.center).abs() - node.half).max_element() <= 0.0);
                    }
                }
            }
            assert_eq!(blocks_met, tree.blocks.len());
            assert_eq!(lanes_used, geometry.surfaces.len());
            assert!(
                tree.slot_of_patch
                    .iter()
                    .all(|&slot| (slot as usize) < tree.blocks.len() * LANES)
            );
        }
    }

    #[test]
    fn pieces_change_nothing() {
        let geometry = geometry(40_000);
        let surfaces = &geometry.surfaces;
        assert!(surfaces.len() > 3 * PARALLEL_FROM);
        let boxes: Vec<Bounds> = surfaces.iter().map(|surface| Bounds::of(surface.corners)).collect();
        let tree = |pieces: usize| {
            let mut order: Vec<u32> = (0..u32::try_from(surfaces.len()).expect("few")).collect();
            let piece = cut(&boxes, &|s| surfaces[s as usize].front.0, &mut order, pieces);
            let nodes: Vec<_> = piece
                .nodes
                .iter()
                .map(|n| (n.center, n.half, n.child, n.block))
                .collect();
            (order, nodes, piece.leaves)
        };
        let alone = tree(1);
        for pieces in [2, 3, 8, 64] {
            assert!(tree(pieces) == alone, "{pieces} pieces");
        }
    }

    #[test]
    fn a_triangle_is_the_same_arithmetic_in_any_vertex_order() {
        let [a, b, c] = [
            DVec3::new(0.5, 0.0, -0.0),
            DVec3::new(0.5, 0.0, 0.3),
            DVec3::new(-1.0, 2.0, 0.0),
        ];
        let (sorted, flipped) = sorted_corners([a, b, c]);
        for (corners, turned) in [
            ([b, c, a], false),
            ([c, a, b], false),
            ([a, c, b], true),
            ([c, b, a], true),
        ] {
            let (again, again_flipped) = sorted_corners(corners);
            assert_eq!(
                sorted.map(|p| p.to_array().map(f64::to_bits)),
                again.map(|p| p.to_array().map(f64::to_bits))
            );
            assert_eq!(flipped ^ turned, again_flipped);
        }
    }
}
