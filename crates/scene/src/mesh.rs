//! Meshes of numerical programs: nodes, and cells of a few shapes. Surface cells become faces; a mesh without any has
//! the faces that belong to one volume cell only.
//!
//! Corners are in the order of VTK, which is Gmsh's and CalculiX's for these shapes. The sides of a volume cell are in
//! CalculiX's order (S1 to S6), and are turned out of the cell by its centroid, because programs differ in the
//! orientation of wedges.
//!
//! # Second order
//! A side whose mid-side nodes lie on its straight edges is the side of its corners. A curved one is cut by them: a
//! triangle into two to four; a quadrilateral into two where two opposite edges are curved, otherwise into a fan about
//! its centre: its own node, or that of the serendipity shape functions, ½ Σ mids − ¼ Σ corners (Zienkiewicz & Taylor,
//! *The Finite Element Method*, vol. 1, ch. 8). Neighbours judge an edge alike, so no gap opens between them.

use crate::bounds::Bounds;
use crate::names::Names;
use crate::polygon::{Labels, cut_face, push_triangles};
use crate::{Error, ErrorKind, Fate, Kind, Ledger, Material, Scene, Triangle};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};

/// No node on an edge.
pub(crate) const NO_NODE: u32 = u32::MAX;
/// Distance of a mid-side node from its straight edge, by the edge's length, up to which the edge is straight: well
/// above the rounding of files with seven digits. Larger leaves out bows, smaller cuts straight sides for nothing.
const STRAIGHT: f64 = 1e-6;

/// Elements of third and higher order.
#[cfg(any(feature = "gmsh", feature = "vtk"))]
pub(crate) const HIGHER: Kind<'static> = Kind {
    fate: Fate::Approximated,
    what: "element of higher order, read by its corners",
    next: "save the mesh with elements of first or second order",
};
/// Elements whose mid-side nodes are used.
pub(crate) const SECOND: &str = "element of second order, cut by its mid-side nodes where they are off its edges";

/// The shape of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// A triangle, a quadrilateral, or a polygon of more corners.
    Polygon,
    Tetrahedron,
    Pyramid,
    Wedge,
    Hexahedron,
}

impl Shape {
    /// Number of corners; of polygons none is fixed.
    fn corner_count(self) -> Option<usize> {
        match self {
            Self::Polygon => None,
            Self::Tetrahedron => Some(4),
            Self::Pyramid => Some(5),
            Self::Wedge => Some(6),
            Self::Hexahedron => Some(8),
        }
    }

    /// The ends of each edge of a volume cell, in the order of VTK's and CalculiX's mid-side nodes.
    pub(crate) fn edges(self) -> &'static [[usize; 2]] {
        match self {
            Self::Polygon => &[],
            Self::Tetrahedron => &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]],
            Self::Pyramid => &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]],
            Self::Wedge => &[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]],
            #[rustfmt::skip]
            Self::Hexahedron => &[
                [0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7],
            ],
        }
    }

    /// The corners of each side of a volume cell.
    pub(crate) fn sides(self) -> &'static [&'static [usize]] {
        match self {
            Self::Polygon => &[],
            Self::Tetrahedron => &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[2, 0, 3]],
            Self::Pyramid => &[&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]],
            Self::Wedge => &[&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]],
            Self::Hexahedron => &[
                &[0, 3, 2, 1],
                &[4, 5, 6, 7],
                &[0, 1, 5, 4],
                &[1, 2, 6, 5],
                &[2, 3, 7, 6],
                &[3, 0, 4, 7],
            ],
        }
    }
}

struct Cell {
    shape: Shape,
    /// The place of its first corner; its last node is before the next cell's.
    first: u32,
    /// Mid-side nodes follow its corners, and in a polygon the node at the centre may follow these.
    is_second: bool,
    labels: Labels,
}

/// A mesh while it is read.
#[derive(Default)]
pub(crate) struct Mesh {
    pub(crate) nodes: Vec<DVec3>,
    pub(crate) objects: Names,
    pub(crate) materials: Names,
    pub(crate) ledger: Ledger,
    /// Further names of objects whose name is of several.
    further: BTreeMap<u32, Vec<String>>,
    cells: Vec<Cell>,
    /// Corners and mid-side nodes.
    corners: Vec<u32>,
}

/// A face of a cell.
#[derive(Default)]
struct Face {
    corners: Vec<u32>,
    /// The node on the edge after each corner; empty without any.
    mids: Vec<u32>,
    centre: Option<u32>,
}

impl Mesh {
    /// Adds a cell of first order; `labels.face` rises from cell to cell.
    #[cfg(feature = "vtk")]
    pub(crate) fn push(&mut self, shape: Shape, corners: &[u32], labels: Labels) -> Result<(), Error> {
        self.push_second(shape, corners, &[], None, labels)
    }

    /// Adds a cell with a node for each of its edges, of a polygon the edge after each corner, or [`NO_NODE`]; none
    /// for a cell of first order. A polygon may have one at its centre.
    pub(crate) fn push_second(
        &mut self,
        shape: Shape,
        corners: &[u32],
        mids: &[u32],
        centre: Option<u32>,
        labels: Labels,
    ) -> Result<(), Error> {
        let first = u32::try_from(self.corners.len()).map_err(|_| {
            Error::new(ErrorKind::TooLarge(
                "has more corners of cells than can be numbered".to_owned(),
            ))
        })?;
        self.corners.extend_from_slice(corners);
        self.corners.extend_from_slice(mids);
        if !mids.is_empty() {
            self.corners.extend(centre);
            self.ledger.note(SECOND);
        }
        self.cells.push(Cell {
            shape,
            first,
            is_second: !mids.is_empty(),
            labels,
        });
        Ok(())
    }

    /// The number of an object by its names, the first of which shows.
    #[cfg(any(feature = "gmsh", feature = "abaqus"))]
    pub(crate) fn object(&mut self, names: &[String]) -> Result<u32, Error> {
        let [first, others @ ..] = names else {
            return self.objects.number("");
        };
        if others.is_empty() {
            return self.objects.number(first);
        }
        let number = self.objects.number(&names.join(BETWEEN))?;
        self.further.insert(number, names.to_vec());
        Ok(number)
    }

    /// The names of an object.
    #[cfg(feature = "gmsh")]
    fn names_of(&self, object: u32) -> Vec<String> {
        let one = || self.objects.names.get(object as usize).cloned().into_iter().collect();
        self.further.get(&object).cloned().unwrap_or_else(one)
    }

    /// Makes one of surface cells that a file lists once for each of their groups: of the names of all of them.
    #[cfg(feature = "gmsh")]
    pub(crate) fn merge_groups(&mut self) -> Result<(), Error> {
        // By their least corner first, with their winding.
        let key = |cell: usize| {
            let mut corners = self.corners(cell).to_vec();
            let least = (0..corners.len()).min_by_key(|&at| corners[at]).unwrap_or(0);
            corners.rotate_left(least);
            corners
        };
        let surfaces = (0..self.cells.len()).filter(|&cell| self.cells[cell].shape == Shape::Polygon);
        let mut sorted: Vec<(Vec<u32>, usize)> = surfaces.map(|cell| (key(cell), cell)).collect();
        sorted.sort_unstable();
        let mut into: HashMap<usize, usize> = HashMap::new();
        let mut named: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for same in sorted.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
            let kept = same[0].1;
            let mut objects = vec![self.cells[kept].labels.object];
            for &(_, cell) in &same[1..] {
                // A copy in the same group is a double of it, which repair drops.
                let object = self.cells[cell].labels.object;
                if !objects.contains(&object) {
                    objects.push(object);
                    into.insert(cell, kept);
                }
            }
            if objects.len() > 1 {
                named.insert(kept, objects);
            }
        }
        for (kept, objects) in named {
            let names: Vec<String> = objects.iter().flat_map(|&object| self.names_of(object)).collect();
            self.cells[kept].labels.object = self.object(&names)?;
        }
        self.ledger.note_many(
            "copy of an element for a further group, which is a name of it",
            into.len() as u64,
        );
        if into.is_empty() {
            return Ok(());
        }
        let old = std::mem::take(&mut self.cells);
        let old_corners = std::mem::take(&mut self.corners);
        let end = |at: usize| old.get(at + 1).map_or(old_corners.len(), |next| next.first as usize);
        for (at, cell) in old.iter().enumerate() {
            if !into.contains_key(&at) {
                let first = u32::try_from(self.corners.len()).unwrap_or(NO_NODE);
                self.corners
                    .extend_from_slice(&old_corners[cell.first as usize..end(at)]);
                self.cells.push(Cell { first, ..*cell });
            }
        }
        Ok(())
    }

    /// All nodes of a cell: corners, then those on edges.
    fn nodes_of(&self, cell: usize) -> &[u32] {
        let first = self.cells.get(cell).map_or(0, |cell| cell.first as usize);
        let end = self
            .cells
            .get(cell + 1)
            .map_or(self.corners.len(), |next| next.first as usize);
        self.corners.get(first..end).unwrap_or_default()
    }

    /// Number of corners among the nodes of a cell.
    fn corner_count(&self, cell: usize) -> usize {
        let all = self.nodes_of(cell).len();
        match self.cells.get(cell) {
            Some(Cell { is_second: false, .. }) | None => all,
            Some(of) => of.shape.corner_count().unwrap_or(all / 2),
        }
    }

    /// The corners of a cell, as indices of nodes.
    fn corners(&self, cell: usize) -> &[u32] {
        self.nodes_of(cell).get(..self.corner_count(cell)).unwrap_or_default()
    }

    /// A surface cell as a face.
    fn polygon(&self, cell: usize) -> Face {
        let nodes = self.nodes_of(cell);
        let count = self.corner_count(cell);
        let (corners, rest) = nodes.split_at(count.min(nodes.len()));
        let (mids, centre) = rest.split_at(count.min(rest.len()));
        Face {
            corners: corners.to_vec(),
            mids: mids.to_vec(),
            centre: centre.first().copied(),
        }
    }

    fn node(&self, index: u32) -> DVec3 {
        self.nodes.get(index as usize).copied().unwrap_or(DVec3::NAN)
    }

    /// The corners of a side, turned round if it faces into its cell, whose corners are `all`.
    pub(crate) fn outward(&self, side: &[u32], all: &[u32]) -> Vec<u32> {
        let point = |&corner: &u32| self.node(corner);
        let middle = |corners: &[u32]| corners.iter().map(point).sum::<DVec3>() / corners.len() as f64;
        let mut corners = side.to_vec();
        let from = side.first().map_or(DVec3::ZERO, point);
        let edge = |two: &[u32]| (self.node(two[0]) - from).cross(self.node(two[1]) - from);
        let normal: DVec3 = side.windows(2).map(edge).sum();
        if normal.dot(middle(side) - middle(all)) < 0.0 {
            corners.reverse();
        }
        corners
    }

    /// A side of a volume cell that faces out of it.
    fn side(&self, cell: usize, side: usize) -> Face {
        let shape = self.cells[cell].shape;
        let (all, nodes) = (self.corners(cell), self.nodes_of(cell));
        let mids = nodes.get(all.len()..).unwrap_or_default();
        let numbers = shape.sides()[side];
        let corners: Vec<u32> = numbers.iter().filter_map(|&n| all.get(n).copied()).collect();
        let outward = self.outward(&corners, all);
        let mut face = Face {
            mids: Vec::new(),
            centre: None,
            corners,
        };
        if !mids.is_empty() {
            let mid = |at: usize| {
                let ends = [numbers[at], numbers[(at + 1) % numbers.len()]];
                let is = |edge: &[usize; 2]| *edge == ends || *edge == [ends[1], ends[0]];
                let edge = shape.edges().iter().position(is);
                edge.and_then(|edge| mids.get(edge).copied()).unwrap_or(NO_NODE)
            };
            face.mids = (0..numbers.len()).map(mid).collect();
        }
        if outward != face.corners {
            face.reverse();
        }
        face
    }

    /// Adds a face to a scene's.
    fn add(&self, face: &Face, labels: Labels, faces: &mut Faces) -> Result<(), Error> {
        let corners: Vec<DVec3> = face.corners.iter().map(|&corner| self.node(corner)).collect();
        if face.mids.is_empty() {
            return faces.add(&corners, labels);
        }
        let count = corners.len();
        let curved = |at: usize| {
            // From the lower number, so that both neighbours come to the same bits.
            let (from, to) = (face.corners[at], face.corners[(at + 1) % count]);
            let (from, to) = (from.min(to), from.max(to));
            let mid = face.mids[at];
            let point = self.nodes.get(mid as usize).copied()?;
            let (from, edge) = (self.node(from), self.node(to) - self.node(from));
            let along = (point - from).dot(edge) / edge.length_squared();
            let off = (point - from).reject_from(edge).length();
            (!(off <= STRAIGHT * edge.length() && along > 0.0 && along < 1.0)).then_some(point)
        };
        let mids: Vec<Option<DVec3>> = (0..count).map(curved).collect();
        let centre = face.centre.map(|centre| self.node(centre));
        faces.add_curved(&corners, &mids, centre, labels)
    }

    /// The sides of volume cells that no second cell has, as cells and sides in their order.
    pub(crate) fn boundary(&self) -> Vec<(usize, usize)> {
        let mut sides = Vec::new();
        for (number, cell) in self.cells.iter().enumerate() {
            let corners = self.corners(number);
            for (side, numbers) in cell.shape.sides().iter().enumerate() {
                let mut key = [u32::MAX; 4];
                for (place, &n) in key.iter_mut().zip(*numbers) {
                    *place = corners.get(n).copied().unwrap_or(u32::MAX);
                }
                // A collapsed side repeats corners, and its neighbour may have a triangle in its place.
                key.sort_unstable();
                for at in 1..4 {
                    if key[at] == key[at - 1] {
                        key[at - 1..].rotate_left(1);
                        key[3] = u32::MAX;
                    }
                }
                if key[2] != u32::MAX {
                    #[allow(
                        clippy::cast_possible_truncation,
                        reason = "`push` counts corners in u32, and sides are six"
                    )]
                    sides.push((key, number as u32, side as u8));
                }
            }
        }
        sides.sort_unstable();
        let alone = sides.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
        let mut alone: Vec<(usize, usize)> = alone.flatten().map(|side| (side.1 as usize, side.2 as usize)).collect();
        alone.sort_unstable();
        alone
    }

    /// Number of cells.
    #[cfg(feature = "abaqus")]
    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The shape of a cell.
    #[cfg(feature = "abaqus")]
    pub(crate) fn shape(&self, cell: usize) -> Option<Shape> {
        self.cells.get(cell).map(|cell| cell.shape)
    }

    /// The scene of the surface cells, or of the boundary of the volume cells.
    pub(crate) fn scene(mut self, bounds: Bounds) -> Result<Scene, Error> {
        let mut faces = Faces::new(bounds, std::mem::take(&mut self.ledger));
        let is_surface = |cell: &Cell| cell.shape == Shape::Polygon;
        let surfaces = self.cells.iter().filter(|cell| is_surface(cell)).count();
        if surfaces > 0 {
            let corners = (0..self.cells.len()).filter(|&cell| is_surface(&self.cells[cell]));
            let corners = corners.map(|cell| self.corners(cell).len().saturating_sub(2));
            faces.triangles.reserve_exact(corners.sum());
            let volumes = (self.cells.len() - surfaces) as u64;
            faces
                .ledger
                .note_many("volume cell beside surface cells, not used", volumes);
            if volumes > 0 {
                self.find_uncovered(&mut faces.ledger);
            }
            for (number, cell) in self.cells.iter().enumerate() {
                if is_surface(cell) {
                    self.add(&self.polygon(number), cell.labels, &mut faces)?;
                }
            }
        } else if !self.cells.is_empty() {
            let boundary = self.boundary();
            faces.triangles.reserve(boundary.len());
            faces.ledger.warnings.push(format!(
                "there are no surface cells: {} faces that belong to one volume cell only are taken, and face out of \
                 it; turn them round if what radiates surrounds the volume that is meshed",
                boundary.len()
            ));
            for (face, (cell, side)) in (0..).zip(boundary) {
                let labels = Labels {
                    face,
                    ..self.cells[cell].labels
                };
                self.add(&self.side(cell, side), labels, &mut faces)?;
            }
        }
        Ok(faces.scene(self.objects, self.further, self.materials))
    }

    /// Records sides on the boundary of the volume cells that no surface cell covers: the surfaces are not whole.
    fn find_uncovered(&self, ledger: &mut Ledger) {
        let sorted = |mut corners: Vec<u32>| {
            corners.sort_unstable();
            corners.dedup();
            corners
        };
        let surfaces = (0..self.cells.len()).filter(|&cell| self.cells[cell].shape == Shape::Polygon);
        let covered: std::collections::HashSet<Vec<u32>> =
            surfaces.map(|cell| sorted(self.corners(cell).to_vec())).collect();
        let uncovered = Kind {
            fate: Fate::LeftOut,
            what: "side of a volume cell on the boundary that no surface cell covers",
            next: "save the surface elements of the whole boundary, or the volume cells alone",
        };
        for (cell, side) in self.boundary() {
            let numbers = self.cells[cell].shape.sides()[side];
            let all = self.corners(cell);
            let corners: Vec<u32> = numbers.iter().filter_map(|&n| all.get(n).copied()).collect();
            let points: Vec<DVec3> = corners.iter().map(|&corner| self.node(corner)).collect();
            if !covered.contains(&sorted(corners)) {
                let area = 0.5 * crate::polygon::vector_area(&points).length();
                let place = || format!("cell {}", self.cells[cell].labels.face);
                ledger.lose(uncovered, 1, Some(area), place);
            }
        }
    }

    /// The scene of some sides of cells, numbered in the order given; the material is the cell's.
    #[cfg(feature = "abaqus")]
    pub(crate) fn scene_of(mut self, sides: &[Side], bounds: Bounds) -> Result<Scene, Error> {
        let mut faces = Faces::new(bounds, std::mem::take(&mut self.ledger));
        faces.triangles.reserve(sides.len());
        for (face, side) in (0..).zip(sides) {
            let cell = side.cell as usize;
            let mut of = match self.cells[cell].shape {
                Shape::Polygon => self.polygon(cell),
                _ => self.side(cell, usize::from(side.side)),
            };
            if self.cells[cell].shape == Shape::Polygon && side.side == 0 {
                of.reverse();
            }
            let labels = Labels {
                object: side.object,
                material: self.cells[cell].labels.material,
                face,
            };
            self.add(&of, labels, &mut faces)?;
        }
        Ok(faces.scene(self.objects, self.further, self.materials))
    }
}

/// Between the names of an object of several.
const BETWEEN: &str = " + ";

impl Face {
    /// Turns it round.
    fn reverse(&mut self) {
        self.corners.reverse();
        // The edge after the last corner stays the last.
        if let Some((_, mids)) = self.mids.split_last_mut() {
            mids.reverse();
        }
    }
}

/// A side of a cell: of a volume cell by the order of [`Shape::sides`], of a surface cell 0 its back, 1 its front.
#[cfg(feature = "abaqus")]
pub(crate) struct Side {
    pub(crate) cell: u32,
    pub(crate) side: u8,
    pub(crate) object: u32,
}

/// Faces of a mesh while they become triangles.
struct Faces {
    bounds: Bounds,
    ledger: Ledger,
    cut: Vec<[u32; 3]>,
    triangles: Vec<Triangle>,
}

impl Faces {
    fn new(bounds: Bounds, ledger: Ledger) -> Self {
        Self {
            bounds,
            ledger,
            cut: Vec::new(),
            triangles: Vec::new(),
        }
    }

    fn add(&mut self, corners: &[DVec3], labels: Labels) -> Result<(), Error> {
        self.bounds.polygon(corners.len())?;
        let place = || format!("cell {}", labels.face);
        cut_face(corners, &mut self.cut, &mut self.ledger, place);
        push_triangles(corners, &self.cut, labels, &mut self.triangles);
        Ok(())
    }

    /// Adds a face with nodes on its curved edges, the edge after each corner; see the [module](self).
    fn add_curved(
        &mut self,
        corners: &[DVec3],
        mids: &[Option<DVec3>],
        centre: Option<DVec3>,
        labels: Labels,
    ) -> Result<(), Error> {
        let curved: Vec<usize> = (0..mids.len()).filter(|&at| mids[at].is_some()).collect();
        let ring: Vec<DVec3> = corners
            .iter()
            .zip(mids)
            .flat_map(|(&corner, &mid)| std::iter::once(corner).chain(mid))
            .collect();
        let at = |k: usize| corners[k % corners.len()];
        let mut parts: Vec<Vec<DVec3>> = Vec::new();
        match (corners.len(), &curved[..]) {
            (3, &[e]) => {
                let m = mids[e].unwrap_or_default();
                parts.extend([vec![at(e), m, at(e + 2)], vec![m, at(e + 1), at(e + 2)]]);
            }
            (3, &[e, f]) => {
                // The corner between the two edges comes after the first of them.
                let (e, f) = if f == e + 1 { (e, f) } else { (f, e) };
                let (m, n) = (mids[e].unwrap_or_default(), mids[f].unwrap_or_default());
                parts.extend([vec![m, at(e + 1), n], vec![at(e), m, n], vec![at(e), n, at(e + 2)]]);
            }
            (3, &[_, _, _]) => {
                let m = |e: usize| mids[e].unwrap_or_default();
                parts.extend((0..3).map(|e| vec![m(e), at(e + 1), m((e + 1) % 3)]));
                parts.push(vec![m(0), m(1), m(2)]);
            }
            (4, _) => {
                let middle = |e: usize| mids[e].unwrap_or_else(|| 0.5 * (at(e) + at(e + 1)));
                let sum: DVec3 = (0..4).map(|e| 0.5 * middle(e) - 0.25 * at(e)).sum();
                let extent = at(0).distance(at(2)).max(at(1).distance(at(3)));
                let own = centre.filter(|own| curved.len() < 3 && own.distance(sum) > STRAIGHT * extent);
                match &curved[..] {
                    [] if own.is_none() => return self.add(corners, labels),
                    &[e, f] if f == e + 2 && own.is_none() => {
                        let (m, n) = (middle(e), middle(f));
                        parts.extend([vec![at(e), m, n, at(e + 3)], vec![m, at(e + 1), at(e + 2), n]]);
                    }
                    _ => {
                        let centre = centre.unwrap_or(sum);
                        let edges = ring.iter().zip(ring.iter().cycle().skip(1));
                        parts.extend(edges.map(|(&from, &to)| vec![centre, from, to]));
                    }
                }
            }
            _ => parts.push(ring),
        }
        parts.iter().try_for_each(|part| self.add(part, labels))
    }

    fn scene(self, objects: Names, further: BTreeMap<u32, Vec<String>>, materials: Names) -> Scene {
        let material = |name| Material {
            name,
            ..Material::default()
        };
        let mut names = objects.names;
        let mut triangles = self.triangles;
        let mut further_names = BTreeMap::new();
        if !further.is_empty() {
            // Names that only stood for a copy of an element in a further group are of no object.
            let used: std::collections::BTreeSet<u32> = triangles.iter().map(|triangle| triangle.object).collect();
            let numbers: HashMap<u32, u32> = used.iter().copied().zip(0..).collect();
            for triangle in &mut triangles {
                triangle.object = numbers.get(&triangle.object).copied().unwrap_or(0);
            }
            let name_of = |number: &u32| names.get(*number as usize).cloned().unwrap_or_default();
            let mut all: Vec<Vec<String>> = Vec::with_capacity(used.len());
            for number in &used {
                all.push(further.get(number).cloned().unwrap_or_else(|| vec![name_of(number)]));
            }
            let mut uses: HashMap<&String, usize> = HashMap::new();
            for first in all.iter().filter_map(|names| names.first()) {
                *uses.entry(first).or_default() += 1;
            }
            let mut shown = Vec::with_capacity(all.len());
            for (number, of) in (0..).zip(&all) {
                // Where another object begins with its first name, it shows all of them.
                let is_alone = of.first().is_some_and(|first| uses.get(first) == Some(&1));
                shown.push(if is_alone { of[0].clone() } else { of.join(BETWEEN) });
                if of.len() > 1 {
                    further_names.insert(number, of[usize::from(is_alone)..].to_vec());
                }
            }
            names = shown;
        }
        Scene {
            triangles,
            objects: names,
            further_names,
            materials: materials.names.into_iter().map(material).collect(),
            ledger: self.ledger,
            ..Scene::default()
        }
    }
}

/// Numbers that a file gives its nodes or elements, with their places.
#[derive(Default)]
pub(crate) struct Tags {
    sorted: Vec<(u64, u32)>,
}

impl Tags {
    /// Makes the table; the first number twice, if there is one, is an error.
    pub(crate) fn new(tags: &[u64]) -> Result<Self, u64> {
        let mut sorted: Vec<(u64, u32)> = tags.iter().copied().zip(0..).collect();
        sorted.sort_unstable();
        match sorted.windows(2).find(|two| two[0].0 == two[1].0) {
            Some(two) => Err(two[0].0),
            None => Ok(Self { sorted }),
        }
    }

    /// The place of a number.
    pub(crate) fn place(&self, tag: u64) -> Option<u32> {
        // Most files count without gaps.
        let guess = tag.checked_sub(self.sorted.first()?.0)?;
        let found = usize::try_from(guess).ok().and_then(|guess| self.sorted.get(guess));
        match found {
            Some(&(number, place)) if number == tag => Some(place),
            _ => {
                let at = self.sorted.binary_search_by_key(&tag, |&(number, _)| number).ok()?;
                Some(self.sorted[at].1)
            }
        }
    }

    /// The numbers from `first` to `last` with their places.
    #[cfg(feature = "abaqus")]
    pub(crate) fn within(&self, first: u64, last: u64) -> &[(u64, u32)] {
        let begin = self.sorted.partition_point(|&(number, _)| number < first);
        let end = self.sorted.partition_point(|&(number, _)| number <= last);
        self.sorted.get(begin..end).unwrap_or_default()
    }
}
