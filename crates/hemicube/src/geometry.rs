//! Triangles, as everything here measures them.

use glam::DVec3;

/// A triangle's area.
#[inline]
pub(crate) fn area([a, b, c]: &[DVec3; 3]) -> f64 {
    0.5 * (*b - *a).cross(*c - *a).length()
}
