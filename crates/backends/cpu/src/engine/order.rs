//! Engine `order`: the walk over the binary space partition, nearest first, and the row straight from the drawing.
//!
//! With parent triangles, the partition is of these (version `order-2` for fractions, `order-3` otherwise). No buffer
//! knows at the end which pixels show a parent, so the coverage records them while drawing: eight words of visible
//! pixels at a time, and with covered weights, for the rows that the parent touches, the pixels uncovered before its
//! plane (`Record` in `kernel/coverage.rs`). After the walk, each visible parent is distributed by its record
//! (`distribute.rs`). Patches without a pixel are visible if their centroid was uncovered: in parents with visible
//! pixels the record tells, in parents without a pixel the snapshot while drawing. A piece is asked only for the
//! patches with a centroid in it, as the other pieces may have been culled.

use super::covered::CoveredCounter;
use super::distribute::{Distributor, Entry, UNCOUNTED, VisibleParent};
use super::{ALL_FACES, Faces, Remainder, View, each_face, frame, ids_of};
use crate::SharedScene;
use crate::bsp::{BspTree, NO_PLANE, NONE, PlaneNode};
use crate::kernel::{
    BOXES, Coverage, Cut, GroupOnFaces, OnFaces, OrderedCoverage, Pass, PatchSet, Recorded, RunIndex, SceneBox, Shown,
    Sums, Transformed, Turns, bits, prefetch,
};
use crate::parents::ParentTriangles;
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Counters, Culling, Hemicube};
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::row::RowBlock;
use std::ops::Range;

/// A session's working memory.
#[derive(Debug)]
pub(crate) struct BspEngine {
    canvas: OrderedCoverage,
    sums: Sums,
    triangles: Box<Transformed>,
    /// The surfaces that the pieces of a block were cut from.
    surfaces: Box<Transformed>,
    pending: Vec<Pending>,
    /// Nodes of a layer to be tested, and its blocks to be drawn.
    layer_nodes: Vec<InLayer>,
    layer_blocks: Vec<InLayer>,
    /// For each of these blocks, the lanes with an uncovered centroid, if asked beforehand.
    uncovered: Vec<u16>,
    on_faces: OnFaces,
    /// Patches without a pixel centre and with a visible centroid.
    subpixel: PatchSet,
    /// Likewise, without a proof that they cover no pixel centre.
    perhaps_subpixel: PatchSet,
    /// Both sets in ascending order.
    subpixel_patches: [Vec<u32>; 2],
    row: Vec<Listed>,
    /// Places in `row` with a covered weight to be counted, and their patches.
    uncounted: Vec<u32>,
    patches: Vec<u32>,
    counter: CoveredCounter,
    parents: ParentRecords,
    distributor: Distributor,
    counters: Counters,
}

/// Results for parent triangles, for the time after everything is drawn.
#[derive(Debug)]
struct ParentRecords {
    /// Records of subdivided parents, indexed by `index`.
    recorded: Vec<Recorded>,
    index: RunIndex,
    /// Full but for the pixels uncovered before the parent at hand.
    uncovered: Coverage,
    /// Visible ids.
    ids: Vec<IdSum>,
    /// Parents with a covered weight to be counted.
    uncounted: Vec<u32>,
    /// Parents found without a pixel, but with visible centroids of patches, and these patches.
    subpixel: Vec<SubpixelParent>,
    subpixel_patches: Vec<u32>,
    /// All visible sub-pixel patches, ascending.
    found: Vec<u32>,
}

/// Covered and visible weight of an id.
#[derive(Clone, Copy, Debug)]
struct IdSum {
    id: u32,
    covered: u32,
    visible: u32,
}

/// A parent found without a pixel, with visible patches.
#[derive(Clone, Debug)]
struct SubpixelParent {
    id: u32,
    /// Its visible patches, in [`ParentRecords::subpixel_patches`].
    patches: Range<usize>,
    /// True if it is proved to cover no pixel.
    proved: bool,
}

impl ParentRecords {
    fn new(scene: &SharedScene) -> Self {
        let (index, resolution) = match &scene.parents {
            Some(parents) => {
                let index = RunIndex::new(scene.tree.patch_count as usize + 1, parents.subdivided_ids());
                (index, scene.settings.resolution)
            }
            None => (RunIndex::default(), 0),
        };
        Self {
            recorded: Vec::new(),
            index,
            uncovered: Coverage::full(resolution),
            ids: Vec::new(),
            uncounted: Vec::new(),
            subpixel: Vec::new(),
            subpixel_patches: Vec::new(),
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
    /// True if it has no pixel, so that it is left out if it turns out to cover one.
    subpixel: bool,
}

/// A part of the scene waiting to be drawn, the nearest last.
#[derive(Clone, Copy, Debug)]
struct Pending {
    part: ScenePart,
    faces: Faces,
}

#[derive(Clone, Copy, Debug)]
enum ScenePart {
    /// A node of the partition.
    Node(u32),
    /// The root of a layer: a tree of boxes over blocks.
    Layer(u32),
}

/// A block or a node of a layer that may be visible.
#[derive(Clone, Copy, Debug)]
struct InLayer {
    index: u32,
    faces: Faces,
}

/// Marks a covered weight that is not complete.
const INCOMPLETE: u32 = 1 << 31;

impl BspEngine {
    pub(crate) fn new(scene: &SharedScene) -> Self {
        let canvas = OrderedCoverage::new(&scene.table, scene.settings.culling == Culling::On);
        Self {
            canvas: if scene.parents.is_some() {
                canvas.recording(scene.settings.covered)
            } else {
                canvas
            },
            sums: Sums::new(scene.tree.patch_count as usize + 1),
            triangles: Box::new(Transformed::new()),
            surfaces: Box::new(Transformed::new()),
            pending: Vec::new(),
            layer_nodes: Vec::new(),
            layer_blocks: Vec::new(),
            uncovered: Vec::new(),
            on_faces: OnFaces::new(),
            subpixel: PatchSet::new(scene.tree.patch_count as usize),
            perhaps_subpixel: PatchSet::new(scene.tree.patch_count as usize),
            subpixel_patches: [Vec::new(), Vec::new()],
            row: Vec::new(),
            uncounted: Vec::new(),
            patches: Vec::new(),
            counter: CoveredCounter::new(),
            parents: ParentRecords::new(scene),
            distributor: Distributor::new(scene),
            counters: Counters::default(),
        }
    }

    pub(crate) fn rows(
        &mut self,
        scene: &SharedScene,
        bsp: &BspTree,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
    ) -> Counters {
        self.counters = Counters::default();
        for hemicube in hemicubes {
            let frame = &frame(scene, hemicube);
            if scene.settings.covered {
                self.row::<true>(View { scene, frame }, bsp, out);
            } else {
                self.row::<false>(View { scene, frame }, bsp, out);
            }
        }
        self.counters
    }

    /// The pixels that hit nothing, and the blocked weight.
    pub(crate) fn escaped(&mut self, scene: &SharedScene, bsp: &BspTree, hemicube: &Hemicube, out: &mut EscapedPixels) {
        let mut row = RowBlock::default();
        self.row::<false>(
            View {
                scene,
                frame: &frame(scene, hemicube),
            },
            bsp,
            &mut row,
        );
        out.clear(scene.settings.resolution);
        self.canvas.now.write_uncovered(out);
        out.blocked = row.row(0).blocked;
    }

    fn row<const COVERED: bool>(&mut self, view: View<'_>, bsp: &BspTree, out: &mut RowBlock) {
        let patch_count = view.scene.tree.patch_count;
        self.canvas.now.clear();
        self.render::<COVERED>(view, bsp);
        let mut remainder = Remainder {
            escaped: self.canvas.uncovered_weight(&view.scene.table),
            blocked: 0,
        };
        if let Some(parents) = &view.scene.parents {
            self.row_of_parents::<COVERED>(view, bsp, parents, remainder, out);
            return;
        }
        if !COVERED {
            self.sums.drain(|id, _, weight| {
                if id < patch_count {
                    out.push(InputPatch(id), weight, 0);
                } else {
                    remainder.blocked = weight;
                }
            });
            out.end_row(remainder.escaped, remainder.blocked);
            return;
        }
        remainder.blocked = self.list_row(bsp, patch_count);
        self.patches.clear();
        self.patches
            .extend(self.uncounted.iter().map(|&place| self.row[place as usize].patch));
        let counts = self.counter.count(view, &self.patches);
        for (&place, count) in self.uncounted.iter().zip(counts) {
            let entry = &mut self.row[place as usize];
            // A sub-pixel patch is asked for its pixels only. Pieces of a cut patch may show more than it covers whole,
            // where the eye lies in its plane but for rounding: visible pixels are covered.
            entry.covered = if entry.subpixel {
                count.pixels
            } else {
                count.weight.max(entry.visible)
            };
        }
        for entry in &self.row {
            if !(entry.subpixel && entry.covered != 0) {
                out.push(InputPatch(entry.patch), entry.visible, entry.covered);
            }
        }
        out.end_row(remainder.escaped, remainder.blocked);
    }

    /// Lists the row's entries in ascending order, and the places with a covered weight to be counted. Returns the
    /// blocked weight.
    fn list_row(&mut self, bsp: &BspTree, patch_count: u32) -> u32 {
        let [subpixel, perhaps] = &mut self.subpixel_patches;
        for (set, patches) in [
            (&mut self.subpixel, &mut *subpixel),
            (&mut self.perhaps_subpixel, &mut *perhaps),
        ] {
            patches.clear();
            set.drain(|patch| patches.push(patch));
        }
        self.row.clear();
        self.uncounted.clear();
        let (row, uncounted) = (&mut self.row, &mut self.uncounted);
        let mut subpixel = merged(subpixel, perhaps).peekable();
        let mut push_subpixel = |patch: u32, unproved: bool, row: &mut Vec<Listed>| {
            if unproved {
                #[allow(clippy::cast_possible_truncation, reason = "fewer entries than patches")]
                uncounted.push(row.len() as u32);
            }
            row.push(Listed {
                patch,
                visible: 0,
                covered: 0,
                subpixel: true,
            });
        };
        let mut blocked = 0;
        self.sums.drain(|patch, covered, visible| {
            while let Some((t, unproved)) = subpixel.next_if(|&(t, _)| t <= patch) {
                if t < patch {
                    push_subpixel(t, unproved, row);
                }
            }
            if patch == patch_count {
                blocked = visible;
                return;
            }
            row.push(Listed {
                patch,
                visible,
                covered,
                subpixel: false,
            });
        });
        for (t, unproved) in subpixel {
            push_subpixel(t, unproved, row);
        }
        for (place, entry) in row.iter().enumerate() {
            if !entry.subpixel && (entry.covered & INCOMPLETE != 0 || bsp.is_cut(entry.patch)) {
                #[allow(clippy::cast_possible_truncation, reason = "fewer entries than patches")]
                uncounted.push(place as u32);
            }
        }
        blocked
    }

    /// Makes the row after the walk, if parent triangles were drawn.
    fn row_of_parents<const COVERED: bool>(
        &mut self,
        view: View<'_>,
        bsp: &BspTree,
        parents: &ParentTriangles,
        mut remainder: Remainder,
        out: &mut RowBlock,
    ) {
        let patch_count = view.scene.tree.patch_count;
        let records = &mut self.parents;
        records.ids.clear();
        self.sums.drain(|id, covered, visible| {
            if id < patch_count {
                records.ids.push(IdSum { id, covered, visible });
            } else {
                remainder.blocked = visible;
            }
        });
        let is_known = |of: &IdSum| of.covered & INCOMPLETE == 0 && !bsp.is_cut(of.id);
        records.uncounted.clear();
        let unknown = records
            .ids
            .iter()
            .filter(|of| COVERED && !is_known(of) && records.index.has(of.id));
        records.uncounted.extend(unknown.map(|of| of.id));
        let mut counted = self.counter.count_drawn(view, &records.uncounted).iter();
        for place in 0..self.parents.ids.len() {
            let of = self.parents.ids[place];
            let known = COVERED && is_known(&of);
            if !self.parents.index.has(of.id) {
                let covered = if known { of.covered } else { UNCOUNTED };
                self.distributor.entries.push(Entry::new(of.id, of.visible, covered));
                continue;
            }
            let covered = if known || !COVERED {
                of.covered
            } else {
                counted.next().map_or(0, |count| count.weight)
            };
            let parent = parents.get(parents.subdivided(of.id).expect("indexed"));
            let records = &self.parents;
            let recorded = || records.index.of(of.id).map(|place| &records.recorded[place]);
            let seen = VisibleParent {
                parents,
                parent,
                id: of.id,
                faces: if COVERED {
                    parent.faces(view.frame)
                } else {
                    recorded().fold(0, |faces, of| faces | 1 << of.face as u8)
                },
                weight: of.visible,
            };
            // Near the horizon pixels have no weight: equal weights of 0 do not prove that all pixels are visible.
            if view.scene.fractions && covered == of.visible && of.visible != 0 {
                self.distributor.list_all(view, &seen);
            } else {
                distribute::<COVERED>(
                    view,
                    &seen,
                    &self.canvas,
                    &mut self.parents,
                    &mut self.distributor,
                    &mut self.subpixel,
                );
            }
            self.parents.index.forget(of.id);
        }
        self.parents.recorded.clear();
        self.parents.index.clear();
        if let Some(record) = &mut self.canvas.record {
            record.clear();
        }
        if COVERED {
            self.find_subpixel(view);
        }
        self.counters.triangles_transformed += self.distributor.take_transformed();
        self.distributor
            .end_row::<COVERED>(view, &self.parents.found, remainder, out);
    }

    /// Finds the other visible sub-pixel patches: without a parent, or of parents without a pixel.
    fn find_subpixel(&mut self, view: View<'_>) {
        let ParentRecords {
            ids,
            uncounted,
            subpixel,
            subpixel_patches,
            found,
            ..
        } = &mut self.parents;
        uncounted.clear();
        self.perhaps_subpixel.drain(|patch| uncounted.push(patch));
        let counts = self.counter.count(view, uncounted);
        let without = uncounted.iter().zip(counts).filter(|(_, count)| count.pixels == 0);
        without.for_each(|(&patch, _)| self.subpixel.insert(patch));

        subpixel.sort_unstable_by_key(|parent| (parent.id, parent.proved));
        uncounted.clear();
        for parent in subpixel.iter() {
            if !parent.proved && uncounted.last() != Some(&parent.id) {
                uncounted.push(parent.id);
            }
        }
        let counts = self.counter.count_drawn(view, uncounted);
        let mut with_pixels = uncounted
            .iter()
            .zip(counts)
            .filter(|(_, count)| count.pixels != 0)
            .peekable();
        for parent in subpixel.drain(..) {
            while with_pixels.next_if(|(id, _)| **id < parent.id).is_some() {}
            let has_pixels = with_pixels.peek().is_some_and(|(id, _)| **id == parent.id)
                || ids.binary_search_by_key(&parent.id, |of| of.id).is_ok();
            if !has_pixels {
                subpixel_patches[parent.patches]
                    .iter()
                    .for_each(|&patch| self.subpixel.insert(patch));
            }
        }
        subpixel_patches.clear();
        found.clear();
        self.subpixel.drain(|patch| found.push(patch));
    }

    /// Keeps the lanes of the block that are subdivided parents.
    fn parent_lanes(&self, lanes: u16) -> u16 {
        let is_parent = |lane: usize| self.parents.index.has(self.triangles.seen[lane]);
        bits(u32::from(lanes)).fold(0, |parents, lane| parents | u16::from(is_parent(lane)) << lane)
    }

    /// Keeps the records of a block's subdivided parents.
    fn keep_records(&mut self) {
        let parents = &mut self.parents;
        if let Some(record) = &mut self.canvas.record {
            for (lane, recorded) in record.lanes.drain(..) {
                let id = self.triangles.seen[lane];
                if parents.index.has(id) {
                    parents.index.add(id);
                    parents.recorded.push(recorded);
                }
            }
        }
    }

    /// Lists the sub-pixel patches of a block's parents without a pixel.
    fn list_subpixel_parents(
        &mut self,
        view: View<'_>,
        parents: &ParentTriangles,
        faces: Faces,
        shown: &Shown,
        is_cut: bool,
    ) {
        let isa = view.scene.isa;
        let mut without = self.parent_lanes(shown.without);
        if without != 0 {
            let snapshot = &self.canvas.snapshot;
            without = isa.may_touch_uncovered(&self.triangles, without, faces.visible, snapshot);
            if !is_cut {
                // Most lanes left out cover pixels, hidden by something close.
                without = view.without_pixels(&self.triangles, without, shown.hidden, faces.visible);
            }
        }
        for lane in bits(u32::from(without)) {
            let id = self.triangles.seen[lane];
            let of = VisibleParent {
                parents,
                parent: parents.get(parents.subdivided(id).expect("indexed")),
                id,
                faces: faces.visible,
                weight: 0,
            };
            let first = self.parents.subpixel_patches.len();
            for block in 0..parents.block_count(of.parent) {
                self.distributor.transform(view, &of, block);
                let t = &*self.distributor.triangles;
                let mut seen = isa.uncovered_centroids(t, t.live, of.faces, &self.canvas.snapshot);
                if is_cut {
                    seen &= centroids_in(t, seen, corners(&self.triangles, lane));
                }
                self.parents.subpixel_patches.extend(ids_of(t, seen));
            }
            let patches = first..self.parents.subpixel_patches.len();
            if !patches.is_empty() {
                let proved = faces.hidden == 0 && !is_cut && shown.hidden >> lane & 1 == 0;
                self.parents.subpixel.push(SubpixelParent { id, patches, proved });
            }
        }
    }

    /// Draws the scene into the clear coverage, and adds up the visible weights.
    fn render<const COVERED: bool>(&mut self, view: View<'_>, bsp: &BspTree) {
        self.counters.hemicubes += 1;
        if bsp.nodes.is_empty() {
            return;
        }
        let eye = DVec3::from_array(view.frame.origin);
        self.pending.clear();
        self.pending.push(Pending {
            part: ScenePart::Node(0),
            faces: Faces {
                visible: ALL_FACES,
                hidden: 0,
            },
        });
        while let Some(Pending { part, faces }) = self.pending.pop() {
            let node = match part {
                ScenePart::Layer(index) => {
                    self.draw_layer::<COVERED>(view, bsp, InLayer { index, faces });
                    continue;
                }
                ScenePart::Node(node) => &bsp.nodes[node as usize],
            };
            let faces = if self.canvas.culling {
                self.counters.nodes_tested += 1;
                let now = self.faces_of_box::<COVERED>(view, node.center, node.half, faces.visible);
                if !self.may_be_visible(now.visible, now.hidden) {
                    continue;
                }
                Faces {
                    visible: now.visible,
                    hidden: faces.hidden | now.hidden,
                }
            } else {
                faces
            };
            if node.is_leaf {
                if COVERED && view.scene.parents.is_some() {
                    self.take_snapshot(faces.visible);
                }
                self.draw_leaf::<COVERED>(view, bsp, node, faces);
                continue;
            }
            let in_front = node.normal.dot(eye) >= node.distance;
            let (near, far, here) = if in_front {
                (node.front, node.back, node.here[0])
            } else {
                (node.back, node.front, node.here[1])
            };
            if far != NONE {
                prefetch(&bsp.nodes[far as usize]);
                self.pending.push(Pending {
                    part: ScenePart::Node(far),
                    faces,
                });
            }
            for layer in (here.start..here.end).rev() {
                let root = bsp.layers[layer as usize];
                prefetch(&bsp.layer_nodes[root as usize]);
                self.pending.push(Pending {
                    part: ScenePart::Layer(root),
                    faces,
                });
            }
            if near != NONE {
                prefetch(&bsp.nodes[near as usize]);
                self.pending.push(Pending {
                    part: ScenePart::Node(near),
                    faces,
                });
            }
        }
    }

    /// Counts a tested box; returns true if it may be visible.
    #[inline]
    fn may_be_visible(&mut self, visible: u8, hidden: u8) -> bool {
        if visible == 0 {
            if hidden == 0 {
                self.counters.nodes_outside += 1;
            } else {
                self.counters.nodes_hidden += 1;
            }
        }
        visible != 0
    }

    /// Draws a layer of a plane. Its surfaces do not hide each other, so that all are tested before any is drawn.
    fn draw_layer<const COVERED: bool>(&mut self, view: View<'_>, bsp: &BspTree, root: InLayer) {
        let (mut nodes, mut blocks) = (
            std::mem::take(&mut self.layer_nodes),
            std::mem::take(&mut self.layer_blocks),
        );
        self.canvas.begin_plane();
        if COVERED && !self.canvas.culling {
            self.canvas.snapshot_all();
        }
        nodes.push(root);
        while let Some(InLayer { index, faces }) = nodes.pop() {
            let node = &bsp.layer_nodes[index as usize];
            let tested = if self.canvas.culling {
                self.counters.nodes_tested += u64::from(node.used.count_ones());
                let (canvas, isa) = (&mut self.canvas, view.scene.isa);
                isa.test_group::<COVERED>(&node.boxes, node.used, view.frame, canvas, faces.visible)
            } else {
                GroupOnFaces {
                    visible: [faces.visible; BOXES],
                    hidden: [0; BOXES],
                }
            };
            for l in bits(u32::from(node.used)) {
                if self.may_be_visible(tested.visible[l], tested.hidden[l]) {
                    let list = if node.boxes.leaves >> l & 1 != 0 {
                        prefetch(&bsp.blocks[node.child[l] as usize]);
                        &mut blocks
                    } else {
                        &mut nodes
                    };
                    list.push(InLayer {
                        index: node.child[l],
                        faces: Faces {
                            visible: tested.visible[l],
                            hidden: faces.hidden | tested.hidden[l],
                        },
                    });
                }
            }
        }
        if COVERED && !self.canvas.takes_snapshots {
            self.draw_asked(view, bsp, &blocks);
            blocks.clear();
        }
        for block in blocks.drain(..) {
            self.draw_block::<COVERED>(view, bsp, block, Turns::Together);
        }
        (self.layer_nodes, self.layer_blocks) = (nodes, blocks);
    }

    /// Draws blocks of a plane with covered weights, after asking all of them for uncovered centroids.
    fn draw_asked(&mut self, view: View<'_>, bsp: &BspTree, blocks: &[InLayer]) {
        let mut uncovered = std::mem::take(&mut self.uncovered);
        for block in blocks {
            self.transform(view, bsp, block.index);
            let t = &*self.triangles;
            let visible = block.faces.visible;
            uncovered.push(view.scene.isa.uncovered_centroids(t, t.live, visible, &self.canvas.now));
        }
        for (&block, &uncovered) in blocks.iter().zip(&uncovered) {
            self.draw_block::<true>(view, bsp, block, Turns::Asked(uncovered));
        }
        uncovered.clear();
        self.uncovered = uncovered;
    }

    /// Transforms a block; returns the surfaces that its pieces were cut from, if they were.
    #[inline(always)]
    fn transform<'a>(&mut self, view: View<'a>, bsp: &'a BspTree, index: u32) -> Option<Cut<'a>> {
        let (isa, frame, index) = (view.scene.isa, view.frame, index as usize);
        isa.transform(&bsp.blocks[index], frame, &mut self.triangles);
        let lines = bsp.lines_of_block[index];
        let cut = (lines != NONE).then(|| Cut {
            lines: &bsp.lines[lines as usize],
            frame,
        });
        if let Some(cut) = &cut {
            // The visible side of a piece is its surface's.
            isa.transform(&cut.lines.surfaces, frame, &mut self.surfaces);
            let (t, whole) = (&mut *self.triangles, &*self.surfaces);
            (t.sign, t.seen, t.live) = (whole.sign, whole.seen, whole.live);
        }
        cut
    }

    /// Tests a box on faces.
    #[inline]
    fn faces_of_box<const COVERED: bool>(&mut self, view: View<'_>, center: DVec3, half: DVec3, faces: u8) -> Faces {
        let isa = view.scene.isa;
        let of = SceneBox {
            center: center.to_array(),
            half: half.to_array(),
        };
        isa.on_faces(&of, view.frame, faces, COVERED, &mut self.on_faces);
        View::faces_of(&self.on_faces, view.frame.resolution, |_, pixels| {
            isa.all_covered(&self.canvas.now, pixels)
        })
    }

    /// Adds the box that was just tested to the snapshot, on the faces where it may be visible.
    fn take_snapshot(&mut self, visible: u8) {
        let (canvas, on) = (&mut self.canvas, &self.on_faces);
        canvas.begin_plane();
        if !canvas.culling || on.at_eye != 0 {
            canvas.snapshot_all();
        }
        let resolution = canvas.now.resolution;
        each_face(on.boxed & visible, |face| {
            canvas.snapshot_box(on.in_atlas(face as usize, resolution));
        });
    }

    /// Draws a leaf's block in the order of its planes.
    fn draw_leaf<const COVERED: bool>(&mut self, view: View<'_>, bsp: &BspTree, node: &PlaneNode, faces: Faces) {
        let planes = &bsp.planes[node.here[0].start as usize..node.here[0].end as usize];
        let block = node.front;
        prefetch(&bsp.blocks[block as usize]);
        let eye = DVec3::from_array(view.frame.origin);
        let mut lanes = [0u8; LANES];
        let mut count = 0;
        // A plane is met twice: to visit its sides, and to draw its own lanes.
        let mut pending = [(0u8, false); 2 * LEAF_DEPTH];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (index, draw) = pending[depth];
            let plane = &planes[usize::from(index)];
            if draw {
                let start = count;
                for lane in bits(u32::from(plane.here)) {
                    #[allow(clippy::cast_possible_truncation, reason = "below 16")]
                    {
                        lanes[count] = lane as u8;
                    }
                    count += 1;
                }
                if plane.overlap {
                    let block = &bsp.blocks[block as usize];
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
        let block = InLayer { index: block, faces };
        self.draw_block::<COVERED>(view, bsp, block, Turns::InOrder(&lanes[..count]));
    }

    fn draw_block<const COVERED: bool>(&mut self, view: View<'_>, bsp: &BspTree, block: InLayer, turns: Turns<'_>) {
        let (scene, faces) = (view.scene, block.faces);
        let cut = self.transform(view, bsp, block.index);
        let is_cut = cut.is_some();
        self.counters.triangles_transformed += LANES as u64;
        if self.triangles.live == 0 {
            return;
        }
        let pass = Pass {
            faces: faces.visible,
            turns,
            cut,
        };
        let shown = scene
            .isa
            .draw_ordered::<COVERED>(&mut self.triangles, pass, &mut self.canvas, &scene.table);
        self.counters.triangles_drawn += u64::from(shown.drawn);
        let incomplete = if faces.hidden == 0 { shown.hidden } else { u16::MAX };
        for lane in bits(u32::from(shown.seen)) {
            let id = self.triangles.seen[lane];
            self.sums.add(id, shown.covered[lane], shown.visible[lane]);
            if COVERED && incomplete >> lane & 1 != 0 {
                self.sums.mark(id, INCOMPLETE);
            }
        }
        self.keep_records();
        if COVERED {
            let unproved = if is_cut { u16::MAX } else { incomplete };
            let mut subpixel = shown.subpixel;
            if let Some(parents) = &scene.parents {
                self.list_subpixel_parents(view, parents, faces, &shown, is_cut);
                subpixel &= !self.parent_lanes(subpixel);
            }
            for lane in bits(u32::from(subpixel)) {
                let patch = self.triangles.seen[lane];
                if patch < scene.tree.patch_count {
                    if unproved >> lane & 1 != 0 {
                        self.perhaps_subpixel.insert(patch);
                    } else {
                        self.subpixel.insert(patch);
                    }
                }
            }
        }
    }
}

/// Distributes a visible parent by its record, and finds its visible sub-pixel patches.
fn distribute<const COVERED: bool>(
    view: View<'_>,
    seen: &VisibleParent<'_>,
    canvas: &OrderedCoverage,
    parents: &mut ParentRecords,
    distributor: &mut Distributor,
    subpixel: &mut PatchSet,
) {
    let record = canvas.record.as_ref().expect("made with parents");
    let (index, all) = (&parents.index, &parents.recorded);
    let recorded = || index.of(seen.id).map(|place| &all[place]);
    recorded().for_each(|of| record.uncover_shown(of, &mut distributor.uncovered));
    let uncovered = &mut parents.uncovered;
    let mut is_uncovered = false;
    let stays_uncovered = distributor.distribute::<COVERED>(view, seen, |t, lanes, hidden| {
        if !is_uncovered {
            is_uncovered = true;
            recorded().for_each(|of| record.uncover_box(of, uncovered));
        }
        let centered = view.scene.isa.uncovered_centroids(t, lanes, seen.faces, uncovered);
        let without = view.without_pixels(t, centered, hidden, seen.faces);
        ids_of(t, without).for_each(|patch| subpixel.insert(patch));
    });
    if stays_uncovered {
        recorded().for_each(|of| record.cover_shown(of, &mut distributor.uncovered));
    }
    if is_uncovered {
        recorded().for_each(|of| record.cover_box(of, uncovered));
    }
}

/// The corners of a lane, in a hemicube's frame.
fn corners(t: &Transformed, lane: usize) -> [DVec3; 3] {
    [0, 1, 2].map(|k| DVec3::from_array([0, 1, 2].map(|c| t.corners[3 * k + c][lane])))
}

/// Keeps the lanes, in the plane of a piece, with a centroid in the piece: the others lie in pieces drawn at other
/// times.
///
/// Tested in the plane, not as seen by the eye, which may see it edge-on.
fn centroids_in(t: &Transformed, mut lanes: u16, piece: [DVec3; 3]) -> u16 {
    // A centroid on a cut, but for rounding, lies in both pieces.
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

/// Merges two ascending lists; true marks the patches of the second alone.
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

/// The greatest depth of a leaf's stacked planes.
const LEAF_DEPTH: usize = 48;

/// The id of a lane's side that an eye sees.
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
    use crate::Isa;
    use crate::kernel::{Frame, InstructionSet};

    /// Sixteen patches of a triangle, seen from the origin, and the two pieces that a cut through its middle leaves.
    #[test]
    fn centroids_are_in_the_piece_that_they_lie_in_also_where_it_is_seen_edge_on() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX, 64);
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
            let isa = InstructionSet::of(Isa::Portable).expect("any machine has it");
            isa.transform(&block, &frame, &mut t);
            let first = centroids_in(&t, u16::MAX, [a, b, middle]);
            let second = centroids_in(&t, u16::MAX, [middle, c, a]);
            assert_eq!(first | second, u16::MAX, "depth {depth}");
            // The cut runs along the middles of patches on it: these may be in both.
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
