//! Objects of an input data file: a class and fields between commas, a semicolon at the end, comments from `!` on.

use super::building::{Building, Class, Face, Rules, Zone, refused, rotated};
use super::shown;
use crate::Error;
use glam::DVec3;

pub(super) fn read(bytes: &[u8]) -> Result<Building, Error> {
    let text = String::from_utf8_lossy(bytes);
    let mut building = Building::default();
    let mut objects = Objects {
        rest: &text,
        line: 1,
        fields: Vec::new(),
    };
    let mut any = false;
    while objects.next()? {
        any = true;
        let (class, line) = objects.fields[0];
        let Some(known) = Class::of(class) else {
            if has_corners(class, &objects.fields[1..]) {
                building.doubt(class, format!("line {line}"));
            }
            continue;
        };
        let object = Object {
            fields: &objects.fields[1..],
            class: known,
            line,
        };
        if known == Class::Refused {
            return Err(refused(class).at(line));
        }
        object.enter(&mut building)?;
    }
    if !any {
        return Err(Error::malformed(
            "is no input of EnergyPlus: it has no object such as `Zone, office;`",
        ));
    }
    Ok(building)
}

/// Returns whether an object of an unknown class ends with a number of corners and as many points.
fn has_corners(class: &str, fields: &[(&str, u64)]) -> bool {
    let is_number = |text: &str| text.parse::<f64>().is_ok_and(f64::is_finite);
    let is_matrix = class.get(..6).is_some_and(|word| word.eq_ignore_ascii_case("matrix"));
    let ends_with = |count: usize| {
        let at = fields.len().checked_sub(3 * count + 1);
        at.and_then(|at| fields.get(at))
            .is_some_and(|&(text, _)| text.parse() == Ok(count))
            && fields[fields.len() - 3 * count..]
                .iter()
                .all(|&(text, _)| is_number(text))
    };
    !is_matrix && (3..=(fields.len() / 3).min(CORNERS_SOUGHT)).any(ends_with)
}

/// Most corners by which a surface of an unknown class is known.
const CORNERS_SOUGHT: usize = 32;

/// The objects of a text, one after the other.
struct Objects<'a> {
    rest: &'a str,
    line: u64,
    /// The class and the fields of the object read last, with their lines.
    fields: Vec<(&'a str, u64)>,
}

impl<'a> Objects<'a> {
    /// Reads the next object; false at the end.
    fn next(&mut self) -> Result<bool, Error> {
        self.fields.clear();
        // The line on which a field begins, once there is something of it.
        let mut field = "";
        let mut begun = self.line;
        loop {
            let end = self.rest.find([',', ';', '!', '\n']).unwrap_or(self.rest.len());
            let (part, after) = self.rest.split_at(end);
            let part = part.trim();
            if !part.is_empty() {
                if part.starts_with("##") {
                    return Err(Error::unsupported(
                        "is input of EP-Macro; expand its macros (`##`) first, and open what comes of it",
                    )
                    .at(self.line));
                }
                if !field.is_empty() {
                    let place = format!("`{}` follows `{}` without a comma", shown(part), shown(field));
                    return Err(Error::malformed(place).at(self.line));
                }
                (field, begun) = (part, self.line);
            }
            let mark = after.bytes().next();
            self.rest = after.get(1..).unwrap_or_default();
            match mark {
                Some(b'!') => {
                    let end = self.rest.find('\n').unwrap_or(self.rest.len());
                    self.rest = &self.rest[end..];
                }
                Some(b'\n') => self.line += 1,
                Some(mark) => {
                    self.fields
                        .push((field, if field.is_empty() { self.line } else { begun }));
                    if mark == b';' {
                        return Ok(true);
                    }
                    field = "";
                }
                None if field.is_empty() && self.fields.is_empty() => return Ok(false),
                None => {
                    let class = self.fields.first().map_or(field, |&(class, _)| class);
                    return Err(Error::malformed(format!(
                        "the file ends within an object (`{}`), before its semicolon; it is cut short",
                        shown(class)
                    ))
                    .at(self.line));
                }
            }
        }
    }
}

/// An object's fields, from its name on.
struct Object<'a> {
    class: Class,
    fields: &'a [(&'a str, u64)],
    line: u64,
}

impl Object<'_> {
    fn text(&self, at: usize) -> &str {
        self.fields.get(at).map_or("", |&(text, _)| text)
    }

    /// A number; 0 for an empty field.
    fn number(&self, at: usize) -> Result<f64, Error> {
        match self.fields.get(at) {
            None | Some(("", _)) => Ok(0.0),
            Some(&(text, line)) => {
                let number = text.parse().ok().filter(|number: &f64| number.is_finite());
                number.ok_or_else(|| Error::malformed(format!("`{}` where a number is due", shown(text))).at(line))
            }
        }
    }

    fn enter(&self, building: &mut Building) -> Result<(), Error> {
        match self.class {
            Class::Rules => {
                let rules = Rules::of(self.text(1), self.text(2)).map_err(|error| error.at(self.line))?;
                building.rules = Some(rules);
            }
            Class::Building => building.north = self.number(1)?,
            Class::Zone => {
                let zone = Zone {
                    north: self.number(1)?,
                    origin: DVec3::new(self.number(2)?, self.number(3)?, self.number(4)?),
                };
                building.add_zone(self.text(0), zone, || format!("line {}", self.line));
            }
            // The first number of fields before the corners is today's; the other has a field less or more.
            Class::Surface => building.surfaces.push(self.face(2, 3, [11, 10])?),
            Class::Wall => building.surfaces.push(self.face(1, 2, [10, 9])?),
            Class::Opening => {
                let face = self.face(2, 3, [9, 10])?;
                let header = self.fields.len() - 3 * face.corners.len();
                if self.number(header - 2)? > 1.0 {
                    let place = format!("line {}", self.line);
                    building.leave_out("window with a multiplier, taken once", "write each window out", place);
                }
                building.openings.push(face);
            }
            Class::SiteShading | Class::BuildingShading => {
                building.shading.push((self.class, self.face(1, 1, [3, 3])?));
            }
            Class::ZoneShading => building.shading.push((self.class, self.face(2, 1, [4, 4])?)),
            Class::AirBoundary => {
                building.air.insert(self.text(0).to_uppercase());
            }
            Class::Mass => {
                building.leave_out(
                    "internal mass, which has no place",
                    "make surfaces of it",
                    format!("line {}", self.line),
                );
            }
            Class::OtherShading => {
                let next = "write it as `Shading:Building:Detailed`";
                building.leave_out("shading without corners, not read", next, format!("line {}", self.line));
            }
            Class::Compliance if self.number(0)? != 0.0 => return Err(rotated().at(self.line)),
            Class::Compliance | Class::Refused => {}
        }
        Ok(())
    }

    /// A face: its construction and what it belongs to at their places, and corners after one of two numbers of fields.
    fn face(&self, construction: usize, of: usize, before: [usize; 2]) -> Result<Face, Error> {
        let mut face = Face {
            name: self.text(0).to_owned(),
            construction: self.text(construction).to_owned(),
            of: self.text(of).to_owned(),
            corners: Vec::new(),
            line: Some(self.line),
        };
        let count = self.fields.len();
        let fits = |&header: &usize| count >= header + 9 && (count - header).is_multiple_of(3);
        let Some(header) = before.into_iter().find(fits) else {
            return Err(face.fail(&format!(
                "has {count} fields, and after the first {} three for each of three corners or more are due",
                before[0]
            )));
        };
        for at in (header..count).step_by(3) {
            if self.fields[at..at + 3].iter().any(|(text, _)| text.is_empty()) {
                return Err(face.fail(&format!("corner {} lacks a coordinate", (at - header) / 3 + 1)));
            }
            let corner = DVec3::new(self.number(at)?, self.number(at + 1)?, self.number(at + 2)?);
            face.corners.push(corner);
        }
        // Empty or `autocalculate` is what there are.
        if let Ok(said) = self.text(header - 1).parse::<f64>()
            && said != face.corners.len() as f64
        {
            return Err(face.fail(&format!("has {} corners, and says {said}", face.corners.len())));
        }
        Ok(face)
    }
}
