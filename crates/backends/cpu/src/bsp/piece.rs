//! Surfaces, and the pieces that planes cut them into.

use glam::DVec3;
use hemicube_contract::bvh::sorted_corners;

/// A plane: normal · p = distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub(super) normal: DVec3,
    pub(super) distance: f64,
}

impl Plane {
    /// The plane of a triangle; `None` without area.
    pub(super) fn of(&[a, b, c]: &[DVec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a);
        let length = normal.length();
        (length > 1e-28).then(|| {
            let normal = normal / length;
            Self {
                normal,
                distance: normal.dot(a),
            }
        })
    }

    /// Heights of corners above the plane, 0 up to a tolerance, and the side they are on.
    pub(super) fn side_of(self, corners: &[DVec3; 3], tolerance: f64) -> (Side, [f64; 3]) {
        let heights = corners.map(|p| {
            let height = self.normal.dot(p) - self.distance;
            if height.abs() <= tolerance { 0.0 } else { height }
        });
        let above = heights.iter().any(|&h| h > 0.0);
        let below = heights.iter().any(|&h| h < 0.0);
        let side = match (above, below) {
            (false, false) => Side::Here,
            (true, false) => Side::Front,
            (false, true) => Side::Back,
            (true, true) => Side::Both,
        };
        (side, heights)
    }
}

/// Side of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Here,
    Front,
    Back,
    Both,
}

/// A part of a surface that planes cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) corners: [DVec3; 3],
    /// The line of the edge opposite each corner.
    pub(super) lines: [[DVec3; 2]; 3],
    pub(super) surface: u32,
}

impl Piece {
    /// All of a surface, its corners sorted as in blocks.
    pub(super) fn whole(surface: u32, corners: [DVec3; 3]) -> Self {
        let ([a, b, c], _) = sorted_corners(corners);
        Self {
            corners: [a, b, c],
            lines: [[b, c], [c, a], [a, b]],
            surface,
        }
    }

    /// Cuts the piece by a plane, given the heights of its corners; appends the parts on either side.
    pub(super) fn cut(&self, heights: [f64; 3], front: &mut Vec<Self>, back: &mut Vec<Self>) {
        // Corners of the two parts in the piece's winding, each with the line of the edge that leaves it.
        let mut parts: [Vec<(DVec3, [DVec3; 2])>; 2] = [Vec::with_capacity(4), Vec::with_capacity(4)];
        let mut crossings = Vec::with_capacity(2);
        for k in 0..3 {
            let next = (k + 1) % 3;
            // The edge from corner k to the next is opposite the third.
            let line = self.lines[(k + 2) % 3];
            let (p, q) = (self.corners[k], self.corners[next]);
            let (hp, hq) = (heights[k], heights[next]);
            if hp >= 0.0 {
                parts[0].push((p, line));
            }
            if hp <= 0.0 {
                parts[1].push((p, line));
            }
            if hp == 0.0 {
                crossings.push(p);
            }
            if hp * hq < 0.0 {
                // Go from the same end whatever the winding: two surfaces that share the edge cut it at the same point.
                let (a, b, ha, hb) = if (p.x, p.y, p.z) < (q.x, q.y, q.z) {
                    (p, q, hp, hq)
                } else {
                    (q, p, hq, hp)
                };
                let at = a + (b - a) * (ha / (ha - hb));
                crossings.push(at);
                parts[0].push((at, line));
                parts[1].push((at, line));
            }
        }
        let &[first, second] = crossings.as_slice() else {
            return;
        };
        for (part, out) in parts.iter_mut().zip([front, back]) {
            // The edge along the cut leaves the first of two neighbouring crossings.
            let count = part.len();
            for k in 0..count {
                let (p, q) = (part[k].0, part[(k + 1) % count].0);
                if (p == first && q == second) || (p == second && q == first) {
                    // One direction for both parts: the caller of the lines' product corrects the sign.
                    part[k].1 = [p, q];
                }
            }
            for k in 1..count.saturating_sub(1) {
                let (a, b, c) = (part[0], part[k], part[k + 1]);
                let last = k + 2 == count;
                // The diagonals between the triangles of a fan are lines of their own, shared by both.
                let ab = if k == 1 { a.1 } else { [a.0, b.0] };
                let ca = if last { c.1 } else { [c.0, a.0] };
                out.push(Self {
                    corners: [a.0, b.0, c.0],
                    lines: [b.1, ca, ab],
                    surface: self.surface,
                });
            }
        }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Bounds {
    pub(super) fn of(&[a, b, c]: &[DVec3; 3]) -> Self {
        Self {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
        }
    }

    pub(super) const EMPTY: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    pub(super) fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    pub(super) fn center(self) -> DVec3 {
        (self.low + self.high) * 0.5
    }

    pub(super) fn twice_center(self) -> DVec3 {
        self.low + self.high
    }

    /// Half the surface; 0 of nothing.
    pub(super) fn area(self) -> f64 {
        let d = (self.high - self.low).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// Half the sides, a hair wider than the content, as the middle and the halves are rounded.
    pub(super) fn half(self) -> DVec3 {
        (self.high - self.low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15)
    }
}
