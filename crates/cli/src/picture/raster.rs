//! Triangles on a picture plane, by a z-buffer in f64.
//!
//! A pixel's ray is (u, v, 1) in the lens's frame. With the corners there as columns of a matrix, the ray's barycentric
//! coordinates over its depth are the products of the ray with (b × c, c × a, a × b) / det (Olano & Greer 1997).
//! Triangles that reach behind the lens need no clipping.

use glam::DVec3;
use hemicube_spatial::whole;

/// A picture plane: its centre of projection and its pixels' rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    pub(crate) origin: DVec3,
    /// Right, up, forward: orthonormal.
    pub(crate) axes: [DVec3; 3],
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// u and v of the left and upper edge of the picture.
    pub(crate) left: f64,
    pub(crate) top: f64,
    /// Step of u from pixel to pixel; v falls by the same.
    pub(crate) step: f64,
}

/// A covered pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Row by row from the upper left.
    pub(crate) pixel: usize,
    /// Along the lens's axis, in the scene's unit.
    pub(crate) depth: f64,
    /// Weights of the corners.
    pub(crate) barycentric: [f64; 3],
    /// True if the front is seen.
    pub(crate) front: bool,
}

impl Lens {
    /// A point in the lens's frame.
    fn local(&self, point: DVec3) -> DVec3 {
        let p = point - self.origin;
        DVec3::new(p.dot(self.axes[0]), p.dot(self.axes[1]), p.dot(self.axes[2]))
    }

    /// The rays' pixels between two values of u or v, widened by one.
    fn range(low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
        let start = whole::to_usize(low.floor() - 1.0);
        let end = whole::to_usize(high.ceil() + 1.0).min(count);
        start.min(end)..end
    }

    /// Calls `cover` for every pixel with a covered centre.
    pub(crate) fn draw(&self, corners: &[DVec3; 3], mut cover: impl FnMut(Fragment)) {
        let [a, b, c] = corners.map(|corner| self.local(corner));
        if a.z <= 0.0 && b.z <= 0.0 && c.z <= 0.0 {
            return;
        }
        let normals = [b.cross(c), c.cross(a), a.cross(b)];
        let volume = a.dot(normals[0]);
        if volume == 0.0 {
            return;
        }
        let (mut columns, mut rows) = (0..self.width, 0..self.height);
        if a.z > 0.0 && b.z > 0.0 && c.z > 0.0 {
            let us = [a, b, c].map(|p| (p.x / p.z - self.left) / self.step - 0.5);
            let vs = [a, b, c].map(|p| (self.top - p.y / p.z) / self.step - 0.5);
            let low = |values: [f64; 3]| values.into_iter().fold(f64::INFINITY, f64::min);
            let high = |values: [f64; 3]| values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            columns = Self::range(low(us), high(us), self.width);
            rows = Self::range(low(vs), high(vs), self.height);
        }
        let planes = normals.map(|normal| normal / volume);
        for y in rows {
            let v = self.top - (y as f64 + 0.5) * self.step;
            for x in columns.clone() {
                let ray = DVec3::new(self.left + (x as f64 + 0.5) * self.step, v, 1.0);
                let parts = planes.map(|plane| plane.dot(ray));
                let sum = parts[0] + parts[1] + parts[2];
                if parts.iter().all(|&part| part >= 0.0) && sum > 0.0 {
                    cover(Fragment {
                        pixel: y * self.width + x,
                        depth: 1.0 / sum,
                        barycentric: parts.map(|part| part / sum),
                        // Counter-clockwise on the picture: right, up and forward are a left-handed frame.
                        front: volume > 0.0,
                    });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Right x, up y, forward −z, like a page.
    fn lens() -> Lens {
        Lens {
            origin: DVec3::ZERO,
            axes: [DVec3::X, DVec3::Y, DVec3::NEG_Z],
            width: 8,
            height: 8,
            left: -1.0,
            top: 1.0,
            step: 0.25,
        }
    }

    #[test]
    fn a_triangle_that_fills_the_picture_is_at_its_depth_and_faces_us() {
        let far = [
            DVec3::new(-50.0, -50.0, -4.0),
            DVec3::new(50.0, -50.0, -4.0),
            DVec3::new(0.0, 90.0, -4.0),
        ];
        let mut seen = 0;
        lens().draw(&far, |fragment| {
            assert!((fragment.depth - 4.0).abs() < 1e-12 && fragment.front);
            assert!((fragment.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            seen += 1;
        });
        assert_eq!(seen, 64);
        let mut backs = 0;
        lens().draw(&[far[0], far[2], far[1]], |fragment| {
            assert!(!fragment.front);
            backs += 1;
        });
        assert_eq!(backs, 64);
    }

    #[test]
    fn what_reaches_behind_us_is_drawn_where_it_is_in_front() {
        // A floor below us, from far behind to far ahead.
        let floor = [
            DVec3::new(-1e4, -1.0, 1e4),
            DVec3::new(1e4, -1.0, 1e4),
            DVec3::new(0.0, -1.0, -1e6),
        ];
        let mut rows = [0; 8];
        lens().draw(&floor, |fragment| {
            assert!(fragment.depth > 0.0);
            rows[fragment.pixel / 8] += 1;
        });
        assert_eq!(
            rows,
            [0, 0, 0, 0, 8, 8, 8, 8],
            "the lower half, and nothing above the horizon"
        );
        let mut behind = 0;
        lens().draw(&floor.map(|p| p + DVec3::Z * 3e6), |_| behind += 1);
        assert_eq!(behind, 0);
    }
}
