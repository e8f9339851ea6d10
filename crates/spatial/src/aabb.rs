//! Axis-aligned boxes in f64.

use glam::DVec3;

/// A closed axis-aligned box. It is *empty* when `min` exceeds `max` on some axis.
///
/// A NaN is kept, not dropped: growing by a point with a NaN coordinate, or uniting with a box that has one, gives a
/// box with a NaN on that axis. Such a box is neither finite nor empty, contains and intersects nothing, and straddles
/// every frustum; [`Octree::build`](crate::Octree::build) refuses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: DVec3,
    /// The corner with the largest coordinates.
    pub max: DVec3,
}

/// The empty box.
impl Default for Aabb {
    fn default() -> Self {
        Self::EMPTY
    }
}

// `f64::min` drops a NaN and glam's own drops it on one side only; here it must survive from either side.
fn min(a: f64, b: f64) -> f64 {
    if a < b || a.is_nan() { a } else { b }
}

fn max(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

impl Aabb {
    /// The box without points, and the neutral element of [`union`](Self::union).
    pub const EMPTY: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    /// The smallest box over all the points; [`EMPTY`](Self::EMPTY) if there is none.
    ///
    /// ```
    /// use hemicube_spatial::{Aabb, glam::DVec3};
    /// let triangle = [DVec3::ZERO, DVec3::new(2.0, 0.0, 1.0), DVec3::new(0.0, 4.0, 0.0)];
    /// let bounds = Aabb::from_points(triangle);
    /// assert_eq!(bounds.center(), DVec3::new(1.0, 2.0, 0.5));
    /// assert!(Aabb::from_points([]).is_empty());
    /// ```
    pub fn from_points(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::grow)
    }

    /// The smallest box over this one and a point.
    #[must_use]
    pub fn grow(self, point: DVec3) -> Self {
        self.union(Self { min: point, max: point })
    }

    /// The smallest box over both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            min: DVec3::new(
                min(self.min.x, other.min.x),
                min(self.min.y, other.min.y),
                min(self.min.z, other.min.z),
            ),
            max: DVec3::new(
                max(self.max.x, other.max.x),
                max(self.max.y, other.max.y),
                max(self.max.z, other.max.z),
            ),
        }
    }

    /// Returns whether `min` exceeds `max` on some axis, so that no point is inside. False for a box with a NaN unless
    /// another axis makes it so.
    pub fn is_empty(&self) -> bool {
        self.min.x > self.max.x || self.min.y > self.max.y || self.min.z > self.max.z
    }

    /// Returns whether all six bounds are finite numbers.
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// Returns whether a point is inside or on the border. False for a NaN on either side.
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// Returns whether another box lies wholly inside this one, borders included. An empty `other` holds no point, so
    /// it is contained in every box without a NaN.
    pub fn contains_box(&self, other: &Self) -> bool {
        let nan = self.min.is_nan() || self.max.is_nan();
        (other.is_empty() && !nan) || (other.min.cmpge(self.min).all() && other.max.cmple(self.max).all())
    }

    /// Returns whether the two share a point, borders included. False if either is empty or has a NaN.
    pub fn intersects(&self, other: &Self) -> bool {
        !self.is_empty() && !other.is_empty() && self.min.cmple(other.max).all() && self.max.cmpge(other.min).all()
    }

    /// The middle of the box, without overflow for any finite box. NaN for [`EMPTY`](Self::EMPTY).
    pub fn center(&self) -> DVec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Half the length along each axis, without overflow for any finite box. Negative on the axes that make a box
    /// empty.
    pub fn half_extent(&self) -> DVec3 {
        self.max * 0.5 - self.min * 0.5
    }

    /// The square of the distance from a point to the box, zero inside; infinite for [`EMPTY`](Self::EMPTY).
    pub fn distance_squared(&self, point: DVec3) -> f64 {
        let outside = |p: f64, lo: f64, hi: f64| max(max(lo - p, p - hi), 0.0);
        DVec3::new(
            outside(point.x, self.min.x, self.max.x),
            outside(point.y, self.min.y, self.max.y),
            outside(point.z, self.min.z, self.max.z),
        )
        .length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(lo: f64, hi: f64) -> Aabb {
        Aabb {
            min: DVec3::splat(lo),
            max: DVec3::splat(hi),
        }
    }

    #[test]
    fn empty_is_neutral_and_holds_nothing() {
        let b = cube(-1.0, 2.0);
        assert_eq!(b.union(Aabb::EMPTY), b);
        assert_eq!(Aabb::EMPTY.union(b), b);
        assert!(Aabb::EMPTY.is_empty() && !Aabb::EMPTY.is_finite() && !Aabb::EMPTY.contains(DVec3::ZERO));
        assert!(b.contains_box(&Aabb::EMPTY) && !Aabb::EMPTY.contains_box(&b));
        assert!(!b.intersects(&Aabb::EMPTY) && !Aabb::EMPTY.intersects(&Aabb::EMPTY));
        assert_eq!(Aabb::EMPTY.distance_squared(DVec3::ZERO), f64::INFINITY);
        assert_eq!(Aabb::default(), Aabb::EMPTY);
    }

    #[test]
    fn borders_belong_to_the_box() {
        let b = cube(0.0, 1.0);
        assert!(b.contains(DVec3::ZERO) && b.contains(DVec3::ONE));
        assert!(!b.contains(DVec3::new(0.5, 0.5, 1.0 + f64::EPSILON)));
        assert!(b.contains_box(&b) && b.intersects(&cube(1.0, 2.0)) && !b.intersects(&cube(1.5, 2.0)));
        assert!(!b.contains_box(&cube(0.5, 1.5)));
        assert!(!cube(2.0, 2.0).is_empty(), "a point is a box");
    }

    #[test]
    fn center_and_half_extent_do_not_overflow() {
        let b = cube(-f64::MAX, f64::MAX);
        assert_eq!(b.center(), DVec3::ZERO);
        assert_eq!(b.half_extent(), DVec3::splat(f64::MAX));
        assert_eq!(cube(f64::MAX, f64::MAX).center(), DVec3::splat(f64::MAX));
    }

    #[test]
    fn nan_survives_from_either_side_and_in_the_middle() {
        let nan = DVec3::new(0.5, f64::NAN, 0.5);
        for points in [
            [nan, DVec3::ZERO, DVec3::ONE],
            [DVec3::ZERO, nan, DVec3::ONE],
            [DVec3::ZERO, DVec3::ONE, nan],
        ] {
            let b = Aabb::from_points(points);
            assert!(b.min.y.is_nan() && b.max.y.is_nan(), "{points:?} gave {b:?}");
            assert_eq!((b.min.x, b.max.z), (0.0, 1.0), "the other axes are kept");
            assert!(!b.is_finite() && !b.is_empty() && !b.contains(DVec3::splat(0.5)));
            assert!(!b.contains_box(&cube(0.0, 1.0)) && !cube(-9.0, 9.0).contains_box(&b));
            assert!(!b.intersects(&cube(0.0, 1.0)) && !cube(0.0, 1.0).intersects(&b));
            assert!(!b.contains_box(&Aabb::EMPTY));
        }
    }

    #[test]
    fn distance_is_zero_inside_and_euclidean_outside() {
        let b = cube(0.0, 1.0);
        assert_eq!(b.distance_squared(DVec3::splat(0.3)), 0.0);
        assert_eq!(b.distance_squared(DVec3::new(4.0, 5.0, 0.5)), 25.0);
        assert_eq!(b.distance_squared(DVec3::new(-1.0, -1.0, -1.0)), 3.0);
    }
}
