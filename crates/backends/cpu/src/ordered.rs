//! One session of engine 2: the walk over the order, nearest first, and the row straight from what was drawn.

use crate::Shared;
use crate::alone::Alone;
use crate::engine::{ALL_FACES, frame, pixel};
use crate::kernel::{
    BOXES, Coverage, Cut, Frame, GroupOnFaces, Kernel, OnFaces, PatchSet, Shown, Sums, Transformed, Turns, prefetch,
};
use crate::order::{NO_PLANE, NONE, Order, PlaneNode};
use glam::DVec3;
use hemicube::InputPatch;
use hemicube::backend::{Counters, Culling, Hemicube};
use hemicube::face::Face;
use hemicube::row::RowBlock;
use hemicube::tree::{Block, LANES};
use std::marker::PhantomData;

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
    row: Vec<Entry>,
    /// Places in `row` whose covered weight is to be counted.
    uncounted: Vec<u32>,
    /// Their patches.
    patches: Vec<u32>,
    alone: Alone<K>,
    counters: Counters,
    kernel: PhantomData<K>,
}

/// An entry of the row being made.
#[derive(Clone, Copy, Debug)]
struct Entry {
    patch: u32,
    visible: u32,
    covered: u32,
    /// Whether it has no pixel, and is to be left out if it turns out to cover one.
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
        Self {
            coverage: Coverage::new(shared.settings.resolution, shared.settings.culling == Culling::On),
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
        let mut push_tiny = |patch: u32, unproved: bool, row: &mut Vec<Entry>| {
            if unproved {
                #[allow(clippy::cast_possible_truncation, reason = "fewer entries than patches")]
                uncounted.push(row.len() as u32);
            }
            row.push(Entry {
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
            row.push(Entry {
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
            // Of a tiny one, only whether it covers a pixel. Pieces of a cut patch may show more than it covers whole, where the eye
            // lies in its plane but for rounding: what shows of a patch, it covers.
            entry.covered = if entry.tiny { pixels } else { weight.max(entry.visible) };
        }
        for entry in &self.row {
            if !(entry.tiny && entry.covered != 0) {
                out.push(InputPatch(entry.patch), entry.visible, entry.covered);
            }
        }
        out.end_row(escaped, blocked);
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

    /// Draws what lies in a plane. Its surfaces hide nothing of each other, so that all of them are tested before any is drawn.
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
            // SAFETY: `Isa::available` checked the machine for K's instruction set before this engine was made.
            open.push(unsafe { K::open_centroids(&self.triangles, block.faces, &self.coverage) });
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
            #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
            let first_row = Face::ALL[face].first_row(resolution as u32) as usize;
            let b = &self.on_faces;
            let [x0, x1, y0, y1] = [b.x0[face], b.x1[face], b.y0[face], b.y1[face]].map(pixel);
            let pixels = [x0, x1, first_row + y0, first_row + y1];
            // SAFETY: as above.
            if unsafe { K::all_covered(&self.coverage, pixels) } {
                hidden |= 1 << face;
                continue;
            }
            visible |= 1 << face;
        }
        (visible, hidden)
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
        if COVERED {
            let mut tiny = shown.tiny;
            while tiny != 0 {
                let lane = tiny.trailing_zeros() as usize;
                tiny &= tiny - 1;
                let patch = self.triangles.seen[lane];
                if patch < shared.tree.patch_count {
                    let unproved = hidden != 0 || is_cut || shown.hidden >> lane & 1 != 0;
                    if unproved {
                        self.perhaps_tiny.insert(patch);
                    } else {
                        self.tiny.insert(patch);
                    }
                }
            }
        }
    }
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
