//! Covered weights: the pixels and the weight that a patch would have alone.

use super::{ALL_FACES, View};
use crate::SharedScene;
use crate::kernel::{Count, Transformed};
use hemicube_contract::bvh::{Block, LANES};

/// Counts covered weights by the rasteriser that draws, sixteen patches at a time.
#[derive(Debug)]
pub(super) struct CoveredCounter {
    block: Box<Block>,
    triangles: Box<Transformed>,
    counts: Vec<Count>,
}

impl CoveredCounter {
    pub(super) fn new() -> Self {
        Self {
            block: Box::new(Block::empty()),
            triangles: Box::new(Transformed::new()),
            counts: Vec::new(),
        }
    }

    /// Counts patches, in their order.
    pub(super) fn count(&mut self, view: View<'_>, patches: &[u32]) -> &[Count] {
        self.count_each(view, patches, SharedScene::put)
    }

    /// Counts drawn triangles by their ids, in their order.
    pub(super) fn count_drawn(&mut self, view: View<'_>, ids: &[u32]) -> &[Count] {
        self.count_each(view, ids, SharedScene::put_drawn)
    }

    fn count_each(
        &mut self,
        view: View<'_>,
        patches: &[u32],
        put: impl Fn(&SharedScene, u32, usize, &mut Block),
    ) -> &[Count] {
        let isa = view.scene.isa;
        self.counts.clear();
        for patches in patches.chunks(LANES) {
            for (lane, &patch) in patches.iter().enumerate() {
                put(view.scene, patch, lane, &mut self.block);
            }
            let mut counts = [Count::default(); LANES];
            isa.transform(&self.block, view.frame, &mut self.triangles);
            let lanes = u16::MAX >> (LANES - patches.len());
            isa.cover_lanes(&self.triangles, lanes, ALL_FACES, &view.scene.table, &mut counts);
            self.counts.extend(&counts[..patches.len()]);
        }
        &self.counts
    }
}
