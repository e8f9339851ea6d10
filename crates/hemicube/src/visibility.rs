//! Visibility between two patches.
//!
//! A `shaft` lists the occluders between the two, as regions of coplanar surfaces (`coplanar`). An empty shaft proves
//! that all is visible, one blocked by a single region that nothing is. Rays decide the rest, against the list or,
//! where it is long, down the tree (`segments`), or `exact` polygons from points. `candidates` finds patches that could
//! matter though no hemicube saw them.

pub(crate) mod candidates;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod segments;
pub(crate) mod shaft;
