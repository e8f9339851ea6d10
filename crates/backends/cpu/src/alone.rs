//! What patches would cover alone, sixteen at a time.

use crate::Shared;
use crate::engine::ALL_FACES;
use crate::kernel::{Frame, Kernel, Transformed};
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::face::Face;
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
            block: Box::new(Block::empty()),
            triangles: Box::new(Transformed::new()),
            counts: Vec::new(),
            kernel: PhantomData,
        }
    }

    /// Pixels and weight of each patch, in order.
    pub(crate) fn count(&mut self, shared: &Shared, frame: &Frame, patches: &[u32]) -> &[(u32, u32)] {
        self.count_each(shared, frame, patches, Shared::put)
    }

    /// Pixels and weight of what is drawn with each id, in order.
    pub(crate) fn count_drawn(&mut self, shared: &Shared, frame: &Frame, ids: &[u32]) -> &[(u32, u32)] {
        self.count_each(shared, frame, ids, Shared::put_drawn)
    }

    fn count_each(
        &mut self,
        shared: &Shared,
        frame: &Frame,
        patches: &[u32],
        put: impl Fn(&Shared, u32, usize, &mut Block),
    ) -> &[(u32, u32)] {
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        self.counts.clear();
        for patches in patches.chunks(LANES) {
            for (lane, &patch) in patches.iter().enumerate() {
                put(shared, patch, lane, &mut self.block);
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
