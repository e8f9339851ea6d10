//! What two patches see of each other.
//!
//! A `shaft` between the two lists what may come in between, as regions of surfaces that are coplanar (`coplanar`). An
//! empty one proves that all is visible, one blocked by a single region that nothing is; rays decide the rest, against
//! the list or, where it is long, down the tree (`segments`), or `exact` polygons from points. `candidates` finds
//! patches that could matter though no hemicube saw them.

pub(crate) mod candidates;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod segments;
pub(crate) mod shaft;
