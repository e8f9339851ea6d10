//! Reads Green Building XML (`.gbxml`, `.xml`).
//!
//! Source: *gbXML schema* 6.01 and 7.03 (`Surface`, `Opening`, `PlanarGeometry`, `RectangularGeometry`,
//! `AdjacentSpaceId`), whose annotations say that a surface's normal points away from the first adjacent space.
//!
//! # What becomes of what
//! - `Surface` of a `Campus`: a face by its `PlanarGeometry`, otherwise by its `RectangularGeometry` (point at the
//!   bottom left seen from outside, azimuth clockwise from north, tilt from up, width, height). It **faces into the
//!   first adjacent space**: the file winds it outwards, and here it is turned
//! - of two adjacent spaces (interior walls and floors), or of none (shades): with two sides; of none and no shade or
//!   column: the same, and said
//! - `Opening`: a face, cut out of its surface, facing as the surface; one that the file winds against it is turned, and
//!   that is said
//! - surfaces and openings of type `Air`: left open, because radiation passes through them
//! - the object is the `Name`, or the `id` where there is none or another has it, too; the material is
//!   `constructionIdRef`, for openings `windowTypeIdRef` first, otherwise the type
//! - `lengthUnit`: the scene's unit; z is up. Azimuths are those of the model's axes: y is north
//! - surfaces in the order of the file, each followed by its openings
//! - `Space` with its shell and boundaries, and everything else: skipped; elements with loops that gbXML has not: said

use crate::bounds::Bounds;
use crate::names::Names;
use crate::openings::{cut, turn_with, vector_area};
use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::DVec3;
use roxmltree::Node;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

/// Reads a gbXML building from the bytes of a file.
///
/// # Errors
/// When the text is no XML, no gbXML, or a surface has no shape; the error names the line.
///
/// ```
/// use hemicube_scene::{ReadOptions, gbxml};
///
/// let point = |x, y| format!("<CartesianPoint><Coordinate>{x}</Coordinate><Coordinate>{y}</Coordinate>\
///     <Coordinate>0</Coordinate></CartesianPoint>");
/// let text = format!("<gbXML lengthUnit=\"Feet\"><Campus><Surface id=\"floor\" surfaceType=\"SlabOnGrade\">\
///     <AdjacentSpaceId spaceIdRef=\"office\"/><PlanarGeometry><PolyLoop>{}{}{}</PolyLoop></PlanarGeometry>\
///     </Surface></Campus></gbXML>", point(0, 0), point(0, 3), point(4, 3));
/// let scene = gbxml::read(text.as_bytes(), None, ReadOptions::default())?;
/// assert_eq!((scene.objects[0].as_str(), scene.metres_per_unit), ("floor", Some(0.3048)));
/// // Wound outwards it faces down in the file; here it faces up, into the office.
/// let [a, b, c] = scene.triangles[0].corners;
/// assert!((b - a).cross(c - a).z > 0.0);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let bounds = Bounds::new(bytes.len(), options);
    let text = text(bytes)?;
    let document = crate::formats::parse_xml(&text)?;
    let root = document.root_element();
    if root.tag_name().name() != "gbXML" {
        return Err(at(root, "the root is not `gbXML`"));
    }
    let unit = match root.attribute("lengthUnit") {
        None | Some("Meters") => 1.0,
        Some("Kilometers") => 1000.0,
        Some("Centimeters") => 0.01,
        Some("Millimeters") => 0.001,
        Some("Miles") => 1609.344,
        Some("Yards") => 0.9144,
        Some("Feet") => 0.3048,
        Some("Inches") => 0.0254,
        Some(other) => return Err(at(root, format!("`{}` is no unit of length", shown(other)))),
    };
    let surfaces: Vec<Node<'_, '_>> = root
        .children()
        .filter(|node| node.tag_name().name() == "Campus")
        .flat_map(|campus| campus.children())
        .filter(|node| node.tag_name().name() == "Surface")
        .collect();
    let mut reader = Reader {
        names: HashMap::new(),
        triangles: Vec::new(),
        objects: Names::default(),
        materials: Names::default(),
        ledger: Ledger::default(),
        bounds,
        face: 0,
    };
    for node in surfaces
        .iter()
        .flat_map(|surface| std::iter::once(*surface).chain(openings(*surface)))
    {
        if let Some(name) = child(node, "Name").and_then(|name| name.text()) {
            *reader.names.entry(name.trim()).or_insert(0) += 1;
        }
    }
    for campus in root.children().filter(|node| node.tag_name().name() == "Campus") {
        reader.doubt(campus, &["Surface", "Building"]);
    }
    for surface in surfaces {
        let read = ["Opening", "PlanarGeometry", "RectangularGeometry"];
        reader.doubt(surface, &read);
        reader.surface(surface)?;
    }
    let material = |name| Material {
        name,
        ..Material::default()
    };
    Ok(Scene {
        triangles: reader.triangles,
        objects: reader.objects.names,
        materials: reader.materials.names.into_iter().map(material).collect(),
        ledger: reader.ledger,
        up: Some(Axis::Z),
        metres_per_unit: Some(unit),
        is_oriented: true,
        ..Scene::default()
    })
}

/// The text of a file in UTF-8 or, with a mark, UTF-16.
fn text(bytes: &[u8]) -> Result<Cow<'_, str>, Error> {
    let wide = |rest: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = rest.as_chunks().0.iter().map(|&pair| unit(pair));
        let text: Result<String, _> = char::decode_utf16(units).collect();
        text.map(Cow::Owned)
            .map_err(|_| Error::malformed("is no UTF-16 text, as its first bytes say"))
    };
    match bytes {
        [0xFF, 0xFE, rest @ ..] if !rest.starts_with(&[0, 0]) => wide(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => wide(rest, u16::from_be_bytes),
        _ => {
            let bytes = crate::text::unmarked(bytes)?;
            std::str::from_utf8(bytes).map(Cow::Borrowed).map_err(|error| {
                let line = bytes[..error.valid_up_to()]
                    .iter()
                    .filter(|&&byte| byte == b'\n')
                    .count();
                Error::malformed("is not UTF-8 text").at(line as u64 + 1)
            })
        }
    }
}

fn shown(text: &str) -> String {
    text.chars().take(40).collect::<String>().escape_debug().to_string()
}

fn at(node: Node<'_, '_>, reason: impl Into<String>) -> Error {
    Error::malformed(reason).at(u64::from(node.document().text_pos_at(node.range().start).row))
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.tag_name().name() == name)
}

fn openings<'a, 'input>(surface: Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    surface.children().filter(|node| node.tag_name().name() == "Opening")
}

/// The number in an element.
fn number(node: Node<'_, '_>) -> Result<f64, Error> {
    // All of its text: comments stand between parts of it.
    let parts = node.children().filter(Node::is_text).filter_map(|part| part.text());
    let text = parts.collect::<String>();
    let text = text.trim();
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| at(node, format!("`{}` where a number is due", shown(text))))
}

/// The point of a `CartesianPoint`; a coordinate that is left out is 0 where `least` allows it.
fn point(node: Node<'_, '_>, least: usize) -> Result<DVec3, Error> {
    let mut point = DVec3::ZERO;
    let mut found = 0;
    for coordinate in node.children().filter(|node| node.tag_name().name() == "Coordinate") {
        if found == 3 {
            return Err(at(node, "a point has more than three coordinates"));
        }
        point[found] = number(coordinate)?;
        found += 1;
    }
    if found < least {
        return Err(at(node, format!("a point has {found} coordinates; {least} are due")));
    }
    Ok(point)
}

/// Where a rectangle lies: its bottom left corner, and to the right and up in its plane, seen from outside.
struct Frame {
    origin: DVec3,
    right: DVec3,
    up: DVec3,
}

impl Frame {
    /// The frame of a surface by its `RectangularGeometry`; none where that is not whole.
    fn of(surface: Node<'_, '_>) -> Result<Option<Self>, Error> {
        let Some(geometry) = child(surface, "RectangularGeometry") else {
            return Ok(None);
        };
        let parts = ["CartesianPoint", "Azimuth", "Tilt"].map(|name| child(geometry, name));
        let [Some(origin), Some(azimuth), Some(tilt)] = parts else {
            return Ok(None);
        };
        let (azimuth_sin, azimuth_cos) = number(azimuth)?.to_radians().sin_cos();
        let (tilt_sin, tilt_cos) = number(tilt)?.to_radians().sin_cos();
        Ok(Some(Self {
            origin: point(origin, 3)?,
            right: DVec3::new(-azimuth_cos, azimuth_sin, 0.0),
            up: DVec3::new(-tilt_cos * azimuth_sin, -tilt_cos * azimuth_cos, tilt_sin),
        }))
    }

    /// A rectangle with its bottom left corner at a place of the frame.
    fn rectangle(&self, node: Node<'_, '_>, corner: DVec3) -> Result<Option<Vec<DVec3>>, Error> {
        let geometry = child(node, "RectangularGeometry");
        let measure = |name| {
            geometry
                .and_then(|geometry| child(geometry, name))
                .map(number)
                .transpose()
        };
        let (Some(width), Some(height)) = (measure("Width")?, measure("Height")?) else {
            return Ok(None);
        };
        let at = |x: f64, y: f64| self.origin + (corner.x + x) * self.right + (corner.y + y) * self.up;
        let corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)];
        Ok(Some(corners.map(|(x, y)| at(x, y)).to_vec()))
    }
}

/// Types of surfaces that bound no space. One without a type tells nothing.
const SPACELESS: [&str; 5] = ["", "Shade", "Air", "FreestandingColumn", "EmbeddedColumn"];
const OF_NO_SPACE: Kind<'static> = Kind {
    fate: Fate::Doubtful,
    what: "wall, floor or roof of no space, with two sides as a shade has",
    next: "name its space in an `AdjacentSpaceId`, or make it a `Shade`",
};

/// The corners of an element's `PlanarGeometry`; none where it has no polygon.
fn polygon(node: Node<'_, '_>, ledger: &mut Ledger) -> Result<Option<Vec<DVec3>>, Error> {
    let Some(geometry) = child(node, "PlanarGeometry") else {
        return Ok(None);
    };
    let mut loops = geometry.children().filter(|node| node.tag_name().name() == "PolyLoop");
    let Some(first) = loops.next() else {
        return Ok(None);
    };
    let further = loops.count() as u64;
    let kind = Kind {
        fate: Fate::LeftOut,
        what: "further loop of a polygon, left out",
        next: "a polygon has one loop; write another surface, or an opening",
    };
    ledger.lose(kind, further, None, || id_of(node));
    let points = first
        .children()
        .filter(|node| node.tag_name().name() == "CartesianPoint");
    let mut corners = points.map(|node| point(node, 3)).collect::<Result<Vec<_>, _>>()?;
    // Some programs end with the first corner again.
    if corners.len() > 3 && corners.first() == corners.last() {
        corners.pop();
    }
    Ok(Some(corners))
}

struct Reader<'a> {
    /// How often each name is used.
    names: HashMap<&'a str, u32>,
    triangles: Vec<Triangle>,
    objects: Names,
    materials: Names,
    ledger: Ledger,
    bounds: Bounds,
    face: u32,
}

impl Reader<'_> {
    /// Records children with loops that are none of gbXML's.
    fn doubt(&mut self, node: Node<'_, '_>, read: &[&str]) {
        let others = node
            .children()
            .filter(|child| child.is_element() && !read.contains(&child.tag_name().name()));
        for other in others {
            let has_loop = |below: Node<'_, '_>| below.tag_name().name() == "PolyLoop";
            if other.descendants().any(has_loop) {
                let what = format!("element `{}` with loops, not read", shown(other.tag_name().name()));
                let kind = Kind {
                    fate: Fate::LeftOut,
                    what: &what,
                    next: "surfaces are read of `Surface`, windows and doors of `Opening`",
                };
                self.ledger.lose(kind, 1, None, || id_of(other));
            }
        }
    }

    fn surface(&mut self, node: Node<'_, '_>) -> Result<(), Error> {
        let frame = Frame::of(node)?;
        let shape = match (polygon(node, &mut self.ledger)?, &frame) {
            (Some(corners), _) => Some(corners),
            (None, Some(frame)) => frame.rectangle(node, DVec3::ZERO)?,
            (None, None) => None,
        };
        let whole = "its `PlanarGeometry` has no loop, and its `RectangularGeometry` lacks a part";
        let mut corners = shape.ok_or_else(|| fail(node, whole))?;
        let spaces: Vec<&str> = node
            .children()
            .filter(|node| node.tag_name().name() == "AdjacentSpaceId")
            .filter_map(|node| node.attribute("spaceIdRef"))
            .collect();
        let inward = |corners: &mut Vec<DVec3>| {
            // The first corner stays the first.
            if let Some(others) = corners.get_mut(1..)
                && !spaces.is_empty()
            {
                others.reverse();
            }
        };
        inward(&mut corners);
        let outline = corners.clone();
        let mut parts = Vec::new();
        for opening in openings(node) {
            let shape = match (polygon(opening, &mut self.ledger)?, &frame) {
                (Some(corners), _) => Some(corners),
                (None, Some(frame)) => {
                    let geometry = child(opening, "RectangularGeometry");
                    let corner = geometry.and_then(|geometry| child(geometry, "CartesianPoint"));
                    let corner = corner.map_or(Ok(DVec3::ZERO), |corner| point(corner, 2))?;
                    frame.rectangle(opening, corner)?
                }
                (None, None) => None,
            };
            let mut corners = shape.ok_or_else(|| fail(opening, whole))?;
            inward(&mut corners);
            turn_with(&outline, &mut corners, &mut self.ledger, || id_of(opening));
            parts.push((opening, corners));
        }
        let holes: Vec<&[DVec3]> = parts.iter().map(|(_, corners)| corners.as_slice()).collect();
        let two_sided = spaces.len() != 1;
        let kind = node.attribute("surfaceType").unwrap_or_default();
        if spaces.is_empty() && !SPACELESS.contains(&kind) {
            self.ledger
                .lose(OF_NO_SPACE, 1, Some(0.5 * vector_area(&corners).length()), || {
                    id_of(node)
                });
        }
        self.add(node, &corners, &holes, two_sided)?;
        for (opening, corners) in &parts {
            self.add(*opening, corners, &[], two_sided)?;
        }
        Ok(())
    }

    fn add(&mut self, node: Node<'_, '_>, corners: &[DVec3], holes: &[&[DVec3]], two_sided: bool) -> Result<(), Error> {
        let face = self.face;
        self.face = face
            .checked_add(1)
            .ok_or_else(|| Error::new(ErrorKind::TooLarge("has more surfaces than can be numbered".to_owned())))?;
        let kind = node
            .attribute("surfaceType")
            .or(node.attribute("openingType"))
            .unwrap_or_default();
        if kind == "Air" {
            self.ledger.note("surface or opening of air, left open");
            return Ok(());
        }
        let name = child(node, "Name").and_then(|name| name.text()).map(str::trim);
        let id = node.attribute("id").filter(|id| !id.is_empty());
        let object = match (name, id) {
            (Some(name), id) if !name.is_empty() && (id.is_none() || self.names.get(name) == Some(&1)) => name,
            (name, id) => id.or(name).unwrap_or_default(),
        };
        let construction = node.attribute("constructionIdRef");
        let material = node.attribute("windowTypeIdRef").or(construction).unwrap_or(kind);
        let triangles = cut(corners, holes, &mut self.bounds, &mut self.ledger, || id_of(node));
        let triangles = triangles.map_err(|error| Error {
            line: at(node, "").line,
            ..error
        })?;
        let object = self.objects.number(object)?;
        let material = self.materials.number(material)?;
        self.triangles.extend(triangles.into_iter().map(|corners| Triangle {
            corners,
            object,
            material,
            face,
            two_sided,
        }));
        Ok(())
    }
}

/// Name and line of an element for a person.
fn id_of(node: Node<'_, '_>) -> String {
    let id = node.attribute("id").unwrap_or_default();
    let line = node.document().text_pos_at(node.range().start).row;
    if id.is_empty() {
        format!("line {line}")
    } else {
        format!("`{}`, line {line}", shown(id))
    }
}

/// An error of a surface or an opening.
fn fail(node: Node<'_, '_>, reason: &str) -> Error {
    let id = node.attribute("id").unwrap_or_default();
    at(node, format!("`{}`: {reason}", shown(id)))
}
