//! Units of winding: surfaces of an object that join along edges which two of them run through in opposite ways.
//!
//! What is wound in one way is one unit, whatever the object holds besides: a building of a city that is one object, a
//! wall turned round in a room, a table beside a chair. An object of more than [`UNITS_MAX`] is one unit: leaves,
//! soups.

use super::enclosure::welded;
use crate::Model;
use glam::DVec3;
use hemicube_scene::{InputPatch, Patches, Side};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Most units of an object.
const UNITS_MAX: usize = 4096;

/// A unit, in the scene's coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unit {
    pub(super) object: u32,
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    pub(super) area: f64,
    /// Σ A n.
    pub(super) net: DVec3,
    /// Σ A x over the centroids x.
    pub(super) moment: DVec3,
    /// Every edge joins two of its surfaces.
    pub(super) is_closed: bool,
}

impl Unit {
    fn empty(object: u32) -> Self {
        Self {
            object,
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
            area: 0.0,
            net: DVec3::ZERO,
            moment: DVec3::ZERO,
            is_closed: true,
        }
    }

    fn add(&mut self, patches: &Patches, patch: InputPatch, is_open: bool) {
        for corner in patches.corners(patch) {
            self.low = self.low.min(corner);
            self.high = self.high.max(corner);
        }
        let area = patches.area(patch);
        self.area += area;
        self.net += area * patches.normal(patch);
        self.moment += area * patches.centroid(patch);
        self.is_closed &= !is_open;
    }
}

pub(super) struct Units {
    /// By triangle of the scene.
    of: Vec<u32>,
    list: Vec<Unit>,
}

/// An edge from one vertex to another, as a surface runs through it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    object: u32,
    ends: [u32; 2],
    is_reversed: bool,
    triangle: u32,
}

/// Disjoint sets of numbers from 0 on (Tarjan 1975), by halving paths.
pub(super) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// Each number by itself.
    pub(super) fn of(count: usize) -> Self {
        Self {
            parent: (0u32..).take(count).collect(),
        }
    }

    /// The least number of a set.
    pub(super) fn least(&mut self, of: u32) -> u32 {
        let parent = &mut self.parent;
        let mut at = of;
        while parent[at as usize] != at {
            let up = parent[parent[at as usize] as usize];
            parent[at as usize] = up;
            at = up;
        }
        at
    }

    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.least(a), self.least(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "patches are counted in 32 bits, and so are triangles"
)]
fn triangle_of(patches: &Patches, patch: InputPatch) -> u32 {
    patches.triangle(patch) as u32
}

fn fronts(patches: &Patches) -> impl Iterator<Item = InputPatch> {
    patches.iter().filter(|&patch| patches.side(patch) == Side::Front)
}

/// The edges of all surfaces, sorted, between welded corners.
fn edges(model: &Model, object: &impl Fn(InputPatch) -> u32) -> Vec<Edge> {
    let patches = model.patches();
    let mut vertices: HashMap<[i64; 3], u32> = HashMap::new();
    let mut edges = Vec::with_capacity(3 * patches.surfaces().len());
    for patch in fronts(patches) {
        let ids = patches.corners(patch).map(|corner| {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than three times the patches")]
            let next = vertices.len() as u32;
            *vertices.entry(welded(model, corner)).or_insert(next)
        });
        for (from, to) in [(ids[0], ids[1]), (ids[1], ids[2]), (ids[2], ids[0])] {
            edges.push(Edge {
                object: object(patch),
                ends: [from.min(to), from.max(to)],
                is_reversed: from > to,
                triangle: triangle_of(patches, patch),
            });
        }
    }
    edges.sort_unstable();
    edges
}

impl Units {
    /// Finds the units of a scene: n log n time and memory of some 100 bytes a surface.
    pub(super) fn of(model: &Model, object: &impl Fn(InputPatch) -> u32) -> Self {
        let patches = model.patches();
        let count = fronts(patches)
            .map(|patch| patches.triangle(patch) + 1)
            .max()
            .unwrap_or(0);
        let mut sets = Sets::of(count);
        let mut is_open = vec![false; count];
        for same in edges(model, object).chunk_by(|a, b| (a.object, a.ends) == (b.object, b.ends)) {
            match same {
                [a, b] if a.is_reversed != b.is_reversed => sets.join(a.triangle, b.triangle),
                _ => same.iter().for_each(|edge| is_open[edge.triangle as usize] = true),
            }
        }
        // The least triangle of each set, by object.
        let mut roots: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for patch in fronts(patches) {
            let own = triangle_of(patches, patch);
            if sets.least(own) == own {
                roots.entry(object(patch)).or_default().insert(own);
            }
        }
        let mut place: HashMap<u32, u32> = HashMap::new();
        let mut list = Vec::new();
        for (object, own) in roots {
            let is_one = own.len() > UNITS_MAX;
            for (number, root) in own.into_iter().enumerate() {
                if !is_one || number == 0 {
                    list.push(Unit::empty(object));
                }
                #[allow(clippy::cast_possible_truncation, reason = "no more than triangles")]
                place.insert(root, list.len() as u32 - 1);
            }
        }
        let of: Vec<u32> = (0u32..)
            .take(count)
            .map(|own| place.get(&sets.least(own)).copied().unwrap_or(u32::MAX))
            .collect();
        for patch in fronts(patches) {
            let own = patches.triangle(patch);
            list[of[own] as usize].add(patches, patch, is_open[own]);
        }
        Self { of, list }
    }

    pub(super) fn of_triangle(&self, triangle: usize) -> u32 {
        self.of.get(triangle).copied().unwrap_or(u32::MAX)
    }

    pub(super) fn get(&self, unit: u32) -> &Unit {
        &self.list[unit as usize]
    }

    /// All, by number.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, &Unit)> {
        (0u32..).zip(&self.list)
    }
}
