//! Occlusion culling from the host: which nodes of the hierarchy are in front of the depths drawn so far.
//!
//! Two queues, as in the thesis (Vázquez and Guartes 2017, §3.2). What the hemicube before saw is drawn at once, as
//! depths, and asked about behind all that this one sees, for the hemicube after. Of what it did not see, the topmost
//! nodes are asked about and waited for; of those that are in front, the children. Nodes of few triangles are drawn
//! unasked, and with them the node above is asked about.
//!
//! There are two ways of asking. *Queries* are hardware occlusion queries, one a node and face. *Marks* draws the boxes
//! of all nodes in one go, and fragments that pass the depth test set the node's bit: a software driver takes some 15
//! µs for a query, and for a box in a long draw less than one. The answers for the next hemicube are then there for
//! this one too, and the ids of what turned out to be hidden need not be drawn.

use crate::cull::{ALL_FACES, Descend, FacePlanes, Hierarchy, WalkCounters};
use std::ops::Range;
use std::sync::Arc;

/// A node, and the faces that it is drawn on or asked about.
pub(crate) type OnFaces = (u32, u8);

/// What the hemicube before saw: by node, whether its box was in front.
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

    /// Notes that a node is seen, for the hemicube after.
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
    /// Leaves to be drawn as depths before the next question.
    pub(crate) fresh: Vec<OnFaces>,
    /// Nodes to be asked about next.
    pub(crate) asked: Vec<OnFaces>,
    /// All leaves drawn, and the node that stands for each.
    drawn: Vec<(u32, u8, u32)>,
}

impl Asking {
    /// Begins with what the hemicube before saw.
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

    /// Sorts what is in view beneath a node into what is drawn and what is asked about. `found`: the node itself is
    /// known to be in front.
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

    /// Takes the faces on which each of `asked` is in front.
    pub(crate) fn hear(&mut self, asked: &[OnFaces], visible: &[u8]) {
        for (&(place, _), &faces) in asked.iter().zip(visible) {
            if faces == 0 {
                self.hidden += 1;
            } else {
                self.descend(place, faces, |_| false, true);
            }
        }
    }

    /// What stands for all that was drawn: asked about for the next hemicube.
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

    /// The chunks drawn on each face, ascending; only such as are in front, where the answers for `units` are known.
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
