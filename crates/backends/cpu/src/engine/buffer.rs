//! The nearest surface at each pixel: the buffers that engines `depth` and `claims` draw into.

use crate::SharedScene;
use crate::kernel::{
    AtlasBox, Coverage, DepthBuffer, Drawn, GROUP, InstructionSet, LanesOnFace, OwnershipBuffer, RunIndex, Sums,
    face_of_row, is_small,
};
use hemicube_contract::backend::Culling;
use hemicube_contract::bvh::LANES;
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::Face;

/// The nearest surface at each pixel of a hemicube's atlas.
pub(crate) trait Buffer {
    /// A clear buffer.
    fn new(scene: &SharedScene) -> Self;

    /// Draws lanes of a block on a face. With `COUNT`, adds each lane's covered pixels to `pixels`.
    fn draw<const COUNT: bool>(
        &mut self,
        scene: &SharedScene,
        lanes: LanesOnFace<'_>,
        pixels: &mut [u32; LANES],
    ) -> Drawn;

    /// Returns true if every pixel of a box on a face is surely nearer than `bound`, in 1/w.
    fn is_hidden(&mut self, isa: InstructionSet, face: Face, pixels: AtlasBox, bound: f32) -> bool;

    /// Lower bound on 1/w at a pixel for the rest of the hemicube.
    fn at_least(&self, row: usize, column: usize) -> f32;

    /// Visible id at a pixel, and its 1/w.
    fn seen_at(&self, row: usize, column: usize) -> (u32, f32);

    /// Sets the bits of the pixels that hit nothing in `out`, a clear mask of the same resolution.
    fn write_escaped(&self, out: &mut EscapedPixels);

    /// Appends the visible id of each pixel of the atlas, row by row.
    fn write_items(&self, out: &mut Vec<u32>);

    /// Appends the row and column of each pixel of an indexed id, after the reduction.
    fn pixels_of(&self, id: u32, out: &mut Vec<(usize, usize)>);

    /// Adds up the visible weights of each id. With parent triangles, the buffer then knows the visible pixels of each
    /// subdivided one until it is forgotten; without, the buffer is ready to be cleared.
    fn reduce(&mut self, scene: &SharedScene, sums: &mut Sums);

    /// Uncovers in `coverage` the visible pixels of a subdivided parent; returns their faces.
    fn uncover(&self, id: u32, coverage: &mut Coverage) -> u8;

    /// Covers the visible pixels of a subdivided parent.
    fn cover(&self, id: u32, coverage: &mut Coverage);

    /// Forgets the visible pixels of a subdivided parent.
    fn forget(&mut self, id: u32);

    /// Clears the buffer for the next hemicube, after all parents are forgotten.
    fn clear(&mut self);
}

/// Index of the subdivided parents' ids.
fn index(scene: &SharedScene) -> RunIndex {
    match &scene.parents {
        Some(parents) => RunIndex::new(nothing(scene) as usize + 1, parents.subdivided_ids()),
        None => RunIndex::default(),
    }
}

/// The id of pixels that hit nothing: two above the patches, after that of blocked pixels.
fn nothing(scene: &SharedScene) -> u32 {
    scene.tree.patch_count + 1
}

impl DepthBuffer {
    fn depth_of_tile(&mut self, isa: InstructionSet, tile: usize, tile_row: usize, column: usize) -> f32 {
        if self.dirty[tile] {
            self.dirty[tile] = false;
            let chunks = self.chunks_per_row();
            self.tile_depth[tile] = isa.tile_depth(&self.depth, tile_row * GROUP * chunks + column, chunks);
        }
        self.tile_depth[tile]
    }

    fn place(&self, row: usize, column: usize) -> (usize, usize) {
        (row * self.chunks_per_row() + column / LANES, column % LANES)
    }
}

impl Buffer for DepthBuffer {
    fn new(scene: &SharedScene) -> Self {
        let culling = scene.settings.culling == Culling::On;
        Self::new(scene.settings.resolution, nothing(scene), culling, index(scene))
    }

    fn draw<const COUNT: bool>(
        &mut self,
        scene: &SharedScene,
        lanes: LanesOnFace<'_>,
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        scene.isa.draw_depth::<COUNT>(lanes, self, pixels)
    }

    #[inline]
    fn is_hidden(&mut self, isa: InstructionSet, _face: Face, [x0, x1, y0, y1]: AtlasBox, bound: f32) -> bool {
        let chunks = self.chunks_per_row();
        if is_small([x0, x1, y0, y1]) {
            return isa.all_nearer(&self.depth, chunks, [x0, x1, y0, y1], bound);
        }
        for tile_row in y0 / GROUP..=y1 / GROUP {
            for column in x0 / LANES..=x1 / LANES {
                if self.depth_of_tile(isa, tile_row * chunks + column, tile_row, column) <= bound {
                    return false;
                }
            }
        }
        true
    }

    fn at_least(&self, row: usize, column: usize) -> f32 {
        // Depths only grow.
        self.seen_at(row, column).1
    }

    #[inline]
    fn seen_at(&self, row: usize, column: usize) -> (u32, f32) {
        let (chunk, place) = self.place(row, column);
        (self.items[chunk].0[place], self.depth[chunk].0[place])
    }

    fn write_escaped(&self, out: &mut EscapedPixels) {
        let chunks = self.chunks_per_row();
        for (row, chunks) in (0..).zip(self.items.chunks_exact(chunks)) {
            for (chunk, items) in chunks.iter().enumerate() {
                let lanes = (0..LANES).fold(0, |bits, lane| bits | u64::from(items.0[lane] == self.nothing) << lane);
                out.row_mut(row)[chunk * LANES / 64] |= lanes << (chunk * LANES % 64);
            }
        }
    }

    fn write_items(&self, out: &mut Vec<u32>) {
        out.reserve(self.items.len() * LANES);
        for chunk in &self.items {
            out.extend_from_slice(&chunk.0);
        }
    }

    fn pixels_of(&self, id: u32, out: &mut Vec<(usize, usize)>) {
        for place in self.index.of(id) {
            let run = self.runs[place];
            out.extend((usize::from(run.start)..usize::from(run.end)).map(|x| (run.row as usize, x)));
        }
    }

    fn reduce(&mut self, scene: &SharedScene, sums: &mut Sums) {
        scene.isa.reduce(self, &scene.table, sums);
    }

    fn uncover(&self, id: u32, coverage: &mut Coverage) -> u8 {
        let mut faces = 0;
        for place in self.index.of(id) {
            let run = &self.runs[place];
            coverage.uncover_span(run.row as usize, usize::from(run.start), usize::from(run.end));
            faces |= face_of_row(run.row as usize, self.resolution);
        }
        faces
    }

    fn cover(&self, id: u32, coverage: &mut Coverage) {
        for place in self.index.of(id) {
            let run = &self.runs[place];
            coverage.cover_span(run.row as usize, usize::from(run.start), usize::from(run.end));
        }
    }

    fn forget(&mut self, id: u32) {
        self.index.forget(id);
    }

    fn clear(&mut self) {
        // Without an index, the reduction cleared it.
        if self.index.is_used() {
            self.clear_all();
        }
    }
}

impl Buffer for OwnershipBuffer {
    fn new(scene: &SharedScene) -> Self {
        let culling = scene.settings.culling == Culling::On;
        Self::new(&scene.table, nothing(scene), culling, index(scene))
    }

    fn draw<const COUNT: bool>(
        &mut self,
        scene: &SharedScene,
        lanes: LanesOnFace<'_>,
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        let running = scene.table.running(lanes.face);
        scene.isa.draw_owned::<COUNT>(lanes, self, running, pixels)
    }

    #[inline]
    fn is_hidden(&mut self, isa: InstructionSet, face: Face, pixels: AtlasBox, bound: f32) -> bool {
        isa.is_hidden(self, face, pixels, bound)
    }

    fn at_least(&self, row: usize, column: usize) -> f32 {
        self.at_least(row, column)
    }

    #[inline]
    fn seen_at(&self, row: usize, column: usize) -> (u32, f32) {
        self.seen_at(row, column)
    }

    fn write_escaped(&self, out: &mut EscapedPixels) {
        self.write_uncovered(out);
    }

    fn write_items(&self, out: &mut Vec<u32>) {
        self.write_items(out);
    }

    fn pixels_of(&self, id: u32, out: &mut Vec<(usize, usize)>) {
        self.pixels_of(id, out);
    }

    fn reduce(&mut self, scene: &SharedScene, sums: &mut Sums) {
        self.reduce(&scene.table, sums);
    }

    fn uncover(&self, id: u32, coverage: &mut Coverage) -> u8 {
        self.each_of(id, coverage, |covered, shows| *covered &= !shows)
    }

    fn cover(&self, id: u32, coverage: &mut Coverage) {
        self.each_of(id, coverage, |covered, shows| *covered |= shows);
    }

    fn forget(&mut self, id: u32) {
        self.forget(id);
    }

    fn clear(&mut self) {
        self.clear();
    }
}
