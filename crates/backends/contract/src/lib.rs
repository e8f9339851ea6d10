//! The contract between the driver and a backend: hemicubes in, rows of integer weights out.
//!
//! A crate of its own, so that a backend compiles without the driver, the store and the closed forms. The driver's
//! crate, `hemicube`, has all of it under the same names.

pub mod backend;
pub mod bvh;
pub mod close;
pub mod delta;
pub mod escaped;
pub mod face;
pub mod outline;
pub mod row;

pub use hemicube_scene::InputPatch;
