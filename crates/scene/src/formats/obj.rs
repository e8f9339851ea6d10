//! Reads Wavefront OBJ scenes, and the reflectance and emission of their materials from `.mtl` libraries.
//!
//! Source: *Appendix B1. Object Files*, Advanced Visualizer manual (Wavefront 1993). The text is read by a parser of
//! our own, as `tobj` cuts polygons into fans, names no lines, and refuses much of what real files hold; `tobj` reads
//! the material libraries.
//!
//! # What becomes of what
//! - `v x y z …`: a vertex in full f64; a weight or a colour that follows is skipped. `nan`, `inf`, `1e400` are read:
//!   [`crate::repair`] drops the triangles that use them
//! - `f`, `fo`: triangles with the polygon's winding, concave ones by ear clipping. Of a corner `a/t/n` only `a`
//!   counts; negative ones count back from the last vertex
//! - a face with fewer than three corners, or without area: left out, and said; it keeps its face number
//! - a corner 0, or of a vertex that is not there (yet): an error
//! - a face with more than 65,536 corners: an error
//! - `o`, `g`: the name of the object of the faces that follow: the latest `g` since the latest `o`; an empty `g` goes
//!   back to the name of that `o`. The same name later is the same object. Several groups on one line are one name
//! - `usemtl`: the material of the faces that follow; an empty one is the material `""`, as before any
//! - `mtllib`: read only when optics are asked for: `Kd` as diffuse reflectance, `Ke` as emission, the numbers taken as
//!   linear; the first library and the first entry that has the name counts
//! - a library that cannot be read, or does not lie in the scene's folder or below it, links followed: a warning
//! - `l`, `p`, curves: skipped, counted; free-form surfaces, `call`, `csh`: left out, and said
//! - `vt`, `vn`, `vp`, `s` and the other attributes: skipped
//! - other lines: skipped, counted, the first few named in a warning
//!
//! Lines end with LF, CRLF or CR; a `\` before that, or before blanks at the end of a line, joins the next line. A `#` begins a comment, in names only after a
//! blank (`wall#2` is a name). The text is UTF-8 with or without a byte order mark, or any extension of ASCII: names
//! are decoded as UTF-8, other bytes as U+FFFD.
//!
//! No statement of OBJ announces how much is to follow, so memory is bounded by a multiple of the file's length.

use crate::bounds::Bounds;
use crate::ledger::UNREAD_LIBRARY;
use crate::names::Names;
use crate::polygon::{Labels, cut_face, push_triangles};
use crate::{Error, ErrorKind, Fate, Gloss, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Reads an OBJ scene from the bytes of a file. Material libraries are looked for in `base_dir`, and opened only when
/// `options` ask for optics.
///
/// # Errors
/// When a vertex has fewer than three numbers, a number or a face corner cannot be read, or a face names a vertex not
/// before it; the error names the line. A file without faces is no error: the scene has no triangles.
///
/// ```
/// use hemicube_scene::{ReadOptions, obj};
///
/// // A polygon that is not convex, and a line.
/// let text = b"v 0 0 0\nv 4 0 0\nv 4 4 0\nv 1 1 0\ng step\nusemtl brick\nf 1 2 3 4\nl 1 2\n";
/// let scene = obj::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0], &*scene.materials[0].name), (2, "step", "brick"));
/// assert!(scene.triangles.iter().all(|triangle| triangle.face == 0));
/// assert_eq!(scene.ledger.get("line element"), 1, "what is no surface is counted");
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let text = crate::text::unmarked(bytes)?;
    let mut reader = Reader {
        bounds: Bounds::new(bytes.len(), options),
        ..Reader::default()
    };
    let mut lines = Lines { rest: text, number: 0 };
    let mut joined = Vec::new();
    while let Some(line) = lines.next() {
        let result = if line.continues() {
            joined.clear();
            let mut hash = false;
            let mut part = Some(line);
            while let Some(line) = part {
                hash |= line.hash;
                let continues = line.continues();
                joined.extend_from_slice(if continues { line.without_last() } else { line.text });
                // The parts of a continued line are apart even if neither has a blank.
                joined.push(b' ');
                part = if continues { lines.next() } else { None };
            }
            reader.line(Line {
                number: line.number,
                text: &joined,
                hash,
            })
        } else {
            reader.line(line)
        };
        result.map_err(|error| error.at(line.number))?;
    }
    if options.optics {
        reader.read_libraries(base_dir);
    }
    Ok(reader.scene())
}

/// Number of unknown lines, or of unreadable libraries, named by warnings.
const NAMED: u64 = 3;
/// Most bytes of material libraries read for one scene.
const LIBRARY_BYTES_MAX: u64 = 64 << 20;
/// Most material libraries opened for one scene.
const LIBRARIES_MAX: usize = 1000;
fn is_blank(byte: u8) -> bool {
    byte == b' ' || (b'\t'..=b'\r').contains(&byte)
}

fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(|&b| is_blank(b)).filter(|word| !word.is_empty())
}

/// The first word of a line and the text after it.
fn keyword(text: &[u8]) -> (&[u8], &[u8]) {
    let start = text.iter().position(|&b| !is_blank(b)).unwrap_or(text.len());
    let (_, text) = text.split_at(start);
    text.split_at(text.iter().position(|&b| is_blank(b)).unwrap_or(text.len()))
}

/// A name without its comment.
fn name(text: &[u8]) -> String {
    let mut after_blank = true;
    let end = text.iter().position(|&b| {
        let begins = after_blank && b == b'#';
        after_blank = is_blank(b);
        begins
    });
    let text = text.get(..end.unwrap_or(text.len())).unwrap_or_default();
    // Blanks of Unicode too: `tobj` trims them.
    String::from_utf8_lossy(text).trim().to_owned()
}

/// Bytes of a file for a message: printable, and not too many.
fn quoted(bytes: &[u8]) -> String {
    let shown = bytes.get(..40).unwrap_or(bytes);
    let more = if shown.len() < bytes.len() { "…" } else { "" };
    format!("`{}{more}`", String::from_utf8_lossy(shown).escape_debug())
}

#[derive(Clone, Copy)]
struct Line<'a> {
    /// From 1.
    number: u64,
    text: &'a [u8],
    /// True if there is a `#` in it.
    hash: bool,
}

impl<'a> Line<'a> {
    /// Returns whether the next line belongs to this one. A comment ends with its line, even after a backslash: `C:\`.
    fn continues(&self) -> bool {
        self.text.trim_ascii_end().last() == Some(&b'\\')
            && !(self.hash && self.without_comment().len() < self.text.len())
    }

    fn without_last(&self) -> &'a [u8] {
        self.text.trim_ascii_end().split_last().map_or(&[], |(_, text)| text)
    }

    /// The text up to a `#` comment. A `#` in a number, as some C libraries print non-finite ones (`1.#INF`), begins
    /// none.
    fn without_comment(&self) -> &'a [u8] {
        let mut before = [b' ', b' '];
        let end = self.text.iter().position(|&b| {
            let begins = b == b'#' && before != *b"1.";
            before = [before[1], b];
            begins
        });
        self.text.get(..end.unwrap_or(self.text.len())).unwrap_or_default()
    }
}

struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    #[inline]
    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let mut hash = false;
        let end = self.rest.iter().position(|&b| {
            hash |= b == b'#';
            b == b'\n' || b == b'\r'
        });
        let (text, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = match rest {
            [b'\r', b'\n', rest @ ..] | [_, rest @ ..] => rest,
            [] => &[],
        };
        Some(Line {
            number: self.number,
            text,
            hash,
        })
    }
}

/// Reads a number in the spelling of C and OBJ writers.
fn number(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    if let Ok(x) = text.parse() {
        return Some(x);
    }
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text),
    };
    match rest.to_ascii_lowercase() {
        rest if rest.starts_with("1.#inf") => Some(sign * f64::INFINITY),
        rest if rest.starts_with("1.#") || rest.starts_with("nan(") => Some(f64::NAN),
        _ => None,
    }
}

#[derive(Default)]
struct Reader {
    bounds: Bounds,
    vertices: Vec<DVec3>,
    triangles: Vec<Triangle>,
    objects: Names,
    materials: Names,
    optics: HashMap<String, Material>,
    /// The name of the latest `o`.
    object_name: String,
    /// The name of the latest `g` since, if any.
    group_name: String,
    material_name: String,
    /// Numbers of the names above, once a face has used them.
    object: Option<u32>,
    material: Option<u32>,
    /// The text after each `mtllib`, once each, and whether it is known.
    libraries: Vec<Vec<u8>>,
    known_libraries: HashSet<Vec<u8>>,
    ledger: Ledger,
    face: u32,
    /// The line read.
    line: u64,
    corners: Vec<DVec3>,
    cut: Vec<[u32; 3]>,
}

impl Reader {
    #[inline]
    fn line(&mut self, line: Line<'_>) -> Result<(), Error> {
        let (word, rest) = keyword(line.text);
        self.line = line.number;
        match word {
            b"v" if !line.hash => self.vertex(rest),
            b"f" if !line.hash => self.face(rest),
            _ => self.other_line(line, word, rest),
        }
    }

    fn other_line(&mut self, line: Line<'_>, word: &[u8], rest: &[u8]) -> Result<(), Error> {
        if line.hash && matches!(word.iter().position(|&b| b == b'#'), Some(at) if at > 0) {
            // The comment touches the keyword: `g#`.
            let (word, _) = keyword(line.without_comment());
            return self.other_line(Line { hash: false, ..line }, word, &[]);
        }
        match word {
            b"v" => self.vertex(keyword(line.without_comment()).1)?,
            b"f" | b"fo" => self.face(keyword(line.without_comment()).1)?,
            b"vt" | b"vn" | b"s" | [] | [b'#', ..] => {}
            b"o" => {
                self.object_name = name(rest);
                self.group_name.clear();
                self.object = None;
            }
            b"g" => {
                self.group_name = name(rest);
                self.object = None;
            }
            b"usemtl" => {
                self.material_name = name(rest);
                self.material = None;
            }
            b"mtllib" => {
                let library = name(rest).into_bytes();
                if self.known_libraries.insert(library.clone()) {
                    self.libraries.push(library);
                }
            }
            b"l" => self.ledger.note("line element"),
            b"p" => self.ledger.note("point element"),
            b"surf" => self.lose("free-form surface", "make faces of it in the modeller", line.number),
            b"curv" | b"curv2" | b"bsp" | b"bzp" | b"cdc" | b"cdp" => {
                self.ledger.note("free-form curve");
            }
            b"call" | b"csh" => {
                self.lose(
                    "command in the file, not run",
                    "put what it stands for into the file",
                    line.number,
                );
            }
            // Attributes, parts of free-form elements, and (`vw`, `t`) extensions by other programs.
            b"vp" | b"mg" | b"bevel" | b"c_interp" | b"d_interp" | b"lod" | b"maplib" | b"usemap" | b"shadow_obj"
            | b"trace_obj" | b"ctech" | b"stech" | b"cstype" | b"deg" | b"bmat" | b"step" | b"parm" | b"trim"
            | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"res" | b"vw" | b"t" => {}
            _ => {
                let reason = "line that is no OBJ, skipped";
                if self.ledger.get(reason) < NAMED {
                    self.ledger.warnings.push(format!(
                        "line {}: {} begins no statement of OBJ; the line was skipped",
                        line.number,
                        quoted(word)
                    ));
                }
                self.ledger.note(reason);
            }
        }
        Ok(())
    }

    fn lose(&mut self, what: &str, next: &str, line: u64) {
        let fate = Fate::LeftOut;
        self.ledger
            .lose(Kind { fate, what, next }, 1, None, || format!("line {line}"));
    }

    #[inline]
    fn vertex(&mut self, rest: &[u8]) -> Result<(), Error> {
        let mut words = words(rest);
        let mut vertex = [0.0; 3];
        for (count, x) in vertex.iter_mut().enumerate() {
            let Some(word) = words.next() else {
                return Err(Error::malformed(format!(
                    "`v` has {count} numbers; a vertex needs three"
                )));
            };
            *x = number(word).ok_or_else(|| {
                let hint = if word.contains(&b',') {
                    "; write a decimal point, not a comma"
                } else {
                    ""
                };
                Error::malformed(format!("{} is no number{hint}", quoted(word)))
            })?;
        }
        self.vertices.push(DVec3::from_array(vertex));
        Ok(())
    }

    /// The vertex of a face corner such as `12`, `-1`, `3/1` or `3//2`.
    #[inline]
    fn corner(&self, word: &[u8]) -> Result<DVec3, Error> {
        let (index, rest) = word.split_at(word.iter().position(|&b| b == b'/').unwrap_or(word.len()));
        let (back, digits) = match index {
            [b'-', digits @ ..] => (true, digits),
            [b'+', digits @ ..] => (false, digits),
            digits => (false, digits),
        };
        if digits.is_empty()
            || !digits.iter().all(u8::is_ascii_digit)
            || !rest.iter().all(|b| matches!(b, b'0'..=b'9' | b'/' | b'-' | b'+'))
        {
            return Err(Error::malformed(format!(
                "{} is no face corner; write the number of a vertex, or `vertex/texture/normal`",
                quoted(word)
            )));
        }
        let index = digits.iter().fold(0_usize, |n, &b| {
            n.saturating_mul(10).saturating_add(usize::from(b - b'0'))
        });
        let count = self.vertices.len();
        let at = if back {
            count.checked_sub(index)
        } else {
            index.checked_sub(1)
        };
        match at.and_then(|at| self.vertices.get(at)) {
            Some(&vertex) => Ok(vertex),
            None if index == 0 => Err(Error::malformed(format!(
                "face corner {} is of vertex 0; OBJ counts vertices from 1",
                quoted(word)
            ))),
            None => Err(Error::malformed(format!(
                "face corner {} is of a vertex that is not there; {count} come before this line",
                quoted(word)
            ))),
        }
    }

    fn face(&mut self, rest: &[u8]) -> Result<(), Error> {
        self.corners.clear();
        for word in words(rest) {
            let corner = self.corner(word)?;
            self.corners.push(corner);
        }
        let face = self.face;
        self.face = face
            .checked_add(1)
            .ok_or_else(|| Error::new(ErrorKind::TooLarge(format!("has more than {face} faces"))))?;

        let count = self.corners.len();
        self.bounds.polygon(count)?;
        let finite = self.corners.iter().all(|corner| corner.is_finite());
        if !finite {
            self.ledger.note("face with a corner that is not finite");
        }
        let line = self.line;
        cut_face(&self.corners, &mut self.cut, &mut self.ledger, || {
            format!("line {line}")
        });
        if self.cut.is_empty() {
            return Ok(());
        }
        if count > 3 && finite {
            let first = self.corners.first();
            if self.corners.windows(2).any(|edge| matches!(edge, [a, b] if a == b)) || first == self.corners.last() {
                self.ledger.note("face with a repeated corner, mended");
            }
        }

        let object = match self.object {
            Some(object) => object,
            None => {
                let name = if self.group_name.is_empty() {
                    &self.object_name
                } else {
                    &self.group_name
                };
                *self.object.insert(self.objects.number(name)?)
            }
        };
        let material = match self.material {
            Some(material) => material,
            None => *self.material.insert(self.materials.number(&self.material_name)?),
        };
        push_triangles(
            &self.corners,
            &self.cut,
            Labels { object, material, face },
            &mut self.triangles,
        );
        Ok(())
    }

    fn scene(self) -> Scene {
        let mut optics = self.optics;
        Scene {
            triangles: self.triangles,
            objects: self.objects.names,
            materials: self
                .materials
                .names
                .into_iter()
                .map(|name| {
                    optics.remove(&name).unwrap_or_else(|| Material {
                        name,
                        ..Material::default()
                    })
                })
                .collect(),
            ledger: self.ledger,
            ..Scene::default()
        }
    }

    fn read_libraries(&mut self, base_dir: Option<&Path>) {
        let mut budget = LIBRARY_BYTES_MAX;
        let mut opened = 0;
        for line in std::mem::take(&mut self.libraries) {
            let line = String::from_utf8_lossy(&line).into_owned();
            if line.is_empty() {
                continue;
            }
            let Some(base_dir) = base_dir else {
                self.warn_of_library(&line, "the scene is not read from a file that it could lie beside");
                continue;
            };
            for name in library_names(base_dir, &line) {
                opened += 1;
                if opened > LIBRARIES_MAX {
                    self.warn_of_library(name, &format!("the scene names more than {LIBRARIES_MAX}"));
                    return;
                }
                match open(base_dir, name).and_then(|file| text_of(file, &mut budget)) {
                    Ok(text) => self.read_library(name, &text),
                    Err(reason) => self.warn_of_library(name, &reason),
                }
            }
        }
        let missing = self
            .materials
            .names
            .iter()
            .filter(|name| !name.is_empty() && !self.optics.contains_key(*name));
        self.ledger
            .note_many("material that no library describes", missing.count() as u64);
    }

    fn warn_of_library(&mut self, name: &str, reason: &str) {
        let counted = "material library that could not be read";
        if self.ledger.get(counted) < NAMED {
            self.ledger.warnings.push(format!(
                "{UNREAD_LIBRARY} {} could not be read: {reason}",
                quoted(name.as_bytes())
            ));
        }
        self.ledger.note(counted);
    }

    fn read_library(&mut self, name: &str, text: &[u8]) {
        let text = match crate::text::unmarked(text) {
            Ok(text) => text,
            Err(error) => return self.warn_of_library(name, &format!("it {error}")),
        };
        let lines = self.library_lines(text);
        let materials = match tobj::load_mtl_buf(&mut lines.as_bytes()) {
            Ok((materials, _)) => materials,
            Err(error) => return self.warn_of_library(name, &error.to_string()),
        };
        for read in materials {
            let mut diffuse = read.diffuse;
            if let Some(rgb) = &mut diffuse {
                let clamped = rgb.map(|x| x.clamp(0.0, 1.0));
                if clamped != *rgb {
                    self.ledger.note("reflectance outside 0 to 1, clamped");
                    *rgb = clamped;
                }
            }
            let mut emission = read.emissive;
            if emission.is_some_and(|rgb| rgb.iter().any(|&x| x < 0.0)) {
                self.ledger.note("negative emission, read as none");
                emission = None;
            }
            let gloss = gloss(&read);
            self.optics.entry(read.name.clone()).or_insert(Material {
                name: read.name,
                diffuse,
                emission,
                gloss,
            });
        }
    }

    /// The `newmtl`, `Kd`, `Ke`, `Ks`, `d`, `Tr`, `Ni` and `illum` lines of a material library, fit for `tobj`. `tobj`
    /// gives up a whole library at one bad line, even of a kind unused here, and panics at a colour of fewer than three
    /// numbers.
    fn library_lines(&mut self, text: &[u8]) -> String {
        let mut kept = String::new();
        let mut named = false;
        for line in (Lines { rest: text, number: 0 }) {
            let (word, rest) = keyword(line.text);
            let key = match word {
                b"newmtl" => {
                    let name = name(rest);
                    named = !name.is_empty();
                    if named {
                        kept.extend(["newmtl ", &name, "\n"]);
                    }
                    continue;
                }
                b"Kd" if named => "Kd",
                b"Ke" if named => "Ke",
                b"Ks" | b"d" | b"Tr" | b"Ni" | b"illum" if named => {
                    kept.extend(gloss_line(word, line.without_comment()));
                    continue;
                }
                _ => continue,
            };
            let (_, rest) = keyword(line.without_comment());
            let mut numbers = words(rest).map_while(|word| {
                let text = std::str::from_utf8(word).ok()?;
                text.parse::<f64>().is_ok_and(f64::is_finite).then_some(text)
            });
            match [numbers.next(), numbers.next(), numbers.next()] {
                [Some(r), Some(g), Some(b)] => kept.extend([key, " ", r, " ", g, " ", b, "\n"]),
                // One number is all three, by the format's rules.
                [Some(r), None, _] if words(rest).count() == 1 => {
                    kept.extend([key, " ", r, " ", r, " ", r, "\n"]);
                }
                // A spectrum, in a file of its own or in other coordinates.
                _ => self.ledger.note("material colour that is no three numbers, skipped"),
            }
        }
        kept
    }
}

/// A line of a mirror's or a pane's properties, fit for `tobj`; `None` for one without numbers in range.
fn gloss_line(word: &[u8], line: &[u8]) -> Option<String> {
    let (_, rest) = keyword(line);
    let numbers = words(rest).map(|word| std::str::from_utf8(word).ok()?.parse::<f64>().ok());
    let numbers: Vec<f64> = numbers.collect::<Option<_>>()?;
    let share = |share: &f64| (0.0..=1.0).contains(share);
    match (word, numbers.as_slice()) {
        (b"Ks", [r, g, b]) if numbers.iter().all(share) => Some(format!("Ks {r} {g} {b}\n")),
        (b"Ks", [grey]) if share(grey) => Some(format!("Ks {grey} {grey} {grey}\n")),
        (b"d", [opaque]) if share(opaque) => Some(format!("d {opaque}\n")),
        (b"Tr", [clear]) if share(clear) => Some(format!("d {}\n", 1.0 - clear)),
        (b"Ni", [index]) if index.is_finite() => Some(format!("Ni {index}\n")),
        (b"illum", [model]) if (0.0..=10.0).contains(model) && model.fract() == 0.0 => Some(format!("illum {model}\n")),
        _ => None,
    }
}

/// The mirror or pane that a material is, by its illumination model.
fn gloss(read: &tobj::Material) -> Option<Gloss> {
    let specular = read.specular.unwrap_or([0.0; 3]);
    let clear = 1.0 - read.dissolve.unwrap_or(1.0);
    let index = read.optical_density.filter(|index| *index > 1.0);
    let gloss = match read.illumination_model? {
        3 | 8 => Gloss {
            specular,
            ..Gloss::default()
        },
        5 => Gloss {
            specular,
            index,
            ..Gloss::default()
        },
        4 | 6 | 9 => Gloss {
            specular: specular.map(|s| s.min(1.0 - clear)),
            transmittance: [clear; 3],
            index: None,
        },
        7 => Gloss {
            specular: specular.map(|s| s.min(1.0 - clear)),
            transmittance: [clear; 3],
            index,
        },
        _ => return None,
    };
    let is_any = gloss.index.is_some()
        || gloss
            .specular
            .iter()
            .chain(&gloss.transmittance)
            .any(|share| *share > 0.0);
    is_any.then_some(gloss)
}

/// The names on an `mtllib` line: one with blanks in it, if there is such a file, or several.
fn library_names<'a>(base_dir: &Path, line: &'a str) -> Vec<&'a str> {
    if open(base_dir, line).is_ok() {
        vec![line]
    } else {
        line.split_whitespace().collect()
    }
}

/// Opens a library beside the scene; backslashes may stand for slashes.
fn open(base_dir: &Path, name: &str) -> Result<File, String> {
    let opened = crate::regular::open_beside(base_dir, name);
    let opened = match opened {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && name.contains('\\') => {
            crate::regular::open_beside(base_dir, &name.replace('\\', "/"))
        }
        opened => opened,
    };
    opened.map_err(|e| e.to_string())
}

fn text_of(file: File, budget: &mut u64) -> Result<Vec<u8>, String> {
    let mut text = Vec::new();
    let read = file
        .take(*budget + 1)
        .read_to_end(&mut text)
        .map_err(|e| e.to_string())?;
    match budget.checked_sub(read as u64) {
        Some(rest) => *budget = rest,
        None => return Err(format!("the libraries are larger than {LIBRARY_BYTES_MAX} bytes")),
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn library(text: &[u8]) -> Reader {
        let mut reader = Reader::default();
        reader.read_library("test", text);
        reader
    }

    #[test]
    fn libraries_as_programs_write_them() {
        let reader = library(
            b"\xEF\xBB\xBF# made by\r\nKd 9 9 9\r\nnewmtl\r\nKd 8 8 8\r\n  newmtl  red wall # of brick\r\n\
                Ns 10.0\r\n\tKd .63 0.065 5e-2 # measured\r\n\
              illum x\r\nmap_Kd\r\nd\r\nnewmtl light\rKe 17 12 4\rKd 0.78\rKs 1 1\r\
              newmtl r\xF6d\nKd spectral red.rfl 1\nKe xyz 1 1 1\n\
              newmtl bright\nKd 1.5 -1 0.5\nKe -1 0 0\nnewmtl light\nKd 0 0 0\nnewmtl odd\nKd nan 0 0\nKe 1 2\n",
        );
        let of = |name: &str| reader.optics.get(name).map(|m| (m.diffuse, m.emission));
        assert_eq!(of("red wall"), Some((Some([0.63, 0.065, 0.05]), None)));
        assert_eq!(
            of("light"),
            Some((Some([0.78; 3]), Some([17.0, 12.0, 4.0]))),
            "the first entry counts"
        );
        assert_eq!(of("r\u{FFFD}d"), Some((None, None)));
        assert_eq!(of("bright"), Some((Some([1.0, 0.0, 0.5]), None)));
        assert_eq!(of("odd"), Some((None, None)));
        assert_eq!(reader.optics.len(), 5);
        assert_eq!(reader.ledger.get("reflectance outside 0 to 1, clamped"), 1);
        assert_eq!(reader.ledger.get("negative emission, read as none"), 1);
        assert_eq!(
            reader.ledger.get("material colour that is no three numbers, skipped"),
            4
        );
        assert_eq!(reader.ledger.get("material library that could not be read"), 0);
    }

    #[test]
    fn numbers_as_programs_write_them() {
        for (text, expected) in [
            ("1", 1.0),
            ("+1.5e+01", 15.0),
            ("-.5", -0.5),
            ("5.", 5.0),
            ("0003.0E-2", 0.03),
            ("2678219.194", 2_678_219.194),
            ("1e400", f64::INFINITY),
            ("-inf", f64::NEG_INFINITY),
            ("-1.#INF", f64::NEG_INFINITY),
            ("1e-400", 0.0),
        ] {
            assert_eq!(number(text.as_bytes()), Some(expected), "{text}");
        }
        for text in ["nan", "-NaN", "1.#QNAN", "-1.#IND00", "-nan(ind)"] {
            assert!(number(text.as_bytes()).is_some_and(f64::is_nan), "{text}");
        }
        for text in ["", "-", ".", "1,5", "1e", "0x10", "1.0f", "1_0", "one", "1.5.2"] {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
        assert_eq!(number(b"\xFF1"), None);
    }

    proptest! {
        #[test]
        fn any_library_at_all(text in prop::collection::vec(any::<u8>(), 0..300)) {
            library(&text);
        }

        #[test]
        fn libraries_of_any_words(words in prop::collection::vec(prop::sample::select(vec![
            "newmtl", "Kd", "Ke", "Ns", "map_Kd", "illum", "a", "b", "1", "0.5", "nan", "1e400", "#", "\\", "\n",
            "\n", "\r", " ",
            "\u{2028}", "é",
        ]), 0..60)) {
            let reader = library(words.join(" ").as_bytes());
            prop_assert_eq!(reader.ledger.get("material library that could not be read"), 0);
            for material in reader.optics.values() {
                prop_assert!(material.diffuse.is_none_or(|rgb| rgb.iter().all(|x| (0.0..=1.0).contains(x))));
                prop_assert!(material.emission.is_none_or(|rgb| rgb.iter().all(|x| x.is_finite() && *x >= 0.0)));
            }
        }
    }
}
