//! Seeded random numbers: a hash, and points that fill a cube evenly.

pub(crate) mod sobol;
pub(crate) mod splitmix;
