//! The invariants of an octree, walked one by one.

use crate::Aabb;
use crate::morton::LEVEL_COUNT;
use crate::octree::{Fit, MAX_ITEM_COUNT, Node, Octree, deepest_fit, union_of};
use glam::DVec3;
use std::fmt;

/// The first defect found in an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ValidationError {
    /// No octree has these options or this cube.
    Frame,
    /// The number of items is not that of the boxes.
    ItemCount {
        /// Items in the order.
        items: usize,
        /// Boxes given.
        boxes: usize,
    },
    /// The order is no permutation: the entry at this place is out of range or a repetition.
    Order {
        /// The place in the order.
        place: usize,
    },
    /// A box is empty or not finite, so it can be in no octree.
    Box {
        /// Its input index.
        index: usize,
    },
    /// There is no root over items, a root over none, or the first node is no root.
    Root,
    /// The node's ranges of items do not nest, are empty, or do not follow on those of its siblings and its parent.
    Items {
        /// The node.
        node: usize,
    },
    /// The node's children are out of breadth-first order or name another parent, or it has too few items for children,
    /// or a single child that should be in its stead.
    Children {
        /// The node.
        node: usize,
    },
    /// Some nodes are no node's children.
    Orphans {
        /// The first of them.
        node: usize,
    },
    /// The node's level is not below its parent's, or is deeper than the maximum.
    Level {
        /// The node.
        node: usize,
    },
    /// The node's cell is not in its parent's, or not in a later octant than its sibling before.
    Cell {
        /// The node.
        node: usize,
    },
    /// An own item of the node sticks out of the node's cell, or in a loose octree more than it may.
    Outside {
        /// The node.
        node: usize,
        /// The item's place in the order.
        place: usize,
    },
    /// An own item fits a child of the node, and the node is subdivided or should be.
    TooHigh {
        /// The node.
        node: usize,
        /// The item's place in the order.
        place: usize,
    },
    /// The node's bounds, or those of its own items, are not the smallest box over the items.
    Bounds {
        /// The node.
        node: usize,
    },
}

impl fmt::Display for ValidationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame => write!(f, "the octree's `options` or `cube` are out of range")?,
            Self::ItemCount { items, boxes } => write!(f, "the octree has {items} items for {boxes} boxes")?,
            Self::Order { place } => write!(f, "`order` is no permutation: entry `{place}` is repeated or too large")?,
            Self::Box { index } => write!(f, "box `{index}` is empty or not finite")?,
            Self::Root => write!(f, "the octree's root is missing, misplaced or over no items")?,
            Self::Items { node } => write!(f, "node `{node}` has ranges of items that do not nest or follow on")?,
            Self::Children { node } => write!(f, "node `{node}` has children it should not have, or misplaced ones")?,
            Self::Orphans { node } => write!(f, "node `{node}` is no node's child")?,
            Self::Level { node } => write!(f, "node `{node}` has a level not below its parent's, or too deep")?,
            Self::Cell { node } => write!(f, "node `{node}` has a cell outside its parent's, or out of order")?,
            Self::Outside { node, place } => write!(f, "item `{place}` sticks out of the cell of its node `{node}`")?,
            Self::TooHigh { node, place } => write!(f, "item `{place}` belongs in a child of its node `{node}`")?,
            Self::Bounds { node } => write!(f, "node `{node}` has bounds that are not tight round its items")?,
        }
        f.write_str("; build the octree anew from these boxes")
    }
}

impl std::error::Error for ValidationError {}

/// Most that an item sticks out of its cell, in units of the root's edge: twice the tolerance of building, 2⁻²⁷, so
/// that the rounding of this other arithmetic does not matter.
const CELL_TOLERANCE: f64 = 1.0 / (1u64 << 26) as f64;

impl Octree {
    /// Checks that this is an octree of the boxes: the order is a permutation, ranges nest and follow on each other,
    /// nodes are in breadth-first order, levels and cells descend, own items are in the right cell and fit no child,
    /// and bounds are tight. Takes time in proportion to the items.
    ///
    /// # Errors
    /// [`ValidationError`] at the first defect.
    pub fn validate(&self, boxes: &[Aabb]) -> Result<(), ValidationError> {
        let options = self.options;
        let cube_is_fine =
            self.cube.origin.is_finite() && self.cube.half_edge.is_finite() && self.cube.half_edge >= 0.0;
        if options.max_level > LEVEL_COUNT || !cube_is_fine || boxes.len() > MAX_ITEM_COUNT {
            return Err(ValidationError::Frame);
        }
        self.validate_order(boxes)?;
        match (self.nodes.first(), self.order.is_empty()) {
            (None, true) => return Ok(()),
            (Some(root), false) => {
                if root.parent.is_some() || root.first_item != 0 || root.item_end as usize != self.order.len() {
                    return Err(ValidationError::Root);
                }
            }
            _ => return Err(ValidationError::Root),
        }
        let mut next_child = 1;
        for (index, node) in self.nodes.iter().enumerate() {
            self.validate_node(index, node)?;
            next_child = self.validate_children(index, node, next_child)?;
            self.validate_own(index, node, boxes)?;
        }
        if next_child < self.nodes.len() {
            return Err(ValidationError::Orphans { node: next_child });
        }
        self.validate_bounds(boxes)
    }

    fn validate_order(&self, boxes: &[Aabb]) -> Result<(), ValidationError> {
        if self.order.len() != boxes.len() {
            return Err(ValidationError::ItemCount {
                items: self.order.len(),
                boxes: boxes.len(),
            });
        }
        if let Some(index) = boxes.iter().position(|b| !b.is_finite() || b.is_empty()) {
            return Err(ValidationError::Box { index });
        }
        let mut seen = vec![false; boxes.len()];
        for (place, &index) in self.order.iter().enumerate() {
            match seen.get_mut(index as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(ValidationError::Order { place }),
            }
        }
        Ok(())
    }

    /// Checks a node on its own: its ranges, its level, and a cell of that level.
    fn validate_node(&self, index: usize, node: &Node) -> Result<(), ValidationError> {
        let nested = node.first_item <= node.own_end && node.own_end <= node.item_end;
        if !nested || node.all().is_empty() || node.item_end as usize > self.order.len() {
            return Err(ValidationError::Items { node: index });
        }
        if node.level > self.options.max_level {
            return Err(ValidationError::Level { node: index });
        }
        if node.cell.iter().any(|&c| c >> node.level != 0) {
            return Err(ValidationError::Cell { node: index });
        }
        Ok(())
    }

    /// Checks a node with its children, due to begin at `next_child`; returns the beginning of the next node's.
    fn validate_children(&self, index: usize, node: &Node, next_child: usize) -> Result<usize, ValidationError> {
        if node.is_leaf() {
            let complete = node.own_end == node.item_end;
            return if complete {
                Ok(next_child)
            } else {
                Err(ValidationError::Items { node: index })
            };
        }
        let misplaced = ValidationError::Children { node: index };
        let end = next_child.saturating_add(node.child_count as usize);
        let few = node.all().len() <= self.options.min_items as usize || node.level >= self.options.max_level;
        let chain = node.own().is_empty() && node.child_count == 1;
        if few || chain || node.first_child as usize != next_child || next_child <= index {
            return Err(misplaced);
        }
        let children = self.nodes.get(next_child..end).ok_or(misplaced)?;
        let mut item_end = node.own_end;
        let mut octant_before = None;
        for (number, child) in (next_child..).zip(children) {
            if child.parent.map(|parent| parent as usize) != Some(index) {
                return Err(misplaced);
            }
            if child.first_item != item_end {
                return Err(ValidationError::Items { node: number });
            }
            item_end = child.item_end;
            let octant = child.octant_beneath(node.level);
            if octant.is_none() || child.level > self.options.max_level {
                return Err(ValidationError::Level { node: number });
            }
            let shift = child.level - node.level;
            if child.cell.map(|c| c >> shift) != node.cell || octant <= octant_before {
                return Err(ValidationError::Cell { node: number });
            }
            octant_before = octant;
        }
        if item_end == node.item_end {
            Ok(end)
        } else {
            Err(ValidationError::Items { node: index })
        }
    }

    /// Checks the node's own items against its cell, by other arithmetic than building.
    fn validate_own(&self, index: usize, node: &Node, boxes: &[Aabb]) -> Result<(), ValidationError> {
        let scale = (-f64::from(node.level)).exp2();
        let [x, y, z] = node.cell.map(|c| f64::from(c) * scale);
        let (low, high) = (
            DVec3::new(x, y, z) - CELL_TOLERANCE,
            DVec3::new(x, y, z) + scale + CELL_TOLERANCE,
        );
        let must_subdivide = node.all().len() > self.options.min_items as usize && node.level < self.options.max_level;
        for place in node.own() {
            let place = place as usize;
            let Some(item) = self.order.get(place).and_then(|&item| boxes.get(item as usize)) else {
                return Err(ValidationError::Items { node: index });
            };
            let sticks_out = match self.fit {
                Fit::Whole => {
                    let unit = [item.min, item.max].map(|corner| self.cube.unit_position(corner));
                    // In a cube without extent the quotients are NaN for its point, infinite for the rest.
                    (unit[0].cmplt(low) | unit[1].cmpgt(high)).any()
                }
                Fit::Loose => {
                    let middle = self.cube.unit_position(item.center());
                    let edge = item.half_extent().max_element() / self.cube.half_edge;
                    (middle.cmplt(low) | middle.cmpgt(high)).any() || edge > scale + 2.0 * CELL_TOLERANCE
                }
            };
            if sticks_out {
                return Err(ValidationError::Outside { node: index, place });
            }
            if must_subdivide && deepest_fit(item, &self.cube, self.fit, self.options.max_level).0 > node.level {
                return Err(ValidationError::TooHigh { node: index, place });
            }
        }
        Ok(())
    }

    /// All bounds, from the last node to the first. Exact: the smallest and largest of the same numbers.
    fn validate_bounds(&self, boxes: &[Aabb]) -> Result<(), ValidationError> {
        for (index, node) in self.nodes.iter().enumerate().rev() {
            let slice = |range: std::ops::Range<u32>| range.start as usize..range.end as usize;
            let own = self.order.get(slice(node.own())).unwrap_or_default();
            let children = if node.is_leaf() {
                &[]
            } else {
                self.nodes.get(slice(node.children())).unwrap_or_default()
            };
            let own_bounds = union_of(boxes, own);
            let bounds = children
                .iter()
                .fold(own_bounds, |bounds, child| bounds.union(child.bounds));
            if node.own_bounds != own_bounds || node.bounds != bounds {
                return Err(ValidationError::Bounds { node: index });
            }
        }
        Ok(())
    }
}
