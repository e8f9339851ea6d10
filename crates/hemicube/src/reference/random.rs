//! Streams of random numbers by keys, and points of a triangle from pairs of them.

use crate::sampling::splitmix;
use glam::DVec3;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub(super) struct Random(u64);

impl Random {
    /// The stream of these keys.
    pub(super) fn of(keys: &[u64]) -> Self {
        let mut stream = Self(0x6A09_E667_F3BC_C908);
        for &key in keys {
            stream.0 ^= key;
            stream.0 = stream.next();
        }
        stream
    }

    pub(super) fn next(&mut self) -> u64 {
        splitmix::next(&mut self.0)
    }

    /// Evenly in (0, 1), never an end: no point lies on an edge.
    pub(super) fn unit(&mut self) -> f64 {
        ((self.next() >> 12) as f64 + 0.5) / (1u64 << 52) as f64
    }
}

/// Maps a point of the unit square to a triangle, areas in proportion. Strata of the square become strata of the
/// triangle.
pub(super) fn point_of([a, b, c]: &[DVec3; 3], u: f64, v: f64) -> DVec3 {
    let s = u.sqrt();
    *a * (1.0 - s) + *b * (s * (1.0 - v)) + *c * (s * v)
}
