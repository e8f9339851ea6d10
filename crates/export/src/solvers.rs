//! Form factors in the files that radiation solvers read: [`export_for`].
//!
//! Each writer's head names what of its program was read. F\[i, j\] is from i to j throughout; a program in which it is
//! the other way round would get the transpose, and none of these is one.

mod calculix;
mod elmer;
mod energyplus;
mod energyplus_outside;
mod openfoam;
mod petsc;
mod udales;
pub(crate) mod view3d;

pub(crate) use calculix::Calculix;
pub(crate) use elmer::Elmer;
pub(crate) use energyplus::EnergyPlus;
pub(crate) use energyplus_outside::EnergyPlusOutside;
pub(crate) use openfoam::OpenFoam;
pub(crate) use petsc::Petsc;
pub(crate) use udales::Udales;
pub(crate) use view3d::{View3d, View3dBinary};

use crate::faces::{Faces, Found, Grouping, Needs};
use crate::write::{Cancellable, WriteOptions, on_write};
use crate::{Error, Result, SolverFormat};
use hemicube_store::Store;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Options of [`export_for`].
#[derive(Clone, Copy, Debug)]
pub struct SolverOptions<'a> {
    /// Rows; `None`: as the solver counts ([`SolverFormat::needs`]).
    pub grouping: Option<Grouping>,
    /// Names of all rows in the solver's order: numbers of faces or patches from 0, or names; `None`: the scene's
    /// order.
    pub order: Option<&'a [String]>,
    /// Name of the enclosure, for EnergyPlus.
    pub zone: Option<&'a str>,
    /// Version of the solver, where its files tell it.
    pub version: Option<&'a str>,
    /// Overwriting, and cancelling.
    pub write: WriteOptions<'a>,
}

/// A file written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Written {
    /// Its path.
    pub path: PathBuf,
    /// Its size in bytes.
    pub bytes: u64,
}

/// A finished export for a solver.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SolverReport {
    /// The solver's format.
    pub format: SolverFormat,
    /// Its files.
    pub files: Vec<Written>,
    /// Rows' kind.
    pub grouping: Grouping,
    /// Rows.
    pub rows: u64,
    /// Entries, sums and reciprocity.
    #[serde(flatten)]
    pub found: Found,
    /// The words to type, or the setting to make, in the solver.
    pub next: String,
}

/// Writer of a solver's format.
pub(crate) trait SolverWriter: Sync {
    fn needs(&self) -> Needs;

    /// The files that OUT stands for.
    fn paths(&self, faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>>;

    /// Size in bytes, if it can be told; refuses what the format cannot hold.
    fn forecast(&self, faces: &Faces<'_>, found: &Found, path: &Path) -> Result<Option<u64>>;

    /// Writes all files, which stand in the order of `paths`.
    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()>;

    /// The words to type, or the setting to make, in the solver.
    fn next(&self, faces: &Faces<'_>, found: &Found, paths: &[PathBuf]) -> String;
}

/// Work of a writer.
pub(crate) struct SolverJob<'a> {
    pub(crate) faces: &'a Faces<'a>,
    pub(crate) found: &'a Found,
    pub(crate) options: &'a SolverOptions<'a>,
    pub(crate) paths: &'a [PathBuf],
}

impl SolverJob<'_> {
    /// Writes bytes to a file.
    pub(crate) fn put(&self, files: &mut [Cancellable<'_>], file: usize, bytes: &[u8]) -> Result<()> {
        let written = files[file].write_all(bytes);
        written.map_err(|error| on_write(&self.paths[file], error))
    }
}

/// Writes the matrix of `store` for a solver to `path`. All files are written before the first has its name.
///
/// # Errors
/// [`Error::Unfit`] when the matrix lacks what the solver needs, with the next step;
/// [`Error::TooLarge`] when the format cannot hold it; otherwise as [`crate::export`].
///
/// ```
/// use hemicube_export::{SolverFormat, SolverOptions, WriteOptions, export_for};
/// use std::sync::atomic::AtomicBool;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.0)?;
/// # let path = folder.path().join("ViewFactors.dat");
///
/// let write = WriteOptions { overwrite: false, cancel: &AtomicBool::new(false) };
/// let options = SolverOptions { grouping: None, order: None, zone: None, version: None, write };
/// let report = export_for(&store, &path, SolverFormat::Elmer, &options)?;
/// let text = std::fs::read_to_string(&path)?;
/// assert_eq!(text.lines().count() as u64, report.rows + report.found.entries);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn export_for(
    store: &Store,
    path: &Path,
    format: SolverFormat,
    options: &SolverOptions<'_>,
) -> Result<SolverReport> {
    let writer = format.writer()?;
    let needs = writer.needs();
    let grouping = options.grouping.unwrap_or(needs.grouping);
    let faces = Faces::new(store, format.program(), grouping, options.order, options.write.cancel)?;
    if let Some(version) = options.version.filter(|version| !is_version(version)) {
        let reason = format!("`{version}` is no version");
        return Err(faces.unfit(reason, "a version is numbers with points between them, as `22.1`"));
    }
    let paths = writer.paths(&faces, path)?;
    // Created first: an unwritable place is the better thing to be told than a matrix that does not fit.
    let mut files: Vec<Cancellable<'_>> = Vec::with_capacity(paths.len());
    for path in &paths {
        files.push(Cancellable::create(path, options.write)?);
    }
    let found = faces.check(needs)?;
    if let Some(bytes) = writer.forecast(&faces, &found, path)? {
        faces.require_room(&paths[0], bytes)?;
    }
    let job = SolverJob {
        faces: &faces,
        found: &found,
        options,
        paths: &paths,
    };
    let result = writer.write(&job, &mut files);
    // A cancelled file refuses bytes, which is no error of the disk.
    if options.write.cancel.load(Ordering::Relaxed) {
        let path = path.to_owned();
        return Err(Error::Interrupted { path });
    }
    result?;
    let mut written = Vec::with_capacity(paths.len());
    for (file, path) in files.into_iter().zip(&paths) {
        let bytes = Cancellable::commit(Ok(file), path, options.write, |error| on_write(path, error))?;
        written.push(Written {
            path: path.clone(),
            bytes,
        });
    }
    Ok(SolverReport {
        format,
        next: writer.next(&faces, &found, &paths),
        files: written,
        grouping,
        rows: faces.len() as u64,
        found,
    })
}

/// Returns whether a text may be a version: `22.1`, `2.8p2`.
fn is_version(text: &str) -> bool {
    let is_part =
        |part: &str| part.starts_with(|c: char| c.is_ascii_digit()) && part.bytes().all(|b| b.is_ascii_alphanumeric());
    text.len() < 40 && text.split('.').all(is_part)
}

#[cfg(test)]
mod tests {
    use super::is_version;

    #[test]
    fn versions_begin_with_numbers() {
        for version in ["2", "2.21", "22.1.0", "2.8p2"] {
            assert!(is_version(version), "{version}");
        }
        for other in ["", "abc", "2.", ".2", "2.21; x", "2..1", "-2", &"1.".repeat(40)] {
            assert!(!is_version(other), "{other}");
        }
    }
}
