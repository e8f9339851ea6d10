//! Visibility between two patches.
//!
//! A `shaft` lists the occluders between the two, as regions of coplanar surfaces (`coplanar`). An empty shaft proves
//! full visibility, a single region in front of all of it full occlusion. Rays decide the rest, against the list or,
//! where it is long, down the tree (`segments`, `wide`), or `exact` polygons from points; `bodies` tells which faces of
//! a convex body matter. `candidates` finds patches that could matter though no hemicube saw them. `spaces` tells which
//! patches no straight line can join, because a closed surface keeps them apart, and `screen` from which patches nothing
//! can be seen of given triangles.

pub(crate) mod bodies;
pub(crate) mod candidates;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod nearest;
pub(crate) mod screen;
pub(crate) mod segments;
pub(crate) mod shaft;
pub(crate) mod spaces;
pub(crate) mod wide;
