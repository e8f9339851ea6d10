//! Zones, surfaces, openings and shading, whichever file they come from; and the scene of them.

use super::shown;
use crate::bounds::Bounds;
use crate::names::{Names, numbered};
use crate::openings::{cut, turn_with, vector_area};
use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, Material, Scene, Triangle};
use glam::{DVec2, DVec3};
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

/// A class of EnergyPlus objects that matters here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Class {
    Rules,
    Building,
    Zone,
    /// `BuildingSurface:Detailed`.
    Surface,
    /// `Wall:Detailed` and its like, without a surface type.
    Wall,
    Opening,
    SiteShading,
    BuildingShading,
    ZoneShading,
    AirBoundary,
    Mass,
    /// Shading by rule: not read, and outside zones.
    OtherShading,
    /// `Compliance:Building`.
    Compliance,
    Refused,
}

impl Class {
    pub(super) fn of(name: &str) -> Option<Self> {
        let is = |other: &&str| name.eq_ignore_ascii_case(other);
        let known: &[(&[&str], Self)] = &[
            (&["GlobalGeometryRules"], Self::Rules),
            (&["Building"], Self::Building),
            (&["Zone"], Self::Zone),
            (&["BuildingSurface:Detailed"], Self::Surface),
            (&["Wall:Detailed", "Floor:Detailed", "RoofCeiling:Detailed"], Self::Wall),
            (&["FenestrationSurface:Detailed"], Self::Opening),
            (&["Shading:Site:Detailed"], Self::SiteShading),
            (&["Shading:Building:Detailed"], Self::BuildingShading),
            (&["Shading:Zone:Detailed"], Self::ZoneShading),
            (&["Construction:AirBoundary"], Self::AirBoundary),
            (&["InternalMass"], Self::Mass),
            (
                &[
                    "Shading:Site",
                    "Shading:Building",
                    "Shading:Overhang",
                    "Shading:Overhang:Projection",
                    "Shading:Fin",
                    "Shading:Fin:Projection",
                ],
                Self::OtherShading,
            ),
            (&["Compliance:Building"], Self::Compliance),
            (
                &[
                    "Wall:Exterior",
                    "Wall:Adiabatic",
                    "Wall:Underground",
                    "Wall:Interzone",
                    "Roof",
                    "Ceiling:Adiabatic",
                    "Ceiling:Interzone",
                    "Floor:GroundContact",
                    "Floor:Adiabatic",
                    "Floor:Interzone",
                    "Window",
                    "Door",
                    "GlazedDoor",
                    "Window:Interzone",
                    "Door:Interzone",
                    "GlazedDoor:Interzone",
                    "GeometryTransform",
                ],
                Self::Refused,
            ),
        ];
        let found = known.iter().find(|(names, _)| names.iter().any(is));
        found.map(|&(_, class)| class)
    }
}

/// The error for an object of a class that is refused.
pub(super) fn refused(class: &str) -> Error {
    Error::unsupported(if class.eq_ignore_ascii_case("GeometryTransform") {
        "`GeometryTransform` changes the building's shape, which is not read; write the shape that is meant".to_owned()
    } else {
        format!(
            "`{}` has no corners, but lengths and angles, and is not read; save its surfaces in detail \
             (`BuildingSurface:Detailed`, `FenestrationSurface:Detailed`)",
            shown(class)
        )
    })
}

/// The error for a rotation that EnergyPlus would do.
pub(super) fn rotated() -> Error {
    Error::unsupported(
        "`Compliance:Building` rotates the building, which is not read; set its rotation to 0 and turn the building",
    )
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rules {
    pub(super) clockwise: bool,
    pub(super) world: bool,
}

impl Rules {
    /// The rules by the words of `GlobalGeometryRules`.
    pub(super) fn of(direction: &str, system: &str) -> Result<Self, Error> {
        let begins = |text: &str, with: &str| {
            text.get(..with.len())
                .is_some_and(|text| text.eq_ignore_ascii_case(with))
        };
        let clockwise = match direction.trim() {
            text if begins(text, "counter") || text.eq_ignore_ascii_case("ccw") => false,
            text if begins(text, "clock") || text.eq_ignore_ascii_case("cw") => true,
            other => {
                return Err(Error::malformed(format!(
                    "`{}` where `Counterclockwise` or `Clockwise` is due",
                    shown(other)
                )));
            }
        };
        let world = match system.trim() {
            "" => false,
            text if begins(text, "rel") => false,
            text if begins(text, "world") || begins(text, "abs") || text.eq_ignore_ascii_case("wcs") => true,
            other => {
                return Err(Error::malformed(format!(
                    "`{}` where `World` or `Relative` is due",
                    shown(other)
                )));
            }
        };
        Ok(Self { clockwise, world })
    }
}

/// A zone's place, and its north in degrees clockwise from the building's.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Zone {
    pub(super) north: f64,
    pub(super) origin: DVec3,
}

/// A surface, an opening or shading.
#[derive(Debug, Default)]
pub(super) struct Face {
    pub(super) name: String,
    pub(super) construction: String,
    /// The zone of a surface, the wall of an opening or of a zone's shading.
    pub(super) of: String,
    pub(super) corners: Vec<DVec3>,
    /// Where a file has lines that are of use.
    pub(super) line: Option<u64>,
}

impl Face {
    /// Name and line for a person.
    pub(super) fn place(&self) -> String {
        match self.line {
            Some(line) => format!("`{}`, line {line}", shown(&self.name)),
            None => format!("`{}`", shown(&self.name)),
        }
    }

    pub(super) fn fail(&self, reason: &str) -> Error {
        let error = Error::malformed(format!("surface `{}`: {reason}", shown(&self.name)));
        match self.line {
            Some(line) => error.at(line),
            None => error,
        }
    }
}

/// The contents of a file.
#[derive(Default)]
pub(super) struct Building {
    pub(super) rules: Option<Rules>,
    pub(super) north: f64,
    pub(super) zones: HashMap<String, Zone>,
    pub(super) surfaces: Vec<Face>,
    pub(super) openings: Vec<Face>,
    /// Shading with the class that says how it is placed.
    pub(super) shading: Vec<(Class, Face)>,
    pub(super) air: HashSet<String>,
    pub(super) ledger: Ledger,
}

/// A point turned clockwise seen from above, by degrees.
fn turned(point: DVec3, degrees: f64) -> DVec3 {
    if degrees == 0.0 {
        return point;
    }
    // Exact at right angles, the usual case.
    let turn = match degrees.rem_euclid(360.0) {
        0.0 => DVec2::new(1.0, 0.0),
        90.0 => DVec2::new(0.0, -1.0),
        180.0 => DVec2::new(-1.0, 0.0),
        270.0 => DVec2::new(0.0, 1.0),
        _ => DVec2::from_angle(-degrees.to_radians()),
    };
    turn.rotate(point.truncate()).extend(point.z)
}

impl Building {
    /// Records an object that is left out, wholly or in part.
    pub(super) fn leave_out(&mut self, what: &str, next: &str, place: String) {
        let fate = Fate::LeftOut;
        self.ledger.lose(Kind { fate, what, next }, 1, None, || place);
    }

    /// Adds a zone; the first of a name stands for all of that name, as their surfaces cannot be told apart.
    pub(super) fn add_zone(&mut self, name: &str, zone: Zone, place: impl FnOnce() -> String) {
        match self.zones.entry(name.trim().to_uppercase()) {
            Entry::Vacant(entry) => {
                entry.insert(zone);
            }
            Entry::Occupied(_) => {
                let kind = Kind {
                    fate: Fate::Merged,
                    what: "zone of a name that another has, taken as the first",
                    next: "give each zone a name of its own, and its surfaces that name",
                };
                self.ledger.lose(kind, 1, None, place);
            }
        }
    }

    /// Numbers surfaces, openings and shading that share a name.
    fn number_names(&mut self) {
        let shading = self.shading.iter_mut().map(|(_, face)| face);
        let all = self.surfaces.iter_mut().chain(&mut self.openings).chain(shading);
        let mut faces: Vec<&mut Face> = all.collect();
        let names: Vec<&str> = faces.iter().map(|face| face.name.as_str()).collect();
        let found = numbered(&names, "surface", |name| name.trim().to_uppercase());
        let kind = Kind {
            fate: Fate::Doubtful,
            what: "surface without a name of its own, numbered as the file has them",
            next: "give the surfaces names where properties are to tell them apart",
        };
        for (at, name) in found {
            self.ledger.lose(kind, 1, None, || faces[at].place());
            faces[at].name = name;
        }
    }

    /// Records an object of a class that EnergyPlus has not, with corners.
    pub(super) fn doubt(&mut self, class: &str, place: String) {
        let what = format!("object of class `{}` with corners, not read", shown(class));
        self.leave_out(
            &what,
            "`BuildingSurface:Detailed` and its like are read; mend the class",
            place,
        );
    }

    pub(super) fn scene(mut self, mut bounds: Bounds) -> Result<Scene, Error> {
        let rules = self.rules.unwrap_or_else(|| {
            self.ledger
                .warnings
                .push("there are no `GlobalGeometryRules`; relative and counterclockwise are assumed".to_owned());
            Rules::default()
        });
        let key = |name: &str| name.trim().to_uppercase();
        let mut walls: HashMap<String, usize> = HashMap::new();
        if !self.openings.is_empty() || self.shading.iter().any(|(class, _)| *class == Class::ZoneShading) {
            let named = self.surfaces.iter().enumerate();
            // Of several walls of one name the first has the openings.
            named.for_each(|(at, wall)| _ = walls.entry(key(&wall.name)).or_insert(at));
        }
        let mut openings: Vec<Vec<usize>> = vec![Vec::new(); self.surfaces.len()];
        for (at, opening) in self.openings.iter_mut().enumerate() {
            let wall = walls.get(&key(&opening.of)).copied();
            let wall = wall.ok_or_else(|| opening.fail(&format!("its wall `{}` is not there", shown(&opening.of))))?;
            openings[wall].push(at);
            let zone = self.surfaces[wall].of.clone();
            opening.of = zone;
        }
        for face in self.surfaces.iter_mut().chain(&mut self.openings) {
            let zone = self.zones.get(&key(&face.of)).copied();
            let zone = zone.ok_or_else(|| face.fail(&format!("its zone `{}` is not there", shown(&face.of))))?;
            let inward = |corners: &mut Vec<DVec3>| {
                // The first corner stays the first.
                if !rules.clockwise
                    && let Some(others) = corners.get_mut(1..)
                {
                    others.reverse();
                }
            };
            inward(&mut face.corners);
            if !rules.world {
                place(&mut face.corners, Some(zone), self.north);
            }
        }
        for (wall, openings) in self.surfaces.iter().zip(&openings) {
            for &at in openings {
                let opening = &mut self.openings[at];
                let place = opening.place();
                turn_with(&wall.corners, &mut opening.corners, &mut self.ledger, || place);
            }
        }
        self.number_names();
        let mut builder = Builder::default();
        // A hole is tied to its outline by two edges.
        let openings_corners = self.openings.iter().map(|face| 2 * face.corners.len());
        let corners = self.surfaces.iter().map(|face| face.corners.len().saturating_sub(2));
        builder.triangles.reserve_exact(corners.chain(openings_corners).sum());
        for (wall, openings) in self.surfaces.iter().zip(&openings) {
            let is_air = |face: &Face| self.air.contains(&key(&face.construction));
            let holes: Vec<&[DVec3]> = openings
                .iter()
                .map(|&at| self.openings[at].corners.as_slice())
                .collect();
            for &at in openings {
                let opening = &self.openings[at];
                if !in_plane(&wall.corners, &opening.corners) {
                    let kind = Kind {
                        fate: Fate::Approximated,
                        what: "opening out of the plane of its wall",
                        next: "move it into the plane",
                    };
                    let area = 0.5 * vector_area(&opening.corners).length();
                    self.ledger.lose(kind, 1, Some(area), || opening.place());
                }
            }
            let others = openings.iter().map(|&at| (&self.openings[at], [].as_slice()));
            for (face, holes) in std::iter::once((wall, holes.as_slice())).chain(others) {
                if is_air(face) {
                    self.ledger.note("surface of an air boundary, left out");
                    builder.face += 1;
                    continue;
                }
                builder.add(face, holes, &face.construction, false, &mut bounds, &mut self.ledger)?;
            }
        }
        for (class, face) in &mut self.shading {
            let zone = match class {
                Class::ZoneShading => {
                    let wall = walls.get(&key(&face.of)).map(|&at| key(&self.surfaces[at].of));
                    let zone = wall.and_then(|zone| self.zones.get(&zone).copied());
                    Some(zone.ok_or_else(|| face.fail(&format!("its wall `{}` is not there", shown(&face.of))))?)
                }
                _ => None,
            };
            if !rules.world && *class != Class::SiteShading {
                place(&mut face.corners, zone, self.north);
            }
            builder.add(face, &[], "shading", true, &mut bounds, &mut self.ledger)?;
        }
        let material = |name| Material {
            name,
            ..Material::default()
        };
        Ok(Scene {
            triangles: builder.triangles,
            objects: builder.objects.names,
            materials: builder.materials.names.into_iter().map(material).collect(),
            ledger: self.ledger,
            up: Some(Axis::Z),
            metres_per_unit: Some(1.0),
            is_oriented: true,
            ..Scene::default()
        })
    }
}

/// Moves corners from a zone's coordinates to the world's.
fn place(corners: &mut [DVec3], zone: Option<Zone>, north: f64) {
    for corner in corners {
        if let Some(zone) = zone {
            *corner = turned(*corner, zone.north) + zone.origin;
        }
        *corner = turned(*corner, north);
    }
}

/// Returns whether an opening lies in the plane of its wall, by a thousandth of the wall's extent.
fn in_plane(wall: &[DVec3], opening: &[DVec3]) -> bool {
    let (Some(&first), Some(normal)) = (wall.first(), vector_area(wall).try_normalize()) else {
        return true;
    };
    let extent = wall.iter().map(|corner| corner.distance(first)).fold(0.0, f64::max);
    opening
        .iter()
        .all(|corner| (*corner - first).dot(normal).abs() <= 1e-3 * extent)
}

#[derive(Default)]
struct Builder {
    triangles: Vec<Triangle>,
    objects: Names,
    materials: Names,
    face: u32,
}

impl Builder {
    fn add(
        &mut self,
        face: &Face,
        holes: &[&[DVec3]],
        material: &str,
        two_sided: bool,
        bounds: &mut Bounds,
        ledger: &mut Ledger,
    ) -> Result<(), Error> {
        let located = |error: Error| match error.kind {
            ErrorKind::TooLarge(reason) => Error {
                line: face.line,
                ..Error::new(ErrorKind::TooLarge(format!(
                    "surface `{}`: {reason}",
                    shown(&face.name)
                )))
            },
            kind => Error::new(kind),
        };
        let place = || face.place();
        let triangles = cut(&face.corners, holes, bounds, ledger, place).map_err(located)?;
        let object = self.objects.number(&face.name)?;
        let material = self.materials.number(material)?;
        let number = self.face;
        self.face = number
            .checked_add(1)
            .ok_or_else(|| Error::new(ErrorKind::TooLarge("has more surfaces than can be numbered".to_owned())))?;
        self.triangles.extend(triangles.into_iter().map(|corners| Triangle {
            corners,
            object,
            material,
            face: number,
            two_sided,
        }));
        Ok(())
    }
}
