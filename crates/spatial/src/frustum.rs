//! Frusta as intersections of half-spaces, and the three-outcome test of a box against one.
//!
//! For a plane through `q` with inward normal `n`, the signed offset of a corner `c` is `n·(c − q)`. Over a box it is
//! largest at one corner and smallest at the opposite one (Greene 1994, "Detecting intersection of a rectangular solid
//! and a convex polyhedron"): largest < 0 proves the box outside, smallest > 0 on every plane proves it inside.
//!
//! Rounding: the three differences, products and two sums are each right to u = ε/2 relatively, so the computed offset
//! is within 2ε Σ|nᵢ||cᵢ − qᵢ| of the exact one. Twice that is the margin that a decision must clear. Measuring from a
//! point *on the plane*, rather than from the world's origin, keeps the margin small far from the origin.

use crate::Aabb;
use glam::DVec3;
use std::fmt;

/// The place of a box with respect to a frustum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Containment {
    /// Every point of the box is inside.
    Inside,
    /// Neither is proved: the box may cross the border, or be too near to tell.
    Straddling,
    /// No point of the box is inside.
    Outside,
}

/// A half-space: the points `p` with `normal · (p − point) ≥ 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point on the plane; best taken near the tested boxes.
    pub point: DVec3,
    /// Perpendicular to the plane, pointing inwards, of any length.
    pub normal: DVec3,
}

impl Plane {
    /// Distance of a point on the inner side, in units of the normal's length; negative on the outer side.
    pub fn offset(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.point)
    }
}

#[derive(Clone, Copy, Debug)]
struct Side {
    plane: Plane,
    /// The margin for each unit of Σ|cᵢ − qᵢ| over both extreme corners.
    error: f64,
}

/// The intersection of half-spaces.
///
/// The intersection of none is all space: every box with bounds is inside.
#[derive(Clone, Debug, Default)]
pub struct Frustum {
    sides: Vec<Side>,
}

/// Why four directions do not span a pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PyramidError {
    /// The apex or a direction has an infinite coordinate or a NaN.
    NonFinite,
    /// A direction is zero, two neighbours are parallel or opposite, or all four lie in one plane.
    Flat,
    /// The directions do not go round a convex pyramid.
    NotConvex,
}

impl fmt::Display for PyramidError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NonFinite => {
                "the pyramid has a coordinate that is infinite or NaN; pass finite `apex` and `corners` only"
            }
            Self::Flat => {
                "the pyramid is flat: of its `corners` one is zero, two neighbours are parallel or all are coplanar; \
                 pass four directions that span a solid angle"
            }
            Self::NotConvex => {
                "the pyramid is not convex; pass its `corners` in their order round the axis, either way round"
            }
        })
    }
}

impl std::error::Error for PyramidError {}

impl Frustum {
    /// The intersection of half-spaces. A plane with a zero, infinite or NaN normal or point proves nothing, so that no
    /// box is ever culled by it or found inside.
    ///
    /// The planes are taken as exact: the margin covers the rounding of the test, not of computing the planes.
    pub fn from_planes(planes: &[Plane]) -> Self {
        let side = |&plane: &Plane| Side {
            plane,
            error: 4.0 * f64::EPSILON * plane.normal.abs().max_element(),
        };
        Self {
            sides: planes.iter().map(side).collect(),
        }
    }

    /// The infinite pyramid from an apex through four corner directions, given in their order round the axis, either
    /// way round, and of any length. The margin also covers the rounding of the planes' normals, so that the outcomes
    /// hold for the exact pyramid over these directions.
    ///
    /// # Errors
    /// [`PyramidError`] when the directions span no convex pyramid.
    ///
    /// ```
    /// use hemicube_spatial::{Aabb, Containment, Frustum, glam::DVec3};
    /// let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
    /// let frustum = Frustum::pyramid(DVec3::ZERO, corners)?;
    /// let ball = |z: f64| Aabb { min: DVec3::new(-1.0, -1.0, z - 1.0), max: DVec3::new(1.0, 1.0, z + 1.0) };
    /// assert_eq!(frustum.classify(&ball(5.0)), Containment::Inside);
    /// assert_eq!(frustum.classify(&ball(0.0)), Containment::Straddling);
    /// assert_eq!(frustum.classify(&ball(-5.0)), Containment::Outside);
    /// # Ok::<(), hemicube_spatial::PyramidError>(())
    /// ```
    pub fn pyramid(apex: DVec3, corners: [DVec3; 4]) -> Result<Self, PyramidError> {
        if !apex.is_finite() || corners.iter().any(|c| !c.is_finite()) {
            return Err(PyramidError::NonFinite);
        }
        // Unit length, so that one bound on the error of a cross product serves all; scaled first, so that the squares
        // neither overflow nor vanish.
        let mut units = [DVec3::ZERO; 4];
        for (unit, corner) in units.iter_mut().zip(corners) {
            let largest = corner.abs().max_element();
            if largest == 0.0 {
                return Err(PyramidError::Flat);
            }
            *unit = (corner / largest).normalize();
        }
        // Each component of a cross product of unit vectors right to 2u is right to 6u; the rest is margin.
        const NORMAL_ERROR: f64 = 4.0 * f64::EPSILON;
        // An opening below this is as good as none: the margin would leave nothing to be decided.
        const FLAT: f64 = 64.0 * f64::EPSILON;
        let [a, b, c, d] = units;
        let mut sides = Vec::with_capacity(4);
        for (from, to, others) in [(a, b, [c, d]), (b, c, [d, a]), (c, d, [a, b]), (d, a, [b, c])] {
            let normal = from.cross(to);
            if normal.abs().max_element() <= FLAT {
                return Err(PyramidError::Flat);
            }
            let heights = others.map(|other| normal.dot(other));
            let (low, high) = (heights[0].min(heights[1]), heights[0].max(heights[1]));
            let normal = match (low < -FLAT, high > FLAT) {
                (true, true) => return Err(PyramidError::NotConvex),
                (false, false) => return Err(PyramidError::Flat),
                (false, true) => normal,
                (true, false) => -normal,
            };
            let error = 4.0 * f64::EPSILON * normal.abs().max_element() + NORMAL_ERROR;
            sides.push(Side {
                plane: Plane { point: apex, normal },
                error,
            });
        }
        Ok(Self { sides })
    }

    /// The half-spaces.
    pub fn planes(&self) -> impl ExactSizeIterator<Item = Plane> + '_ {
        self.sides.iter().map(|side| side.plane)
    }

    /// Returns whether a point is inside or on the border, up to rounding; false for NaN. For proofs use
    /// [`classify`](Self::classify).
    pub fn contains(&self, point: DVec3) -> bool {
        self.sides.iter().all(|side| side.plane.offset(point) >= 0.0)
    }

    /// Classifies a box. [`Outside`](Containment::Outside) and [`Inside`](Containment::Inside) are proofs, rounding
    /// included. A box outside the frustum without a single plane separating it, possible near the frustum's edges, is
    /// [`Straddling`](Containment::Straddling); so is a box with an infinite bound or a NaN, unless there is no plane.
    /// An empty box is outside.
    pub fn classify(&self, bounds: &Aabb) -> Containment {
        if bounds.is_empty() {
            return Containment::Outside;
        }
        self.classify_masked(bounds, ALL_PLANES).0
    }

    /// [`classify`](Self::classify) for a box that is not empty, against the planes whose bit is set. Also returns the
    /// mask of the planes without proof that the box is wholly within them: nothing inside the box need be tested
    /// against the others. Planes from the 65th on have no bit and are always tested.
    pub(crate) fn classify_masked(&self, bounds: &Aabb, mask: u64) -> (Containment, u64) {
        let mut remaining = mask;
        let mut inside = true;
        for (index, side) in (0u32..).zip(&self.sides) {
            let bit = 1u64.checked_shl(index).unwrap_or(0);
            if bit != 0 && mask & bit == 0 {
                continue;
            }
            let Plane { point, normal } = side.plane;
            let (low, high) = (bounds.min - point, bounds.max - point);
            let (a, b) = (low * normal, high * normal);
            let largest = a.x.max(b.x) + a.y.max(b.y) + a.z.max(b.z);
            let smallest = a.x.min(b.x) + a.y.min(b.y) + a.z.min(b.z);
            // Both corners enter, and by addition: an infinity or a NaN in any bound makes the margin unbeatable.
            let reach = low.abs() + high.abs();
            // The last term covers products that vanish below the smallest normal number.
            let margin = side.error * (reach.x + reach.y + reach.z) + f64::MIN_POSITIVE;
            if largest < -margin {
                return (Containment::Outside, mask);
            }
            if smallest > margin {
                remaining &= !bit;
            } else {
                inside = false;
            }
        }
        (
            if inside {
                Containment::Inside
            } else {
                Containment::Straddling
            },
            remaining,
        )
    }
}

/// No plane has been decided yet.
pub(crate) const ALL_PLANES: u64 = u64::MAX;

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_pyramid() -> Frustum {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
        Frustum::pyramid(DVec3::ZERO, corners).expect("a plain pyramid")
    }

    #[test]
    fn a_touching_box_straddles() {
        let plane = Plane {
            point: DVec3::X,
            normal: DVec3::X,
        };
        let frustum = Frustum::from_planes(&[plane]);
        let slab = |lo: f64, hi: f64| Aabb {
            min: DVec3::new(lo, -1.0, -1.0),
            max: DVec3::new(hi, 1.0, 1.0),
        };
        assert_eq!(frustum.classify(&slab(0.0, 1.0)), Containment::Straddling);
        assert_eq!(frustum.classify(&slab(1.0, 2.0)), Containment::Straddling);
        assert_eq!(frustum.classify(&slab(1.0 + 1e-12, 2.0)), Containment::Inside);
        assert_eq!(frustum.classify(&slab(0.0, 1.0 - 1e-12)), Containment::Outside);
    }

    #[test]
    fn odd_boxes_and_planes_are_never_culled() {
        let huge = f64::INFINITY;
        let frustum = unit_pyramid();
        assert_eq!(frustum.classify(&Aabb::EMPTY), Containment::Outside);
        for bounds in [
            Aabb {
                min: DVec3::splat(-huge),
                max: DVec3::splat(huge),
            },
            Aabb {
                min: DVec3::splat(-huge),
                max: DVec3::splat(-1.0),
            },
            Aabb {
                min: DVec3::splat(f64::NAN),
                max: DVec3::splat(-1.0),
            },
            Aabb {
                min: DVec3::splat(-2.0),
                max: DVec3::new(-1.0, -1.0, f64::NAN),
            },
        ] {
            assert_eq!(frustum.classify(&bounds), Containment::Straddling, "{bounds:?}");
        }
        let there = Aabb {
            min: DVec3::splat(5.0),
            max: DVec3::splat(6.0),
        };
        for (point, normal) in [
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::ZERO, DVec3::splat(f64::NAN)),
            (DVec3::splat(f64::NAN), DVec3::X),
            (DVec3::splat(huge), DVec3::X),
            (DVec3::ZERO, DVec3::new(-huge, 0.0, 0.0)),
            (DVec3::ZERO, DVec3::splat(-1e-320)),
            (DVec3::ZERO, DVec3::new(f64::MAX, -f64::MAX, f64::MAX)),
        ] {
            let outcome = Frustum::from_planes(&[Plane { point, normal }]).classify(&there);
            assert_eq!(outcome, Containment::Straddling, "{point} {normal}");
        }
        assert_eq!(Frustum::from_planes(&[]).classify(&there), Containment::Inside);
    }

    #[test]
    fn pyramid_takes_either_winding_and_any_length() {
        let box_at = |p: DVec3| Aabb {
            min: p - 0.1,
            max: p + 0.1,
        };
        for scale in [1e-300, 1e-9, 1.0, 1e300] {
            let mut corners =
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0) * scale);
            for _ in 0..2 {
                let frustum = Frustum::pyramid(DVec3::splat(7.0), corners).expect("a plain pyramid");
                assert_eq!(
                    frustum.classify(&box_at(DVec3::new(7.0, 7.0, 9.0))),
                    Containment::Inside
                );
                assert_eq!(
                    frustum.classify(&box_at(DVec3::new(7.0, 7.0, 5.0))),
                    Containment::Outside
                );
                corners.reverse();
            }
        }
    }

    #[test]
    fn what_is_no_pyramid_is_refused() {
        let [a, b, c, d] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
        let refused = |corners| Frustum::pyramid(DVec3::ZERO, corners).expect_err("no pyramid");
        assert_eq!(refused([a, c, b, d]), PyramidError::NotConvex, "crossed");
        assert_eq!(
            refused([a, b, DVec3::new(-0.5, -0.5, 1.0), d]),
            PyramidError::NotConvex,
            "dented"
        );
        assert_eq!(refused([a, a, c, d]), PyramidError::Flat);
        assert_eq!(refused([a, b, c, DVec3::ZERO]), PyramidError::Flat);
        assert_eq!(
            refused([DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y]),
            PyramidError::Flat,
            "all in one plane"
        );
        assert_eq!(refused([a, -a, c, d]), PyramidError::Flat, "opposite neighbours");
        assert_eq!(refused([a, b, c, d * f64::NAN]), PyramidError::NonFinite);
        let apex = DVec3::splat(f64::INFINITY);
        assert_eq!(
            Frustum::pyramid(apex, [a, b, c, d]).expect_err("no pyramid"),
            PyramidError::NonFinite
        );
    }

    #[test]
    fn planes_beyond_the_mask_still_count() {
        let mut planes = vec![
            Plane {
                point: DVec3::ZERO,
                normal: DVec3::X
            };
            70
        ];
        let there = Aabb {
            min: DVec3::splat(5.0),
            max: DVec3::splat(6.0),
        };
        assert_eq!(
            Frustum::from_planes(&planes).classify_masked(&there, ALL_PLANES),
            (Containment::Inside, 0)
        );
        planes[69].normal = -DVec3::X;
        assert_eq!(
            Frustum::from_planes(&planes).classify_masked(&there, 0).0,
            Containment::Outside
        );
    }
}
