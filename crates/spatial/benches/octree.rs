//! Building an octree over the tiles of a bumpy sheet and culling by the five sides of a hemicube, 10k and 1M; culling
//! beside testing every box.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, Containment, CullCounters, Frustum, Octree, OctreeOptions, Visit};

/// side² tiles of a sheet of unit size, row by row.
fn sheet(side: u32) -> Vec<Aabb> {
    let point = |i: u32, j: u32| {
        let (x, y) = (f64::from(i) / f64::from(side), f64::from(j) / f64::from(side));
        DVec3::new(x, y, ((x * 40.0).sin() + (y * 40.0).sin()) / 40.0)
    };
    let tile = |k: u32| {
        let (i, j) = (k % side, k / side);
        Aabb::from_points([point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1)])
    };
    (0..side * side).map(tile).collect()
}

/// The faces of a hemicube that looks along x from just above the middle of the sheet.
fn faces(eye: DVec3) -> Vec<Frustum> {
    let (x, y, z) = (DVec3::Y, DVec3::Z, DVec3::X);
    let top = [z - x - y, z + x - y, z + x + y, z - x + y];
    let side = |out: DVec3, along: DVec3| [out - along, out + along, out + along + z, out - along + z];
    [top, side(x, y), side(-x, y), side(y, x), side(-y, x)]
        .map(|corners| Frustum::pyramid(eye, corners).expect("a right pyramid"))
        .to_vec()
}

fn octree_benches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("octree");
    group.sample_size(10);
    for (name, side) in [("10k", 100), ("1M", 1000)] {
        let boxes = sheet(side);
        let options = OctreeOptions::default();
        group.bench_function(BenchmarkId::new("build", name), |b| {
            b.iter(|| Octree::build(&boxes, options))
        });
        group.bench_function(BenchmarkId::new("build_loose", name), |b| {
            b.iter(|| Octree::build_loose(&boxes, options));
        });
        let octree = Octree::build(&boxes, options).expect("finite boxes");
        group.bench_function(BenchmarkId::new("validate", name), |b| {
            b.iter(|| octree.validate(&boxes))
        });
        let eye = DVec3::new(0.5, 0.5, 0.06);
        let faces = faces(eye);
        group.bench_function(BenchmarkId::new("cull_five_faces", name), |b| {
            b.iter(|| {
                let (mut items_drawn, mut counters) = (0, CullCounters::default());
                for face in &faces {
                    counters += octree.cull(face, |items, _| items_drawn += items.len());
                }
                (items_drawn, counters)
            });
        });
        group.bench_function(BenchmarkId::new("test_every_box_five_faces", name), |b| {
            b.iter(|| {
                let drawn = |face: &Frustum| {
                    boxes
                        .iter()
                        .filter(|b| face.classify(b) != Containment::Outside)
                        .count()
                };
                faces.iter().map(drawn).sum::<usize>()
            });
        });
        group.bench_function(BenchmarkId::new("front_to_back", name), |b| {
            b.iter(|| {
                let mut items_seen = 0;
                octree.visit_front_to_back(eye, |_, node| {
                    items_seen += node.own().len();
                    Visit::Descend
                });
                items_seen
            });
        });
    }
    group.finish();
}

criterion_group!(benches, octree_benches);
criterion_main!(benches);
