//! An octree over boxes, as one sorted array of items and one array of nodes.
//!
//! The cells are the halvings of the cube over all boxes ([`Cube::around`]). A box fits a cell if it lies wholly in it,
//! borders included; the deepest fitting cell follows from the first bit in which the quantised corners differ. In a
//! loose octree (Ulrich 2000, "Loose octrees", Game Programming Gems) it fits if its middle is in the cell and no edge
//! is longer than the cell's, so that size alone decides on the level. Sorting the items by that cell's Morton code, a
//! shallower cell before the deeper ones with the same code, gives the order of the finished octree, with one
//! contiguous range for every node:
//!
//! ```text
//! items   [ own │ octant 0 │ octant 2 │ octant 7 ]      of one node: own() then the ranges of its children
//! nodes   root │ its children │ the children of the first of them │ …      breadth first
//! ```
//!
//! Parameters: maximum level and minimum items of a subdivided node, like the maximum level and the minimum of patches
//! of Vázquez and Guartes 2017. Two departures: bounds are tight round the items rather than the cells, and a node with
//! all items in one child takes that child's cell in its stead, so that boxes in a heap make no chain of nodes and
//! there are never more than two nodes for each item.

use crate::morton::{CELL_COUNT, Cube, LEVEL_COUNT, encode, quantise};
use crate::{Aabb, ValidationError, whole};
use glam::DVec3;
use std::fmt;
use std::ops::Range;

/// The most boxes of an octree, 2³¹: so its nodes, at most two for each, have 32-bit numbers.
pub const MAX_ITEM_COUNT: usize = 1 << 31;

/// Most that a fitting box sticks out of its cell, in edges of the finest cell: 2⁻⁶, or 2⁻²⁷ of the root's edge.
/// Without it, rounding of the coordinates would leave boxes that tile a cell's border with its parent.
const FIT_TOLERANCE: f64 = 1.0 / 64.0;

/// When a node is subdivided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OctreeOptions {
    /// The level of the smallest cells, at most [`LEVEL_COUNT`]; the root is level 0.
    pub max_level: u32,
    /// A node is subdivided when it has more items than this.
    pub min_items: u32,
}

/// All levels, and 32 items: an embedder's start. The best choice depends on the cost of an item against that of a
/// node.
impl Default for OctreeOptions {
    fn default() -> Self {
        Self {
            max_level: LEVEL_COUNT,
            min_items: 32,
        }
    }
}

/// The rule by which a box fits a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// The box lies wholly in the cell: see [`Octree::build`].
    Whole,
    /// The box's middle is in the cell, and no edge of it is longer than the cell's: see [`Octree::build_loose`].
    Loose,
}

/// Why an octree was not built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OctreeError {
    /// A box has an infinite bound or a NaN.
    NonFinite {
        /// Its index in the input.
        index: usize,
    },
    /// A box is empty: its `min` exceeds its `max` on some axis.
    EmptyBox {
        /// Its index in the input.
        index: usize,
    },
    /// `max_level` is more than [`LEVEL_COUNT`].
    Level {
        /// The level asked for.
        max_level: u32,
    },
    /// There are more boxes than [`MAX_ITEM_COUNT`].
    TooMany {
        /// Their number.
        count: usize,
    },
}

impl fmt::Display for OctreeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFinite { index } => {
                write!(
                    f,
                    "box `{index}` has a bound that is infinite or NaN; drop it or mend it before building"
                )
            }
            Self::EmptyBox { index } => {
                write!(
                    f,
                    "box `{index}` is empty, its `min` exceeds its `max`; drop it or mend it before building"
                )
            }
            Self::Level { max_level } => {
                write!(
                    f,
                    "`max_level` {max_level} is too deep; a position has {LEVEL_COUNT} bits, so ask for no more"
                )
            }
            Self::TooMany { count } => {
                write!(
                    f,
                    "{count} boxes are more than the {MAX_ITEM_COUNT} that an octree can number; split them"
                )
            }
        }
    }
}

impl std::error::Error for OctreeError {}

/// A node of an [`Octree`]. Item numbers are places in [`Octree::order`], node numbers places in [`Octree::nodes`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// The smallest box over all items beneath this node.
    pub bounds: Aabb,
    /// The smallest box over the node's own items, [`Aabb::EMPTY`] if it has none.
    pub own_bounds: Aabb,
    /// The node's cell, counted from the cube's origin in cells of its level.
    pub cell: [u32; 3],
    /// The level of the cell, 0 for the whole cube. At least one more than the parent's.
    pub level: u32,
    /// The first item beneath this node.
    pub first_item: u32,
    /// One past the last of the node's own items.
    pub own_end: u32,
    /// One past the last item beneath this node.
    pub item_end: u32,
    /// The first child; meaningless in a leaf.
    pub first_child: u32,
    /// Number of children: only octants with items have a node.
    pub child_count: u32,
    /// The parent; `None` for the root.
    pub parent: Option<u32>,
}

impl Node {
    /// The node's own items: all items of a leaf, otherwise the items that fit no child.
    pub fn own(&self) -> Range<u32> {
        self.first_item..self.own_end
    }

    /// All items beneath this node: its own, then its children's.
    pub fn all(&self) -> Range<u32> {
        self.first_item..self.item_end
    }

    /// The node numbers of the children, in Morton order of their octants.
    pub fn children(&self) -> Range<u32> {
        self.first_child..self.first_child.saturating_add(self.child_count)
    }

    /// Returns whether there are no children.
    pub fn is_leaf(&self) -> bool {
        self.child_count == 0
    }

    /// The octant of an ancestor's cell with this node's cell: bit 0 for the upper half in x, 1 in y, 2 in z.
    pub(crate) fn octant_beneath(&self, ancestor_level: u32) -> Option<usize> {
        let shift = self.level.checked_sub(ancestor_level.checked_add(1)?)?;
        let [x, y, z] = self.cell.map(|c| (c.checked_shr(shift).unwrap_or(0) & 1) as usize);
        Some(x | y << 1 | z << 2)
    }
}

/// An octree over boxes. It keeps their order and the nodes, not the boxes or their contents.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    pub(crate) fit: Fit,
    pub(crate) options: OctreeOptions,
    pub(crate) cube: Cube,
    pub(crate) order: Vec<u32>,
    pub(crate) nodes: Vec<Node>,
}

impl Octree {
    /// Builds the octree of a set of boxes; of none, an octree without nodes.
    ///
    /// The own items of each node are in Morton order of their middles (as far as nine levels below the node), ties by
    /// input index; a leaf's are in the order of further subdivision. The result depends on the input only.
    ///
    /// # Errors
    /// [`OctreeError`] when a box is not finite or empty, `max_level` is too deep, or there are too many boxes.
    ///
    /// ```
    /// use hemicube_spatial::{Aabb, Octree, OctreeError, OctreeOptions, glam::DVec3};
    /// let boxes = [0.0, 1.0, f64::NAN].map(|x| Aabb::from_points([DVec3::splat(x)]));
    /// let options = OctreeOptions { max_level: 4, min_items: 1 };
    /// assert_eq!(Octree::build(&boxes, options), Err(OctreeError::NonFinite { index: 2 }));
    /// let octree = Octree::build(&boxes[..2], options)?;
    /// assert_eq!(octree.nodes().len(), 3);
    /// # Ok::<(), OctreeError>(())
    /// ```
    pub fn build(boxes: &[Aabb], options: OctreeOptions) -> Result<Self, OctreeError> {
        Self::build_with(boxes, Fit::Whole, options)
    }

    /// Builds a loose octree: like [`build`](Self::build), but a box goes into the octant of its middle unless one of
    /// its edges is longer than that octant's. Few boxes are left in nodes with children, so culling is much sharper
    /// for boxes that are not small beside the cells, the usual case for scenes of triangles. In exchange sibling nodes
    /// overlap by up to half a cell, and the order of [`visit_front_to_back`](Self::visit_front_to_back) holds for the
    /// boxes' middles only.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn build_loose(boxes: &[Aabb], options: OctreeOptions) -> Result<Self, OctreeError> {
        Self::build_with(boxes, Fit::Loose, options)
    }

    fn build_with(boxes: &[Aabb], fit: Fit, options: OctreeOptions) -> Result<Self, OctreeError> {
        if options.max_level > LEVEL_COUNT {
            return Err(OctreeError::Level {
                max_level: options.max_level,
            });
        }
        if boxes.len() > MAX_ITEM_COUNT {
            return Err(OctreeError::TooMany { count: boxes.len() });
        }
        let mut bounds = Aabb::EMPTY;
        for (index, b) in boxes.iter().enumerate() {
            if !b.is_finite() {
                return Err(OctreeError::NonFinite { index });
            }
            if b.is_empty() {
                return Err(OctreeError::EmptyBox { index });
            }
            bounds = bounds.union(*b);
        }
        if boxes.is_empty() {
            return Ok(Self {
                fit,
                options,
                cube: Cube {
                    origin: DVec3::ZERO,
                    half_edge: 0.0,
                },
                order: Vec::new(),
                nodes: Vec::new(),
            });
        }
        let cube = Cube::around(bounds);
        let mut keys: Vec<u128> = (0..u32::MAX)
            .zip(boxes)
            .map(|(index, b)| Key::new(index, b, &cube, fit, options.max_level).0)
            .collect();
        keys.sort_unstable();
        let order = keys.iter().map(|&key| Key(key).index()).collect();
        let mut octree = Self {
            fit,
            options,
            cube,
            order,
            nodes: subdivide(&keys, options),
        };
        octree.fit_bounds(boxes);
        Ok(octree)
    }

    /// An octree from its parts, for instance as read from a file, once [`validate`](Self::validate) has found it to be
    /// an octree of these boxes.
    ///
    /// # Errors
    /// [`ValidationError`] at the first defect.
    pub fn from_parts(
        fit: Fit,
        options: OctreeOptions,
        cube: Cube,
        order: Vec<u32>,
        nodes: Vec<Node>,
        boxes: &[Aabb],
    ) -> Result<Self, ValidationError> {
        let octree = Self {
            fit,
            options,
            cube,
            order,
            nodes,
        };
        octree.validate(boxes)?;
        Ok(octree)
    }

    /// The largest fitting box, in edges of the cell.
    pub fn fit(&self) -> Fit {
        self.fit
    }

    /// The parameters it was built with.
    pub fn options(&self) -> OctreeOptions {
        self.options
    }

    /// The cell of level 0.
    pub fn cube(&self) -> Cube {
        self.cube
    }

    /// The items in the octree's order: `order()[k]` is the input index of the k-th.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The nodes, breadth first: the root, if there is any item, then its children, then theirs. A child's number is
    /// above its parent's.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Sets all bounds, from the last node to the first, so that children are ready before their parent.
    fn fit_bounds(&mut self, boxes: &[Aabb]) {
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            let own_bounds = union_of(boxes, &self.order[node.first_item as usize..node.own_end as usize]);
            let children = &self.nodes[node.first_child as usize..][..node.child_count as usize];
            let bounds = children
                .iter()
                .fold(own_bounds, |bounds, child| bounds.union(child.bounds));
            self.nodes[index].own_bounds = own_bounds;
            self.nodes[index].bounds = bounds;
        }
    }
}

/// The smallest box over the named boxes; names without a box count for nothing.
pub(crate) fn union_of(boxes: &[Aabb], indices: &[u32]) -> Aabb {
    indices
        .iter()
        .filter_map(|&index| boxes.get(index as usize))
        .fold(Aabb::EMPTY, |bounds, b| bounds.union(*b))
}

/// The deepest fitting cell of a box, down to `max_level`: its level, and its position in finest cells, with only the
/// bits down to that level set.
pub(crate) fn deepest_fit(bounds: &Aabb, cube: &Cube, fit: Fit, max_level: u32) -> (u32, [u32; 3]) {
    let cell_of = |x: f64| whole::to_u32(x).min(CELL_COUNT - 1);
    let in_cells = |corner: DVec3| cube.unit_position(corner) * f64::from(CELL_COUNT);
    let (low, high) = (in_cells(bounds.min), in_cells(bounds.max));
    // The finest cell with the box's beginning, and the bits to drop until a cell holds all of it.
    let (first, excess) = match fit {
        Fit::Whole => {
            // The upper border belongs to the lower cell: hence the ceiling less one, but for a flat box on the border.
            let (low, high) = (low + FIT_TOLERANCE, (high - FIT_TOLERANCE).ceil() - 1.0);
            let first = low.to_array().map(cell_of);
            let last = high.to_array().map(cell_of);
            let differing = first
                .iter()
                .zip(last)
                .fold(0, |bits, (&first, last)| bits | (first ^ last.max(first)));
            (first, differing)
        }
        Fit::Loose => {
            let edge = ((high - low).max_element() - FIT_TOLERANCE).ceil() - 1.0;
            let middle = cube.unit_position(bounds.center()).to_array();
            (middle.map(quantise), cell_of(edge))
        }
    };
    let level = (LEVEL_COUNT - (u32::BITS - excess.leading_zeros())).min(max_level);
    let shift = LEVEL_COUNT - level;
    (level, first.map(|c| c >> shift << shift))
}

/// An item's place in the octree's order, as one integer:
///
/// ```text
/// bits  127 … 65                64 … 60      59 … 32                        31 … 0
///       code of its cell (63)   level (5)    middle, nine levels on (28)    input index (32)
/// ```
#[derive(Clone, Copy)]
struct Key(u128);

impl Key {
    fn new(index: u32, bounds: &Aabb, cube: &Cube, fit: Fit, max_level: u32) -> Self {
        let (level, cell) = deepest_fit(bounds, cube, fit, max_level);
        let middle = cube.position_code(bounds.center());
        // The 3·level leading bits of the middle are those of the cell; the next 28 go into the key.
        let middle = (middle << 1).checked_shl(3 * level).unwrap_or(0) >> 36;
        Self(u128::from(encode(cell)) << 65 | u128::from(level) << 60 | u128::from(middle) << 32 | u128::from(index))
    }

    #[allow(clippy::cast_possible_truncation, reason = "the low 32 bits")]
    fn index(self) -> u32 {
        self.0 as u32
    }

    #[allow(clippy::cast_possible_truncation, reason = "the high 63 bits")]
    fn code(self) -> u64 {
        (self.0 >> 65) as u64
    }

    #[allow(clippy::cast_possible_truncation, reason = "5 bits")]
    fn level(self) -> u32 {
        (self.0 >> 60) as u32 & 31
    }

    /// The octant of this item's cell in the enclosing cell of the level above `level`.
    fn octant(self, level: u32) -> u64 {
        self.code() >> (3 * (LEVEL_COUNT - level)) & 7
    }
}

/// The nodes over sorted keys, but for their bounds.
fn subdivide(keys: &[u128], options: OctreeOptions) -> Vec<Node> {
    let mut nodes = vec![new_node(keys, 0, keys.len(), 0, None, options)];
    let mut next = 0;
    while let Some(&node) = nodes.get(next) {
        let (own_end, end) = (node.own_end as usize, node.item_end as usize);
        let first_child = as_u32(nodes.len());
        let level = node.level + 1;
        let mut start = own_end;
        while start < end {
            let octant = Key(keys[start]).octant(level);
            let count = keys[start..end].partition_point(|&key| Key(key).octant(level) == octant);
            nodes.push(new_node(keys, start, start + count, level, Some(as_u32(next)), options));
            start += count;
        }
        nodes[next].first_child = first_child;
        nodes[next].child_count = as_u32(nodes.len()) - first_child;
        next += 1;
    }
    nodes
}

/// The node over the keys from `start` to `end`; all fit one cell of `level`.
fn new_node(keys: &[u128], start: usize, end: usize, level: u32, parent: Option<u32>, options: OctreeOptions) -> Node {
    let (first, last) = (Key(keys[start]), Key(keys[end - 1]));
    let subdivided = end - start > options.min_items as usize;
    let level = if subdivided {
        // The deepest cell that fits all. The codes are sorted, so digits shared by the first and the last are shared
        // by all; and an item fitting no deeper than those has the lowest code and the lowest level, so it is the
        // first.
        let shared = ((first.code() ^ last.code()).leading_zeros() - 1) / 3;
        shared.min(first.level())
    } else {
        level
    };
    let own_count = if subdivided {
        keys[start..end].partition_point(|&k| Key(k).level() == level)
    } else {
        end - start
    };
    let shift = LEVEL_COUNT - level;
    Node {
        bounds: Aabb::EMPTY,
        own_bounds: Aabb::EMPTY,
        cell: crate::morton::decode(first.code()).map(|c| c >> shift),
        level,
        first_item: as_u32(start),
        own_end: as_u32(start + own_count),
        item_end: as_u32(end),
        first_child: 0,
        child_count: 0,
        parent,
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "at most 2³¹ items, and two nodes for each, see MAX_ITEM_COUNT"
)]
fn as_u32(count: usize) -> u32 {
    count as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_cube() -> Cube {
        Cube {
            origin: DVec3::ZERO,
            half_edge: 0.5,
        }
    }

    fn cube_at(x: f64, edge: f64) -> Aabb {
        Aabb {
            min: DVec3::splat(x),
            max: DVec3::splat(x + edge),
        }
    }

    #[test]
    fn a_box_fits_the_cell_whose_borders_it_touches() {
        let fit = |b: Aabb| deepest_fit(&b, &unit_cube(), Fit::Whole, 21);
        assert_eq!(fit(cube_at(0.0, 1.0)).0, 0);
        assert_eq!(fit(cube_at(0.0, 0.5)), (1, [0; 3]));
        assert_eq!(fit(cube_at(0.5, 0.5)), (1, [1 << 20; 3]));
        assert_eq!(fit(cube_at(0.25, 0.25)), (2, [1 << 19; 3]));
        assert_eq!(fit(cube_at(0.25, 0.5)).0, 0, "astride the middle");
        assert_eq!(
            fit(cube_at(0.5, 0.0)),
            (21, [1 << 20; 3]),
            "a point on the border is in the upper cell"
        );
        assert_eq!(
            fit(cube_at(1.0, 0.0)),
            (21, [CELL_COUNT - 1; 3]),
            "but in the last at the cube's own"
        );
        assert_eq!(
            deepest_fit(&cube_at(0.0, 0.1), &unit_cube(), Fit::Whole, 2),
            (2, [0; 3]),
            "no deeper than asked"
        );
    }

    #[test]
    fn a_box_fits_loosely_by_its_size_alone() {
        let fit = |x, edge| deepest_fit(&cube_at(x, edge), &unit_cube(), Fit::Loose, 21);
        assert_eq!(fit(0.0, 1.0).0, 0);
        assert_eq!(fit(0.25, 0.5), (1, [1 << 20; 3]), "astride the middle");
        assert_eq!(fit(0.375 - 1e-3, 0.25), (2, [1 << 19; 3]));
        assert_eq!(fit(0.1, 0.25 + 1e-6).0, 1, "an edge too long");
        assert_eq!(fit(0.1, 0.25 + 1e-9).0, 2, "by rounding only");
        assert_eq!(fit(1.0, 0.0), (21, [CELL_COUNT - 1; 3]));
    }

    #[test]
    fn rounding_does_not_push_a_box_out_of_its_cell() {
        let nudge = 1e-9;
        let b = Aabb {
            min: DVec3::splat(0.25 - nudge),
            max: DVec3::splat(0.5 + nudge),
        };
        assert_eq!(deepest_fit(&b, &unit_cube(), Fit::Whole, 21), (2, [1 << 19; 3]));
        let b = Aabb {
            min: DVec3::splat(0.25 - 1e-7),
            max: DVec3::splat(0.5),
        };
        assert_eq!(
            deepest_fit(&b, &unit_cube(), Fit::Whole, 21).0,
            1,
            "more than the tolerance"
        );
    }

    #[test]
    fn node_stays_small() {
        assert!(size_of::<Node>() <= 144);
    }
}
