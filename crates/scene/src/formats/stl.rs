//! Reads STL scenes, in text and binary.
//!
//! Source: *StereoLithography Interface Specification* (3D Systems 1989), and files of common programs. By a reader of
//! our own, because `stl_io` takes a binary file with a header beginning with `solid` for text, reads the first solid
//! only, and keeps coordinates in f32.
//!
//! # What becomes of what
//! - 84 bytes and 50 for each triangle that bytes 80 to 83 announce: binary, whatever the header says
//! - anything else that begins with `solid`: text; keywords in any case
//! - `solid NAME`: an object. Where several have one name, or none, they are numbered as the file has them: `NAME 1`,
//!   `solid 2`, and that is said
//! - a facet's `vertex` lines: a triangle in full f64; a loop of more than three is cut as a polygon
//! - a facet's normal: only compared: the order of the vertices says where the front is; facets whose normal says
//!   otherwise are said
//! - the attribute bytes of a binary triangle: skipped
//! - bytes after the last announced triangle: skipped, and said
//! - fewer bytes than announced: an error
//! - text that begins otherwise: an error
//!
//! STL names neither units nor an up axis.

use crate::bounds::Bounds;
use crate::names::numbered;
use crate::polygon::{Labels, cut_face, push_triangles};
use crate::{Error, ErrorKind, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::DVec3;
use std::path::Path;

/// The binary header, the count after it, and a triangle.
const HEADER: usize = 80;
const START: usize = HEADER + 4;
const RECORD: usize = 50;

/// Reads an STL scene from the bytes of a file.
///
/// # Errors
/// When a binary file is cut short, or a line of a text file breaks the grammar; the error names the line.
///
/// ```
/// use hemicube_scene::{ReadOptions, stl};
///
/// let text = b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
///     endfacet\nendsolid s\n";
/// let scene = stl::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0]), (1, "s"));
/// assert!(stl::read(&text[..90], None, ReadOptions::default()).is_err(), "cut short");
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    match announced(bytes) {
        Some(count) if bytes.len() == START + RECORD * count => binary(bytes, count, &mut scene),
        _ if is_text(bytes) => text(
            crate::text::unmarked(bytes)?,
            &mut scene,
            Bounds::new(bytes.len(), options),
        )?,
        // A header of a binary file may begin with any bytes: a mark counts only if the size does not fit.
        _ if bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF]) => {
            crate::text::unmarked(bytes)?;
        }
        _ if is_prose(bytes) => {
            return Err(Error::malformed(
                "is text that does not begin with `solid`, as STL in text does; take away what stands before it",
            )
            .at(1));
        }
        Some(count) if bytes.len() > START + RECORD * count => {
            let more = (bytes.len() - START - RECORD * count) as u64;
            let kind = Kind {
                fate: Fate::LeftOut,
                what: "byte after the last triangle",
                next: "the header announces fewer triangles than the file has room for; get the file anew",
            };
            scene
                .ledger
                .lose(kind, more, None, || format!("byte {}", START + RECORD * count));
            binary(bytes, count, &mut scene);
        }
        Some(count) => {
            let whole = (bytes.len() - START) / RECORD;
            return Err(Error::malformed(format!(
                "is cut short: its header announces {count} triangles, and {whole} are there; get the whole file"
            )));
        }
        None => {
            return Err(Error::malformed(
                "is neither text that begins with `solid` nor long enough for binary STL",
            ));
        }
    }
    Ok(scene)
}

/// Number of triangles announced by a binary file.
fn announced(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER..START)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*count) as usize)
}

fn is_text(bytes: &[u8]) -> bool {
    let text = crate::text::unmarked(bytes).unwrap_or(bytes).trim_ascii_start();
    text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) && !text.contains(&0)
}

/// Returns whether a file's beginning, the count of triangles within it, is printable: no count of a file that is not
/// gigabytes long is.
fn is_prose(bytes: &[u8]) -> bool {
    let is_text = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    bytes.get(..START).is_some_and(|start| start.iter().all(is_text))
}

fn binary(bytes: &[u8], count: usize, scene: &mut Scene) {
    scene.objects.push(String::new());
    let records = bytes.get(START..).unwrap_or_default().as_chunks::<RECORD>().0;
    for (face, record) in (0..).zip(records.iter().take(count)) {
        let vector = |at: usize| {
            let float = |k: usize| {
                let four = record.get(at + 4 * k..).and_then(|rest| rest.first_chunk::<4>());
                f64::from(four.map_or(f32::NAN, |four| f32::from_le_bytes(*four)))
            };
            DVec3::new(float(0), float(1), float(2))
        };
        let corners = [vector(12), vector(24), vector(36)];
        compare_normal(vector(0), &corners, &mut scene.ledger, face);
        scene.triangles.push(Triangle {
            corners,
            object: 0,
            material: 0,
            face,
            two_sided: false,
        });
    }
}

/// Counts a facet with its normal against the order of its vertices.
fn compare_normal(normal: DVec3, corners: &[DVec3], ledger: &mut Ledger, face: u32) {
    if let [a, b, c, ..] = corners
        && (b - a).cross(c - a).dot(normal) < 0.0
    {
        let kind = Kind {
            fate: Fate::Doubtful,
            what: "facet whose normal contradicts the order of its vertices, which is followed",
            next: "if normals are right, turn its object round, or make normals anew in the modeller",
        };
        let area = 0.5 * (b - a).cross(c - a).length();
        ledger.lose(kind, 1, Some(area), || format!("facet {face}"));
    }
}

/// State of the text grammar: the keyword of a line, and the keywords allowed next.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    Outside,
    Solid,
    Facet,
    Loop,
    AfterLoop,
}

fn text(bytes: &[u8], scene: &mut Scene, mut bounds: Bounds) -> Result<(), Error> {
    let mut objects: Vec<String> = Vec::new();
    let mut place = Place::Outside;
    let mut object = 0;
    let mut normal = DVec3::ZERO;
    let mut corners: Vec<DVec3> = Vec::new();
    let mut cut = Vec::new();
    let mut face = 0_u32;
    let mut last = 0;
    for (number, line) in (1..).zip(bytes.split(|&b| b == b'\n')) {
        last = number;
        let line = line.trim_ascii();
        if line.is_empty() {
            continue;
        }
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let keyword = words.next().unwrap_or_default().to_ascii_lowercase();
        let unexpected = || {
            let due = match place {
                Place::Outside => "`solid`",
                Place::Solid => "`facet` or `endsolid`",
                Place::Facet => "`outer loop`",
                Place::Loop => "`vertex` or `endloop`",
                Place::AfterLoop => "`endfacet`",
            };
            let shown: String = String::from_utf8_lossy(line).chars().take(40).collect();
            Error::malformed(format!("`{}` where {due} is due", shown.escape_debug())).at(number)
        };
        place = match (place, keyword.as_slice()) {
            (Place::Outside, b"solid") => {
                let name = line.get(5..).unwrap_or_default().trim_ascii();
                object = u32::try_from(objects.len()).map_err(|_| {
                    Error::new(ErrorKind::TooLarge("has more solids than can be numbered".to_owned())).at(number)
                })?;
                objects.push(String::from_utf8_lossy(name).into_owned());
                Place::Solid
            }
            (Place::Solid, b"endsolid") => Place::Outside,
            (Place::Solid, b"facet") => {
                // Some programs write `facet` alone, or a sliver's normal without numbers.
                let numbers: Vec<f64> = words.skip(1).map_while(float).collect();
                normal = numbers
                    .first_chunk::<3>()
                    .map_or(DVec3::ZERO, |n| DVec3::from_array(*n));
                corners.clear();
                Place::Facet
            }
            (Place::Facet, b"outer") => Place::Loop,
            (Place::Loop, b"vertex") => {
                let mut numbers = [0.0; 3];
                for x in &mut numbers {
                    *x = words.next().and_then(float).ok_or_else(|| {
                        Error::malformed("a `vertex` needs three numbers, with a decimal point").at(number)
                    })?;
                }
                corners.push(DVec3::from_array(numbers));
                Place::Loop
            }
            (Place::Loop, b"endloop") => Place::AfterLoop,
            (Place::AfterLoop, b"endfacet") => {
                bounds.polygon(corners.len()).map_err(|error| error.at(number))?;
                compare_normal(normal, &corners, &mut scene.ledger, face);
                cut_face(&corners, &mut cut, &mut scene.ledger, || format!("line {number}"));
                push_triangles(
                    &corners,
                    &cut,
                    Labels {
                        object,
                        face,
                        ..Labels::default()
                    },
                    &mut scene.triangles,
                );
                face = face.checked_add(1).ok_or_else(|| {
                    Error::new(ErrorKind::TooLarge("has more faces than can be numbered".to_owned())).at(number)
                })?;
                Place::Solid
            }
            _ => return Err(unexpected()),
        };
    }
    if place != Place::Outside {
        return Err(Error::malformed("the file ends within a solid; it is cut short, get the whole of it").at(last));
    }
    number_solids(&mut objects, &mut scene.ledger);
    scene.objects = objects;
    Ok(())
}

/// Numbers solids that share a name, or have none.
fn number_solids(names: &mut [String], ledger: &mut Ledger) {
    let kind = Kind {
        fate: Fate::Doubtful,
        what: "solid without a name of its own, numbered as the file has them",
        next: "give the solids names where properties are to tell them apart",
    };
    let shared: Vec<&str> = names.iter().map(String::as_str).collect();
    for (at, name) in numbered(&shared, "solid", str::to_owned) {
        names[at] = name;
        ledger.lose(kind, 1, None, || format!("solid {}", at + 1));
    }
}

fn float(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid roof\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 \
        1.25e0 0\n  endloop\n endfacet\nendsolid roof\nSOLID wall 2\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0 0 0\n\
        VERTEX 0 1 0\nVERTEX 1 1 0\nVERTEX 1 0 0\nENDLOOP\nENDFACET\nENDSOLID\n";

    fn open(bytes: &[u8]) -> Result<Scene, Error> {
        read(bytes, None, ReadOptions::default())
    }

    fn binary_of(header: &[u8], corners: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(HEADER, 0);
        bytes.extend(u32::try_from(corners.len()).unwrap().to_le_bytes());
        for corners in corners {
            bytes.extend([0; 12]);
            bytes.extend(corners.iter().flatten().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn text_with_several_solids_and_a_quadrilateral() {
        let scene = open(TEXT.as_bytes()).unwrap();
        assert_eq!(scene.objects, ["roof", "wall 2"]);
        assert_eq!(scene.triangles.len(), 3);
        assert_eq!(scene.triangles[0].corners[2], DVec3::new(0.0, 1.25, 0.0));
        assert_eq!(scene.triangles.iter().map(|t| t.face).collect::<Vec<_>>(), [0, 1, 1]);
        let contradicting = "facet whose normal contradicts the order of its vertices, which is followed";
        assert_eq!(scene.ledger.get(contradicting), 1);
    }

    #[test]
    fn solids_of_one_name_or_none_are_numbered_as_the_file_has_them() {
        let again = TEXT.replace("wall 2", "roof");
        let scene = open(again.as_bytes()).unwrap();
        assert_eq!(scene.objects, ["roof 1", "roof 2"]);
        assert_eq!(scene.ledger.losses().count(), 2, "{}", scene.ledger);
        let bare = TEXT.replace("solid roof", "solid").replace("SOLID wall 2", "SOLID");
        assert_eq!(open(bare.as_bytes()).unwrap().objects, ["solid 1", "solid 2"]);
        let alone = &bare[..bare.find("SOLID").unwrap()];
        assert_eq!(open(alone.as_bytes()).unwrap().objects, [""]);
    }

    #[test]
    fn binary_even_if_its_header_says_solid() {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.5]];
        let bytes = binary_of(b"solid by some program", &[corners, corners]);
        let scene = open(&bytes).unwrap();
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.triangles[1].corners[2], DVec3::new(0.0, 1.0, 0.5));
        let mut longer = bytes.clone();
        longer.extend([0; 7]);
        assert_eq!(open(&longer).unwrap().ledger.get("byte after the last triangle"), 7);
    }

    #[test]
    fn what_is_cut_short_or_is_not_stl_is_refused_with_a_reason() {
        let bytes = binary_of(b"", &[[[0.0; 3]; 3]; 3]);
        let message = open(&bytes[..bytes.len() - 1]).unwrap_err().to_string();
        assert!(message.contains("announces 3 triangles, and 2 are there"), "{message}");
        assert!(open(b"").is_err() && open(b"hello").is_err());
        for (cut, expected) in [
            (TEXT.len() - 20, "line 17"),
            (TEXT.len() - 9, "line 19"),
            (60, "line 5"),
        ] {
            let message = open(&TEXT.as_bytes()[..cut]).unwrap_err().to_string();
            assert!(message.contains(expected), "{cut}: {message}");
        }
        let message = open(TEXT.replace("1.25e0", "1,25").as_bytes()).unwrap_err().to_string();
        assert!(message.starts_with("line 6: "), "{message}");
        let message = open(TEXT.replace("endloop", "vertx 0 0 0").as_bytes())
            .unwrap_err()
            .to_string();
        assert!(message.contains("`vertex` or `endloop` is due"), "{message}");
        let mut huge = bytes;
        huge[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(open(&huge).is_err());
    }
}
