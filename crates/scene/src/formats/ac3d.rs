//! Reads AC3D scenes: `.ac` of the AC3D modeller and `.acc` of the racing simulator TORCS.
//!
//! Source: *The AC3D file format* (Inivis, 27 March 2003) for `.ac`. `.acc` has no specification; its files have six
//! numbers a vertex line (position, normal), up to nine a corner line, several `texture` lines an object, and surface
//! type 4, a triangle strip.
//!
//! The file is text, one keyword a line, objects in a tree: `kids` gives the number of following objects that are an
//! object's children.
//!
//! # Transforms
//! An object's `loc` and `rot` place it in its parent. With **row vectors**, and `R` the matrix whose rows are the
//! first, second and third three numbers of the `rot` line (r₀ … r₈),
//!
//! ```text
//! parent = point · R + loc        x' = x r₀ + y r₃ + z r₆ + loc_x
//!                                 y' = x r₁ + y r₄ + z r₇ + loc_y
//!                                 z' = x r₂ + y r₅ + z r₈ + loc_z
//! ```
//!
//! and so on up the tree. The specification leaves open which way round `rot` is meant, and readers disagree: this is
//! OpenSceneGraph's reading, assimp has the transpose. The order of the lines does not matter. Corners keep their
//! order, so an object under a mirroring `rot` is turned inside out; such objects are counted.
//!
//! # What becomes of what
//! - surface type 0, polygon: triangles, concave ones by ear clipping; with its winding
//! - type 1 and 2, closed and open line: skipped, counted
//! - type 4, triangle strip: triangles of alternating order, those without area too ([`crate::repair`] drops them)
//! - other types: skipped, counted
//! - surface bit `0x20`: [`Triangle::two_sided`](crate::Triangle::two_sided)
//! - surface bit `0x10` (smooth shading), `crease`, `texture`, `texrep`, `texoff`, `url`, `data`, `locked`, `folded`:
//!   of no meaning to geometry: skipped
//! - `hidden`: read all the same, counted
//! - `subdiv`: read as the control mesh, counted
//! - `OBJECT light`: skipped, counted
//! - `name`: the object's name; without one `object N`, the file's N-th object, from 1
//! - `MATERIAL`, `MAT` … `ENDMAT` (version c): `rgb` as diffuse reflectance, `emis` as emission, when asked for; the
//!   numbers are taken as linear
//! - surface without `mat`: the first material
//! - `mat` beyond the materials: the first material, counted; an error when the file has no material at all
//! - other lines, such as conflict markers of a version control system: skipped, counted, the first few named in a
//!   warning
//! - the same property twice in an object: the last is taken, counted
//!
//! Line ends may be LF, CRLF or CR; the text may be UTF-8, UTF-16, or any extension of ASCII. Names are decoded as
//! UTF-8, other bytes as U+FFFD.
//!
//! # Counts that lie
//! No count is believed when memory is taken. `kids`, `numvert` and `numsurf` that do not match what follows are
//! ledger, as the file can still be read in one way only; objects that no `kids` asked for are top-level. So is
//! `data` whose length ends within a line: it is then taken to go on to the next keyword. `refs` that promises more
//! corners than follow is an error, and so is a file that ends within vertices, surfaces or corners.

use crate::bounds::Bounds;
use crate::polygon::{TOO_FEW_CORNERS, cut_face};
use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::{DAffine3, DMat3, DVec3};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Reads an AC3D scene from the bytes of a file. The directory does not matter: the format refers to textures only, and
/// those are not read.
///
/// # Errors
/// When the header is missing, a number cannot be read, a surface names a missing vertex, or the file ends within
/// vertices, surfaces or corners; the error names the line.
///
/// ```
/// use hemicube_scene::{ReadOptions, ac3d};
///
/// let text = b"AC3Db\nMATERIAL \"tin\" rgb 1 1 1 amb 0 0 0 emis 0 0 0 spec 0 0 0 shi 0 trans 0\n\
///     OBJECT world\nkids 1\nOBJECT poly\nname \"wing\"\nnumvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\n\
///     SURF 0x20\nmat 0\nrefs 3\n0 0 0\n1 0 0\n2 0 0\nkids 0\n";
/// let scene = ac3d::read(text, None, ReadOptions::default())?;
/// assert_eq!((&*scene.objects[scene.triangles[0].object as usize], &*scene.materials[0].name), ("wing", "tin"));
/// assert!(scene.triangles[0].two_sided, "0x20 says so");
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let text = text_of(bytes);
    let mut reader = Reader::new(&text, options);
    reader.header()?;
    while let Some(line) = reader.lines.next() {
        reader.line(line)?;
    }
    reader.finish()
}

/// Keywords at the start of a line: they tell a wrong count from unknown text.
const KEYWORDS: [&[u8]; 23] = [
    b"MATERIAL",
    b"MAT",
    b"ENDMAT",
    b"OBJECT",
    b"kids",
    b"name",
    b"data",
    b"texture",
    b"texrep",
    b"texoff",
    b"rot",
    b"loc",
    b"url",
    b"crease",
    b"subdiv",
    b"hidden",
    b"locked",
    b"folded",
    b"numvert",
    b"numsurf",
    b"SURF",
    b"mat",
    b"refs",
];

/// Number of unknown lines named by a warning; the rest are only counted.
const NAMED_LINES: u64 = 3;

/// The text of a file without its byte order mark, in an extension of ASCII, each line ended by LF.
fn text_of(bytes: &[u8]) -> Cow<'_, [u8]> {
    let decode = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
        let text: String = char::decode_utf16(units)
            .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect();
        Cow::Owned(text.into_bytes())
    };
    // The header is ASCII, so UTF-16 shows even without a mark.
    let text = match bytes {
        [0xFF, 0xFE, rest @ ..] => decode(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => decode(rest, u16::from_be_bytes),
        [b'A', 0, b'C', 0, ..] => decode(bytes, u16::from_le_bytes),
        [0, b'A', 0, b'C', ..] => decode(bytes, u16::from_be_bytes),
        // Text with another mark was decoded above.
        _ => Cow::Borrowed(crate::text::unmarked(bytes).unwrap_or(bytes)),
    };
    if !text.contains(&b'\r') {
        return text;
    }
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text.iter().copied().peekable();
    while let Some(byte) = rest.next() {
        if byte == b'\r' {
            rest.next_if_eq(&b'\n');
            out.push(b'\n');
        } else {
            out.push(byte);
        }
    }
    Cow::Owned(out)
}

/// A line with text.
#[derive(Clone, Copy)]
struct Line<'a> {
    /// From 1.
    number: u64,
    /// The first word.
    word: &'a [u8],
    /// The rest of the line.
    rest: &'a [u8],
}

impl<'a> Line<'a> {
    fn words(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        words(self.rest)
    }

    fn is_keyword(&self) -> bool {
        KEYWORDS.contains(&self.word)
    }

    /// The count after a keyword.
    fn count(&self) -> Result<u64, Error> {
        let word = self.words().next().unwrap_or_default();
        integer(word).and_then(|n| u64::try_from(n).ok()).ok_or_else(|| {
            let keyword = excerpt(self.word);
            let shown = excerpt(word);
            self.malformed(format!(
                "`{shown}` after `{keyword}` is no count; a whole number from 0 belongs there"
            ))
        })
    }

    /// `N` numbers after a keyword.
    fn numbers<const N: usize>(&self) -> Result<[f64; N], Error> {
        let mut numbers = [0.0; N];
        let mut words = self.words();
        for out in &mut numbers {
            let word = words.next().unwrap_or_default();
            *out = number(word).ok_or_else(|| {
                let keyword = excerpt(self.word);
                let shown = excerpt(word);
                self.malformed(format!(
                    "`{shown}` after `{keyword}` is no number; {N} numbers belong there"
                ))
            })?;
        }
        Ok(numbers)
    }

    /// The type and properties after `SURF`.
    fn flags(&self) -> Result<u64, Error> {
        let word = self.words().next().unwrap_or_default();
        let flags = match word {
            [b'0', b'x' | b'X', digits @ ..] => std::str::from_utf8(digits)
                .ok()
                .and_then(|digits| u64::from_str_radix(digits, 16).ok()),
            _ => integer(word).and_then(|n| u64::try_from(n).ok()),
        };
        flags.ok_or_else(|| {
            let shown = excerpt(word);
            self.malformed(format!(
                "`{shown}` after `SURF` is no set of flags; a hexadecimal number such as `0x10` belongs there"
            ))
        })
    }

    fn malformed(&self, message: String) -> Error {
        Error::malformed(message).at(self.number)
    }
}

/// The remaining lines.
#[derive(Clone, Copy)]
struct Lines<'a> {
    rest: &'a [u8],
    /// Number of the last line handed out, from 1.
    number: u64,
}

impl<'a> Lines<'a> {
    fn next(&mut self) -> Option<Line<'a>> {
        while !self.rest.is_empty() {
            let mut parts = self.rest.splitn(2, |&b| b == b'\n');
            let text = parts.next().unwrap_or_default();
            self.rest = parts.next().unwrap_or_default();
            self.number += 1;
            let (word, rest) = split_word(text);
            if !word.is_empty() {
                return Some(Line {
                    number: self.number,
                    word,
                    rest,
                });
            }
        }
        None
    }

    /// Passes over text of `length` bytes ending at a line's end. `false` if it does not end there: then nothing is
    /// passed.
    fn skip_text(&mut self, length: u64) -> bool {
        let Some((text, rest)) = usize::try_from(length).ok().and_then(|n| self.rest.split_at_checked(n)) else {
            return false;
        };
        // Some writers count the line end after the text, some don't.
        let rest = match rest {
            [] => rest,
            [b'\n', after @ ..] => {
                self.number += 1;
                after
            }
            _ if text.last() == Some(&b'\n') => rest,
            _ => return false,
        };
        self.number += text.iter().map(|&b| u64::from(b == b'\n')).sum::<u64>();
        self.rest = rest;
        true
    }
}

/// An object before its `kids` line.
struct Object {
    /// Its name in errors.
    name: String,
    is_light: bool,
    world_from_parent: DAffine3,
    location: Option<DVec3>,
    rotation: Option<DMat3>,
    vertices: Vec<DVec3>,
    has_vertices: bool,
    surfaces_promised: Option<u64>,
    surfaces_read: u64,
    surface: Option<Surface>,
    pieces: Vec<Piece>,
}

/// A surface before its `refs`.
#[derive(Clone, Copy, Default)]
struct Surface {
    /// `None`: the `SURF` line is missing so far.
    flags: Option<u64>,
    /// Index of the material, and its line.
    material: Option<(u64, u64)>,
}

/// A triangle by the object's vertices.
struct Piece {
    vertices: [u32; 3],
    face: u32,
    /// Index into the materials of the file.
    material: u32,
    two_sided: bool,
}

/// An object with children still to come.
struct Parent {
    world_from_object: DAffine3,
    awaited: u64,
}

struct Reader<'a> {
    lines: Lines<'a>,
    options: ReadOptions,
    triangles: Vec<Triangle>,
    objects: Vec<String>,
    /// All materials, in the file's order.
    materials: Vec<Material>,
    ledger: Ledger,
    object: Option<Object>,
    parents: Vec<Parent>,
    objects_read: u64,
    faces_read: u32,
    lines_named: u64,
    /// Surfaces by the number of a material that was not there yet: it may still come.
    surfaces_awaiting_material: BTreeMap<u64, u64>,
    first_material_line: Option<u64>,
    bounds: Bounds,
    // Scratch space of one surface.
    refs: Vec<u32>,
    corners: Vec<DVec3>,
    cut: Vec<[u32; 3]>,
}

impl<'a> Reader<'a> {
    fn new(text: &'a [u8], options: ReadOptions) -> Self {
        Self {
            lines: Lines { rest: text, number: 0 },
            options,
            triangles: Vec::new(),
            objects: Vec::new(),
            materials: Vec::new(),
            ledger: Ledger::default(),
            object: None,
            parents: Vec::new(),
            objects_read: 0,
            faces_read: 0,
            lines_named: 0,
            surfaces_awaiting_material: BTreeMap::new(),
            first_material_line: None,
            bounds: Bounds::new(text.len(), options),
            refs: Vec::new(),
            corners: Vec::new(),
            cut: Vec::new(),
        }
    }

    fn header(&mut self) -> Result<(), Error> {
        let first = self.lines.next();
        let word = first.map_or(&b""[..], |line| line.word);
        let Some(version) = word.strip_prefix(b"AC3D") else {
            let shown = excerpt(word);
            return Err(Error::malformed(format!(
                "begins with `{shown}` instead of `AC3Db`: this is no AC3D file; check that it is complete and has the \
                 right extension"
            ))
            .at(first.map_or(1, |line| line.number)));
        };
        if version != b"b" && version != b"c" {
            let shown = excerpt(word);
            self.ledger.warnings.push(format!(
                "The header is `{shown}`; the versions known here are `AC3Db` and `AC3Dc`. It was read as if it were \
                 one of them."
            ));
        }
        Ok(())
    }

    fn line(&mut self, line: Line<'a>) -> Result<(), Error> {
        match line.word {
            b"MATERIAL" => {
                let (name, rest) = string(line.rest);
                let mut material = Material {
                    name,
                    ..Material::default()
                };
                self.colours(&mut material, words(rest));
                self.materials.push(material);
            }
            b"MAT" => self.material_block(line)?,
            b"OBJECT" => self.begin_object(line)?,
            b"numvert" => self.vertices(line)?,
            b"SURF" => {
                let flags = line.flags()?;
                let mut left = None;
                match &mut self.geometry_object(line)?.surface {
                    // `mat` stood before `SURF`.
                    Some(surface) if surface.flags.is_none() => surface.flags = Some(flags),
                    surface => {
                        left = surface.replace(Surface {
                            flags: Some(flags),
                            material: None,
                        })
                    }
                }
                if left.is_some() {
                    self.pass_unfinished_surface()?;
                }
            }
            b"refs" => self.surface(line)?,
            b"numsurf" => {
                let count = line.count()?;
                if self.geometry_object(line)?.surfaces_promised.replace(count).is_some() {
                    self.lose(Fate::Doubtful, "repeated `numsurf` in an object, the last taken");
                }
            }
            b"data" => self.data(line)?,
            _ => match &mut self.object {
                Some(_) => self.property(line)?,
                None => self.stray(line),
            },
        }
        Ok(())
    }

    /// A line legal only between an object's `OBJECT` and `kids`, while such an object is open.
    fn property(&mut self, line: Line<'a>) -> Result<(), Error> {
        let Some(object) = &mut self.object else { return Ok(()) };
        match line.word {
            b"name" => object.name = name(line.rest),
            b"loc" => {
                if object.location.replace(DVec3::from_array(line.numbers()?)).is_some() {
                    self.lose(Fate::Doubtful, "repeated `loc` in an object, the last taken");
                }
            }
            b"rot" => {
                // The columns of glam's matrix are the rows of the line's: `R * point` is then `point · R`.
                if object
                    .rotation
                    .replace(DMat3::from_cols_array(&line.numbers()?))
                    .is_some()
                {
                    self.lose(Fate::Doubtful, "repeated `rot` in an object, the last taken");
                }
            }
            b"mat" => {
                let word = line.words().next().unwrap_or_default();
                let Some(material) = integer(word) else {
                    let shown = excerpt(word);
                    return Err(line.malformed(format!(
                        "`{shown}` after `mat` is no material index; a whole number from 0 belongs there"
                    )));
                };
                // A negative number is beyond the materials, too.
                let material = u64::try_from(material).unwrap_or(u64::MAX);
                object.surface.get_or_insert_default().material = Some((material, line.number));
            }
            b"subdiv" => {
                if line.words().next() != Some(b"0") {
                    self.lose(Fate::Approximated, "subdivision surface read as its control mesh");
                }
            }
            b"hidden" => self.lose(Fate::Doubtful, "hidden object, read all the same"),
            b"kids" => {
                let kids = line.count()?;
                self.end_object(kids)?;
            }
            b"texture" | b"texrep" | b"texoff" | b"crease" | b"url" | b"locked" | b"folded" => {}
            _ => self.stray(line),
        }
        Ok(())
    }

    /// Records what is not taken as the file says.
    fn lose(&mut self, fate: Fate, what: &str) {
        let place = self.object.as_ref().map(|object| object.name.clone());
        let place = || {
            place.map_or_else(
                || "the file".to_owned(),
                |name| format!("`{}`", excerpt(name.as_bytes())),
            )
        };
        self.ledger.lose(Kind { fate, what, next: "" }, 1, None, place);
    }

    /// Counts a line without a meaning at its place.
    fn stray(&mut self, line: Line<'a>) {
        if number(line.word).is_some() {
            self.lose(Fate::Doubtful, "line of numbers beyond the count before it, skipped");
            return;
        }
        self.ledger.note("line that is no AC3D, skipped");
        if self.lines_named < NAMED_LINES {
            self.lines_named += 1;
            let shown = excerpt(line.word);
            let more = if self.lines_named == NAMED_LINES {
                " Further such lines are only counted."
            } else {
                ""
            };
            self.ledger.warnings.push(format!(
                "Line {} was skipped: `{shown}` means nothing there.{more}",
                line.number
            ));
        }
    }

    /// The open object, for a line with geometry: outside an object it belongs nowhere.
    fn geometry_object(&mut self, line: Line<'a>) -> Result<&mut Object, Error> {
        self.object.as_mut().ok_or_else(|| {
            let keyword = excerpt(line.word);
            line.malformed(format!(
                "`{keyword}` stands outside an object; put it between an object's `OBJECT` and its `kids`"
            ))
        })
    }

    /// The colours among a material's keys and values.
    fn colours(&mut self, material: &mut Material, mut words: impl Iterator<Item = &'a [u8]>) {
        if !self.options.optics {
            return;
        }
        while let Some(key) = words.next() {
            let (property, largest) = match key {
                b"rgb" => (&mut material.diffuse, 1.0),
                b"emis" => (&mut material.emission, f64::MAX),
                _ => continue,
            };
            let mut colour = [0.0; 3];
            let mut is_right = true;
            let mut was_clamped = false;
            for channel in &mut colour {
                match words.next().and_then(number) {
                    Some(value) if value.is_finite() => {
                        *channel = value.clamp(0.0, largest);
                        was_clamped |= *channel != value;
                    }
                    _ => is_right = false,
                }
            }
            if is_right {
                *property = Some(colour);
            } else {
                self.ledger.note("material colour that is not three numbers, left out");
            }
            if was_clamped {
                self.ledger.note("material colour out of range, clamped");
            }
        }
    }

    /// A material of version c, from the line after `MAT` to `ENDMAT`.
    fn material_block(&mut self, begin: Line<'a>) -> Result<(), Error> {
        let (name, rest) = string(begin.rest);
        let mut material = Material {
            name,
            ..Material::default()
        };
        self.colours(&mut material, words(rest));
        loop {
            let before = self.lines;
            let Some(line) = self.lines.next() else {
                return Err(begin.malformed(
                    "`MAT` has no `ENDMAT` before the file ends; the file is cut short, get a complete copy".to_owned(),
                ));
            };
            match line.word {
                b"ENDMAT" => break,
                b"data" => self.data(line)?,
                b"MAT" | b"MATERIAL" | b"OBJECT" => {
                    self.ledger.note("material without `ENDMAT`");
                    self.lines = before;
                    break;
                }
                key => self.colours(&mut material, std::iter::once(key).chain(line.words())),
            }
        }
        self.materials.push(material);
        Ok(())
    }

    /// The user's text, of any content.
    fn data(&mut self, line: Line<'a>) -> Result<(), Error> {
        let length = line.count()?;
        if self.lines.skip_text(length) {
            return Ok(());
        }
        self.ledger.note("`data` whose length is wrong");
        loop {
            let before = self.lines;
            match self.lines.next() {
                Some(line) if line.is_keyword() => {
                    self.lines = before;
                    return Ok(());
                }
                Some(_) => {}
                None => return Ok(()),
            }
        }
    }

    fn begin_object(&mut self, line: Line<'a>) -> Result<(), Error> {
        // An object still open has no `kids` line.
        if self.object.is_some() {
            self.ledger.note("object without `kids`");
            self.end_object(0)?;
        }
        let world_from_parent = match self.parents.last_mut() {
            Some(parent) => {
                parent.awaited -= 1;
                let world_from_parent = parent.world_from_object;
                if parent.awaited == 0 {
                    self.parents.pop();
                }
                world_from_parent
            }
            None => {
                if self.objects_read > 0 {
                    self.ledger.note("object that no `kids` asked for, read as top-level");
                }
                DAffine3::IDENTITY
            }
        };
        self.objects_read += 1;
        let kind = line.words().next().unwrap_or_default();
        let is_light = kind == b"light";
        if is_light {
            self.ledger.note("light");
        } else if !matches!(kind, b"world" | b"group" | b"poly") {
            self.lose(Fate::Doubtful, "object of an unknown type, read as `poly`");
        }
        self.object = Some(Object {
            name: format!("object {}", self.objects_read),
            is_light,
            world_from_parent,
            location: None,
            rotation: None,
            vertices: Vec::new(),
            has_vertices: false,
            surfaces_promised: None,
            surfaces_read: 0,
            surface: None,
            pieces: Vec::new(),
        });
        Ok(())
    }

    fn vertices(&mut self, begin: Line<'a>) -> Result<(), Error> {
        let promised = begin.count()?;
        let object = self.geometry_object(begin)?;
        if object.surfaces_read > 0 {
            return Err(begin.malformed(format!(
                "`numvert` stands after surfaces of `{}`; an object's vertices belong before its `numsurf`",
                excerpt(object.name.as_bytes())
            )));
        }
        if std::mem::replace(&mut object.has_vertices, true) {
            self.lose(Fate::Doubtful, "repeated `numvert` in an object, the last taken");
        }
        let mut vertices = Vec::new();
        for read in 0..promised {
            let before = self.lines;
            let Some(line) = self.lines.next() else {
                return Err(self.cut_short(&format!("after {read} of {promised} vertices")));
            };
            if line.is_keyword() {
                self.lose(Fate::Doubtful, "`numvert` promising more vertices than follow");
                self.lines = before;
                break;
            }
            let mut words = std::iter::once(line.word).chain(line.words());
            let mut vertex = [0.0; 3];
            for coordinate in &mut vertex {
                let word = words.next().unwrap_or_default();
                *coordinate = number(word).ok_or_else(|| {
                    let shown = excerpt(word);
                    line.malformed(format!(
                        "`{shown}` in a vertex of `{}` is no number; three numbers make a vertex",
                        self.object_name()
                    ))
                })?;
            }
            vertices.push(DVec3::from_array(vertex));
        }
        self.geometry_object(begin)?.vertices = vertices;
        Ok(())
    }

    /// A surface, from its `refs`.
    fn surface(&mut self, begin: Line<'a>) -> Result<(), Error> {
        let promised = begin.count()?;
        let object = self.geometry_object(begin)?;
        let surface = object.surface.take().unwrap_or_default();
        let vertex_count = object.vertices.len();
        object.surfaces_read += 1;
        self.refs.clear();
        for read in 0..promised {
            let Some(line) = self.lines.next() else {
                return Err(self.cut_short(&format!("after {read} of {promised} corners of a surface")));
            };
            let Some(index) = integer(line.word) else {
                let shown = excerpt(line.word);
                return Err(line.malformed(format!(
                    "`{shown}` stands where corner {} of {promised} of a surface of `{}` belongs; a corner begins with \
                     the number of a vertex, and `refs` says how many there are",
                    read + 1,
                    self.object_name()
                )));
            };
            let vertex = u32::try_from(index)
                .ok()
                .filter(|&v| usize::try_from(v).is_ok_and(|v| v < vertex_count));
            let Some(vertex) = vertex else {
                return Err(line.malformed(format!(
                    "vertex {index} is not there: `{}` has {vertex_count} vertices, numbered from 0; mend the number, \
                     or `numvert`",
                    self.object_name()
                )));
            };
            self.refs.push(vertex);
        }
        let face = self.next_face()?;
        self.cut.clear();
        let flags = surface.flags.unwrap_or_else(|| {
            self.lose(Fate::Doubtful, "surface without `SURF`, read as a one-sided polygon");
            0
        });
        if self.object.as_ref().is_some_and(|object| object.is_light) {
            self.ledger.note("surface of a light, skipped");
            return Ok(());
        }
        match flags & 0xF {
            0 => {
                self.bounds.polygon(self.refs.len())?;
                self.cut_polygon();
            }
            1 | 2 => self.ledger.note("line element"),
            4 => self.cut_strip(),
            _ => self.lose(Fate::LeftOut, "surface of an unknown type, skipped"),
        }
        if self.cut.is_empty() {
            return Ok(());
        }
        let material = surface.material.map_or(0, |(material, line)| {
            self.first_material_line.get_or_insert(line);
            if usize::try_from(material).map_or(true, |m| m >= self.materials.len()) {
                *self.surfaces_awaiting_material.entry(material).or_default() += 1;
            }
            u32::try_from(material).unwrap_or(u32::MAX)
        });
        let Some(object) = &mut self.object else { return Ok(()) };
        object.pieces.extend(self.cut.iter().map(|&vertices| Piece {
            vertices,
            face,
            material,
            two_sided: flags & 0x20 != 0,
        }));
        Ok(())
    }

    /// Cuts the polygon with the corners in `refs` into triangles.
    fn cut_polygon(&mut self) {
        let Some(object) = &self.object else { return };
        self.corners.clear();
        self.corners
            .extend(self.refs.iter().filter_map(|&v| object.vertices.get(v as usize)));
        let place = || format!("`{}`", excerpt(object.name.as_bytes()));
        cut_face(&self.corners, &mut self.cut, &mut self.ledger, place);
        for corner in self.cut.iter_mut().flatten() {
            *corner = self.refs.get(*corner as usize).copied().unwrap_or_default();
        }
    }

    /// Cuts the strip with the corners in `refs` into triangles: each corner from the third on makes one with the two
    /// before it, every second one turned so that all wind alike.
    fn cut_strip(&mut self) {
        if self.refs.len() < 3 {
            let name = self.object.as_ref().map_or("", |object| object.name.as_str());
            let place = || format!("`{}`", excerpt(name.as_bytes()));
            self.ledger.lose(TOO_FEW_CORNERS, 1, None, place);
            return;
        }
        for (position, corners) in self.refs.windows(3).enumerate() {
            if let &[a, b, c] = corners {
                self.cut.push(if position % 2 == 0 { [a, b, c] } else { [b, a, c] });
            }
        }
    }

    /// Counts a surface without corners.
    fn pass_unfinished_surface(&mut self) -> Result<(), Error> {
        self.lose(Fate::LeftOut, "surface without `refs`");
        if let Some(object) = &mut self.object {
            object.surfaces_read += 1;
        }
        self.next_face().map(|_| ())
    }

    fn next_face(&mut self) -> Result<u32, Error> {
        let face = self.faces_read;
        self.faces_read = face.checked_add(1).ok_or_else(too_many)?;
        Ok(face)
    }

    /// Puts the open object's triangles into the world; the next `kids` objects are its children.
    fn end_object(&mut self, kids: u64) -> Result<(), Error> {
        if self.object.as_ref().is_some_and(|object| object.surface.is_some()) {
            self.pass_unfinished_surface()?;
        }
        let Some(object) = self.object.take() else {
            return Ok(());
        };
        // An object without `numsurf` has as many surfaces as follow.
        match object
            .surfaces_promised
            .unwrap_or(object.surfaces_read)
            .cmp(&object.surfaces_read)
        {
            std::cmp::Ordering::Greater => self.lose(Fate::LeftOut, "`numsurf` promising more surfaces than follow"),
            std::cmp::Ordering::Less => self.lose(Fate::Doubtful, "`numsurf` promising fewer surfaces than follow"),
            std::cmp::Ordering::Equal => {}
        }
        let parent_from_object = DAffine3::from_mat3_translation(
            object.rotation.unwrap_or(DMat3::IDENTITY),
            object.location.unwrap_or(DVec3::ZERO),
        );
        let world_from_object = object.world_from_parent * parent_from_object;
        if kids > 0 {
            self.parents.push(Parent {
                world_from_object,
                awaited: kids,
            });
        }
        if object.pieces.is_empty() {
            return Ok(());
        }
        if world_from_object.matrix3.determinant() < 0.0 {
            self.lose(Fate::Turned, "object under a mirroring `rot`, turned inside out");
        }
        let index = u32::try_from(self.objects.len()).map_err(|_| too_many())?;
        self.objects.push(object.name);
        let place = |v: u32| {
            object
                .vertices
                .get(v as usize)
                .map(|&v| world_from_object.transform_point3(v))
        };
        for piece in &object.pieces {
            let [a, b, c] = piece.vertices.map(place);
            // Each index was checked when it was read.
            let (Some(a), Some(b), Some(c)) = (a, b, c) else {
                continue;
            };
            self.triangles.push(Triangle {
                corners: [a, b, c],
                object: index,
                material: piece.material,
                face: piece.face,
                two_sided: piece.two_sided,
            });
        }
        Ok(())
    }

    fn finish(mut self) -> Result<Scene, Error> {
        if let Some(object) = &self.object {
            let read = object.surfaces_read;
            if object.surface.is_some() {
                return Err(self.cut_short("before the corners of a surface"));
            }
            if let Some(promised) = object.surfaces_promised.filter(|&promised| promised > read) {
                return Err(self.cut_short(&format!("after {read} of {promised} surfaces")));
            }
            self.ledger.note("object without `kids`");
            self.end_object(0)?;
        }
        // A `usize` fits in 64 bits.
        let kind = Kind {
            fate: Fate::Doubtful,
            what: "`kids` promising more objects than follow",
            next: "the file may be cut short",
        };
        self.ledger
            .lose(kind, self.parents.len() as u64, None, || "the end".to_owned());
        let materials = self.materials_in_use()?;
        Ok(Scene {
            triangles: self.triangles,
            objects: self.objects,
            materials,
            ledger: self.ledger,
            up: Some(Axis::Y),
            ..Scene::default()
        })
    }

    /// The materials of the triangles, in order of first use; changes the triangles' indices to match.
    fn materials_in_use(&mut self) -> Result<Vec<Material>, Error> {
        if self.materials.is_empty() {
            if let Some(line) = self.first_material_line {
                return Err(Error::malformed(
                    "`mat` names a material, but the file has none; add a line such as `MATERIAL \"\" rgb 1 1 1 amb 1 \
                     1 1 emis 0 0 0 spec 0 0 0 shi 0 trans 0` after the header",
                )
                .at(line));
            }
            self.materials.push(Material::default());
        }
        for (&material, &surfaces) in &self.surfaces_awaiting_material {
            if usize::try_from(material).map_or(true, |m| m >= self.materials.len()) {
                let kind = Kind {
                    fate: Fate::Doubtful,
                    what: "surface with a material that is not there, the first taken",
                    next: "",
                };
                self.ledger
                    .lose(kind, surfaces, None, || format!("material {material}"));
            }
        }
        let mut in_use = Vec::new();
        let mut new_index: Vec<Option<u32>> = vec![None; self.materials.len()];
        for triangle in &mut self.triangles {
            let old = usize::try_from(triangle.material)
                .ok()
                .filter(|&m| m < new_index.len())
                .unwrap_or(0);
            let (Some(new), Some(material)) = (new_index.get_mut(old), self.materials.get(old)) else {
                continue;
            };
            triangle.material = match *new {
                Some(index) => index,
                None => {
                    let index = u32::try_from(in_use.len()).map_err(|_| too_many())?;
                    in_use.push(material.clone());
                    *new.insert(index)
                }
            };
        }
        Ok(in_use)
    }

    /// The open object's name in errors.
    fn object_name(&self) -> String {
        self.object
            .as_ref()
            .map(|object| excerpt(object.name.as_bytes()))
            .unwrap_or_default()
    }

    fn cut_short(&self, place: &str) -> Error {
        Error::malformed(format!(
            "the file ends in `{}` {place}; it is cut short, get a complete copy",
            self.object_name()
        ))
        .at(self.lines.number)
    }
}

fn too_many() -> Error {
    Error::new(ErrorKind::TooLarge(format!(
        "more than {} objects or surfaces cannot be numbered; split the file",
        u32::MAX
    )))
}

fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// The first word of a line, and the rest.
fn split_word(text: &[u8]) -> (&[u8], &[u8]) {
    let text = text.trim_ascii_start();
    let mut parts = text.splitn(2, u8::is_ascii_whitespace);
    (parts.next().unwrap_or_default(), parts.next().unwrap_or_default())
}

/// A string with more to follow: to the next quote, or, unquoted, a word.
fn string(text: &[u8]) -> (String, &[u8]) {
    let text = text.trim_ascii_start();
    let (string, rest) = match text.strip_prefix(b"\"") {
        Some(quoted) => {
            let mut parts = quoted.splitn(2, |&b| b == b'"');
            (parts.next().unwrap_or_default(), parts.next().unwrap_or_default())
        }
        None => split_word(text),
    };
    (String::from_utf8_lossy(string).into_owned(), rest)
}

/// A string to the end of its line: it may hold quotes, and spaces even if unquoted.
fn name(text: &[u8]) -> String {
    let text = text.trim_ascii();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    let text = text.strip_suffix(b"\"").unwrap_or(text);
    String::from_utf8_lossy(text).into_owned()
}

fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn integer(word: &[u8]) -> Option<i64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Text from the file, fit for a message.
fn excerpt(text: &[u8]) -> String {
    const LONGEST: usize = 40;
    // No character takes more than four bytes.
    let start = text.get(..4 * (LONGEST + 1)).unwrap_or(text);
    let decoded = String::from_utf8_lossy(start);
    let mut shown: String = decoded
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c })
        .collect();
    if decoded.chars().nth(LONGEST).is_some() {
        shown.push('…');
    }
    shown
}
