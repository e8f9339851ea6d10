//! Outputs never overwrite inputs, and replace nothing unasked: one rule for every command, checked before any work.
//!
//! 1. No output is an input or another output, by whatever name or link.
//! 2. No output lies in the directory of a matrix that the command reads or writes.
//! 3. An existing output is replaced with `--overwrite` only. A progress file replaces one of its kind and nothing else,
//!    so that a resumed run may have the same command line.

use crate::exit::hinted;
use anyhow::{Result, anyhow};
use std::fs::Metadata;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Files that an output may replace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Replaces {
    /// Anything with `--overwrite`, and nothing without.
    Asked(bool),
    /// A progress file of this program.
    Progress,
}

/// The paths of a command.
#[derive(Debug, Default)]
pub(crate) struct Paths {
    /// Files, and directories other than matrices.
    inputs: Vec<PathBuf>,
    /// Directories of matrices to read, to write, or both.
    stores: Vec<PathBuf>,
    /// Directories of matrices to make.
    makes: Vec<PathBuf>,
    /// Files to write, with their names on the command line.
    outputs: Vec<(&'static str, PathBuf, Replaces)>,
}

impl Paths {
    pub(crate) fn reads<'a>(mut self, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.inputs.extend(inputs.into_iter().cloned());
        self
    }

    pub(crate) fn store<'a>(mut self, stores: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.stores.extend(stores.into_iter().cloned());
        self
    }

    pub(crate) fn makes<'a>(mut self, stores: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.makes.extend(stores.into_iter().cloned());
        self
    }

    pub(crate) fn writes<'a>(
        mut self,
        flag: &'static str,
        outputs: impl IntoIterator<Item = &'a PathBuf>,
        overwrite: bool,
    ) -> Self {
        let outputs = outputs.into_iter().cloned();
        self.outputs
            .extend(outputs.map(|path| (flag, path, Replaces::Asked(overwrite))));
        self
    }

    pub(crate) fn tells<'a>(mut self, flag: &'static str, outputs: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        let outputs = outputs.into_iter().cloned();
        self.outputs
            .extend(outputs.map(|path| (flag, path, Replaces::Progress)));
        self
    }
}

/// Checks the rule for a command's paths.
///
/// # Errors
/// When it would write over an input, into a matrix, one file twice, or over an existing file.
pub(crate) fn check(paths: &Paths) -> Result<()> {
    let Paths {
        inputs,
        stores,
        makes,
        outputs,
    } = paths;
    for made in makes {
        if let Some(store) = stores.iter().find(|store| Place::of(made).is_within(&Place::of(store))) {
            return Err(hinted(
                anyhow!(
                    "`-o` would write `{}`, which lies in the directory of the matrix `{}`",
                    made.display(),
                    store.display()
                ),
                "give it a name outside that",
            ));
        }
    }
    let mut seen: Vec<(&str, &Path, Place)> = Vec::new();
    for (flag, path, replaces) in outputs {
        let shown = path.display();
        let place = Place::of(path);
        let another = "give it another name";
        if inputs.iter().any(|input| Place::of(input).is(&place)) {
            return Err(hinted(
                anyhow!("`{flag}` would write `{shown}`, which is to be read"),
                another,
            ));
        }
        if let Some(store) = stores
            .iter()
            .chain(makes)
            .find(|store| place.is_within(&Place::of(store)))
        {
            return Err(hinted(
                anyhow!(
                    "`{flag}` would write `{shown}`, which lies in the directory of the matrix `{}`",
                    store.display()
                ),
                "give it a name outside that",
            ));
        }
        if let Some((other, ..)) = seen.iter().find(|(.., other)| other.is(&place)) {
            return Err(hinted(
                anyhow!("`{flag}` would write `{shown}`, and so would `{other}`"),
                another,
            ));
        }
        // Opening refuses a directory or a device.
        if place.metadata.as_ref().is_some_and(Metadata::is_file) {
            match replaces {
                Replaces::Asked(true) => {}
                Replaces::Asked(false) => {
                    return Err(hinted(
                        anyhow!("`{shown}` exists"),
                        "`--overwrite` replaces it, or choose another name",
                    ));
                }
                Replaces::Progress if is_progress(path) => {}
                Replaces::Progress => {
                    return Err(hinted(
                        anyhow!(
                            "`{shown}` exists and is no progress file of hemicube's, and `{flag}` replaces nothing else"
                        ),
                        another,
                    ));
                }
            }
        }
        seen.push((flag, path, place));
    }
    Ok(())
}

/// Returns whether a file begins like a progress file.
fn is_progress(path: &Path) -> bool {
    let mut begin = Vec::new();
    let read = hemicube_scene::open_regular(path).and_then(|file| file.take(64).read_to_end(&mut begin));
    let text: Vec<u8> = begin.into_iter().filter(|byte| !byte.is_ascii_whitespace()).collect();
    read.is_ok() && text.starts_with(b"{\"schema\":")
}

/// Target of a path.
#[derive(Debug)]
struct Place {
    /// Absolute and without links, as far as it exists.
    path: PathBuf,
    /// The target's, if it exists.
    metadata: Option<Metadata>,
}

impl Place {
    fn of(path: &Path) -> Self {
        Self {
            path: resolved(path),
            metadata: std::fs::metadata(path).ok(),
        }
    }

    /// Compares names, and files by the file system's numbers: a file may have several names.
    fn is(&self, other: &Self) -> bool {
        self.path == other.path
            || match (&self.metadata, &other.metadata) {
                (Some(ours), Some(theirs)) => is_one(ours, theirs),
                _ => false,
            }
    }

    fn is_within(&self, folder: &Self) -> bool {
        self.path.starts_with(&folder.path)
            || folder.metadata.as_ref().is_some_and(|theirs| {
                let above = self.path.ancestors().skip(1);
                above
                    .filter_map(|above| std::fs::metadata(above).ok())
                    .any(|ours| is_one(&ours, theirs))
            })
            || folder.metadata.is_some() && self.is_linked_into(&folder.path)
    }

    /// Returns whether it is another name of one of a matrix's files.
    fn is_linked_into(&self, folder: &Path) -> bool {
        #[cfg(unix)]
        if let Some(ours) = &self.metadata
            && ours.is_file()
            && std::os::unix::fs::MetadataExt::nlink(ours) > 1
        {
            let folders = [folder.to_owned(), folder.join("parts"), folder.join("sky")];
            return folders
                .iter()
                .filter_map(|folder| std::fs::read_dir(folder).ok())
                .flat_map(|entries| entries.flatten())
                .filter_map(|entry| entry.metadata().ok())
                .any(|theirs| is_one(ours, &theirs));
        }
        let _ = folder;
        false
    }
}

#[cfg(unix)]
fn is_one(one: &Metadata, other: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// The standard library gives no file numbers here; `resolved` follows links.
#[cfg(not(unix))]
fn is_one(_: &Metadata, _: &Metadata) -> bool {
    false
}

/// The path without links, as far as it exists; the rest is appended, with `..` resolved by its text.
fn resolved(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    // A dangling link is kept: writing replaces the link, not its target.
    for existing in whole.ancestors() {
        let Ok(mut resolved) = existing.canonicalize() else {
            continue;
        };
        for component in whole.strip_prefix(existing).into_iter().flat_map(Path::components) {
            match component {
                Component::ParentDir => {
                    resolved.pop();
                }
                component => resolved.push(component),
            }
        }
        return resolved;
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_resolved_as_far_as_it_exists() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().canonicalize().expect("a folder");
        std::fs::create_dir(folder.join("a")).expect("a folder");
        assert_eq!(resolved(&folder.join("a/../a/b/../c")), folder.join("a/c"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.join("a"), folder.join("l")).expect("a link");
            assert_eq!(resolved(&folder.join("l/new/file")), folder.join("a/new/file"));
            assert!(Place::of(&folder.join("l/x")).is_within(&Place::of(&folder.join("a"))));
        }
        std::fs::write(folder.join("one"), "x").expect("a file");
        std::fs::hard_link(folder.join("one"), folder.join("two")).expect("a link");
        let [one, two] = ["one", "two"].map(|name| Place::of(&folder.join(name)));
        assert_eq!(one.is(&two), cfg!(unix));
        assert!(!one.is(&Place::of(&folder.join("three"))));
        std::fs::hard_link(folder.join("one"), folder.join("a/part")).expect("a link");
        assert_eq!(two.is_within(&Place::of(&folder.join("a"))), cfg!(unix));
    }

    #[test]
    fn reports_are_known_by_how_they_begin() {
        let place = tempfile::tempdir().expect("a folder");
        let is = |text: &str| {
            let path = place.path().join("file");
            std::fs::write(&path, text).expect("a file");
            is_progress(&path)
        };
        assert!(is("{\n  \"schema\": 1,\n") && is("{\"schema\":1}"));
        assert!(!is("") && !is("{\"type\": \"CityJSON\"}") && !is("{\n  \"format\": \"hemicube\""));
    }
}
