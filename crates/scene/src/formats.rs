//! Scene formats: one table of names, extensions and readers; [`load`] chooses the reader by the extension.
//!
//! A new format is a module of this folder, declared below, and a row of the table; extensions, messages, the program's
//! help and Python's come of it.
//!
//! No tobj for geometry, no gltf crate, no stl_io, because they refuse or misread files that people have; the heads of
//! the modules give the cases. tobj reads material libraries.

#[cfg(feature = "abaqus")]
pub mod abaqus;
#[cfg(feature = "ac3d")]
pub mod ac3d;
#[cfg(feature = "cityjson")]
pub mod cityjson;
#[cfg(feature = "energyplus")]
pub mod energyplus;
#[cfg(feature = "gbxml")]
pub mod gbxml;
#[cfg(feature = "gltf")]
pub mod gltf;
#[cfg(feature = "gmsh")]
pub mod gmsh;
#[cfg(feature = "obj")]
pub mod obj;
#[cfg(feature = "ply")]
pub mod ply;
#[cfg(feature = "raster")]
pub mod raster;
#[cfg(feature = "stl")]
pub mod stl;
#[cfg(feature = "vs3")]
pub mod vs3;
#[cfg(feature = "vtk")]
pub mod vtk;

use crate::{Error, ErrorKind, ReadOptions, Scene};
use std::path::Path;

type Read = fn(&[u8], Option<&Path>, ReadOptions) -> Result<Scene, Error>;

/// Makes [`Format`] and [`scene_formats!`](crate::scene_formats) of the table of formats: variant, name, extensions,
/// feature and module of the reader, and bytes of memory for each byte of a file while it is read. Measured on files of
/// 20,000 to 200,000 triangles that have little else, and rounded up; names and comments take less.
macro_rules! formats {
    ($(
        $(#[$doc:meta])*
        $format:ident, $name:literal, [$($extension:literal),+], $feature:literal, $module:ident, $memory:literal;
    )+) => {
        /// The formats and their extensions as a literal, one a line of a Markdown list, for documentation. Includes
        /// readers that are not compiled in.
        ///
        /// ```
        /// assert!(hemicube_scene::scene_formats!().starts_with("\n- Wavefront OBJ: .obj\n- glTF 2.0: .gltf .glb\n"));
        /// ```
        #[macro_export]
        macro_rules! scene_formats {
            () => {
                concat!($("\n- ", $name, ":" $(, " .", $extension)+),+)
            };
        }

        /// A scene file format.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Format {
            $($(#[$doc])* $format,)+
        }

        impl Format {
            /// All formats, in the order of lists.
            pub const ALL: &'static [Self] = &[$(Self::$format),+];

            /// The format's name.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$format => $name,)+
                }
            }

            /// The extensions of its files, in lower case, the usual one first.
            pub fn extensions(self) -> &'static [&'static str] {
                match self {
                    $(Self::$format => &[$($extension),+],)+
                }
            }

            /// Bytes of memory for each byte of a file while it is read.
            fn memory(self) -> u64 {
                match self {
                    $(Self::$format => $memory,)+
                }
            }

            /// The reader; `None` where it is not compiled in.
            fn reader(self) -> Option<Read> {
                match self {
                    $(
                        #[cfg(feature = $feature)]
                        Self::$format => Some($module::read),
                        #[cfg(not(feature = $feature))]
                        Self::$format => None,
                    )+
                }
            }
        }
    };
}

formats! {
    /// Wavefront OBJ, `.obj`.
    Obj, "Wavefront OBJ", ["obj"], "obj", obj, 6;
    /// glTF 2.0, `.gltf` or `.glb`.
    Gltf, "glTF 2.0", ["gltf", "glb"], "gltf", gltf, 7;
    /// AC3D, `.ac` or `.acc`.
    Ac3d, "AC3D", ["ac", "acc"], "ac3d", ac3d, 4;
    /// STL, `.stl`.
    Stl, "STL", ["stl"], "stl", stl, 3;
    /// PLY, `.ply`.
    Ply, "PLY", ["ply"], "ply", ply, 12;
    /// View3D, `.vs3`.
    Vs3, "View3D", ["vs3"], "vs3", vs3, 15;
    /// CityJSON, `.json` or `.cityjson`, or a sequence of features, `.jsonl`.
    CityJson, "CityJSON", ["json", "cityjson", "jsonl"], "cityjson", cityjson, 18;
    /// Gmsh, `.msh`.
    Gmsh, "Gmsh", ["msh"], "gmsh", gmsh, 6;
    /// VTK, `.vtu`, `.vtp` or `.vtk`.
    Vtk, "VTK", ["vtu", "vtp", "vtk"], "vtk", vtk, 9;
    /// Abaqus and CalculiX, `.inp`.
    Abaqus, "Abaqus, CalculiX", ["inp"], "abaqus", abaqus, 7;
    /// EnergyPlus, `.idf` or `.epJSON`.
    EnergyPlus, "EnergyPlus", ["idf", "epjson"], "energyplus", energyplus, 8;
    /// Green Building XML, `.gbxml` or `.xml`.
    GbXml, "gbXML", ["gbxml", "xml"], "gbxml", gbxml, 6;
    /// A height model, GeoTIFF `.tif` or ESRI ASCII grid `.asc`. What its cells and faces take is asked for by them.
    Raster, "Height models, GeoTIFF and ASCII grid", ["tif", "tiff", "asc"], "raster", raster, 2;
}

impl Format {
    /// The format named by a path's extension, in any case.
    pub fn from_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let has = |format: &&Self| format.extensions().contains(&extension.as_str());
        Self::ALL.iter().find(has).copied()
    }

    /// The extensions of all formats, for people: `.obj, .gltf, … and .vtk`.
    ///
    /// ```
    /// assert!(hemicube_scene::Format::listed().starts_with(".obj, .gltf, .glb, .ac"));
    /// ```
    pub fn listed() -> String {
        let all: Vec<String> = Self::ALL
            .iter()
            .flat_map(|format| format.extensions())
            .map(|extension| format!(".{extension}"))
            .collect();
        match all.split_last() {
            Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
            None => String::new(),
        }
    }
}

/// Attributes of a tag: the tree compares each with all others.
#[cfg(feature = "_xml")]
const ATTRIBUTES_MAX: usize = 1000;

/// The line of a tag with too many attributes, by the equals signs outside quotes; what is no tag is passed over.
#[cfg(feature = "_xml")]
fn crowded_tag(text: &str) -> Option<u64> {
    let mut at = 0;
    while let Some(begin) = text[at..].find('<').map(|found| at + found) {
        let rest = &text[begin..];
        let passed = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, end)) = passed.iter().find(|(start, _)| rest.starts_with(start)) {
            at = begin + rest.find(end)? + end.len();
            continue;
        }
        let (mut quote, mut equals, mut length) = (None, 0, rest.len());
        for (place, byte) in rest.bytes().enumerate() {
            match (quote, byte) {
                (Some(open), _) if open == byte => quote = None,
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => equals += 1,
                (None, b'>') => {
                    length = place + 1;
                    break;
                }
                _ => {}
            }
        }
        if equals > ATTRIBUTES_MAX {
            return Some(1 + text[..begin].matches('\n').count() as u64);
        }
        at = begin + length;
    }
    None
}

/// The tree of an XML text, without document type definitions, whose entities may stand for gigabytes.
#[cfg(feature = "_xml")]
fn parse_xml(text: &str) -> Result<roxmltree::Document<'_>, Error> {
    // The tree takes some 80 bytes a tag. `<Coordinate>0</Coordinate>`, the least of real files, has 13 bytes a tag.
    let tags = text.bytes().filter(|&byte| byte == b'<').count();
    if tags > text.len() / 10 + 100 {
        return Err(Error::malformed(format!(
            "has {tags} tags in {} bytes; it is damaged, or no data of a mesh or a building",
            text.len()
        )));
    }
    if let Some(line) = crowded_tag(text) {
        let reason = format!("a tag has more than {ATTRIBUTES_MAX} attributes; no data of a mesh or a building has");
        return Err(Error::malformed(reason).at(line));
    }
    let options = roxmltree::ParsingOptions {
        allow_dtd: false,
        nodes_limit: u32::MAX,
        ..roxmltree::ParsingOptions::default()
    };
    roxmltree::Document::parse_with_options(text, options).map_err(|error| {
        let place = error.pos();
        let reason = error.to_string();
        // The place is said once, before the reason.
        let reason = reason.rsplit_once(" at ").map_or(reason.as_str(), |(reason, _)| reason);
        let reason: String = reason.chars().filter(|&c| !crate::is_unseen(c)).take(160).collect();
        Error::malformed(format!("is no XML as it should be: {reason}")).at(u64::from(place.row))
    })
}

/// Reads the scene in `path`: a file, or a folder, all scene files of which are one scene ([`files`](crate::files)).
///
/// A folder's objects have the name of their file, `FILE`, or `FILE/OBJECT` where the file has several. Materials of
/// one name are one material.
///
/// # Errors
/// When a folder is refused ([`files`](crate::files)), or its files prescribe different axes up or units; when a file
/// cannot be read, its extension names no known format, the format's reader is not compiled in, or the reader refuses
/// it. The error names the file and, for text formats, the line.
///
/// ```
/// use hemicube_scene::{ReadOptions, load};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("wall.obj");
///
/// std::fs::write(&path, "o wall\nv 0 0 0\nv 4 0 0\nv 4 0 3\nv 0 0 3\nf 1 2 3 4\n")?;
/// let scene = load(&path, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &scene.objects[..]), (2, &["wall".to_owned()][..]));
///
/// // An error names the file, the line and the thing.
/// std::fs::write(&path, "v 0 0 0\nv 4 0 0\nf 1 2 9\n")?;
/// let error = load(&path, ReadOptions::default()).expect_err("a face with a vertex that is not there");
/// assert_eq!((error.line, error.path.as_deref()), (Some(3), Some(&*path)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn load(path: &Path, options: ReadOptions) -> Result<Scene, Error> {
    if path.is_dir() {
        return crate::folder::load(path, options);
    }
    if !path.exists() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        return Err(Error::new(ErrorKind::Io(missing)).in_file(path));
    }
    let format = Format::from_path(path).ok_or_else(|| {
        Error::unsupported(format!(
            "the extension names no scene format; {} are read",
            Format::listed()
        ))
        .in_file(path)
    })?;
    let read = format.reader().ok_or_else(|| {
        Error::unsupported(format!(
            "the {} reader is not compiled into this program",
            format.name()
        ))
        .in_file(path)
    })?;
    // What cannot be asked for its size cannot be read, and says why there.
    let length = std::fs::metadata(path).map_or(0, |file| file.len());
    options
        .budget
        .require(length.saturating_mul(format.memory()), "reading it")
        .map_err(|refused| Error::from(refused).in_file(path))?;
    let bytes = crate::read_regular(path).map_err(|e| Error::new(ErrorKind::Io(e)).in_file(path))?;
    let scene = read(&bytes, path.parent(), options);
    let scene = scene.map_err(|e| e.in_file(path))?;
    if scene.triangles.is_empty() {
        return Err(nothing_of(&scene).in_file(path));
    }
    Ok(scene)
}

/// The error of a scene without a triangle: with what its file has instead, where the reader counted that.
fn nothing_of(scene: &Scene) -> Error {
    let entries = scene.ledger.entries.iter().take(FINDINGS_SHOWN);
    let found: Vec<String> = entries.map(|(what, loss)| format!("{} × {what}", loss.count)).collect();
    if found.is_empty() {
        return Error::new(ErrorKind::Empty);
    }
    Error::unsupported(format!(
        "holds no triangle that is read, and a scene needs one; in the file: {}",
        found.join("; ")
    ))
}

/// Kinds of other things named where a file holds no triangle.
const FINDINGS_SHOWN: usize = 3;
