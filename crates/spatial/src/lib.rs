//! Boxes in Morton order, an octree over them, and frustum culling with three outcomes.
//!
//! The crate orders and culls *boxes*, whatever is in them: triangles, particles, tiles of a map. Everything is in f64,
//! and no function allocates more than a small multiple of its input.
//!
//! # Where to start
//!
//! 1. Put a box round each of your things: [`Aabb::from_points`].
//! 2. [`Octree::build`] sorts them. The octree does not hold your things; it hands back a permutation,
//!    [`Octree::order`], in which everything beneath a node is one contiguous range. Lay your own arrays out in that
//!    order once, and every answer below is a slice of them. [`Octree::build_loose`] culls more sharply; its nodes
//!    overlap.
//! 3. [`Octree::cull`] with a [`Frustum`] gives the ranges that are wholly inside and those that may straddle the
//!    border; [`Octree::visit_front_to_back`] walks the nodes outwards from a point, and lets you skip what is hidden.
//!
//! ```
//! use hemicube_spatial::glam::DVec3;
//! use hemicube_spatial::{Aabb, Containment, Frustum, Octree, OctreeOptions};
//!
//! // A row of unit boxes along x.
//! let boxes: Vec<Aabb> = (0..1000)
//!     .map(|i| Aabb::from_points([DVec3::new(f64::from(i), 0.0, 0.0), DVec3::new(f64::from(i) + 1.0, 1.0, 1.0)]))
//!     .collect();
//! let octree = Octree::build(&boxes, OctreeOptions { max_level: 10, min_items: 16 })?;
//!
//! // Looking along +x from the middle of the row: half of it lies behind.
//! let eye = DVec3::new(500.25, 0.5, 0.5);
//! let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(y, z)| DVec3::new(1.0, y, z));
//! let frustum = Frustum::pyramid(eye, corners)?;
//!
//! let (mut inside, mut straddling) = (0, 0);
//! let counters = octree.cull(&frustum, |items, containment| match containment {
//!     Containment::Inside => inside += items.len(),
//!     _ => straddling += items.len(),
//! });
//! assert!(inside > 400 && inside + straddling < 600);
//! assert_eq!(counters.items_culled, 1000 - (inside + straddling) as u64);
//!
//! // The items of a range are positions in the octree's order; this is how they lead back to the input.
//! let first_box = boxes[octree.order()[0] as usize];
//! assert!(octree.nodes()[0].bounds.contains_box(&first_box));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! To order things without a hierarchy, for the cache's sake, see [`order_by_normal_and_position`] and
//! [`order_by_position`]; the codes themselves are in [`morton`].
//!
//! # What it promises
//!
//! - **Culling is conservative.** [`Containment::Outside`] and [`Containment::Inside`] are proofs that hold for the
//!   numbers as given, rounding included; all else is [`Containment::Straddling`].
//! - **Deterministic.** An order or an octree is a function of its input alone: ties go to the smaller index, and no
//!   thread, hash or address enters.
//! - **Bad input ends in an error**, never in a panic or an endless loop: a NaN in a box is refused by
//!   [`Octree::build`] and its index named. What panics says so under *Panics*, and is a caller's slip.
//! - **The structure can be checked**: [`Octree::validate`] walks every invariant, and [`Octree::from_parts`] accepts
//!   a stored octree only when they hold.
//!
//! The only dependency is [`glam`], re-exported so that embedders take the same version; only [`glam::DVec3`] appears
//! in the interface.

mod aabb;
mod cull;
mod frustum;
pub mod morton;
mod octree;
mod order;
/// For the kernels of the crates beside this one: it changes without notice.
#[doc(hidden)]
pub mod simd;
mod validate;
pub mod whole;

pub use aabb::Aabb;
pub use cull::{CullCounters, Visit};
pub use frustum::{Containment, Frustum, Plane, PyramidError};
pub use glam;
pub use octree::{Fit, MAX_ITEM_COUNT, Node, Octree, OctreeError, OctreeOptions};
pub use order::{invert, order_by_normal_and_position, order_by_position};
pub use validate::ValidationError;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
