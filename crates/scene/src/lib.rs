//! Scenes for form-factor computation: triangles in f64 with the names of their objects and materials and their sides,
//! read from OBJ, glTF, AC3D, STL, PLY, View3D, CityJSON, EnergyPlus, gbXML, meshes and height models, repaired by
//! documented rules, and cut into patches.
//!
//! ```
//! use hemicube_scene::{Patches, Subdivision, generate};
//! let scene = generate::cornell_box();
//! let patches = Patches::new(&scene, Subdivision::Levels(4))?;
//! assert_eq!(patches.len(), 40 * 256);
//! # Ok::<(), hemicube_scene::Error>(())
//! ```

#[cfg(feature = "_readers")]
mod bounds;
mod budget;
#[cfg(any(feature = "gmsh", feature = "vtk"))]
mod cursor;
mod error;
#[cfg(feature = "_polygons")]
pub mod faces;
mod folder;
mod formats;
#[cfg(feature = "generate")]
pub mod generate;
pub mod globs;
mod ledger;
#[cfg(feature = "_meshes")]
mod mesh;
#[cfg(any(
    feature = "obj",
    feature = "vs3",
    feature = "cityjson",
    feature = "_buildings",
    feature = "_meshes"
))]
mod names;
#[cfg(any(feature = "vs3", feature = "_buildings"))]
mod openings;
mod patch;
#[cfg(feature = "_polygons")]
mod polygon;
mod regular;
pub mod repair;
mod subdivide;
pub mod survey;
pub mod text;
pub mod up;
pub mod write;

pub use budget::{Budget, NoRoom};
pub use error::{Error, ErrorKind};
pub use folder::files;
pub use formats::*;
pub use ledger::{Fate, Kind, Ledger, Loss};
pub use patch::{InputPatch, Patches, Side};
pub use regular::{open_regular, read_regular, read_regular_text};
pub use subdivide::Subdivision;

use glam::DVec3;
use std::collections::BTreeMap;

/// A triangle of a scene: world coordinates in the file's unit, corners counter-clockwise seen from the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// The corners, in the file's unit.
    pub corners: [DVec3; 3],
    /// Index into [`Scene::objects`].
    pub object: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Position of the face (a polygon; a triangle in formats without polygons) in the file, from 0, counting faces
    /// dropped later. A polygon's triangles share it.
    pub face: u32,
    /// True if the back radiates and receives, too: such a triangle becomes two patches.
    pub two_sided: bool,
}

/// A surface material. Optical properties are read only when [`ReadOptions::optics`] asks for them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// The name in the file, or `""` for faces without a material.
    pub name: String,
    /// Diffuse reflectance (linear RGB, 0 to 1), if the file gives one and it was asked for.
    pub diffuse: Option<[f64; 3]>,
    /// Emitted radiosity (linear RGB, the file's own unit), if the file gives one and it was asked for.
    pub emission: Option<[f64; 3]>,
    /// The mirror or pane that it is, if the file says so and optics were asked for.
    pub gloss: Option<Gloss>,
}

/// A mirror or a pane, as files for pictures give it. Red, green and blue, from 0 to 1.
///
/// - MTL, mirrors: `illum` 3, 8: ρs = `Ks`; 5: by Fresnel with `Ni`, or `Ks`. Panes: `illum` 4, 6, 9: τ = 1 − `d`,
///   ρs = `Ks`, at most `d`; 7: by Fresnel with `Ni`, the glass letting through 1 − `d`.
/// - glTF, mirrors: metallic 1, roughness 0: ρs = base colour. Panes: `KHR_materials_transmission`, roughness 0: by
///   Fresnel with `ior` (1.5), the glass letting through the factor times the base colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gloss {
    /// Specular reflectance; of no meaning with an index.
    pub specular: [f64; 3],
    /// Transmittance; with an index that of the glass alone, between its faces.
    pub transmittance: [f64; 3],
    /// Index of refraction: reflectance and transmittance follow from it by Fresnel's equations.
    pub index: Option<f64>,
}

/// The axis pointing up in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The x axis.
    X,
    /// The y axis.
    Y,
    /// The z axis.
    Z,
}

/// A scene: triangles in the file's face order, with the names they refer to.
///
/// A reader makes one of a file, [`generate`] makes some by rule, and an embedder makes it of triangles:
///
/// ```
/// use hemicube_scene::{Material, Patches, Scene, Side, Subdivision, Triangle};
/// use glam::DVec3;
///
/// let corners = [DVec3::ZERO, DVec3::X, DVec3::Y]; // counter-clockwise seen from the front
/// let scene = Scene {
///     triangles: vec![Triangle { corners, object: 0, material: 0, face: 0, two_sided: true }],
///     objects: vec!["leaf".to_owned()],
///     materials: vec![Material::default()],
///     ..Scene::default()
/// };
/// // Both sides of it radiate: two patches on one surface.
/// let patches = Patches::new(&scene, Subdivision::None)?;
/// let [front, back] = patches.iter().collect::<Vec<_>>()[..] else { unreachable!("two sides") };
/// assert_eq!((patches.side(front), patches.side(back)), (Side::Front, Side::Back));
/// assert_eq!((patches.normal(front), patches.normal(back)), (DVec3::Z, DVec3::NEG_Z));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The triangles, in the file's face order.
    pub triangles: Vec<Triangle>,
    /// Object names (OBJ `o`/`g`, glTF node, AC3D object), in order of first use; not necessarily unique.
    pub objects: Vec<String>,
    /// Materials, in order of first use.
    pub materials: Vec<Material>,
    /// What was not taken as the file says.
    pub ledger: Ledger,
    /// Further names of objects, by their number: a surface of a mesh may be in several groups. Properties, selections
    /// and flips match them as they match the first.
    pub further_names: BTreeMap<u32, Vec<String>>,
    /// The coordinate reference system that the file names, such as `https://www.opengis.net/def/crs/EPSG/0/7415`.
    pub crs: Option<String>,
    /// True if the format says which way each surface faces, and its reader turned them so: one that sees backs is no
    /// reason to turn others.
    pub is_oriented: bool,
    /// The up axis prescribed by the format (glTF: y; AC3D: y), if it prescribes one.
    pub up: Option<Axis>,
    /// The length of one unit in metres prescribed by the format (glTF: 1), if it prescribes one.
    pub metres_per_unit: Option<f64>,
}

/// Returns whether a character moves a terminal's cursor, rings, ends a line or turns text around. Names may have any:
/// escape them before showing them.
///
/// ```
/// assert!(hemicube_scene::is_unseen('\u{1b}') && hemicube_scene::is_unseen('\n') && !hemicube_scene::is_unseen('é'));
/// ```
pub fn is_unseen(c: char) -> bool {
    let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns
}

/// Options of reading: optical properties, and what the result may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Read diffuse reflectance and emission of materials, from material libraries, too.
    pub optics: bool,
    /// Read scenes that grow beyond their file's size. By default a file may become one triangle a byte, a million in
    /// any case, and polygons with holes may have 16,384 corners. A small file may then take all memory.
    pub allow_large: bool,
    /// Memory that the file, what its copies hold and its triangles may take.
    pub budget: Budget,
}
