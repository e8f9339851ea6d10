//! The arithmetic of engine `depth`, written once and compiled for each instruction set: transform of 16 triangles,
//! bounding boxes, spans, depth test, reduction.
//!
//! Homogeneous rasterisation (Olano & Greer 1997): a pixel's direction d is inside a triangle with corners v0, v1, v2
//! as seen from the origin iff d · (v_i × v_j) has one sign for the three edges. No near plane and no clipping. The
//! edge vectors are computed once for all five faces, in f64 and without fused multiply-add, so that the edge that two
//! triangles share is the same to the bit with opposite signs: every pixel centre belongs to exactly one of them. 1/w
//! is affine in the pixel and serves as depth: greater is nearer, 0 is nothing.
//!
//! The three paths (AVX-512, AVX2, portable) perform the same operations in the same order and give the same bits; the
//! tests compare them.
//!
//! No f32 spans, because a pixel position near 256 is known in f32 to some 1e-5, which is enough to lose a pixel at a
//! corner once in a while, and the rows of a closed room must sum to 1 exactly.

mod bits;
mod boxes;
mod claims;

pub(crate) use bits::{Coverage, Cut, Recorded, Shown, Turns};
pub(crate) use boxes::{BOXES, BoxGroup, GroupOnFaces, OnFaces};
pub(crate) use claims::Claims;
use hemicube_contract::bvh::{Block, LANES, UNUSED};
use hemicube_contract::face::Face;

/// Rows of pixels that are rasterised together: the height of a tile.
pub(crate) const GROUP: usize = 8;

/// Sixteen neighbouring pixels of a row: one cache line, the width of a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Chunk<T>(pub(crate) [T; LANES]);

/// A hemicube's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) origin: [f64; 3],
    /// Tangent, bitangent, normal.
    pub(crate) axes: [[f64; 3]; 3],
    /// The same, by component: what each adds along tangent, bitangent and normal, and 0.
    pub(crate) columns: [[f64; 4]; 3],
    /// Heights above the emitter's plane up to this count as 0.
    pub(crate) tolerance: f64,
    /// The emitting patch, or `UNUSED`.
    pub(crate) emitter: u32,
}

impl Frame {
    pub(crate) fn new(origin: [f64; 3], axes: [[f64; 3]; 3], tolerance: f64, emitter: u32) -> Self {
        Self {
            origin,
            axes,
            columns: three(|c| [axes[0][c], axes[1][c], axes[2][c], 0.0]),
            tolerance,
            emitter,
        }
    }
}

/// By how much a tiny patch may be behind the depth at its pixel's centre and still be seen: about what depth varies
/// over a few pixels of a surface that is not seen edge-on.
pub(crate) fn tiny_slack(resolution: u32) -> f64 {
    16.0 / f64::from(resolution)
}

/// More than what 1/w at a pixel must be, as a multiple of that of a tiny patch, to hide it.
#[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
pub(super) fn beyond_tiny(resolution: usize) -> f32 {
    ((1.0 + tiny_slack(resolution as u32)) * (1.0 + 4e-6)) as f32
}

/// The bit of the face that a row of the atlas is of.
pub(crate) fn face_of_row(row: usize, resolution: usize) -> u8 {
    let sides = 2 * row.saturating_sub(resolution) / resolution;
    if row < resolution { 1 } else { 2 << sides }
}

/// Sixteen triangles in a hemicube's frame.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Transformed {
    /// x, y, z of corner 0, then 1, then 2.
    pub(crate) corners: [[f64; LANES]; 9],
    /// The same, rounded: good enough for bounding boxes.
    near: [[f32; LANES]; 9],
    /// v1 × v2, v2 × v0, v0 × v1, times the sign of the determinant.
    pub(crate) edges: [[f64; LANES]; 9],
    /// The sign that `edges` have been multiplied by.
    pub(crate) sign: [f64; LANES],
    /// |det(v0, v1, v2)|.
    pub(crate) determinant: [f64; LANES],
    /// What is seen of the triangle: a patch, or the id for blocked.
    pub(crate) seen: [u32; LANES],
    /// Lanes that can be seen at all.
    pub(crate) live: u16,
}

impl Transformed {
    pub(crate) fn new() -> Self {
        Self {
            corners: [[0.0; LANES]; 9],
            near: [[0.0; LANES]; 9],
            edges: [[0.0; LANES]; 9],
            sign: [1.0; LANES],
            determinant: [0.0; LANES],
            seen: [UNUSED; LANES],
            live: 0,
        }
    }
}

/// Where the centroids of sixteen triangles are seen.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Centroids {
    /// The pixel's column.
    pub(crate) x: [u32; LANES],
    /// The pixel's row of the atlas.
    pub(crate) row: [u32; LANES],
    /// 1/w.
    pub(crate) depth: [f64; LANES],
    /// The direction whose w is 1.
    pub(crate) direction: [[f64; LANES]; 3],
    /// Lanes whose centroid lies above the horizon.
    pub(crate) above: u16,
}

impl Centroids {
    pub(crate) fn new() -> Self {
        Self {
            x: [0; LANES],
            row: [0; LANES],
            depth: [0.0; LANES],
            direction: [[0.0; LANES]; 3],
            above: 0,
        }
    }
}

/// The buffers that one hemicube is drawn into.
#[derive(Debug)]
pub(crate) struct Target {
    pub(crate) resolution: usize,
    /// 1/w of the nearest surface, by atlas row and chunk.
    pub(crate) depth: Vec<Chunk<f32>>,
    /// What is seen, likewise.
    pub(crate) items: Vec<Chunk<u32>>,
    /// True if a tile of 16 × 8 pixels was drawn on since its depth was last taken.
    pub(crate) dirty: Vec<bool>,
    /// The farthest depth in each tile.
    pub(crate) tile_depth: Vec<f32>,
    /// The id of pixels that hit nothing.
    pub(crate) nothing: u32,
    /// True if triangles that cannot be seen are left out.
    pub(crate) culling: bool,
    beyond_tiny: f32,
    /// Runs of pixels of one id in a row, of the ids that are noted.
    pub(crate) runs: Vec<Run>,
    pub(crate) noted: Noted,
}

/// Pixels `start..end` of a row of the atlas that show the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) row: u32,
    pub(crate) start: u16,
    pub(crate) end: u16,
}

/// For each of some ids, what a list has of it: from the last one to the one before.
#[derive(Debug, Default)]
pub(crate) struct Noted {
    /// Place of the last of each id, plus 1; [`UNUSED`] for ids that are not noted.
    last: Vec<u32>,
    /// Place of the one before each, plus 1.
    before: Vec<u32>,
}

impl Transformed {
    /// Whether a face shows all of a lane that is above the horizon: its corners lie in the pyramid over the face, and
    /// so does what is between them.
    pub(crate) fn is_within(&self, face: Face, lane: usize) -> bool {
        let (axis, sign) = face.axes();
        (0..3).all(|k| {
            let [u, v, w] = three(|c| sign[c] * self.corners[3 * k + axis[c]][lane]);
            w > 0.0 && u.abs() <= w && v.abs() <= w
        })
    }
}

impl Noted {
    /// Of ids below `count`, these.
    pub(crate) fn new(count: usize, ids: impl Iterator<Item = u32>) -> Self {
        let mut last = vec![UNUSED; count];
        ids.for_each(|id| last[id as usize] = 0);
        Self {
            last,
            before: Vec::new(),
        }
    }

    /// Returns whether any id is noted.
    pub(crate) fn any(&self) -> bool {
        !self.last.is_empty()
    }

    /// Returns whether an id is.
    #[inline(always)]
    pub(crate) fn is_noted(&self, id: u32) -> bool {
        self.last[id as usize] != UNUSED
    }

    /// The next of the list is one of `id`.
    #[inline(always)]
    pub(crate) fn add(&mut self, id: u32) {
        let last = &mut self.last[id as usize];
        self.before.push(*last);
        if *last != UNUSED {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            {
                *last = self.before.len() as u32;
            }
        }
    }

    /// Passes over the next of the list.
    pub(crate) fn skip(&mut self) {
        self.before.push(0);
    }

    /// Places in the list of what an id has.
    pub(crate) fn of(&self, id: u32) -> impl Iterator<Item = usize> + use<'_> {
        let mut next = self.last[id as usize];
        std::iter::from_fn(move || {
            (next != 0).then(|| {
                let place = next as usize - 1;
                next = self.before[place];
                place
            })
        })
    }

    /// Forgets what an id has.
    pub(crate) fn forget(&mut self, id: u32) {
        self.last[id as usize] = 0;
    }

    /// Begins a new list; all ids must have been forgotten.
    pub(crate) fn clear(&mut self) {
        self.before.clear();
    }
}

impl Target {
    pub(crate) fn new(resolution: u32, nothing: u32, culling: bool, noted: Noted) -> Self {
        let resolution = resolution as usize;
        let chunks = 3 * resolution * resolution / LANES;
        Self {
            resolution,
            depth: vec![Chunk([0.0; LANES]); chunks],
            items: vec![Chunk([nothing; LANES]); chunks],
            dirty: vec![false; chunks / GROUP],
            tile_depth: vec![0.0; chunks / GROUP],
            nothing,
            culling,
            beyond_tiny: beyond_tiny(resolution),
            runs: Vec::new(),
            noted,
        }
    }

    pub(crate) fn chunks_per_row(&self) -> usize {
        self.resolution / LANES
    }

    /// Clears all but the pixels.
    fn clear_tiles(&mut self) {
        self.dirty.fill(false);
        self.tile_depth.fill(0.0);
    }

    /// Clears it for the next hemicube.
    pub(crate) fn clear_all(&mut self) {
        self.items.fill(Chunk([self.nothing; LANES]));
        self.depth.fill(Chunk([0.0; LANES]));
        self.clear_tiles();
        self.runs.clear();
        self.noted.clear();
    }
}

/// The running sums of delta form factors, and where a row's weights are added up.
pub(crate) struct Reduction<'a> {
    pub(crate) top: &'a [u32],
    pub(crate) side: &'a [u32],
    pub(crate) sums: &'a mut Sums,
}

/// Sums for each patch, and for blocked and nothing, with the set of those that are not zero.
#[derive(Debug)]
pub(crate) struct Sums {
    /// Pixels seen in the upper half, weight in the lower; with engine `order`, covered and visible weight.
    pub(crate) of: Vec<u64>,
    /// Those that were touched.
    touched: PatchSet,
}

impl Sums {
    pub(crate) fn new(count: usize) -> Self {
        Self {
            of: vec![0; count],
            touched: PatchSet::new(count),
        }
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, id: u32, pixels: u32, weight: u32) {
        let index = id as usize;
        let sum = self.of[index];
        if sum == 0 {
            self.touched.insert(id);
        }
        // The weights of a hemicube sum to 2³¹, so the lower half never carries into the upper.
        self.of[index] = sum + (u64::from(pixels) << 32 | u64::from(weight));
    }

    /// Sets bits in the upper half of a sum that was touched.
    #[inline(always)]
    pub(crate) fn mark(&mut self, id: u32, bits: u32) {
        self.of[id as usize] |= u64::from(bits) << 32;
    }

    /// Hands out (id, pixels, weight) in ascending order of id and forgets them.
    #[inline]
    pub(crate) fn drain(&mut self, mut each: impl FnMut(u32, u32, u32)) {
        let of = &mut self.of;
        self.touched.drain(|id| {
            let sum = std::mem::take(&mut of[id as usize]);
            #[allow(clippy::cast_possible_truncation, reason = "the halves of a u64")]
            each(id, (sum >> 32) as u32, sum as u32);
        });
    }
}

/// A set of patches, or of ids of what is seen, that hands them out in ascending order.
#[derive(Debug)]
pub(crate) struct PatchSet {
    /// One bit for each patch.
    bits: Vec<u64>,
    /// One bit for each word of `bits` that is not zero.
    words: Vec<u64>,
}

impl PatchSet {
    pub(crate) fn new(count: usize) -> Self {
        let words = count.div_ceil(64);
        Self {
            bits: vec![0; words],
            words: vec![0; words.div_ceil(64)],
        }
    }

    #[inline(always)]
    pub(crate) fn insert(&mut self, patch: u32) {
        let index = patch as usize;
        self.bits[index >> 6] |= 1 << (index & 63);
        self.words[index >> 12] |= 1 << (index >> 6 & 63);
    }

    /// Hands out what is in the set in ascending order, and empties it.
    #[inline]
    pub(crate) fn drain(&mut self, mut each: impl FnMut(u32)) {
        for group in 0..self.words.len() {
            let mut words = std::mem::take(&mut self.words[group]);
            while words != 0 {
                let word = group * 64 + words.trailing_zeros() as usize;
                words &= words - 1;
                let mut bits = std::mem::take(&mut self.bits[word]);
                while bits != 0 {
                    #[allow(clippy::cast_possible_truncation, reason = "an id that was inserted")]
                    let id = (word * 64) as u32 + bits.trailing_zeros();
                    bits &= bits - 1;
                    each(id);
                }
            }
        }
    }
}

/// What rasterising a block on a face did.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Drawn {
    /// Lanes that the face may have pixels of.
    pub(crate) on: u16,
    /// Lanes that were rasterised.
    pub(crate) drawn: u16,
    /// With `COUNT`, those of the next that are so even where what is about as near may be seen.
    pub(crate) behind: u16,
    /// Lanes that were not, because all of their box is nearer than they are.
    pub(crate) hidden: u16,
}

/// One instruction set's way through the kernels.
///
/// # Safety
/// Every method may be called only on a machine that has the instruction set; [`crate::Isa`] sees to it.
pub(crate) trait Kernel: Send + 'static {
    /// Brings a block into a frame.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn transform(block: &Block, frame: &Frame, out: &mut Transformed);

    /// Finds where centroids are seen; heights up to `tolerance` are below the horizon.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn centroids(triangles: &Transformed, tolerance: f64, resolution: usize, out: &mut Centroids);

    /// The pixels that a box of the scene touches on each of `faces`; without `touched`, those whose centres it may
    /// cover.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn on_faces(
        center: &[f64; 3],
        half: &[f64; 3],
        frame: &Frame,
        resolution: usize,
        faces: u8,
        touched: bool,
        out: &mut OnFaces,
    );

    /// On which faces the boxes in `used` of a group may be seen, and on which they are hidden by what is covered; with
    /// `COVERED`, those that a box touches are asked, and remembered of leaves that may be seen; see
    /// [`Self::on_faces`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_group<const COVERED: bool>(
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        coverage: &mut Coverage,
        faces: u8,
    ) -> GroupOnFaces;

    /// Rasterises lanes of a block on one face. With `COUNT`, adds the pixels that each lane covers to `pixels`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn draw<const COUNT: bool>(
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        target: &mut Target,
        pixels: &mut [u32; LANES],
    ) -> Drawn;

    /// Draws lanes of a block on one face for engine `claims`; `running` is the face's running sum of delta form
    /// factors. With `COUNT`, adds the pixels that each lane covers to `pixels`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn claim<const COUNT: bool>(
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        claims: &mut Claims,
        running: &[u32],
        pixels: &mut [u32; LANES],
    ) -> Drawn;

    /// Returns whether every pixel of a box of the atlas (inclusive), on a face, is nearer than `bound`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn is_hidden(claims: &Claims, face: Face, pixels: [usize; 4], bound: f32) -> bool;

    /// Pixels and weight that each of some lanes covers alone, over some faces.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn cover_lanes(
        triangles: &Transformed,
        lanes: u16,
        faces: u8,
        resolution: usize,
        top: &[u32],
        side: &[u32],
        out: &mut [(u32, u32); LANES],
    );

    /// Draws lanes of a block into the coverage, in turn. With `cut`, lanes are pieces, whose edges are those of what
    /// they were cut from.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[allow(clippy::too_many_arguments, reason = "the pieces of one loop")]
    unsafe fn draw_bits<const COVERED: bool>(
        triangles: &mut Transformed,
        cut: Option<Cut<'_>>,
        faces: u8,
        turns: Turns<'_>,
        coverage: &mut Coverage,
        top: &[u32],
        side: &[u32],
        shown: &mut Shown,
    );

    /// Those of these lanes of a block whose centroid lies above the horizon, at a pixel of one of these faces that
    /// nothing covers, or covered when that was remembered.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn open_centroids(
        triangles: &Transformed,
        lanes: u16,
        faces: u8,
        coverage: &Coverage,
        remembered: bool,
    ) -> u16;

    /// Those of these lanes of a block that may have a point on one of these faces at a pixel that was not covered when
    /// that was remembered: at least those that do.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn may_touch_open(triangles: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16;

    /// Lanes of a block that have a box of pixels on one of these faces alone, none of which is covered.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn in_the_open(triangles: &Transformed, faces: u8, coverage: &Coverage) -> u16;

    /// Returns whether every pixel of a box of the atlas (inclusive) is covered.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn all_covered(coverage: &Coverage, pixels: [usize; 4]) -> bool;

    /// Returns whether every pixel of a box of the atlas (inclusive) is nearer than `bound`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn all_nearer(depth: &[Chunk<f32>], chunks_per_row: usize, pixels: [usize; 4], bound: f32) -> bool;

    /// The farthest depth in a tile, whose first chunk is `first`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn tile_depth(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32;

    /// Adds up the weights that each id shows, and clears the target for the next hemicube on the way, while each chunk
    /// is in cache. If any ids are noted, nothing is cleared, and their runs of pixels are listed.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn reduce(target: &mut Target, reduction: Reduction<'_>);
}

/// What differs between instruction sets inside the generic bodies. No SIMD type in any signature, so that nothing is
/// passed in registers that a caller without the feature does not have.
pub(crate) trait Lanes {
    /// The first pixel and one past the last, of each of eight rows from `y`, within `x0..x1`. Returns a bit for each
    /// row whose span is not empty.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn spans(
        edges: &EdgeLines,
        y: f64,
        x0: f64,
        x1: f64,
        starts: &mut [i32; GROUP],
        ends: &mut [i32; GROUP],
    ) -> u8;

    /// Depth test of the pixels of `mask` in a chunk at depth `base + steps[i]`, clamped to `low..=high`. Returns
    /// whether any won.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test(
        depth: &mut Chunk<f32>,
        items: &mut Chunk<u32>,
        mask: u16,
        base: f64,
        depths: &DepthPlane,
        id: u32,
    ) -> bool;

    /// Returns whether all pixels of `mask` in a chunk are nearer than `bound`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn nearer(depth: &Chunk<f32>, mask: u16, bound: f32) -> bool;

    /// See [`Kernel::test_group`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn test_group<const COVERED: bool>(
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        coverage: &mut Coverage,
        faces: u8,
    ) -> GroupOnFaces
    where
        Self: Sized,
    {
        // SAFETY: the caller's promise.
        unsafe { boxes::test_group::<Self, COVERED>(group, used, frame, coverage, faces) }
    }

    /// The lines of all lanes of a block, for a path whose `draw_lane` asks for them: it says which are ready.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn block_lines(_triangles: &Transformed, _face: Face, _resolution: usize, _out: &mut bits::BlockLines) {}

    /// Covers the pixels of a lane on a face, whose box is `left..right` by `low..high`, and weighs them and those that
    /// nothing covered before.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "numbers that stay in registers")]
    unsafe fn draw_lane<const COVERED: bool>(
        triangles: &Transformed,
        _lines: &bits::BlockLines,
        face: Face,
        lane: usize,
        left: i32,
        right: i32,
        low: i32,
        high: i32,
        coverage: &mut Coverage,
        running: &[u32],
    ) -> bits::DrawnLane
    where
        Self: Sized,
    {
        // SAFETY: the caller's promise.
        unsafe { bits::draw_lane::<Self, COVERED>(triangles, face, lane, left, right, low, high, coverage, running) }
    }

    /// See [`Kernel::on_faces`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "the arguments of `Kernel::on_faces`")]
    unsafe fn on_faces(
        center: &[f64; 3],
        half: &[f64; 3],
        frame: &Frame,
        resolution: usize,
        faces: u8,
        touched: bool,
        out: &mut OnFaces,
    ) {
        boxes::on_faces(center, half, frame, resolution, faces, touched, out);
    }

    /// Which of eight words lack one of the bits of `mask`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
        bits::lacking(rows, mask)
    }

    /// Covers the part of eight spans that lies in one column of words: `shows` is what nothing covered before, `over`
    /// what something did. Returns the rows that have any of the first, and those that have any of the second.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn mark(
        starts: &[i32; GROUP],
        ends: &[i32; GROUP],
        rows: u8,
        column: usize,
        covered: &mut [u64; GROUP],
        shows: &mut [u64; GROUP],
        over: &mut [u64; GROUP],
    ) -> (u8, u8) {
        bits::mark(starts, ends, rows, column, covered, shows, Some(over))
    }

    /// A bit for every byte of eight words that is not 0, from the lowest of the first on.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn occupied(rows: &[u64; GROUP]) -> u64 {
        (0..GROUP).fold(0, |any, r| any | u64::from(claims::cells_of(rows[r])) << (8 * r))
    }

    /// Which of eight words have a bit in common with another.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn any_of(words: &[u64; GROUP], with: u64) -> u8 {
        (0..GROUP).fold(0, |any, k| any | u8::from(words[k] & with != 0) << k)
    }

    /// Moves the bits of `left` that are in `shows` to `common`; returns the rows that have any, and what others have
    /// left, as [`Self::occupied`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn common(shows: &[u64; GROUP], left: &mut [u64; GROUP], common: &mut [u64; GROUP]) -> (u8, u64) {
        let mut rows = 0;
        for r in 0..GROUP {
            common[r] = shows[r] & left[r];
            left[r] &= !shows[r];
            rows |= u8::from(common[r] != 0) << r;
        }
        // SAFETY: the caller's promise.
        (rows, unsafe { Self::occupied(left) })
    }

    /// Number of pixels that some of eight spans have.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn pixels_of(starts: &[i32; GROUP], ends: &[i32; GROUP], rows: u8) -> u32 {
        let mut pixels = 0;
        for r in 0..GROUP {
            if rows >> r & 1 != 0 {
                pixels += ends[r].wrapping_sub(starts[r]).cast_unsigned();
            }
        }
        pixels
    }

    /// Which of eight words have bits beyond those of others.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn beyond(rows: &[u64; GROUP], others: &[u64; GROUP]) -> u8 {
        let mut any = 0;
        for r in 0..GROUP {
            any |= u8::from(rows[r] & !others[r] != 0) << r;
        }
        any
    }

    /// The bits of eight words that are in `mask`, and the words that have any.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn restrict(rows: &[u64; GROUP], mask: u64, out: &mut [u64; GROUP]) -> u8 {
        let mut any = 0;
        for r in 0..GROUP {
            out[r] = rows[r] & mask;
            any |= u8::from(out[r] != 0) << r;
        }
        any
    }

    /// The bits that any of eight words has.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn columns(rows: &[u64; GROUP]) -> u64 {
        rows.iter().fold(0, |all, &bits| all | bits)
    }

    /// Which of eight numbers are at most others.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    unsafe fn up_to(a: &[f32; GROUP], b: &[f32; GROUP]) -> u8 {
        let mut cells = 0;
        for k in 0..GROUP {
            cells |= u8::from(a[k] <= b[k]) << k;
        }
        cells
    }

    /// One bit for each flag that is not 0.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn mask(flags: &Flags) -> u16;

    /// One bit for each item of a chunk that differs from the one before it.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn changes(items: &Chunk<u32>, before: u32) -> u16;
}

/// A flag for each lane, 0 or 1.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Flags([u32; LANES]);

/// 1/w over a face, as a function of the pixel.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct DepthPlane {
    /// i × step, for i in 0..16. In f64, and rounded to f32 only with the base added: on a steep plane the base is far
    /// from the depths in the chunk, and their last digits would be lost.
    steps: [f64; LANES],
    plane: Plane,
}

/// 1/w over a face's pixels: x · column + y · row + constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    x: f64,
    y: f64,
    constant: f64,
    /// The values at the triangle's corners bound the values inside it.
    low: f32,
    high: f32,
}

/// The three edges of a triangle on a face as lines x = slope · y + offset, in pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EdgeLines {
    slope: [f64; 3],
    offset: [f64; 3],
    /// All ones for edges that bound the span from the left: whole bytes, as they are masks of eight rows.
    left: [u8; 3],
    /// All ones for edges that bound it from the right.
    right: [u8; 3],
    /// True if an edge runs along the rows, which are then inside it or not.
    any_flat: bool,
    flat_y: [f64; 3],
    flat_constant: [f64; 3],
}

/// A box of pixels: `x0..x1` by `y0..y1`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelBox {
    x0: i32,
    x1: i32,
    y0: i32,
    y1: i32,
}

impl PixelBox {
    /// With the pixels of the face around it: all that is touched by what has the centres of this box.
    #[inline(always)]
    fn wider(self, face: Face, resolution: usize) -> Self {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let width = resolution as i32;
        let height = if face.is_top() { width } else { width / 2 };
        Self {
            x0: (self.x0 - 1).max(0),
            x1: (self.x1 + 1).min(width),
            y0: (self.y0 - 1).max(0),
            y1: (self.y1 + 1).min(height),
        }
    }
}

/// Asks for something that will be read soon.
#[inline(always)]
pub(crate) fn prefetch<T>(of: &T) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..size_of::<T>().div_ceil(64) {
        // SAFETY: a hint, of an address within what is referred to.
        unsafe {
            std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(
                std::ptr::from_ref(of).cast::<i8>().add(line * 64),
            );
        }
    }
}

/// `[f(0), f(1), f(2)]`: the library's `map` is left as a call in these kernels.
#[inline(always)]
pub(crate) fn three<T>(mut f: impl FnMut(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// A point in a hemicube's frame; what is in the emitter's plane but for the tolerance lies in it.
#[inline(always)]
fn in_frame(frame: &Frame, point: [f64; 3]) -> [f64; 3] {
    let [t, b, n] = &frame.axes;
    let [x, y, z] = three(|c| point[c] - frame.origin[c]);
    let height = n[0] * x + n[1] * y + n[2] * z;
    [
        t[0] * x + t[1] * y + t[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        if height.abs() <= frame.tolerance { 0.0 } else { height },
    ]
}

#[inline(always)]
pub(crate) unsafe fn transform<L: Lanes>(block: &Block, frame: &Frame, out: &mut Transformed) {
    let mut live = Flags([0; LANES]);
    for l in 0..LANES {
        let corner = |k: usize| in_frame(frame, three(|c| block.corners[3 * k + c][l]));
        let corners = [corner(0), corner(1), corner(2)];
        for k in 0..9 {
            let x = corners[k / 3][k % 3];
            out.corners[k][l] = x;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
            {
                out.near[k][l] = x as f32;
            }
        }
        let edge = |k: usize| {
            let ([ax, ay, az], [bx, by, bz]) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
        };
        let edges = [edge(0), edge(1), edge(2)];
        let determinant = corners[0][0] * edges[0][0] + corners[0][1] * edges[0][1] + corners[0][2] * edges[0][2];
        let above = (corners[0][2] > 0.0) | (corners[1][2] > 0.0) | (corners[2][2] > 0.0);
        let (negative, positive) = (block.negative[l], block.positive[l]);
        let emitter = (negative == frame.emitter) | (positive == frame.emitter);
        let turned = determinant < 0.0;
        out.seen[l] = if turned { negative } else { positive };
        live.0[l] = u32::from(above & (determinant != 0.0) & !emitter & (negative != UNUSED));
        let sign = if turned { -1.0 } else { 1.0 };
        out.sign[l] = sign;
        out.determinant[l] = determinant.abs();
        for k in 0..9 {
            out.edges[k][l] = edges[k / 3][k % 3] * sign;
        }
    }
    // SAFETY: the caller's promise.
    out.live = unsafe { L::mask(&live) };
}

/// Finds where centroids are seen. A corner within `tolerance` of the horizon lies in it, as `transform` has put it
/// there.
#[inline(always)]
pub(crate) unsafe fn centroids<L: Lanes>(t: &Transformed, tolerance: f64, resolution: usize, out: &mut Centroids) {
    let half = resolution as f64 * 0.5;
    let edge = resolution as f64 - 1.0;
    let mut above = Flags([0; LANES]);
    for l in 0..LANES {
        let [x, y, z] = three(|c| (t.corners[c][l] + t.corners[3 + c][l] + t.corners[6 + c][l]) / 3.0);
        let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
        let on_top = (az >= ax) & (az >= ay);
        let on_x = ax >= ay;
        // The frames of the faces, as `Face::axes` gives them.
        let w = if on_top {
            z
        } else if on_x {
            ax
        } else {
            ay
        };
        let u = if on_top {
            x
        } else if on_x {
            if x > 0.0 { y } else { -y }
        } else if y > 0.0 {
            -x
        } else {
            x
        };
        let v = if on_top { y } else { z };
        let side = match (on_x, x > 0.0, y > 0.0) {
            (true, true, _) => 0.0,
            (true, false, _) => 1.0,
            (false, _, true) => 2.0,
            (false, _, false) => 3.0,
        };
        let inverse = 1.0 / w;
        let (shift, first, last) = if on_top {
            (half, 0.0, edge)
        } else {
            (0.0, (2.0 + side) * half, half - 1.0)
        };
        let column = clamped(u * inverse * half + half, edge);
        let row = clamped(v * inverse * half + shift, last);
        // SAFETY: both are clamped to the face, by comparisons that NaN does not pass, and the face lies in the atlas.
        unsafe {
            let column: i32 = column.to_int_unchecked();
            let row: i32 = row.to_int_unchecked();
            let first: i32 = first.to_int_unchecked();
            out.x[l] = column.cast_unsigned();
            out.row[l] = (row + first).cast_unsigned();
        }
        out.depth[l] = inverse;
        out.direction[0][l] = x * inverse;
        out.direction[1][l] = y * inverse;
        out.direction[2][l] = z * inverse;
        above.0[l] = u32::from(z > tolerance);
    }
    // SAFETY: the caller's promise.
    out.above = unsafe { L::mask(&above) };
}

/// x, between 0 and `most`; NaN is 0.
#[inline(always)]
fn clamped(x: f64, most: f64) -> f64 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < most { x } else { most }
}

/// Bounding boxes of sixteen triangles on a face. Aligned, so that what was stored by the register is soon read by the
/// lane.
#[repr(C, align(64))]
struct Boxes {
    x0: [i32; LANES],
    x1: [i32; LANES],
    y0: [i32; LANES],
    y1: [i32; LANES],
    low: [f32; LANES],
    high: [f32; LANES],
    /// Wholly in front of the eye, box not empty.
    whole: u16,
    /// Partly behind the eye (w ≤ 0), or nearly.
    straddling: u16,
}

/// How far, in pixels, a box exceeds the projected corners: these are f32, spans are not.
const BOX_SLACK: f32 = 2e-3;
/// A triangle whose nearest corner is closer than this part of its farthest is treated as straddling the eye plane.
const STRADDLE: f32 = 1e-6;
/// How much 1/w at a corner is widened so that rounding inside the triangle is not cut off.
const DEPTH_SLACK: f32 = 1e-6;

/// By how much the depth of a blocking back is lowered: two to four units in the last place of f32, above the rounding
/// of two depths.
const BACK: f64 = 1.0 - 1.0 / 4_194_304.0;
#[allow(clippy::cast_possible_truncation, reason = "exact in f32")]
const BACK_F32: f32 = BACK as f32;

#[inline(always)]
unsafe fn boxes<L: Lanes>(t: &Transformed, face: Face, resolution: usize) -> Boxes {
    let (axis, sign) = face.axes();
    #[allow(clippy::cast_possible_truncation, reason = "±1")]
    let s = [sign[0] as f32, sign[1] as f32, sign[2] as f32];
    let width = resolution as f32;
    let height = if face.is_top() { width } else { width * 0.5 };
    let half = width * 0.5;
    // Pixel x has its centre at (x + ½) 2/N − 1.
    let (u_shift, v_shift) = (half - 0.5, if face.is_top() { half - 0.5 } else { -0.5 });
    let mut out = Boxes {
        x0: [0; LANES],
        x1: [0; LANES],
        y0: [0; LANES],
        y1: [0; LANES],
        low: [0.0; LANES],
        high: [0.0; LANES],
        whole: 0,
        straddling: 0,
    };
    let mut whole = Flags([0; LANES]);
    let mut straddling = Flags([0; LANES]);
    for l in 0..LANES {
        let w = [
            s[2] * t.near[axis[2]][l],
            s[2] * t.near[3 + axis[2]][l],
            s[2] * t.near[6 + axis[2]][l],
        ];
        let u = [
            s[0] * t.near[axis[0]][l],
            s[0] * t.near[3 + axis[0]][l],
            s[0] * t.near[6 + axis[0]][l],
        ];
        let v = [
            s[1] * t.near[axis[1]][l],
            s[1] * t.near[3 + axis[1]][l],
            s[1] * t.near[6 + axis[1]][l],
        ];
        let far = greater(greater(w[0], w[1]), w[2]);
        let near = smaller(smaller(w[0], w[1]), w[2]);
        let i = [1.0 / w[0], 1.0 / w[1], 1.0 / w[2]];
        let x = [
            u[0] * i[0] * half + u_shift,
            u[1] * i[1] * half + u_shift,
            u[2] * i[2] * half + u_shift,
        ];
        let y = [
            v[0] * i[0] * half + v_shift,
            v[1] * i[1] * half + v_shift,
            v[2] * i[2] * half + v_shift,
        ];
        // The comparisons send NaN to a bound, so that the conversions below are in range for every lane.
        let x0 = smaller(greater(smaller(smaller(x[0], x[1]), x[2]) - BOX_SLACK, -0.5), width);
        let x1 = greater(
            smaller(greater(greater(x[0], x[1]), x[2]) + BOX_SLACK, width - 1.0),
            -1.0,
        );
        let y0 = smaller(greater(smaller(smaller(y[0], y[1]), y[2]) - BOX_SLACK, -0.5), height);
        let y1 = greater(
            smaller(greater(greater(y[0], y[1]), y[2]) + BOX_SLACK, height - 1.0),
            -1.0,
        );
        out.x0[l] = ceil_to_int(x0);
        out.x1[l] = floor_to_int(x1) + 1;
        out.y0[l] = ceil_to_int(y0);
        out.y1[l] = floor_to_int(y1) + 1;
        let in_front = near > STRADDLE * far;
        whole.0[l] = u32::from(in_front & (out.x0[l] < out.x1[l]) & (out.y0[l] < out.y1[l]));
        straddling.0[l] = u32::from(!in_front & (far > 0.0));
        out.low[l] = greater(
            smaller(smaller(i[0], i[1]), i[2]) * (1.0 - DEPTH_SLACK),
            f32::MIN_POSITIVE,
        );
        out.high[l] = greater(greater(i[0], i[1]), i[2]) * (1.0 + DEPTH_SLACK);
    }
    // SAFETY: the caller's promise.
    unsafe {
        out.whole = L::mask(&whole) & t.live;
        out.straddling = L::mask(&straddling) & t.live;
    }
    out
}

/// ⌈x⌉ for −1 ≤ x ≤ 2³⁰.
#[inline(always)]
fn ceil_to_int(x: f32) -> i32 {
    // SAFETY: callers clamp to the pixels of a face, by comparisons that NaN does not pass.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i + i32::from((i as f32) < x)
}

/// ⌊x⌋ for −1 ≤ x ≤ 2³⁰.
#[inline(always)]
fn floor_to_int(x: f32) -> i32 {
    // SAFETY: as above.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i - i32::from((i as f32) > x)
}

/// The bounding box of the part of a straddling triangle that a face sees: clipped to the face's pyramid, in f64.
fn clipped_box(t: &Transformed, face: Face, lane: usize, resolution: usize) -> Option<PixelBox> {
    let (axis, sign) = face.axes();
    let corner = |k: usize| three(|c| sign[c] * t.corners[3 * k + axis[c]][lane]);
    let mut polygon = [[0.0f64; 3]; 8];
    for (k, p) in polygon.iter_mut().take(3).enumerate() {
        *p = corner(k);
    }
    let mut count = 3;
    let bottom = if face.is_top() { 1.0 } else { 0.0 };
    for plane in [[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, bottom], [0.0, -1.0, 1.0]] {
        let mut sides = [0.0f64; 8];
        let (mut inside, mut outside) = (true, true);
        for (p, side) in polygon[..count].iter().zip(&mut sides) {
            *side = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2];
            inside &= *side >= 0.0;
            outside &= *side < 0.0;
        }
        // Most planes leave all of it or nothing.
        if inside {
            continue;
        }
        if outside {
            return None;
        }
        let mut kept = [[0.0f64; 3]; 8];
        let mut kept_count = 0;
        for i in 0..count {
            let next = if i + 1 == count { 0 } else { i + 1 };
            let (p, q) = (polygon[i], polygon[next]);
            let (sp, sq) = (sides[i], sides[next]);
            if sp >= 0.0 {
                kept[kept_count] = p;
                kept_count += 1;
            }
            if (sp < 0.0) != (sq < 0.0) {
                let f = sp / (sp - sq);
                kept[kept_count] = three(|c| p[c] + (q[c] - p[c]) * f);
                kept_count += 1;
            }
        }
        (polygon, count) = (kept, kept_count);
        if count < 3 {
            return None;
        }
    }
    let width = resolution as f64;
    let height = if face.is_top() { width } else { width * 0.5 };
    let half = width * 0.5;
    let v_shift = if face.is_top() { half } else { 0.0 };
    let (mut x0, mut x1, mut y0, mut y1) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY);
    for p in &polygon[..count] {
        if p[2] <= 1e-14 {
            // The polygon reaches the eye: it may fill the face.
            (x0, x1, y0, y1) = (0.0, width, 0.0, height);
            break;
        }
        let (x, y) = (p[0] / p[2] * half + half - 0.5, p[1] / p[2] * half + v_shift - 0.5);
        (x0, x1, y0, y1) = (x0.min(x), x1.max(x), y0.min(y), y1.max(y));
    }
    // Clipping moves corners by rounding only; a hundredth of a pixel is far more than that.
    let slack = 0.01;
    #[allow(clippy::cast_possible_truncation, reason = "saturates, clamped to the face")]
    let pixels = PixelBox {
        x0: (x0 - slack).ceil().clamp(0.0, width) as i32,
        x1: (x1 + slack).floor().clamp(-1.0, width - 1.0) as i32 + 1,
        y0: (y0 - slack).ceil().clamp(0.0, height) as i32,
        y1: (y1 + slack).floor().clamp(-1.0, height - 1.0) as i32 + 1,
    };
    (pixels.x0 < pixels.x1 && pixels.y0 < pixels.y1).then_some(pixels)
}

/// An edge vector's value over a face's pixels: a · x + b · y + c.
#[inline(always)]
fn affine(e: [f64; 3], face: Face, resolution: usize) -> [f64; 3] {
    let step = 2.0 / resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if face.is_top() { u0 } else { 0.5 * step };
    // Every operation is odd in e, so the shared edge of two triangles has the same zero line to the bit.
    [e[0] * step, e[1] * step, e[2] + e[0] * u0 + e[1] * v0]
}

#[inline(always)]
fn edge_lines(t: &Transformed, face: Face, lane: usize, resolution: usize) -> (EdgeLines, [f64; 3]) {
    let (axis, sign) = face.axes();
    let mut lines = EdgeLines::default();
    let mut sum = [0.0; 3];
    for k in 0..3 {
        let e = three(|c| sign[c] * t.edges[3 * k + axis[c]][lane]);
        for c in 0..3 {
            sum[c] += e[c];
        }
        let [a, b, c] = affine(e, face, resolution);
        let inverse = -1.0 / a;
        lines.slope[k] = b * inverse;
        lines.offset[k] = c * inverse;
        lines.left[k] = u8::from(a > 0.0).wrapping_neg();
        lines.right[k] = u8::from(a < 0.0).wrapping_neg();
        lines.any_flat |= a == 0.0;
        lines.flat_y[k] = b;
        lines.flat_constant[k] = c;
    }
    (lines, sum)
}

/// The box of a lane's pixels on a face, where it has any, and the least and the greatest 1/w that it has there.
#[inline(always)]
fn lane_box(
    t: &Transformed,
    boxes: &Boxes,
    face: Face,
    lane: usize,
    resolution: usize,
) -> Option<(PixelBox, f32, f32)> {
    if boxes.straddling >> lane & 1 != 0 {
        let pixels = clipped_box(t, face, lane, resolution)?;
        return Some((pixels, f32::MIN_POSITIVE, f32::MAX));
    }
    let pixels = PixelBox {
        x0: boxes.x0[lane],
        x1: boxes.x1[lane],
        y0: boxes.y0[lane],
        y1: boxes.y1[lane],
    };
    Some((pixels, boxes.low[lane], boxes.high[lane]))
}

/// 1/w of a lane over a face's pixels, from the sum of its edge vectors; what seeing nothing is called tells what is
/// blocked.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "numbers that stay in registers")]
fn plane(
    t: &Transformed,
    face: Face,
    lane: usize,
    resolution: usize,
    sum: [f64; 3],
    nothing: u32,
    low: f32,
    high: f32,
) -> Plane {
    let inverse = 1.0 / t.determinant[lane];
    let [a, b, c] = affine(sum, face, resolution);
    // Where the back of a surface meets a front, as at every silhouette edge of a solid, their depths differ by less
    // than f32 can tell, and the front must win.
    let (inverse, low, high) = if t.seen[lane] + 1 == nothing {
        (inverse * BACK, low * BACK_F32, high * BACK_F32)
    } else {
        (inverse, low, high)
    };
    Plane {
        x: a * inverse,
        y: b * inverse,
        constant: c * inverse,
        low,
        high,
    }
}

/// Takes rows outside a flat edge away from `rows`. On the line itself, one of the two sides wins.
#[inline(always)]
fn flat_rows(lines: &EdgeLines, y: f64, mut rows: u8) -> u8 {
    for k in 0..3 {
        if lines.left[k] | lines.right[k] == 0 {
            for r in 0..GROUP {
                let value = lines.flat_y[k] * (y + r as f64) + lines.flat_constant[k];
                let inside = value > 0.0 || (value == 0.0 && lines.flat_y[k] > 0.0);
                if !inside {
                    rows &= !(1 << r);
                }
            }
        }
    }
    rows
}

/// The spans of eight rows from `y` on, and which of them have pixels of a triangle's box.
#[inline(always)]
unsafe fn spans_within<L: Lanes>(
    lines: &EdgeLines,
    y: usize,
    pixels: PixelBox,
    starts: &mut [i32; GROUP],
    ends: &mut [i32; GROUP],
) -> u8 {
    let (x0, x1) = (f64::from(pixels.x0), f64::from(pixels.x1));
    let (y0, y1) = (bits::at(pixels.y0), bits::at(pixels.y1));
    // SAFETY: the caller's promise.
    let mut rows = unsafe { L::spans(lines, y as f64, x0, x1, starts, ends) };
    if lines.any_flat {
        rows = flat_rows(lines, y as f64, rows);
    }
    if y < y0 {
        rows &= u8::MAX << (y0 - y);
    }
    if y + GROUP > y1 {
        rows &= u8::MAX >> (y + GROUP - y1);
    }
    rows
}

/// Walks the spans of one triangle on one face: `each(atlas row offset within the face, start, end)`.
#[inline(always)]
unsafe fn walk<L: Lanes>(lines: &EdgeLines, pixels: PixelBox, mut each: impl FnMut(usize, usize, usize)) {
    let mut starts = [0i32; GROUP];
    let mut ends = [0i32; GROUP];
    let mut y = bits::at(pixels.y0) / GROUP * GROUP;
    while y < bits::at(pixels.y1) {
        // SAFETY: the caller's promise.
        let mut rows = unsafe { spans_within::<L>(lines, y, pixels, &mut starts, &mut ends) };
        while rows != 0 {
            let r = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            #[allow(clippy::cast_sign_loss, reason = "spans lie within the pixel box")]
            each(y + r, starts[r] as usize, ends[r] as usize);
        }
        y += GROUP;
    }
}

/// Boxes of at most this many rows and two chunks across are tested pixel by pixel, larger ones by tiles.
const FEW_ROWS: usize = 2 * GROUP;

/// Returns whether `box` is small enough to be tested pixel by pixel.
#[inline(always)]
pub(crate) fn is_small([x0, x1, y0, y1]: [usize; 4]) -> bool {
    x1 / LANES - x0 / LANES < 2 && y1 - y0 < FEW_ROWS
}

/// Returns whether every pixel of a box of the atlas (inclusive) is nearer than `bound`.
#[inline(always)]
pub(crate) unsafe fn all_nearer<L: Lanes>(
    depth: &[Chunk<f32>],
    chunks_per_row: usize,
    [x0, x1, y0, y1]: [usize; 4],
    bound: f32,
) -> bool {
    let (first, last) = (x0 / LANES, x1 / LANES);
    for row in y0..=y1 {
        let mut mask = u16::MAX << (x0 % LANES);
        for chunk in first..=last {
            if chunk == last {
                mask &= u16::MAX >> (LANES - 1 - x1 % LANES);
            }
            // SAFETY: the caller's promise.
            if unsafe { !L::nearer(&depth[row * chunks_per_row + chunk], mask, bound) } {
                return false;
            }
            mask = u16::MAX;
        }
    }
    true
}

/// Whether all that a triangle's box touches is nearer than `high`: by its pixels when it is small, else by what is
/// known of its tiles. Depths only grow, so that a tile's depth taken earlier is a bound.
#[inline(always)]
unsafe fn is_hidden<L: Lanes>(target: &Target, first_row: usize, pixels: PixelBox, high: f32) -> bool {
    if !target.culling {
        return false;
    }
    #[allow(clippy::cast_sign_loss, reason = "a pixel box lies within its face")]
    let [x0, x1, y0, y1] = [pixels.x0, pixels.x1 - 1, pixels.y0, pixels.y1 - 1].map(|x| x as usize);
    let (y0, y1) = (first_row + y0, first_row + y1);
    let chunks_per_row = target.chunks_per_row();
    if is_small([x0, x1, y0, y1]) {
        // SAFETY: the caller's promise.
        return unsafe { all_nearer::<L>(&target.depth, chunks_per_row, [x0, x1, y0, y1], high) };
    }
    for tile_row in y0 / GROUP..=y1 / GROUP {
        let row = &target.tile_depth[tile_row * chunks_per_row..][x0 / LANES..=x1 / LANES];
        if row.iter().any(|&depth| depth <= high) {
            return false;
        }
    }
    true
}

#[inline(always)]
pub(crate) unsafe fn draw<L: Lanes, const COUNT: bool>(
    t: &Transformed,
    face: Face,
    lanes: u16,
    target: &mut Target,
    pixels: &mut [u32; LANES],
) -> Drawn {
    let resolution = target.resolution;
    // SAFETY: the caller's promise.
    let boxes = unsafe { boxes::<L>(t, face, resolution) };
    let mut pending = (boxes.whole | boxes.straddling) & lanes;
    let mut drawn = Drawn {
        on: pending,
        ..Drawn::default()
    };
    #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
    let first_row = face.first_row(resolution as u32) as usize;
    let chunks_per_row = resolution / LANES;
    while pending != 0 {
        let lane = pending.trailing_zeros() as usize;
        pending &= pending - 1;
        let Some((pixel_box, low, high)) = lane_box(t, &boxes, face, lane, resolution) else {
            continue;
        };
        // SAFETY: the caller's promise.
        if unsafe { is_hidden::<L>(target, first_row, pixel_box, high) } {
            drawn.hidden |= 1 << lane;
            let touched = pixel_box.wider(face, resolution);
            // SAFETY: likewise.
            if COUNT && unsafe { is_hidden::<L>(target, first_row, touched, high * target.beyond_tiny) } {
                drawn.behind |= 1 << lane;
            }
            continue;
        }
        drawn.drawn |= 1 << lane;
        let (lines, sum) = edge_lines(t, face, lane, resolution);
        let id = t.seen[lane];
        let plane = plane(t, face, lane, resolution, sum, target.nothing, low, high);
        let mut steps = [0.0; LANES];
        for (i, s) in steps.iter_mut().enumerate() {
            *s = plane.x * i as f64;
        }
        let depths = DepthPlane { steps, plane };
        let mut covered = 0;
        let first = bits::at(pixel_box.x0) / LANES;
        let columns = (bits::at(pixel_box.x1) - 1) / LANES - first;
        if columns < 2 {
            // Most triangles of a fine scene: which chunks a row has pixels in would be as good as random.
            let left = first * LANES;
            let across = [0, 1].map(|column| depths.plane.x * ((first + column) * LANES) as f64);
            // SAFETY: the caller's promise.
            unsafe {
                walk::<L>(&lines, pixel_box, |row, start, end| {
                    if COUNT {
                        covered += end - start;
                    }
                    let mask = (u64::MAX << (start - left)) & !(u64::MAX << (end - left));
                    let row_depth = depths.plane.constant + depths.plane.y * row as f64;
                    let atlas_row = first_row + row;
                    let tile = atlas_row / GROUP * chunks_per_row + first;
                    for column in 0..=columns {
                        let at = atlas_row * chunks_per_row + first + column;
                        #[allow(clippy::cast_possible_truncation, reason = "sixteen of them")]
                        let mask = (mask >> (column * LANES)) as u16;
                        let base = row_depth + across[column];
                        target.dirty[tile + column] |=
                            L::test(&mut target.depth[at], &mut target.items[at], mask, base, &depths, id);
                    }
                });
            }
        } else {
            // SAFETY: the caller's promise.
            unsafe {
                walk::<L>(&lines, pixel_box, |row, start, end| {
                    if COUNT {
                        covered += end - start;
                    }
                    let row_depth = depths.plane.constant + depths.plane.y * row as f64;
                    let atlas_row = first_row + row;
                    let row_chunk = atlas_row * chunks_per_row;
                    let tile_row = atlas_row / GROUP * chunks_per_row;
                    let mut chunk = start / LANES;
                    let last = (end - 1) / LANES;
                    let mut mask = u16::MAX << (start % LANES);
                    loop {
                        if chunk == last {
                            mask &= u16::MAX >> (LANES - 1 - (end - 1) % LANES);
                        }
                        let base = row_depth + depths.plane.x * (chunk * LANES) as f64;
                        let at = row_chunk + chunk;
                        target.dirty[tile_row + chunk] |=
                            L::test(&mut target.depth[at], &mut target.items[at], mask, base, &depths, id);
                        if chunk == last {
                            break;
                        }
                        chunk += 1;
                        mask = u16::MAX;
                    }
                });
            }
        }
        if COUNT {
            #[allow(clippy::cast_possible_truncation, reason = "at most 3·2²⁰ pixels")]
            {
                pixels[lane] += covered as u32;
            }
        }
    }
    drawn
}

#[inline(always)]
pub(crate) fn tile_depth(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 {
    let mut lanes = depth[first].0;
    for row in 1..GROUP {
        let chunk = &depth[first + row * chunks_per_row].0;
        for l in 0..LANES {
            lanes[l] = smaller(lanes[l], chunk[l]);
        }
    }
    let mut width = LANES;
    while width > 1 {
        width /= 2;
        for l in 0..width {
            lanes[l] = smaller(lanes[l], lanes[l + width]);
        }
    }
    lanes[0]
}

#[inline(always)]
pub(crate) unsafe fn reduce<L: Lanes>(target: &mut Target, reduction: Reduction<'_>) {
    // SAFETY: the caller's promise.
    unsafe {
        if target.noted.any() {
            reduce_rows::<L, true>(target, reduction);
        } else {
            reduce_rows::<L, false>(target, reduction);
            target.clear_tiles();
        }
    }
}

#[inline(always)]
unsafe fn reduce_rows<L: Lanes, const NOTE: bool>(target: &mut Target, reduction: Reduction<'_>) {
    let Reduction { top, side, sums } = reduction;
    let resolution = target.resolution;
    let chunks_per_row = target.chunks_per_row();
    let rows = target.items.len() / chunks_per_row;
    let cleared = Chunk([target.nothing; LANES]);
    for row in 0..rows {
        // The top, then four sides that share one table.
        let (running, face_row) = if row < resolution {
            (top, row)
        } else {
            (side, (row - resolution) % (resolution / 2))
        };
        let running = &running[face_row * resolution..][..=resolution];
        let items = &mut target.items[row * chunks_per_row..][..chunks_per_row];
        let depth = &mut target.depth[row * chunks_per_row..][..chunks_per_row];
        let mut id = items[0].0[0];
        let (mut start, mut sum) = (0usize, running[0]);
        let mut before = id;
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
        let mut add = |id: u32, start: usize, end: usize, weight: u32| {
            sums.add(id, (end - start) as u32, weight);
            if NOTE && target.noted.is_noted(id) {
                target.noted.add(id);
                target.runs.push(Run {
                    row: row as u32,
                    start: start as u16,
                    end: end as u16,
                });
            }
        };
        for (c, (chunk, chunk_depth)) in items.iter_mut().zip(depth).enumerate() {
            // SAFETY: the caller's promise.
            let mut changes = unsafe { L::changes(chunk, before) };
            before = chunk.0[LANES - 1];
            while changes != 0 {
                let l = changes.trailing_zeros() as usize;
                changes &= changes - 1;
                let x = c * LANES + l;
                let upto = running[x];
                add(id, start, x, upto - sum);
                (id, start, sum) = (chunk.0[l], x, upto);
            }
            if !NOTE {
                *chunk = cleared;
                *chunk_depth = Chunk([0.0; LANES]);
            }
        }
        add(id, start, resolution, running[resolution] - sum);
    }
}

/// The portable path: the definition of the arithmetic that the others must reproduce.
#[derive(Debug)]
pub(crate) struct Portable;

impl Lanes for Portable {
    #[inline(always)]
    unsafe fn spans(
        lines: &EdgeLines,
        y: f64,
        x0: f64,
        x1: f64,
        starts: &mut [i32; GROUP],
        ends: &mut [i32; GROUP],
    ) -> u8 {
        let mut low = [x0; GROUP];
        let mut high = [x1; GROUP];
        for k in 0..3 {
            let (slope, offset) = (lines.slope[k], lines.offset[k]);
            if lines.left[k] != 0 {
                for (r, low) in low.iter_mut().enumerate() {
                    let x = slope * (y + r as f64) + offset;
                    *low = if x > *low { x } else { *low };
                }
            } else if lines.right[k] != 0 {
                for (r, high) in high.iter_mut().enumerate() {
                    let x = slope * (y + r as f64) + offset;
                    *high = if x < *high { x } else { *high };
                }
            }
        }
        let mut rows = 0;
        for r in 0..GROUP {
            let low = if low[r] < x1 { low[r] } else { x1 };
            let high = if high[r] > x0 { high[r] } else { x0 };
            starts[r] = ceil_f64(low);
            ends[r] = ceil_f64(high);
            rows |= u8::from(starts[r] < ends[r]) << r;
        }
        rows
    }

    #[inline(always)]
    unsafe fn test(
        depth: &mut Chunk<f32>,
        items: &mut Chunk<u32>,
        mask: u16,
        base: f64,
        depths: &DepthPlane,
        id: u32,
    ) -> bool {
        let mut any = false;
        let mut left = mask;
        while left != 0 {
            let l = left.trailing_zeros() as usize;
            left &= left - 1;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
            let z = (base + depths.steps[l]) as f32;
            let z = if z > depths.plane.low { z } else { depths.plane.low };
            let z = if z < depths.plane.high { z } else { depths.plane.high };
            let old = depth.0[l];
            if z > old || (z == old && id < items.0[l]) {
                depth.0[l] = z;
                items.0[l] = id;
                any = true;
            }
        }
        any
    }

    #[inline(always)]
    unsafe fn nearer(depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
        let mut nearer = 0;
        for l in 0..LANES {
            nearer |= u16::from(depth.0[l] > bound) << l;
        }
        nearer & mask == mask
    }

    #[inline(always)]
    unsafe fn mask(flags: &Flags) -> u16 {
        flags
            .0
            .iter()
            .enumerate()
            .fold(0, |mask, (l, &flag)| mask | u16::from(flag != 0) << l)
    }

    #[inline(always)]
    unsafe fn changes(items: &Chunk<u32>, before: u32) -> u16 {
        let mut mask = u16::from(items.0[0] != before);
        for l in 1..LANES {
            mask |= u16::from(items.0[l] != items.0[l - 1]) << l;
        }
        mask
    }
}

/// ⌈x⌉ of a pixel position.
#[inline(always)]
fn ceil_f64(x: f64) -> i32 {
    // SAFETY: spans are clamped to their pixel box, by comparisons that NaN does not pass.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i + i32::from(f64::from(i) < x)
}

impl Kernel for Portable {
    unsafe fn transform(block: &Block, frame: &Frame, out: &mut Transformed) {
        // SAFETY: the portable path needs no instruction set.
        unsafe { transform::<Self>(block, frame, out) };
    }

    unsafe fn centroids(triangles: &Transformed, tolerance: f64, resolution: usize, out: &mut Centroids) {
        // SAFETY: the portable path needs no instruction set.
        unsafe { centroids::<Self>(triangles, tolerance, resolution, out) };
    }

    unsafe fn on_faces(
        center: &[f64; 3],
        half: &[f64; 3],
        frame: &Frame,
        resolution: usize,
        faces: u8,
        touched: bool,
        out: &mut OnFaces,
    ) {
        boxes::on_faces(center, half, frame, resolution, faces, touched, out);
    }

    unsafe fn test_group<const COVERED: bool>(
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        coverage: &mut Coverage,
        faces: u8,
    ) -> GroupOnFaces {
        // SAFETY: the portable path needs no instruction set.
        unsafe { <Self as Lanes>::test_group::<COVERED>(group, used, frame, coverage, faces) }
    }

    unsafe fn draw<const COUNT: bool>(
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        target: &mut Target,
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        // SAFETY: the portable path needs no instruction set.
        unsafe { draw::<Self, COUNT>(triangles, face, lanes, target, pixels) }
    }

    unsafe fn claim<const COUNT: bool>(
        triangles: &Transformed,
        face: Face,
        lanes: u16,
        claims: &mut Claims,
        running: &[u32],
        pixels: &mut [u32; LANES],
    ) -> Drawn {
        // SAFETY: as above.
        unsafe { claims::draw::<Self, COUNT>(triangles, face, lanes, claims, running, pixels) }
    }

    unsafe fn is_hidden(claims: &Claims, face: Face, pixels: [usize; 4], bound: f32) -> bool {
        // SAFETY: as above.
        unsafe { claims.is_hidden::<Self>(face, pixels, bound) }
    }

    unsafe fn cover_lanes(
        triangles: &Transformed,
        lanes: u16,
        faces: u8,
        resolution: usize,
        top: &[u32],
        side: &[u32],
        out: &mut [(u32, u32); LANES],
    ) {
        // SAFETY: as above.
        unsafe { bits::cover_lanes::<Self>(triangles, lanes, faces, resolution, top, side, out) };
    }

    unsafe fn draw_bits<const COVERED: bool>(
        triangles: &mut Transformed,
        cut: Option<Cut<'_>>,
        faces: u8,
        turns: Turns<'_>,
        coverage: &mut Coverage,
        top: &[u32],
        side: &[u32],
        shown: &mut Shown,
    ) {
        // SAFETY: as above.
        unsafe { bits::draw::<Self, COVERED>(triangles, cut, faces, turns, coverage, top, side, shown) };
    }

    unsafe fn open_centroids(
        triangles: &Transformed,
        lanes: u16,
        faces: u8,
        coverage: &Coverage,
        remembered: bool,
    ) -> u16 {
        bits::open_centroids(triangles, lanes, faces, coverage, remembered)
    }

    unsafe fn may_touch_open(triangles: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16 {
        // SAFETY: the caller's promise.
        unsafe { bits::may_touch_open::<Self>(triangles, lanes, faces, coverage) }
    }

    unsafe fn in_the_open(triangles: &Transformed, faces: u8, coverage: &Coverage) -> u16 {
        // SAFETY: as above.
        unsafe { bits::in_the_open::<Self>(triangles, faces, coverage) }
    }

    unsafe fn all_covered(coverage: &Coverage, pixels: [usize; 4]) -> bool {
        // SAFETY: as above.
        unsafe { bits::all_covered::<Self>(coverage, pixels) }
    }

    unsafe fn all_nearer(depth: &[Chunk<f32>], chunks_per_row: usize, pixels: [usize; 4], bound: f32) -> bool {
        // SAFETY: as above.
        unsafe { all_nearer::<Self>(depth, chunks_per_row, pixels, bound) }
    }

    unsafe fn tile_depth(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 {
        tile_depth(depth, first, chunks_per_row)
    }

    unsafe fn reduce(target: &mut Target, reduction: Reduction<'_>) {
        // SAFETY: as above.
        unsafe { reduce::<Self>(target, reduction) }
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) mod x86 {
    //! AVX-512 and AVX2.

    use super::*;
    use std::arch::x86_64::*;

    /// AVX-512 with F, BW, DQ and VL.
    #[derive(Debug)]
    pub(crate) struct Avx512;

    /// AVX2.
    #[derive(Debug)]
    pub(crate) struct Avx2;

    impl Lanes for Avx512 {
        #[inline(always)]
        unsafe fn on_faces(
            center: &[f64; 3],
            half: &[f64; 3],
            frame: &Frame,
            resolution: usize,
            faces: u8,
            touched: bool,
            out: &mut OnFaces,
        ) {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { boxes::on_faces_avx512(center, half, frame, resolution, faces, touched, out) };
        }

        #[inline(always)]
        unsafe fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { bits::lacking_avx512(rows, mask) }
        }

        #[inline(always)]
        unsafe fn mark(
            starts: &[i32; GROUP],
            ends: &[i32; GROUP],
            rows: u8,
            column: usize,
            covered: &mut [u64; GROUP],
            shows: &mut [u64; GROUP],
            over: &mut [u64; GROUP],
        ) -> (u8, u8) {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { bits::mark_avx512(starts, ends, rows, column, covered, shows, over) }
        }

        #[inline(always)]
        unsafe fn occupied(rows: &[u64; GROUP]) -> u64 {
            // SAFETY: the caller's promise of the instruction set; the load is as long as the array.
            unsafe {
                let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
                _mm512_test_epi8_mask(rows, rows)
            }
        }

        #[inline(always)]
        unsafe fn any_of(words: &[u64; GROUP], with: u64) -> u8 {
            // SAFETY: the caller's promise of the instruction set; the load is as long as the array.
            unsafe {
                let words = _mm512_loadu_epi64(words.as_ptr().cast());
                _mm512_test_epi64_mask(words, _mm512_set1_epi64(with.cast_signed()))
            }
        }

        #[inline(always)]
        unsafe fn common(shows: &[u64; GROUP], left: &mut [u64; GROUP], common: &mut [u64; GROUP]) -> (u8, u64) {
            // SAFETY: the caller's promise of the instruction set; loads and stores are as long as their arrays.
            unsafe {
                let shows = _mm512_loadu_epi64(shows.as_ptr().cast());
                let before = _mm512_loadu_epi64(left.as_ptr().cast());
                let (both, rest) = (_mm512_and_si512(shows, before), _mm512_andnot_si512(shows, before));
                _mm512_storeu_epi64(left.as_mut_ptr().cast(), rest);
                _mm512_storeu_epi64(common.as_mut_ptr().cast(), both);
                (_mm512_test_epi64_mask(both, both), _mm512_test_epi8_mask(rest, rest))
            }
        }

        #[inline(always)]
        unsafe fn pixels_of(starts: &[i32; GROUP], ends: &[i32; GROUP], rows: u8) -> u32 {
            // SAFETY: the caller's promise of the instruction set; loads are as long as the arrays.
            unsafe {
                let (starts, ends) = (
                    _mm256_loadu_si256(starts.as_ptr().cast()),
                    _mm256_loadu_si256(ends.as_ptr().cast()),
                );
                bits::sum_of(_mm256_maskz_sub_epi32(rows, ends, starts))
            }
        }

        #[inline(always)]
        unsafe fn beyond(rows: &[u64; GROUP], others: &[u64; GROUP]) -> u8 {
            // SAFETY: the caller's promise of the instruction set; loads are as long as the arrays.
            unsafe {
                let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
                let beyond = _mm512_andnot_si512(_mm512_loadu_epi64(others.as_ptr().cast()), rows);
                _mm512_test_epi64_mask(beyond, beyond)
            }
        }

        #[inline(always)]
        unsafe fn restrict(rows: &[u64; GROUP], mask: u64, out: &mut [u64; GROUP]) -> u8 {
            // SAFETY: the caller's promise of the instruction set; the load and the store are as long as the arrays.
            unsafe {
                let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
                let rows = _mm512_and_si512(rows, _mm512_set1_epi64(mask.cast_signed()));
                _mm512_storeu_epi64(out.as_mut_ptr().cast(), rows);
                _mm512_test_epi64_mask(rows, rows)
            }
        }

        #[inline(always)]
        unsafe fn columns(rows: &[u64; GROUP]) -> u64 {
            // SAFETY: the caller's promise of the instruction set; the load is as long as the array.
            unsafe { _mm512_reduce_or_epi64(_mm512_loadu_epi64(rows.as_ptr().cast())).cast_unsigned() }
        }

        #[inline(always)]
        unsafe fn up_to(a: &[f32; GROUP], b: &[f32; GROUP]) -> u8 {
            // SAFETY: the caller's promise of the instruction set; loads are as long as the arrays.
            unsafe { _mm256_cmp_ps_mask::<_CMP_LE_OQ>(_mm256_loadu_ps(a.as_ptr()), _mm256_loadu_ps(b.as_ptr())) }
        }

        #[inline(always)]
        unsafe fn test_group<const COVERED: bool>(
            group: &BoxGroup,
            used: u8,
            frame: &Frame,
            coverage: &mut Coverage,
            faces: u8,
        ) -> GroupOnFaces {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { boxes::test_group_avx512::<Self, COVERED>(group, used, frame, coverage, faces) }
        }

        #[inline(always)]
        unsafe fn block_lines(triangles: &Transformed, face: Face, resolution: usize, out: &mut bits::BlockLines) {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { bits::block_lines_avx512(triangles, face, resolution, out) };
        }

        #[inline(always)]
        unsafe fn draw_lane<const COVERED: bool>(
            triangles: &Transformed,
            lines: &bits::BlockLines,
            face: Face,
            lane: usize,
            left: i32,
            right: i32,
            low: i32,
            high: i32,
            coverage: &mut Coverage,
            running: &[u32],
        ) -> bits::DrawnLane {
            // SAFETY: the caller's promise of the instruction set.
            unsafe {
                bits::draw_lane_avx512::<COVERED>(
                    triangles, lines, face, lane, left, right, low, high, coverage, running,
                )
            }
        }

        #[inline(always)]
        unsafe fn spans(
            lines: &EdgeLines,
            y: f64,
            x0: f64,
            x1: f64,
            starts: &mut [i32; GROUP],
            ends: &mut [i32; GROUP],
        ) -> u8 {
            // SAFETY: the caller's promise of the instruction set; stores are as long as the arrays.
            unsafe {
                let rows = _mm512_add_pd(
                    _mm512_set1_pd(y),
                    _mm512_setr_pd(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0),
                );
                let (first, end) = (_mm512_set1_pd(x0), _mm512_set1_pd(x1));
                let (mut low, mut high) = (first, end);
                for k in 0..3 {
                    let x = _mm512_add_pd(
                        _mm512_mul_pd(_mm512_set1_pd(lines.slope[k]), rows),
                        _mm512_set1_pd(lines.offset[k]),
                    );
                    // The second operand wins over NaN, as in the portable comparison.
                    low = _mm512_mask_max_pd(low, lines.left[k], x, low);
                    high = _mm512_mask_min_pd(high, lines.right[k], x, high);
                }
                low = _mm512_min_pd(low, end);
                high = _mm512_max_pd(high, first);
                let low = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(
                    low,
                ));
                let high = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(
                    high,
                ));
                _mm256_storeu_si256(starts.as_mut_ptr().cast(), low);
                _mm256_storeu_si256(ends.as_mut_ptr().cast(), high);
                _mm256_cmplt_epi32_mask(low, high)
            }
        }

        #[inline(always)]
        unsafe fn test(
            depth: &mut Chunk<f32>,
            items: &mut Chunk<u32>,
            mask: u16,
            base: f64,
            depths: &DepthPlane,
            id: u32,
        ) -> bool {
            // SAFETY: the caller's promise of the instruction set; chunks are 16 lanes, aligned to 64 bytes.
            unsafe {
                let base = _mm512_set1_pd(base);
                let near = _mm512_cvtpd_ps(_mm512_add_pd(base, _mm512_load_pd(depths.steps.as_ptr())));
                let far = _mm512_cvtpd_ps(_mm512_add_pd(base, _mm512_load_pd(depths.steps.as_ptr().add(8))));
                let z = _mm512_insertf32x8::<1>(_mm512_castps256_ps512(near), far);
                let z = _mm512_max_ps(z, _mm512_set1_ps(depths.plane.low));
                let z = _mm512_min_ps(z, _mm512_set1_ps(depths.plane.high));
                let old = _mm512_load_ps(depth.0.as_ptr());
                let mut won = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, z, old);
                let equal = _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(mask, z, old);
                let id = _mm512_set1_epi32(id.cast_signed());
                if equal != 0 {
                    let old_id = _mm512_load_si512(items.0.as_ptr().cast());
                    won |= _mm512_mask_cmplt_epu32_mask(equal, id, old_id);
                }
                // Whether any wins is as good as random: no branch. Whole stores, as what was stored in part is soon
                // read whole.
                _mm512_store_ps(depth.0.as_mut_ptr(), _mm512_mask_mov_ps(old, won, z));
                let old_id = _mm512_load_si512(items.0.as_ptr().cast());
                _mm512_store_si512(items.0.as_mut_ptr().cast(), _mm512_mask_mov_epi32(old_id, won, id));
                won != 0
            }
        }

        #[inline(always)]
        unsafe fn nearer(depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
            // SAFETY: the caller's promise of the instruction set; chunks are 16 lanes, aligned to 64 bytes.
            unsafe {
                let depth = _mm512_load_ps(depth.0.as_ptr());
                _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, depth, _mm512_set1_ps(bound)) == mask
            }
        }

        #[inline(always)]
        unsafe fn mask(flags: &Flags) -> u16 {
            // SAFETY: the caller's promise of the instruction set; flags are 16 lanes, aligned to 64 bytes.
            unsafe {
                let flags = _mm512_load_si512(flags.0.as_ptr().cast());
                _mm512_test_epi32_mask(flags, flags)
            }
        }

        #[inline(always)]
        unsafe fn changes(items: &Chunk<u32>, before: u32) -> u16 {
            // SAFETY: the caller's promise of the instruction set; chunks are 16 lanes, aligned to 64 bytes.
            unsafe {
                let items = _mm512_load_si512(items.0.as_ptr().cast());
                let before = _mm512_set1_epi32(before.cast_signed());
                _mm512_cmpneq_epi32_mask(items, _mm512_alignr_epi32::<15>(items, before))
            }
        }
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        unsafe fn on_faces(
            center: &[f64; 3],
            half: &[f64; 3],
            frame: &Frame,
            resolution: usize,
            faces: u8,
            touched: bool,
            out: &mut OnFaces,
        ) {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { boxes::on_faces_avx2(center, half, frame, resolution, faces, touched, out) };
        }

        #[inline(always)]
        unsafe fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { bits::lacking_avx2(rows, mask) }
        }

        #[inline(always)]
        unsafe fn draw_lane<const COVERED: bool>(
            triangles: &Transformed,
            _lines: &bits::BlockLines,
            face: Face,
            lane: usize,
            left: i32,
            right: i32,
            low: i32,
            high: i32,
            coverage: &mut Coverage,
            running: &[u32],
        ) -> bits::DrawnLane {
            // SAFETY: the caller's promise of the instruction set.
            unsafe { bits::draw_lane_avx2::<COVERED>(triangles, face, lane, left, right, low, high, coverage, running) }
        }

        #[inline(always)]
        unsafe fn spans(
            lines: &EdgeLines,
            y: f64,
            x0: f64,
            x1: f64,
            starts: &mut [i32; GROUP],
            ends: &mut [i32; GROUP],
        ) -> u8 {
            // SAFETY: the caller's promise of the instruction set; each half stores four of the eight entries.
            unsafe {
                let mut mask = 0;
                let (first, end) = (_mm256_set1_pd(x0), _mm256_set1_pd(x1));
                let side = |bits: u8| _mm256_castsi256_pd(_mm256_set1_epi8(bits.cast_signed()));
                for half in 0..2 {
                    let rows = _mm256_add_pd(
                        _mm256_set1_pd(y),
                        if half == 0 {
                            _mm256_setr_pd(0.0, 1.0, 2.0, 3.0)
                        } else {
                            _mm256_setr_pd(4.0, 5.0, 6.0, 7.0)
                        },
                    );
                    let (mut low, mut high) = (first, end);
                    for k in 0..3 {
                        let x = _mm256_add_pd(
                            _mm256_mul_pd(_mm256_set1_pd(lines.slope[k]), rows),
                            _mm256_set1_pd(lines.offset[k]),
                        );
                        // Which side an edge is on is as good as random: no branch.
                        low = _mm256_blendv_pd(low, _mm256_max_pd(x, low), side(lines.left[k]));
                        high = _mm256_blendv_pd(high, _mm256_min_pd(x, high), side(lines.right[k]));
                    }
                    low = _mm256_min_pd(low, end);
                    high = _mm256_max_pd(high, first);
                    let low = _mm256_cvtpd_epi32(_mm256_ceil_pd(low));
                    let high = _mm256_cvtpd_epi32(_mm256_ceil_pd(high));
                    _mm_storeu_si128(starts.as_mut_ptr().add(4 * half).cast(), low);
                    _mm_storeu_si128(ends.as_mut_ptr().add(4 * half).cast(), high);
                    let below = _mm_movemask_ps(_mm_castsi128_ps(_mm_cmplt_epi32(low, high)));
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "four bits")]
                    {
                        mask |= (below as u8) << (4 * half);
                    }
                }
                mask
            }
        }

        #[inline(always)]
        unsafe fn test(
            depth: &mut Chunk<f32>,
            items: &mut Chunk<u32>,
            mask: u16,
            base: f64,
            depths: &DepthPlane,
            id: u32,
        ) -> bool {
            // SAFETY: the caller's promise of the instruction set; each half is eight of the sixteen lanes, aligned to
            // 32 bytes.
            unsafe {
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let id = _mm256_set1_epi32(id.cast_signed());
                let mut any = false;
                for half in 0..2 {
                    let wanted = _mm256_set1_epi32(i32::from(mask >> (8 * half)));
                    let wanted = _mm256_cmpeq_epi32(_mm256_and_si256(wanted, bits), bits);
                    let depth_at = depth.0.as_mut_ptr().add(8 * half);
                    let items_at = items.0.as_mut_ptr().add(8 * half).cast::<__m256i>();
                    let steps = depths.steps.as_ptr().add(8 * half);
                    let base = _mm256_set1_pd(base);
                    let near = _mm256_cvtpd_ps(_mm256_add_pd(base, _mm256_load_pd(steps)));
                    let far = _mm256_cvtpd_ps(_mm256_add_pd(base, _mm256_load_pd(steps.add(4))));
                    let z = _mm256_set_m128(far, near);
                    let z = _mm256_max_ps(z, _mm256_set1_ps(depths.plane.low));
                    let z = _mm256_min_ps(z, _mm256_set1_ps(depths.plane.high));
                    let old = _mm256_load_ps(depth_at);
                    let old_id = _mm256_load_si256(items_at);
                    let nearer = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_GT_OQ>(z, old));
                    let equal = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_EQ_OQ>(z, old));
                    // Ids are below 2³¹, so a signed comparison will do.
                    let smaller = _mm256_cmpgt_epi32(old_id, id);
                    let won = _mm256_and_si256(wanted, _mm256_or_si256(nearer, _mm256_and_si256(equal, smaller)));
                    // Whether any wins is as good as random: no branch.
                    _mm256_store_ps(depth_at, _mm256_blendv_ps(old, z, _mm256_castsi256_ps(won)));
                    _mm256_store_si256(items_at, _mm256_blendv_epi8(old_id, id, won));
                    any |= _mm256_testz_si256(won, won) == 0;
                }
                any
            }
        }

        #[inline(always)]
        unsafe fn nearer(depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
            // SAFETY: the caller's promise of the instruction set; each half is eight of the sixteen lanes.
            unsafe {
                let half = |k: usize| {
                    let depth = _mm256_load_ps(depth.0.as_ptr().add(8 * k));
                    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(depth, _mm256_set1_ps(bound)))
                };
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
                let nearer = (half(0) | half(1) << 8) as u16;
                nearer & mask == mask
            }
        }

        #[inline(always)]
        unsafe fn mask(flags: &Flags) -> u16 {
            // SAFETY: the caller's promise of the instruction set; each half is eight of the sixteen flags.
            unsafe {
                let zero = _mm256_setzero_si256();
                let half = |k: usize| {
                    let flags = _mm256_load_si256(flags.0.as_ptr().add(8 * k).cast());
                    _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpgt_epi32(flags, zero)))
                };
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
                {
                    (half(0) | half(1) << 8) as u16
                }
            }
        }

        #[inline(always)]
        unsafe fn changes(items: &Chunk<u32>, before: u32) -> u16 {
            // SAFETY: the caller's promise of the instruction set; the second half's left neighbours start at lane 7.
            unsafe {
                let p = items.0.as_ptr();
                let rotate = _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6);
                let low = _mm256_load_si256(p.cast());
                let shifted = _mm256_permutevar8x32_epi32(low, rotate);
                let shifted = _mm256_blend_epi32::<1>(shifted, _mm256_set1_epi32(before.cast_signed()));
                let high = _mm256_load_si256(p.add(8).cast());
                let high_shifted = _mm256_loadu_si256(p.add(7).cast());
                let same = |a, b| _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)));
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
                {
                    !((same(low, shifted) | same(high, high_shifted) << 8) as u16)
                }
            }
        }
    }

    macro_rules! kernel {
        ($name:ident, $features:literal) => {
            impl Kernel for $name {
                unsafe fn transform(block: &Block, frame: &Frame, out: &mut Transformed) {
                    #[target_feature(enable = $features)]
                    fn inner(block: &Block, frame: &Frame, out: &mut Transformed) {
                        // SAFETY: this function has the instruction set.
                        unsafe { transform::<$name>(block, frame, out) };
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(block, frame, out) }
                }

                unsafe fn centroids(triangles: &Transformed, tolerance: f64, resolution: usize, out: &mut Centroids) {
                    #[target_feature(enable = $features)]
                    fn inner(triangles: &Transformed, tolerance: f64, resolution: usize, out: &mut Centroids) {
                        // SAFETY: this function has the instruction set.
                        unsafe { centroids::<$name>(triangles, tolerance, resolution, out) };
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(triangles, tolerance, resolution, out) }
                }

                unsafe fn on_faces(
                    center: &[f64; 3],
                    half: &[f64; 3],
                    frame: &Frame,
                    resolution: usize,
                    faces: u8,
                    touched: bool,
                    out: &mut OnFaces,
                ) {
                    #[target_feature(enable = $features)]
                    #[allow(clippy::too_many_arguments, reason = "the arguments of `Kernel::on_faces`")]
                    fn inner(
                        center: &[f64; 3],
                        half: &[f64; 3],
                        frame: &Frame,
                        resolution: usize,
                        faces: u8,
                        touched: bool,
                        out: &mut OnFaces,
                    ) {
                        // SAFETY: this function has the instruction set.
                        unsafe {
                            <$name as Lanes>::on_faces(center, half, frame, resolution, faces, touched, out);
                        }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(center, half, frame, resolution, faces, touched, out) }
                }

                unsafe fn test_group<const COVERED: bool>(
                    group: &BoxGroup,
                    used: u8,
                    frame: &Frame,
                    coverage: &mut Coverage,
                    faces: u8,
                ) -> GroupOnFaces {
                    #[target_feature(enable = $features)]
                    fn inner<const COVERED: bool>(
                        group: &BoxGroup,
                        used: u8,
                        frame: &Frame,
                        coverage: &mut Coverage,
                        faces: u8,
                    ) -> GroupOnFaces {
                        // SAFETY: this function has the instruction set.
                        unsafe { <$name as Lanes>::test_group::<COVERED>(group, used, frame, coverage, faces) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner::<COVERED>(group, used, frame, coverage, faces) }
                }

                unsafe fn draw<const COUNT: bool>(
                    triangles: &Transformed,
                    face: Face,
                    lanes: u16,
                    target: &mut Target,
                    pixels: &mut [u32; LANES],
                ) -> Drawn {
                    #[target_feature(enable = $features)]
                    fn inner<const COUNT: bool>(
                        triangles: &Transformed,
                        face: Face,
                        lanes: u16,
                        target: &mut Target,
                        pixels: &mut [u32; LANES],
                    ) -> Drawn {
                        // SAFETY: this function has the instruction set.
                        unsafe { draw::<$name, COUNT>(triangles, face, lanes, target, pixels) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner::<COUNT>(triangles, face, lanes, target, pixels) }
                }

                unsafe fn claim<const COUNT: bool>(
                    triangles: &Transformed,
                    face: Face,
                    lanes: u16,
                    claims: &mut Claims,
                    running: &[u32],
                    pixels: &mut [u32; LANES],
                ) -> Drawn {
                    #[target_feature(enable = $features)]
                    fn inner<const COUNT: bool>(
                        triangles: &Transformed,
                        face: Face,
                        lanes: u16,
                        claims: &mut Claims,
                        running: &[u32],
                        pixels: &mut [u32; LANES],
                    ) -> Drawn {
                        // SAFETY: this function has the instruction set.
                        unsafe { claims::draw::<$name, COUNT>(triangles, face, lanes, claims, running, pixels) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner::<COUNT>(triangles, face, lanes, claims, running, pixels) }
                }

                unsafe fn is_hidden(claims: &Claims, face: Face, pixels: [usize; 4], bound: f32) -> bool {
                    #[target_feature(enable = $features)]
                    fn inner(claims: &Claims, face: Face, pixels: [usize; 4], bound: f32) -> bool {
                        // SAFETY: this function has the instruction set.
                        unsafe { claims.is_hidden::<$name>(face, pixels, bound) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(claims, face, pixels, bound) }
                }

                unsafe fn cover_lanes(
                    triangles: &Transformed,
                    lanes: u16,
                    faces: u8,
                    resolution: usize,
                    top: &[u32],
                    side: &[u32],
                    out: &mut [(u32, u32); LANES],
                ) {
                    #[target_feature(enable = $features)]
                    fn inner(
                        triangles: &Transformed,
                        lanes: u16,
                        faces: u8,
                        resolution: usize,
                        top: &[u32],
                        side: &[u32],
                        out: &mut [(u32, u32); LANES],
                    ) {
                        // SAFETY: this function has the instruction set.
                        unsafe { bits::cover_lanes::<$name>(triangles, lanes, faces, resolution, top, side, out) };
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(triangles, lanes, faces, resolution, top, side, out) }
                }

                unsafe fn draw_bits<const COVERED: bool>(
                    triangles: &mut Transformed,
                    cut: Option<Cut<'_>>,
                    faces: u8,
                    turns: Turns<'_>,
                    coverage: &mut Coverage,
                    top: &[u32],
                    side: &[u32],
                    shown: &mut Shown,
                ) {
                    #[target_feature(enable = $features)]
                    #[allow(clippy::too_many_arguments, reason = "the arguments of `Kernel::draw_bits`")]
                    fn inner<const COVERED: bool>(
                        triangles: &mut Transformed,
                        cut: Option<Cut<'_>>,
                        faces: u8,
                        turns: Turns<'_>,
                        coverage: &mut Coverage,
                        top: &[u32],
                        side: &[u32],
                        shown: &mut Shown,
                    ) {
                        // SAFETY: this function has the instruction set.
                        unsafe {
                            bits::draw::<$name, COVERED>(triangles, cut, faces, turns, coverage, top, side, shown);
                        }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner::<COVERED>(triangles, cut, faces, turns, coverage, top, side, shown) }
                }

                unsafe fn open_centroids(
                    triangles: &Transformed,
                    lanes: u16,
                    faces: u8,
                    coverage: &Coverage,
                    remembered: bool,
                ) -> u16 {
                    #[target_feature(enable = $features)]
                    fn inner(t: &Transformed, lanes: u16, faces: u8, coverage: &Coverage, remembered: bool) -> u16 {
                        bits::open_centroids(t, lanes, faces, coverage, remembered)
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(triangles, lanes, faces, coverage, remembered) }
                }

                unsafe fn may_touch_open(triangles: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16 {
                    #[target_feature(enable = $features)]
                    fn inner(triangles: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16 {
                        // SAFETY: this function has the instruction set.
                        unsafe { bits::may_touch_open::<$name>(triangles, lanes, faces, coverage) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(triangles, lanes, faces, coverage) }
                }

                unsafe fn in_the_open(triangles: &Transformed, faces: u8, coverage: &Coverage) -> u16 {
                    #[target_feature(enable = $features)]
                    fn inner(triangles: &Transformed, faces: u8, coverage: &Coverage) -> u16 {
                        // SAFETY: this function has the instruction set.
                        unsafe { bits::in_the_open::<$name>(triangles, faces, coverage) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(triangles, faces, coverage) }
                }

                unsafe fn all_covered(coverage: &Coverage, pixels: [usize; 4]) -> bool {
                    #[target_feature(enable = $features)]
                    fn inner(coverage: &Coverage, pixels: [usize; 4]) -> bool {
                        // SAFETY: this function has the instruction set.
                        unsafe { bits::all_covered::<$name>(coverage, pixels) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(coverage, pixels) }
                }

                unsafe fn all_nearer(
                    depth: &[Chunk<f32>],
                    chunks_per_row: usize,
                    pixels: [usize; 4],
                    bound: f32,
                ) -> bool {
                    #[target_feature(enable = $features)]
                    fn inner(depth: &[Chunk<f32>], chunks_per_row: usize, pixels: [usize; 4], bound: f32) -> bool {
                        // SAFETY: this function has the instruction set.
                        unsafe { all_nearer::<$name>(depth, chunks_per_row, pixels, bound) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(depth, chunks_per_row, pixels, bound) }
                }

                unsafe fn tile_depth(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 {
                    #[target_feature(enable = $features)]
                    fn inner(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 {
                        tile_depth(depth, first, chunks_per_row)
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(depth, first, chunks_per_row) }
                }

                unsafe fn reduce(target: &mut Target, reduction: Reduction<'_>) {
                    #[target_feature(enable = $features)]
                    fn inner(target: &mut Target, reduction: Reduction<'_>) {
                        // SAFETY: this function has the instruction set.
                        unsafe { reduce::<$name>(target, reduction) }
                    }
                    // SAFETY: the caller's promise of the instruction set.
                    unsafe { inner(target, reduction) }
                }
            }
        };
    }

    kernel!(Avx512, "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt");
    kernel!(Avx2, "avx2,bmi1,bmi2,lzcnt,popcnt");
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sums_are_handed_out_in_ascending_order_and_forgotten() {
        let mut sums = Sums::new(10_000);
        for (id, pixels, weight) in [
            (9_999, 1, 5),
            (0, 2, 7),
            (64, 1, 0),
            (64, 3, 1),
            (4_096, 1, 2),
            (0, 1, 1),
        ] {
            sums.add(id, pixels, weight);
        }
        let mut seen = Vec::new();
        sums.drain(|id, pixels, weight| seen.push((id, pixels, weight)));
        assert_eq!(seen, [(0, 3, 8), (64, 4, 1), (4_096, 1, 2), (9_999, 1, 5)]);
        sums.drain(|_, _, _| panic!("nothing may be left"));
        assert!(sums.of.iter().all(|&s| s == 0));
    }

    /// Numbers that have broken rasterisers: huge, tiny, not finite, signed zeros.
    fn coefficient() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => -300.0..300.0f64,
            2 => -1e-3..1e-3f64,
            1 => prop::sample::select(vec![
                0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 5e-324, 0.5, -0.5, 16.0,
            ]),
        ]
    }

    fn lines() -> impl Strategy<Value = EdgeLines> {
        (
            prop::array::uniform3(coefficient()),
            prop::array::uniform3(coefficient()),
            prop::array::uniform3(prop::sample::select(vec![(0u8, 0u8), (u8::MAX, 0), (0, u8::MAX)])),
        )
            .prop_map(|(slope, offset, sides)| EdgeLines {
                slope,
                offset,
                left: sides.map(|s| s.0),
                right: sides.map(|s| s.1),
                ..EdgeLines::default()
            })
    }

    fn spans_of<L: Lanes>(lines: &EdgeLines, y: f64, x0: f64, x1: f64) -> (u8, [i32; GROUP], [i32; GROUP]) {
        let (mut starts, mut ends) = ([0; GROUP], [0; GROUP]);
        // SAFETY: callers checked the machine for L's instruction set.
        let rows = unsafe { L::spans(lines, y, x0, x1, &mut starts, &mut ends) };
        (rows, starts, ends)
    }

    #[cfg(target_arch = "x86_64")]
    fn same_on_every_instruction_set<T: PartialEq + std::fmt::Debug>(
        portable: T,
        avx2: impl Fn() -> T,
        avx512: impl Fn() -> T,
    ) -> Result<(), TestCaseError> {
        for isa in crate::Isa::available() {
            match isa {
                crate::Isa::Avx512 => prop_assert_eq!(&avx512(), &portable),
                crate::Isa::Avx2 => prop_assert_eq!(&avx2(), &portable),
                crate::Isa::Portable => {}
            }
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn spans_lie_within_their_box_whatever_the_edges(lines in lines(), group in 0u32..32, x0 in 0u32..255, width in 1u32..256) {
            let (x0, x1) = (f64::from(x0), f64::from((x0 + width).min(256)));
            let (_, starts, ends) = spans_of::<Portable>(&lines, f64::from(group * 8), x0, x1);
            for x in starts.into_iter().chain(ends) {
                prop_assert!((x0..=x1).contains(&f64::from(x)));
            }
        }

        #[cfg(target_arch = "x86_64")]
        #[test]
        fn spans_are_the_same_bits_on_every_path(lines in lines(), group in 0u32..32, x0 in 0u32..255, width in 1u32..256) {
            let (y, x0, x1) = (f64::from(group * 8), f64::from(x0), f64::from((x0 + width).min(256)));
            same_on_every_instruction_set(
                spans_of::<Portable>(&lines, y, x0, x1),
                || spans_of::<x86::Avx2>(&lines, y, x0, x1),
                || spans_of::<x86::Avx512>(&lines, y, x0, x1),
            )?;
        }

        #[cfg(target_arch = "x86_64")]
        #[test]
        fn depth_tests_are_the_same_bits_on_every_path(
            old in prop::array::uniform16(prop::sample::select(vec![0.0f32, 0.5, 1.0, 1.5, 2.0])),
            old_ids in prop::array::uniform16(0u32..4),
            mask in any::<u16>(),
            base in prop::sample::select(vec![0.0f64, 0.5, 1.0, -7.3, 1e300, f64::NAN, f64::INFINITY]),
            step in prop::sample::select(vec![0.0f64, 0.1, 0.5, -0.25, f64::NAN]),
            id in 0u32..4,
        ) {
            let mut steps = [0.0; LANES];
            for (i, s) in steps.iter_mut().enumerate() {
                *s = step * i as f64;
            }
            let depths = DepthPlane { steps, plane: Plane { low: 0.25, high: 1.75, x: 0.0, y: 0.0, constant: 0.0 } };
            fn run<L: Lanes>(old: [f32; 16], old_ids: [u32; 16], mask: u16, base: f64, depths: &DepthPlane, id: u32) -> ([u32; 16], [u32; 16], bool) {
                let (mut depth, mut items) = (Chunk(old), Chunk(old_ids));
                // SAFETY: callers checked the machine for L's instruction set.
                let any = unsafe { L::test(&mut depth, &mut items, mask, base, depths, id) };
                (depth.0.map(f32::to_bits), items.0, any)
            }
            same_on_every_instruction_set(
                run::<Portable>(old, old_ids, mask, base, &depths, id),
                || run::<x86::Avx2>(old, old_ids, mask, base, &depths, id),
                || run::<x86::Avx512>(old, old_ids, mask, base, &depths, id),
            )?;
        }

        #[cfg(target_arch = "x86_64")]
        #[test]
        fn changes_are_the_same_bits_on_every_path(items in prop::array::uniform16(0u32..3), before in 0u32..3) {
            let chunk = Chunk(items);
            // SAFETY: each is called only where the machine has the instruction set.
            unsafe {
                same_on_every_instruction_set(
                    Portable::changes(&chunk, before),
                    || x86::Avx2::changes(&chunk, before),
                    || x86::Avx512::changes(&chunk, before),
                )?;
            }
        }
    }
}
