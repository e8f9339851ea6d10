//! Rigid motions of space.

use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// x ↦ L x + t with an orthogonal L.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    linear: DMat3,
    shift: DVec3,
}

impl Motion {
    pub(super) const IDENTITY: Self = Self {
        linear: DMat3::IDENTITY,
        shift: DVec3::ZERO,
    };

    /// The reflection in the plane n · x = `offset`, n of length 1.
    pub(super) fn reflection(normal: DVec3, offset: f64) -> Self {
        let column = |axis: DVec3| axis - 2.0 * normal.dot(axis) * normal;
        Self {
            linear: DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z)),
            shift: 2.0 * offset * normal,
        }
    }

    pub(super) fn translation(shift: DVec3) -> Self {
        Self {
            linear: DMat3::IDENTITY,
            shift,
        }
    }

    /// The rotation about `axis` through the origin, given by cosine and sine.
    pub(super) fn rotation(axis: DVec3, cosine: f64, sine: f64) -> Self {
        let turn = |v: DVec3| {
            let along = axis.dot(v) * axis;
            along + (v - along) * cosine + axis.cross(v) * sine
        };
        Self {
            linear: DMat3::from_cols(turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z)),
            shift: DVec3::ZERO,
        }
    }

    /// First `other`, then this.
    pub(super) fn after(&self, other: &Self) -> Self {
        Self {
            linear: self.linear * other.linear,
            shift: self.linear * other.shift + self.shift,
        }
    }

    pub(super) fn inverse(&self) -> Self {
        let linear = self.linear.transpose();
        Self {
            linear,
            shift: -(linear * self.shift),
        }
    }

    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        self.linear * p + self.shift
    }

    /// Returns whether it turns the handedness of space.
    pub(super) fn is_mirrored(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    /// The triangle moved, its front where the front was.
    pub(super) fn triangle(&self, corners: [DVec3; 3]) -> [DVec3; 3] {
        let [a, b, c] = corners.map(|p| self.point(p));
        if self.is_mirrored() { [a, c, b] } else { [a, b, c] }
    }

    fn distance(&self, other: &Self) -> f64 {
        let columns = (0..3).map(|k| (self.linear.col(k) - other.linear.col(k)).abs().max_element());
        columns.fold((self.shift - other.shift).abs().max_element(), f64::max)
    }
}

/// A motion's number among those of a row.
pub(super) type MotionId = u32;

/// The number of motions that are not kept, being too many.
pub(super) const OTHER: MotionId = u32::MAX;

/// Most motions of a row.
const MOST: usize = 1 << 16;
/// Motions nearer to each other than this are one: far above rounding, far below any scene's detail.
const SAME: f64 = 1e-9;
/// Side of the cells in which motions are looked up.
const CELL: f64 = 1e-6;

/// The motions met by a row, equal ones once, whatever the order of their mirrors.
#[derive(Debug, Default)]
pub(super) struct Motions {
    motions: Vec<Motion>,
    cells: HashMap<[i64; 3], Vec<MotionId>>,
    /// The motion after a portal's plane, by the motion before it and the block's lane of its surface.
    next: HashMap<(MotionId, u32), MotionId>,
}

impl Motions {
    /// Forgets all but the identity, which is number 0.
    pub(super) fn begin(&mut self) {
        self.motions.clear();
        self.cells.clear();
        self.next.clear();
        self.id(Motion::IDENTITY);
    }

    pub(super) fn get(&self, id: MotionId) -> &Motion {
        self.motions.get(id as usize).unwrap_or(&Motion::IDENTITY)
    }

    /// The motion after the reflection in the plane of a surface, kept by its lane.
    pub(super) fn reflected(&mut self, id: MotionId, lane: u32, normal: DVec3, offset: f64) -> MotionId {
        if id == OTHER {
            return OTHER;
        }
        if let Some(&known) = self.next.get(&(id, lane)) {
            return known;
        }
        let moved = self.get(id).after(&Motion::reflection(normal, offset));
        let found = self.id(moved);
        self.next.insert((id, lane), found);
        found
    }

    fn id(&mut self, motion: Motion) -> MotionId {
        // A point of no symmetry, so that different motions take it to different places.
        let at = motion.point(DVec3::new(0.217, 0.591, 0.373)) / CELL;
        #[allow(clippy::cast_possible_truncation, reason = "saturates; equal motions saturate alike")]
        let cell = at.floor().to_array().map(|x| x as i64);
        for step in 0..27 {
            let steps = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
            let near: [i64; 3] = std::array::from_fn(|k| cell[k].saturating_add(steps[k]));
            for &id in self.cells.get(&near).into_iter().flatten() {
                if self.get(id).distance(&motion) < SAME {
                    return id;
                }
            }
        }
        if self.motions.len() >= MOST {
            return OTHER;
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 2¹⁶")]
        let id = self.motions.len() as MotionId;
        self.motions.push(motion);
        self.cells.entry(cell).or_default().push(id);
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_mirrors_at_right_angles_commute_and_are_one_motion() {
        let mut motions = Motions::default();
        motions.begin();
        let (x, y) = ((DVec3::X, 0.3), (DVec3::Y, -0.7));
        let one = motions.reflected(0, 1, x.0, x.1);
        let one = motions.reflected(one, 2, y.0, y.1);
        let other = motions.reflected(0, 2, y.0, y.1);
        let other = motions.reflected(other, 1, x.0, x.1);
        assert_eq!(one, other);
        assert_ne!(one, 0);
        assert!(!motions.get(one).is_mirrored());
        // Twice the same mirror is nothing.
        let once = motions.reflected(0, 1, x.0, x.1);
        assert_eq!(motions.reflected(once, 1, x.0, x.1), 0);
        assert!(motions.get(once).is_mirrored());
    }

    #[test]
    fn inverses_and_triangles() {
        let turned = Motion::rotation(DVec3::Z, 0.6, 0.8).after(&Motion::translation(DVec3::X));
        let back = turned.inverse().after(&turned);
        assert!(back.distance(&Motion::IDENTITY) < 1e-15);
        assert!(turned.point(DVec3::ZERO).distance(DVec3::new(0.6, 0.8, 0.0)) < 1e-15);
        let mirror = Motion::reflection(DVec3::X, 1.0);
        let [a, b, c] = mirror.triangle([DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert_eq!((a, b, c), (DVec3::X * 2.0, DVec3::new(2.0, 1.0, 0.0), DVec3::X));
        assert!((b - a).cross(c - a).z > 0.0, "its front still looks up");
    }
}
