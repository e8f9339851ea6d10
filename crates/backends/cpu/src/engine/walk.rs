//! Engines `depth` and `claims`: the walk over the tree, then the reduction of the row. They differ in the buffer.

use super::buffer::Buffer;
use super::covered::CoveredCounter;
use super::distribute::{Distributor, Entry, UNCOUNTED, VisibleParent};
use super::{ALL_FACES, Faces, Remainder, View, each_face, frame, ids_of};
use crate::SharedScene;
use crate::kernel::{
    Centroids, Count, Coverage, Frame, LanesOnFace, OnFaces, Pass, SceneBox, Sums, Transformed, Turns, bits, prefetch,
    subpixel_slack, three,
};
use crate::parents::ParentTriangles;
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Counters, Culling, Hemicube, WHOLE};
use hemicube_contract::bvh::{Block, INNER, LANES, Node, Tree};
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::{Face, Items};
use hemicube_contract::row::RowBlock;

/// A session's working memory.
#[derive(Debug)]
pub(crate) struct TreeEngine<B> {
    buffer: B,
    sums: Sums,
    triangles: Box<Transformed>,
    pending: Vec<Pending>,
    /// For each block: the hemicube that drew it last, and the covered pixels of its lanes.
    drawn: Vec<DrawnBlock>,
    hemicube: u32,
    candidates: Vec<Candidate>,
    distributor: Distributor,
    parents_drawn: Vec<DrawnParent>,
    /// For each parent the faces it may be on; 0 if it was not drawn.
    faces_of_parent: Vec<u8>,
    ids: Vec<IdSum>,
    on_faces: OnFaces,
    centroids: Box<Centroids>,
    /// Sub-pixel patches of the row.
    subpixel: Vec<u32>,
    row: Vec<IdSum>,
    /// Patches with a covered weight to be counted.
    uncounted: Vec<u32>,
    counter: CoveredCounter,
    /// The id of blocked pixels: one above all patches.
    blocked: u32,
    counters: Counters,
}

/// Visible pixels and weight of an id.
#[derive(Clone, Copy, Debug)]
struct IdSum {
    id: u32,
    pixels: u32,
    weight: u32,
}

/// A node waiting to be tested.
#[derive(Clone, Copy, Debug)]
struct Pending {
    node: u32,
    faces: Faces,
}

/// Covered pixels of a block's lanes in the hemicube that drew it last.
#[derive(Clone, Copy, Debug)]
struct DrawnBlock {
    hemicube: u32,
    /// Lanes left out on some face as hidden: their `pixels` are not all.
    incomplete: u16,
    pixels: [u32; LANES],
}

/// A drawn parent triangle that may be visible, if only between pixel centres.
#[derive(Clone, Copy, Debug)]
struct DrawnParent {
    parent: u32,
    id: u32,
    /// Faces that may have pixels of it.
    faces: u8,
    pixels: Pixels,
}

/// True if a triangle covers the centre of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixels {
    /// It does, or is too far behind to matter.
    Some,
    None,
    Unknown,
}

/// Results for the lanes of a block on all faces.
#[derive(Clone, Copy, Debug)]
struct DrawnLanes {
    live: u16,
    /// For each face, the lanes that may have pixels there.
    on: [u16; Face::ALL.len()],
    /// Lanes hidden on some face, even if surfaces about as near as the visible ones count as visible.
    behind: u16,
    /// Lanes found without a pixel.
    without: u16,
    /// Lanes left out on some face: they may have pixels there.
    incomplete: u16,
}

/// A drawn patch without a pixel centre, visible if nothing is nearer at its centroid.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    patch: u32,
    /// True if it was left out on some face: a proof that it has no pixel is still needed.
    unproved: bool,
    /// The centroid's pixel in the atlas.
    row: u32,
    column: u32,
    /// The centroid's 1/w, and its direction, scaled to w = 1.
    depth: f64,
    direction: [f64; 3],
}

impl<B: Buffer> TreeEngine<B> {
    pub(crate) fn new(scene: &SharedScene) -> Self {
        let patch_count = scene.tree.patch_count;
        let drawn_blocks = if scene.settings.covered {
            scene.tree.blocks.len()
        } else {
            0
        };
        Self {
            buffer: B::new(scene),
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
            candidates: Vec::new(),
            distributor: Distributor::new(scene),
            parents_drawn: Vec::new(),
            faces_of_parent: vec![0; scene.parents.as_ref().map_or(0, |parents| parents.len())],
            ids: Vec::new(),
            on_faces: OnFaces::new(),
            centroids: Box::new(Centroids::new()),
            subpixel: Vec::new(),
            row: Vec::new(),
            uncounted: Vec::new(),
            counter: CoveredCounter::new(),
            blocked: patch_count,
            counters: Counters::default(),
        }
    }

    pub(crate) fn rows(&mut self, scene: &SharedScene, hemicubes: &[Hemicube], out: &mut RowBlock) -> Counters {
        self.counters = Counters::default();
        for hemicube in hemicubes {
            let frame = &frame(scene, hemicube);
            if scene.settings.covered {
                self.row::<true>(View { scene, frame }, out);
            } else {
                self.row::<false>(View { scene, frame }, out);
            }
        }
        self.counters
    }

    /// The pixels that hit nothing, and the blocked weight.
    pub(crate) fn escaped(&mut self, scene: &SharedScene, hemicube: &Hemicube, out: &mut EscapedPixels) {
        let frame = &frame(scene, hemicube);
        self.render::<false>(View { scene, frame });
        out.clear(scene.settings.resolution);
        self.buffer.write_escaped(out);
        self.buffer.reduce(scene, &mut self.sums);
        let blocked = scene.tree.patch_count;
        let (buffer, parents) = (&mut self.buffer, scene.parents.as_ref());
        self.sums.drain(|id, _, weight| {
            if id == blocked {
                out.blocked = weight;
            } else if id < blocked && parents.is_some_and(|parents| parents.subdivided(id).is_some()) {
                buffer.forget(id);
            }
        });
        self.buffer.clear();
    }

    fn row<const COVERED: bool>(&mut self, view: View<'_>, out: &mut RowBlock) {
        let scene = view.scene;
        let drawn_before = self.counters.triangles_drawn;
        self.render::<COVERED>(view);
        if COVERED && scene.parents.is_none() {
            self.find_subpixel(view);
        }
        let is_clear = self.counters.triangles_drawn == drawn_before;
        if is_clear && self.subpixel.is_empty() && self.candidates.is_empty() && self.parents_drawn.is_empty() {
            // Nothing is in view, and the buffer is still clear.
            out.end_row(WHOLE, 0);
            return;
        }
        self.buffer.reduce(scene, &mut self.sums);
        self.end_row::<COVERED>(view, out);
    }

    /// Makes the row after the reduction.
    fn end_row<const COVERED: bool>(&mut self, view: View<'_>, out: &mut RowBlock) {
        let scene = view.scene;
        if let Some(parents) = &scene.parents {
            self.row_of_parents::<COVERED>(view, parents, out);
            return;
        }
        self.buffer.clear();
        let patch_count = scene.tree.patch_count;
        let mut remainder = Remainder::default();
        if !COVERED {
            self.sums.drain(|id, _, weight| match id {
                id if id < patch_count => out.push(InputPatch(id), weight, 0),
                id if id == patch_count => remainder.blocked = weight,
                _ => remainder.escaped = weight,
            });
            out.end_row(remainder.escaped, remainder.blocked);
            return;
        }
        let row = &mut self.row;
        row.clear();
        self.sums.drain(|id, pixels, weight| match id {
            id if id < patch_count => row.push(IdSum { id, pixels, weight }),
            id if id == patch_count => remainder.blocked = weight,
            _ => remainder.escaped = weight,
        });
        // Count the unknown covered weights. The other patches show everything they cover.
        self.uncounted.clear();
        for of in &self.row {
            if self.known_pixels(&scene.tree, of.id) != Some(of.pixels) {
                self.uncounted.push(of.id);
            }
        }
        let counts = self.counter.count(view, &self.uncounted);
        let mut counted = self.uncounted.iter().zip(counts).peekable();
        let mut subpixel = self.subpixel.iter().copied().peekable();
        for &IdSum { id, weight, .. } in &self.row {
            // A sub-pixel patch has no pixel, so its id is never in the row.
            while let Some(patch) = subpixel.next_if(|&patch| patch < id) {
                out.push(InputPatch(patch), 0, 0);
            }
            let covered = counted
                .next_if(|(patch, _)| **patch == id)
                .map_or(weight, |(_, count)| count.weight);
            out.push(InputPatch(id), weight, covered);
        }
        for patch in subpixel {
            out.push(InputPatch(patch), 0, 0);
        }
        out.end_row(remainder.escaped, remainder.blocked);
    }

    /// Makes the row after the reduction, if parent triangles were drawn.
    fn row_of_parents<const COVERED: bool>(&mut self, view: View<'_>, parents: &ParentTriangles, out: &mut RowBlock) {
        let patch_count = view.scene.tree.patch_count;
        for drawn in &self.parents_drawn {
            self.faces_of_parent[drawn.parent as usize] = drawn.faces;
        }
        let mut ids = std::mem::take(&mut self.ids);
        self.sums
            .drain(|id, pixels, weight| ids.push(IdSum { id, pixels, weight }));
        let mut remainder = Remainder::default();
        for IdSum { id, pixels, weight } in ids.drain(..) {
            if id == patch_count {
                remainder.blocked = weight;
            } else if id > patch_count {
                remainder.escaped = weight;
            } else if let Some(parent) = parents.subdivided(id) {
                let seen = VisibleParent {
                    parents,
                    parent: parents.get(parent),
                    id,
                    faces: self.faces_of_parent[parent as usize],
                    weight,
                };
                if view.scene.fractions && self.shows_all(view, &seen, pixels) {
                    self.distributor.list_all(view, &seen);
                } else {
                    self.distribute::<COVERED>(view, seen);
                }
                self.buffer.forget(id);
            } else {
                // All covered pixels are visible if their numbers agree.
                let is_known = COVERED && self.known_pixels(&view.scene.tree, id) == Some(pixels);
                let covered = if is_known { weight } else { UNCOUNTED };
                self.distributor.entries.push(Entry::new(id, weight, covered));
            }
        }
        if COVERED {
            self.find_subpixel_of_parents(view, parents);
            self.find_subpixel(view);
        }
        self.buffer.clear();
        self.counters.triangles_transformed += self.distributor.take_transformed();
        self.distributor
            .end_row::<COVERED>(view, &self.subpixel, remainder, out);
        self.ids = ids;
    }

    /// Covered pixels of a drawn id, if known.
    fn known_pixels(&self, tree: &Tree, id: u32) -> Option<u32> {
        let slot = tree.slot_of_patch[id as usize] as usize;
        let (drawn, lane) = (&self.drawn[slot / LANES], slot % LANES);
        let is_known = drawn.incomplete >> lane & 1 == 0 && drawn.hemicube == self.hemicube;
        is_known.then_some(drawn.pixels[lane])
    }

    /// Returns true if the visible pixels of a parent are all it covers. Culling must not decide: unknown covered
    /// pixels are counted.
    fn shows_all(&mut self, view: View<'_>, seen: &VisibleParent<'_>, pixels: u32) -> bool {
        let known = self.known_pixels(&view.scene.tree, seen.id);
        known.unwrap_or_else(|| self.covered_pixels(view, seen.id, seen.faces)) == pixels
    }

    /// Distributes the visible weight of a parent over its patches.
    fn distribute<const COVERED: bool>(&mut self, view: View<'_>, mut seen: VisibleParent<'_>) {
        let id = seen.id;
        let mut search = SubpixelSearch {
            view,
            buffer: &self.buffer,
            centroids: &mut self.centroids,
            found: &mut self.subpixel,
        };
        let of_parent = seen;
        let shown_on = self.buffer.uncover(id, &mut self.distributor.uncovered);
        if !COVERED {
            // Covered pixels must be known on all faces, visible ones only where there are any.
            seen.faces = shown_on;
        }
        let stays_uncovered = self.distributor.distribute::<COVERED>(view, &seen, |t, lanes, hidden| {
            search.find(&of_parent, t, lanes, hidden);
        });
        if stays_uncovered {
            self.buffer.cover(id, &mut self.distributor.uncovered);
        }
    }

    /// Lists the lanes of a block that are subdivided parents and may be visible, if only between pixel centres.
    /// Returns all lanes that are subdivided parents.
    fn list_parents(&mut self, parents: &ParentTriangles, block: usize, of: DrawnLanes) -> u16 {
        let lanes = parents.lanes(block);
        for lane in bits(u32::from(of.live & lanes.subdivided)) {
            let id = self.triangles.seen[lane];
            let faces = (0..of.on.len()).fold(0, |faces, face| faces | u8::from(of.on[face] >> lane & 1 != 0) << face);
            // Hidden on the one face that it is on, if that is certain.
            let is_behind = of.behind >> lane & 1 != 0 && faces.is_power_of_two();
            let face = |faces: u8| Face::ALL[faces.trailing_zeros() as usize];
            if id >= self.blocked || is_behind && self.triangles.is_within(face(faces), lane) {
                continue;
            }
            self.parents_drawn.push(DrawnParent {
                parent: lanes.parent[lane],
                id,
                faces,
                pixels: match (of.without >> lane & 1 != 0, of.incomplete >> lane & 1 != 0) {
                    (false, _) => Pixels::Some,
                    (true, false) => Pixels::None,
                    (true, true) => Pixels::Unknown,
                },
            });
        }
        lanes.subdivided
    }

    /// Finds the visible sub-pixel patches of drawn parents without a pixel centre.
    fn find_subpixel_of_parents(&mut self, view: View<'_>, parents: &ParentTriangles) {
        let drawn = std::mem::take(&mut self.parents_drawn);
        for of in &drawn {
            self.faces_of_parent[of.parent as usize] = 0;
            if of.pixels == Pixels::Some {
                continue;
            }
            let seen = VisibleParent {
                parents,
                parent: parents.get(of.parent),
                id: of.id,
                faces: of.faces,
                weight: 0,
            };
            let Faces { visible, .. } = self.faces_of_box::<true>(view, &seen.parent.bounds(), ALL_FACES);
            if visible == 0 || of.pixels == Pixels::Unknown && self.covered_pixels(view, of.id, of.faces) != 0 {
                continue;
            }
            let mut search = SubpixelSearch {
                view,
                buffer: &self.buffer,
                centroids: &mut self.centroids,
                found: &mut self.subpixel,
            };
            for block in 0..parents.block_count(seen.parent) {
                self.distributor.transform(view, &seen, block);
                let t = &*self.distributor.triangles;
                if t.live != 0 {
                    search.find(&seen, t, t.live, 0);
                }
            }
        }
        self.parents_drawn = drawn;
    }

    /// Counts the pixels of some faces that a drawn id covers.
    fn covered_pixels(&mut self, view: View<'_>, id: u32, faces: u8) -> u32 {
        let scene = view.scene;
        let slot = scene.tree.slot_of_patch[id as usize] as usize;
        let (block, lane) = (&scene.tree.blocks[slot / LANES], slot % LANES);
        let mut counts = [Count::default(); LANES];
        scene.isa.transform(block, view.frame, &mut self.triangles);
        scene
            .isa
            .cover_lanes(&self.triangles, 1 << lane, faces, &scene.table, &mut counts);
        counts[lane].pixels
    }

    /// Draws the scene into the clear buffer.
    fn render<const COVERED: bool>(&mut self, view: View<'_>) {
        let tree = &view.scene.tree;
        self.counters.hemicubes += 1;
        self.hemicube = self.hemicube.wrapping_add(1);
        if self.hemicube == 0 {
            // After 2³² hemicubes a stamp would match an old one.
            self.drawn.iter_mut().for_each(|d| d.hemicube = 0);
            self.hemicube = 1;
        }
        self.candidates.clear();
        self.subpixel.clear();
        self.parents_drawn.clear();
        let all = Faces {
            visible: ALL_FACES,
            hidden: 0,
        };
        if view.scene.settings.culling == Culling::Off {
            for block in 0..tree.blocks.len() {
                self.draw_block::<COVERED>(view, block, all);
            }
            return;
        }
        self.pending.clear();
        self.pending.push(Pending { node: 0, faces: all });
        while let Some(Pending { node, faces }) = self.pending.pop() {
            let node = &tree.nodes[node as usize];
            self.counters.nodes_tested += 1;
            let of = SceneBox {
                center: node.center.to_array(),
                half: node.half.to_array(),
            };
            let now = self.faces_of_box::<COVERED>(view, &of, faces.visible);
            if now.visible == 0 {
                if now.hidden == 0 {
                    self.counters.nodes_outside += 1;
                } else {
                    self.counters.nodes_hidden += 1;
                }
                continue;
            }
            let faces = Faces {
                visible: now.visible,
                hidden: faces.hidden | now.hidden,
            };
            if node.block != INNER {
                self.draw_block::<COVERED>(view, node.block as usize, faces);
                continue;
            }
            let [near, far] = front_to_back(tree, node.child, view.frame);
            for next in [near, far] {
                let next = &tree.nodes[next as usize];
                if next.block == INNER {
                    prefetch(&tree.nodes[next.child as usize]);
                    prefetch(&tree.nodes[next.child as usize + 1]);
                } else {
                    prefetch(&tree.blocks[next.block as usize]);
                }
            }
            self.pending.push(Pending { node: far, faces });
            self.pending.push(Pending { node: near, faces });
        }
    }

    fn draw_block<const COVERED: bool>(&mut self, view: View<'_>, block: usize, faces: Faces) {
        let scene = view.scene;
        scene
            .isa
            .transform(&scene.tree.blocks[block], view.frame, &mut self.triangles);
        let live = self.triangles.live;
        self.counters.triangles_transformed += LANES as u64;
        let mut pixels = [0; LANES];
        let hidden = faces.hidden;
        let mut lanes = DrawnLanes {
            live,
            on: std::array::from_fn(|face| if hidden >> face & 1 != 0 { live } else { 0 }),
            behind: 0,
            without: live,
            incomplete: if hidden == 0 { 0 } else { u16::MAX },
        };
        if live != 0 {
            each_face(faces.visible, |face| {
                let on = LanesOnFace {
                    triangles: &self.triangles,
                    face,
                    lanes: live,
                };
                let drawn = self.buffer.draw::<COVERED>(scene, on, &mut pixels);
                self.counters.triangles_drawn += u64::from(drawn.drawn.count_ones());
                lanes.incomplete |= drawn.hidden;
                lanes.on[face as usize] = drawn.on;
                lanes.behind |= drawn.behind;
            });
        }
        if COVERED {
            self.drawn[block] = DrawnBlock {
                hemicube: self.hemicube,
                incomplete: lanes.incomplete,
                pixels,
            };
            for (lane, &pixels) in pixels.iter().enumerate() {
                if pixels != 0 || self.triangles.seen[lane] >= scene.tree.patch_count {
                    lanes.without &= !(1 << lane);
                }
            }
            let mut candidates = lanes.without;
            if let Some(parents) = &scene.parents {
                candidates &= !self.list_parents(parents, block, lanes);
            }
            if candidates != 0 {
                self.list_subpixel(view, candidates, lanes.incomplete);
            }
        }
    }

    /// Lists the patches of a block without a pixel centre, except those with a centroid behind the buffer. Lanes in
    /// `unproved` may still have a pixel.
    fn list_subpixel(&mut self, view: View<'_>, candidates: u16, unproved: u16) {
        view.scene
            .isa
            .centroids(&self.triangles, view.frame, &mut self.centroids);
        let centroids = &*self.centroids;
        for lane in bits(u32::from(candidates & centroids.above)) {
            let (row, column) = (centroids.row[lane], centroids.x[lane]);
            let depth = centroids.depth[lane];
            if depth < view.about_as_near(self.buffer.at_least(row as usize, column as usize)) {
                // Depths only grow.
                continue;
            }
            self.candidates.push(Candidate {
                patch: self.triangles.seen[lane],
                unproved: unproved >> lane & 1 != 0,
                row,
                column,
                depth,
                direction: three(|c| centroids.direction[c][lane]),
            });
        }
    }

    /// Tests a box on faces.
    #[inline]
    fn faces_of_box<const COVERED: bool>(&mut self, view: View<'_>, of: &SceneBox, faces: u8) -> Faces {
        let (scene, on) = (view.scene, &mut self.on_faces);
        scene.isa.on_faces(of, view.frame, faces, COVERED, on);
        // Depths are within rounding of the corners' 1/w, widened by a millionth. A sub-pixel patch about as near as
        // the pixels before it may be visible.
        let slack = if COVERED {
            1.0 + subpixel_slack(scene.settings.resolution)
        } else {
            1.0
        };
        let buffer = &mut self.buffer;
        View::faces_of(on, view.frame.resolution, |face, pixels| {
            #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
            let bound = (on.near[face] * slack * (1.0 + 4e-6)) as f32;
            buffer.is_hidden(scene.isa, Face::ALL[face], pixels, bound)
        })
    }

    /// Finds the visible candidates: nearest at their centroid.
    ///
    /// "Nearest" means not behind the visible surface in the direction of the centroid. A neighbour in the same surface
    /// must not hide a patch, as it would if depths at the pixel's centre were compared. For culling to change nothing,
    /// the patch must also be about as near as the pixel: culling drops others.
    fn find_subpixel(&mut self, view: View<'_>) {
        let tree = &view.scene.tree;
        let mut candidates = std::mem::take(&mut self.candidates);
        self.uncounted.clear();
        for candidate in &candidates {
            let &Candidate { patch, depth, .. } = candidate;
            let (id, seen) = self.buffer.seen_at(candidate.row as usize, candidate.column as usize);
            if depth < view.about_as_near(seen) {
                continue;
            }
            if !is_in_front(tree, id, view.frame, depth, candidate.direction) {
                continue;
            }
            if candidate.unproved {
                self.uncounted.push(patch);
            } else {
                self.subpixel.push(patch);
            }
        }
        let counts = self.counter.count(view, &self.uncounted);
        let none = self.uncounted.iter().zip(counts).filter(|(_, count)| count.pixels == 0);
        self.subpixel.extend(none.map(|(&patch, _)| patch));
        candidates.clear();
        self.candidates = candidates;
        self.subpixel.sort_unstable();
    }
}

impl<B: Buffer> TreeEngine<B> {
    /// The item buffer of a hemicube.
    pub(crate) fn items(&mut self, scene: &SharedScene, hemicube: &Hemicube) -> Items {
        let frame = &frame(scene, hemicube);
        let view = View { scene, frame };
        self.render::<false>(view);
        let items = self.take_items(view);
        let (buffer, parents) = (&mut self.buffer, scene.parents.as_ref());
        let patch_count = scene.tree.patch_count;
        self.sums.drain(|id, _, _| {
            if id < patch_count && parents.is_some_and(|parents| parents.subdivided(id).is_some()) {
                buffer.forget(id);
            }
        });
        self.buffer.clear();
        items
    }

    /// A row without covered weights, and its item buffer.
    pub(crate) fn row_and_items(
        &mut self,
        scene: &SharedScene,
        hemicube: &Hemicube,
        out: &mut RowBlock,
    ) -> (Items, Counters) {
        self.counters = Counters::default();
        let frame = &frame(scene, hemicube);
        let view = View { scene, frame };
        self.render::<false>(view);
        let items = self.take_items(view);
        self.end_row::<false>(view, out);
        (items, self.counters)
    }

    /// The item buffer of what is drawn. Reduces the buffer.
    fn take_items(&mut self, view: View<'_>) -> Items {
        let scene = view.scene;
        let patch_count = scene.tree.patch_count;
        let mut items = Vec::new();
        self.buffer.write_items(&mut items);
        self.buffer.reduce(scene, &mut self.sums);
        if let Some(parents) = &scene.parents {
            let mut ids = std::mem::take(&mut self.ids);
            self.sums
                .drain(|id, pixels, weight| ids.push(IdSum { id, pixels, weight }));
            for IdSum { id, pixels, weight } in ids.drain(..) {
                self.sums.add(id, pixels, weight);
                if id < patch_count
                    && let Some(parent) = parents.subdivided(id)
                {
                    let seen = VisibleParent {
                        parents,
                        parent: parents.get(parent),
                        id,
                        faces: ALL_FACES,
                        weight: 0,
                    };
                    self.distribute_items(view, &seen, &mut items);
                }
            }
            self.ids = ids;
        }
        for id in &mut items {
            *id = match *id {
                id if id < patch_count => id,
                id if id == patch_count => Items::BLOCKED,
                _ => Items::ESCAPED,
            };
        }
        Items {
            resolution: scene.settings.resolution,
            seen: items,
        }
    }

    /// Replaces a parent in the item buffer by its patches, as [`Self::distribute`] does with weights.
    fn distribute_items(&mut self, view: View<'_>, of: &VisibleParent<'_>, items: &mut [u32]) {
        let scene = view.scene;
        let resolution = view.frame.resolution;
        let mut pixels = Vec::new();
        self.buffer.pixels_of(of.id, &mut pixels);
        let mut most = None;
        let distributor = &mut self.distributor;
        self.buffer.uncover(of.id, &mut distributor.uncovered);
        // Words of the coverage with pixels that no patch has yet, and these pixels. A patch is held against words: there
        // are up to 64 times fewer than pixels.
        let mut left: Vec<(usize, u64)> = Vec::new();
        for (row, x) in pixels {
            let (word, bit) = distributor.uncovered.place_of(row, x);
            match left.last_mut() {
                Some((last, bits)) if *last == word => *bits |= bit,
                _ => left.push((word, bit)),
            }
        }
        let set = |items: &mut [u32], coverage: &Coverage, word: usize, bits: u64, patch: u32| {
            let mut bits = bits;
            while bits != 0 {
                let (row, x) = coverage.pixel_at(word, bits.trailing_zeros());
                items[row * resolution + x] = patch;
                bits &= bits - 1;
            }
        };
        for block in 0..of.parents.block_count(of.parent) {
            distributor.transform(view, of, block);
            let (t, uncovered) = (&mut *distributor.triangles, &mut distributor.uncovered);
            for lane in bits(u32::from(t.live)) {
                let patch = t.seen[lane];
                #[allow(clippy::cast_possible_truncation, reason = "below 16")]
                let turns = [lane as u8];
                let pass = Pass {
                    faces: of.faces,
                    turns: Turns::InOrder(&turns),
                    cut: None,
                };
                let shown = scene.isa.draw_patches::<false>(t, pass, uncovered, &scene.table);
                if shown.seen == 0 {
                    continue;
                }
                let visible = shown.visible[lane];
                if most.is_none_or(|(_, other)| visible >= other) {
                    most = Some((patch, visible));
                }
                left.retain_mut(|(word, bits)| {
                    let found = *bits & uncovered.word(*word);
                    set(items, uncovered, *word, found, patch);
                    *bits &= !found;
                    *bits != 0
                });
            }
        }
        if !left.is_empty() {
            let patch = most.map_or_else(|| of.parents.nearest(of.parent, of.id, view.frame), |(patch, _)| patch);
            for (word, bits) in left {
                set(items, &self.distributor.uncovered, word, bits, patch);
            }
        }
        self.buffer.cover(of.id, &mut self.distributor.uncovered);
    }
}

/// Search of the visible sub-pixel patches of a parent, after everything is drawn.
struct SubpixelSearch<'a, B> {
    view: View<'a>,
    buffer: &'a B,
    centroids: &'a mut Centroids,
    found: &'a mut Vec<u32>,
}

impl<B: Buffer> SubpixelSearch<'_, B> {
    /// Finds, among lanes of a block of the parent's patches, those without a pixel centre and nearest at their
    /// centroid, as [`TreeEngine::find_subpixel`] does. Lanes in `unproved` may have a pixel.
    fn find(&mut self, of: &VisibleParent<'_>, t: &Transformed, candidates: u16, unproved: u16) {
        let view = self.view;
        view.scene.isa.centroids(t, view.frame, self.centroids);
        let centroids = &*self.centroids;
        let mut found = 0;
        for lane in bits(u32::from(candidates & centroids.above)) {
            let (row, column, depth) = (centroids.row[lane], centroids.x[lane], centroids.depth[lane]);
            let (row, column) = (row as usize, column as usize);
            if depth < view.about_as_near(self.buffer.at_least(row, column)) {
                continue;
            }
            let (id, seen) = self.buffer.seen_at(row, column);
            if depth < view.about_as_near(seen) {
                continue;
            }
            let direction = three(|c| centroids.direction[c][lane]);
            // The parent has no depth but the patch's own.
            let is_in_front = id == of.id || is_in_front(&view.scene.tree, id, view.frame, depth, direction);
            found |= u16::from(is_in_front) << lane;
        }
        let found = view.without_pixels(t, found, unproved, of.faces);
        self.found.extend(ids_of(t, found));
    }
}

impl View<'_> {
    /// Least 1/w of a centroid about as near as the visible surface at its pixel.
    #[inline(always)]
    fn about_as_near(self, seen: f32) -> f64 {
        f64::from(seen) / (1.0 + subpixel_slack(self.scene.settings.resolution))
    }
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

/// Returns true if a centroid is in front of the visible surface at its pixel. The surface's depth in the direction of
/// the centroid decides; beyond its silhouette, being about as near as the pixel suffices.
fn is_in_front(tree: &Tree, seen: u32, frame: &Frame, depth: f64, direction: [f64; 3]) -> bool {
    seen >= tree.patch_count
        || depth_there(tree, seen, frame, direction).is_none_or(|there| depth >= there * (1.0 - 1e-6))
}

/// 1/w of a patch in a direction scaled to w = 1, or `None` where the direction misses it.
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
