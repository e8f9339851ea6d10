//! Coding and ordering of points on a bumpy sheet, 10k and 1M.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, invert, morton, order_by_normal_and_position, order_by_position};
use std::hint::black_box;

/// Normals and positions, listed in an order without locality.
fn sheet(count: u32) -> (Vec<DVec3>, Vec<DVec3>) {
    let point = |k: u32| {
        let (x, y) = (
            f64::from(k) * 0.754_877_666_246_693 % 1.0,
            f64::from(k) * 0.569_840_290_998_053 % 1.0,
        );
        let (slope_x, slope_y) = ((x * 40.0).cos(), (y * 40.0).cos());
        (
            DVec3::new(-slope_x, -slope_y, 1.0),
            DVec3::new(x, y, ((x * 40.0).sin() + (y * 40.0).sin()) / 40.0),
        )
    };
    (0..count).map(point).unzip()
}

fn morton_benches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("morton");
    group.sample_size(10);
    for (name, count) in [("10k", 10_000), ("1M", 1_000_000)] {
        let (normals, positions) = sheet(count);
        let bounds = Aabb::from_points(positions.iter().copied());
        group.throughput(Throughput::Elements(u64::from(count)));
        group.bench_function(BenchmarkId::new("position_code", name), |b| {
            b.iter(|| {
                positions
                    .iter()
                    .fold(0, |sum, &p| sum ^ morton::position_code(black_box(p)))
            });
        });
        group.bench_function(BenchmarkId::new("normal_code", name), |b| {
            b.iter(|| {
                normals
                    .iter()
                    .fold(0, |sum, &n| sum ^ morton::normal_code(black_box(n)))
            });
        });
        group.bench_function(BenchmarkId::new("order_by_position", name), |b| {
            b.iter(|| order_by_position(&positions, bounds));
        });
        group.bench_function(BenchmarkId::new("order_by_normal_and_position", name), |b| {
            b.iter(|| order_by_normal_and_position(&normals, &positions, bounds));
        });
        let order = order_by_position(&positions, bounds);
        group.bench_function(BenchmarkId::new("invert", name), |b| b.iter(|| invert(&order)));
    }
    group.finish();
}

criterion_group!(benches, morton_benches);
criterion_main!(benches);
