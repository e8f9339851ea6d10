//! Occlusion culling by the host: finds the nodes of the hierarchy in front of the depths drawn so far. The other
//! backends cull on the device alone, so only this one has the file and [`crate::hierarchy`].
//!
//! Two queues, after the thesis (Vázquez and Guartes 2017, §3.2). Nodes seen by the hemicube before are drawn at once,
//! as depths; they are asked about behind everything this hemicube sees, for the hemicube after. Of all others, the
//! topmost nodes are asked about and waited for, and then the children of those in front. Nodes of few triangles are
//! drawn unasked; the node above them is asked about.
//!
//! There are two ways of asking. *Queries* are hardware occlusion queries, one a node and face. *Marks* draws the boxes
//! of all nodes at once; a fragment passing the depth test sets its node's bit. A software driver takes some 15 µs for
//! a query, and less than 1 µs for a box in a long draw. Marks also answer for this hemicube, so that ids of hidden
//! nodes need not be drawn.

use crate::cull::Cull;
use crate::device::Entered;
use crate::hierarchy::{ALL_FACES, Descend, FacePlanes, Hierarchy, WalkCounters};
use crate::reduce::wait;
use crate::render::{Place, Programs, Scene};
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Counters, Hemicube};
use hemicube_contract::face::Face;
use hemicube_shaders::view::FACES;
use std::ops::Range;
use std::sync::Arc;

/// A node, and a bit for each face to draw it on or to ask about.
pub(crate) type OnFaces = (u32, u8);

/// The nodes seen by the hemicube before: those with their boxes in front.
#[derive(Debug, Default)]
pub(crate) struct Coherence {
    seen: Vec<bool>,
    /// Number of nodes seen before each; one more at the end.
    before: Vec<u32>,
}

impl Coherence {
    pub(crate) fn new(nodes: usize) -> Self {
        Self {
            seen: vec![false; nodes],
            before: vec![0; nodes + 1],
        }
    }

    /// Marks a node seen, for the hemicube after.
    pub(crate) fn note(&mut self, place: u32) {
        self.seen[place as usize] = true;
    }

    /// Goes on to the next hemicube.
    fn advance(&mut self) {
        let mut count = 0;
        for (seen, before) in self.seen.iter_mut().zip(&mut self.before) {
            *before = count;
            count += u32::from(std::mem::take(seen));
        }
        if let Some(last) = self.before.last_mut() {
            *last = count;
        }
    }

    fn any(&self, places: Range<u32>) -> bool {
        self.before[places.end as usize] > self.before[places.start as usize]
    }
}

/// One hemicube's questions.
#[derive(Debug)]
pub(crate) struct Asking {
    hierarchy: Arc<Hierarchy>,
    planes: FacePlanes,
    few: u32,
    pub(crate) walked: WalkCounters,
    pub(crate) hidden: u64,
    /// Leaves to draw before the next question.
    pub(crate) fresh: Vec<OnFaces>,
    /// Nodes to be asked about next.
    pub(crate) asked: Vec<OnFaces>,
    /// All leaves drawn, and the node asked about in their place.
    drawn: Vec<(u32, u8, u32)>,
}

impl Asking {
    /// Begins with the nodes seen by the hemicube before.
    pub(crate) fn new(hierarchy: &Arc<Hierarchy>, planes: FacePlanes, few: u32, coherence: &mut Coherence) -> Self {
        coherence.advance();
        let mut asking = Self {
            hierarchy: Arc::clone(hierarchy),
            planes,
            few,
            walked: WalkCounters::default(),
            hidden: 0,
            fresh: Vec::new(),
            asked: Vec::new(),
            drawn: Vec::new(),
        };
        if !hierarchy.nodes.is_empty() {
            asking.descend(0, ALL_FACES, |places| coherence.any(places), false);
        }
        asking
    }

    /// Sorts the nodes in view beneath `from` into drawn and asked-about ones. `found`: `from` itself is known to be in
    /// front.
    fn descend(&mut self, from: u32, faces: u8, seen: impl Fn(Range<u32>) -> bool, found: bool) {
        let (hierarchy, few) = (&self.hierarchy, self.few);
        let (fresh, asked, drawn) = (&mut self.fresh, &mut self.asked, &mut self.drawn);
        hierarchy.walk(from, faces, &self.planes, &mut self.walked, |place, faces| {
            let node = &hierarchy.nodes[place as usize];
            let small = node.triangles <= few;
            let known = small || (found && place == from) || seen(place..node.skip);
            if !known {
                asked.push((place, faces));
                return Descend::No;
            }
            if node.is_leaf(place) {
                let mut unit = place;
                while hierarchy.nodes[unit as usize].triangles <= few && unit != 0 {
                    unit = hierarchy.nodes[unit as usize].parent;
                }
                fresh.push((place, faces));
                drawn.push((place, faces, unit));
            }
            Descend::Yes
        });
    }

    /// Takes the answers: the faces with each node of `asked` in front.
    pub(crate) fn hear(&mut self, asked: &[OnFaces], visible: &[u8]) {
        for (&(place, _), &faces) in asked.iter().zip(visible) {
            if faces == 0 {
                self.hidden += 1;
            } else {
                self.descend(place, faces, |_| false, true);
            }
        }
    }

    /// The nodes to ask about for the next hemicube: one for each leaf drawn.
    pub(crate) fn units(&self) -> Vec<OnFaces> {
        let mut units: Vec<OnFaces> = self.drawn.iter().map(|&(_, faces, unit)| (unit, faces)).collect();
        units.sort_unstable();
        units.dedup_by(|next, last| {
            let same = next.0 == last.0;
            if same {
                last.1 |= next.1;
            }
            same
        });
        units
    }

    /// Lists the chunks drawn on each face, ascending. With answers for `units`, leaves out hidden ones.
    pub(crate) fn lists(&self, answers: Option<(&[OnFaces], &[u8])>) -> [Vec<u32>; 5] {
        let mut lists: [Vec<u32>; 5] = Default::default();
        for &(leaf, faces, unit) in &self.drawn {
            let faces = faces
                & answers.map_or(ALL_FACES, |(units, visible)| {
                    units
                        .binary_search_by_key(&unit, |&(place, _)| place)
                        .map_or(ALL_FACES, |k| visible[k])
                });
            add(&mut lists, faces, self.hierarchy.nodes[leaf as usize].chunks.clone());
        }
        lists.iter_mut().for_each(|list| list.sort_unstable());
        lists
    }
}

/// Adds chunks to the lists of some faces.
pub(crate) fn add(lists: &mut [Vec<u32>; 5], faces: u8, chunks: Range<u32>) {
    for (face, list) in lists.iter_mut().enumerate() {
        if faces >> face & 1 == 1 {
            list.extend(chunks.clone());
        }
    }
}

/// Boxes to draw. `places`: the asked-about node of each box and its face, in the shader's order; `ends`: the list's
/// end for each face; `within`: by node, the faces not to be asked about.
struct Boxes {
    within: Vec<u8>,
    places: Vec<(usize, u8)>,
    ends: [usize; 5],
}

/// The queries of a node, with the face of each.
type Queries = Vec<(u8, glow::Query)>;

/// Waits for queries. Returns the faces with each node in front.
fn answers(entered: &Entered<'_>, asked: &[OnFaces], queries: &[Queries]) -> Vec<u8> {
    let each = asked.iter().zip(queries);
    each.map(|(&(_, faces), queries)| {
        let hidden = queries
            .iter()
            .filter(|(_, query)| !is_visible(entered, *query))
            .fold(0, |bits, (bit, _)| bits | bit);
        faces & !hidden
    })
    .collect()
}

impl Scene {
    /// Lists the chunks possibly visible on each face, ascending, by frustum and occlusion: see [`crate::ask`].
    pub(crate) fn ask(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        at: Place<'_>,
        counters: &mut Counters,
    ) -> Result<[Vec<u32>; 5], BackendError> {
        for (query, place) in std::mem::take(&mut self.pending) {
            if is_visible(entered, query) {
                self.coherence.note(place);
            }
        }
        let hierarchy = Arc::clone(&self.hierarchy);
        let mut asking = self.begin_asking(at.hemicube, self.few);
        let marks = self.cull == Cull::Marks;
        if self.is_tried() {
            self.trial.triangles += self.triangles_in_view(at.hemicube);
        }
        self.begin_depths(entered, programs, at, true);
        self.queries_begun = 0;
        loop {
            let mut fresh: [Vec<u32>; 5] = Default::default();
            for (leaf, faces) in asking.fresh.drain(..) {
                add(&mut fresh, faces, hierarchy.nodes[leaf as usize].chunks.clone());
            }
            counters.triangles_transformed += fresh.iter().map(|list| self.triangles_of(list)).sum::<u64>();
            self.draw_lists(entered, at, &fresh);
            let asked = std::mem::take(&mut asking.asked);
            if asked.is_empty() {
                break;
            }
            let visible = if marks {
                self.mark(entered, programs, at, &asked, counters)?
            } else {
                let queries = self.query(entered, programs, at, &asked, counters)?;
                answers(entered, &asked, &queries)
            };
            self.begin_depths(entered, programs, at, false);
            asking.hear(&asked, &visible);
        }
        // Behind all that this hemicube sees, for the next one.
        let mut units = asking.units();
        units.retain(|&(place, _)| hierarchy.nodes[place as usize].triangles > self.few);
        let lists = if marks {
            let visible = self.mark(entered, programs, at, &units, counters)?;
            for (&(place, _), &faces) in units.iter().zip(&visible) {
                if faces != 0 {
                    self.coherence.note(place);
                }
            }
            asking.lists(Some((&units, &visible)))
        } else {
            let queries = self.query(entered, programs, at, &units, counters)?;
            for (&(place, faces), queries) in units.iter().zip(queries) {
                if queries.len() < faces.count_ones() as usize {
                    self.coherence.note(place);
                }
                self.pending
                    .extend(queries.into_iter().map(|(_, query)| (query, place)));
            }
            asking.lists(None)
        };
        self.note_lists(entered, &mut asking, &lists, at, counters);
        Ok(lists)
    }

    pub(crate) fn begin_asking(&mut self, hemicube: &Hemicube, few: u32) -> Asking {
        let planes = FacePlanes::new(hemicube, self.geometry.plane_tolerance);
        Asking::new(&self.hierarchy, planes, few, &mut self.coherence)
    }

    /// Counts drawn nodes and triangles, and marks drawn chunks for the search for sub-pixel patches.
    pub(crate) fn note_lists(
        &mut self,
        entered: &Entered<'_>,
        asking: &mut Asking,
        lists: &[Vec<u32>; 5],
        at: Place<'_>,
        counters: &mut Counters,
    ) {
        counters.nodes_tested += asking.walked.tested;
        counters.nodes_outside += asking.walked.outside;
        counters.nodes_hidden += asking.hidden;
        let triangles = lists.iter().map(|list| self.triangles_of(list)).sum::<u64>();
        counters.triangles_drawn += triangles;
        counters.triangles_transformed += triangles;
        if self.settings.covered {
            let mut marks = vec![0; FACES as usize * self.upload.chunks.len()];
            for (face, list) in lists.iter().enumerate() {
                for &chunk in list {
                    marks[face * self.upload.chunks.len() + chunk as usize] = 1;
                }
            }
            self.write(entered, self.store.drawn, at.layer as usize * marks.len(), &marks);
        }
    }

    /// The triangles of all chunks in view, once a face.
    fn triangles_in_view(&self, hemicube: &Hemicube) -> u64 {
        let planes = FacePlanes::new(hemicube, self.geometry.plane_tolerance);
        let mut triangles = 0;
        self.hierarchy
            .walk(0, ALL_FACES, &planes, &mut WalkCounters::default(), |place, faces| {
                let node = &self.hierarchy.nodes[place as usize];
                if node.is_leaf(place) {
                    triangles += u64::from(node.triangles * faces.count_ones());
                }
                Descend::Yes
            });
        triangles
    }

    fn triangles_of(&self, list: &[u32]) -> u64 {
        list.iter()
            .map(|&chunk| u64::from(self.upload.chunks[chunk as usize].index_count / 3))
            .sum()
    }

    /// Lists the asked-about nodes by face, for the shader. A node whose box contains the eye, or almost, is in front
    /// without a question: its faces are in `within`.
    fn list_boxes(&self, entered: &Entered<'_>, hemicube: &Hemicube, asked: &[OnFaces]) -> Boxes {
        let mut boxes = Boxes {
            within: vec![0; asked.len()],
            places: Vec::new(),
            ends: [0; 5],
        };
        let inside: Vec<bool> = asked
            .iter()
            .map(|&(place, _)| {
                let bounds = &self.hierarchy.nodes[place as usize].bounds;
                let away = (hemicube.origin - bounds.center).abs();
                // More than the shader's widening: an eye within sees the box from inside, or not at all.
                let far = away.length() + bounds.half.length();
                let wider = far * (1.0 / 64.0 + 32.0 / f64::from(self.settings.resolution));
                away.cmple(bounds.half + wider).all()
            })
            .collect();
        let mut words = Vec::new();
        for face in Face::ALL {
            let bit = 1u8 << face as u8;
            for (k, (&(place, faces), &inside)) in asked.iter().zip(&inside).enumerate() {
                if faces & bit == 0 {
                    continue;
                }
                if inside {
                    boxes.within[k] |= bit;
                } else {
                    boxes.places.push((k, bit));
                    words.push(place);
                }
            }
            boxes.ends[face as usize] = boxes.places.len();
        }
        if !words.is_empty() {
            self.write(entered, self.store.asked, 0, &words);
        }
        boxes
    }

    /// Makes the program for boxes current; depths are tested and not written.
    fn begin_boxes(&self, entered: &Entered<'_>, program: glow::Program) {
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            entered.gl.use_program(Some(program));
            entered.gl.bind_vertex_array(Some(self.store.no_vertices));
            entered.gl.depth_mask(false);
            // Boxes are wound inwards, and the eye is in none: culling fronts leaves the sides facing the eye.
            entered.gl.enable(glow::CULL_FACE);
            entered.gl.cull_face(glow::FRONT);
        }
    }

    /// Returns the faces with each node's box in front of the depths, by one draw of all boxes a face.
    fn mark(
        &self,
        entered: &Entered<'_>,
        programs: &Programs,
        at: Place<'_>,
        asked: &[OnFaces],
        counters: &mut Counters,
    ) -> Result<Vec<u8>, BackendError> {
        let boxes = self.list_boxes(entered, at.hemicube, asked);
        let mut visible = boxes.within;
        let words = boxes.places.len().div_ceil(32);
        if words == 0 {
            return Ok(visible);
        }
        entered.clear_words(self.store.marks.buffer, 0..words);
        self.begin_boxes(entered, programs.marks);
        let mut first = 0;
        for face in Face::ALL {
            let end = boxes.ends[face as usize];
            if end > first {
                self.begin_face(entered, at, face);
                let [corner, count] = [36 * first, 36 * (end - first)].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
                // SAFETY: as above; the shader finds the node of each corner in the list of the same length.
                unsafe { entered.gl.draw_arrays(glow::TRIANGLES, corner, count) };
            }
            first = end;
        }
        // SAFETY: the context is current.
        let fence = unsafe {
            entered
                .gl
                .memory_barrier(glow::CLIENT_MAPPED_BUFFER_BARRIER_BIT | glow::BUFFER_UPDATE_BARRIER_BIT);
            entered.gl.fence_sync(glow::SYNC_GPU_COMMANDS_COMPLETE, 0)
        };
        wait(entered, fence.map_err(BackendError::Internal)?)?;
        let marks = self.store.marks.read(0..words)?;
        counters.bytes_read_back += 4 * words as u64;
        for (number, &(k, bit)) in boxes.places.iter().enumerate() {
            if marks[number / 32] >> (number % 32) & 1 == 1 {
                visible[k] |= bit;
            }
        }
        Ok(visible)
    }

    /// Begins a hardware query of each node on each of its faces. No query means that the eye is in the box.
    fn query(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        at: Place<'_>,
        asked: &[OnFaces],
        counters: &mut Counters,
    ) -> Result<Vec<Queries>, BackendError> {
        let gl = entered.gl;
        let boxes = self.list_boxes(entered, at.hemicube, asked);
        let mut queries: Vec<Queries> = vec![Vec::new(); asked.len()];
        self.begin_boxes(entered, programs.boxes);
        let mut first = 0;
        for face in Face::ALL {
            let end = boxes.ends[face as usize];
            if end > first {
                self.begin_face(entered, at, face);
            }
            for place in first..end {
                let (k, bit) = boxes.places[place];
                let query = self.objects.query(entered, self.queries_begun)?;
                self.queries_begun += 1;
                counters.queries += 1;
                // SAFETY: the context is current; the shader finds the node of each corner in the list.
                unsafe {
                    gl.begin_query(glow::ANY_SAMPLES_PASSED, query);
                    gl.draw_arrays(glow::TRIANGLES, i32::try_from(36 * place).unwrap_or(i32::MAX), 36);
                    gl.end_query(glow::ANY_SAMPLES_PASSED);
                }
                queries[k].push((bit, query));
            }
            first = end;
        }
        Ok(queries)
    }
}

fn is_visible(entered: &Entered<'_>, query: glow::Query) -> bool {
    // SAFETY: the context is current, and the query was begun and ended in it.
    unsafe { entered.gl.get_query_parameter_u32(query, glow::QUERY_RESULT) != 0 }
}
