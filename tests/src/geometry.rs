//! Geometry written inline in tests, rigid motions, and closed forms of form factors.
//!
//! Point to polygon (Lambert 1760; Baum, Rushmeier & Winget 1989, eq. 5): with the receiver at the origin and a, b the
//! ends of an edge, F = (1/2π) |Σ θ(a, b) n · (a × b)/|a × b||, after clipping the polygon at the receiver's horizon.

use glam::{DQuat, DVec3};
use hemicube_scene::{Material, Scene, Subdivision, Triangle};
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

/// The faces of the box from `low` to `low + size`, seen from outside, in the order of [`box_inside`].
pub fn box_outside(low: DVec3, size: DVec3) -> [[DVec3; 4]; 6] {
    box_inside(DVec3::ONE).map(|face| flipped(face).map(|p| low + p * size))
}

/// Points of a circle round the z axis, counter-clockwise.
pub fn circle(count: u32, radius: f64, z: f64) -> Vec<DVec3> {
    (0..count)
        .map(|k| {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / f64::from(count)).sin_cos();
            DVec3::new(radius * cosine, radius * sine, z)
        })
        .collect()
}

/// The quad seen from the other side, from the same first corner.
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

/// The unoccluded form factor between two planar polygons that do not touch, each wholly in front of the other: A F =
/// 1/2π ∮∮ ln r dl · dl' (Sparrow 1963), by 16 Gauss points an edge, or 4 for short and many edges.
pub fn between_polygons(from: &[DVec3], to: &[DVec3]) -> f64 {
    // Abscissas and weights on (−1, 1), half of them: the rule is symmetric.
    const FOUR: [(f64, f64); 2] = [
        (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
    ];
    const SIXTEEN: [(f64, f64); 8] = [
        (0.095_012_509_837_637_4, 0.189_450_610_455_068_5),
        (0.281_603_550_779_258_9, 0.182_603_415_044_923_6),
        (0.458_016_777_657_227_4, 0.169_156_519_395_002_5),
        (0.617_876_244_402_643_7, 0.149_595_988_816_576_7),
        (0.755_404_408_355_003_0, 0.124_628_971_255_533_9),
        (0.865_631_202_387_831_7, 0.095_158_511_682_492_8),
        (0.944_575_023_073_232_6, 0.062_253_523_938_647_9),
        (0.989_400_934_991_649_9, 0.027_152_459_411_754_1),
    ];
    let half: &[(f64, f64)] = if from.len() + to.len() > 16 { &FOUR } else { &SIXTEEN };
    let rule: Vec<(f64, f64)> = half
        .iter()
        .flat_map(|&(x, w)| [(0.5 - 0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)])
        .collect();
    let edges = |polygon: &[DVec3]| -> Vec<(DVec3, Vec<(DVec3, f64)>)> {
        (0..polygon.len())
            .map(|k| {
                let (p, q) = (polygon[k], polygon[(k + 1) % polygon.len()]);
                (q - p, rule.iter().map(|&(t, w)| (p + (q - p) * t, w)).collect())
            })
            .collect()
    };
    let (own, other) = (edges(from), edges(to));
    let mut sum = 0.0;
    for (edge, points) in &own {
        for (facing, targets) in &other {
            let mut mean = 0.0;
            for &(x, w) in points {
                mean += w * targets
                    .iter()
                    .map(|&(y, v)| v * x.distance_squared(y).ln())
                    .sum::<f64>();
            }
            sum += edge.dot(*facing) * mean;
        }
    }
    sum.abs() / (2.0 * TAU * polygon_area(from))
}

/// The area of a planar polygon.
pub fn polygon_area(polygon: &[DVec3]) -> f64 {
    let cross = |k: usize| (polygon[k] - polygon[0]).cross(polygon[(k + 1) % polygon.len()] - polygon[0]);
    0.5 * (0..polygon.len()).map(cross).sum::<DVec3>().length()
}

/// The unoccluded form factor from a triangle to a planar polygon, touching or not, and its error bound: the point's
/// closed form over parts of the triangle, cut into four while that changes more than a millionth.
pub fn triangle_to_polygon(triangle: &[DVec3; 3], polygon: &[DVec3]) -> (f64, f64) {
    const DEEPEST: u32 = 9;
    const ENOUGH: f64 = 1e-6;
    let cross = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let normal = cross.normalize();
    let at = |[a, b, c]: [DVec3; 3]| point_to_polygon((a + b + c) / 3.0, normal, polygon);
    let parts = |[a, b, c]: [DVec3; 3]| {
        let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    };
    // Changes are relative to the mean over 64 parts.
    let fine: Vec<[DVec3; 3]> = parts(*triangle).into_iter().flat_map(parts).flat_map(parts).collect();
    let scale = fine.iter().map(|&part| at(part)).sum::<f64>() / fine.len() as f64;
    let (mut sum, mut off) = (0.0, 0.0);
    let mut pending = vec![(*triangle, at(*triangle), 0, 1.0)];
    while let Some((part, coarse, depth, share)) = pending.pop() {
        let four = parts(part).map(|part| (part, at(part)));
        let finer = four.iter().map(|p| p.1).sum::<f64>() / 4.0;
        let change = share * (finer - coarse).abs();
        if depth >= 3 && (change <= ENOUGH * scale * share.sqrt() || depth == DEEPEST) {
            // The midpoint rule errs with the square of the width.
            sum += share * (finer + (finer - coarse) / 3.0);
            off += change / 3.0;
        } else {
            pending.extend(four.map(|(part, value)| (part, value, depth + 1, share / 4.0)));
        }
    }
    (sum, off)
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

/// From the rectangle `from` to the rectangle `to` of a parallel plane at distance c, each the product of two
/// intervals, edges along the same axes (Howell's catalogue, C-13): a signed sum of factors of opposite rectangles.
pub fn parallel_rectangles_apart(from: [[f64; 2]; 2], to: [[f64; 2]; 2], c: f64) -> f64 {
    let exchange = |a: f64, b: f64| {
        if a == 0.0 || b == 0.0 {
            0.0
        } else {
            0.25 * a * b * parallel_rectangles(a, b, c)
        }
    };
    let mut sum = 0.0;
    for corner in 0..16_usize {
        let ends = [0, 1, 2, 3].map(|bit| corner >> bit & 1);
        let x = (from[0][ends[0]] - to[0][ends[1]]).abs();
        let y = (from[1][ends[2]] - to[1][ends[3]]).abs();
        let sign = if (ends[0] == ends[1]) == (ends[2] == ends[3]) {
            1.0
        } else {
            -1.0
        };
        sum += sign * exchange(x, y);
    }
    sum / ((from[0][1] - from[0][0]) * (from[1][1] - from[1][0]))
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

/// The best exponent p of y ∝ xᵖ: the slope of the least-squares line through the logarithms.
pub fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (x, y) = logs
        .iter()
        .fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
    let covariance: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

/// Half or all of a sphere, from an octahedron: each face's edges in `pieces`, points moved onto the sphere.
pub fn sphere(pieces: u32, radius: f64, inwards: bool, whole: bool) -> Vec<[DVec3; 3]> {
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut faces = vec![[x, y, z], [y, -x, z], [-x, -y, z], [-y, x, z]];
    if whole {
        faces.extend(faces.clone().into_iter().map(|[a, b, c]| [b, a, -c]));
    }
    let mut parts = Vec::new();
    faces
        .iter()
        .for_each(|face| Subdivision::Split(pieces).cut(face, &mut parts));
    let turn = |[a, b, c]: [DVec3; 3]| if inwards { [a, c, b] } else { [a, b, c] };
    parts
        .into_iter()
        .map(|t| turn(t.map(|p| p.normalize() * radius)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms_agree_with_each_other_and_with_known_values() {
        assert!((parallel_rectangles(1.0, 1.0, 1.0) - 0.199_824_895_698_387).abs() < 1e-14);
        assert!((perpendicular_rectangles(1.0, 1.0, 1.0) - 0.200_043_776_075_403).abs() < 1e-14);
        assert!((perpendicular_rectangles(1.0, 3.0, 2.0) - 0.308_140_292_981_996).abs() < 1e-14);
        let box_ = box_inside(DVec3::ONE);
        let by_contours = between_polygons(&box_[0], &box_[1]);
        assert!(
            (by_contours - parallel_rectangles(1.0, 1.0, 1.0)).abs() < 1e-12,
            "{by_contours}"
        );
        let corner = [[0.0, 1.0], [0.0, 1.0]];
        let apart = parallel_rectangles_apart(corner, [[1.0, 2.0], [0.0, 1.0]], 1.0);
        assert!((apart - 0.086_050_489_152_327_3).abs() < 1e-14, "{apart}");
        let overlap = parallel_rectangles_apart(corner, [[0.3, 1.3], [-0.6, 0.4]], 1e-9);
        assert!((overlap - 0.28).abs() < 1e-8, "{overlap}");
        let shifted = box_[1].map(|p| p + DVec3::new(0.3, -0.6, 0.0));
        let apart = parallel_rectangles_apart(corner, [[0.3, 1.3], [-0.6, 0.4]], 1.0);
        assert!((between_polygons(&box_[0], &shifted) - apart).abs() < 1e-12);
        let (sum, off) = quad(box_[0])
            .iter()
            .map(|t| triangle_to_polygon(t, &box_[2]))
            .fold((0.0, 0.0), |a, b| (a.0 + 0.5 * b.0, a.1 + 0.5 * b.1));
        assert!(
            (sum - perpendicular_rectangles(1.0, 1.0, 1.0)).abs() < 1e-5,
            "{sum}, {off}"
        );
        assert!(off < 1e-4, "{off}");
        assert!((polygon_area(&box_[4]) - 1.0).abs() < 1e-15);
        // The floor's mean over its points is the factor between the areas: the midpoint rule converges with its
        // square.
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
