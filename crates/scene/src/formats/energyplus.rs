//! Reads EnergyPlus's buildings: input data files (`.idf`) and epJSON (`.epJSON`).
//!
//! Source: *Input Output Reference* of EnergyPlus 24.2, group thermal zone description and geometry; `GetVertices` of
//! `SurfaceGeometry.cc` for coordinate systems and winding. Fields of older versions without spaces (before 9.6) and
//! with a shading control (before 9.0) are told apart by their number.
//!
//! # What becomes of what
//! - `BuildingSurface:Detailed`, `Wall:Detailed`, `Floor:Detailed`, `RoofCeiling:Detailed`: a face, which **faces into
//!   its zone**. EnergyPlus winds surfaces outwards; here they are turned, because the zone's radiation is what they
//!   exchange. `--flip all` turns them out, for sun and sky
//! - `FenestrationSurface:Detailed` (windows, doors): a face, cut out of its wall, facing as the wall
//! - a wall between two zones: the two surfaces of EnergyPlus, back to back, each facing its zone
//! - `Shading:Site:Detailed`, `Shading:Building:Detailed`, `Shading:Zone:Detailed`: a face with two sides
//! - the object is the surface's name, the material its construction, `shading` for shading. Where several have one name,
//!   they are numbered, `NAME 1`, and that is said; the first zone of a name stands for all of that name, which is said
//! - surfaces with `Construction:AirBoundary`: left out, because radiation passes through them
//! - `GlobalGeometryRules`: coordinates relative to zones (turned by the zone's and the building's north, moved to the
//!   zone's origin) or of the world; clockwise or counterclockwise. Its starting corner does not matter here
//! - surfaces in the order of the file, each followed by its openings; then shading
//! - `InternalMass`, multipliers of windows, `Shading:Overhang`, `Shading:Fin` and other shading by rule: counted
//! - `Wall:Exterior`, `Window` and other surfaces by length and height, `GeometryTransform`, rotation by
//!   `Compliance:Building`, macros (`##`): an error
//! - everything else: skipped
//!
//! Names are the same in upper and lower case. Lengths are in metres, z is up. An error names the line; one of a
//! surface in epJSON names the surface.

mod building;
mod epjson;
mod idf;

use crate::bounds::Bounds;
use crate::{Error, ReadOptions, Scene};
use std::path::Path;

/// Reads an EnergyPlus building from the bytes of a file.
///
/// # Errors
/// When the text breaks the format, or a surface names a zone or a wall that is missing.
///
/// ```
/// use hemicube_scene::{ReadOptions, energyplus};
///
/// let text = b"GlobalGeometryRules, UpperLeftCorner, Counterclockwise, World;\nZone, office;\n\
///     Floor:Detailed, floor, slab, office, , Ground, , NoSun, NoWind, , 4, 0,0,0, 0,3,0, 4,3,0, 4,0,0;\n";
/// let scene = energyplus::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0], &*scene.materials[0].name), (2, "floor", "slab"));
/// // Wound outwards it faces down in the file; here it faces up, into the office.
/// let [a, b, c] = scene.triangles[0].corners;
/// assert!((b - a).cross(c - a).z > 0.0);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let bytes = crate::text::unmarked(bytes)?;
    let building = if bytes.trim_ascii_start().starts_with(b"{") {
        epjson::read(bytes)?
    } else {
        idf::read(bytes)?
    };
    building.scene(Bounds::new(bytes.len(), options))
}

/// Text for an error.
fn shown(text: &str) -> String {
    text.chars().take(40).collect::<String>().escape_debug().to_string()
}
