//! Opens a scene file: format by extension, the reader by format.
//!
//! No tobj for geometry, no gltf crate, no stl_io, because they refuse or misread files that people have (their modules
//! say which); tobj reads material libraries.

use crate::{Error, ErrorKind, ReadOptions, Scene};
use std::path::Path;

/// A scene file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ, `.obj`.
    Obj,
    /// glTF 2.0, `.gltf` or `.glb`.
    Gltf,
    /// AC3D, `.ac` or `.acc`.
    Ac3d,
    /// STL, `.stl`.
    Stl,
    /// PLY, `.ply`.
    Ply,
    /// View3D, `.vs3`.
    Vs3,
    /// CityJSON, `.json` or `.cityjson`, or a sequence of features, `.jsonl`.
    CityJson,
}

impl Format {
    /// The format that a path's extension names, in any case.
    pub fn from_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "obj" => Some(Self::Obj),
            "gltf" | "glb" => Some(Self::Gltf),
            "ac" | "acc" => Some(Self::Ac3d),
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            "vs3" => Some(Self::Vs3),
            "json" | "cityjson" | "jsonl" => Some(Self::CityJson),
            _ => None,
        }
    }
}

/// Reads the scene in `path`.
///
/// # Errors
/// When the file cannot be read, its extension names no known format, the format's reader is not compiled in, or the
/// reader refuses it. The error names the file and, for text formats, the line.
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
    let format = Format::from_path(path).ok_or_else(|| {
        Error::unsupported("the extension names no scene format; .obj, .gltf, .glb, .ac, .acc, .stl, .ply, .vs3, .json and .jsonl (CityJSON) are read")
            .in_file(path)
    })?;
    let bytes = crate::read_regular(path).map_err(|e| Error::new(ErrorKind::Io(e)).in_file(path))?;
    let base = path.parent();
    #[cfg(not(feature = "_readers"))]
    let _ = (&bytes, base, options);
    let scene: Result<Scene, Error> = match format {
        #[cfg(feature = "obj")]
        Format::Obj => crate::obj::read(&bytes, base, options),
        #[cfg(feature = "gltf")]
        Format::Gltf => crate::gltf::read(&bytes, base, options),
        #[cfg(feature = "ac3d")]
        Format::Ac3d => crate::ac3d::read(&bytes, base, options),
        #[cfg(feature = "stl")]
        Format::Stl => crate::stl::read(&bytes, base, options),
        #[cfg(feature = "ply")]
        Format::Ply => crate::ply::read(&bytes, base, options),
        #[cfg(feature = "vs3")]
        Format::Vs3 => crate::vs3::read(&bytes, base, options),
        #[cfg(feature = "cityjson")]
        Format::CityJson => crate::cityjson::read(&bytes, base, options),
        #[allow(
            unreachable_patterns,
            unused_variables,
            reason = "reached only where a reader is not compiled in"
        )]
        other => Err(Error::unsupported(format!(
            "the {other:?} reader is not compiled into this program"
        ))),
    };
    let scene = scene.map_err(|e| e.in_file(path))?;
    if scene.triangles.is_empty() {
        return Err(Error::new(ErrorKind::Empty).in_file(path));
    }
    Ok(scene)
}
