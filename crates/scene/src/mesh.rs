//! Meshes of numerical programs: nodes, and cells of a few shapes. Surface cells become faces; a mesh without any has
//! the faces that belong to one volume cell only.
//!
//! Corners are in the order of VTK, which is Gmsh's and CalculiX's for these shapes. The sides of a volume cell are in
//! CalculiX's order (S1 to S6), and are turned out of the cell by its centroid, because programs differ in the
//! orientation of wedges.

use crate::bounds::Bounds;
use crate::names::Names;
use crate::polygon::{Labels, cut_face, push_triangles};
use crate::{Error, ErrorKind, Findings, Material, Scene, Triangle};
use glam::DVec3;

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
    /// The place of its first corner; its last is before the next cell's.
    first: u32,
    labels: Labels,
}

/// A mesh while it is read.
#[derive(Default)]
pub(crate) struct Mesh {
    pub(crate) nodes: Vec<DVec3>,
    pub(crate) objects: Names,
    pub(crate) materials: Names,
    pub(crate) findings: Findings,
    cells: Vec<Cell>,
    corners: Vec<u32>,
}

impl Mesh {
    /// Adds a cell. Corners beyond its shape's are left out by the caller; `labels.face` rises from cell to cell.
    pub(crate) fn push(&mut self, shape: Shape, corners: &[u32], labels: Labels) -> Result<(), Error> {
        let first = u32::try_from(self.corners.len()).map_err(|_| {
            Error::new(ErrorKind::TooLarge(
                "has more corners of cells than can be numbered".to_owned(),
            ))
        })?;
        self.corners.extend_from_slice(corners);
        self.cells.push(Cell { shape, first, labels });
        Ok(())
    }

    /// The corners of a cell, as indices of nodes.
    fn corners(&self, cell: usize) -> &[u32] {
        let first = self.cells.get(cell).map_or(0, |cell| cell.first as usize);
        let end = self
            .cells
            .get(cell + 1)
            .map_or(self.corners.len(), |next| next.first as usize);
        self.corners.get(first..end).unwrap_or_default()
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

    /// The corners of a side of a cell that faces out of it.
    fn side(&self, cell: usize, side: usize) -> Vec<DVec3> {
        let all = self.corners(cell);
        let numbers = self.cells[cell].shape.sides()[side];
        let corners: Vec<u32> = numbers.iter().filter_map(|&n| all.get(n).copied()).collect();
        let outward = self.outward(&corners, all);
        outward.iter().map(|&corner| self.node(corner)).collect()
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
        let mut faces = Faces::new(bounds, std::mem::take(&mut self.findings));
        let is_surface = |cell: &Cell| cell.shape == Shape::Polygon;
        let surfaces = self.cells.iter().filter(|cell| is_surface(cell)).count();
        if surfaces > 0 {
            let corners = (0..self.cells.len()).filter(|&cell| is_surface(&self.cells[cell]));
            let corners = corners.map(|cell| self.corners(cell).len().saturating_sub(2));
            faces.triangles.reserve_exact(corners.sum());
            let volumes = (self.cells.len() - surfaces) as u64;
            faces
                .findings
                .count_many("volume cell beside surface cells, not used", volumes);
            let mut corners = Vec::new();
            for (number, cell) in self.cells.iter().enumerate() {
                if is_surface(cell) {
                    corners.clear();
                    corners.extend(self.corners(number).iter().map(|&corner| self.node(corner)));
                    faces.add(&corners, cell.labels)?;
                }
            }
        } else if !self.cells.is_empty() {
            let boundary = self.boundary();
            faces.triangles.reserve(boundary.len());
            faces.findings.warnings.push(format!(
                "there are no surface cells: {} faces that belong to one volume cell only are taken, and face out of \
                 it; turn them round (`--flip all`) if what radiates surrounds the volume that is meshed",
                boundary.len()
            ));
            for (face, (cell, side)) in (0..).zip(boundary) {
                let labels = Labels {
                    face,
                    ..self.cells[cell].labels
                };
                faces.add(&self.side(cell, side), labels)?;
            }
        }
        Ok(faces.scene(self.objects, self.materials))
    }

    /// The scene of some sides of cells, numbered in the order given; the material is the cell's.
    #[cfg(feature = "abaqus")]
    pub(crate) fn scene_of(mut self, sides: &[Side], bounds: Bounds) -> Result<Scene, Error> {
        let mut faces = Faces::new(bounds, std::mem::take(&mut self.findings));
        faces.triangles.reserve(sides.len());
        for (face, side) in (0..).zip(sides) {
            let cell = side.cell as usize;
            let mut corners = match self.cells[cell].shape {
                Shape::Polygon => self.corners(cell).iter().map(|&corner| self.node(corner)).collect(),
                _ => self.side(cell, usize::from(side.side)),
            };
            if self.cells[cell].shape == Shape::Polygon && side.side == 0 {
                corners.reverse();
            }
            let material = self.cells[cell].labels.material;
            faces.add(
                &corners,
                Labels {
                    object: side.object,
                    material,
                    face,
                },
            )?;
        }
        Ok(faces.scene(self.objects, self.materials))
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
    findings: Findings,
    cut: Vec<[u32; 3]>,
    triangles: Vec<Triangle>,
}

impl Faces {
    fn new(bounds: Bounds, findings: Findings) -> Self {
        Self {
            bounds,
            findings,
            cut: Vec::new(),
            triangles: Vec::new(),
        }
    }

    fn add(&mut self, corners: &[DVec3], labels: Labels) -> Result<(), Error> {
        self.bounds.polygon(corners.len())?;
        cut_face(corners, &mut self.cut, &mut self.findings);
        push_triangles(corners, &self.cut, labels, &mut self.triangles);
        Ok(())
    }

    fn scene(self, objects: Names, materials: Names) -> Scene {
        let material = |name| Material {
            name,
            ..Material::default()
        };
        Scene {
            triangles: self.triangles,
            objects: objects.names,
            materials: materials.names.into_iter().map(material).collect(),
            findings: self.findings,
            up: None,
            metres_per_unit: None,
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
