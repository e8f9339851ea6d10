//! Reads CityJSON cities, and CityJSON text sequences (a feature a line).
//!
//! Source: *CityJSON Specifications 2.0.1* (Open Geospatial Consortium community standard), also 1.0 and 1.1; *CityJSON
//! Text Sequences* for streams.
//!
//! # What becomes of what
//! - `vertices`, `transform`: corners in f64, in metres of the file's coordinate system; z is up
//! - a city object's `geometry`: the one of the highest level of detail; geometry of level 0 (footprints) only where a
//!   building and its parts have no other. What is left out is counted
//! - `MultiSurface`, `CompositeSurface`, `Solid`, `MultiSolid`, `CompositeSolid`: a face for each surface, cut into
//!   triangles with its holes
//! - `GeometryInstance`: its template, placed
//! - points and lines: counted
//! - `semantics`: the object of a surface is `CITYOBJECT/RoofSurface`, its material `RoofSurface`; without semantics
//!   the city object and its type. A `ClosureSurface` is air, and left open: radiation passes through it
//! - `metadata`: the coordinate reference system; attributes, appearance, extensions: skipped
//!
//! By serde and a few types of our own: the other services of `cityjson` and `cjseq` (validating, attributes, writing)
//! are not needed here.

use crate::bounds::{Bounds, STEPS_A_COPY};
use crate::names::Names;
use crate::polygon::{
    Labels, TOO_FEW_CORNERS, Triangulation, judge_cut, judge_lost, push_triangles, triangulate_with_holes,
};
use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::{DMat4, DVec3};
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;

/// Reads a CityJSON city, or a sequence of features, from the bytes of a file.
///
/// # Errors
/// When the text is not JSON or not CityJSON, or a boundary names a missing vertex; the error names the line of the
/// JSON error, or the city object.
///
/// ```
/// use hemicube_scene::{Axis, ReadOptions, cityjson};
///
/// let text = br#"{ "type": "CityJSON", "version": "2.0",
///     "transform": { "scale": [0.5, 0.5, 0.5], "translate": [100.0, 0.0, 0.0] },
///     "vertices": [[0, 0, 6], [8, 0, 6], [8, 8, 6], [0, 8, 6]],
///     "CityObjects": { "hut": { "type": "Building", "geometry": [{ "type": "MultiSurface", "lod": "2",
///         "boundaries": [[[0, 1, 2, 3]]],
///         "semantics": { "surfaces": [{ "type": "RoofSurface" }], "values": [0] } }] } } }"#;
/// let scene = cityjson::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0], scene.up), (2, "hut/RoofSurface", Some(Axis::Z)));
/// assert!(scene.triangles.iter().all(|triangle| triangle.corners.iter().all(|corner| corner.z == 3.0)));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let bytes = crate::text::unmarked(bytes)?;
    let mut city = City {
        bounds: Bounds::new(bytes.len(), options),
        ..City::default()
    };
    // A sequence has one JSON text a line, the first of them the frame of the others.
    let texts = serde_json::Deserializer::from_slice(bytes).into_iter::<Document>();
    let mut frame: Option<(Transform, Option<Templates>)> = None;
    for document in texts {
        let document = document.map_err(|error| {
            Error::malformed(format!("is no CityJSON: {}", without_place(&error))).at(error.line() as u64)
        })?;
        match (document.kind.as_str(), &frame) {
            ("CityJSON", None) => {
                let crs = document.metadata.as_ref().and_then(|of| of.reference_system.as_str());
                city.crs = crs.map(|crs| crs.chars().take(CRS_MAX).collect());
                if document.transform.is_none() && !matches!(document.version.as_str(), Some("1.0" | "0.9")) {
                    let warning = "the city has no `transform`, which CityJSON asks for from 1.1 on: its vertices are \
                                   taken for coordinates";
                    city.ledger.warnings.push(warning.to_owned());
                }
                let transform = document.transform.unwrap_or_default();
                city.add(
                    document.objects,
                    &document.vertices,
                    &transform,
                    document.templates.as_ref(),
                )?;
                frame = Some((transform, document.templates));
            }
            ("CityJSONFeature", Some((transform, templates))) => {
                city.add(document.objects, &document.vertices, transform, templates.as_ref())?;
            }
            ("CityJSONFeature", None) => {
                return Err(Error::malformed(
                    "is a CityJSON feature without the `CityJSON` text before it that says where it lies",
                ));
            }
            ("CityJSON", Some(_)) => {
                return Err(Error::unsupported(
                    "holds more than one CityJSON city; open them one by one",
                ));
            }
            (kind, _) => {
                return Err(Error::unsupported(format!(
                    "is JSON of type `{}`, not `CityJSON`",
                    shown(kind)
                )));
            }
        }
    }
    if frame.is_none() {
        return Err(Error::malformed("is empty; a CityJSON text was expected"));
    }
    Ok(city.scene())
}

/// serde_json's message without its own "at line … column …": the error has the line itself.
fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or_default().to_owned()
}

fn shown(text: &str) -> String {
    text.chars().take(40).collect::<String>().escape_debug().to_string()
}

#[derive(Deserialize)]
struct Document {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    transform: Option<Transform>,
    #[serde(rename = "CityObjects", default)]
    objects: InOrder<CityObject>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
    #[serde(rename = "geometry-templates", default)]
    templates: Option<Templates>,
    #[serde(default)]
    version: Value,
    #[serde(default)]
    metadata: Option<Metadata>,
}

#[derive(Deserialize)]
struct Metadata {
    #[serde(rename = "referenceSystem", default)]
    reference_system: Value,
}

#[derive(Clone, Deserialize)]
struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

impl Default for Transform {
    fn default() -> Self {
        Self {
            scale: [1.0; 3],
            translate: [0.0; 3],
        }
    }
}

#[derive(Deserialize)]
struct Templates {
    templates: Vec<Geometry>,
    #[serde(rename = "vertices-templates")]
    vertices: Vec<[f64; 3]>,
}

#[derive(Deserialize)]
struct CityObject {
    #[serde(rename = "type", default)]
    kind: String,
    #[serde(default)]
    geometry: Vec<Geometry>,
    #[serde(default)]
    parents: Vec<String>,
    #[serde(default)]
    children: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
struct Geometry {
    #[serde(rename = "type")]
    kind: String,
    /// A number in version 1.0, text from 1.1 on.
    #[serde(default)]
    lod: Value,
    #[serde(default)]
    boundaries: Value,
    #[serde(default)]
    semantics: Option<Semantics>,
    #[serde(default)]
    template: Option<usize>,
    #[serde(rename = "transformationMatrix", default)]
    matrix: Option<[f64; 16]>,
}

impl Geometry {
    /// Level of detail, such as 2.2.
    fn level(&self) -> f64 {
        match &self.lod {
            Value::Number(number) => number.as_f64().unwrap_or(0.0),
            Value::String(text) => text.parse().unwrap_or(0.0),
            // An instance of a template may have none of its own.
            _ => f64::INFINITY,
        }
    }
}

#[derive(Deserialize)]
struct Semantics {
    #[serde(default)]
    surfaces: Vec<SemanticSurface>,
    #[serde(default)]
    values: Value,
}

#[derive(Deserialize)]
struct SemanticSurface {
    #[serde(rename = "type", default)]
    kind: String,
}

/// A JSON object's members in the order of the file: the order of the patches.
struct InOrder<T>(Vec<(String, T)>);

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for InOrder<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members<T>(std::marker::PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Members<T> {
            type Value = InOrder<T>;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object of city objects")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut members = Vec::new();
                while let Some(member) = map.next_entry()? {
                    members.push(member);
                }
                Ok(InOrder(members))
            }
        }
        deserializer.deserialize_map(Members(std::marker::PhantomData))
    }
}

/// The vertices of a geometry.
struct Place<'a> {
    vertices: &'a [[f64; 3]],
    transform: &'a Transform,
    /// Transformation of a template's instance; the identity for other geometry.
    matrix: DMat4,
    /// Reference point of a template's instance.
    reference: DVec3,
}

impl Place<'_> {
    fn vertex(&self, index: u64) -> Option<DVec3> {
        let vertex = self.vertices.get(usize::try_from(index).ok()?)?;
        let at = |k: usize| vertex[k] * self.transform.scale[k] + self.transform.translate[k];
        let vertex = DVec3::new(at(0), at(1), at(2));
        Some(self.matrix.transform_point3(vertex) + self.reference)
    }
}

#[derive(Default)]
struct City {
    triangles: Vec<Triangle>,
    objects: Names,
    materials: Names,
    ledger: Ledger,
    face: u32,
    corners: Vec<DVec3>,
    holes: Vec<usize>,
    cut: Vec<[u32; 3]>,
    bounds: Bounds,
    crs: Option<String>,
}

/// Most characters kept of the name of a coordinate reference system.
const CRS_MAX: usize = 256;

impl City {
    fn lose(&mut self, fate: Fate, what: &str, next: &str, id: &str, area: Option<f64>) {
        let place = || format!("`{}`", shown(id));
        self.ledger.lose(Kind { fate, what, next }, 1, area, place);
    }

    fn add(
        &mut self,
        objects: InOrder<CityObject>,
        vertices: &[[f64; 3]],
        transform: &Transform,
        templates: Option<&Templates>,
    ) -> Result<(), Error> {
        // The best level of a family, a building with its parts: footprints count only if there is nothing else.
        let mut best: HashMap<&str, f64> = HashMap::new();
        let family = |id: &'_ String, object: &'_ CityObject| object.parents.first().unwrap_or(id).clone();
        let families: Vec<String> = objects.0.iter().map(|(id, object)| family(id, object)).collect();
        for ((_, object), family) in objects.0.iter().zip(&families) {
            for geometry in &object.geometry {
                let level = best.entry(family).or_insert(f64::NEG_INFINITY);
                *level = level.max(geometry.level());
            }
        }
        for ((id, object), family) in objects.0.iter().zip(&families) {
            let level = object
                .geometry
                .iter()
                .map(Geometry::level)
                .fold(f64::NEG_INFINITY, f64::max);
            let mut used = false;
            if object.geometry.is_empty() && object.children.is_none() && object.kind != "CityObjectGroup" {
                let next = "geometry is read of the member `geometry`";
                self.lose(
                    Fate::LeftOut,
                    "city object without geometry and without parts",
                    next,
                    id,
                    None,
                );
            }
            for geometry in &object.geometry {
                let footprint = level < 1.0 && best.get(family.as_str()).is_some_and(|&best| best >= 1.0);
                if geometry.level() < level || footprint {
                    self.ledger.note("geometry of a lower level of detail, left out");
                } else if used {
                    let what = "further geometry of the same level of detail, left out";
                    self.lose(Fate::LeftOut, what, "make one geometry of them", id, None);
                } else {
                    used = true;
                    let place = Place {
                        vertices,
                        transform,
                        matrix: DMat4::IDENTITY,
                        reference: DVec3::ZERO,
                    };
                    self.geometry(id, object, geometry, &place, templates)?;
                }
            }
        }
        Ok(())
    }

    fn geometry(
        &mut self,
        id: &str,
        object: &CityObject,
        geometry: &Geometry,
        place: &Place<'_>,
        templates: Option<&Templates>,
    ) -> Result<(), Error> {
        let broken = |what: &str| Error::malformed(format!("city object `{}`: {what}", shown(id)));
        // Depth of the surfaces in the boundaries.
        let depth = match geometry.kind.as_str() {
            "MultiSurface" | "CompositeSurface" => 0,
            "Solid" => 1,
            "MultiSolid" | "CompositeSolid" => 2,
            "GeometryInstance" => {
                let template = geometry
                    .template
                    .zip(templates)
                    .and_then(|(at, all)| all.templates.get(at));
                let (Some(template), Some(templates)) = (template, templates) else {
                    return Err(broken("its template is not there"));
                };
                if template.kind == "GeometryInstance" {
                    return Err(broken("its template is an instance of a template"));
                }
                let reference = geometry
                    .boundaries
                    .get(0)
                    .and_then(Value::as_u64)
                    .and_then(|i| place.vertex(i));
                let Some(reference) = reference else {
                    return Err(broken("its reference point is not there"));
                };
                let identity = Transform::default();
                // Rows in the file, columns here.
                let matrix = geometry
                    .matrix
                    .map_or(DMat4::IDENTITY, |m| DMat4::from_cols_array(&m).transpose());
                let placed = Place {
                    vertices: &templates.vertices,
                    transform: &identity,
                    matrix,
                    reference,
                };
                return self.geometry(id, object, template, &placed, None);
            }
            "MultiPoint" | "MultiLineString" => {
                self.ledger.note("geometry of points or lines");
                return Ok(());
            }
            other => {
                let what = format!("geometry of type `{}`, not read", shown(other));
                self.lose(Fate::LeftOut, &what, "surfaces and solids are read", id, None);
                return Ok(());
            }
        };
        let (values, kinds) = match &geometry.semantics {
            Some(semantics) => (&semantics.values, semantics.surfaces.as_slice()),
            None => (&Value::Null, [].as_slice()),
        };
        let mut pending = vec![(&geometry.boundaries, values, depth)];
        while let Some((boundaries, values, depth)) = pending.pop() {
            let Some(list) = boundaries.as_array() else {
                return Err(broken("its boundaries are not the arrays that its type asks for"));
            };
            if depth > 0 {
                let inner = list.iter().enumerate().rev();
                pending
                    .extend(inner.map(|(at, boundary)| (boundary, values.get(at).unwrap_or(&Value::Null), depth - 1)));
                continue;
            }
            // Surfaces without corners make no triangle, and templates repeat them.
            self.bounds.steps(STEPS_A_COPY.saturating_mul(list.len() as u64))?;
            for (at, rings) in list.iter().enumerate() {
                let kind = values
                    .get(at)
                    .and_then(Value::as_u64)
                    .and_then(|kind| kinds.get(usize::try_from(kind).ok()?))
                    .map_or("", |surface| surface.kind.as_str());
                self.surface(id, object, rings, kind, place)
                    .map_err(|reason| match reason {
                        Some(error) => error,
                        None => broken("a boundary names a vertex that is not there, or is no ring of vertices"),
                    })?;
            }
        }
        Ok(())
    }

    /// Cuts a surface. Returns an error for one that breaks CityJSON's rules.
    fn surface(
        &mut self,
        id: &str,
        object: &CityObject,
        rings: &Value,
        kind: &str,
        place: &Place<'_>,
    ) -> Result<(), Option<Error>> {
        self.corners.clear();
        self.holes.clear();
        for (at, ring) in rings.as_array().ok_or(None)?.iter().enumerate() {
            if at > 0 {
                self.holes.push(self.corners.len());
            }
            for index in ring.as_array().ok_or(None)? {
                let vertex = index.as_u64().and_then(|index| place.vertex(index)).ok_or(None)?;
                self.corners.push(vertex);
            }
        }
        let named = |error: Error| match error.kind {
            ErrorKind::TooLarge(reason) => {
                Error::new(ErrorKind::TooLarge(format!("city object `{}`: {reason}", shown(id))))
            }
            kind => Error::new(kind),
        };
        self.bounds
            .polygon_with_holes(self.corners.len(), self.holes.len())
            .map_err(named)?;
        let face = self.face;
        self.face = face.checked_add(1).ok_or_else(|| {
            Some(Error::new(ErrorKind::TooLarge(format!(
                "has more than {face} surfaces"
            ))))
        })?;
        if kind == "ClosureSurface" {
            self.ledger.note("`ClosureSurface`, left open as air");
            return Ok(());
        }
        self.cut.clear();
        match triangulate_with_holes(&self.corners, &self.holes, &mut self.cut) {
            Triangulation::Done if self.holes.is_empty() => {
                judge_cut(&self.corners, &self.cut, &mut self.ledger, || {
                    format!("`{}`", shown(id))
                });
            }
            Triangulation::Done => {}
            Triangulation::TooFewCorners => {
                self.ledger
                    .lose(TOO_FEW_CORNERS, 1, None, || format!("`{}`", shown(id)));
            }
            Triangulation::NoArea => {
                let outline = self.holes.first().copied().unwrap_or(self.corners.len());
                judge_lost(&self.corners[..outline], &mut self.ledger, || {
                    format!("`{}`", shown(id))
                });
            }
        }
        if self.cut.is_empty() {
            return Ok(());
        }
        let (name, material) = if kind.is_empty() {
            (id.to_owned(), object.kind.as_str())
        } else {
            (format!("{id}/{kind}"), kind)
        };
        let object = self.objects.number(&name)?;
        let material = self.materials.number(material)?;
        push_triangles(
            &self.corners,
            &self.cut,
            Labels { object, material, face },
            &mut self.triangles,
        );
        self.bounds.triangles(self.triangles.len() as u64, 0)?;
        Ok(())
    }

    fn scene(self) -> Scene {
        let material = |name| Material {
            name,
            ..Material::default()
        };
        Scene {
            triangles: self.triangles,
            objects: self.objects.names,
            materials: self.materials.names.into_iter().map(material).collect(),
            ledger: self.ledger,
            crs: self.crs,
            up: Some(Axis::Z),
            ..Scene::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of 2 m with a hole of 1 m² in its roof, as a building part under a building that has its footprint.
    const CITY: &str = r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.001,0.001,0.001],
"translate":[80000.0,450000.0,0.0]},
"CityObjects":{"b":{"type":"Building","children":["a"],"geometry":[{"type":"MultiSurface","lod":"0","boundaries":[[[0,
1,2,3]]]}]},
"a":{"type":"BuildingPart","parents":["b"],"geometry":[{"type":"Solid","lod":"1.2","boundaries":[[[[0,3,2,1]]]]},
{"type":"Solid","lod":"2.2","boundaries":[[[[0,3,2,1]],[[4,5,6,7],[8,9,10,11]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,
0,4,7]]]],
"semantics":{"surfaces":[{"type":"GroundSurface"},{"type":"RoofSurface"},{"type":"WallSurface"}],"values":[[0,1,2,2,2,
2]]}}]},
"t":{"type":"SolitaryVegetationObject","geometry":[{"type":"GeometryInstance","template":0,"boundaries":[4],
"transformationMatrix":[2,0,0,0,0,2,0,0,0,0,2,5,0,0,0,1]}]}},
"geometry-templates":{"templates":[{"type":"MultiSurface","lod":"2","boundaries":[[[0,1,2]]]}],
"vertices-templates":[[0,0,0],[1,0,0],[0,1,0]]},
"vertices":[[0,0,0],[2000,0,0],[2000,2000,0],[0,2000,0],[0,0,2000],[2000,0,2000],[2000,2000,2000],[0,2000,2000],[500,
500,2000],[1500,500,2000],[1500,1500,2000],[500,1500,2000]]}"#;

    fn open(text: &str) -> Result<Scene, Error> {
        read(text.as_bytes(), None, ReadOptions::default())
    }

    fn area(scene: &Scene, object: &str) -> f64 {
        let of = |t: &&Triangle| scene.objects[t.object as usize] == object;
        let area = |t: &Triangle| {
            0.5 * (t.corners[1] - t.corners[0])
                .cross(t.corners[2] - t.corners[0])
                .length()
        };
        scene.triangles.iter().filter(of).map(area).sum()
    }

    #[test]
    fn the_best_level_with_holes_semantics_and_templates() {
        let scene = open(CITY).unwrap();
        assert_eq!(
            scene.objects,
            ["a/GroundSurface", "a/RoofSurface", "a/WallSurface", "t"]
        );
        let materials: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(
            materials,
            [
                "GroundSurface",
                "RoofSurface",
                "WallSurface",
                "SolitaryVegetationObject"
            ]
        );
        assert_eq!(scene.ledger.get("geometry of a lower level of detail, left out"), 2);
        for (object, expected) in [
            ("a/GroundSurface", 4.0),
            ("a/RoofSurface", 3.0),
            ("a/WallSurface", 16.0),
            ("t", 2.0),
        ] {
            let found = area(&scene, object);
            assert!((found - expected).abs() < 1e-6, "{object}: {found}");
        }
        let roof = scene.triangles.iter().find(|t| t.object == 1).unwrap();
        assert!(
            (roof.corners[1] - roof.corners[0])
                .cross(roof.corners[2] - roof.corners[0])
                .z
                > 0.0
        );
        let tree = scene.triangles.last().unwrap().corners;
        assert!(
            (tree[1] - DVec3::new(80002.0, 450000.0, 7.0)).length() < 1e-9,
            "{tree:?}"
        );
        assert_eq!(scene.up, Some(Axis::Z));
    }

    #[test]
    fn a_sequence_is_its_features() {
        let whole: Value = serde_json::from_str(CITY).unwrap();
        let mut frame = whole.clone();
        frame["CityObjects"] = serde_json::json!({});
        frame["vertices"] = serde_json::json!([]);
        let feature = serde_json::json!({
            "type": "CityJSONFeature", "id": "b", "CityObjects": whole["CityObjects"], "vertices": whole["vertices"],
        });
        let text = format!("{frame}\n{feature}\n");
        let (scene, expected) = (open(&text).unwrap(), open(CITY).unwrap());
        // The members of a JSON value are sorted, so the order differs from the file above; the surfaces do not.
        assert_eq!(scene.triangles.len(), expected.triangles.len());
        assert!((area(&scene, "a/WallSurface") - 16.0).abs() < 1e-6);
        assert!(
            open(&feature.to_string())
                .unwrap_err()
                .to_string()
                .contains("without the `CityJSON` text")
        );
    }

    #[test]
    fn bad_files_are_refused_with_a_reason() {
        for (from, to, expected) in [
            (
                "[[0,1,5,4]]",
                "[[0,1,5,44]]",
                "city object `a`: a boundary names a vertex",
            ),
            ("[[0,1,5,4]]", "[0,1,5,4]", "city object `a`: a boundary names a vertex"),
            (
                "[[0,1,5,4]]",
                "[[0,1,5,-4]]",
                "city object `a`: a boundary names a vertex",
            ),
            ("\"template\":0", "\"template\":3", "its template is not there"),
            (
                "\"CityJSON\"",
                "\"FeatureCollection\"",
                "`FeatureCollection`, not `CityJSON`",
            ),
            ("\"scale\":[0.001", "\"scale\":[", "line 1"),
            ("[[[[0,3,2,1]],[[4", "7,[[[[0,3,2,1]],[[4", "line 6: is no CityJSON"),
        ] {
            let message = open(&CITY.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        for end in 0..CITY.len() - 1 {
            assert!(open(&CITY[..end]).is_err(), "cut at {end}");
        }
    }
}
