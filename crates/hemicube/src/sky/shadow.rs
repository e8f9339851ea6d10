//! The part of a patch that a sun reaches, without rays: along the sun, each occluder hides a convex polygon of the
//! patch, and these are cut out of it one after another. What is left is lit, exactly but for rounding.
//!
//! A sun's *view* has the box of each surface in a plane across the sun's direction, and a grid of cells with the
//! surfaces whose boxes touch them. A patch looks at the cells of its own box alone. A year of hours asks for millions
//! of pairs of a patch and a sun, and most of them have few occluders or none.
//!
//! An occluder is what rays would meet ([`crate::reference::Reference::is_open`]): surfaces in or below the patch's plane
//! and its own surface hide nothing, of others only the part in front of the plane does, and backs hide, too.

use crate::Model;
use crate::frame;
use crate::geometry::{self, Polygon, in_front};
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::whole;

/// Cells along an edge of a view's grid, at most.
const CELLS_MOST: u32 = 512;
/// Bound of a view's entries: so many a surface, and so many more. Surfaces that cover one another by the thousand would
/// fill cells with all of them; rays find those.
const ENTRIES: [u64; 2] = [16, 1 << 20];
/// Bound of the pieces that a patch is cut into: beyond, rays are cheaper.
const PIECES_MOST: usize = 96;
/// Corners of a piece. Each cut adds one at most; pieces with more are left to rays.
const CORNERS: usize = 16;
/// Distance in normalised units up to which a corner lies on a plane of a cut.
const SLACK: f64 = 1e-13;
/// Pieces below this share of the patch are no longer looked at.
const SLIVER: f64 = 1e-9;

type Piece = Polygon<CORNERS>;

/// What a sun sees of the scene: boxes of the surfaces across its direction.
#[derive(Debug)]
pub(super) struct View {
    sun: DVec3,
    axes: [DVec3; 2],
    boxes: Vec<Flat>,
    low: [f64; 2],
    /// Cells per length.
    scale: [f64; 2],
    /// Cells along an edge.
    edge: u32,
    /// Where the surfaces of each cell begin in `items`.
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// A surface across a sun's direction.
#[derive(Clone, Copy, Debug)]
struct Flat {
    low: [f64; 2],
    high: [f64; 2],
    /// Its least and greatest coordinate towards the sun.
    along: [f64; 2],
}

impl Flat {
    fn of(corners: &[DVec3; 3], axes: &[DVec3; 2], sun: DVec3) -> Self {
        let range = |axis: DVec3| {
            let [a, b, c] = corners.map(|corner| axis.dot(corner));
            [a.min(b).min(c), a.max(b).max(c)]
        };
        let ([x0, x1], [y0, y1]) = (range(axes[0]), range(axes[1]));
        Self {
            low: [x0, y0],
            high: [x1, y1],
            along: range(sun),
        }
    }
}

impl View {
    /// The view of a sun in this direction, of length 1. `None` for a direction without length, and where cells would
    /// hold more than [`ENTRIES`].
    pub(super) fn new(model: &Model, sun: DVec3) -> Option<Self> {
        let [u, v, sun] = frame::axes_of(sun, 0.0)?;
        let axes = [u, v];
        let surfaces = &model.geometry().surfaces;
        let boxes: Vec<Flat> = surfaces.iter().map(|of| Flat::of(&of.corners, &axes, sun)).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for flat in &boxes {
            for axis in 0..2 {
                low[axis] = low[axis].min(flat.low[axis]);
                high[axis] = high[axis].max(flat.high[axis]);
            }
        }
        let edge = whole::to_u32((boxes.len() as f64).sqrt().ceil()).clamp(1, CELLS_MOST);
        let scale = [0, 1].map(|axis| {
            let width: f64 = high[axis] - low[axis];
            if width > 0.0 { f64::from(edge) / width } else { 0.0 }
        });
        let mut view = Self {
            sun,
            axes,
            boxes,
            low,
            scale,
            edge,
            starts: vec![0; (edge * edge + 1) as usize],
            items: Vec::new(),
        };
        let most = ENTRIES[0] * view.boxes.len() as u64 + ENTRIES[1];
        let mut entries = 0;
        for flat in &view.boxes {
            for cell in view.cells(flat) {
                view.starts[cell + 1] += 1;
                entries += 1;
            }
            if entries > most {
                return None;
            }
        }
        for cell in 1..view.starts.len() {
            view.starts[cell] += view.starts[cell - 1];
        }
        let mut next = view.starts.clone();
        view.items = vec![0; next.last().map_or(0, |&end| end as usize)];
        for (surface, flat) in (0..).zip(&view.boxes) {
            for cell in view.cells(flat) {
                view.items[next[cell] as usize] = surface;
                next[cell] += 1;
            }
        }
        Some(view)
    }

    /// The cells that a box touches.
    fn cells(&self, flat: &Flat) -> impl Iterator<Item = usize> + use<> {
        let edge = self.edge;
        let cell =
            |axis: usize, at: f64| whole::to_u32(((at - self.low[axis]) * self.scale[axis]).max(0.0)).min(edge - 1);
        let [columns, rows] = [0, 1].map(|axis| cell(axis, flat.low[axis])..=cell(axis, flat.high[axis]));
        rows.flat_map(move |row| columns.clone().map(move |column| (row * edge + column) as usize))
    }

    /// Number of surfaces of a view.
    pub(super) fn surfaces(model: &Model) -> usize {
        model.geometry().surfaces.len()
    }
}

/// A patch that suns shine on, in normalised coordinates.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    corners: [DVec3; 3],
    normal: DVec3,
    surface: usize,
}

impl Facet {
    /// `None` for a patch without area.
    pub(super) fn new(model: &Model, patch: InputPatch) -> Option<Self> {
        let corners = model.normalised_corners(patch.0);
        let [_, _, normal] = frame::axes(corners, 0.0)?;
        (geometry::area(&corners) > 0.0).then(|| Self {
            corners,
            normal,
            surface: model.patches().surface(patch),
        })
    }
}

/// Room for cuts, of one thread.
#[derive(Debug)]
pub(super) struct Cutter {
    /// The number of the last patch that each surface was looked at for.
    seen: Vec<u32>,
    turn: u32,
    pieces: Pieces,
    left: Pieces,
    /// What of a piece is inside of some edges, and of the next one, too.
    inside: [Piece; 2],
}

/// Pieces of a patch, in places that are used again: a piece has 400 bytes, and most have three to five corners.
#[derive(Debug, Default)]
struct Pieces {
    places: Vec<Piece>,
    count: usize,
}

impl Pieces {
    fn all(&self) -> &[Piece] {
        &self.places[..self.count]
    }

    /// The place of the next piece, whose corners are those of an earlier use.
    fn next(&mut self) -> &mut Piece {
        if self.count == self.places.len() {
            self.places.push(Piece::EMPTY);
        }
        self.count += 1;
        &mut self.places[self.count - 1]
    }

    fn push(&mut self, piece: &Piece) {
        self.next().copy(piece.corners());
    }
}

/// Planes along the sun through the edges of an occluder, inwards: unit normals and offsets.
#[derive(Debug)]
struct Edges {
    planes: [(DVec3, f64); 4],
    count: usize,
}

impl Edges {
    /// `None` for an occluder that the sun sees edge-on.
    fn new(occluder: &[DVec3], sun: DVec3) -> Option<Self> {
        let across = normal_of(occluder).dot(sun);
        let mut edges = Self {
            planes: [(DVec3::ZERO, 0.0); 4],
            count: 0,
        };
        if across == 0.0 {
            return None;
        }
        for (place, &from) in occluder.iter().enumerate() {
            let to = occluder[(place + 1) % occluder.len()];
            if let Some(normal) = (sun.cross(to - from) * across.signum()).try_normalize() {
                edges.planes[edges.count] = (normal, normal.dot(from));
                edges.count += 1;
            }
        }
        Some(edges)
    }

    fn planes(&self) -> &[(DVec3, f64)] {
        &self.planes[..self.count]
    }

    /// Returns whether all corners of a piece lie beyond one edge.
    fn are_beside(&self, corners: &[DVec3]) -> bool {
        self.planes().iter().any(|&plane| are_beyond(plane, corners))
    }
}

/// Returns whether no corner lies in front of a plane.
fn are_beyond((normal, offset): (DVec3, f64), corners: &[DVec3]) -> bool {
    corners.iter().all(|&corner| normal.dot(corner) - offset <= SLACK)
}

impl Cutter {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            seen: vec![0; View::surfaces(model)],
            turn: 0,
            pieces: Pieces::default(),
            left: Pieces::default(),
            inside: [Piece::EMPTY; 2],
        }
    }

    /// The share of a patch that a sun in front of it reaches; `None` where that takes too many pieces.
    pub(super) fn lit(&mut self, model: &Model, view: &View, facet: &Facet) -> Option<f64> {
        if self.turn == u32::MAX {
            self.seen.fill(0);
            self.turn = 0;
        }
        self.turn += 1;
        let geometry = model.geometry();
        let own = Flat::of(&facet.corners, &view.axes, view.sun);
        let walls = walls(&facet.corners, view.sun);
        let whole = geometry::area(&facet.corners);
        self.pieces.count = 0;
        self.pieces.next().copy(&facet.corners);
        for cell in view.cells(&own) {
            for &surface in &view.items[view.starts[cell] as usize..view.starts[cell + 1] as usize] {
                let surface = surface as usize;
                if std::mem::replace(&mut self.seen[surface], self.turn) == self.turn {
                    continue;
                }
                let other = &view.boxes[surface];
                let is_apart = |axis: usize| other.high[axis] <= own.low[axis] || own.high[axis] <= other.low[axis];
                if other.along[1] <= own.along[0] || is_apart(0) || is_apart(1) {
                    continue;
                }
                let of = &geometry.surfaces[surface];
                if walls.iter().any(|&wall| are_beyond(wall, &of.corners)) {
                    continue;
                }
                if model.patches().surface(of.front) == facet.surface {
                    continue;
                }
                let front = in_front(&of.corners, facet.corners[0], facet.normal, geometry.plane_tolerance);
                let Some(front) = front else { continue };
                // Of an occluder through the patch's plane, the part in front of it.
                if walls.iter().any(|&wall| are_beyond(wall, front.corners())) {
                    continue;
                }
                let Some(edges) = Edges::new(front.corners(), view.sun) else {
                    continue;
                };
                if edges.are_beside(&facet.corners) {
                    continue;
                }
                self.cut(&edges, SLIVER * whole)?;
                if self.pieces.count == 0 {
                    return Some(0.0);
                }
            }
        }
        let left: f64 = self.pieces.all().iter().map(|piece| area(piece.corners())).sum();
        Some((left / whole).min(1.0))
    }

    /// Takes what an occluder hides along the sun away from all pieces; `None` where there are too many.
    fn cut(&mut self, edges: &Edges, least: f64) -> Option<()> {
        let is_met = |piece: &Piece| !edges.are_beside(piece.corners());
        if !self.pieces.all().iter().any(is_met) {
            return Some(());
        }
        self.left.count = 0;
        for piece in self.pieces.all() {
            if !is_met(piece) {
                self.left.push(piece);
                continue;
            }
            // Parts outside of the edges so far; they count only where something is left inside of all.
            let first = self.left.count;
            let [one, other] = &mut self.inside;
            let (mut inside, mut within) = (one, other);
            inside.copy(piece.corners());
            for &(normal, offset) in edges.planes() {
                if inside.len() + 1 >= CORNERS {
                    return None;
                }
                if inside
                    .corners()
                    .iter()
                    .all(|&corner| normal.dot(corner) - offset >= -SLACK)
                {
                    continue;
                }
                let without = self.left.next();
                inside.split_into(normal, offset, SLACK, within, without);
                if without.len() < 3 || area(without.corners()) <= least {
                    self.left.count -= 1;
                }
                std::mem::swap(&mut inside, &mut within);
                if inside.len() < 3 {
                    break;
                }
            }
            if inside.len() < 3 || area(inside.corners()) <= least {
                self.left.count = first;
                self.left.push(piece);
            }
            if self.left.count > PIECES_MOST {
                return None;
            }
        }
        std::mem::swap(&mut self.pieces, &mut self.left);
        Some(())
    }
}

/// The planes along the sun through the edges of a triangle that faces it, inwards: normal and offset.
fn walls(corners: &[DVec3; 3], sun: DVec3) -> [(DVec3, f64); 3] {
    [0, 1, 2].map(|place| {
        let (from, to) = (corners[place], corners[(place + 1) % 3]);
        let normal = sun.cross(to - from).normalize_or_zero();
        (normal, normal.dot(from))
    })
}

/// Twice the area of a plane polygon, across it.
fn normal_of(corners: &[DVec3]) -> DVec3 {
    let Some((&first, rest)) = corners.split_first() else {
        return DVec3::ZERO;
    };
    rest.windows(2)
        .map(|pair| (pair[0] - first).cross(pair[1] - first))
        .sum()
}

fn area(corners: &[DVec3]) -> f64 {
    0.5 * normal_of(corners).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::of_triangles;

    /// A stack of plates that all cover one another takes no memory out of proportion.
    #[test]
    fn a_stack_of_thousands_of_plates_is_left_to_rays() {
        let plate = |height: f64| {
            let p = |x, y| DVec3::new(x, y, height);
            [p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0)]
        };
        for (plates, is_viewed) in [(100, true), (6_000, false)] {
            let model = of_triangles(
                &(0..plates)
                    .map(|k| (plate(f64::from(k) * 1e-3), true))
                    .collect::<Vec<_>>(),
            );
            assert_eq!(View::new(&model, DVec3::Z).is_some(), is_viewed, "{plates}");
        }
    }
}
