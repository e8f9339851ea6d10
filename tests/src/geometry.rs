//! Geometry written inline in tests, rigid motions, and the closed forms that factors are held against.
//!
//! Point to polygon (Lambert 1760; Baum, Rushmeier & Winget 1989, eq. 5): with the receiver at the origin and a, b the
//! ends of an edge, F = (1/2π) |Σ θ(a, b) n · (a × b)/|a × b||, after clipping the polygon at the receiver's horizon.

use glam::{DQuat, DVec3};
use hemicube_scene::{Material, Scene, Triangle};
use std::f64::consts::{PI, TAU};

/// A scene of one-sided triangles.
pub fn scene_of(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Scene {
    scene_with_sides(triangles.into_iter().map(|corners| (corners, false)))
}

/// A scene of triangles, each with whether it is two-sided.
pub fn scene_with_sides(triangles: impl IntoIterator<Item = ([DVec3; 3], bool)>) -> Scene {
    Scene {
        triangles: (0..)
            .zip(triangles)
            .map(|(face, (corners, two_sided))| Triangle {
                corners,
                object: 0,
                material: 0,
                face,
                two_sided,
            })
            .collect(),
        objects: vec![String::new()],
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// The two triangles of a quad, cut from its first corner.
pub fn quad([a, b, c, d]: [DVec3; 4]) -> [[DVec3; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

/// The triangles of a parallelogram cut at the given places of its first and its second edge (0 to 1, ascending, with
/// both ends), with its winding.
pub fn grid([a, b, _, d]: [DVec3; 4], along: &[f64], across: &[f64]) -> Vec<[DVec3; 3]> {
    let at = |s: f64, t: f64| a + (b - a) * s + (d - a) * t;
    let mut triangles = Vec::new();
    for s in along.windows(2) {
        for t in across.windows(2) {
            triangles.extend(quad([at(s[0], t[0]), at(s[1], t[0]), at(s[1], t[1]), at(s[0], t[1])]));
        }
    }
    triangles
}

/// `count` + 1 places from 0 to 1, evenly.
pub fn even(count: u32) -> Vec<f64> {
    (0..=count).map(|k| f64::from(k) / f64::from(count)).collect()
}

/// The faces of the box from the origin to `size`, seen from inside, each corner list starting at a corner of the box:
/// floor and ceiling (z), then x = 0, x = size, y = 0, y = size.
pub fn box_inside(size: DVec3) -> [[DVec3; 4]; 6] {
    let DVec3 { x, y, z } = size;
    let p = DVec3::new;
    [
        [p(0., 0., 0.), p(x, 0., 0.), p(x, y, 0.), p(0., y, 0.)],
        [p(0., 0., z), p(0., y, z), p(x, y, z), p(x, 0., z)],
        [p(0., 0., 0.), p(0., y, 0.), p(0., y, z), p(0., 0., z)],
        [p(x, 0., 0.), p(x, 0., z), p(x, y, z), p(x, y, 0.)],
        [p(0., 0., 0.), p(0., 0., z), p(x, 0., z), p(x, 0., 0.)],
        [p(0., y, 0.), p(x, y, 0.), p(x, y, z), p(0., y, z)],
    ]
}

/// The same quad seen from the other side, from the same first corner.
pub fn flipped([a, b, c, d]: [DVec3; 4]) -> [DVec3; 4] {
    [a, d, c, b]
}

/// The scene with every corner moved.
pub fn moved(mut scene: Scene, motion: impl Fn(DVec3) -> DVec3) -> Scene {
    for triangle in &mut scene.triangles {
        triangle.corners = triangle.corners.map(&motion);
    }
    scene
}

/// A rotation by √2 radians about (1, 2, 3): no axis, edge or plane of anything comes to lie along another.
pub fn irrational_rotation() -> DQuat {
    DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), std::f64::consts::SQRT_2)
}

/// The unoccluded form factor from a point with a normal to a planar polygon.
pub fn point_to_polygon(origin: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let corners: Vec<DVec3> = polygon.iter().map(|&p| p - origin).collect();
    // A polygon round the origin in its own plane would count as the whole sky.
    if !corners.iter().any(|&p| normal.dot(p) > 0.0) {
        return 0.0;
    }
    let mut clipped = Vec::with_capacity(corners.len() + 2);
    for (k, &p) in corners.iter().enumerate() {
        let q = corners[(k + 1) % corners.len()];
        let (hp, hq) = (normal.dot(p), normal.dot(q));
        if hp >= 0.0 {
            clipped.push(p);
        }
        if (hp < 0.0) != (hq < 0.0) {
            clipped.push(p + (q - p) * (hp / (hp - hq)));
        }
    }
    let mut sum = 0.0;
    for (k, &p) in clipped.iter().enumerate() {
        let q = clipped[(k + 1) % clipped.len()];
        let cross = p.cross(q);
        let sine = cross.length();
        if sine > 0.0 {
            sum += sine.atan2(p.dot(q)) * normal.dot(cross) / sine;
        }
    }
    sum.abs() / TAU
}

/// Between two parallel rectangles of a × b, opposite each other at distance c (Howell's catalogue, C-11).
pub fn parallel_rectangles(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    2.0 / (PI * x * y)
        * ((p * p * q * q / (1.0 + x * x + y * y)).sqrt().ln() + x * q * (x / q).atan() + y * p * (y / p).atan()
            - x * x.atan()
            - y * y.atan())
}

/// From a rectangle of width w to one of height h at right angles to it, along a common edge of length l (Howell's
/// catalogue, C-14).
pub fn perpendicular_rectangles(w: f64, h: f64, l: f64) -> f64 {
    let (h, w) = (h / l, w / l);
    let (h2, w2) = (h * h, w * w);
    let diagonal = (h2 + w2).sqrt();
    let logarithm = (((1.0 + w2) * (1.0 + h2)) / (1.0 + w2 + h2)).ln()
        + w2 * (w2 * (1.0 + w2 + h2) / ((1.0 + w2) * (w2 + h2))).ln()
        + h2 * (h2 * (1.0 + h2 + w2) / ((1.0 + h2) * (h2 + w2))).ln();
    (w * (1.0 / w).atan() + h * (1.0 / h).atan() - diagonal * (1.0 / diagonal).atan() + logarithm / 4.0) / (PI * w)
}

/// The exponent p of y ∝ xᵖ that fits best: the slope of the least-squares line through the logarithms.
pub fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (x, y) = logs
        .iter()
        .fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
    let covariance: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms_agree_with_each_other_and_with_known_values() {
        assert!((parallel_rectangles(1.0, 1.0, 1.0) - 0.199_824_895_698_387).abs() < 1e-14);
        assert!((perpendicular_rectangles(1.0, 1.0, 1.0) - 0.200_043_776_075_403).abs() < 1e-14);
        assert!((perpendicular_rectangles(1.0, 3.0, 2.0) - 0.308_140_292_981_996).abs() < 1e-14);
        // The floor's mean over its points is the factor between the areas: the midpoint rule converges with its square.
        let [floor, ceiling, wall, ..] = box_inside(DVec3::ONE);
        let (mut up, mut aside) = (0.0, 0.0);
        let n = 100;
        for i in 0..n {
            for j in 0..n {
                let at =
                    floor[0] + (DVec3::new(f64::from(i), f64::from(j), 0.0) + DVec3::new(0.5, 0.5, 0.0)) / f64::from(n);
                up += point_to_polygon(at, DVec3::Z, &ceiling) / f64::from(n * n);
                aside += point_to_polygon(at, DVec3::Z, &wall) / f64::from(n * n);
            }
        }
        assert!((up - parallel_rectangles(1.0, 1.0, 1.0)).abs() < 1e-5, "{up}");
        assert!(
            (aside - perpendicular_rectangles(1.0, 1.0, 1.0)).abs() < 1e-4,
            "{aside}"
        );
    }

    #[test]
    fn a_box_s_faces_look_inside_and_sum_to_one() {
        let inside = DVec3::new(0.3, 0.4, 0.2);
        let mut sum = 0.0;
        for face in box_inside(DVec3::ONE) {
            let normal = (face[1] - face[0]).cross(face[2] - face[0]);
            assert!(normal.dot(inside - face[0]) > 0.0);
            let back = flipped(face);
            assert!((back[1] - back[0]).cross(back[2] - back[0]).dot(inside - face[0]) < 0.0);
            sum += point_to_polygon(DVec3::new(0.3, 0.4, 0.0), DVec3::Z, &face);
        }
        assert!((sum - 1.0).abs() < 1e-14, "{sum}");
    }

    #[test]
    fn slopes() {
        let points: Vec<(f64, f64)> = [1.0, 2.0, 4.0, 8.0]
            .iter()
            .map(|&x| (x, 3.0 * f64::powf(x, -1.5)))
            .collect();
        assert!((slope(&points) + 1.5).abs() < 1e-12);
    }
}
