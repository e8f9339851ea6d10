//! One session of engine 1 or engine 3: the walk over the tree, then the reduction of the row. The two differ in what they draw
//! into.

use crate::Shared;
use crate::alone::Alone;
use crate::buffer::Buffer;
use crate::kernel::{Centroids, Chunk, Frame, Kernel, OnFaces, Sums, Target, Transformed, prefetch, three};
use glam::DVec3;
use hemicube::InputPatch;
use hemicube::backend::{Counters, Culling, Hemicube, WHOLE};
use hemicube::face::{Face, Items};
use hemicube::row::RowBlock;
use hemicube::tree::{Block, INNER, LANES, Node, Tree, UNUSED};
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
    on_faces: OnFaces,
    centroids: Box<Centroids>,
    tiny: Vec<u32>,
    row: Vec<(u32, u32, u32)>,
    /// Patches of which it is to be counted what they cover alone.
    uncounted: Vec<u32>,
    alone: Alone<K>,
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

/// A patch that was drawn and covered no pixel centre.
#[derive(Clone, Copy, Debug)]
struct TinyCandidate {
    patch: u32,
    block: u32,
    lane: u8,
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
            on_faces: OnFaces::new(),
            centroids: Box::new(Centroids::new()),
            tiny: Vec::new(),
            row: Vec::new(),
            uncounted: Vec::new(),
            alone: Alone::new(),
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
        let frame = frame(tree, hemicube);
        let drawn_before = self.counters.triangles_drawn;
        self.render::<COVERED>(shared, &frame);
        if COVERED {
            self.find_tiny(shared, &frame);
        }
        if self.counters.triangles_drawn == drawn_before && self.tiny.is_empty() {
            // Nothing is in view, and the target is as clear as it was.
            out.end_row(WHOLE, 0);
            return;
        }
        self.buffer.reduce::<K>(shared, &mut self.sums);

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
            let slot = tree.slot_of_patch[id as usize] as usize;
            let (block, lane) = (slot / LANES, slot % LANES);
            let drawn = &self.drawn[block];
            let known = drawn.incomplete >> lane & 1 == 0 && drawn.hemicube == self.hemicube;
            if !(known && drawn.pixels[lane] == pixels) {
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
            let (faces, hidden_now) = self.visible_faces::<COVERED>(shared, node, frame, faces);
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
        if live != 0 {
            for face in Face::ALL {
                if faces >> face as u8 & 1 == 0 {
                    continue;
                }
                let drawn = self
                    .buffer
                    .draw::<K, COVERED>(shared, &self.triangles, face, live, &mut pixels);
                self.counters.triangles_drawn += u64::from(drawn.triangles);
                incomplete |= drawn.hidden;
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
            if candidates != 0 {
                self.list_tiny(shared, frame, block, candidates);
            }
        }
    }

    /// Lists patches of a block that covered no pixel centre, but for those whose centroid is behind what was drawn already.
    fn list_tiny(&mut self, shared: &Shared, frame: &Frame, block: usize, candidates: u16) {
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
            #[allow(
                clippy::cast_possible_truncation,
                reason = "blocks are fewer than ids; lanes are below 16"
            )]
            self.tiny_candidates.push(TinyCandidate {
                patch: self.triangles.seen[lane],
                block: block as u32,
                lane: lane as u8,
                row,
                column,
                depth,
                direction: three(|c| centroids.direction[c][lane]),
            });
        }
    }

    /// On which faces a node may be seen, and on which of the others it is hidden.
    #[inline]
    fn visible_faces<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        node: &Node,
        frame: &Frame,
        faces: u8,
    ) -> (u8, u8) {
        let (center, half) = (node.center.to_array(), node.half.to_array());
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
            let b = &self.on_faces;
            let pixels = [b.x0[face], b.x1[face], b.y0[face], b.y1[face]].map(pixel);
            if self.is_hidden::<COVERED>(shared, Face::ALL[face], pixels, b.near[face]) {
                hidden |= 1 << face;
            } else {
                visible |= 1 << face;
            }
        }
        (visible, hidden)
    }

    /// Whether all of a rectangle of pixels (inclusive) is nearer than `nearest`, in 1/w.
    #[inline]
    fn is_hidden<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        face: Face,
        [x0, x1, y0, y1]: [usize; 4],
        nearest: f64,
    ) -> bool {
        // Depths are within rounding of the corners' 1/w, widened by a millionth. With tiny patches, what is about as near
        // as the pixels in front of it may be seen.
        let slack = if COVERED { 1.0 + tiny_slack(shared) } else { 1.0 };
        #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
        let bound = (nearest * slack * (1.0 + 4e-6)) as f32;
        let first_row = face.first_row(shared.settings.resolution) as usize;
        let pixels = [x0, x1, first_row + y0, first_row + y1];
        self.buffer.is_hidden::<K>(face, pixels, bound)
    }

    /// Among the patches that were drawn and covered no pixel centre, finds those that are nearest at their centroid.
    ///
    /// "Nearest" means: not behind what is seen at the pixel there. A neighbour in the same surface must not hide it, as it
    /// would if depths at the pixel's centre were compared; but for culling to change nothing, it must also be about as near
    /// as the pixel, for what culling drops is not.
    fn find_tiny(&mut self, shared: &Shared, frame: &Frame) {
        let tree = &shared.tree;
        let mut candidates = std::mem::take(&mut self.tiny_candidates);
        self.uncounted.clear();
        for candidate in &candidates {
            let &TinyCandidate { patch, depth, .. } = candidate;
            let (block, lane) = (candidate.block as usize, usize::from(candidate.lane));
            let (id, seen) = self.buffer.seen_at(candidate.row as usize, candidate.column as usize);
            if depth < about(shared, seen) {
                continue;
            }
            // Where the seen patch reaches the centroid, its depth there decides; where it does not, as beyond a
            // silhouette, being about as near as the pixel does.
            let in_front = id >= tree.patch_count
                || depth_there(tree, id, frame, candidate.direction).is_none_or(|there| depth >= there * (1.0 - 1e-6));
            if !in_front {
                continue;
            }
            // A block that was hidden on one of its faces was not drawn there, so its pixels must be counted.
            if self.drawn[block].incomplete >> lane & 1 != 0 {
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
        let frame = frame(&shared.tree, hemicube);
        self.render::<false>(shared, &frame);
        let patch_count = shared.tree.patch_count;
        let seen = self.buffer.items.iter().flat_map(|chunk| chunk.0).map(|id| match id {
            id if id < patch_count => id,
            id if id == patch_count => Items::BLOCKED,
            _ => Items::ESCAPED,
        });
        let items = Items {
            resolution: shared.settings.resolution,
            seen: seen.collect(),
        };
        self.buffer.items.fill(Chunk([patch_count + 1; LANES]));
        self.buffer.depth.fill(Chunk([0.0; LANES]));
        self.buffer.dirty.fill(false);
        self.buffer.tile_depth.fill(0.0);
        items
    }
}

/// By how much a tiny patch may be behind the depth at its pixel's centre and still be seen: about what depth varies
/// over a few pixels of a surface that is not seen edge-on.
fn tiny_slack(shared: &Shared) -> f64 {
    16.0 / f64::from(shared.settings.resolution)
}

/// The 1/w that a centroid must have at least to be about as near as what is seen at its pixel.
#[inline(always)]
fn about(shared: &Shared, seen: f32) -> f64 {
    f64::from(seen) / (1.0 + tiny_slack(shared))
}

/// A pixel's place: none is negative.
#[inline(always)]
pub(crate) fn pixel(x: i32) -> usize {
    #[allow(clippy::cast_sign_loss, reason = "boxes lie within their face")]
    let place = x as u32;
    place as usize
}

pub(crate) fn frame(tree: &Tree, hemicube: &Hemicube) -> Frame {
    Frame::new(
        hemicube.origin.to_array(),
        hemicube.axes.map(|a| a.to_array()),
        tree.plane_tolerance,
        hemicube.emitter.map_or(UNUSED, |p| p.0),
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
