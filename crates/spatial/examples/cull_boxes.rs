//! Builds an octree over a city of boxes and looks down one of its streets: how few boxes need testing, and which are
//! nearest.
//!
//! `cargo run --release -p hemicube-spatial --example cull_boxes`
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, Containment, Frustum, Octree, OctreeOptions, Visit};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    // 300 × 300 houses, 8 m wide, every 12 m, up to 40 m high.
    let house = |k: u32| {
        let corner = DVec3::new(f64::from(k % 300), f64::from(k / 300), 0.0) * 12.0;
        let height = 4.0 + f64::from(k * 2_654_435 % 37);
        Aabb::from_points([corner, corner + DVec3::new(8.0, 8.0, height)])
    };
    let boxes: Vec<Aabb> = (0..90_000).map(house).collect();
    let (max_level, min_items) = (12, 16);
    let octree = Octree::build(&boxes, OctreeOptions { max_level, min_items })?;
    octree.validate(&boxes)?;
    println!("{} boxes, {} nodes", boxes.len(), octree.nodes().len());

    let eye = DVec3::new(1798.0, 300.0, 2.0);
    let corners = [(-0.5, -0.3), (0.5, -0.3), (0.5, 0.3), (-0.5, 0.3)].map(|(x, z)| DVec3::new(x, 1.0, z));
    let frustum = Frustum::pyramid(eye, corners)?;
    let (mut inside, mut straddling, mut ranges) = (0, 0, 0);
    let counters = octree.cull(&frustum, |items, containment| {
        ranges += 1;
        match containment {
            Containment::Inside => inside += items.len(),
            _ => straddling += items.len(),
        }
    });
    println!("inside {inside}, straddling {straddling}, in {ranges} ranges");
    println!("culled {}, with {} tests", counters.items_culled, counters.nodes_tested);

    // The nearest in view, by walking outwards and leaving out what is farther than the best so far.
    let (mut nearest, mut best, mut visited) = (None, f64::INFINITY, 0);
    octree.visit_front_to_back(eye, |_, node| {
        visited += 1;
        if node.bounds.distance_squared(eye) > best {
            return Visit::Skip;
        }
        for &item in &octree.order()[node.first_item as usize..node.own_end as usize] {
            let house = &boxes[item as usize];
            let distance = house.distance_squared(eye);
            if distance < best && frustum.classify(house) != Containment::Outside {
                (nearest, best) = (Some(item), distance);
            }
        }
        Visit::Descend
    });
    println!(
        "nearest in view: {nearest:?}, {:.1} m, after {visited} nodes",
        best.sqrt()
    );
    Ok(())
}
