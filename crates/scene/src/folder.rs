//! A folder as one scene: the scene files in it, in the order of their names. CAD programs write one STL a part, cities
//! come in tiles.
//!
//! Subfolders, hidden files and files of other extensions (`.mtl`, `.bin`, pictures) are passed over. A height model is
//! read as the ground or the roofs of the others; a `.tif` without a place, of eight bits or of more bands is a picture.

use crate::{Error, ErrorKind, Format, Material, ReadOptions, Scene};
use std::collections::HashMap;
use std::fmt::Debug;
use std::path::{Path, PathBuf};

/// Lists the files that a scene at `path` is read from: `path` itself, or the scene files of a folder by name.
///
/// # Errors
/// When a folder cannot be read, is a matrix, has no scene file, or has two of one name that differ in the extension:
/// one model in two formats would be there twice.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let folder = folder.path();
/// for name in ["pipe.stl", "case.obj", "case.mtl"] {
///     std::fs::write(folder.join(name), "")?;
/// }
/// assert_eq!(hemicube_scene::files(folder)?, [folder.join("case.obj"), folder.join("pipe.stl")]);
/// assert_eq!(hemicube_scene::files(&folder.join("pipe.stl"))?, [folder.join("pipe.stl")]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn files(path: &Path) -> Result<Vec<PathBuf>, Error> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    if path.join("manifest.json").exists() && path.join("parts").is_dir() {
        return Err(Error::unsupported("is a matrix, and a scene is needed").in_file(path));
    }
    let cannot = |error| Error::new(ErrorKind::Io(error)).in_file(path);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(cannot)? {
        let file = entry.map_err(cannot)?.path();
        let is_hidden = file
            .file_name()
            .is_none_or(|name| name.as_encoded_bytes().starts_with(b"."));
        let is_scene = || match Format::from_path(&file) {
            #[cfg(feature = "raster")]
            Some(Format::Raster) => crate::formats::raster::is_height_model(&file),
            format => format.is_some(),
        };
        if !is_hidden && file.is_file() && is_scene() {
            files.push(file);
        }
    }
    files.sort();
    if files.is_empty() {
        let reason = format!("is a folder without a scene file; {} are read", Format::listed());
        return Err(Error::unsupported(reason).in_file(path));
    }
    let mut by_stem = HashMap::new();
    for file in &files {
        if let Some(other) = by_stem.insert(file.file_stem(), file) {
            return Err(Error::unsupported(format!(
                "has `{}` and `{}`, one model in two formats; move one of them out of the folder",
                name_of(other),
                name_of(file)
            ))
            .in_file(path));
        }
    }
    Ok(files)
}

/// Reads the files of a folder as one scene.
///
/// A file's only object has the name of the file without its extension, the objects of a file with several
/// `FILE/OBJECT`. Materials of one name are one material, with the first file's values.
pub(crate) fn load(folder: &Path, options: ReadOptions) -> Result<Scene, Error> {
    let mut whole = Whole::default();
    for file in files(folder)? {
        whole.push(&file, crate::load(&file, options)?)?;
    }
    Ok(whole.finish())
}

/// Bound of a folder's warnings: cities come in hundreds of tiles.
const MOST_WARNINGS: usize = 8;

/// A scene while files are added to it.
#[derive(Default)]
struct Whole {
    scene: Scene,
    materials: HashMap<String, u32>,
    /// The next file's first face.
    faces: u32,
    /// The files that prescribe the axis up, the unit, and the coordinate reference system.
    of_up: String,
    of_unit: String,
    of_crs: String,
    /// Number of warnings beyond [`MOST_WARNINGS`].
    more_warnings: u64,
}

impl Whole {
    fn push(&mut self, file: &Path, mut scene: Scene) -> Result<(), Error> {
        let too_large = || Error::new(ErrorKind::TooLarge(TOO_LARGE.to_owned())).in_file(file);
        let name = name_of(file);
        let whole = &mut self.scene;
        agree(&mut whole.up, &mut self.of_up, scene.up, "the axis up", file)?;
        let unit = scene.metres_per_unit;
        agree(
            &mut whole.metres_per_unit,
            &mut self.of_unit,
            unit,
            "metres a unit",
            file,
        )?;

        let first_object = u32::try_from(whole.objects.len()).map_err(|_| too_large())?;
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        if let [only] = &mut scene.objects[..] {
            *only = stem.into_owned();
        } else {
            for object in &mut scene.objects {
                *object = format!("{stem}/{object}");
            }
        }
        whole.objects.append(&mut scene.objects);

        let mut numbers = Vec::with_capacity(scene.materials.len());
        for material in scene.materials {
            numbers.push(self.number(material, &name).ok_or_else(too_large)?);
        }
        let whole = &mut self.scene;
        let (first_face, mut last_face) = (self.faces, None);
        for triangle in &mut scene.triangles {
            triangle.object = first_object.checked_add(triangle.object).ok_or_else(too_large)?;
            triangle.material = numbers.get(triangle.material as usize).copied().unwrap_or(0);
            triangle.face = first_face.checked_add(triangle.face).ok_or_else(too_large)?;
            last_face = last_face.max(Some(triangle.face));
        }
        if let Some(last) = last_face {
            self.faces = last.checked_add(1).ok_or_else(too_large)?;
        }
        whole.triangles.append(&mut scene.triangles);

        for (object, names) in std::mem::take(&mut scene.further_names) {
            whole.further_names.insert(first_object.saturating_add(object), names);
        }
        agree(
            &mut whole.crs,
            &mut self.of_crs,
            scene.crs.take(),
            "the coordinate reference system",
            file,
        )?;
        let warnings = std::mem::take(&mut scene.ledger.warnings);
        whole.ledger.append(scene.ledger, &name);
        for warning in warnings {
            self.warn(format!("`{name}`: {warning}"));
        }
        Ok(())
    }

    fn warn(&mut self, warning: String) {
        if self.scene.ledger.warnings.len() < MOST_WARNINGS {
            self.scene.ledger.warnings.push(warning);
        } else {
            self.more_warnings += 1;
        }
    }

    fn finish(mut self) -> Scene {
        let ledger = &mut self.scene.ledger;
        ledger.note_many("warning of a file, after the first ones", self.more_warnings);
        self.scene
    }

    /// The number of a material in the whole; `None` where there are more than can be numbered.
    fn number(&mut self, material: Material, file: &str) -> Option<u32> {
        if let Some(&number) = self.materials.get(&material.name) {
            if self.scene.materials[number as usize] != material {
                self.warn(format!(
                    "`{file}`: material `{}` has other values than in a file before, and the first ones hold",
                    material.name
                ));
            }
            return Some(number);
        }
        let number = u32::try_from(self.scene.materials.len()).ok()?;
        self.materials.insert(material.name.clone(), number);
        self.scene.materials.push(material);
        Some(number)
    }
}

const TOO_LARGE: &str = "has more objects, materials or faces, with the files before it, than can be numbered";

/// Takes what a file prescribes over, unless a file before prescribes another value.
fn agree<T: Clone + PartialEq + Debug>(
    whole: &mut Option<T>,
    by: &mut String,
    found: Option<T>,
    what: &str,
    file: &Path,
) -> Result<(), Error> {
    match (whole.clone(), found) {
        (_, None) => {}
        (None, Some(found)) => {
            *whole = Some(found);
            *by = name_of(file);
        }
        (Some(before), Some(now)) if before == now => {}
        (Some(before), Some(now)) => {
            return Err(Error::unsupported(format!(
                "prescribes {what} {now:?}, and `{by}` in the same folder {before:?}; export both alike"
            ))
            .in_file(file));
        }
    }
    Ok(())
}

fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(all(test, feature = "obj", feature = "stl", feature = "gltf"))]
mod tests {
    use super::*;
    use crate::Axis;

    const WALL: &str = "o wall\nv 0 0 0\nv 4 0 0\nv 4 0 3\nv 0 0 3\nf 1 2 3 4\n";
    const PART: &str = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 9\nvertex 1 0 9\nvertex 0 1 9\nendloop\n\
                        endfacet\nendsolid x\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        folder
    }

    fn read(files: &[(&str, &str)]) -> Result<Scene, Error> {
        crate::load(folder(files).path(), ReadOptions::default())
    }

    #[test]
    fn files_of_a_folder_are_one_scene() {
        let rooms = format!("{WALL}usemtl brick\no floor\nf 1 2 3\nusemtl wood\nf 1 3 4\n");
        let files = [
            ("c.stl", PART),
            ("a.obj", &*rooms),
            ("b.OBJ", "usemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
            (".hidden.obj", "f 7"),
            ("notes.txt", "none"),
        ];
        let scene = read(&files).unwrap();
        assert_eq!(scene.objects, ["a/wall", "a/floor", "b", "c"]);
        let materials: Vec<_> = scene.materials.iter().map(|material| &*material.name).collect();
        assert_eq!(materials, ["", "brick", "wood"]);
        let found: Vec<_> = scene.triangles.iter().map(|t| (t.object, t.material, t.face)).collect();
        assert_eq!(
            found,
            [(0, 0, 0), (0, 0, 0), (1, 1, 1), (1, 2, 2), (2, 2, 3), (3, 0, 4)]
        );
    }

    #[test]
    fn one_model_in_two_formats_is_refused() {
        let error = read(&[("a.obj", WALL), ("a.stl", PART)]).unwrap_err().to_string();
        assert!(
            error.ends_with("has `a.obj` and `a.stl`, one model in two formats; move one of them out of the folder"),
            "{error}"
        );
    }

    #[test]
    fn a_folder_without_a_scene_and_a_matrix_are_refused() {
        let error = read(&[("a.txt", "")]).unwrap_err().to_string();
        assert!(error.contains("is a folder without a scene file; .obj"), "{error}");
        let matrix = folder(&[("manifest.json", "{}")]);
        std::fs::create_dir(matrix.path().join("parts")).unwrap();
        let error = crate::load(matrix.path(), ReadOptions::default()).unwrap_err();
        assert!(
            error.to_string().ends_with("is a matrix, and a scene is needed"),
            "{error}"
        );
    }

    #[test]
    fn a_file_that_is_refused_is_named() {
        let error = read(&[("a.obj", WALL), ("b.obj", "v 0 0 0\nf 1 2 3\n")]).unwrap_err();
        assert_eq!(error.line, Some(2));
        assert!(error.path.is_some_and(|path| path.ends_with("b.obj")));
    }

    #[test]
    fn files_must_agree_on_the_axis_up() {
        let mut whole = Whole::default();
        let scene = |up| Scene { up, ..Scene::default() };
        whole.push(Path::new("a.glb"), scene(Some(Axis::Y))).unwrap();
        whole.push(Path::new("b.obj"), scene(None)).unwrap();
        whole.push(Path::new("c.glb"), scene(Some(Axis::Y))).unwrap();
        assert_eq!(whole.scene.up, Some(Axis::Y));
        let error = whole.push(Path::new("d.json"), scene(Some(Axis::Z))).unwrap_err();
        assert_eq!(
            error.to_string(),
            "d.json: prescribes the axis up Z, and `a.glb` in the same folder Y; export both alike"
        );
    }

    #[test]
    fn materials_of_one_name_keep_the_first_values() {
        let mut whole = Whole::default();
        let scene = |diffuse| Scene {
            materials: vec![Material {
                name: "m".to_owned(),
                diffuse: Some([diffuse; 3]),
                ..Material::default()
            }],
            ..Scene::default()
        };
        whole.push(Path::new("a.obj"), scene(0.5)).unwrap();
        whole.push(Path::new("b.obj"), scene(0.5)).unwrap();
        assert!(whole.scene.ledger.warnings.is_empty());
        whole.push(Path::new("c.obj"), scene(0.25)).unwrap();
        assert_eq!(whole.scene.materials, scene(0.5).materials);
        assert_eq!(
            whole.scene.ledger.warnings,
            ["`c.obj`: material `m` has other values than in a file before, and the first ones hold"]
        );
        // Say the first warnings of many files, and count the others.
        for _ in 0..99 {
            whole.push(Path::new("d.obj"), scene(0.25)).unwrap();
        }
        let ledger = whole.finish().ledger;
        assert_eq!(ledger.warnings.len(), MOST_WARNINGS);
        assert_eq!(ledger.get("warning of a file, after the first ones"), 92);
    }
}
