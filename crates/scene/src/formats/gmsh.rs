//! Reads Gmsh's meshes (`.msh`) of versions 2 and 4.1, in text and binary.
//!
//! Source: *Gmsh reference manual*, "MSH file format" and "MSH file format version 2"; the numbers of element types and
//! their nodes are those of `GmshDefines.h`. Files written by Gmsh 4.15 and meshio 5.3 are among the tests.
//!
//! # What becomes of what
//! - triangles and quadrilaterals, of second order cut by their mid-side nodes, of higher order by their corners: a
//!   face each; its number is the element's position among all elements of the file, from 0
//! - tetrahedra, hexahedra, prisms and pyramids: used where there is no surface element: the faces that belong to one
//!   of them only, turned out of it; counted otherwise
//! - a physical group: the object and the material of its elements, by its name, or `physical 7`. An element of several
//!   groups has the name of the first, and the others as further names; version 2 lists it once for each, and the
//!   copies become one
//! - a negative number of a group (4.1): its surface elements are turned round
//! - elements without a group: the object `surface 3` or `volume 3`, by the elementary entity, and no material
//! - points and lines: counted
//! - `$ParametricNodes` (2): nodes, without their parameters
//! - `$Periodic`, `$NodeData`, `$Parametrizations` and such: skipped; sections that Gmsh does not have: said
//! - versions 1 and 4.0: an error that says to save anew
//!
//! By a reader of our own, because `mshio` reads version 4.1 only and skips the names of physical groups, and `rutile`
//! and `msh-rw` each had one release.

use crate::bounds::Bounds;
use crate::cursor::{Cursor, shown};
use crate::mesh::{HIGHER, Mesh, NO_NODE, Shape, Tags};
use crate::polygon::Labels;
use crate::{Error, ErrorKind, Fate, Kind, ReadOptions, Scene};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

/// Reads a Gmsh mesh from the bytes of a file.
///
/// # Errors
/// When a section breaks the format, the file is cut short, or an element names a missing node; the error names the
/// line, in binary files the byte.
///
/// ```
/// use hemicube_scene::{ReadOptions, gmsh};
///
/// let text = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 5 \"floor\"\n$EndPhysicalNames\n\
///     $Nodes\n4\n1 0 0 0\n2 4 0 0\n3 4 3 0\n4 0 3 0\n$EndNodes\n$Elements\n1\n1 3 2 5 1 1 2 3 4\n$EndElements\n";
/// let scene = gmsh::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0]), (2, "floor"));
/// assert!(scene.triangles.iter().all(|triangle| triangle.face == 0));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let bytes = crate::text::unmarked(bytes)?;
    let mut reader = Reader {
        cursor: Cursor::new(bytes),
        version: Version::Two,
        binary: false,
        size: 8,
        names: HashMap::new(),
        groups: HashMap::new(),
        labels: None,
        tags: Vec::new(),
        places: Tags::default(),
        placed: 0,
        turns: 0,
        elements: 0,
        mesh: Mesh::default(),
    };
    reader.sections()?;
    if reader.version == Version::Two {
        reader.mesh.merge_groups()?;
    }
    reader.mesh.scene(Bounds::new(bytes.len(), options))
}

#[derive(Clone, Copy, PartialEq)]
enum Version {
    Two,
    Four,
}

/// Most times that the nodes are sorted: by each section of elements after more nodes.
const TURNS_MAX: u32 = 100;

struct Reader<'a> {
    cursor: Cursor<'a>,
    version: Version,
    /// Numbers of the long sections are binary.
    binary: bool,
    /// Bytes of Gmsh's `size_t`.
    size: usize,
    /// Names of physical groups by dimension and number.
    names: HashMap<(i64, i64), String>,
    /// The physical groups of an entity, by dimension and number (version 4).
    groups: HashMap<(i64, i64), Vec<i64>>,
    /// The labels of the last element, by its dimension, first physical group and entity.
    labels: Option<((i64, i64, i64), Labels)>,
    /// The nodes' numbers.
    tags: Vec<u64>,
    places: Tags,
    /// Nodes in `places`, and how often they were sorted.
    placed: usize,
    turns: u32,
    elements: u32,
    mesh: Mesh,
}

/// The dimension, the shape, the number of corners and the number of nodes of an element type.
fn element(kind: i64) -> Option<(i64, Option<Shape>, usize, usize)> {
    let (dimension, shape, corners) = match kind {
        15 => (0, None, 1),
        1 | 8 | 26..=28 | 62..=66 => (1, None, 2),
        2 | 9 | 20..=25 | 42..=46 | 52..=56 => (2, Some(Shape::Polygon), 3),
        3 | 10 | 16 | 36..=41 | 47..=51 | 57..=61 => (2, Some(Shape::Polygon), 4),
        4 | 11 | 29..=33 | 71..=75 => (3, Some(Shape::Tetrahedron), 4),
        5 | 12 | 17 | 92..=98 => (3, Some(Shape::Hexahedron), 8),
        6 | 13 | 18 | 90 | 91 => (3, Some(Shape::Wedge), 6),
        7 | 14 | 19 => (3, Some(Shape::Pyramid), 5),
        _ => return None,
    };
    #[rustfmt::skip]
    let nodes = match kind {
        1 => 2, 2 => 3, 3 => 4, 4 => 4, 5 => 8, 6 => 6, 7 => 5, 8 => 3, 9 => 6, 10 => 9, 11 => 10, 12 => 27, 13 => 18,
        14 => 14, 15 => 1, 16 => 8, 17 => 20, 18 => 15, 19 => 13, 20 => 9, 21 => 10, 22 => 12, 23 => 15, 24 => 15,
        25 => 21, 26 => 4, 27 => 5, 28 => 6, 29 => 20, 30 => 35, 31 => 56, 32 => 22, 33 => 28, 36 => 16, 37 => 25,
        38 => 36, 39 => 12, 40 => 16, 41 => 20, 42 => 28, 43 => 36, 44 => 45, 45 => 55, 46 => 66, 47 => 49, 48 => 64,
        49 => 81, 50 => 100, 51 => 121, 52 => 18, 53 => 21, 54 => 24, 55 => 27, 56 => 30, 57 => 24, 58 => 28, 59 => 32,
        60 => 36, 61 => 40, 62 => 7, 63 => 8, 64 => 9, 65 => 10, 66 => 11, 71 => 84, 72 => 120, 73 => 165, 74 => 220,
        75 => 286, 90 => 40, 91 => 75, 92 => 64, 93 => 125, 94 => 216, 95 => 343, 96 => 512, 97 => 729, 98 => 1000,
        _ => return None,
    };
    Some((dimension, shape, corners, nodes))
}

/// Sections without surfaces.
const PASSED: &[&[u8]] = &[
    b"Comments",
    b"Periodic",
    b"NodeData",
    b"ElementData",
    b"ElementNodeData",
    b"InterpolationScheme",
    b"Parametrizations",
    b"GhostElements",
    b"PartitionedEntities",
    b"Entities",
];

/// The edges of volume elements in Gmsh's order of their mid-side nodes.
fn edges(shape: Shape) -> &'static [[usize; 2]] {
    match shape {
        Shape::Polygon => &[],
        Shape::Tetrahedron => &[[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]],
        Shape::Pyramid => &[[0, 1], [0, 3], [0, 4], [1, 2], [1, 4], [2, 3], [2, 4], [3, 4]],
        Shape::Wedge => &[[0, 1], [0, 2], [0, 3], [1, 2], [1, 4], [2, 5], [3, 4], [3, 5], [4, 5]],
        #[rustfmt::skip]
        Shape::Hexahedron => &[
            [0, 1], [0, 3], [0, 4], [1, 2], [1, 5], [2, 3], [2, 6], [3, 7], [4, 5], [4, 7], [5, 6], [6, 7],
        ],
    }
}

/// True for elements of second order.
fn is_second(kind: i64) -> bool {
    matches!(kind, 8..=14 | 16..=19)
}

impl Reader<'_> {
    fn int(&mut self) -> Result<i64, Error> {
        self.cursor.whole(4)
    }

    fn count(&mut self) -> Result<usize, Error> {
        self.cursor.count(self.size)
    }

    fn skip_ints(&mut self, count: usize) -> Result<(), Error> {
        (0..count).try_for_each(|_| self.int().map(drop))
    }

    fn point(&mut self) -> Result<DVec3, Error> {
        Ok(DVec3::new(
            self.cursor.real()?,
            self.cursor.real()?,
            self.cursor.real()?,
        ))
    }

    fn sections(&mut self) -> Result<(), Error> {
        let mut has_format = false;
        let mut has_elements = false;
        while let Some(line) = self.cursor.line() {
            let Some(name) = line.trim_ascii().strip_prefix(b"$") else {
                if !line.trim_ascii().is_empty() && !has_format {
                    return Err(self
                        .cursor
                        .fail("is no Gmsh mesh: the first line should be `$MeshFormat`"));
                }
                continue;
            };
            match (name, has_format) {
                (b"MeshFormat", _) => {
                    self.format()?;
                    has_format = true;
                }
                (b"NOD", _) => return Err(self.old("1")),
                (b"PhysicalNames", true) => self.physical_names()?,
                (b"Entities" | b"PartitionedEntities" | b"Nodes" | b"ParametricNodes" | b"Elements", true) => {
                    if name == b"Elements" {
                        self.place_nodes()?;
                    }
                    self.cursor.binary = self.binary;
                    match (name, self.version) {
                        (b"Entities", Version::Four) => self.entities(false)?,
                        (b"PartitionedEntities", Version::Four) => self.entities(true)?,
                        (b"Nodes", Version::Four) => self.node_blocks()?,
                        (b"Nodes", Version::Two) => self.nodes(false)?,
                        (b"ParametricNodes", Version::Two) => self.nodes(true)?,
                        (b"Elements", Version::Four) => self.element_blocks()?,
                        (b"Elements", Version::Two) => self.elements()?,
                        _ => {
                            self.cursor.binary = false;
                            self.skip(name)?;
                            continue;
                        }
                    }
                    has_elements |= name == b"Elements";
                    self.cursor.binary = false;
                    self.end(name)?;
                }
                (_, true) if name.starts_with(b"End") => {}
                (_, true) => {
                    if !PASSED.contains(&name) {
                        let what = format!("section `{}`, not read", shown(name));
                        let kind = Kind {
                            fate: Fate::LeftOut,
                            what: &what,
                            next: "Gmsh writes no section of this name; mend it if it is one of the others",
                        };
                        let line = self.cursor.fail("").line.unwrap_or(0);
                        self.mesh.ledger.lose(kind, 1, None, || format!("line {line}"));
                    }
                    self.skip(name)?;
                }
                (_, false) => {
                    return Err(self
                        .cursor
                        .fail("a section before `$MeshFormat`, which must be the first"));
                }
            }
        }
        match (has_format, has_elements) {
            (true, true) => Ok(()),
            (true, false) => Err(self
                .cursor
                .fail("the file ends before `$Elements`; it is cut short or has no mesh")),
            (false, _) => Err(self.cursor.fail("is no Gmsh mesh: it has no `$MeshFormat`")),
        }
    }

    fn old(&self, version: &str) -> Error {
        let mut error = self.cursor.fail("");
        error.kind = ErrorKind::Unsupported(format!(
            "is a Gmsh mesh of version {version}; save it anew as 2.2 or 4.1 (`gmsh -0 -format msh41 FILE -o NEW.msh`)"
        ));
        error
    }

    fn format(&mut self) -> Result<(), Error> {
        let version = self.cursor.real()?;
        self.version = if (2.0..3.0).contains(&version) {
            Version::Two
        } else if (version - 4.1).abs() < 1e-9 {
            Version::Four
        } else {
            return Err(self.old(&format!("{version:e}").replace("e0", "")));
        };
        self.binary = self.cursor.whole(4)? != 0;
        let size = self.cursor.whole(4)?;
        if size != 4 && size != 8 {
            return Err(self.cursor.fail(format!("a data size of {size} bytes; it is 4 or 8")));
        }
        self.size = if size == 4 { 4 } else { 8 };
        self.cursor.line();
        if self.binary {
            let mut one = self.cursor.clone();
            self.cursor.big = one.bytes(4)? == [0, 0, 0, 1];
            self.cursor.binary = true;
            let read = self.cursor.whole(4)?;
            if read != 1 {
                return Err(self.cursor.fail("the number 1 is due, which says the order of bytes"));
            }
            self.cursor.binary = false;
        }
        self.end(b"MeshFormat")
    }

    /// Takes the end of a section.
    fn end(&mut self, name: &[u8]) -> Result<(), Error> {
        let due = [b"$End", name].concat();
        match self.cursor.word() {
            Some(word) if word == due => Ok(()),
            found => {
                let found = found.map_or("the end of the file".to_owned(), |word| format!("`{}`", shown(word)));
                Err(self.cursor.fail(format!(
                    "{found} where `{}` is due; the section is damaged",
                    shown(&due)
                )))
            }
        }
    }

    /// Passes over a section.
    fn skip(&mut self, name: &[u8]) -> Result<(), Error> {
        let due = [b"$End", name].concat();
        let begin = self.cursor.clone();
        while let Some(line) = self.cursor.line() {
            if line.trim_ascii_end().ends_with(&due) {
                return Ok(());
            }
        }
        Err(begin.fail(format!("section `{}` has no end; the file is cut short", shown(name))))
    }

    fn physical_names(&mut self) -> Result<(), Error> {
        let count = self.cursor.count(4)?;
        self.cursor.line();
        for _ in 0..count {
            let line = self.cursor.line().unwrap_or_default();
            let text = String::from_utf8_lossy(line);
            let mut parts = text.splitn(2, '"');
            let numbers: Option<Vec<i64>> = parts
                .next()
                .unwrap_or_default()
                .split_whitespace()
                .map(|word| word.parse().ok())
                .collect();
            // Version 2.0 has no dimension.
            let (dimensions, number) = match numbers.as_deref() {
                Some(&[dimension, number]) => (vec![dimension], number),
                Some(&[number]) => (vec![2, 3], number),
                _ => return Err(self.cursor.fail("a dimension, a number and a name in quotes are due")),
            };
            let name = parts.next().unwrap_or_default();
            let name = name.rsplit_once('"').map_or(name, |(name, _)| name);
            for dimension in dimensions {
                self.names.insert((dimension, number), name.to_owned());
            }
        }
        self.end(b"PhysicalNames")
    }

    fn entities(&mut self, partitioned: bool) -> Result<(), Error> {
        if partitioned {
            self.cursor.whole(self.size)?;
            let ghosts = self.count()?;
            self.skip_ints(2 * ghosts)?;
        }
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = self.count()?;
        }
        for (dimension, count) in (0..).zip(counts) {
            for _ in 0..count {
                let tag = self.int()?;
                if partitioned {
                    self.skip_ints(2)?;
                    let partitions = self.count()?;
                    self.skip_ints(partitions)?;
                }
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    self.cursor.real()?;
                }
                let count = self.count()?;
                let groups = (0..count).map(|_| self.int()).collect::<Result<Vec<_>, _>>()?;
                if !groups.is_empty() {
                    self.groups.insert((dimension, tag), groups);
                }
                if dimension > 0 {
                    let boundary = self.count()?;
                    self.skip_ints(boundary)?;
                }
            }
        }
        Ok(())
    }

    fn node(&mut self, tag: i64) -> Result<(), Error> {
        match u64::try_from(tag) {
            Ok(tag) => self.tags.push(tag),
            Err(_) => return Err(self.cursor.fail(format!("{tag} is no number of a node"))),
        }
        let point = self.point()?;
        self.mesh.nodes.push(point);
        Ok(())
    }

    fn nodes(&mut self, parametric: bool) -> Result<(), Error> {
        // The count is text in binary files, too.
        self.cursor.binary = false;
        let count = self.cursor.count(4)?;
        self.begin_binary();
        for _ in 0..count {
            let tag = self.int()?;
            self.node(tag)?;
            if parametric {
                let dimension = self.int()?;
                self.int()?;
                // On a curve one parameter, on a surface two; a point and a volume have none.
                for _ in 0..match dimension {
                    1 => 1,
                    2 => 2,
                    _ => 0,
                } {
                    self.cursor.real()?;
                }
            }
        }
        Ok(())
    }

    /// Enters the binary numbers after a count that is text.
    fn begin_binary(&mut self) {
        if self.binary {
            self.cursor.line();
            self.cursor.binary = true;
        }
    }

    fn node_blocks(&mut self) -> Result<(), Error> {
        let blocks = self.count()?;
        for _ in 0..3 {
            self.cursor.whole(self.size)?;
        }
        for _ in 0..blocks {
            let dimension = self.int()?;
            self.int()?;
            let parameters = match (self.int()?, dimension) {
                (0, 0..=3) => 0,
                (1, 0..=3) => dimension,
                _ => {
                    return Err(self
                        .cursor
                        .fail("a block of nodes has a dimension of 0 to 3, and is parametric (1) or not (0)"));
                }
            };
            let count = self.count()?;
            let before = self.tags.len();
            for _ in 0..count {
                let tag = self.cursor.whole(self.size)?;
                self.tags
                    .push(u64::try_from(tag).map_err(|_| self.cursor.fail(format!("{tag} is no number of a node")))?);
            }
            for _ in before..self.tags.len() {
                let point = self.point()?;
                self.mesh.nodes.push(point);
                for _ in 0..parameters {
                    self.cursor.real()?;
                }
            }
        }
        Ok(())
    }

    /// Sorts the nodes by their tags, for the elements that follow, if there are more than before.
    fn place_nodes(&mut self) -> Result<(), Error> {
        if self.placed == self.tags.len() {
            return Ok(());
        }
        self.placed = self.tags.len();
        self.turns += 1;
        if self.turns > TURNS_MAX {
            let reason = format!("nodes and elements take turns more than {TURNS_MAX} times; write the nodes first");
            return Err(self.cursor.fail(reason));
        }
        self.places = Tags::new(&self.tags).map_err(|tag| self.cursor.fail(format!("node {tag} is there twice")))?;
        Ok(())
    }

    fn elements(&mut self) -> Result<(), Error> {
        self.cursor.binary = false;
        let count = self.cursor.count(4)?;
        self.begin_binary();
        let mut read = 0;
        while read < count {
            let (mut number, kind, block, tag_count) = if self.binary {
                (0, self.int()?, self.cursor.count(4)?, self.cursor.count(4)?)
            } else {
                (self.int()?, self.int()?, 1, self.cursor.count(4)?)
            };
            if block == 0 {
                return Err(self.cursor.fail("a block without an element"));
            }
            for _ in 0..block {
                if self.binary {
                    number = self.int()?;
                }
                let (mut group, mut entity) = (0, 0);
                for at in 0..tag_count {
                    let tag = self.int()?;
                    match at {
                        0 => group = tag.saturating_abs(),
                        1 => entity = tag,
                        _ => {}
                    }
                }
                self.element(number, kind, group, entity, 4)?;
            }
            read += block;
        }
        Ok(())
    }

    fn element_blocks(&mut self) -> Result<(), Error> {
        let blocks = self.count()?;
        for _ in 0..3 {
            self.cursor.whole(self.size)?;
        }
        for _ in 0..blocks {
            let dimension = self.int()?;
            let entity = self.int()?;
            let kind = self.int()?;
            let count = self.count()?;
            let group = self.groups.get(&(dimension, entity)).and_then(|groups| groups.first());
            let group = group.copied().unwrap_or(0);
            for _ in 0..count {
                let tag = self.cursor.whole(self.size)?;
                self.element(tag, kind, group, entity, self.size)?;
            }
        }
        Ok(())
    }

    /// Reads the nodes of an element and adds it to the mesh.
    fn element(&mut self, number: i64, kind: i64, group: i64, entity: i64, size: usize) -> Result<(), Error> {
        let Some((dimension, shape, corner_count, node_count)) = element(kind) else {
            return Err(self.cursor.fail(format!(
                "element type {kind} is not known; leave such elements out when you save"
            )));
        };
        let is_second = is_second(kind) && shape.is_some();
        // Corners, and mid-side nodes with the node at the centre of a face.
        let used = if is_second { node_count } else { corner_count };
        let mut nodes = [0; 32];
        for at in 0..node_count {
            let tag = self.cursor.whole(size)?;
            if let Some(node) = nodes.get_mut(at).filter(|_| at < used) {
                let place = u64::try_from(tag).ok().and_then(|tag| self.places.place(tag));
                *node = place.ok_or_else(|| {
                    let count = self.tags.len();
                    self.cursor.fail(format!(
                        "an element has a corner at node {tag}, which is none of the {count} nodes"
                    ))
                })?;
            }
        }
        // A type with fewer nodes than the line has would have the rest taken for another element.
        let more = self.cursor.words_left();
        if more > 0 {
            return Err(self.cursor.fail(format!(
                "element {number} has {more} words after the {node_count} nodes of its type {kind}; the type or its \
                 nodes are wrong"
            )));
        }
        let face = self.elements;
        self.elements = face
            .checked_add(1)
            .ok_or_else(|| Error::new(ErrorKind::TooLarge("has more elements than can be numbered".to_owned())))?;
        let Some(shape) = shape else {
            self.mesh.ledger.note(if dimension == 0 {
                "point element"
            } else {
                "line element"
            });
            return Ok(());
        };
        if node_count > corner_count && !is_second {
            self.mesh.ledger.lose(HIGHER, 1, None, || format!("element {number}"));
        }
        let (corners, others) = nodes.split_at_mut(corner_count);
        let mut mids = [NO_NODE; 12];
        let mut mid_count = 0;
        let mut centre = None;
        if is_second && shape == Shape::Polygon {
            mid_count = corner_count;
            mids[..corner_count].copy_from_slice(&others[..corner_count]);
            centre = (node_count == 9).then(|| others[corner_count]);
        } else if is_second {
            let of_file = edges(shape);
            mid_count = of_file.len();
            for (mid, ends) in mids.iter_mut().zip(shape.edges()) {
                let is = |edge: &[usize; 2]| edge == ends || [edge[1], edge[0]] == *ends;
                *mid = of_file.iter().position(is).map_or(NO_NODE, |at| others[at]);
            }
        }
        // Version 2 has such elements turned round already, and the group's number positive.
        if group < 0 && dimension == 2 {
            corners.reverse();
            mids[..mid_count.saturating_sub(1)].reverse();
        }
        let labels = self.labels(dimension, group.saturating_abs(), entity)?;
        let labels = Labels { face, ..labels };
        self.mesh
            .push_second(shape, corners, &mids[..mid_count], centre, labels)
    }

    /// The name of a physical group; `None` without one.
    fn group_name(&self, dimension: i64, group: i64) -> Option<String> {
        let named = || self.names.get(&(dimension, group)).cloned();
        (group != 0).then(|| named().unwrap_or_else(|| format!("physical {group}")))
    }

    fn labels(&mut self, dimension: i64, group: i64, entity: i64) -> Result<Labels, Error> {
        let groups = self.groups.get(&(dimension, entity));
        let is_several = groups.is_some_and(|groups| groups.len() > 1);
        let key = (dimension, group, if group == 0 || is_several { entity } else { 0 });
        if let Some((_, labels)) = self.labels.filter(|(last, _)| *last == key) {
            return Ok(labels);
        }
        let mut names: Vec<String> = match groups {
            Some(groups) if is_several => {
                let names = groups
                    .iter()
                    .filter_map(|group| self.group_name(dimension, group.saturating_abs()));
                names.collect()
            }
            _ => self.group_name(dimension, group).into_iter().collect(),
        };
        let material = names.first().cloned().unwrap_or_default();
        if names.is_empty() {
            names.push(match dimension {
                3 => format!("volume {entity}"),
                _ => format!("surface {entity}"),
            });
        }
        let labels = Labels {
            object: self.mesh.object(&names)?,
            material: self.mesh.materials.number(&material)?,
            face: 0,
        };
        self.labels = Some((key, labels));
        Ok(labels)
    }
}
