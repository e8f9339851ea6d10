//! Reads View3D's scenes (`.vs3`), in both of its geometry formats, 3 and 3a.
//!
//! Source: Walton, *View3D user manual*, input data elements (National Institute of Standards and Technology), and
//! View3D 4.0.0, `src/getdat.c` (order, tests of subsurfaces), `src/view3d.c` (masks). The plane of format 3a follows
//! the manual's example, a room given in both forms.
//!
//! # What becomes of what
//! - `V n x y z`, `S n v1 v2 v3 v4 base cmb emit name`: a surface: triangles that share a face number, of the object
//!   `name`; `v4` 0 makes it a triangle
//! - format 3a: `S n R|Q|T base cmb emit name`, then origin, azimuth, tilt and measures: the same
//! - `cmb` m: the surface is part of the object of surface m, as View3D reports them as one
//! - `base` m: a subsurface: it is cut out of surface m, in whose plane it lies and faces as m; m may be an obstruction
//! - `N` (null surface): cut out of its base, which it faces, and nothing in its place
//! - `M` (masking surface): likewise, with a warning: what it covers sees the mask alone, and the mask it alone; a
//!   [`Study`] has both
//! - `O` (obstruction): surfaces of objects that are called `obstruction n`, and a warning that `--occluders
//!   'obstruction*'` makes them occlude only
//! - `emit`: the name of the material, `emissivity 0.9`, for tables of materials to refer to
//! - `T`: the title, skipped
//! - `C`, `X`: settings of View3D, skipped, counted; [`study`] has them
//! - `!`, `/`: a comment, to the end of the line
//! - other lines: skipped, counted, with a warning
//! - `E`, `*`: the end; what follows is not read
//!
//! Numbers of vertices and surfaces must run from 1 in order, by View3D's rule.

use crate::bounds::Bounds;
use crate::names::Names;
use crate::openings::outside;
use crate::{Error, Ledger, ReadOptions, Scene, Triangle};
use glam::DVec3;
use std::collections::VecDeque;
use std::path::Path;

/// Lines of no element that a [`Study`] names.
const SKIPPED: usize = 16;
/// Farthest that a subsurface's corner is from the plane of its base, in radii of the subsurface: View3D's.
const PLANE: f64 = 1e-5;
/// Least cosine between the normals of a subsurface and its base: View3D's.
const ALIGNED: f64 = 0.999;
/// Farthest that a subsurface's corner is outside its base, in sizes of the base.
const WITHIN: f64 = 1e-6;

/// Reads a View3D scene from the bytes of a file.
///
/// # Errors
/// When a line breaks the rules of View3D's manual; the error names it.
///
/// ```
/// use hemicube_scene::{ReadOptions, vs3};
///
/// let text = b"T a wall\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 0 1\nV 4 0 0 1\nS 1 1 2 3 4 0 0 0.9 wall\nEnd of data\n";
/// let scene = vs3::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0]), (2, "wall"));
/// assert_eq!(scene.materials[0].name, "emissivity 0.9");
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let text = String::from_utf8_lossy(crate::text::unmarked(bytes)?);
    Reader::of(&text)?.scene(Bounds::new(bytes.len(), options))
}

/// A View3D file as View3D's own command takes it: its settings, and the surfaces that become rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Study {
    /// The last title.
    pub title: String,
    /// `name`, `value` of the control lines in their order, names in lower case; and the line of each.
    pub controls: Vec<(String, String, u64)>,
    /// The surfaces in their order: a triangle's `face` is an index into them.
    pub surfaces: Vec<StudySurface>,
    /// The first words of lines that are no element of View3D, and their lines: at most 16.
    pub skipped: Vec<(String, u64)>,
}

/// The surface that a mask covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mask {
    /// The surface that it covers a part of, from 0.
    pub base: usize,
    /// The area of that part, in the file's unit of length, squared.
    pub area: f64,
}

/// A surface of a [`Study`].
#[derive(Clone, Debug, PartialEq)]
pub struct StudySurface {
    /// Its name; empty for an obstruction.
    pub name: String,
    /// The surface with which it is reported as one, from 0.
    pub combined_with: Option<usize>,
    /// Its emittance as written; 0 for an obstruction.
    pub emittance: f64,
    /// True if it becomes a row: no obstruction, no null surface.
    pub radiates: bool,
    /// The part of another surface that it covers and sees alone, for a masking surface.
    pub mask: Option<Mask>,
}

/// Reads the settings and surfaces of a View3D scene.
///
/// # Errors
/// As [`read`], and for surfaces combined in a chain, by View3D's rule.
///
/// ```
/// use hemicube_scene::vs3;
///
/// let text = b"T a wall\nC encl=1 out=1\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 0 1\nS 1 1 2 3 0 0 0 .9 wall\n";
/// let study = vs3::study(text)?;
/// assert_eq!((&*study.title, &*study.surfaces[0].name), ("a wall", "wall"));
/// assert_eq!(study.controls[1], ("out".to_owned(), "1".to_owned(), 2));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn study(bytes: &[u8]) -> Result<Study, Error> {
    let text = String::from_utf8_lossy(crate::text::unmarked(bytes)?);
    let reader = Reader::of(&text)?;
    let mut study = reader.study;
    for surface in &reader.surfaces {
        let masks = surface.kind == Kind::Masking;
        if let Some(to) = surface.combined_with
            && is_no_whole(reader.surfaces.get(to))
        {
            let reason = format!(
                "surface {} is no surface to combine with: it is part of another",
                to + 1
            );
            return Err(Error::malformed(reason).at(surface.line));
        }
        study.surfaces.push(StudySurface {
            name: surface.name.clone(),
            combined_with: surface.combined_with,
            emittance: surface.emittance,
            radiates: masks || surface.kind == Kind::Radiating,
            mask: surface.base.filter(|_| masks).map(|base| Mask {
                base,
                area: vector_area(&surface.corners).length(),
            }),
        });
    }
    Ok(study)
}

/// Returns whether a surface can't stand for others that are combined with it.
fn is_no_whole(surface: Option<&Surface>) -> bool {
    surface.is_none_or(|surface| surface.combined_with.is_some() || surface.kind != Kind::Radiating)
}

/// The area of a plane polygon, along its normal.
fn vector_area(corners: &[DVec3]) -> DVec3 {
    let Some((&a, rest)) = corners.split_first() else {
        return DVec3::ZERO;
    };
    rest.windows(2)
        .fold(DVec3::ZERO, |sum, edge| sum + (edge[0] - a).cross(edge[1] - a) / 2.0)
}

/// The words of a file with their lines, without comments, up to the end-of-information element.
struct Words<'a> {
    lines: VecDeque<(u64, Vec<&'a str>)>,
    /// The line last taken from.
    line: u64,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        let mut lines = VecDeque::new();
        for (number, line) in (1..).zip(text.lines()) {
            let code = line.split(['!', '/']).next().unwrap_or_default();
            // View3D's separators.
            let is_separator = |c: char| c.is_whitespace() || c == ',';
            let words: Vec<&str> = code.split(is_separator).filter(|word| !word.is_empty()).collect();
            match words.first().and_then(|word| word.chars().next()) {
                None => continue,
                Some('*' | 'E' | 'e') => break,
                Some(_) => lines.push_back((number, words)),
            }
        }
        Self { lines, line: 0 }
    }

    fn next_line(&mut self) -> Option<Vec<&'a str>> {
        let (line, words) = self.lines.pop_front()?;
        self.line = line;
        Some(words)
    }
}

/// The fields of an element for a surface.
struct Surface {
    line: u64,
    kind: Kind,
    corners: Vec<DVec3>,
    /// From 0.
    base: Option<usize>,
    /// From 0.
    combined_with: Option<usize>,
    emittance: f64,
    material: String,
    name: String,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Radiating,
    Null,
    Masking,
    Obstruction,
}

struct Reader<'a> {
    words: Words<'a>,
    ledger: Ledger,
    vertices: Vec<DVec3>,
    surfaces: Vec<Surface>,
    study: Study,
}

impl<'a> Reader<'a> {
    fn of(text: &'a str) -> Result<Self, Error> {
        let mut reader = Self {
            words: Words::new(text),
            ledger: Ledger::default(),
            vertices: Vec::new(),
            surfaces: Vec::new(),
            study: Study::default(),
        };
        reader.elements()?;
        reader.bases()?;
        Ok(reader)
    }

    fn fail<T>(&self, reason: impl Into<String>) -> Result<T, Error> {
        Err(Error::malformed(reason).at(self.words.line))
    }

    fn number(&self, word: Option<&&str>, what: &str) -> Result<f64, Error> {
        match word.map(|word| (word, word.parse::<f64>())) {
            Some((_, Ok(number))) if number.is_finite() => Ok(number),
            Some((word, _)) => self.fail(format!("`{}` is no number for {what}", shown(word))),
            None => self.fail(format!("the line ends before {what}")),
        }
    }

    fn whole(&self, word: Option<&&str>, what: &str) -> Result<usize, Error> {
        match word.map(|word| (word, word.parse::<usize>())) {
            Some((_, Ok(number))) => Ok(number),
            Some((word, _)) => self.fail(format!("`{}` is no whole number for {what}", shown(word))),
            None => self.fail(format!("the line ends before {what}")),
        }
    }

    fn in_order(&self, word: Option<&&str>, so_far: usize, what: &str) -> Result<(), Error> {
        let number = self.whole(word, &format!("the number of the {what}"))?;
        if number == so_far + 1 {
            Ok(())
        } else {
            self.fail(format!(
                "{what} {number} where {what} {} is due; number them in order",
                so_far + 1
            ))
        }
    }

    fn elements(&mut self) -> Result<(), Error> {
        let mut planes = None;
        while let Some(words) = self.words.next_line() {
            let element = words[0].chars().next().map(|c| c.to_ascii_uppercase());
            match element {
                Some('T') => self.study.title = words[1..].join(" "),
                Some('C' | 'X') => {
                    self.ledger.note("line of View3D's settings, not used");
                    if element == Some('C') {
                        self.controls(&words[1..]);
                    }
                }
                Some('F') => {
                    planes = match words.get(1).map(|form| form.to_ascii_lowercase()).as_deref() {
                        Some("3") => Some(false),
                        Some("3a") => Some(true),
                        _ => return self.fail("only the geometry formats `F 3` and `F 3a` are of three dimensions"),
                    }
                }
                Some('V') => {
                    self.in_order(words.get(1), self.vertices.len(), "vertex")?;
                    let mut vertex = [0.0; 3];
                    for (at, x) in vertex.iter_mut().enumerate() {
                        *x = self.number(words.get(2 + at), "a coordinate")?;
                    }
                    self.vertices.push(DVec3::from_array(vertex));
                }
                Some('S') => self.surface(&words, Kind::Radiating, planes)?,
                Some('N') => self.surface(&words, Kind::Null, planes)?,
                Some('O') => self.surface(&words, Kind::Obstruction, planes)?,
                Some('M') => self.surface(&words, Kind::Masking, planes)?,
                _ => {
                    self.ledger.note("line of no element of View3D, skipped");
                    if self.study.skipped.len() < SKIPPED {
                        self.study.skipped.push((shown(words[0]), self.words.line));
                    }
                }
            }
        }
        if let Some((word, line)) = self.study.skipped.first() {
            let warning = format!("line {line}: `{word}` begins no element of a View3D file, and the line is skipped");
            self.ledger.warnings.push(warning);
        }
        Ok(())
    }

    /// Holds subsurfaces, masks and null surfaces against their bases, by View3D's tests.
    fn bases(&self) -> Result<(), Error> {
        for (number, surface) in (1..).zip(&self.surfaces) {
            let fail = |reason: String| Err(Error::malformed(format!("surface {number} {reason}")).at(surface.line));
            let covers = matches!(surface.kind, Kind::Null | Kind::Masking);
            if covers && surface.combined_with.is_some() {
                return fail("covers a part of another, and can't be combined with a third".to_owned());
            }
            let Some(at) = surface.base else {
                if covers {
                    return fail("covers a part of no other: its base surface is 0".to_owned());
                }
                continue;
            };
            let Some(base) = self.surfaces.get(at) else {
                return fail(format!("has the base surface {}, which is not there", at + 1));
            };
            let base_number = at + 1;
            let may_follow = !covers && base.kind == Kind::Obstruction;
            if base_number == number || base_number > number && !may_follow {
                return fail(format!(
                    "has the base surface {base_number}, which does not come before it"
                ));
            }
            if matches!(base.kind, Kind::Null | Kind::Masking) {
                return fail(format!(
                    "has the base surface {base_number}, which covers another itself"
                ));
            }
            let (Some(normal), Some(own)) = (
                vector_area(&base.corners).try_normalize(),
                vector_area(&surface.corners).try_normalize(),
            ) else {
                continue;
            };
            let count = surface.corners.len() as f64;
            let middle = surface.corners.iter().sum::<DVec3>() / count;
            let radius = surface.corners.iter().map(|&p| p.distance(middle)).fold(0.0, f64::max);
            let corner = base.corners[0];
            if surface
                .corners
                .iter()
                .any(|&p| (p - corner).dot(normal).abs() > PLANE * radius)
            {
                return fail(format!("does not lie in the plane of its base surface {base_number}"));
            }
            let turned = own.dot(normal);
            if covers && turned > -ALIGNED {
                return fail(format!(
                    "does not face its base surface {base_number}; turn its vertices round"
                ));
            }
            if !covers && turned < ALIGNED {
                return fail(format!(
                    "does not face as its base surface {base_number} does; turn its vertices round"
                ));
            }
            let within = WITHIN * base.corners.iter().map(|&p| p.distance(corner)).fold(radius, f64::max);
            let beyond = |(&a, &b): (&DVec3, &DVec3)| {
                let inward = normal.cross(b - a).normalize_or_zero();
                surface.corners.iter().any(|&p| (p - a).dot(inward) < -within)
            };
            if base.corners.iter().zip(base.corners.iter().cycle().skip(1)).any(beyond) {
                return fail(format!("is not entirely within its base surface {base_number}"));
            }
        }
        Ok(())
    }

    /// `name=value` pairs, separated by blanks, `=` and `,` in any number.
    fn controls(&mut self, words: &[&str]) {
        let mut parts = words
            .iter()
            .flat_map(|word| word.split(['=', ',']))
            .filter(|part| !part.is_empty());
        while let Some(name) = parts.next() {
            let value = parts.next().unwrap_or_default().to_owned();
            self.study
                .controls
                .push((name.to_ascii_lowercase(), value, self.words.line));
        }
    }

    fn surface(&mut self, words: &[&str], kind: Kind, planes: Option<bool>) -> Result<(), Error> {
        let Some(planes) = planes else {
            return self.fail("a surface before the line `F 3` or `F 3a`, which says how surfaces are written");
        };
        let line = self.words.line;
        self.in_order(words.get(1), self.surfaces.len(), "surface")?;
        let (shape, attributes) = if planes {
            (words.get(2).and_then(|shape| shape.chars().next()), 3)
        } else {
            (None, 6)
        };
        let mut surface = Surface {
            line,
            kind,
            corners: Vec::new(),
            base: None,
            combined_with: None,
            emittance: 0.0,
            material: String::new(),
            name: String::new(),
        };
        // View3D reads only the vertices of an obstruction.
        if kind != Kind::Obstruction {
            let before = |reader: &Self, at: usize, what: &str| match reader.whole(words.get(at), what)? {
                0 => Ok(None),
                number if number <= reader.surfaces.len() => Ok(Some(number - 1)),
                number => reader.fail(format!("{what} {number} does not come before this surface")),
            };
            // A base may be an obstruction, which come last.
            surface.base = self.whole(words.get(attributes), "base surface")?.checked_sub(1);
            surface.combined_with = before(self, attributes + 1, "combination surface")?;
            let emissivity = self.number(words.get(attributes + 2), "the emissivity")?;
            surface.emittance = emissivity;
            surface.material = format!("emissivity {emissivity}");
            surface.name = (*words.get(attributes + 3).unwrap_or(&"")).to_owned();
        }
        surface.corners = if planes {
            self.corners_in_plane(shape)?
        } else {
            let mut corners = Vec::new();
            for at in 2..6 {
                match self.whole(words.get(at), "a vertex")? {
                    0 if at == 5 => {}
                    number => match number.checked_sub(1).and_then(|n| self.vertices.get(n)) {
                        Some(&vertex) => corners.push(vertex),
                        None => {
                            let count = self.vertices.len();
                            return self.fail(format!("vertex {number} is not there; {count} come before this line"));
                        }
                    },
                }
            }
            corners
        };
        self.surfaces.push(surface);
        Ok(())
    }

    /// The corners on the lines after a surface of format 3a, in a plane with an origin, an azimuth (degrees clockwise
    /// from +y, of the direction faced) and a tilt (0 faces up, 90 stands, 180 faces down).
    fn corners_in_plane(&mut self, shape: Option<char>) -> Result<Vec<DVec3>, Error> {
        let count = match shape.map(|shape| shape.to_ascii_uppercase()) {
            Some('R') => 2,
            Some('Q') => 8,
            Some('T') => 6,
            _ => return self.fail("the shape of a surface must be `R`, `Q` or `T`"),
        };
        let mut numbers = Vec::new();
        while numbers.len() < 5 + count {
            let Some(words) = self.words.next_line() else {
                return self.fail("the file ends before the measures of this surface");
            };
            for word in &words {
                numbers.push(self.number(Some(word), "a measure of the surface")?);
            }
        }
        if numbers.len() > 5 + count {
            return self.fail(format!(
                "{} numbers where {} describe this surface",
                numbers.len(),
                5 + count
            ));
        }
        let (plane, measures) = numbers.split_at(5);
        let flat: Vec<[f64; 2]> = match *measures {
            [width, height] => vec![[0.0, height], [0.0, 0.0], [width, 0.0], [width, height]],
            _ => measures.as_chunks::<2>().0.to_vec(),
        };
        let (azimuth_sin, azimuth_cos) = sin_cos_degrees(plane[3]);
        let (tilt_sin, tilt_cos) = sin_cos_degrees(plane[4]);
        // To the right seen from the front, and up in the plane.
        let right = DVec3::new(-azimuth_cos, azimuth_sin, 0.0);
        let up = DVec3::new(-tilt_cos * azimuth_sin, -tilt_cos * azimuth_cos, tilt_sin);
        let origin = DVec3::new(plane[0], plane[1], plane[2]);
        Ok(flat.iter().map(|&[x, y]| origin + x * right + y * up).collect())
    }

    fn scene(self, mut bounds: Bounds) -> Result<Scene, Error> {
        let mut objects = Names::default();
        let mut materials = Names::default();
        let mut scene = Scene {
            ledger: self.ledger,
            ..Scene::default()
        };
        let mut pieces: Vec<Vec<Vec<DVec3>>> = Vec::with_capacity(self.surfaces.len());
        // Beyond one for each surface.
        let mut piece_count = 0_u64;
        for surface in &self.surfaces {
            pieces.push(match surface.kind {
                Kind::Null | Kind::Masking => Vec::new(),
                _ => vec![surface.corners.clone()],
            });
        }
        for surface in &self.surfaces {
            if let Some(base) = surface.base {
                let base_of = pieces
                    .get_mut(base)
                    .ok_or_else(|| Error::malformed("no such base").at(surface.line))?;
                let steps = base_of
                    .iter()
                    .map(|piece| piece.len() * surface.corners.len())
                    .sum::<usize>();
                bounds.steps(steps as u64).map_err(|error| error.at(surface.line))?;
                let before = base_of.len();
                *base_of = base_of
                    .iter()
                    .flat_map(|piece| outside(piece, &surface.corners))
                    .collect();
                piece_count += base_of.len().saturating_sub(before) as u64;
                bounds
                    .triangles(piece_count, 0)
                    .map_err(|error| error.at(surface.line))?;
            }
        }
        let mut obstructions = 0_u64;
        for ((face, surface), pieces) in (0..).zip(&self.surfaces).zip(&pieces) {
            let name = match (surface.kind, surface.combined_with.and_then(|n| self.surfaces.get(n))) {
                (Kind::Obstruction, _) => {
                    obstructions += 1;
                    format!("obstruction {}", face + 1)
                }
                (_, Some(whole)) => whole.name.clone(),
                _ => surface.name.clone(),
            };
            let object = objects.number(&name).map_err(|error| error.at(surface.line))?;
            let material = materials
                .number(&surface.material)
                .map_err(|error| error.at(surface.line))?;
            for piece in pieces {
                for (b, c) in (1..piece.len()).zip(2..piece.len()) {
                    scene.triangles.push(Triangle {
                        corners: [piece[0], piece[b], piece[c]],
                        object,
                        material,
                        face,
                        two_sided: false,
                    });
                }
            }
        }
        let masked = self.surfaces.iter().filter(|surface| surface.kind == Kind::Masking);
        let areas: Vec<f64> = masked.map(|surface| vector_area(&surface.corners).length()).collect();
        if !areas.is_empty() {
            scene.ledger.warnings.push(format!(
                "{} masking surfaces and what they cover, {} of area, are left out: they see each other alone",
                areas.len(),
                areas.iter().sum::<f64>()
            ));
        }
        if obstructions > 0 {
            scene.ledger.warnings.push(format!(
                "{obstructions} obstruction surfaces emit and receive here, unless `obstruction*` are asked to occlude only"
            ));
        }
        scene.objects = objects.names;
        scene.materials = materials
            .names
            .into_iter()
            .map(|name| crate::Material {
                name,
                ..crate::Material::default()
            })
            .collect();
        Ok(scene)
    }
}

/// Sine and cosine of an angle in degrees, exact at right angles, the usual case.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => other.to_radians().sin_cos(),
    }
}

fn shown(word: &str) -> String {
    word.chars().take(40).collect::<String>().escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(text: &str) -> Result<Scene, Error> {
        read(text.as_bytes(), None, ReadOptions::default())
    }

    fn area_of(scene: &Scene, object: &str) -> f64 {
        let of = |t: &&Triangle| scene.objects[t.object as usize] == object;
        let area = |t: &Triangle| {
            0.5 * (t.corners[1] - t.corners[0])
                .cross(t.corners[2] - t.corners[0])
                .length()
        };
        scene.triangles.iter().filter(of).map(area).sum()
    }

    const WALL: &str = "T a wall with a window\nC encl=0\nF 3\nV 1 0 0 0\nV 2 4 0 0\nV 3 4 0 3\nV 4 0 0 3\n\
        V 5 1 0 1\nV 6 2 0 1\nV 7 2 0 2\nV 8 1 0 2\nV 9 0 0 2\nS 1 1 2 3 4 0 0 0.9 wall ! the wall\n\
        S 2 5 6 7 8 1 0 0.5 window\nS 3 9 5 8 0 1 1 0.9 part\nend\nnothing of this is read";

    #[test]
    fn subsurfaces_are_cut_out_of_their_base_and_combined_ones_join() {
        let scene = open(WALL).unwrap();
        assert_eq!(scene.objects, ["wall", "window"]);
        assert_eq!(scene.materials[1].name, "emissivity 0.5");
        assert!((area_of(&scene, "window") - 1.0).abs() < 1e-12);
        // The triangle was cut out of the wall, and is part of it.
        assert!(
            (area_of(&scene, "wall") - 11.0).abs() < 1e-12,
            "{}",
            area_of(&scene, "wall")
        );
        let facing = |t: &Triangle| (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]).y < 0.0;
        assert!(scene.triangles.iter().all(facing));
        // What covers a part of another faces it.
        for covers in ["N", "M"] {
            let scene = open(&WALL.replace("S 2 5 6 7 8", &format!("{covers} 2 8 7 6 5"))).unwrap();
            assert!((area_of(&scene, "wall") - 11.0).abs() < 1e-12 && area_of(&scene, "window") == 0.0);
            let warns = scene
                .ledger
                .warnings
                .iter()
                .any(|warning| warning.contains("1 of area"));
            assert_eq!(warns, covers == "M", "{:?}", scene.ledger.warnings);
        }
    }

    #[test]
    fn a_mask_has_a_row_and_an_obstruction_may_be_a_base() {
        let found = study(WALL.replace("S 2 5 6 7 8", "M 2 8 7 6 5").as_bytes()).unwrap();
        let masks: Vec<_> = found.surfaces.iter().map(|s| (s.radiates, s.mask)).collect();
        let mask = Some(Mask { base: 0, area: 1.0 });
        assert_eq!(masks, [(true, None), (true, mask), (true, None)]);
        // The wall obstructs, the window in it radiates.
        let text = WALL
            .replace("S 1 1 2 3 4 0 0 0.9 wall ! the wall\n", "")
            .replace("S 2 5 6 7 8 1", "S 1 5 6 7 8 2")
            .replace("S 3 9 5 8 0 1 1 0.9 part", "O 2 1 2 3 4");
        let scene = open(&text).unwrap();
        assert_eq!(scene.objects, ["window", "obstruction 2"]);
        assert!((area_of(&scene, "obstruction 2") - 11.0).abs() < 1e-12);
    }

    #[test]
    fn planes_by_azimuth_and_tilt() {
        // Faces of the cube from 0 to 1 looking inwards, one for each form of a plane.
        let scene = open(
            "F 3a\nS 1 R 0 0 0.9 south\n 1 0 0 0 90\n 1 1\nS 2 R 0 0 0.9 north\n 0 1 0 180 90 1 1\n\
             S 3 q 0 0 0.9 floor\n 0 0 0 180 0\n 0 0 1 0 1 1 0 1\nS 4 T 0 0 0.9 east\n 1 1 0 270 90 0 0 1 0 0 1\n",
        )
        .unwrap();
        let normal = |face: u32| {
            let t = scene.triangles.iter().find(|t| t.face == face).unwrap();
            (t.corners[1] - t.corners[0])
                .cross(t.corners[2] - t.corners[0])
                .normalize()
        };
        assert_eq!(normal(0), DVec3::Y);
        assert_eq!(normal(1), -DVec3::Y);
        assert_eq!(normal(2), DVec3::Z);
        assert_eq!(normal(3), -DVec3::X);
        for triangle in &scene.triangles {
            for corner in triangle.corners {
                assert!(corner.min_element() >= 0.0 && corner.max_element() <= 1.0, "{corner}");
            }
        }
    }

    #[test]
    fn bad_lines_are_named() {
        for (from, to, expected) in [
            ("V 2 4 0 0", "V 3 4 0 0", "line 5: vertex 3 where vertex 2 is due"),
            ("V 2 4 0 0", "V 2 4 0 O", "line 5: `O` is no number"),
            ("V 2 4 0 0", "V 2 4 0 nan", "line 5: `nan` is no number"),
            ("V 2 4 0 0", "V 2 4", "line 5: the line ends before a coordinate"),
            ("S 1 1 2 3 4", "S 1 1 2 3 14", "line 13: vertex 14 is not there"),
            (
                "7 8 1 0",
                "7 8 5 0",
                "line 14: surface 2 has the base surface 5, which is not there",
            ),
            (
                "7 8 1 0",
                "7 8 3 0",
                "line 14: surface 2 has the base surface 3, which does not come before",
            ),
            (
                "7 8 1 0",
                "7 8 2 0",
                "line 14: surface 2 has the base surface 2, which does not come before",
            ),
            ("S 2", "M 2", "line 14: surface 2 does not face its base surface 1"),
            (
                "S 2 5 6 7 8",
                "S 2 8 7 6 5",
                "line 14: surface 2 does not face as its base surface 1 does",
            ),
            (
                "S 2 5 6 7 8 1 0",
                "N 2 8 7 6 5 0 0",
                "line 14: surface 2 covers a part of no other",
            ),
            (
                "S 2 5 6 7 8 1 0",
                "N 2 8 7 6 5 1 1",
                "line 14: surface 2 covers a part of another, and",
            ),
            (
                "V 7 2 0 2",
                "V 7 2 .1 2",
                "line 14: surface 2 does not lie in the plane",
            ),
            ("V 6 2 0 1", "V 6 5 0 1", "line 14: surface 2 is not entirely within"),
            ("F 3\n", "", "line 12: a surface before the line `F 3`"),
            ("F 3\n", "F 2\n", "line 3: only the geometry formats"),
        ] {
            let message = open(&WALL.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.starts_with(expected), "{message}");
        }
        let skips = WALL.replace("C encl=0", "Q encl=0");
        let warnings = open(&skips).unwrap().ledger.warnings;
        assert!(warnings[0].starts_with("line 2: `Q` begins no element"), "{warnings:?}");
        assert_eq!(study(skips.as_bytes()).unwrap().skipped, [("Q".to_owned(), 2)]);
    }

    #[test]
    fn a_study_has_settings_and_rows() {
        let text = WALL
            .replace("C encl=0", "C encl=1,out = 2 , EPS=1.e-5")
            .replace("S 2 5 6 7 8", "N 2 8 7 6 5")
            .replace("V 2 4 0 0", "V 2 4,0,0");
        let found = study(text.as_bytes()).unwrap();
        let control = |name: &str, value: &str| (name.to_owned(), value.to_owned(), 2);
        assert_eq!(
            found.controls,
            [control("encl", "1"), control("out", "2"), control("eps", "1.e-5")]
        );
        assert_eq!(found.title, "a wall with a window");
        let rows: Vec<_> = found
            .surfaces
            .iter()
            .map(|s| (&*s.name, s.combined_with, s.emittance, s.radiates))
            .collect();
        assert_eq!(
            rows,
            [
                ("wall", None, 0.9, true),
                ("window", None, 0.5, false),
                ("part", Some(0), 0.9, true)
            ]
        );
        // A chain of combined surfaces, and one with a null surface.
        for text in [
            WALL.replace("end\n", "S 4 9 5 8 0 0 3 0.9 chain\nend\n"),
            WALL.replace("S 2 5 6 7 8", "N 2 8 7 6 5")
                .replace("0 1 1 0.9 part", "0 1 2 0.9 part"),
        ] {
            let message = study(text.as_bytes()).unwrap_err().to_string();
            assert!(message.contains("no surface to combine with"), "{message}");
        }
    }

    #[test]
    fn obstructions_say_how_to_be_occluders_only() {
        let scene = open(
            &WALL
                .replace("S 1 1 2 3 4 0 0 0.9 wall", "S 1 1 2 3 4 0 0 0.9 wall\nO 2 1 2 3 4")
                .replace("S 2 5", "S 3 5")
                .replace("S 3 9", "S 4 9"),
        )
        .unwrap();
        assert_eq!(scene.objects[1], "obstruction 2");
        assert!(scene.ledger.warnings[0].contains("`obstruction*` are asked to occlude only"));
    }
}
