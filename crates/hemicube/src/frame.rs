//! Position and rotation of hemicubes on their patch. All in f64: rounding world coordinates to f32 before the rigid
//! transform gives the emitter's own plane a large part of the row, and the row still sums to 1.
//!
//! No hemicubes turned by any angle, because boxes along the scene's axes then lie across the pixels of the faces, and
//! culling by boxes leaves a fifth more. No hemicubes without a turn, because an edge may then run along a whole row of
//! pixel centres, and all of them err the same way. `frame::MOST_TURN` is in between: visible fractions err by a
//! twentieth more at most, pixel sums of an aligned room by a tenth in the median.

use crate::sampling::splitmix;
use glam::DVec3;
use hemicube_scene::{Axis, InputPatch};

/// Tangent, bitangent and normal of a triangle, orthonormal and right-handed: the tangent along its first edge, then
/// turned about the normal by `turn` (0 to 1: 0° to 90°, after which a hemicube repeats itself).
///
/// The turn is the rational parametrisation of the circle, cos = (1−t²)/(1+t²), sin = 2t/(1+t²): frames are the same
/// bits on every platform. Returns `None` for a triangle without area.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::frame::{axes, turn};
/// use hemicube_spatial::glam::DVec3;
///
/// let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
/// assert_eq!(axes(triangle, 0.0), Some([DVec3::X, DVec3::Y, DVec3::Z]));
///
/// // A patch's own turn leaves the normal where it is, and the frame right-handed.
/// let [tangent, bitangent, normal] = axes(triangle, turn(InputPatch(7))).ok_or("no area")?;
/// assert!(normal == DVec3::Z && tangent != DVec3::X);
/// assert!(tangent.cross(bitangent).distance(normal) < 1e-15);
/// assert_eq!(axes([DVec3::ZERO, DVec3::X, DVec3::X * 2.0], 0.0), None);
/// # Ok::<(), &str>(())
/// ```
pub fn axes([a, b, c]: [DVec3; 3], turn: f64) -> Option<[DVec3; 3]> {
    // Edges first brought to unit length: the square of a tiny edge must not underflow.
    let (e, f) = ((b - a).try_normalize()?, (c - a).try_normalize()?);
    let normal = e.cross(f).try_normalize()?;
    let bitangent = normal.cross(e).try_normalize()?;
    let tangent = bitangent.cross(normal);
    let t2 = turn * turn;
    let (cosine, sine) = ((1.0 - t2) / (1.0 + t2), 2.0 * turn / (1.0 + t2));
    Some([
        tangent * cosine + bitangent * sine,
        bitangent * cosine - tangent * sine,
        normal,
    ])
}

/// [`axes`] about a given normal: the tangent lies in the plane of the normal and its farthest axis. Returns `None` for
/// a normal without length.
pub fn axes_of(normal: DVec3, turn: f64) -> Option<[DVec3; 3]> {
    let normal = normal.try_normalize()?;
    let [x, y, z] = normal.abs().to_array();
    let farthest = if x <= y && x <= z {
        DVec3::X
    } else if y <= z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let bitangent = normal.cross(farthest).try_normalize()?;
    axes([DVec3::ZERO, bitangent.cross(normal), bitangent], turn)
}

/// The turn of a patch's hemicube: a hash of its id, within [`MOST_TURN`]. Turning each hemicube differently
/// decorrelates the aliasing of neighbouring rows.
pub fn turn(patch: InputPatch) -> f64 {
    let drawn = splitmix::unit(splitmix::hash((u64::from(patch.0) + 1).wrapping_mul(splitmix::STEP)));
    MOST_TURN * (2.0 * drawn - 1.0)
}

/// Bound of [`turn`] either way: 11° from the scene's axes. See the head of this module for the choice.
pub const MOST_TURN: f64 = 0.1;

/// Directions of east, north and up: unit vectors, east × north = up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// East.
    pub east: DVec3,
    /// North.
    pub north: DVec3,
    /// Up.
    pub up: DVec3,
    /// True where the ground hides what is below; false in space.
    pub has_ground: bool,
}

impl Horizon {
    /// The horizon of a scene with the axis `up` pointing up, and north turned clockwise, seen from above, by `turn`
    /// degrees. North is +y with z up, −z with y up (x is east in both), and +z with x up (y is east).
    pub fn new(up: Axis, turn: f64) -> Self {
        let (east, north, up) = match up {
            Axis::Z => (DVec3::X, DVec3::Y, DVec3::Z),
            Axis::Y => (DVec3::X, DVec3::NEG_Z, DVec3::Y),
            Axis::X => (DVec3::Y, DVec3::Z, DVec3::X),
        };
        let (sine, cosine) = turn.to_radians().sin_cos();
        Self {
            north: north * cosine + east * sine,
            east: east * cosine - north * sine,
            up,
            has_ground: true,
        }
    }

    /// The same directions, and nothing below that hides a sun: in space.
    #[must_use]
    pub fn without_ground(self) -> Self {
        Self {
            has_ground: false,
            ..self
        }
    }

    /// Returns whether a direction is below the ground.
    pub fn is_below(&self, direction: DVec3) -> bool {
        self.has_ground && direction.dot(self.up) < 0.0
    }

    /// The direction with these parts along east, north and up.
    pub fn direction(&self, [east, north, up]: [f64; 3]) -> DVec3 {
        self.east * east + self.north * north + self.up * up
    }

    /// A direction by its parts along east, north and up.
    pub(crate) fn local(&self, direction: DVec3) -> DVec3 {
        DVec3::new(
            direction.dot(self.east),
            direction.dot(self.north),
            direction.dot(self.up),
        )
    }
}

/// The sample points of K = n² hemicubes on a triangle: the centroids of K equal sub-triangles.
pub fn sample_points([a, b, c]: [DVec3; 3], n: u32) -> Vec<DVec3> {
    let mut points = Vec::with_capacity(n as usize * n as usize);
    let third = 3.0 * f64::from(n);
    let mut at = |i: u32, j: u32, upright: bool| {
        // Barycentric sums of a sub-triangle's corners, in thirds of its side.
        let (i, j) = if upright {
            (3 * i + 1, 3 * j + 1)
        } else {
            (3 * i + 2, 3 * j + 2)
        };
        let (u, v) = (f64::from(i) / third, f64::from(j) / third);
        points.push(a * (1.0 - u - v) + b * u + c * v);
    };
    for j in 0..n {
        for i in 0..n - j {
            at(i, j, true);
            if i + j + 1 < n {
                at(i, j, false);
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [DVec3; 3] = [
        DVec3::new(1.0, 2.0, 3.0),
        DVec3::new(4.0, 2.5, 3.5),
        DVec3::new(0.5, 5.0, 2.0),
    ];

    #[test]
    fn frames_are_orthonormal_and_right_handed_at_any_scale() {
        for scale in [1e-9, 1.0, 1e9] {
            for turn in [0.0, 0.3, 0.999] {
                let [t, b, n] = axes(TRIANGLE.map(|p| p * scale), turn).expect("a proper triangle");
                assert!((t.cross(b) - n).length() < 1e-14);
                assert!((t.length() - 1.0).abs() < 1e-14 && (b.length() - 1.0).abs() < 1e-14);
                assert!(n.dot((TRIANGLE[1] - TRIANGLE[0]).cross(TRIANGLE[2] - TRIANGLE[0])) > 0.0);
            }
        }
        assert_eq!(axes([DVec3::ZERO, DVec3::X, DVec3::X * 2.0], 0.0), None);
    }

    #[test]
    fn frames_about_a_normal_keep_it() {
        for normal in [DVec3::X, DVec3::NEG_Z, DVec3::new(1.0, -2.0, 3.0), DVec3::splat(1e-3)] {
            let [t, b, n] = axes_of(normal, 0.4).expect("a normal");
            assert!((n - normal.normalize()).length() < 1e-14 && (t.cross(b) - n).length() < 1e-14);
        }
        assert_eq!(axes_of(DVec3::ZERO, 0.0), None);
    }

    #[test]
    fn turns_spread_over_what_they_may_be() {
        let turns: Vec<f64> = (0..1000).map(|i| turn(InputPatch(i)) / MOST_TURN).collect();
        assert!(turns.iter().all(|t| (-1.0..1.0).contains(t)));
        assert!((turns.iter().sum::<f64>() / 1000.0).abs() < 0.06);
        for part in 0..8 {
            let from = f64::from(part) / 4.0 - 1.0;
            let count = turns.iter().filter(|&&t| (from..from + 0.25).contains(&t)).count();
            assert!((100..150).contains(&count), "{count} of 1000 from {from}");
        }
    }

    #[test]
    fn frames_stand_along_the_axes_as_far_as_the_normal_lets_them() {
        let level = |normal: DVec3| axes_of(normal, 0.0).expect("a normal");
        // A wall in any direction is upright in its frame, and a floor's frame is the scene's.
        for degrees in [0.0f64, 20.0, 45.0, 80.0] {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let upright = level(DVec3::new(cosine, sine, 0.0))
                .iter()
                .any(|axis| (axis.z.abs() - 1.0).abs() < 1e-15);
            assert!(upright, "a wall at {degrees}°");
        }
        assert_eq!(level(DVec3::Z), [DVec3::X, DVec3::Y, DVec3::Z]);
    }

    #[test]
    fn sample_points_average_to_the_centroid() {
        for n in 1..6 {
            let points = sample_points(TRIANGLE, n);
            assert_eq!(points.len(), (n * n) as usize);
            let mean = points.iter().sum::<DVec3>() / f64::from(n * n);
            assert!((mean - TRIANGLE.iter().sum::<DVec3>() / 3.0).length() < 1e-13);
        }
    }
}
