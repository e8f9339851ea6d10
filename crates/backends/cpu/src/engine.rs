//! One session of engine `depth` or engine `claims`: the walk over the tree, then the reduction of the row. The two
//! differ in what they draw into.
//!
//! *Depth* walks a tree of boxes roughly front to back, draws into a buffer of depths and ids, and drops what lies
//! behind. It takes any scene. *Order* walks a binary space partition strictly front to back and has one bit a pixel:
//! what is drawn first is seen, so that there is no depth, no id and no reduction, and a box is hidden when its bits
//! are set. Both rasterise with the same code, so their pixel sums are the same bits wherever f32 depths can tell
//! surfaces apart (`tests/tests/engines.rs`). *Claims* walks the tree of *depth* with the bits of *order*
//! (`kernel/claims.rs`): what a triangle covers first is its claim, a mask of bits for each tile of 64 × 8 pixels, on a
//! page of the tile's, where eight claims at a time are asked for which bytes of its rows they have; where it covers
//! pixels of other claims, a bound for each cell of 8 × 8 mostly says that it is behind them, then the difference of
//! two planes over what they share, and what that leaves open is settled pixel by pixel by the depths that *depth*
//! would have compared. So its rows are those of *depth*, to the last bit, and a session may take either: it takes
//! *claims* where a hemicube has 350 pixels or more for each triangle that eight hemicubes at N = 128 drew. The two are
//! one walk (`engine.rs`) over two buffers (`buffer.rs`).
//!
//! No visible sets shared by neighbours, because even an oracle that finds them for nothing gains 1.2 times once they
//! are put into a tree, 1.8 on a real city; a conservative set is larger and must be found (`docs/study.md`).
//!
//! No coherence between hemicubes in the CPU backend, because with front-to-back order, drawing first what the last
//! hemicube saw loses 5–13 % (measured on prototypes). The order of work serves the caches.

use crate::Shared;
use crate::alone::Alone;
use crate::buffer::Buffer;
use crate::kernel::{
    Centroids, Frame, Kernel, OnFaces, Shown, Sums, Target, Transformed, Turns, prefetch, three, tiny_slack,
};
use crate::share::{Entry, SeenWhole, Sharing, UNCOUNTED, patches_of, without_pixels};
use crate::whole::{Whole, Wholes};
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Counters, Culling, Hemicube, WHOLE};
use hemicube_contract::bvh::{Block, INNER, LANES, Node, Tree, UNUSED};
use hemicube_contract::face::{Face, Items};
use hemicube_contract::row::RowBlock;
use std::marker::PhantomData;

pub(crate) const ALL_FACES: u8 = 0b1_1111;

/// A hemicube's working memory. One a thread.
#[derive(Debug)]
pub(crate) struct Engine<K, B> {
    buffer: B,
    sums: Sums,
    triangles: Box<Transformed>,
    pending: Vec<Pending>,
    /// For each block: which hemicube drew it last, and what its lanes covered.
    drawn: Vec<DrawnBlock>,
    hemicube: u32,
    tiny_candidates: Vec<TinyCandidate>,
    sharing: Sharing<K>,
    wholes_drawn: Vec<DrawnWhole>,
    /// For each whole the faces that it may be on; 0 for those that were not drawn.
    faces_of_whole: Vec<u8>,
    ids: Vec<(u32, u32, u32)>,
    on_faces: OnFaces,
    centroids: Box<Centroids>,
    tiny: Vec<u32>,
    row: Vec<(u32, u32, u32)>,
    /// Patches of which it is to be counted what they cover alone.
    uncounted: Vec<u32>,
    alone: Alone<K>,
    /// What stands for blocked: one above all patches.
    blocked: u32,
    counters: Counters,
    kernel: PhantomData<K>,
}

/// A node waiting to be tested.
#[derive(Clone, Copy, Debug)]
struct Pending {
    node: u32,
    /// Faces that it may be seen on.
    faces: u8,
    /// Faces on which it was found hidden: what it covers there is not known.
    hidden: u8,
}

/// What the lanes of a block covered in the hemicube that last drew it.
#[derive(Clone, Copy, Debug)]
struct DrawnBlock {
    hemicube: u32,
    /// Lanes that were left out on some face as hidden, so that `pixels` is not all that they would cover.
    incomplete: u16,
    pixels: [u32; LANES],
}

/// A triangle that was cut, was drawn and may be seen, if only in part between pixel centres.
#[derive(Clone, Copy, Debug)]
struct DrawnWhole {
    whole: u32,
    id: u32,
    /// The faces that may have pixels of it.
    faces: u8,
    pixels: Pixels,
}

/// True if a triangle covers the centre of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixels {
    /// It does, or it is so far behind that it does not matter.
    Some,
    None,
    Unknown,
}

/// Results for the lanes of a block that was drawn.
#[derive(Clone, Copy, Debug)]
struct LanesOn {
    /// Those that can be seen at all.
    live: u16,
    /// Those that each face may have pixels of.
    on: [u16; Face::ALL.len()],
    /// Those that are hidden on some face, even where what is about as near may be seen.
    behind: u16,
    /// Those that were not found to cover a pixel.
    without: u16,
    /// Those that were left out on some face, so that this does not say much.
    incomplete: u16,
}

/// A patch that was drawn and covered no pixel centre.
#[derive(Clone, Copy, Debug)]
struct TinyCandidate {
    patch: u32,
    /// True if it is still to be shown that it covers none: it was left out on some face.
    unproved: bool,
    /// The pixel of its centroid, in the atlas.
    row: u32,
    column: u32,
    /// 1/w of the centroid, and its direction there, whose w is 1.
    depth: f64,
    direction: [f64; 3],
}

impl<K: Kernel, B: Buffer> Engine<K, B> {
    pub(crate) fn new(shared: &Shared) -> Self {
        let patch_count = shared.tree.patch_count;
        let drawn_blocks = if shared.settings.covered {
            shared.tree.blocks.len()
        } else {
            0
        };
        Self {
            buffer: B::new(shared),
            sums: Sums::new(patch_count as usize + 2),
            triangles: Box::new(Transformed::new()),
            pending: Vec::new(),
            drawn: vec![
                DrawnBlock {
                    hemicube: 0,
                    incomplete: 0,
                    pixels: [0; LANES]
                };
                drawn_blocks
            ],
            hemicube: 0,
            tiny_candidates: Vec::new(),
            sharing: Sharing::new(shared),
            wholes_drawn: Vec::new(),
            faces_of_whole: vec![0; shared.wholes.as_ref().map_or(0, |wholes| wholes.len())],
            ids: Vec::new(),
            on_faces: OnFaces::new(),
            centroids: Box::new(Centroids::new()),
            tiny: Vec::new(),
            row: Vec::new(),
            uncounted: Vec::new(),
            alone: Alone::new(),
            blocked: patch_count,
            counters: Counters::default(),
            kernel: PhantomData,
        }
    }

    pub(crate) fn rows(&mut self, shared: &Shared, hemicubes: &[Hemicube], out: &mut RowBlock) -> Counters {
        self.counters = Counters::default();
        for hemicube in hemicubes {
            if shared.settings.covered {
                self.row::<true>(shared, hemicube, out);
            } else {
                self.row::<false>(shared, hemicube, out);
            }
        }
        self.counters
    }

    fn row<const COVERED: bool>(&mut self, shared: &Shared, hemicube: &Hemicube, out: &mut RowBlock) {
        let tree = &shared.tree;
        let frame = frame(shared, hemicube);
        let drawn_before = self.counters.triangles_drawn;
        self.render::<COVERED>(shared, &frame);
        if COVERED && shared.wholes.is_none() {
            self.find_tiny(shared, &frame);
        }
        let is_clear = self.counters.triangles_drawn == drawn_before;
        if is_clear && self.tiny.is_empty() && self.tiny_candidates.is_empty() && self.wholes_drawn.is_empty() {
            // Nothing is in view, and the target is as clear as it was.
            out.end_row(WHOLE, 0);
            return;
        }
        self.buffer.reduce::<K>(shared, &mut self.sums);
        if let Some(wholes) = &shared.wholes {
            self.row_of_wholes::<COVERED>(shared, wholes, &frame, out);
            return;
        }
        self.buffer.clear();

        let (mut escaped, mut blocked) = (0, 0);
        if !COVERED {
            self.sums.drain(|id, _, weight| match id {
                id if id < tree.patch_count => out.push(InputPatch(id), weight, 0),
                id if id == tree.patch_count => blocked = weight,
                _ => escaped = weight,
            });
            out.end_row(escaped, blocked);
            return;
        }
        let row = &mut self.row;
        row.clear();
        self.sums.drain(|id, pixels, weight| match id {
            id if id < tree.patch_count => row.push((id, pixels, weight)),
            id if id == tree.patch_count => blocked = weight,
            _ => escaped = weight,
        });
        // What is not known of covered weights is counted; of the others, all that is covered is seen.
        self.uncounted.clear();
        for &(id, pixels, _) in &self.row {
            if self.known_pixels(tree, id) != Some(pixels) {
                self.uncounted.push(id);
            }
        }
        let counts = self.alone.count(shared, &frame, &self.uncounted);
        let mut counted = self.uncounted.iter().zip(counts).peekable();
        let mut tiny = self.tiny.iter().copied().peekable();
        for &(id, _, weight) in &self.row {
            // A tiny patch has no pixel, so its id is never in the row already.
            while let Some(tiny) = tiny.next_if(|&t| t < id) {
                out.push(InputPatch(tiny), 0, 0);
            }
            let covered = counted.next_if(|(patch, _)| **patch == id).map_or(weight, |(_, c)| c.1);
            out.push(InputPatch(id), weight, covered);
        }
        for tiny in tiny {
            out.push(InputPatch(tiny), 0, 0);
        }
        out.end_row(escaped, blocked);
    }

    /// The row of what was rendered and reduced, where triangles that were cut were drawn as they were before.
    fn row_of_wholes<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        wholes: &Wholes,
        frame: &Frame,
        out: &mut RowBlock,
    ) {
        let patch_count = shared.tree.patch_count;
        for drawn in &self.wholes_drawn {
            self.faces_of_whole[drawn.whole as usize] = drawn.faces;
        }
        let mut ids = std::mem::take(&mut self.ids);
        self.sums.drain(|id, pixels, weight| ids.push((id, pixels, weight)));
        let (mut escaped, mut blocked) = (0, 0);
        for (id, pixels, weight) in ids.drain(..) {
            if id >= patch_count {
                *(if id == patch_count { &mut blocked } else { &mut escaped }) = weight;
            } else if let Some(whole) = wholes.cut(id) {
                let seen = SeenWhole {
                    whole: wholes.get(whole),
                    id,
                    faces: self.faces_of_whole[whole as usize],
                    weight,
                };
                if shared.fractions && self.shows_all(shared, frame, &seen, pixels) {
                    self.sharing.list_all(wholes, frame, &seen);
                } else {
                    self.share::<COVERED>(shared, wholes, frame, seen);
                }
                self.buffer.forget(id);
            } else {
                // Of what is known and covers no other pixels, all is seen.
                let is_known = COVERED && self.known_pixels(&shared.tree, id) == Some(pixels);
                let covered = if is_known { weight } else { UNCOUNTED };
                self.sharing.entries.push(Entry::new(id, weight, covered));
            }
        }
        if COVERED {
            self.find_tiny_wholes(shared, wholes, frame);
            self.find_tiny(shared, frame);
        }
        self.buffer.clear();
        self.counters.triangles_transformed += self.sharing.take_transformed();
        self.sharing
            .end_row::<COVERED>(shared, frame, &self.tiny, (escaped, blocked), out);
        self.ids = ids;
    }

    /// The pixels that what is drawn with an id covers, where that is known.
    fn known_pixels(&self, tree: &Tree, id: u32) -> Option<u32> {
        let slot = tree.slot_of_patch[id as usize] as usize;
        let (drawn, lane) = (&self.drawn[slot / LANES], slot % LANES);
        let is_known = drawn.incomplete >> lane & 1 == 0 && drawn.hemicube == self.hemicube;
        is_known.then_some(drawn.pixels[lane])
    }

    /// Returns whether what is seen of a triangle that was cut, so many pixels, is all that it covers.
    fn shows_all(&mut self, shared: &Shared, frame: &Frame, seen: &SeenWhole<'_>, pixels: u32) -> bool {
        let known = self.known_pixels(&shared.tree, seen.id);
        // What culling left unknown must not decide.
        known.unwrap_or_else(|| self.covered_pixels(shared, frame, seen.id, seen.faces)) == pixels
    }

    /// Shares out what is seen of a triangle that was cut among its patches.
    fn share<const COVERED: bool>(&mut self, shared: &Shared, wholes: &Wholes, frame: &Frame, mut seen: SeenWhole<'_>) {
        let (buffer, centroids, tiny) = (&self.buffer, &mut self.centroids, &mut self.tiny);
        let (id, faces) = (seen.id, seen.faces);
        let shown_on = buffer.open(id, &mut self.sharing.open);
        if !COVERED {
            // What is covered must be known on all faces, what is seen only on those.
            seen.faces = shown_on;
        }
        let stays_open = self
            .sharing
            .share::<COVERED>(shared, wholes, frame, &seen, |t, lanes, hidden| {
                find_tiny_parts::<K, B>(buffer, centroids, shared, frame, (id, faces), t, (lanes, hidden), tiny);
            });
        if stays_open {
            buffer.close(id, &mut self.sharing.open);
        }
    }

    /// Lists the lanes of a block that are triangles that were cut and may be seen, if only in part between pixel
    /// centres; returns all that are such triangles.
    fn list_wholes(&mut self, wholes: &Wholes, block: usize, of: LanesOn) -> u16 {
        let lanes = wholes.lanes(block);
        let mut left = of.live & lanes.cut;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let id = self.triangles.seen[lane];
            let faces = (0..of.on.len()).fold(0, |faces, face| faces | u8::from(of.on[face] >> lane & 1 != 0) << face);
            // Behind on the one face that it is on, if that is certain.
            let is_behind = of.behind >> lane & 1 != 0 && faces.is_power_of_two();
            if id >= self.blocked
                || is_behind
                    && self
                        .triangles
                        .is_within(Face::ALL[faces.trailing_zeros() as usize], lane)
            {
                continue;
            }
            self.wholes_drawn.push(DrawnWhole {
                whole: lanes.whole[lane],
                id,
                faces,
                pixels: match (of.without >> lane & 1 != 0, of.incomplete >> lane & 1 != 0) {
                    (false, _) => Pixels::Some,
                    (true, false) => Pixels::None,
                    (true, true) => Pixels::Unknown,
                },
            });
        }
        lanes.cut
    }

    /// Of triangles that were cut, were drawn and cover no pixel centre, finds the patches that are seen between them.
    fn find_tiny_wholes(&mut self, shared: &Shared, wholes: &Wholes, frame: &Frame) {
        let drawn = std::mem::take(&mut self.wholes_drawn);
        for &DrawnWhole {
            whole,
            id,
            faces,
            pixels,
        } in &drawn
        {
            self.faces_of_whole[whole as usize] = 0;
            if pixels == Pixels::Some {
                continue;
            }
            let whole = wholes.get(whole);
            let (center, half) = whole.bounds();
            let (visible, _) = self.visible_faces::<true>(shared, center, half, frame, ALL_FACES);
            if visible == 0 || pixels == Pixels::Unknown && self.covered_pixels(shared, frame, id, faces) != 0 {
                continue;
            }
            for block in 0..wholes.block_count(whole) {
                self.sharing.transform(wholes, frame, whole, id, block);
                let t = &*self.sharing.triangles;
                if t.live != 0 {
                    let (buffer, centroids, tiny) = (&self.buffer, &mut self.centroids, &mut self.tiny);
                    find_tiny_parts::<K, B>(buffer, centroids, shared, frame, (id, faces), t, (t.live, 0), tiny);
                }
            }
        }
        self.wholes_drawn = drawn;
    }

    /// The pixels of some faces that what is drawn as `id` covers.
    fn covered_pixels(&mut self, shared: &Shared, frame: &Frame, id: u32, faces: u8) -> u32 {
        let slot = shared.tree.slot_of_patch[id as usize] as usize;
        let (block, lane) = (&shared.tree.blocks[slot / LANES], slot % LANES);
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        let mut counts = [(0, 0); LANES];
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe {
            K::transform(block, frame, &mut self.triangles);
            let resolution = shared.settings.resolution as usize;
            K::cover_lanes(&self.triangles, 1 << lane, faces, resolution, top, side, &mut counts);
        }
        counts[lane].0
    }

    /// Draws the scene into the target, which is clear.
    fn render<const COVERED: bool>(&mut self, shared: &Shared, frame: &Frame) {
        let tree = &shared.tree;
        self.counters.hemicubes += 1;
        self.hemicube = self.hemicube.wrapping_add(1);
        if self.hemicube == 0 {
            // After 2³² hemicubes a stamp could be taken for an old one.
            self.drawn.iter_mut().for_each(|d| d.hemicube = 0);
            self.hemicube = 1;
        }
        self.tiny_candidates.clear();
        self.tiny.clear();
        self.wholes_drawn.clear();
        if shared.settings.culling == Culling::Off {
            for block in 0..tree.blocks.len() {
                self.draw_block::<COVERED>(shared, frame, block, ALL_FACES, 0);
            }
            return;
        }
        self.pending.clear();
        self.pending.push(Pending {
            node: 0,
            faces: ALL_FACES,
            hidden: 0,
        });
        while let Some(Pending { node, faces, hidden }) = self.pending.pop() {
            let node = &tree.nodes[node as usize];
            self.counters.nodes_tested += 1;
            let (faces, hidden_now) = self.visible_faces::<COVERED>(shared, node.center, node.half, frame, faces);
            let hidden = hidden | hidden_now;
            if faces == 0 {
                if hidden_now == 0 {
                    self.counters.nodes_outside += 1;
                } else {
                    self.counters.nodes_hidden += 1;
                }
                continue;
            }
            if node.block != INNER {
                self.draw_block::<COVERED>(shared, frame, node.block as usize, faces, hidden);
                continue;
            }
            let [near, far] = front_to_back(tree, node.child, frame);
            for next in [near, far] {
                let next = &tree.nodes[next as usize];
                if next.block == INNER {
                    prefetch(&tree.nodes[next.child as usize]);
                    prefetch(&tree.nodes[next.child as usize + 1]);
                } else {
                    prefetch(&tree.blocks[next.block as usize]);
                }
            }
            self.pending.push(Pending {
                node: far,
                faces,
                hidden,
            });
            self.pending.push(Pending {
                node: near,
                faces,
                hidden,
            });
        }
    }

    fn draw_block<const COVERED: bool>(&mut self, shared: &Shared, frame: &Frame, block: usize, faces: u8, hidden: u8) {
        let tree = &shared.tree;
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe { K::transform(&tree.blocks[block], frame, &mut self.triangles) };
        let live = self.triangles.live;
        self.counters.triangles_transformed += LANES as u64;
        let mut pixels = [0; LANES];
        let mut incomplete = if hidden == 0 { 0 } else { u16::MAX };
        // Lanes that are on each face or may be, and those that are hidden on one even where what is about as near may
        // be seen.
        let mut on = std::array::from_fn(|face| if hidden >> face & 1 != 0 { live } else { 0 });
        let mut behind = 0;
        if live != 0 {
            for face in Face::ALL {
                if faces >> face as u8 & 1 == 0 {
                    continue;
                }
                let drawn = self
                    .buffer
                    .draw::<K, COVERED>(shared, &self.triangles, face, live, &mut pixels);
                self.counters.triangles_drawn += u64::from(drawn.drawn.count_ones());
                incomplete |= drawn.hidden;
                on[face as usize] = drawn.on;
                behind |= drawn.behind;
            }
        }
        if COVERED {
            self.drawn[block] = DrawnBlock {
                hemicube: self.hemicube,
                incomplete,
                pixels,
            };
            let mut candidates = live;
            for (lane, &pixels) in pixels.iter().enumerate() {
                if pixels != 0 || self.triangles.seen[lane] >= tree.patch_count {
                    candidates &= !(1 << lane);
                }
            }
            if let Some(wholes) = &shared.wholes {
                let lanes = LanesOn {
                    live,
                    on,
                    behind,
                    without: candidates,
                    incomplete,
                };
                candidates &= !self.list_wholes(wholes, block, lanes);
            }
            if candidates != 0 {
                self.list_tiny(shared, frame, candidates, incomplete);
            }
        }
    }

    /// Lists patches of a block that covered no pixel centre, but for those whose centroid is behind what was drawn
    /// already. Of those in `unproved`, that they cover none is still to be shown.
    fn list_tiny(&mut self, shared: &Shared, frame: &Frame, candidates: u16, unproved: u16) {
        let resolution = shared.settings.resolution as usize;
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe { K::centroids(&self.triangles, frame.tolerance, resolution, &mut self.centroids) };
        let centroids = &*self.centroids;
        let mut candidates = candidates & centroids.above;
        while candidates != 0 {
            let lane = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            let (row, column) = (centroids.row[lane], centroids.x[lane]);
            let depth = centroids.depth[lane];
            if depth < about(shared, self.buffer.at_least(row as usize, column as usize)) {
                // Depths only grow.
                continue;
            }
            self.tiny_candidates.push(TinyCandidate {
                patch: self.triangles.seen[lane],
                unproved: unproved >> lane & 1 != 0,
                row,
                column,
                depth,
                direction: three(|c| centroids.direction[c][lane]),
            });
        }
    }

    /// On which faces a box may be seen, and on which of the others it is hidden.
    #[inline]
    fn visible_faces<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        center: DVec3,
        half: DVec3,
        frame: &Frame,
        faces: u8,
    ) -> (u8, u8) {
        let (center, half) = (center.to_array(), half.to_array());
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe {
            K::on_faces(
                &center,
                &half,
                frame,
                shared.settings.resolution as usize,
                faces,
                COVERED,
                &mut self.on_faces,
            );
        }
        let (mut visible, mut hidden) = (self.on_faces.at_eye, 0);
        let mut boxed = self.on_faces.boxed;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            let pixels = self.on_faces.in_atlas(face, shared.settings.resolution as usize);
            if self.is_hidden::<COVERED>(shared, Face::ALL[face], pixels, self.on_faces.near[face]) {
                hidden |= 1 << face;
            } else {
                visible |= 1 << face;
            }
        }
        (visible, hidden)
    }

    /// Returns whether all of a box of the atlas (inclusive), on a face, is nearer than `nearest`, in 1/w.
    #[inline]
    fn is_hidden<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        face: Face,
        pixels: [usize; 4],
        nearest: f64,
    ) -> bool {
        // Depths are within rounding of the corners' 1/w, widened by a millionth. With tiny patches, what is about as
        // near as the pixels in front of it may be seen.
        let slack = if COVERED {
            1.0 + tiny_slack(shared.settings.resolution)
        } else {
            1.0
        };
        #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
        let bound = (nearest * slack * (1.0 + 4e-6)) as f32;
        self.buffer.is_hidden::<K>(face, pixels, bound)
    }

    /// Among the patches that were drawn and covered no pixel centre, finds those that are nearest at their centroid.
    ///
    /// "Nearest" means: not behind what is seen at the pixel there. A neighbour in the same surface must not hide it,
    /// as it would if depths at the pixel's centre were compared; but for culling to change nothing, it must also be
    /// about as near as the pixel, for what culling drops is not.
    fn find_tiny(&mut self, shared: &Shared, frame: &Frame) {
        let tree = &shared.tree;
        let mut candidates = std::mem::take(&mut self.tiny_candidates);
        self.uncounted.clear();
        for candidate in &candidates {
            let &TinyCandidate { patch, depth, .. } = candidate;
            let (id, seen) = self.buffer.seen_at(candidate.row as usize, candidate.column as usize);
            if depth < about(shared, seen) {
                continue;
            }
            if !is_in_front(tree, id, frame, depth, candidate.direction) {
                continue;
            }
            if candidate.unproved {
                self.uncounted.push(patch);
            } else {
                self.tiny.push(patch);
            }
        }
        let counts = self.alone.count(shared, frame, &self.uncounted);
        let none = self
            .uncounted
            .iter()
            .zip(counts)
            .filter(|(_, (pixels, _))| *pixels == 0);
        self.tiny.extend(none.map(|(&patch, _)| patch));
        candidates.clear();
        self.tiny_candidates = candidates;
        self.tiny.sort_unstable();
    }
}

impl<K: Kernel> Engine<K, Target> {
    pub(crate) fn items(&mut self, shared: &Shared, hemicube: &Hemicube) -> Items {
        let frame = frame(shared, hemicube);
        self.render::<false>(shared, &frame);
        let patch_count = shared.tree.patch_count;
        let mut seen: Vec<u32> = self.buffer.items.iter().flat_map(|chunk| chunk.0).collect();
        if let Some(wholes) = &shared.wholes {
            self.buffer.reduce::<K>(shared, &mut self.sums);
            let mut ids = std::mem::take(&mut self.ids);
            self.sums.drain(|id, pixels, weight| ids.push((id, pixels, weight)));
            for (id, ..) in ids.drain(..) {
                if id < patch_count
                    && let Some(whole) = wholes.cut(id)
                {
                    self.share_items(shared, wholes, &frame, id, wholes.get(whole), &mut seen);
                }
            }
            self.ids = ids;
        }
        self.buffer.clear_all();
        for id in &mut seen {
            *id = match *id {
                id if id < patch_count => id,
                id if id == patch_count => Items::BLOCKED,
                _ => Items::ESCAPED,
            };
        }
        Items {
            resolution: shared.settings.resolution,
            seen,
        }
    }

    /// Gives the pixels of a triangle that was cut, and drawn as `id`, to its patches, as [`Self::share`] does their
    /// weights.
    fn share_items(
        &mut self,
        shared: &Shared,
        wholes: &Wholes,
        frame: &Frame,
        id: u32,
        whole: &Whole,
        seen: &mut [u32],
    ) {
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        let resolution = shared.settings.resolution as usize;
        let runs = self.buffer.noted.of(id).map(|place| self.buffer.runs[place]);
        let mut left: Vec<(usize, usize)> = runs
            .flat_map(|run| (usize::from(run.start)..usize::from(run.end)).map(move |x| (run.row as usize, x)))
            .collect();
        let mut most = None;
        let sharing = &mut self.sharing;
        self.buffer.open(id, &mut sharing.open);
        for block in 0..wholes.block_count(whole) {
            sharing.transform(wholes, frame, whole, id, block);
            let (t, open) = (&mut *sharing.triangles, &mut sharing.open);
            for lane in 0..LANES {
                let patch = t.seen[lane];
                if t.live >> lane & 1 == 0 {
                    continue;
                }
                let mut shown = Shown::new();
                #[allow(clippy::cast_possible_truncation, reason = "below 16")]
                let turns = [lane as u8];
                let turns = Turns::InOrder(&turns);
                // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
                unsafe { K::draw_bits::<false>(t, None, ALL_FACES, turns, open, top, side, &mut shown) };
                if shown.seen == 0 {
                    continue;
                }
                let visible = shown.visible[lane];
                if most.is_none_or(|(_, other)| visible >= other) {
                    most = Some((patch, visible));
                }
                left.retain(|&(row, x)| {
                    let is_open = !open.is_covered(row, x, false);
                    if !is_open {
                        seen[row * resolution + x] = patch;
                    }
                    is_open
                });
            }
        }
        if !left.is_empty() {
            let patch = most.map_or_else(|| wholes.nearest(whole, id, frame), |(patch, _)| patch);
            for &(row, x) in &left {
                seen[row * resolution + x] = patch;
            }
        }
        self.buffer.close(id, &mut self.sharing.open);
        self.buffer.forget(id);
    }
}

/// Among lanes of a block of patches, parts of what was drawn as `whole` and is on `faces`, finds those that cover no
/// pixel centre and are nearest at their centroid, as [`Engine::find_tiny`] does, when all is drawn. That they cover
/// none is still to be shown of those in `unproved`.
#[allow(
    clippy::too_many_arguments,
    reason = "private: parts of an engine, of which others are in use"
)]
fn find_tiny_parts<K: Kernel, B: Buffer>(
    buffer: &B,
    centroids: &mut Centroids,
    shared: &Shared,
    frame: &Frame,
    (whole, faces): (u32, u8),
    t: &Transformed,
    (candidates, unproved): (u16, u16),
    tiny: &mut Vec<u32>,
) {
    let tree = &shared.tree;
    let resolution = shared.settings.resolution as usize;
    // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
    unsafe { K::centroids(t, frame.tolerance, resolution, centroids) };
    let mut left = candidates & centroids.above;
    let mut found = 0;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        let (row, column, depth) = (centroids.row[lane], centroids.x[lane], centroids.depth[lane]);
        let (row, column) = (row as usize, column as usize);
        if depth < about(shared, buffer.at_least(row, column)) {
            continue;
        }
        let (id, seen) = buffer.seen_at(row, column);
        if depth < about(shared, seen) {
            continue;
        }
        let direction = three(|c| centroids.direction[c][lane]);
        // What it is a part of has no depth but its own.
        let is_in_front = id == whole || is_in_front(tree, id, frame, depth, direction);
        found |= u16::from(is_in_front) << lane;
    }
    let found = without_pixels::<K>(shared, t, found, unproved, faces);
    tiny.extend(patches_of(t, found));
}

/// The 1/w that a centroid must have at least to be about as near as what is seen at its pixel.
#[inline(always)]
fn about(shared: &Shared, seen: f32) -> f64 {
    f64::from(seen) / (1.0 + tiny_slack(shared.settings.resolution))
}

pub(crate) fn frame(shared: &Shared, hemicube: &Hemicube) -> Frame {
    let emitter = hemicube.emitter.map_or(UNUSED, |p| p.0);
    Frame::new(
        hemicube.origin.to_array(),
        hemicube.axes.map(|a| a.to_array()),
        shared.tree.plane_tolerance,
        match &shared.wholes {
            Some(wholes) if emitter != UNUSED => wholes.drawn_as(emitter),
            _ => emitter,
        },
    )
}

/// The two children of a node, the nearer first.
#[inline(always)]
fn front_to_back(tree: &Tree, child: u32, frame: &Frame) -> [u32; 2] {
    let distance = |node: &Node| {
        let mut to_box = 0.0;
        let mut to_center = 0.0;
        for c in 0..3 {
            let d = (node.center[c] - frame.origin[c]).abs();
            let outside = (d - node.half[c]).max(0.0);
            to_box += outside * outside;
            to_center += d * d;
        }
        (to_box, to_center)
    };
    let (a, b) = (
        distance(&tree.nodes[child as usize]),
        distance(&tree.nodes[child as usize + 1]),
    );
    if a <= b { [child, child + 1] } else { [child + 1, child] }
}

fn corners_in_frame(block: &Block, lane: usize, frame: &Frame) -> [[f64; 3]; 3] {
    three(|k| {
        let d = three(|c| block.corners[3 * k + c][lane] - frame.origin[c]);
        three(|a| {
            let m = &frame.axes[a];
            m[0] * d[0] + m[1] * d[1] + m[2] * d[2]
        })
    })
}

/// Whether a centroid, in a direction and by its 1/w, is in front of what is seen at its pixel. Where that reaches the
/// centroid, its depth there decides; where it does not, as beyond a silhouette, being about as near as the pixel does.
fn is_in_front(tree: &Tree, seen: u32, frame: &Frame, depth: f64, direction: [f64; 3]) -> bool {
    seen >= tree.patch_count
        || depth_there(tree, seen, frame, direction).is_none_or(|there| depth >= there * (1.0 - 1e-6))
}

/// 1/w of a patch in a direction, by the axis along which that is 1, or `None` where the direction misses it.
fn depth_there(tree: &Tree, patch: u32, frame: &Frame, direction: [f64; 3]) -> Option<f64> {
    let slot = tree.slot_of_patch[patch as usize] as usize;
    let [a, b, c] = corners_in_frame(&tree.blocks[slot / LANES], slot % LANES, frame).map(DVec3::from_array);
    let direction = DVec3::from_array(direction);
    let edges = [b.cross(c), c.cross(a), a.cross(b)].map(|e| e.dot(direction));
    let determinant = b.cross(c).dot(a);
    let inside = edges.iter().all(|e| e * determinant >= 0.0);
    let depth = (edges[0] + edges[1] + edges[2]) / determinant;
    (inside && depth.is_finite() && depth > 0.0).then_some(depth)
}
