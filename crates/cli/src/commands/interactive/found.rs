//! Scenes and matrices in a folder, to choose from.

use crate::report::{counted, percent};
use hemicube::store::{Form, Manifest, Store};
use hemicube_scene::Format;
use hemicube_scene::up::Up;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A file with a reader for its name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SceneFile {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
}

/// Bytes inspected of a JSON file.
const LOOKED_AT: u64 = 64 << 10;

/// The scenes of a folder, by name. In the current folder, `.`, names are bare.
///
/// # Errors
/// When the folder cannot be read.
pub(super) fn scenes(folder: &Path) -> std::io::Result<Vec<SceneFile>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name();
        let path = in_folder(folder, Path::new(&name));
        // Follows links; a dangling one is no scene.
        let Ok(metadata) = std::fs::metadata(&path) else {
            continue;
        };
        if metadata.is_file() && is_scene(&path) {
            found.push(SceneFile {
                path,
                bytes: metadata.len(),
            });
        }
    }
    found.sort();
    Ok(found)
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

/// Returns whether a reader takes the file. JSON and XML may be anything, and are looked into.
fn is_scene(path: &Path) -> bool {
    let begins_with = |word: &[u8]| {
        let mut begin = Vec::new();
        let read = hemicube_scene::open_regular(path).and_then(|file| file.take(LOOKED_AT).read_to_end(&mut begin));
        // Every second byte of UTF-16 is 0.
        begin.retain(|&byte| byte != 0);
        read.is_ok() && begin.windows(word.len()).any(|window| window == word)
    };
    match Format::from_path(path) {
        Some(Format::CityJson) if !has_extension(path, "cityjson") => begins_with(b"\"CityJSON"),
        Some(Format::GbXml) if !has_extension(path, "gbxml") => begins_with(b"<gbXML"),
        format => format.is_some(),
    }
}

/// A folder with a matrix in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Found {
    pub(super) path: PathBuf,
    /// The file of its scene.
    pub(super) scene: String,
    /// Hash of the scene and its subdivision.
    pub(super) scene_hash: String,
    /// A few words about it.
    pub(super) about: String,
}

impl Found {
    /// The matrix in a folder, if there is one.
    pub(super) fn at(path: &Path) -> Option<Self> {
        // Checksums of parts are for the commands: here the manifest is enough.
        let store = Store::open_trusting(path).ok()?;
        let manifest = store.manifest();
        Some(Self {
            path: path.to_owned(),
            scene: manifest.scene.file.clone(),
            scene_hash: manifest.scene.blake3.clone(),
            about: about(manifest),
        })
    }
}

/// The guess of the axis pointing up, where neither a matrix nor its scene tells. `None` also for unreadable files: the
/// command says why.
pub(super) fn guessed_up(store: &Path, scene: &Path) -> Option<Up> {
    crate::stored::guessed_up(&Store::open_trusting(store).ok()?, scene).ok()?
}

/// The matrices in the folders of a folder, by name.
///
/// # Errors
/// When the folder cannot be read.
pub(super) fn stores(folder: &Path) -> std::io::Result<Vec<Found>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name();
        found.extend(Found::at(&in_folder(folder, Path::new(&name))));
    }
    found.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(found)
}

pub(super) fn in_folder(folder: &Path, name: &Path) -> PathBuf {
    if folder == Path::new(".") {
        name.to_owned()
    } else {
        folder.join(name)
    }
}

/// Expands `~` in a path that no shell has seen.
pub(super) fn at_home(typed: &str) -> PathBuf {
    let beneath = typed
        .strip_prefix('~')
        .and_then(|rest| rest.strip_prefix(std::path::is_separator));
    match (beneath, std::env::home_dir()) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => PathBuf::from(typed),
    }
}

/// More suggestions are of no use.
#[cfg(any(feature = "menus", test))]
const SUGGESTED_MAX: usize = 100;

/// Completions of a path: files, and folders ending in `/`.
#[cfg(any(feature = "menus", test))]
pub(super) fn completions(typed: &str) -> Vec<String> {
    let end = typed.rfind(std::path::is_separator);
    let (folder, begin) = end.map_or(("", typed), |at| typed.split_at(at + 1));
    let directory = if folder.is_empty() {
        PathBuf::from(".")
    } else {
        at_home(folder)
    };
    let Ok(entries) = std::fs::read_dir(directory) else {
        return Vec::new();
    };
    let mut found: Vec<String> = entries
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            // Hidden files only on request.
            let fits = name.starts_with(begin) && (begin.starts_with('.') || !name.starts_with('.'));
            let end = if entry.path().is_dir() { "/" } else { "" };
            fits.then(|| format!("{folder}{name}{end}"))
        })
        .collect();
    found.sort();
    found.truncate(SUGGESTED_MAX);
    found
}

/// The longest common beginning of some texts.
#[cfg(any(feature = "menus", test))]
pub(super) fn common_beginning(texts: &[String]) -> Option<&str> {
    let (first, others) = texts.split_first()?;
    let mut end = first.len();
    for other in others {
        let same = first.char_indices().zip(other.chars()).find(|((_, a), b)| a != b);
        end = end.min(same.map_or(other.len(), |((at, _), _)| at));
    }
    first.get(..end)
}

/// The differences between matrices of one scene.
fn about(manifest: &Manifest) -> String {
    let settings = &manifest.settings;
    let mut words = Vec::new();
    if !manifest.complete {
        words.push(format!("{} of {} parts", manifest.parts.len(), manifest.part_count));
    }
    match settings["tolerance"].as_f64() {
        Some(tolerance) => words.push(format!("tolerance {}", percent(tolerance))),
        None => words.push(manifest.correction.clone()),
    }
    if let Some(resolution) = settings["resolution"].as_u64() {
        words.push(format!("{resolution} px"));
    }
    match settings["samples"].as_u64() {
        Some(samples) if samples > 1 => words.push(format!("{samples} hemicubes")),
        _ => {}
    }
    words.push(manifest.backend.name.clone());
    if manifest.form == Form::Compact {
        words.push("compact".to_owned());
    }
    if manifest.balance.is_some() {
        words.push("balanced".to_owned());
    }
    words.push(format!(
        "{} of {}",
        counted(manifest.patch_count.into(), "patch"),
        manifest.scene.file
    ));
    words.join(", ")
}

/// Content of the place of a new matrix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Nothing in the way.
    Free,
    /// A matrix, or the remains of a killed run.
    Matrix(Option<Found>),
    /// Something else.
    Taken,
}

impl Place {
    pub(super) fn of(path: &Path) -> Self {
        if let Some(found) = Found::at(path) {
            return Self::Matrix(Some(found));
        }
        match std::fs::read_dir(path).map(|mut entries| entries.next().is_none()) {
            Ok(true) => Self::Free,
            Ok(false) if path.join("manifest.json").exists() || path.join("parts").is_dir() => Self::Matrix(None),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Self::Free,
            _ => Self::Taken,
        }
    }
}

/// `room.hemicube` if that is free, otherwise `room-2.hemicube` and so on.
pub(super) fn free_name(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default();
    let numbered = (2_u32..).map(|number| {
        let mut name = stem.to_owned();
        name.push(format!("-{number}"));
        if let Some(extension) = path.extension() {
            name.push(".");
            name.push(extension);
        }
        path.with_file_name(name)
    });
    let mut names = std::iter::once(path.to_owned()).chain(numbered);
    names.find(|name| !name.exists()).unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place() -> tempfile::TempDir {
        tempfile::tempdir().expect("a temporary directory")
    }

    #[test]
    fn scenes_are_what_readers_take() {
        let place = place();
        let write = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
        for name in ["b.OBJ", "a.ac", "c.txt", "d.rar", "e.glb", "noextension"] {
            write(name, "1234");
        }
        write("package.json", "{\"name\": \"viewer\"}");
        write("city.json", "{\"type\":\"CityJSON\"}");
        write("pom.xml", "<project/>");
        write("house.xml", "<?xml version=\"1.0\"?>\n<gbXML lengthUnit=\"Feet\"/>");
        write("city.jsonl", "{ \"type\": \"CityJSONFeature\"}");
        std::fs::create_dir(place.path().join("folder.obj")).unwrap();
        let found = scenes(place.path()).unwrap();
        let names: Vec<_> = found
            .iter()
            .map(|scene| scene.path.file_name().unwrap().to_str().unwrap())
            .collect();
        assert_eq!(
            names,
            ["a.ac", "b.OBJ", "city.json", "city.jsonl", "e.glb", "house.xml"]
        );
        assert_eq!(found[0].bytes, 4);
        assert!(scenes(&place.path().join("missing")).is_err());
    }

    #[test]
    fn a_place_is_free_or_says_why_not() {
        let place = place();
        let path = |name: &str| place.path().join(name);
        assert_eq!(Place::of(&path("new")), Place::Free);
        std::fs::create_dir(path("empty")).unwrap();
        assert_eq!(Place::of(&path("empty")), Place::Free);
        std::fs::create_dir_all(path("killed/parts")).unwrap();
        assert_eq!(Place::of(&path("killed")), Place::Matrix(None));
        std::fs::write(path("file"), "").unwrap();
        assert_eq!(Place::of(&path("file")), Place::Taken);
        assert_eq!(Place::of(place.path()), Place::Taken);
    }

    #[test]
    fn paths_are_completed() {
        let place = place();
        let path = |name: &str| place.path().join(name).to_string_lossy().into_owned();
        for name in ["high.ac", "high_x16.ac", ".hidden"] {
            std::fs::write(path(name), "").unwrap();
        }
        std::fs::create_dir(path("houses")).unwrap();
        let found = completions(&path("h"));
        assert_eq!(found, [path("high.ac"), path("high_x16.ac"), path("houses/")]);
        assert_eq!(common_beginning(&found), Some(path("h").as_str()));
        assert_eq!(common_beginning(&found[..2]), Some(path("high").as_str()));
        assert_eq!(completions(&path(".")), [path(".hidden")]);
        assert_eq!(completions(&path("houses/")), [""; 0]);
        assert_eq!(completions(&path("missing/x")), [""; 0]);
        assert_eq!(common_beginning(&[]), None);
        assert_eq!(common_beginning(&["aé".into(), "aè".into()]), Some("a"));
        assert_eq!(common_beginning(&["ab".into(), "a".into()]), Some("a"));
    }

    #[test]
    fn names_are_counted_up() {
        let place = place();
        let path = place.path().join("a.b.hemicube");
        assert_eq!(free_name(&path), path);
        std::fs::create_dir(&path).unwrap();
        assert_eq!(free_name(&path), place.path().join("a.b-2.hemicube"));
        std::fs::create_dir(place.path().join("a.b-2.hemicube")).unwrap();
        assert_eq!(free_name(&path), place.path().join("a.b-3.hemicube"));
    }
}
