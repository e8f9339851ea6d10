//! One glam in the tree, and it is the one that obvhs takes: two would give two `DVec3` types, and a user of obvhs
//! could not hand over our points.

use hemicube_tests::scenes::workspace;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::triangle::Triangle;

/// How many packages of a name a lock file holds.
fn packages(lock: &str, name: &str) -> usize {
    lock.lines()
        .filter(|line| line.strip_prefix("name = ") == Some(format!("\"{name}\"").as_str()))
        .count()
}

#[test]
fn one_glam() {
    let path = workspace().join("Cargo.lock");
    let lock = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(packages(&lock, "glam"), 1, "more than one glam, or none");
    assert_eq!(packages(&lock, "obvhs"), 1);
    let two = lock.replace(
        "name = \"glam\"",
        "name = \"glam\"\nversion = \"0\"\n\n[[package]]\nname = \"glam\"",
    );
    assert_eq!(packages(&two, "glam"), 2, "a second glam was not noticed");
}

#[test]
fn obvhs_takes_our_vectors() {
    let corners = hemicube_tests::geometry::box_inside(glam::DVec3::ONE)
        .into_iter()
        .flat_map(hemicube_tests::geometry::quad);
    // The types of one crate assigned to fields of another: this compiles only while both are of one glam.
    let triangles: Vec<Triangle> = corners
        .map(|[a, b, c]| Triangle {
            v0: a.as_vec3a(),
            v1: b.as_vec3a(),
            v2: c.as_vec3a(),
        })
        .collect();
    assert_eq!(triangles.len(), 12);
    let boxes: Vec<obvhs::aabb::Aabb> = triangles.iter().map(Triangle::aabb).collect();
    let indices: Vec<u32> = (0..12).collect();
    let bvh = PlocBuilder::new().build(PlocSearchDistance::Medium, &boxes, indices, SortPrecision::U64, 1);
    assert!(!bvh.nodes.is_empty());
}
