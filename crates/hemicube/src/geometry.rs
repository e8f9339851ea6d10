//! Geometry of triangles and convex polygons.
//!
//! Plain functions of corners in f64. Each keeps its order of operations: rows must not change by a bit, and where an
//! edge is shared, both of its triangles must get the same point.

use glam::DVec3;
pub(crate) use hemicube_contract::bvh::distance;

/// (b − a) × (c − a): the normal, as long as twice the area.
#[inline]
pub(crate) fn cross([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*b - *a).cross(*c - *a)
}

/// A triangle's area.
#[inline]
pub(crate) fn area(triangle: &[DVec3; 3]) -> f64 {
    0.5 * cross(triangle).length()
}

/// A triangle's centroid.
#[inline]
pub(crate) fn centroid([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*a + *b + *c) / 3.0
}

/// The sphere about a triangle's centroid through its farthest corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub(crate) center: DVec3,
    pub(crate) squared_radius: f64,
}

impl Sphere {
    #[inline]
    pub(crate) fn of(triangle: &[DVec3; 3]) -> Self {
        let center = centroid(triangle);
        let squared = triangle.iter().map(|p| p.distance_squared(center));
        Self {
            center,
            squared_radius: squared.fold(0.0, f64::max),
        }
    }

    #[inline]
    pub(crate) fn radius(&self) -> f64 {
        self.squared_radius.sqrt()
    }
}

/// The least and the greatest coordinates of a triangle: its axis-aligned box.
#[inline]
pub(crate) fn bounds([a, b, c]: &[DVec3; 3]) -> (DVec3, DVec3) {
    (a.min(*b).min(*c), a.max(*b).max(*c))
}

/// The four parts of a triangle that halving its edges gives.
pub(crate) fn quarters([a, b, c]: &[DVec3; 3]) -> [[DVec3; 3]; 4] {
    let (ab, bc, ca) = ((*a + *b) * 0.5, (*b + *c) * 0.5, (*c + *a) * 0.5);
    [[*a, ab, ca], [ab, *b, bc], [ca, bc, *c], [ab, bc, ca]]
}

/// The point at which the edge from `p` to `q` meets a plane, by the heights of its ends above it.
#[inline]
pub(crate) fn crossing(p: DVec3, q: DVec3, hp: f64, hq: f64) -> DVec3 {
    p + (q - p) * (hp / (hp - hq))
}

/// A plane: all p with `normal` · p = `offset`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// The normal of unit length, or 0 for a triangle without area.
    pub(crate) normal: DVec3,
    pub(crate) offset: f64,
}

impl Plane {
    /// The height of a point above the plane.
    #[inline(always)]
    pub(crate) fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }
}

/// Appends the part of a convex polygon at heights ≥ 0 to `kept` (Sutherland & Hodgman 1974).
///
/// A corner on the plane next to one below it is appended twice: as a corner and as the edge's crossing. The copies
/// span no area.
pub(crate) fn clip(corners: &[DVec3], height: impl Fn(DVec3) -> f64, kept: &mut Vec<DVec3>) {
    for (k, &p) in corners.iter().enumerate() {
        let q = corners[(k + 1) % corners.len()];
        let (hp, hq) = (height(p), height(q));
        if hp >= 0.0 {
            kept.push(p);
        }
        if (hp >= 0.0) != (hq >= 0.0) {
            kept.push(crossing(p, q, hp, hq));
        }
    }
}

/// The part of a convex polygon within a triangle, in whose plane it lies; in the polygon's order.
pub(crate) fn within(mut polygon: Vec<DVec3>, triangle: &[DVec3; 3]) -> Vec<DVec3> {
    let normal = cross(triangle);
    let mut kept = Vec::with_capacity(6);
    for k in 0..3 {
        let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
        let inwards = normal.cross(to - from);
        kept.clear();
        clip(&polygon, |corner| inwards.dot(corner - from), &mut kept);
        std::mem::swap(&mut polygon, &mut kept);
    }
    polygon
}

/// A convex polygon of at most `MOST` corners, in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon<const MOST: usize> {
    corners: [DVec3; MOST],
    count: usize,
}

impl<const MOST: usize> Polygon<MOST> {
    pub(crate) const EMPTY: Self = Self {
        corners: [DVec3::ZERO; MOST],
        count: 0,
    };

    pub(crate) fn of(corners: &[DVec3]) -> Self {
        let mut polygon = Self::EMPTY;
        for &corner in corners {
            polygon.push(corner);
        }
        polygon
    }

    /// Appends a corner; does nothing if there are `MOST`.
    #[inline]
    pub(crate) fn push(&mut self, corner: DVec3) {
        if self.count < MOST {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Takes these corners, `MOST` at most, in place of its own.
    pub(crate) fn copy(&mut self, corners: &[DVec3]) {
        self.count = corners.len().min(MOST);
        self.corners[..self.count].copy_from_slice(&corners[..self.count]);
    }

    #[inline]
    pub(crate) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Number of corners.
    #[inline]
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        (0..self.count).map(|k| (self.corners[k], self.corners[(k + 1) % self.count]))
    }

    /// The parts in front of the plane n · p = `offset` and behind it. Corners nearer to it than `slack` lie on it.
    pub(crate) fn split(&self, normal: DVec3, offset: f64, slack: f64) -> (Self, Self) {
        let (mut within, mut without) = (Self::EMPTY, Self::EMPTY);
        self.split_into(normal, offset, slack, &mut within, &mut without);
        (within, without)
    }

    /// [`Self::split`] into `within` and `without`, replacing their corners.
    ///
    /// Corners nearer to the plane than `slack` lie on it, so that no edge is cut next to its end: an edge of no length
    /// has no side.
    pub(crate) fn split_into(&self, normal: DVec3, offset: f64, slack: f64, within: &mut Self, without: &mut Self) {
        (within.count, without.count) = (0, 0);
        let height = |p: DVec3| {
            let h = normal.dot(p) - offset;
            if h.abs() <= slack { 0.0 } else { h }
        };
        let Some(&last) = self.corners().last() else {
            return;
        };
        let (mut p, mut hp) = (last, height(last));
        for &q in self.corners() {
            let hq = height(q);
            if (hp > 0.0 && hq < 0.0) || (hp < 0.0 && hq > 0.0) {
                let cut = crossing(p, q, hp, hq);
                within.push(cut);
                without.push(cut);
            }
            if hq >= 0.0 {
                within.push(q);
            }
            if hq <= 0.0 {
                without.push(q);
            }
            (p, hp) = (q, hq);
        }
    }
}

/// The part of `triangle` in front of the plane through `on` with unit `normal`: `None` where nothing is. Corners
/// nearer to the plane than `tolerance` lie on it. Edges are cut from their end in front, so that the two triangles of
/// a shared edge get the same point.
pub(crate) fn in_front(triangle: &[DVec3; 3], on: DVec3, normal: DVec3, tolerance: f64) -> Option<Polygon<4>> {
    let heights = triangle.map(|p| {
        let h = normal.dot(p - on);
        if h.abs() <= tolerance { 0.0 } else { h }
    });
    if heights.iter().all(|&h| h <= 0.0) {
        return None;
    }
    let mut part = Polygon::EMPTY;
    for k in 0..3 {
        let next = (k + 1) % 3;
        let (p, q, hp, hq) = (triangle[k], triangle[next], heights[k], heights[next]);
        if hp >= 0.0 {
            part.push(p);
        }
        if hp > 0.0 && hq < 0.0 {
            part.push(crossing(p, q, hp, hq));
        } else if hp < 0.0 && hq > 0.0 {
            part.push(crossing(q, p, hq, hp));
        }
    }
    Some(part)
}

/// A triangle in a cache line: the centroid in f64, the rest in f32 relative to it.
///
/// Single precision is enough for closed forms between triangles far from each other ([`crate::factor::coarse`]), where
/// vectors between centroids are taken in f64 first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct CompactTriangle {
    pub(crate) center: [f64; 3],
    /// Unit normal; 0 for a triangle without area.
    pub(crate) normal: [f32; 3],
    /// From corner 0 to corner 1.
    pub(crate) edge: [f32; 3],
    /// From the centroid to corner 2. Corners 0 and 1 are at −½ `median` ∓ ½ `edge`.
    pub(crate) median: [f32; 3],
    pub(crate) area: f32,
}

impl CompactTriangle {
    #[allow(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
    pub(crate) fn new(corners: &[DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let center = centroid(corners);
        let single = |v: DVec3| v.to_array().map(|x| x as f32);
        let cross = cross(corners);
        Self {
            center: center.to_array(),
            normal: single(cross.normalize_or_zero()),
            edge: single(*b - *a),
            median: single(*c - center),
            area: (0.5 * cross.length()) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_compact_triangle_is_a_cache_line() {
        assert_eq!(std::mem::size_of::<CompactTriangle>(), 64);
    }

    #[test]
    fn three_ways_to_clip_leave_the_same_area() {
        let triangle = [
            DVec3::new(-1.0, -0.3, 0.0),
            DVec3::new(2.0, 0.1, 0.0),
            DVec3::new(0.3, 1.7, 0.0),
        ];
        let fan = |corners: &[DVec3]| -> f64 {
            let halves = corners[1..].windows(2);
            halves.map(|side| area(&[corners[0], side[0], side[1]])).sum()
        };
        for normal in [DVec3::X, DVec3::new(0.6, -0.8, 0.0), DVec3::NEG_Y] {
            let front = in_front(&triangle, DVec3::ZERO, normal, 0.0).expect("something is in front");
            let (within, without) = Polygon::<8>::of(&triangle).split(normal, 0.0, 0.0);
            let mut kept = Vec::new();
            clip(&triangle, |p| normal.dot(p), &mut kept);
            let part = fan(front.corners());
            assert!((fan(within.corners()) - part).abs() < 1e-12 && (fan(&kept) - part).abs() < 1e-12);
            assert!((part + fan(without.corners()) - area(&triangle)).abs() < 1e-12);
        }
        assert!(in_front(&triangle, DVec3::Y * 2.0, DVec3::Y, 0.0).is_none());
    }
}
