//! Orders the patches of two spheres, and shows the gain: consecutive patches look the same way and lie near each
//! other, so that data in the cache serves the next patch, too.
//!
//! `cargo run --release -p hemicube-spatial --example order_points`
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, invert, order_by_normal_and_position, order_by_position};

/// Points evenly spread over the unit sphere, in the order of a generator that jumps about.
fn sphere(count: u32) -> Vec<DVec3> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let point = |k: u32| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
        let (sin, cos) = (golden_angle * f64::from(k)).sin_cos();
        DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
    };
    (0..count).map(point).collect()
}

/// Mean distance, and mean angle in degrees, from one item to the next.
fn steps(order: &[u32], positions: &[DVec3], normals: &[DVec3]) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for pair in order.windows(2) {
        let [a, b] = [pair[0] as usize, pair[1] as usize];
        sum.0 += positions[a].distance(positions[b]);
        sum.1 += normals[a].angle_between(normals[b]).to_degrees();
    }
    let count = (order.len() - 1) as f64;
    (sum.0 / count, sum.1 / count)
}

fn main() {
    // Two spheres, one beside the other: equal normals, different places.
    let normals: Vec<DVec3> = sphere(20_000).repeat(2);
    let shift = |k: usize| if k < 20_000 { DVec3::ZERO } else { DVec3::X * 3.0 };
    let positions: Vec<DVec3> = normals.iter().enumerate().map(|(k, &n)| n + shift(k)).collect();
    let bounds = Aabb::from_points(positions.iter().copied());

    let input: Vec<u32> = (0..40_000).collect();
    let by_position = order_by_position(&positions, bounds);
    let by_both = order_by_normal_and_position(&normals, &positions, bounds);

    println!("{:<20} {:>10} {:>10}", "order", "mean step", "mean turn");
    for (name, order) in [
        ("input", &input),
        ("position", &by_position),
        ("normal and position", &by_both),
    ] {
        let (distance, angle) = steps(order, &positions, &normals);
        println!("{name:<20} {distance:>10.4} {angle:>9.2}°");
    }
    println!("patch 0 is at place {} of the last", invert(&by_both)[0]);
}
