//! What engines `depth` and `claims` draw into: the nearest surface at each pixel, as depths and ids, or as claims.

use crate::Shared;
use crate::kernel::{
    Claims, Coverage, Drawn, GROUP, Kernel, Noted, Reduction, Sums, Target, Transformed, face_of_row, is_small,
};
use hemicube_contract::backend::Culling;
use hemicube_contract::bvh::LANES;
use hemicube_contract::face::Face;

/// The nearest surface at each pixel of a hemicube's atlas.
///
/// Methods that take a kernel may be called only with one whose instruction set this machine has.
pub(crate) trait Buffer {
    /// An empty one.
    fn new(shared: &Shared) -> Self;

    /// Draws lanes of a block on a face. With `COUNT`, adds the pixels that each covers to `pixels`.
    fn draw<K: Kernel, const COUNT: bool>(
        &mut self,
        shared: &Shared,
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        pixels: &mut [u32; LANES],
    ) -> Drawn;

    /// Whether all of a box of the atlas (inclusive), on a face, is nearer than `bound`, in 1/w. It may say no where it
    /// is.
    fn is_hidden<K: Kernel>(&mut self, face: Face, pixels: [usize; 4], bound: f32) -> bool;

    /// What 1/w at a pixel will be at least.
    fn at_least(&self, row: usize, column: usize) -> f32;

    /// The id of what is seen at a pixel, and its 1/w.
    fn seen_at(&self, row: usize, column: usize) -> (u32, f32);

    /// Adds up what each id shows. Where the scene has triangles that were cut, it is known from then on which pixels
    /// each of them shows, until it is forgotten; else the buffer may be cleared.
    fn reduce<K: Kernel>(&mut self, shared: &Shared, sums: &mut Sums);

    /// Uncovers in `coverage` the pixels that a triangle that was cut shows, by its id; returns the faces that they are
    /// on.
    fn open(&self, id: u32, coverage: &mut Coverage) -> u8;

    /// Covers them.
    fn close(&self, id: u32, coverage: &mut Coverage);

    /// Forgets what it shows.
    fn forget(&mut self, id: u32);

    /// Clears the buffer for the next hemicube; what triangles that were cut show has been forgotten.
    fn clear(&mut self);
}

/// The ids that triangles that were cut are drawn with.
fn noted(shared: &Shared) -> Noted {
    match &shared.wholes {
        Some(wholes) => Noted::new(nothing(shared) as usize + 1, wholes.ids_of_cut()),
        None => Noted::default(),
    }
}

/// One id above the patches is "blocked", the next is "nothing".
fn nothing(shared: &Shared) -> u32 {
    shared.tree.patch_count + 1
}

impl Target {
    fn depth_of_tile<K: Kernel>(&mut self, tile: usize, tile_row: usize, column: usize) -> f32 {
        if self.dirty[tile] {
            self.dirty[tile] = false;
            let chunks = self.chunks_per_row();
            // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
            self.tile_depth[tile] = unsafe { K::tile_depth(&self.depth, tile_row * GROUP * chunks + column, chunks) };
        }
        self.tile_depth[tile]
    }

    fn place(&self, row: usize, column: usize) -> (usize, usize) {
        (row * self.chunks_per_row() + column / LANES, column % LANES)
    }
}

impl Buffer for Target {
    fn new(shared: &Shared) -> Self {
        let settings = &shared.settings;
        Self::new(
            settings.resolution,
            nothing(shared),
            settings.culling == Culling::On,
            noted(shared),
        )
    }

    fn draw<K: Kernel, const COUNT: bool>(
        &mut self,
        _shared: &Shared,
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
        unsafe { K::draw::<COUNT>(triangles, face, lanes, self, pixels) }
    }

    #[inline]
    fn is_hidden<K: Kernel>(&mut self, _face: Face, [x0, x1, y0, y1]: [usize; 4], bound: f32) -> bool {
        let chunks = self.chunks_per_row();
        if is_small([x0, x1, y0, y1]) {
            // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
            return unsafe { K::all_nearer(&self.depth, chunks, [x0, x1, y0, y1], bound) };
        }
        for tile_row in y0 / GROUP..=y1 / GROUP {
            for column in x0 / LANES..=x1 / LANES {
                if self.depth_of_tile::<K>(tile_row * chunks + column, tile_row, column) <= bound {
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

    fn reduce<K: Kernel>(&mut self, shared: &Shared, sums: &mut Sums) {
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
        unsafe { K::reduce(self, Reduction { top, side, sums }) };
    }

    fn open(&self, id: u32, coverage: &mut Coverage) -> u8 {
        let mut faces = 0;
        for place in self.noted.of(id) {
            let run = &self.runs[place];
            coverage.open_span(run.row as usize, usize::from(run.start), usize::from(run.end));
            faces |= face_of_row(run.row as usize, self.resolution);
        }
        faces
    }

    fn close(&self, id: u32, coverage: &mut Coverage) {
        for place in self.noted.of(id) {
            let run = &self.runs[place];
            coverage.cover_span(run.row as usize, usize::from(run.start), usize::from(run.end));
        }
    }

    fn forget(&mut self, id: u32) {
        self.noted.forget(id);
    }

    fn clear(&mut self) {
        // Where nothing is noted, the reduction did it.
        if self.noted.any() {
            self.clear_all();
        }
    }
}

impl Buffer for Claims {
    fn new(shared: &Shared) -> Self {
        let settings = &shared.settings;
        Self::new(
            &shared.table,
            nothing(shared),
            settings.culling == Culling::On,
            noted(shared),
        )
    }

    fn draw<K: Kernel, const COUNT: bool>(
        &mut self,
        shared: &Shared,
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
        unsafe { K::claim::<COUNT>(triangles, face, lanes, self, shared.table.running(face), pixels) }
    }

    #[inline]
    fn is_hidden<K: Kernel>(&mut self, face: Face, pixels: [usize; 4], bound: f32) -> bool {
        // SAFETY: `Isa::available` checked the machine for K's instruction set before an engine was made.
        unsafe { K::is_hidden(self, face, pixels, bound) }
    }

    fn at_least(&self, row: usize, column: usize) -> f32 {
        self.at_least(row, column)
    }

    #[inline]
    fn seen_at(&self, row: usize, column: usize) -> (u32, f32) {
        self.seen_at(row, column)
    }

    fn reduce<K: Kernel>(&mut self, shared: &Shared, sums: &mut Sums) {
        self.reduce(shared.table.running(Face::Top), shared.table.running(Face::PosX), sums);
    }

    fn open(&self, id: u32, coverage: &mut Coverage) -> u8 {
        self.each_of(id, coverage, |covered, shows| *covered &= !shows)
    }

    fn close(&self, id: u32, coverage: &mut Coverage) {
        self.each_of(id, coverage, |covered, shows| *covered |= shows);
    }

    fn forget(&mut self, id: u32) {
        self.forget(id);
    }

    fn clear(&mut self) {
        self.clear();
    }
}
