//! Units of winding: surfaces of an object that join along edges which two of them run through in opposite ways.
//!
//! What is wound in one way is one unit, whatever the object holds besides: a building of a city that is one object, a
//! wall turned round in a room, a table beside a chair. An object of more than [`UNITS_MAX`] is one unit: leaves,
//! soups.

use super::enclosure::welded;
use crate::Model;
use glam::DVec3;
use hemicube_scene::{InputPatch, Side};
use std::collections::{BTreeMap, HashMap};

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

fn root(parent: &mut [u32], of: u32) -> u32 {
    let mut at = of;
    while parent[at as usize] != at {
        let up = parent[parent[at as usize] as usize];
        parent[at as usize] = up;
        at = up;
    }
    at
}

impl Units {
    pub(super) fn of(model: &Model, object: &impl Fn(InputPatch) -> u32) -> Self {
        let patches = model.patches();
        let fronts = || patches.iter().filter(|&patch| patches.side(patch) == Side::Front);
        let count = fronts().map(|patch| patches.triangle(patch) + 1).max().unwrap_or(0);
        #[allow(
            clippy::cast_possible_truncation,
            reason = "patches are counted in 32 bits, and so are triangles"
        )]
        let triangle = |patch| patches.triangle(patch) as u32;
        let mut objects = vec![0; count];
        let mut vertices: HashMap<[i64; 3], u32> = HashMap::new();
        let mut edges = Vec::with_capacity(3 * patches.surfaces().len());
        for patch in fronts() {
            objects[patches.triangle(patch)] = object(patch);
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
                    triangle: triangle(patch),
                });
            }
        }
        drop(vertices);
        edges.sort_unstable();
        let mut parent: Vec<u32> = (0u32..).take(count).collect();
        let mut is_open = vec![false; count];
        for same in edges.chunk_by(|a, b| (a.object, a.ends) == (b.object, b.ends)) {
            match same {
                [a, b] if a.is_reversed != b.is_reversed => {
                    let (a, b) = (root(&mut parent, a.triangle), root(&mut parent, b.triangle));
                    parent[a.max(b) as usize] = a.min(b);
                }
                _ => same.iter().for_each(|edge| is_open[edge.triangle as usize] = true),
            }
        }
        drop(edges);
        let mut roots: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for patch in fronts() {
            let own = triangle(patch);
            if root(&mut parent, own) == own {
                roots.entry(objects[own as usize]).or_default().push(own);
            }
        }
        // The first triangle of an object of too many units stands for all.
        let mut place: HashMap<u32, u32> = HashMap::new();
        let mut list = Vec::new();
        for (&object, own) in &mut roots {
            own.sort_unstable();
            own.dedup();
            let is_one = own.len() > UNITS_MAX;
            for &root in own.iter() {
                if !is_one || root == own[0] {
                    list.push(Unit {
                        object,
                        low: DVec3::INFINITY,
                        high: DVec3::NEG_INFINITY,
                        area: 0.0,
                        net: DVec3::ZERO,
                        moment: DVec3::ZERO,
                        is_closed: true,
                    });
                }
                #[allow(clippy::cast_possible_truncation, reason = "no more than triangles")]
                place.insert(root, list.len() as u32 - 1);
            }
        }
        let of: Vec<u32> = (0u32..)
            .take(count)
            .map(|own| place.get(&root(&mut parent, own)).copied().unwrap_or(u32::MAX))
            .collect();
        for patch in fronts() {
            let own = patches.triangle(patch);
            let unit: &mut Unit = &mut list[of[own] as usize];
            for corner in patches.corners(patch) {
                unit.low = unit.low.min(corner);
                unit.high = unit.high.max(corner);
            }
            let area = patches.area(patch);
            unit.area += area;
            unit.net += area * patches.normal(patch);
            unit.moment += area * patches.centroid(patch);
            unit.is_closed &= !is_open[own];
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
