//! Reads PLY scenes, in text and both binary forms, by `ply-rs-bw`.
//!
//! Source: *The PLY Polygon File Format* (Turk 1994).
//!
//! # What becomes of what
//! - `vertex` with `x`, `y`, `z`: a corner in full f64 where the file has doubles
//! - `face` with a list `vertex_indices` or `vertex_index`: triangles with the polygon's winding, concave ones by ear
//!   clipping
//! - a corner of a vertex that is not there: an error
//! - a face with fewer than three corners, or without area: left out, and said; it keeps its face number
//! - `tristrips` with a list of the same names: a triangle for each corner from the third on, every second turned, each
//!   a face numbered after those of `face`; −1 begins another strip
//! - other elements with lists: left out, and said; without, such as `edge`: counted
//! - colours, normals, texture coordinates and other properties: skipped
//! - `vertex` without one of `x`, `y`, `z`: an error
//! - bytes after the last element, and in text more numbers in a line than the header gives it: said
//!
//! PLY names neither objects nor units nor an up axis.

use crate::bounds::Bounds;
use crate::polygon::{Labels, TOO_FEW_CORNERS, cut_face, push_triangles};
use crate::{Error, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType};
use std::path::Path;

/// Kept part of a vertex or a face.
#[derive(Debug)]
struct Element {
    position: DVec3,
    /// `None` if a corner is no whole number. [`RESTART`] for −1.
    corners: Option<Vec<u32>>,
}

/// More vertices or faces than the header announces, or the header of another file.
const AFTER_THE_LAST: Kind<'static> = Kind {
    fate: Fate::LeftOut,
    what: "byte after the last element",
    next: "the header announces fewer elements than the file has; get the file anew",
};

const SURPLUS: Kind<'static> = Kind {
    fate: Fate::Doubtful,
    what: "line with more numbers than the header gives its element, which were skipped",
    next: "a list begins with the number of its entries",
};

/// Begins another strip.
const RESTART: u32 = u32::MAX;

impl PropertyAccess for Element {
    fn new() -> Self {
        Self {
            position: DVec3::ZERO,
            corners: Some(Vec::new()),
        }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let coordinate = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "vertex_indices" | "vertex_index" => {
                self.corners = indices(&value);
                return PropertyAccessResult::Set;
            }
            _ => return PropertyAccessResult::Ignored,
        };
        match number(&value) {
            Some(number) => {
                *coordinate = number;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }
}

fn number(value: &Property) -> Option<f64> {
    Some(match *value {
        Property::Char(x) => f64::from(x),
        Property::UChar(x) => f64::from(x),
        Property::Short(x) => f64::from(x),
        Property::UShort(x) => f64::from(x),
        Property::Int(x) => f64::from(x),
        Property::UInt(x) => f64::from(x),
        Property::Float(x) => f64::from(x),
        Property::Double(x) => x,
        _ => return None,
    })
}

fn indices(value: &Property) -> Option<Vec<u32>> {
    fn all<T: Copy + Into<i64>>(list: &[T]) -> Option<Vec<u32>> {
        let index = |&index: &T| match index.into() {
            -1 => Some(RESTART),
            index => u32::try_from(index).ok(),
        };
        list.iter().map(index).collect()
    }
    match value {
        Property::ListChar(list) => all(list),
        Property::ListUChar(list) => all(list),
        Property::ListShort(list) => all(list),
        Property::ListUShort(list) => all(list),
        Property::ListInt(list) => all(list),
        Property::ListUInt(list) => Some(list.clone()),
        _ => None,
    }
}

/// Reads a PLY scene from the bytes of a file.
///
/// # Errors
/// When the header is not PLY, the file ends before the announced elements do, or a face names a missing vertex.
///
/// ```
/// use hemicube_scene::{ReadOptions, ply};
///
/// let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
///             element face 1\nproperty list uchar int vertex_indices\nend_header\n\
///             0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
/// let scene = ply::read(text.as_bytes(), None, ReadOptions::default())?;
/// assert_eq!(scene.triangles.len(), 2);
/// assert!(scene.triangles.iter().all(|triangle| triangle.face == 0));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let located = |error: ply_rs_bw::parser::ParseError| {
        let line = error.line();
        // The library's own text may run over several lines, and quotes the whole of one.
        let reason: String = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        let error = Error::malformed(format!("is not PLY as it should be: {}", excerpt(&reason)));
        match line {
            Some(line) => error.at(line as u64),
            None => error,
        }
    };
    // The header is text even in binary files.
    let bytes = crate::text::unmarked(bytes)?;
    let parser = Parser::<Element>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(located)?;
    let mut scene = Scene {
        materials: vec![Material::default()],
        objects: vec![String::new()],
        ..Scene::default()
    };
    for (name, element) in &header.elements {
        // Every element takes a byte at least, a number or a line end: a file cannot hold more elements than bytes.
        if element.count > bytes.len() || (element.properties.is_empty() && element.count > 0) {
            return Err(Error::malformed(format!(
                "announces {} of element `{name}` with {} properties in a file of {} bytes; it is cut short or damaged",
                element.count,
                element.properties.len(),
                bytes.len()
            )));
        }
        // A coordinate that is not there would be 0.
        let is_missing = |axis: &&&str| !element.properties.contains_key(**axis);
        if name == "vertex"
            && let Some(axis) = ["x", "y", "z"].iter().find(is_missing)
        {
            return Err(Error::malformed(format!(
                "has vertices without the property `{axis}`; export the model with positions"
            )));
        }
    }
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    let mut strips = Vec::new();
    for (name, element) in &header.elements {
        let is_read = ["vertex", "face", "tristrips"].contains(&name.as_str());
        if is_read && matches!(header.encoding, Encoding::Ascii) {
            count_surplus(reader.get_ref(), name, element, &mut scene.ledger);
        }
        let values = parser
            .read_payload_for_element(&mut reader, element, &header)
            .map_err(located)?;
        match name.as_str() {
            "vertex" => vertices = values,
            "face" => faces = values,
            "tristrips" => strips = values,
            other => {
                let what = format!("element `{}`, not read", excerpt(other));
                let is_list = |kind: &PropertyType| matches!(kind, PropertyType::List(..));
                let fate = if element.properties.values().any(|property| is_list(&property.data_type)) {
                    Fate::LeftOut
                } else {
                    Fate::Noted
                };
                let next = "faces are read of elements `face` and `tristrips`";
                let kind = Kind {
                    fate,
                    what: &what,
                    next,
                };
                scene
                    .ledger
                    .lose(kind, values.len() as u64, None, || "the header".to_owned());
            }
        }
    }
    let rest = reader.into_inner();
    let is_end = match header.encoding {
        Encoding::Ascii => rest.iter().all(u8::is_ascii_whitespace),
        // Some programs end a binary file with a line.
        _ => matches!(rest, b"" | b"\n" | b"\r\n"),
    };
    if !is_end {
        let place = || format!("byte {}", bytes.len() - rest.len());
        scene.ledger.lose(AFTER_THE_LAST, rest.len() as u64, None, place);
    }
    let mut bounds = Bounds::new(bytes.len(), options);
    let mut corners = Vec::new();
    let mut cut = Vec::new();
    for (face, element) in (0..).zip(&faces) {
        let Some(indices) = element.corners.as_ref().filter(|indices| !indices.contains(&RESTART)) else {
            return Err(Error::malformed(format!(
                "face {face} has a corner that is not the number of a vertex"
            )));
        };
        bounds.polygon(indices.len())?;
        corners.clear();
        for &index in indices {
            let Some(vertex) = vertices.get(index as usize) else {
                return Err(Error::malformed(format!(
                    "face {face} has a corner at vertex {index}; there are {}, counted from 0",
                    vertices.len()
                )));
            };
            corners.push(vertex.position);
        }
        cut_face(&corners, &mut cut, &mut scene.ledger, || format!("face {face}"));
        push_triangles(
            &corners,
            &cut,
            Labels {
                face,
                ..Labels::default()
            },
            &mut scene.triangles,
        );
    }
    read_strips(&strips, &vertices, faces.len(), &mut scene)?;
    if !vertices.is_empty() && faces.is_empty() && strips.is_empty() {
        scene
            .ledger
            .warnings
            .push("the file has vertices and no faces: a point cloud has no surface to compute with".to_owned());
    }
    Ok(scene)
}

/// Records lines of an element, of a file in text, that have more numbers than the header gives it.
fn count_surplus(text: &[u8], name: &str, element: &ElementDef, ledger: &mut Ledger) {
    let has_surplus = |line: &[u8]| {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        for property in element.properties.values() {
            let first = words.next();
            if let PropertyType::List(..) = property.data_type {
                let count = first.and_then(|word| std::str::from_utf8(word).ok()?.parse::<usize>().ok());
                // What is no number is refused elsewhere.
                let Some(count) = count else { return false };
                if count > 0 {
                    words.nth(count - 1);
                }
            }
        }
        words.next().is_some()
    };
    let lines = (0_u64..).zip(text.split(|&byte| byte == b'\n').take(element.count));
    let mut found = lines.filter(|(_, line)| has_surplus(line)).map(|(at, _)| at);
    if let Some(first) = found.next() {
        let more = found.count() as u64;
        ledger.lose(SURPLUS, 1 + more, None, || format!("`{}` {first}", excerpt(name)));
    }
}

/// Adds the triangles of strips, as faces numbered from `first` on.
fn read_strips(strips: &[Element], vertices: &[Element], first: usize, scene: &mut Scene) -> Result<(), Error> {
    let too_many = || Error::malformed("has more faces than can be numbered");
    let mut face = u32::try_from(first).map_err(|_| too_many())?;
    for (number, element) in strips.iter().enumerate() {
        let wrong = |what: &str| Error::malformed(format!("strip {number} has a corner {what}"));
        let indices = element
            .corners
            .as_ref()
            .ok_or_else(|| wrong("that is not the number of a vertex"))?;
        for strip in indices.split(|&index| index == RESTART) {
            let vertex = |index: u32| {
                let vertex = vertices.get(index as usize).map(|vertex| vertex.position);
                vertex.ok_or_else(|| {
                    wrong(&format!(
                        "at vertex {index}; there are {}, counted from 0",
                        vertices.len()
                    ))
                })
            };
            if (1..3).contains(&strip.len()) {
                scene
                    .ledger
                    .lose(TOO_FEW_CORNERS, 1, None, || format!("strip {number}"));
            }
            for (at, three) in strip.windows(3).enumerate() {
                let &[a, b, c] = three else { continue };
                // Repeated corners join strips.
                if a == b || b == c || c == a {
                    continue;
                }
                let [b, c] = if at % 2 == 0 { [b, c] } else { [c, b] };
                scene.triangles.push(Triangle {
                    corners: [vertex(a)?, vertex(b)?, vertex(c)?],
                    object: 0,
                    material: 0,
                    face,
                    two_sided: false,
                });
                face = face.checked_add(1).ok_or_else(too_many)?;
            }
        }
    }
    Ok(())
}

fn excerpt(text: &str) -> String {
    let mut shown: String = text.chars().take(160).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    shown.escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 5\nproperty double x\n\
        property double y\nproperty double z\nproperty uchar red\nelement face 2\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 255\n1 0 0 255\n1 1 0 255\n0 1 0 255\n\
        2678219.194 0 1 255\n4 0 1 2 3\n3 0 1 4\n";

    fn open(bytes: &[u8]) -> Result<Scene, Error> {
        read(bytes, None, ReadOptions::default())
    }

    fn binary(big: bool) -> Vec<u8> {
        let form = if big {
            "binary_big_endian"
        } else {
            "binary_little_endian"
        };
        let mut bytes = format!(
            "ply\nformat {form} 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
            property float z\nelement face 1\nproperty list uchar uint vertex_index\nend_header\n"
        )
        .into_bytes();
        for x in [0.0_f32, 0., 0., 1., 0., 0., 0., 1.5, 0.] {
            bytes.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() });
        }
        bytes.push(3);
        for i in [0_u32, 1, 2] {
            bytes.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() });
        }
        bytes
    }

    #[test]
    fn text_in_doubles_with_a_quadrilateral() {
        let scene = open(TEXT.as_bytes()).unwrap();
        assert_eq!(scene.triangles.len(), 3);
        assert_eq!(scene.triangles[2].corners[2].x, 2_678_219.194);
        assert_eq!(scene.triangles.iter().map(|t| t.face).collect::<Vec<_>>(), [0, 0, 1]);
    }

    #[test]
    fn what_the_header_does_not_announce_is_a_loss() {
        assert_eq!(open(TEXT.as_bytes()).unwrap().ledger.losses().count(), 0);
        for (from, to, count) in [("face 2", "face 1", 8), ("3 0 1 4\n", "3 0 1 4\n\n \r\n", 0)] {
            let ledger = open(TEXT.replacen(from, to, 1).as_bytes()).unwrap().ledger;
            assert_eq!(ledger.get(AFTER_THE_LAST.what), count, "{ledger}");
        }
        for (from, to, count) in [
            ("4 0 1 2 3", "3 0 1 2 3", 1),
            ("1 0 0 255", "1 0 0 255 7", 1),
            ("4 0 1 2 3", "4 0  1 2 3 ", 0),
        ] {
            let ledger = open(TEXT.replacen(from, to, 1).as_bytes()).unwrap().ledger;
            assert_eq!(ledger.get(SURPLUS.what), count, "{ledger}");
        }
        for (rest, count) in [(&b"\n"[..], 0), (b"\0\0\0", 3)] {
            let ledger = open(&[&binary(false), rest].concat()).unwrap().ledger;
            assert_eq!(ledger.get(AFTER_THE_LAST.what), count, "{ledger}");
        }
    }

    #[test]
    fn both_byte_orders() {
        let (little, big) = (open(&binary(false)).unwrap(), open(&binary(true)).unwrap());
        assert_eq!(little, big);
        assert_eq!(little.triangles[0].corners[2], DVec3::new(0.0, 1.5, 0.0));
    }

    #[test]
    fn bad_files_are_refused_with_a_reason_and_cuts_never_pass() {
        for (from, to, expected) in [
            ("3 0 1 4", "3 0 1 5", "vertex 5; there are 5"),
            ("3 0 1 4", "3 0 1 -1", "not the number of a vertex"),
            ("vertex 5", "vertex 4000000000", "cut short or damaged"),
            ("0 1 0 255", "0 one 0 255", "is not PLY"),
            ("ply\n", "plx\n", "is not PLY"),
            ("property double y\n", "", "vertices without the property `y`"),
            (
                "property double z\n",
                "property double height\n",
                "without the property `z`",
            ),
        ] {
            let message = open(TEXT.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
            assert!(message.contains(expected) && !message.contains('\n'), "{message}");
        }
        for bytes in [TEXT.as_bytes(), &binary(false), &binary(true)] {
            for end in 0..bytes.len() - 1 {
                // A text may lose the end of its last number unnoticed.
                let read = open(&bytes[..end]);
                assert!(
                    read.is_err() || bytes.len() - end < 3,
                    "cut at {end} of {}",
                    bytes.len()
                );
            }
        }
        let mut huge = binary(false);
        let list = huge.len() - 13;
        huge[list] = 255;
        assert!(open(&huge).is_err());
    }
}
