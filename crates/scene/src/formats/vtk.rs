//! Reads VTK's meshes: XML (`.vtu`, `.vtp`) and legacy (`.vtk`).
//!
//! Source: *VTK File Formats* (Kitware) and, where that is silent, `vtkXMLDataParser`, `vtkXMLWriter`, `vtkDataReader`
//! and `vtkCellType.h`. Files written by VTK 9.7 and meshio 5.3 are among the tests.
//!
//! # What becomes of what
//! - XML arrays: text, base64 in place, base64 or raw at the end; plain or by zlib; both byte orders; headers of 32 and
//!   64 bits; several pieces one after the other
//! - legacy arrays: text and binary, versions 1 to 5 (cells as lists, or as offsets and connectivity)
//! - triangles, quadrilaterals, polygons, pixels, strips: a face each; those of second order are cut by their mid-side
//!   nodes, of higher order and of Bézier's form by their corners. Its number is the cell's number in VTK: vertices,
//!   lines, polygons, strips in polygonal data
//! - tetrahedra, hexahedra, voxels, wedges, pyramids: used where there is no surface cell: the faces that belong to one
//!   of them only, turned out of it; counted otherwise
//! - cell data `object`, `zone`, `group`, `region`, `PhysicalGroup`, `gmsh:physical`, `CellEntityIds`, `GeometryIds`,
//!   in any case: the object, of the first of them that is there. Strings are names; the number 3 is `zone 3`, or the
//!   third of the field data `zone_names`, from 0
//! - cell data `material`, `MaterialIds`: the material, likewise
//! - vertices and lines: counted; polyhedra and other cells, and cells with fewer or more points than their type has:
//!   left out or read by their first, and said
//! - images and structured grids: an error; extract their surface first
//! - LZ4 and LZMA: an error; save without compression or by zlib
//!
//! Compressed arrays become ten times the file's size at most, or 1 MiB, unless larger is allowed.
//!
//! By a reader of our own on roxmltree, because `vtkio` fails on files that meshio writes (its issue 21, open since
//! 2022), needs to be told the byte order, and has been at release candidates since 2021.

mod legacy;
mod xml;

use crate::bounds::Bounds;
use crate::mesh::{HIGHER, Mesh, NO_NODE, Shape};
use crate::polygon::Labels;
use crate::{Error, ErrorKind, Fate, Kind as Lost, ReadOptions, Scene};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

/// Cell data by which cells are grouped to objects, in lower case, the first that is there.
const OBJECTS: &[&str] = &[
    "object",
    "zone",
    "group",
    "region",
    "physicalgroup",
    "gmsh:physical",
    "cellentityids",
    "geometryids",
];
/// Likewise for materials.
const MATERIALS: &[&str] = &["material", "materialids"];

/// Reads a VTK mesh from the bytes of a file.
///
/// # Errors
/// When the file breaks the format, is cut short, or a cell names a missing point; the error names the line, in binary
/// parts the byte or the array.
///
/// ```
/// use hemicube_scene::{ReadOptions, vtk};
///
/// let text = b"# vtk DataFile Version 3.0\na wall\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 4 0 0 4 0 3 0 0 3\n\
///     POLYGONS 1 5\n4 0 1 2 3\nCELL_DATA 1\nFIELD names 1\nobject 1 1 string\nwall\n";
/// let scene = vtk::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0]), (2, "wall"));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let bytes = crate::text::unmarked(bytes)?;
    let mut bounds = Bounds::new(bytes.len(), options);
    let mut grid = Grid::default();
    if bytes.trim_ascii_start().starts_with(b"<") {
        xml::read(bytes, &mut bounds, &mut grid)?;
    } else if bytes.starts_with(b"# vtk DataFile Version") {
        legacy::read(bytes, &mut grid)?;
    } else {
        return Err(Error::malformed(
            "is no VTK file: it begins neither with `<` nor with `# vtk DataFile Version`",
        ));
    }
    grid.mesh.scene(bounds)
}

/// The values of an array.
#[derive(Debug)]
enum Values {
    Whole(Vec<i64>),
    Real(Vec<f64>),
    Names(Texts),
}

/// Texts one after the other: a file may have one of a letter for each cell.
#[derive(Debug, Default)]
struct Texts {
    all: String,
    /// Where each ends, in bytes.
    ends: Vec<usize>,
}

impl Texts {
    fn push(&mut self, text: &str) {
        self.all += text;
        self.ends.push(self.all.len());
    }

    fn get(&self, at: usize) -> Option<&str> {
        let begin = at
            .checked_sub(1)
            .map_or(Some(0), |before| self.ends.get(before).copied())?;
        self.all.get(begin..*self.ends.get(at)?)
    }
}

impl Values {
    fn reals(self, what: &str) -> Result<Vec<f64>, Error> {
        match self {
            Self::Real(values) => Ok(values),
            Self::Whole(values) => Ok(values.into_iter().map(|value| value as f64).collect()),
            Self::Names(_) => Err(Error::malformed(format!("{what} are text, not numbers"))),
        }
    }

    fn wholes(self, what: &str) -> Result<Vec<i64>, Error> {
        match self {
            Self::Whole(values) => Ok(values),
            _ => Err(Error::malformed(format!("{what} are not whole numbers"))),
        }
    }
}

/// The contents of a list of cells.
#[derive(Debug)]
enum Kind {
    /// Vertices or lines.
    Lesser(&'static str),
    Polygons,
    Strips,
    /// Cells of VTK's types.
    Types(Vec<i64>),
}

/// A list of cells: the points of all of them, and where each ends.
#[derive(Debug)]
struct Cells {
    kind: Kind,
    points: Vec<i64>,
    ends: Vec<i64>,
}

/// A piece of a file.
#[derive(Debug, Default)]
struct Piece {
    points: Vec<f64>,
    cells: Vec<Cells>,
    /// Arrays of cell data by name.
    cell_data: Vec<(String, Values)>,
}

/// The mesh of the pieces so far.
#[derive(Default)]
struct Grid {
    mesh: Mesh,
    /// String arrays of field data by name in lower case.
    names: HashMap<String, Texts>,
    cells: u32,
}

/// Returns whether an array of cell data is of use.
fn is_group(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    OBJECTS.contains(&&*name) || MATERIALS.contains(&&*name)
}

impl Grid {
    /// Adds the points and cells of a piece.
    fn add(&mut self, piece: Piece) -> Result<(), Error> {
        let base = u32::try_from(self.mesh.nodes.len()).map_err(|_| too_many())?;
        let (points, rest) = piece.points.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(Error::malformed("the number of coordinates is no multiple of three"));
        }
        self.mesh.nodes.extend(points.iter().map(|&p| DVec3::from_array(p)));
        let count = points.len();
        let objects = array(&piece.cell_data, OBJECTS);
        let materials = array(&piece.cell_data, MATERIALS);
        let mut in_piece = 0;
        let mut corners: Vec<u32> = Vec::new();
        for cells in &piece.cells {
            if let Kind::Types(types) = &cells.kind
                && types.len() != cells.ends.len()
            {
                return Err(Error::malformed(format!(
                    "there are {} cells, and types of {}",
                    cells.ends.len(),
                    types.len()
                )));
            }
            let mut begin = 0;
            for (at, &end) in cells.ends.iter().enumerate() {
                let number = in_piece + at;
                let range = usize::try_from(end).ok().and_then(|end| cells.points.get(begin..end));
                let Some(points) = range else {
                    return Err(Error::malformed(format!(
                        "cell {number} ends at {end} of {} points of cells, and begins at {begin}",
                        cells.points.len()
                    )));
                };
                begin += points.len();
                let face = self.cells;
                self.cells = face.checked_add(1).ok_or_else(too_many)?;
                let kind = match &cells.kind {
                    Kind::Lesser(what) => {
                        self.mesh.ledger.note(what);
                        continue;
                    }
                    Kind::Polygons => POLYGON,
                    Kind::Strips => STRIP,
                    Kind::Types(types) => types[at],
                };
                corners.clear();
                for &point in points {
                    match u32::try_from(point).ok().filter(|&point| (point as usize) < count) {
                        Some(point) => corners.push(base.checked_add(point).ok_or_else(too_many)?),
                        None => {
                            return Err(Error::malformed(format!(
                                "cell {number} has a corner at point {point}; there are {count}, counted from 0"
                            )));
                        }
                    }
                }
                let name = |group: Option<(&str, &Values)>| match group {
                    Some((array, values)) => self.group(array, values, number),
                    None => String::new(),
                };
                let (object, material) = (name(objects), name(materials));
                let labels = Labels {
                    object: self.mesh.objects.number(&object)?,
                    material: self.mesh.materials.number(&material)?,
                    face,
                };
                self.cell(kind, &corners, labels).map_err(|error| match error.kind {
                    ErrorKind::Malformed(reason) => Error::malformed(format!("cell {number} {reason}")),
                    _ => error,
                })?;
            }
            in_piece += cells.ends.len();
        }
        Ok(())
    }

    /// The name of a cell's group.
    fn group(&self, array: &str, values: &Values, cell: usize) -> String {
        let number = match values {
            Values::Names(names) => return names.get(cell).unwrap_or_default().to_owned(),
            Values::Whole(numbers) => numbers.get(cell).copied(),
            // ParaView's filters make floating-point numbers of whole ones.
            #[allow(clippy::cast_possible_truncation, reason = "saturates; a name only")]
            Values::Real(numbers) => numbers.get(cell).map(|&number| number as i64),
        };
        let Some(number) = number else { return String::new() };
        let names = self.names.get(&format!("{}_names", array.to_ascii_lowercase()));
        let name = usize::try_from(number).ok().and_then(|at| names?.get(at));
        name.map_or_else(|| format!("{array} {number}"), str::to_owned)
    }

    /// Records a cell that is not taken as the file says.
    fn lose(&mut self, fate: Fate, what: &str, next: &str, labels: Labels) {
        let place = || format!("cell {}", labels.face);
        self.mesh.ledger.lose(Lost { fate, what, next }, 1, None, place);
    }

    /// Adds a cell of one of VTK's types.
    fn cell(&mut self, kind: i64, corners: &[u32], labels: Labels) -> Result<(), Error> {
        let extract = "extract the surface (in ParaView: Extract Surface) and open that";
        let (shape, order): (Shape, &[usize]) = match kind {
            1 | 3 | 21 | 35 if corners.len() > points_of_line(kind) => {
                let what = format!(
                    "cell of VTK's type {kind} with {} points, more than it has",
                    corners.len()
                );
                self.lose(Fate::LeftOut, &what, "its type or its points are wrong", labels);
                return Ok(());
            }
            1 | 2 => {
                self.mesh.ledger.note("vertex cell");
                return Ok(());
            }
            3 | 4 | 21 | 35 | 68 | 75 => {
                self.mesh.ledger.note("line cell");
                return Ok(());
            }
            STRIP => return self.strip(corners, labels),
            POLYGON => return self.mesh.push(Shape::Polygon, corners, labels),
            // Corners come first, then the points on edges.
            36 => {
                let (corners, mids) = corners.split_at(corners.len() / 2);
                let mids = mids.get(..corners.len()).unwrap_or_default();
                return self.mesh.push_second(Shape::Polygon, corners, mids, None, labels);
            }
            5 | 22 | 34 | 69 | 76 => (Shape::Polygon, &[0, 1, 2]),
            9 | 23 | 28 | 30 | 70 | 77 => (Shape::Polygon, &[0, 1, 2, 3]),
            8 => (Shape::Polygon, &[0, 1, 3, 2]),
            10 | 24 | 71 | 78 => (Shape::Tetrahedron, &[0, 1, 2, 3]),
            11 => (Shape::Hexahedron, &[0, 1, 3, 2, 4, 5, 7, 6]),
            12 | 25 | 29 | 33 | 72 | 79 => (Shape::Hexahedron, &[0, 1, 2, 3, 4, 5, 6, 7]),
            13 | 26 | 31 | 32 | 73 | 80 => (Shape::Wedge, &[0, 1, 2, 3, 4, 5]),
            14 | 27 | 37 | 74 | 81 => (Shape::Pyramid, &[0, 1, 2, 3, 4]),
            42 => {
                self.lose(Fate::LeftOut, "polyhedron, not read", extract, labels);
                return Ok(());
            }
            _ => {
                let what = format!("cell of VTK's type {kind}, not read");
                self.lose(Fate::LeftOut, &what, extract, labels);
                return Ok(());
            }
        };
        let mut ordered = [0; 8];
        for (place, &from) in ordered.iter_mut().zip(order) {
            *place = *corners.get(from).ok_or_else(|| {
                Error::malformed(format!(
                    "of type {kind} has {} points; {} are due",
                    corners.len(),
                    order.len()
                ))
            })?;
        }
        let ordered = &ordered[..order.len()];
        let others = corners.get(order.len()..).unwrap_or_default();
        if let Some((edges, centre)) = second(kind, others.len()) {
            let count = if shape == Shape::Polygon {
                order.len()
            } else {
                shape.edges().len()
            };
            let mut mids = [NO_NODE; 12];
            for (&edge, &node) in edges.iter().zip(others) {
                mids[edge] = node;
            }
            let centre = centre.and_then(|at| others.get(at).copied());
            return self.mesh.push_second(shape, ordered, &mids[..count], centre, labels);
        }
        if others.is_empty() {
            return self.mesh.push(shape, ordered, labels);
        }
        if kind > 20 {
            self.mesh
                .ledger
                .lose(HIGHER, 1, None, || format!("cell {}", labels.face));
        } else {
            let what = format!(
                "cell of VTK's type {kind} with {} points, read by its first",
                corners.len()
            );
            self.lose(Fate::Doubtful, &what, "its type or its points are wrong", labels);
        }
        self.mesh.push(shape, ordered, labels)
    }

    /// The triangles of a strip: every second is turned round.
    fn strip(&mut self, corners: &[u32], labels: Labels) -> Result<(), Error> {
        for (at, three) in corners.windows(3).enumerate() {
            let &[a, b, c] = three else { continue };
            let triangle = if at % 2 == 0 { [a, b, c] } else { [b, a, c] };
            self.mesh.push(Shape::Polygon, &triangle, labels)?;
        }
        Ok(())
    }
}

/// Points of a vertex or a line.
fn points_of_line(kind: i64) -> usize {
    match kind {
        1 => 1,
        3 => 2,
        21 => 3,
        _ => 4,
    }
}

/// The edges, by the order of [`Mesh`], that the points after the corners of a cell of second order lie on, and which
/// of these points is at a face's centre; `None` for other cells.
fn second(kind: i64, others: usize) -> Option<(&'static [usize], Option<usize>)> {
    const EDGES: &[usize] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
    Some(match (kind, others) {
        // Quadratic, biquadratic and Lagrange's triangles.
        (22 | 69, 3) | (34, 4) => (&EDGES[..3], None),
        (23, 4) => (&EDGES[..4], None),
        (28 | 70, 5) => (&EDGES[..4], Some(4)),
        // Linear in the other direction.
        (30, 2) => (&[0, 2], None),
        (24 | 71, 6) => (&EDGES[..6], None),
        (25, 12) | (29, 19) | (33, 16) => (EDGES, None),
        (26, 9) | (32, 12) => (&EDGES[..9], None),
        (31, 6) => (&EDGES[..6], None),
        (27, 8) | (37, 14) => (&EDGES[..8], None),
        _ => return None,
    })
}

const STRIP: i64 = 6;
const POLYGON: i64 = 7;

fn array<'a>(arrays: &'a [(String, Values)], names: &[&str]) -> Option<(&'a str, &'a Values)> {
    let find = |name: &&str| arrays.iter().find(|(found, _)| found.eq_ignore_ascii_case(name));
    names.iter().find_map(find).map(|(name, values)| (&**name, values))
}

fn too_many() -> Error {
    Error::new(ErrorKind::TooLarge(
        "has more points or cells than can be numbered".to_owned(),
    ))
}
