//! What a file says: parts with nodes and elements, instances of them, sets, surfaces and sections; and where.

use super::generate::Places;
use crate::mesh::Shape;
use crate::{Error, Ledger};
use glam::{DAffine3, DVec3};
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;

/// No entry of a set before it.
pub(super) const NONE: u32 = u32::MAX;

/// A type of elements that are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kind {
    pub(super) shape: Shape,
    pub(super) corners: u8,
    pub(super) nodes: u8,
    /// Of the plane: `S1` and on are its edges.
    pub(super) plane: bool,
}

impl Kind {
    /// Number of nodes that are used: corners, and of elements of second order those on edges and at a face's centre.
    pub(super) fn used(self) -> usize {
        let corners = usize::from(self.corners);
        let (second, centre) = match self.shape {
            Shape::Polygon => (2 * corners, usize::from(self.corners == 4 && self.nodes == 9)),
            shape => (corners + shape.edges().len(), 0),
        };
        if usize::from(self.nodes) < second {
            corners
        } else {
            second + centre
        }
    }

    /// The kind of a type's name in upper case.
    pub(super) fn of(name: &str) -> Option<Self> {
        const SOLIDS: &[&str] = &["C3D", "DC3D", "DCC3D", "AC3D", "SC", "CSS"];
        const SHELLS: &[&str] = &["S", "STRI", "DS", "M3D", "SFM3D", "R3D"];
        const PLANES: &[&str] = &["CPS", "CPE", "CPEG", "DC2D", "AC2D", "CAX", "CGAX", "DCAX"];
        let at = name.find(|c: char| c.is_ascii_digit())?;
        // The digit of `3D` belongs to the family.
        let at = match name.get(at..at + 2) {
            Some("3D" | "2D") => at + 2,
            _ => at,
        };
        let (family, rest) = name.split_at_checked(at)?;
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        let number: u8 = rest.get(..digits)?.parse().ok()?;
        let plane = PLANES.contains(&family);
        let (shape, corners, nodes) = match number {
            65 if family == "STRI" => (Shape::Polygon, 3, 6),
            3 | 6 | 7 if plane || SHELLS.contains(&family) => (Shape::Polygon, 3, number),
            4 | 8 | 9 if plane || SHELLS.contains(&family) => (Shape::Polygon, 4, number),
            4 | 10 if SOLIDS.contains(&family) => (Shape::Tetrahedron, 4, number),
            5 | 13 if SOLIDS.contains(&family) => (Shape::Pyramid, 5, number),
            6 | 15 | 18 if SOLIDS.contains(&family) => (Shape::Wedge, 6, number),
            8 | 20 | 27 if SOLIDS.contains(&family) => (Shape::Hexahedron, 8, number),
            _ => return None,
        };
        Some(Self {
            shape,
            corners,
            nodes,
            plane,
        })
    }
}

/// Elements of one kind, one after the other.
#[derive(Clone, Copy)]
pub(super) struct Block {
    pub(super) kind: Kind,
    /// The place of its first element.
    pub(super) first: u32,
    /// The place of its first element's first corner.
    pub(super) first_corner: u32,
}

/// Nodes and elements that sets number together.
#[derive(Default)]
pub(super) struct Part {
    pub(super) node_numbers: Vec<u32>,
    pub(super) node_lines: Vec<u32>,
    pub(super) nodes: Vec<DVec3>,
    pub(super) blocks: Vec<Block>,
    pub(super) numbers: Vec<u32>,
    pub(super) lines: Vec<u32>,
    /// Numbers of the nodes of elements that are used.
    pub(super) corners: Vec<u32>,
    /// Where nodes and elements are, for rules that name them.
    pub(super) node_places: Places,
    pub(super) places: Places,
}

/// A part at a place.
pub(super) struct Instance {
    pub(super) name: String,
    pub(super) part: u32,
    pub(super) place: DAffine3,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Members {
    /// Numbers of elements in the pool.
    Numbers,
    /// First, last and step in the pool.
    Ranges,
    /// Entries and instances in the pool.
    Sets,
    /// Places of elements in the part, from `begin` to `end`.
    Places,
}

/// Some members of a set.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    /// The entry before it of the same set.
    pub(super) before: u32,
    pub(super) members: Members,
    pub(super) begin: u32,
    pub(super) end: u32,
    /// Of the numbers; `NONE` is the instance that the set is asked for.
    pub(super) instance: u32,
}

pub(super) struct Set {
    pub(super) name: String,
    /// The part that it stands in.
    pub(super) scope: u32,
    /// Its last entry.
    pub(super) last: u32,
    /// It lists numbers in an `*ELSET`.
    pub(super) lists: bool,
    /// It is made by `*ELEMENT`.
    pub(super) of_elements: bool,
    /// A program's own, for surfaces.
    pub(super) internal: bool,
}

/// A line of a surface: elements and the label of their sides.
pub(super) struct Sides {
    pub(super) surface: u32,
    /// The name of a set or the number of an element.
    pub(super) target: String,
    pub(super) label: Label,
    pub(super) line: u32,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Label {
    /// A side of a solid, of a shell 1 is the back and 2 the front.
    Side(u8),
    Front,
    Back,
    Edge,
    None,
}

pub(super) struct Surface {
    pub(super) name: String,
    pub(super) scope: u32,
}

/// A set's material.
pub(super) struct Section {
    pub(super) set: String,
    pub(super) scope: u32,
    pub(super) material: String,
}

/// The contents of the files.
pub(super) struct Model {
    pub(super) parts: Vec<Part>,
    pub(super) part_names: HashMap<String, u32>,
    pub(super) instances: Vec<Instance>,
    pub(super) instance_names: HashMap<String, u32>,
    pub(super) sets: Vec<Set>,
    pub(super) set_names: HashMap<(u32, String), u32>,
    pub(super) entries: Vec<Entry>,
    pub(super) pool: Vec<u32>,
    pub(super) surfaces: Vec<Surface>,
    pub(super) surface_names: HashMap<(u32, String), u32>,
    pub(super) sides: Vec<Sides>,
    /// Parts with elements of types that are not read.
    pub(super) others: HashSet<u32>,
    pub(super) sections: Vec<Section>,
    pub(super) ledger: Ledger,
    /// Where each stretch of lines began: the line in all, the file, and the line in it.
    pub(super) places: Vec<(u32, u32, u32)>,
    pub(super) files: Vec<Option<PathBuf>>,
}

impl Model {
    pub(super) fn new() -> Self {
        let whole = Instance {
            name: String::new(),
            part: 0,
            place: DAffine3::IDENTITY,
        };
        Self {
            parts: vec![Part::default()],
            part_names: HashMap::new(),
            instances: vec![whole],
            instance_names: HashMap::new(),
            sets: Vec::new(),
            set_names: HashMap::new(),
            entries: Vec::new(),
            pool: Vec::new(),
            surfaces: Vec::new(),
            surface_names: HashMap::new(),
            sides: Vec::new(),
            others: HashSet::new(),
            sections: Vec::new(),
            ledger: Ledger::default(),
            places: Vec::new(),
            files: vec![None],
        }
    }

    /// An error with its file and line, from a line in all.
    pub(super) fn at(&self, line: u32, error: Error) -> Error {
        let stretch = self.places.partition_point(|&(begin, ..)| begin <= line);
        let Some(&(begin, file, in_file)) = stretch.checked_sub(1).and_then(|at| self.places.get(at)) else {
            return error;
        };
        let error = error.at(u64::from(in_file) + u64::from(line - begin));
        match self.files.get(file as usize) {
            Some(Some(path)) => error.in_file(path),
            _ => error,
        }
    }

    pub(super) fn fail(&self, line: u32, reason: impl Into<String>) -> Error {
        self.at(line, Error::malformed(reason))
    }

    /// The set of a name, in a scope or, with an instance's name before it, in that instance's.
    pub(super) fn set(&self, scope: u32, name: &str) -> Option<(u32, u32)> {
        let key = |scope: u32, name: &str| self.set_names.get(&(scope, name.to_uppercase())).copied();
        if let Some(set) = key(scope, name) {
            return Some((set, NONE));
        }
        let (instance, set) = self.instance_and(name)?;
        let part = self.instances.get(instance as usize)?.part;
        Some((key(part, set)?, instance))
    }

    /// The instance before a name's first dot, and the rest.
    pub(super) fn instance_and<'a>(&self, name: &'a str) -> Option<(u32, &'a str)> {
        let (instance, rest) = name.split_once('.')?;
        let instance = *self.instance_names.get(&instance.to_uppercase())?;
        Some((instance, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_of_elements() {
        let of = |name: &str| Kind::of(name).map(|kind| (kind.shape, kind.corners, kind.nodes));
        for (name, shape, corners, nodes) in [
            ("S3", Shape::Polygon, 3, 3),
            ("S4R", Shape::Polygon, 4, 4),
            ("S6", Shape::Polygon, 3, 6),
            ("S8R5", Shape::Polygon, 4, 8),
            ("S9R5", Shape::Polygon, 4, 9),
            ("STRI3", Shape::Polygon, 3, 3),
            ("STRI65", Shape::Polygon, 3, 6),
            ("DS8", Shape::Polygon, 4, 8),
            ("M3D9R", Shape::Polygon, 4, 9),
            ("SFM3D4R", Shape::Polygon, 4, 4),
            ("R3D3", Shape::Polygon, 3, 3),
            ("CPS6", Shape::Polygon, 3, 6),
            ("DC2D4", Shape::Polygon, 4, 4),
            ("CAX4P", Shape::Polygon, 4, 4),
            ("C3D4", Shape::Tetrahedron, 4, 4),
            ("C3D10M", Shape::Tetrahedron, 4, 10),
            ("C3D5", Shape::Pyramid, 5, 5),
            ("C3D15", Shape::Wedge, 6, 15),
            ("C3D20RH", Shape::Hexahedron, 8, 20),
            ("DC3D8", Shape::Hexahedron, 8, 8),
            ("SC8R", Shape::Hexahedron, 8, 8),
        ] {
            assert_eq!(of(name), Some((shape, corners, nodes)), "{name}");
        }
        let used = [
            "S4", "S6", "S7", "S8R", "S9R5", "C3D10", "C3D15", "C3D20", "C3D27", "C3D13", "C3D8",
        ];
        let used = used.map(|name| Kind::of(name).map(Kind::used));
        assert_eq!(used, [4, 6, 6, 8, 9, 10, 15, 20, 20, 13, 8].map(Some));
        for name in [
            "B31", "T3D2", "SPRINGA", "MASS", "S", "", "3D", "C3D", "S300", "SAX1", "F3D4",
        ] {
            assert_eq!(of(name), None, "{name}");
        }
    }
}
