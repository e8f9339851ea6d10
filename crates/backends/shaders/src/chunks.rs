//! Chunks: runs of triangles culled and drawn together, each with a box.

use crate::upload::split;
use glam::DVec3;
use hemicube_contract::backend::Surface;
use hemicube_contract::bvh::Bounds;
use hemicube_spatial::Octree;
use std::ops::Range;

/// The most triangles of a chunk: with fewer, tests and draws cost more than they save, with more, too little is culled
/// (`docs/dev/gpu.md`).
pub const MOST_TRIANGLES: u32 = 256;

/// The most triangles of a chunk with [`crate::Draw::Compute`]: one for each thread that prepares them.
pub const MOST_OF_TILES: u32 = 64;

/// Chunks of a run, at most: `OF_A_RUN` of `wgsl/tiles.wgsl`. A choice of half a work group: with fewer, runs take
/// longer to look through, with more, more of their chunks are tested in vain.
pub const OF_A_RUN: usize = 32;

/// Below this number of triangles, a software driver draws hidden ones sooner than it finds them (`docs/dev/gpu.md`).
pub const FEWEST_FOR_OCCLUSION: usize = 20_000;

/// A run of triangles in drawing order, and its box. `Chunk` of `wgsl/shared.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunk {
    /// Its first index in [`crate::Upload::indices`].
    pub first_index: u32,
    /// Number of indices.
    pub index_count: u32,
    /// The middle of its box.
    pub center: DVec3,
    /// Half the sides of its box, rounded up.
    pub half_sides: DVec3,
}

/// Words of a chunk on the device.
pub const CHUNK_WORDS: usize = 12;

impl Chunk {
    /// Returns the chunk in the shaders' layout.
    pub fn words(&self) -> [u32; CHUNK_WORDS] {
        let (high, low) = split(self.center);
        // Rounding the half sides to f32 is the largest error; the middle is exact to 2⁻⁴⁸.
        #[allow(clippy::cast_possible_truncation, reason = "made wider than the rounding")]
        let half = self.half_sides.to_array().map(|h| (h * (1.0 + 1e-6) + 1e-9) as f32);
        let [hx, hy, hz] = high.map(f32::to_bits);
        let [lx, ly, lz] = low.map(f32::to_bits);
        let [sx, sy, sz] = half.map(f32::to_bits);
        [
            hx,
            hy,
            hz,
            self.first_index,
            lx,
            ly,
            lz,
            self.index_count,
            sx,
            sy,
            sz,
            0,
        ]
    }
}

/// Joins neighbouring chunks to runs of chunks, which tiles look through first. A run's `first_index` is the number
/// of its first chunk, its `index_count` that of its chunks.
pub fn runs_of_chunks(chunks: &[Chunk]) -> Vec<Chunk> {
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let runs = chunks.chunks(OF_A_RUN).enumerate();
    runs.map(|(run, members)| {
        let low = members
            .iter()
            .fold(DVec3::INFINITY, |low, c| low.min(c.center - c.half_sides));
        let high = members
            .iter()
            .fold(DVec3::NEG_INFINITY, |high, c| high.max(c.center + c.half_sides));
        Chunk {
            first_index: count(run * OF_A_RUN),
            index_count: count(members.len()),
            center: (low + high) * 0.5,
            half_sides: (high - low) * 0.5,
        }
    })
    .collect()
}

/// Cuts surfaces into runs of at most `most`, in the octree's order: whole nodes, if they are small enough, and else
/// the node's own surfaces apart from its children. Joins small neighbours unless their common box is much larger.
pub fn runs(octree: &Octree, surfaces: &[Surface], most: u32) -> Vec<Range<u32>> {
    let nodes = octree.nodes();
    let mut found: Vec<Range<u32>> = Vec::new();
    let mut pending = if nodes.is_empty() { Vec::new() } else { vec![0u32] };
    let mut parts = |range: Range<u32>| {
        let count = (range.end - range.start).div_ceil(most);
        for part in 0..count {
            // Parts of about the same size.
            let at = |k: u32| {
                let all = u64::from(range.end - range.start);
                #[allow(clippy::cast_possible_truncation, reason = "at most the whole")]
                let offset = (all * u64::from(k) / u64::from(count)) as u32;
                range.start + offset
            };
            found.push(at(part)..at(part + 1));
        }
    };
    if octree.order().len() != surfaces.len() {
        // An octree of other surfaces than these says nothing about them.
        parts(0..u32::try_from(surfaces.len()).unwrap_or(u32::MAX));
        pending.clear();
    }
    while let Some(node) = pending.pop() {
        let node = &nodes[node as usize];
        if node.all().len() <= most as usize {
            parts(node.all());
        } else {
            parts(node.own());
            pending.extend(node.children().rev());
        }
    }
    join(found, surfaces, most)
}

/// The largest half area of a joined box, relative to its two parts together.
const JOINED: f64 = 1.25;

fn join(runs: Vec<Range<u32>>, surfaces: &[Surface], most: u32) -> Vec<Range<u32>> {
    let mut joined: Vec<(Range<u32>, Bounds)> = Vec::with_capacity(runs.len());
    for run in runs {
        let bounds = surfaces[run.start as usize..run.end as usize]
            .iter()
            .fold(Bounds::EMPTY, |bounds, surface| {
                bounds.union(Bounds::of(surface.corners))
            });
        if let Some((last, whole)) = joined.last_mut()
            && run.end - last.start <= most
            && last.end == run.start
        {
            let both = whole.union(bounds);
            if both.half_area() <= JOINED * (whole.half_area() + bounds.half_area()) {
                last.end = run.end;
                *whole = both;
                continue;
            }
        }
        joined.push((run, bounds));
    }
    joined.into_iter().map(|(run, _)| run).collect()
}
