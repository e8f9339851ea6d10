//! The glTF versions and required extensions that are read.

use super::MEND;
use super::json::Document;
use crate::Error;

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Required extensions that do not change the shape of the scene, or whose shape is read.
const READ: [&str; 8] = [
    INSTANCING,
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "KHR_animation_pointer",
    "KHR_xmp_json_ld",
    "MSFT_texture_dds",
];
/// Families of extensions for the look of a surface, never its place.
const READ_FAMILIES: [&str; 5] = [
    "KHR_materials_",
    "EXT_materials_",
    "ADOBE_materials_",
    "KHR_texture_",
    "EXT_texture_",
];

/// Refuses an unknown version or required extension.
pub(super) fn check(document: &Document<'_>) -> Result<(), Error> {
    let asset = document.root.required_object("asset")?;
    let version = asset.text("version")?.unwrap_or_default();
    let (major, _) = parse_version(version)
        .ok_or_else(|| Error::malformed(format!("`asset.version` is not a version such as 2.0; {MEND}")))?;
    if major != 2 {
        return Err(Error::unsupported(format!(
            "`asset.version` is `{version}`; only glTF 2 is read: convert the file to glTF 2.0"
        )));
    }
    if let Some(least) = asset.text("minVersion")? {
        let needed = parse_version(least)
            .ok_or_else(|| Error::malformed(format!("`asset.minVersion` is not a version such as 2.0; {MEND}")))?;
        if needed > (2, 0) {
            return Err(Error::unsupported(format!(
                "`asset.minVersion` is `{least}`; glTF 2.0 is read: export the scene as glTF 2.0"
            )));
        }
    }
    for name in document.root.texts("extensionsRequired")? {
        if name == DRACO {
            return Err(draco("the file"));
        }
        if MESHOPT.contains(&name) {
            return Err(meshopt("the file", name));
        }
        if !READ.contains(&name) && !READ_FAMILIES.iter().any(|family| name.starts_with(family)) {
            return Err(Error::unsupported(format!(
                "requires the extension `{}`, which is not read; export the scene without it",
                super::cut(name)
            )));
        }
    }
    Ok(())
}

pub(super) fn draco(place: &str) -> Error {
    Error::unsupported(format!(
        "{place} holds its geometry only as `{DRACO}`, which is not read; export without Draco compression, or \
         decompress with `gltf-transform copy IN OUT`"
    ))
}

pub(super) fn meshopt(place: &str, name: &str) -> Error {
    Error::unsupported(format!(
        "{place} holds its geometry only as `{name}`, which is not read; export without meshopt compression, or \
         decompress with `gltf-transform copy IN OUT`"
    ))
}

fn parse_version(text: &str) -> Option<(u32, u32)> {
    let (major, minor) = text.split_once('.')?;
    let digits = |part: &str| {
        part.bytes()
            .all(|b| b.is_ascii_digit())
            .then(|| part.parse().ok())
            .flatten()
    };
    Some((digits(major)?, digits(minor)?))
}
