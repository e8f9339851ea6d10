//! One session of engine `order`: the walk over the order, nearest first, and the row straight from what was drawn.
//!
//! The partition of *order* is then of the triangles before they were cut (version `order-2` for fractions, `order-3`
//! otherwise). It has no buffer that says at the end what is seen where, so it records as it draws: eight words of bits
//! at a time what a whole shows, and unless pixel sums are all that is asked, of the rows that it touches what was open
//! before its plane was begun (`Record` in `kernel/bits.rs`). When all is drawn, each whole that is seen is shared out
//! by what was recorded of it (`share.rs`, which all engines have). Patches without a pixel are asked whether their
//! centroid was open: in wholes that show something by the record, in wholes without a pixel when these are drawn. What
//! is in pieces is asked only of patches whose centroid is in the piece, as the others' pieces may have been culled.

use crate::Shared;
use crate::alone::Alone;
use crate::engine::{ALL_FACES, frame};
use crate::kernel::{
    BOXES, Coverage, Cut, Frame, GroupOnFaces, Kernel, Noted, OnFaces, PatchSet, Recorded, Shown, Sums, Transformed,
    Turns, prefetch,
};
use crate::order::{NO_PLANE, NONE, Order, PlaneNode};
use crate::share::{Entry, SeenWhole, Sharing, UNCOUNTED, patches_of, without_pixels};
use crate::whole::Wholes;
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Counters, Culling, Hemicube};
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::face::Face;
use hemicube_contract::row::RowBlock;
use std::marker::PhantomData;
use std::ops::Range;

/// A hemicube's working memory. One a thread.
#[derive(Debug)]
pub(crate) struct OrderedEngine<K> {
    coverage: Coverage,
    sums: Sums,
    triangles: Box<Transformed>,
    /// What the pieces of a block were cut from.
    whole: Box<Transformed>,
    pending: Vec<Pending>,
    /// Nodes of a layer that are to be looked at, and blocks of it that are to be drawn.
    layer_nodes: Vec<InLayer>,
    layer_blocks: Vec<InLayer>,
    /// Of each of these, lanes whose centroids are open, where they are asked beforehand.
    open: Vec<u16>,
    on_faces: OnFaces,
    /// Patches that cover no pixel centre and whose centroid was seen.
    tiny: PatchSet,
    /// Patches of which a part is like that, but that they cover no pixel centre is still to be proved.
    perhaps_tiny: PatchSet,
    /// What was in these sets, in ascending order.
    tiny_patches: [Vec<u32>; 2],
    row: Vec<Listed>,
    /// Places in `row` whose covered weight is to be counted.
    uncounted: Vec<u32>,
    /// Their patches.
    patches: Vec<u32>,
    alone: Alone<K>,
    /// Where triangles that were cut are drawn as they were before.
    parts: Parts,
    sharing: Sharing<K>,
    counters: Counters,
    kernel: PhantomData<K>,
}

/// Results for triangles that were cut, when all is drawn.
#[derive(Debug)]
struct Parts {
    /// What was recorded of each of them, in the order of `noted`.
    recorded: Vec<Recorded>,
    noted: Noted,
    /// All is covered but, for the moment, what was open to one of them.
    open: Coverage,
    /// What was drawn: id, covered weight, visible weight.
    ids: Vec<(u32, u32, u32)>,
    /// Triangles of which it is to be counted what they cover.
    uncounted: Vec<u32>,
    /// Triangles that were not found to cover a pixel, with patches whose centroids are seen, and these patches.
    tiny: Vec<TinyWhole>,
    tiny_patches: Vec<u32>,
    /// All patches that are seen and have no pixel, in ascending order.
    found: Vec<u32>,
}

/// A triangle that was not found to cover a pixel, of which something is seen.
#[derive(Clone, Debug)]
struct TinyWhole {
    id: u32,
    /// Its patches that are seen, in a list of all such patches.
    patches: Range<usize>,
    /// True if it is proved to cover no pixel.
    proved: bool,
}

impl Parts {
    fn new(shared: &Shared) -> Self {
        let (noted, resolution) = match &shared.wholes {
            Some(wholes) => {
                let noted = Noted::new(shared.tree.patch_count as usize + 1, wholes.ids_of_cut());
                (noted, shared.settings.resolution)
            }
            None => (Noted::default(), 0),
        };
        Self {
            recorded: Vec::new(),
            noted,
            open: Coverage::full(resolution),
            ids: Vec::new(),
            uncounted: Vec::new(),
            tiny: Vec::new(),
            tiny_patches: Vec::new(),
            found: Vec::new(),
        }
    }
}

/// An entry of the row being made.
#[derive(Clone, Copy, Debug)]
struct Listed {
    patch: u32,
    visible: u32,
    covered: u32,
    /// True if it has no pixel, and is to be left out if it turns out to cover one.
    tiny: bool,
}

/// What is waiting to be drawn or taken apart, nearest last.
#[derive(Clone, Copy, Debug)]
struct Pending {
    what: What,
    /// Faces that it may be seen on.
    faces: u8,
    /// Faces on which it was found hidden: what it covers there is not known.
    hidden: u8,
}

#[derive(Clone, Copy, Debug)]
enum What {
    /// A node of the partition.
    Node(u32),
    /// A tree of boxes over blocks.
    Layer(u32),
}

/// A block or a node of a layer that may be seen.
#[derive(Clone, Copy, Debug)]
struct InLayer {
    index: u32,
    faces: u8,
    hidden: u8,
}

/// Marks a covered weight that is not all of it.
const INCOMPLETE: u32 = 1 << 31;

impl<K: Kernel> OrderedEngine<K> {
    pub(crate) fn new(shared: &Shared) -> Self {
        let coverage =
            Coverage::new(shared.settings.resolution, shared.settings.culling == Culling::On).weighing(&shared.table);
        Self {
            coverage: if shared.wholes.is_some() {
                coverage.recording(shared.settings.covered)
            } else {
                coverage
            },
            sums: Sums::new(shared.tree.patch_count as usize + 1),
            triangles: Box::new(Transformed::new()),
            whole: Box::new(Transformed::new()),
            pending: Vec::new(),
            layer_nodes: Vec::new(),
            layer_blocks: Vec::new(),
            open: Vec::new(),
            on_faces: OnFaces::new(),
            tiny: PatchSet::new(shared.tree.patch_count as usize),
            perhaps_tiny: PatchSet::new(shared.tree.patch_count as usize),
            tiny_patches: [Vec::new(), Vec::new()],
            row: Vec::new(),
            uncounted: Vec::new(),
            patches: Vec::new(),
            alone: Alone::new(),
            parts: Parts::new(shared),
            sharing: Sharing::new(shared),
            counters: Counters::default(),
            kernel: PhantomData,
        }
    }

    pub(crate) fn rows(
        &mut self,
        shared: &Shared,
        order: &Order,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
    ) -> Counters {
        self.counters = Counters::default();
        for hemicube in hemicubes {
            if shared.settings.covered {
                self.row::<true>(shared, order, hemicube, out);
            } else {
                self.row::<false>(shared, order, hemicube, out);
            }
        }
        self.counters
    }

    fn row<const COVERED: bool>(&mut self, shared: &Shared, order: &Order, hemicube: &Hemicube, out: &mut RowBlock) {
        let tree = &shared.tree;
        let frame = frame(shared, hemicube);
        self.coverage.clear();
        self.render::<COVERED>(shared, order, &frame);
        let table = &shared.table;
        let escaped = self
            .coverage
            .open_weight(table.running(Face::Top), table.running(Face::PosX));
        let mut blocked = 0;
        if let Some(wholes) = &shared.wholes {
            self.row_of_wholes::<COVERED>(shared, order, wholes, &frame, escaped, out);
            return;
        }
        if !COVERED {
            self.sums.drain(|id, _, weight| {
                if id < tree.patch_count {
                    out.push(InputPatch(id), weight, 0);
                } else {
                    blocked = weight;
                }
            });
            out.end_row(escaped, blocked);
            return;
        }
        let [tiny, perhaps_tiny] = &mut self.tiny_patches;
        for (set, patches) in [
            (&mut self.tiny, &mut *tiny),
            (&mut self.perhaps_tiny, &mut *perhaps_tiny),
        ] {
            patches.clear();
            set.drain(|patch| patches.push(patch));
        }
        self.row.clear();
        self.uncounted.clear();
        let (row, uncounted) = (&mut self.row, &mut self.uncounted);
        let mut tiny = merged(tiny, perhaps_tiny).peekable();
        let mut push_tiny = |patch: u32, unproved: bool, row: &mut Vec<Listed>| {
            if unproved {
                #[allow(clippy::cast_possible_truncation, reason = "fewer entries than patches")]
                uncounted.push(row.len() as u32);
            }
            row.push(Listed {
                patch,
                visible: 0,
                covered: 0,
                tiny: true,
            });
        };
        self.sums.drain(|patch, covered, visible| {
            while let Some((t, unproved)) = tiny.next_if(|&(t, _)| t <= patch) {
                if t < patch {
                    push_tiny(t, unproved, row);
                }
            }
            if patch == tree.patch_count {
                blocked = visible;
                return;
            }
            row.push(Listed {
                patch,
                visible,
                covered,
                tiny: false,
            });
        });
        for (t, unproved) in tiny {
            push_tiny(t, unproved, row);
        }
        let is_cut = |patch: u32| order.is_cut[patch as usize / 64] >> (patch % 64) & 1 != 0;
        for (place, entry) in row.iter().enumerate() {
            if !entry.tiny && (entry.covered & INCOMPLETE != 0 || is_cut(entry.patch)) {
                #[allow(clippy::cast_possible_truncation, reason = "fewer entries than patches")]
                uncounted.push(place as u32);
            }
        }
        self.patches.clear();
        self.patches
            .extend(self.uncounted.iter().map(|&place| self.row[place as usize].patch));
        let counts = self.alone.count(shared, &frame, &self.patches);
        for (&place, &(pixels, weight)) in self.uncounted.iter().zip(counts) {
            let entry = &mut self.row[place as usize];
            // Of a tiny one, only whether it covers a pixel. Pieces of a cut patch may show more than it covers whole,
            // where the eye lies in its plane but for rounding: what shows of a patch, it covers.
            entry.covered = if entry.tiny { pixels } else { weight.max(entry.visible) };
        }
        for entry in &self.row {
            if !(entry.tiny && entry.covered != 0) {
                out.push(InputPatch(entry.patch), entry.visible, entry.covered);
            }
        }
        out.end_row(escaped, blocked);
    }

    /// The row of what was rendered, where triangles that were cut were drawn as they were before.
    fn row_of_wholes<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        order: &Order,
        wholes: &Wholes,
        frame: &Frame,
        escaped: u32,
        out: &mut RowBlock,
    ) {
        let patch_count = shared.tree.patch_count;
        let parts = &mut self.parts;
        let mut blocked = 0;
        parts.ids.clear();
        self.sums.drain(|id, covered, visible| {
            if id < patch_count {
                parts.ids.push((id, covered, visible));
            } else {
                blocked = visible;
            }
        });
        let is_cut = |id: u32| order.is_cut[id as usize / 64] >> (id % 64) & 1 != 0;
        let is_known = |id: u32, covered: u32| covered & INCOMPLETE == 0 && !is_cut(id);
        let of_cut = |id: u32| parts.noted.is_noted(id);
        parts.uncounted.clear();
        let unknown = parts
            .ids
            .iter()
            .filter(|&&(id, covered, _)| COVERED && !is_known(id, covered) && of_cut(id));
        parts.uncounted.extend(unknown.map(|&(id, ..)| id));
        let mut counted = self.alone.count_drawn(shared, frame, &parts.uncounted).iter();
        let record = self.coverage.record.as_ref().expect("made so, with wholes");
        for &(id, covered, visible) in &parts.ids {
            let known = COVERED && is_known(id, covered);
            if !parts.noted.is_noted(id) {
                self.sharing
                    .entries
                    .push(Entry::new(id, visible, if known { covered } else { UNCOUNTED }));
                continue;
            }
            let covered = if known || !COVERED {
                covered
            } else {
                counted.next().map_or(0, |count| count.1)
            };
            let whole = wholes.get(wholes.cut(id).expect("noted"));
            let recorded = || parts.noted.of(id).map(|place| &parts.recorded[place]);
            let seen = SeenWhole {
                whole,
                id,
                faces: if COVERED {
                    whole.faces(frame)
                } else {
                    recorded().fold(0, |faces, of| faces | 1 << of.face as u8)
                },
                weight: visible,
            };
            // Where it weighs nothing, as may be at the horizon, that all of it is seen is not known.
            if shared.fractions && covered == visible && visible != 0 {
                self.sharing.list_all(wholes, frame, &seen);
            } else {
                recorded().for_each(|of| record.uncover(of, &mut self.sharing.open));
                let (open, tiny) = (&mut parts.open, &mut self.tiny);
                let mut is_open = false;
                let stays_open = self
                    .sharing
                    .share::<COVERED>(shared, wholes, frame, &seen, |t, lanes, hidden| {
                        if !is_open {
                            is_open = true;
                            recorded().for_each(|of| record.uncover_open(of, open));
                        }
                        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was
                        // made.
                        let centered = unsafe { K::open_centroids(t, lanes, seen.faces, open, false) };
                        let without = without_pixels::<K>(shared, t, centered, hidden, seen.faces);
                        patches_of(t, without).for_each(|patch| tiny.insert(patch));
                    });
                if stays_open {
                    recorded().for_each(|of| record.cover(of, &mut self.sharing.open));
                }
                if is_open {
                    recorded().for_each(|of| record.cover_open(of, open));
                }
            }
            parts.noted.forget(id);
        }
        self.parts.recorded.clear();
        self.parts.noted.clear();
        if let Some(record) = &mut self.coverage.record {
            record.clear();
        }
        if COVERED {
            self.find_tiny(shared, frame);
        }
        self.counters.triangles_transformed += self.sharing.take_transformed();
        self.sharing
            .end_row::<COVERED>(shared, frame, &self.parts.found, (escaped, blocked), out);
    }

    /// Finds the other patches that are seen and have no pixel: those that are not part of anything, and those of
    /// triangles that have none either.
    fn find_tiny(&mut self, shared: &Shared, frame: &Frame) {
        let Parts {
            ids,
            uncounted,
            tiny,
            tiny_patches,
            found,
            ..
        } = &mut self.parts;
        uncounted.clear();
        self.perhaps_tiny.drain(|patch| uncounted.push(patch));
        let counts = self.alone.count(shared, frame, uncounted);
        let without = uncounted.iter().zip(counts).filter(|(_, (pixels, _))| *pixels == 0);
        without.for_each(|(&patch, _)| self.tiny.insert(patch));

        tiny.sort_unstable_by_key(|whole| (whole.id, whole.proved));
        uncounted.clear();
        for whole in tiny.iter() {
            if !whole.proved && uncounted.last() != Some(&whole.id) {
                uncounted.push(whole.id);
            }
        }
        let counts = self.alone.count_drawn(shared, frame, uncounted);
        let mut with_pixels = uncounted
            .iter()
            .zip(counts)
            .filter(|(_, (pixels, _))| *pixels != 0)
            .peekable();
        for whole in tiny.drain(..) {
            while with_pixels.next_if(|(id, _)| **id < whole.id).is_some() {}
            let has_pixels = with_pixels.peek().is_some_and(|(id, _)| **id == whole.id)
                || ids.binary_search_by_key(&whole.id, |&(id, ..)| id).is_ok();
            if !has_pixels {
                tiny_patches[whole.patches]
                    .iter()
                    .for_each(|&patch| self.tiny.insert(patch));
            }
        }
        tiny_patches.clear();
        found.clear();
        self.tiny.drain(|patch| found.push(patch));
    }

    /// Those of these lanes of the block that are triangles that were cut.
    fn cut_lanes(&self, mut lanes: u16) -> u16 {
        let mut cut = 0;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            cut |= u16::from(self.parts.noted.is_noted(self.triangles.seen[lane])) << lane;
        }
        cut
    }

    /// Notes what a block showed of triangles that were cut.
    fn note_shown(&mut self) {
        let parts = &mut self.parts;
        if let Some(record) = &mut self.coverage.record {
            for (lane, recorded) in record.lanes.drain(..) {
                let id = self.triangles.seen[lane];
                if parts.noted.is_noted(id) {
                    parts.noted.add(id);
                    parts.recorded.push(recorded);
                }
            }
        }
    }

    /// Notes patches without a pixel of triangles without one that a block drew.
    fn note_tiny_parts(
        &mut self,
        shared: &Shared,
        wholes: &Wholes,
        frame: &Frame,
        (faces, hidden): (u8, u8),
        shown: &Shown,
        is_cut: bool,
    ) {
        let mut without = self.cut_lanes(shown.without);
        if without != 0 {
            // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
            without = unsafe { K::may_touch_open(&self.triangles, without, faces, &self.coverage) };
            if !is_cut {
                // Most of those that were left out cover pixels: what is in front of them is close.
                without = without_pixels::<K>(shared, &self.triangles, without, shown.hidden, faces);
            }
        }
        while without != 0 {
            let lane = without.trailing_zeros() as usize;
            without &= without - 1;
            let id = self.triangles.seen[lane];
            let whole = wholes.get(wholes.cut(id).expect("noted"));
            let first = self.parts.tiny_patches.len();
            for block in 0..wholes.block_count(whole) {
                self.sharing.transform(wholes, frame, whole, id, block);
                let t = &*self.sharing.triangles;
                // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
                let mut seen = unsafe { K::open_centroids(t, t.live, faces, &self.coverage, true) };
                if is_cut {
                    seen &= centroids_in(t, seen, corners(&self.triangles, lane));
                }
                self.parts.tiny_patches.extend(patches_of(t, seen));
            }
            let patches = first..self.parts.tiny_patches.len();
            if !patches.is_empty() {
                let proved = hidden == 0 && !is_cut && shown.hidden >> lane & 1 == 0;
                self.parts.tiny.push(TinyWhole { id, patches, proved });
            }
        }
    }

    /// Draws the scene into the coverage, which is clear, and adds up what is seen.
    fn render<const COVERED: bool>(&mut self, shared: &Shared, order: &Order, frame: &Frame) {
        self.counters.hemicubes += 1;
        if order.nodes.is_empty() {
            return;
        }
        let eye = DVec3::from_array(frame.origin);
        self.pending.clear();
        self.pending.push(Pending {
            what: What::Node(0),
            faces: ALL_FACES,
            hidden: 0,
        });
        while let Some(Pending { what, faces, hidden }) = self.pending.pop() {
            let node = match what {
                What::Layer(root) => {
                    self.draw_layer::<COVERED>(
                        shared,
                        order,
                        InLayer {
                            index: root,
                            faces,
                            hidden,
                        },
                        frame,
                    );
                    continue;
                }
                What::Node(node) => &order.nodes[node as usize],
            };
            let (faces, hidden) = if self.coverage.culling {
                self.counters.nodes_tested += 1;
                let (visible, hidden_now) = self.visible_faces::<COVERED>(node.center, node.half, frame, faces);
                if !self.is_worth_it(visible, hidden_now) {
                    continue;
                }
                (visible, hidden | hidden_now)
            } else {
                (faces, hidden)
            };
            if node.is_leaf {
                if COVERED && shared.wholes.is_some() {
                    self.remember_faces(faces);
                }
                self.draw_leaf::<COVERED>(shared, order, node, frame, faces, hidden);
                continue;
            }
            let in_front = node.normal.dot(eye) >= node.distance;
            let (near, far, here) = if in_front {
                (node.front, node.back, node.here[0])
            } else {
                (node.back, node.front, node.here[1])
            };
            if far != NONE {
                prefetch(&order.nodes[far as usize]);
                self.pending.push(Pending {
                    what: What::Node(far),
                    faces,
                    hidden,
                });
            }
            for layer in (here.start..here.end).rev() {
                prefetch(&order.layer_nodes[order.layers[layer as usize] as usize]);
                self.pending.push(Pending {
                    what: What::Layer(order.layers[layer as usize]),
                    faces,
                    hidden,
                });
            }
            if near != NONE {
                prefetch(&order.nodes[near as usize]);
                self.pending.push(Pending {
                    what: What::Node(near),
                    faces,
                    hidden,
                });
            }
        }
    }

    /// Counts a box that was tested; whether it may be seen.
    #[inline]
    fn is_worth_it(&mut self, visible: u8, hidden: u8) -> bool {
        if visible == 0 {
            if hidden == 0 {
                self.counters.nodes_outside += 1;
            } else {
                self.counters.nodes_hidden += 1;
            }
        }
        visible != 0
    }

    /// Draws what lies in a plane. Its surfaces hide nothing of each other, so that all of them are tested before any
    /// is drawn.
    fn draw_layer<const COVERED: bool>(&mut self, shared: &Shared, order: &Order, root: InLayer, frame: &Frame) {
        let (mut nodes, mut blocks) = (
            std::mem::take(&mut self.layer_nodes),
            std::mem::take(&mut self.layer_blocks),
        );
        self.coverage.begin_plane();
        if COVERED && !self.coverage.culling {
            self.coverage.remember_all();
        }
        nodes.push(root);
        while let Some(InLayer { index, faces, hidden }) = nodes.pop() {
            let node = &order.layer_nodes[index as usize];
            let tested = if self.coverage.culling {
                self.counters.nodes_tested += u64::from(node.used.count_ones());
                let coverage = &mut self.coverage;
                // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
                unsafe { K::test_group::<COVERED>(&node.boxes, node.used, frame, coverage, faces) }
            } else {
                GroupOnFaces {
                    visible: [faces; BOXES],
                    hidden: [0; BOXES],
                }
            };
            let mut used = node.used;
            while used != 0 {
                let l = used.trailing_zeros() as usize;
                used &= used - 1;
                if self.is_worth_it(tested.visible[l], tested.hidden[l]) {
                    let list = if node.boxes.leaves >> l & 1 != 0 {
                        prefetch(&order.blocks[node.child[l] as usize]);
                        &mut blocks
                    } else {
                        &mut nodes
                    };
                    list.push(InLayer {
                        index: node.child[l],
                        faces: tested.visible[l],
                        hidden: hidden | tested.hidden[l],
                    });
                }
            }
        }
        if COVERED && !self.coverage.remembers {
            self.draw_asked(shared, order, &blocks, frame);
            blocks.clear();
        }
        for InLayer { index, faces, hidden } in blocks.drain(..) {
            self.draw_block::<COVERED>(shared, order, index, frame, faces, hidden, Turns::Together);
        }
        (self.layer_nodes, self.layer_blocks) = (nodes, blocks);
    }

    /// Draws blocks of a plane with covered weights, when it was asked of all of them whether their centroids are open.
    fn draw_asked(&mut self, shared: &Shared, order: &Order, blocks: &[InLayer], frame: &Frame) {
        let mut open = std::mem::take(&mut self.open);
        for block in blocks {
            self.transform(order, block.index, frame);
            let (t, coverage) = (&*self.triangles, &self.coverage);
            // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
            open.push(unsafe { K::open_centroids(t, t.live, block.faces, coverage, false) });
        }
        for (&InLayer { index, faces, hidden }, &open) in blocks.iter().zip(&open) {
            self.draw_block::<true>(shared, order, index, frame, faces, hidden, Turns::Asked(open));
        }
        open.clear();
        self.open = open;
    }

    /// Brings a block into a frame; returns what its pieces were cut from, if they were.
    #[inline(always)]
    fn transform<'a>(&mut self, order: &'a Order, index: u32, frame: &'a Frame) -> Option<Cut<'a>> {
        let index = index as usize;
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe { K::transform(&order.blocks[index], frame, &mut self.triangles) };
        let lines = order.lines_of_block[index];
        let cut = (lines != NONE).then(|| Cut {
            lines: &order.lines[lines as usize],
            frame,
        });
        if let Some(cut) = &cut {
            // What is seen of a piece, and whether, is the whole surface's.
            // SAFETY: as above.
            unsafe { K::transform(&cut.lines.whole, frame, &mut self.whole) };
            let (t, whole) = (&mut *self.triangles, &*self.whole);
            (t.sign, t.seen, t.live) = (whole.sign, whole.seen, whole.live);
        }
        cut
    }

    /// On which faces a box may be seen, and on which of the others it is hidden.
    #[inline]
    fn visible_faces<const COVERED: bool>(&mut self, center: DVec3, half: DVec3, frame: &Frame, faces: u8) -> (u8, u8) {
        let resolution = self.coverage.resolution;
        let (center, half) = (center.to_array(), half.to_array());
        // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
        unsafe { K::on_faces(&center, &half, frame, resolution, faces, COVERED, &mut self.on_faces) };
        let (mut visible, mut hidden) = (self.on_faces.at_eye, 0);
        let mut boxed = self.on_faces.boxed;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            let pixels = self.on_faces.in_atlas(face, resolution);
            // SAFETY: as above.
            if unsafe { K::all_covered(&self.coverage, pixels) } {
                hidden |= 1 << face;
                continue;
            }
            visible |= 1 << face;
        }
        (visible, hidden)
    }

    /// Remembers what is covered of a box that was just tested on faces, and may be seen on some.
    fn remember_faces(&mut self, visible: u8) {
        let (coverage, b) = (&mut self.coverage, &self.on_faces);
        coverage.begin_plane();
        if !coverage.culling || b.at_eye != 0 {
            coverage.remember_all();
        }
        let mut boxed = b.boxed & visible;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            coverage.remember(b.in_atlas(face, coverage.resolution));
        }
    }

    /// Draws a leaf's block in the order that its planes give.
    fn draw_leaf<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        order: &Order,
        node: &PlaneNode,
        frame: &Frame,
        faces: u8,
        hidden: u8,
    ) {
        let planes = &order.planes[node.here[0].start as usize..node.here[0].end as usize];
        let block = node.front;
        prefetch(&order.blocks[block as usize]);
        let eye = DVec3::from_array(frame.origin);
        let mut lanes = [0u8; LANES];
        let mut count = 0;
        // A plane is met twice: to be taken apart, and to have its own lanes drawn.
        let mut pending = [(0u8, false); 2 * LEAF_DEPTH];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (index, draw) = pending[depth];
            let plane = &planes[usize::from(index)];
            if draw {
                let start = count;
                let mut here = plane.here;
                while here != 0 {
                    #[allow(clippy::cast_possible_truncation, reason = "below 16")]
                    {
                        lanes[count] = here.trailing_zeros() as u8;
                    }
                    count += 1;
                    here &= here - 1;
                }
                if plane.overlap {
                    let block = &order.blocks[block as usize];
                    lanes[start..count].sort_unstable_by_key(|&l| seen_from(block, usize::from(l), eye));
                }
                continue;
            }
            let in_front = plane.normal.dot(eye) >= plane.distance;
            let (near, far) = if in_front {
                (plane.front, plane.back)
            } else {
                (plane.back, plane.front)
            };
            for next in [(far, false), (index, true), (near, false)] {
                if next.0 != NO_PLANE {
                    pending[depth] = next;
                    depth += 1;
                }
            }
        }
        let turns = Turns::InOrder(&lanes[..count]);
        self.draw_block::<COVERED>(shared, order, block, frame, faces, hidden, turns);
    }

    #[allow(clippy::too_many_arguments, reason = "private: the pieces of one loop")]
    fn draw_block<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        order: &Order,
        index: u32,
        frame: &Frame,
        faces: u8,
        hidden: u8,
        turns: Turns<'_>,
    ) {
        let cut = self.transform(order, index, frame);
        let is_cut = cut.is_some();
        self.counters.triangles_transformed += LANES as u64;
        if self.triangles.live == 0 {
            return;
        }
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        let mut shown = Shown::new();
        // SAFETY: as above.
        unsafe {
            K::draw_bits::<COVERED>(
                &mut self.triangles,
                cut,
                faces,
                turns,
                &mut self.coverage,
                top,
                side,
                &mut shown,
            );
        }
        self.counters.triangles_drawn += u64::from(shown.drawn);
        let incomplete = if hidden == 0 { shown.hidden } else { u16::MAX };
        let mut seen = shown.seen;
        while seen != 0 {
            let lane = seen.trailing_zeros() as usize;
            seen &= seen - 1;
            let id = self.triangles.seen[lane];
            self.sums.add(id, shown.covered[lane], shown.visible[lane]);
            if COVERED && incomplete >> lane & 1 != 0 {
                self.sums.mark(id, INCOMPLETE);
            }
        }
        self.note_shown();
        if COVERED {
            let unproved = if is_cut { u16::MAX } else { incomplete };
            let mut tiny = shown.tiny;
            if let Some(wholes) = &shared.wholes {
                self.note_tiny_parts(shared, wholes, frame, (faces, hidden), &shown, is_cut);
                tiny &= !self.cut_lanes(tiny);
            }
            while tiny != 0 {
                let lane = tiny.trailing_zeros() as usize;
                tiny &= tiny - 1;
                let patch = self.triangles.seen[lane];
                if patch < shared.tree.patch_count {
                    if unproved >> lane & 1 != 0 {
                        self.perhaps_tiny.insert(patch);
                    } else {
                        self.tiny.insert(patch);
                    }
                }
            }
        }
    }
}

/// The corners of a lane, in a hemicube's frame.
fn corners(t: &Transformed, lane: usize) -> [DVec3; 3] {
    [0, 1, 2].map(|k| DVec3::from_array([0, 1, 2].map(|c| t.corners[3 * k + c][lane])))
}

/// Those of these lanes, in the plane of a piece, whose centroids lie in it: the others are in pieces that are drawn at
/// other times.
///
/// Found in the plane and not as the eye sees it, which may be edge-on.
fn centroids_in(t: &Transformed, mut lanes: u16, piece: [DVec3; 3]) -> u16 {
    // One on a cut, but for rounding, is in both pieces.
    const OFF: f64 = 1e-12;
    let [a, b, c] = piece;
    let (low, high) = (a.min(b).min(c) - OFF, a.max(b).max(c) + OFF);
    let mut within = 0;
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        let [p, q, r] = corners(t, lane);
        let centroid = (p + q + r) / 3.0;
        // A piece may be too thin to have a normal.
        let normal = (q - p).cross(r - p).normalize_or_zero();
        let normal = normal * normal.dot((b - a).cross(c - a)).signum();
        let is_beside =
            |(from, to): (DVec3, DVec3)| normal.cross(to - from).dot(centroid - from) >= -OFF * (to - from).length();
        let is_within = centroid.cmpge(low).all()
            && centroid.cmple(high).all()
            && [(a, b), (b, c), (c, a)].into_iter().all(is_beside);
        within |= u16::from(is_within) << lane;
    }
    within
}

/// Two lists in ascending order as one, and whether each patch is in the second alone.
fn merged(first: &[u32], second: &[u32]) -> impl Iterator<Item = (u32, bool)> {
    let (mut first, mut second) = (first.iter().copied().peekable(), second.iter().copied().peekable());
    std::iter::from_fn(move || match (first.peek().copied(), second.peek().copied()) {
        (Some(a), b) if b.is_none_or(|b| a <= b) => {
            first.next();
            second.next_if_eq(&a);
            Some((a, false))
        }
        (_, b) => {
            second.next();
            b.map(|b| (b, true))
        }
    })
}

/// The deepest that a leaf's planes can be stacked.
const LEAF_DEPTH: usize = 48;

/// The id that an eye sees of a lane.
fn seen_from(block: &Block, lane: usize, eye: DVec3) -> u32 {
    let [a, b, c] = block.triangle(lane).map(|p| p - eye);
    if a.dot(b.cross(c)) < 0.0 {
        block.negative[lane]
    } else {
        block.positive[lane]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Portable;

    /// Sixteen patches of a triangle, seen from the origin, and the two pieces that a cut through its middle leaves.
    #[test]
    fn centroids_are_in_the_piece_that_they_lie_in_also_where_it_is_seen_edge_on() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX);
        // From afar above its plane, and in it.
        for depth in [0.0, 0.5] {
            let at = |x: f64, z: f64| DVec3::new(x, depth, z);
            let [a, b, c] = [at(1.0, 0.1), at(2.0, 0.1), at(1.0, 1.1)];
            let middle = at(1.5, 0.6);
            let mut block = Block::empty();
            let mut lane = 0;
            let corner = |i: usize, j: usize| a + (b - a) * (i as f64 / 4.0) + (c - a) * (j as f64 / 4.0);
            for j in 0..4 {
                for i in 0..4 - j {
                    let mut push = |patch: [DVec3; 3]| {
                        for (k, p) in patch.into_iter().enumerate() {
                            for x in 0..3 {
                                block.corners[3 * k + x][lane] = p[x];
                            }
                        }
                        lane += 1;
                    };
                    push([corner(i, j), corner(i + 1, j), corner(i, j + 1)]);
                    if i + j < 3 {
                        push([corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]);
                    }
                }
            }
            assert_eq!(lane, LANES);
            let mut t = Transformed::new();
            // SAFETY: any machine has the portable path.
            unsafe { Portable::transform(&block, &frame, &mut t) };
            let first = centroids_in(&t, u16::MAX, [a, b, middle]);
            let second = centroids_in(&t, u16::MAX, [middle, c, a]);
            assert_eq!(first | second, u16::MAX, "depth {depth}");
            // The cut runs along the middles of patches on it: those may be in both.
            for lane in 0..LANES {
                let centroid = corners(&t, lane).into_iter().sum::<DVec3>() / 3.0;
                let beside = (centroid.x - a.x) - (centroid.z - a.z);
                if beside.abs() > 1e-9 {
                    assert_eq!(first >> lane & 1 != 0, beside > 0.0, "depth {depth}, lane {lane}");
                    assert_eq!(second >> lane & 1 != 0, beside < 0.0, "depth {depth}, lane {lane}");
                }
            }
            let nothing = centroids_in(&t, u16::MAX, [a, a, a]);
            assert_eq!(nothing, 0, "depth {depth}");
        }
    }
}
