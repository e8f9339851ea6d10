//! What patches would cover alone, sixteen at a time.

use crate::Shared;
use crate::engine::ALL_FACES;
use crate::kernel::{Frame, Kernel, Transformed};
use hemicube::face::Face;
use hemicube::tree::{Block, LANES, UNUSED};
use std::marker::PhantomData;

/// Counts what patches cover alone, by the rasteriser that draws them.
#[derive(Debug)]
pub(crate) struct Alone<K> {
    block: Box<Block>,
    triangles: Box<Transformed>,
    counts: Vec<(u32, u32)>,
    kernel: PhantomData<K>,
}

impl<K: Kernel> Alone<K> {
    pub(crate) fn new() -> Self {
        Self {
            block: Box::new(Block {
                corners: [[0.0; LANES]; 9],
                negative: [UNUSED; LANES],
                positive: [UNUSED; LANES],
            }),
            triangles: Box::new(Transformed::new()),
            counts: Vec::new(),
            kernel: PhantomData,
        }
    }

    /// Pixels and weight of each patch, in order.
    pub(crate) fn count(&mut self, shared: &Shared, frame: &Frame, patches: &[u32]) -> &[(u32, u32)] {
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        self.counts.clear();
        for patches in patches.chunks(LANES) {
            for (lane, &patch) in patches.iter().enumerate() {
                let (block, from) = shared.surface_of(patch);
                for (to, corners) in self.block.corners.iter_mut().zip(&block.corners) {
                    to[lane] = corners[from];
                }
                self.block.negative[lane] = block.negative[from];
                self.block.positive[lane] = block.positive[from];
            }
            let mut counts = [(0, 0); LANES];
            let resolution = shared.settings.resolution as usize;
            // SAFETY: `Isa::available` checked the machine for K's instruction set before any engine was made.
            unsafe {
                K::transform(&self.block, frame, &mut self.triangles);
                let lanes = u16::MAX >> (LANES - patches.len());
                K::cover_lanes(&self.triangles, lanes, ALL_FACES, resolution, top, side, &mut counts);
            }
            self.counts.extend(&counts[..patches.len()]);
        }
        &self.counts
    }
}
