//! Objects of epJSON: classes with objects by name, whose fields have names.

use super::building::{Building, Class, Face, Rules, Zone, refused, rotated};
use super::shown;
use crate::Error;
use glam::DVec3;
use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, Visitor};

pub(super) fn read(bytes: &[u8]) -> Result<Building, Error> {
    let mut reader = Reader {
        building: Building::default(),
        failure: None,
        any: false,
    };
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let read = Classes(&mut reader).deserialize(&mut json).and_then(|()| json.end());
    if let Err(error) = read {
        let line = error.line() as u64;
        return Err(match reader.failure {
            Some(failure) => failure.at(line),
            None => {
                let text = error.to_string();
                let reason = text.split(" at line ").next().unwrap_or_default();
                let reason: String = reason.chars().filter(|&c| !crate::is_unseen(c)).take(160).collect();
                Error::malformed(format!("is no epJSON: {reason}")).at(line)
            }
        });
    }
    if !reader.any {
        return Err(Error::unsupported(
            "is JSON without a class of EnergyPlus such as `Zone` or `BuildingSurface:Detailed`",
        ));
    }
    Ok(reader.building)
}

struct Reader {
    building: Building,
    /// The error that stopped the reading, with its kind.
    failure: Option<Error>,
    any: bool,
}

/// A field that is a number, or text in its place such as `Autocalculate`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(untagged)]
enum Number {
    Value(f64),
    Text(String),
    #[default]
    Nothing,
}

impl Number {
    fn value(&self) -> Option<f64> {
        match self {
            Self::Value(number) => Some(*number),
            Self::Text(text) => text.trim().parse().ok(),
            Self::Nothing => None,
        }
    }
}

#[derive(Clone, Copy, Deserialize)]
struct Vertex {
    #[serde(rename = "vertex_x_coordinate")]
    x: f64,
    #[serde(rename = "vertex_y_coordinate")]
    y: f64,
    #[serde(rename = "vertex_z_coordinate")]
    z: f64,
}

/// The fields of all classes that are of use.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Fields {
    construction_name: String,
    zone_name: String,
    building_surface_name: String,
    base_surface_name: String,
    vertices: Vec<Vertex>,
    number_of_vertices: Number,
    multiplier: Number,
    vertex_entry_direction: String,
    coordinate_system: String,
    north_axis: Number,
    direction_of_relative_north: Number,
    x_origin: Number,
    y_origin: Number,
    z_origin: Number,
    building_rotation_for_appendix_g: Number,
    // Openings have a field for each coordinate.
    vertex_1_x_coordinate: Option<f64>,
    vertex_1_y_coordinate: Option<f64>,
    vertex_1_z_coordinate: Option<f64>,
    vertex_2_x_coordinate: Option<f64>,
    vertex_2_y_coordinate: Option<f64>,
    vertex_2_z_coordinate: Option<f64>,
    vertex_3_x_coordinate: Option<f64>,
    vertex_3_y_coordinate: Option<f64>,
    vertex_3_z_coordinate: Option<f64>,
    vertex_4_x_coordinate: Option<f64>,
    vertex_4_y_coordinate: Option<f64>,
    vertex_4_z_coordinate: Option<f64>,
}

impl Fields {
    fn corners(&self) -> Result<Vec<DVec3>, &'static str> {
        if !self.vertices.is_empty() {
            return Ok(self.vertices.iter().map(|v| DVec3::new(v.x, v.y, v.z)).collect());
        }
        let c = self;
        let all = [
            [
                c.vertex_1_x_coordinate,
                c.vertex_1_y_coordinate,
                c.vertex_1_z_coordinate,
            ],
            [
                c.vertex_2_x_coordinate,
                c.vertex_2_y_coordinate,
                c.vertex_2_z_coordinate,
            ],
            [
                c.vertex_3_x_coordinate,
                c.vertex_3_y_coordinate,
                c.vertex_3_z_coordinate,
            ],
            [
                c.vertex_4_x_coordinate,
                c.vertex_4_y_coordinate,
                c.vertex_4_z_coordinate,
            ],
        ];
        let mut corners = Vec::new();
        for (at, corner) in all.iter().enumerate() {
            match corner {
                [Some(x), Some(y), Some(z)] if corners.len() == at => corners.push(DVec3::new(*x, *y, *z)),
                [None, None, None] => {}
                _ => return Err("a corner lacks a coordinate"),
            }
        }
        Ok(corners)
    }
}

/// The members of the file: classes.
struct Classes<'a>(&'a mut Reader);

impl<'de> DeserializeSeed<'de> for Classes<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Classes<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object of EnergyPlus's classes")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(name) = map.next_key::<String>()? {
            match Class::of(&name) {
                Some(Class::Refused) => {
                    self.0.failure = Some(refused(&name));
                    return Err(A::Error::custom("refused"));
                }
                Some(class) => {
                    self.0.any = true;
                    map.next_value_seed(Objects(self.0, class))?;
                }
                None => {
                    let first = match map.next_value::<Unknown>()? {
                        Unknown::Objects(objects) => objects.into_iter().find(|(_, of)| of.has_corners()),
                        Unknown::Other(_) => None,
                    };
                    if let Some((object, _)) = first {
                        self.0.building.doubt(&name, format!("`{}`", shown(&object)));
                    }
                }
            }
        }
        Ok(())
    }
}

/// A class that is not known: whether its objects have corners.
#[derive(Deserialize)]
#[serde(untagged)]
enum Unknown {
    Objects(std::collections::BTreeMap<String, Corners>),
    Other(IgnoredAny),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Corners {
    List { vertices: Vec<IgnoredAny> },
    Single { vertex_3_z_coordinate: f64 },
    Other(IgnoredAny),
}

impl Corners {
    fn has_corners(&self) -> bool {
        match self {
            Self::List { vertices } => vertices.len() > 2,
            Self::Single { vertex_3_z_coordinate } => vertex_3_z_coordinate.is_finite(),
            Self::Other(_) => false,
        }
    }
}

/// The members of a class: objects by name.
struct Objects<'a>(&'a mut Reader, Class);

impl<'de> DeserializeSeed<'de> for Objects<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Objects<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object of a class's objects by name")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(name) = map.next_key::<String>()? {
            let fields: Fields = map.next_value()?;
            if let Err(failure) = enter(&mut self.0.building, self.1, name, fields) {
                self.0.failure = Some(failure);
                return Err(A::Error::custom("refused"));
            }
        }
        Ok(())
    }
}

/// Takes an object into the building.
fn enter(building: &mut Building, class: Class, name: String, fields: Fields) -> Result<(), Error> {
    let number = |field: &Number| field.value().unwrap_or(0.0);
    match class {
        Class::Rules => building.rules = Some(Rules::of(&fields.vertex_entry_direction, &fields.coordinate_system)?),
        Class::Building => building.north = number(&fields.north_axis),
        Class::Zone => {
            let zone = Zone {
                north: number(&fields.direction_of_relative_north),
                origin: DVec3::new(
                    number(&fields.x_origin),
                    number(&fields.y_origin),
                    number(&fields.z_origin),
                ),
            };
            building.add_zone(&name, zone, || format!("`{}`", shown(&name)));
        }
        Class::Surface | Class::Wall => building.surfaces.push(face(name, fields, |fields| &fields.zone_name)?),
        Class::Opening => {
            if number(&fields.multiplier) > 1.0 {
                let place = format!("`{}`", shown(&name));
                building.leave_out("window with a multiplier, taken once", "write each window out", place);
            }
            building
                .openings
                .push(face(name, fields, |fields| &fields.building_surface_name)?);
        }
        Class::SiteShading | Class::BuildingShading | Class::ZoneShading => {
            let face = face(name, fields, |fields| &fields.base_surface_name)?;
            building.shading.push((class, face));
        }
        Class::AirBoundary => {
            building.air.insert(name.trim().to_uppercase());
        }
        Class::Mass => {
            building.leave_out(
                "internal mass, which has no place",
                "make surfaces of it",
                format!("`{}`", shown(&name)),
            );
        }
        Class::OtherShading => {
            let next = "write it as `Shading:Building:Detailed`";
            building.leave_out("shading without corners, not read", next, format!("`{}`", shown(&name)));
        }
        Class::Compliance if number(&fields.building_rotation_for_appendix_g) != 0.0 => return Err(rotated()),
        Class::Compliance | Class::Refused => {}
    }
    Ok(())
}

fn face(name: String, fields: Fields, of: fn(&Fields) -> &String) -> Result<Face, Error> {
    let mut face = Face {
        name,
        construction: fields.construction_name.clone(),
        of: of(&fields).clone(),
        corners: Vec::new(),
        line: None,
    };
    face.corners = fields.corners().map_err(|reason| face.fail(reason))?;
    if face.corners.len() < 3 {
        return Err(face.fail(&format!("has {} corners; three or more are due", face.corners.len())));
    }
    match fields.number_of_vertices.value() {
        Some(said) if said != face.corners.len() as f64 => {
            Err(face.fail(&format!("has {} corners, and says {said}", face.corners.len())))
        }
        _ => Ok(face),
    }
}
