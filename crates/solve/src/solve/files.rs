//! Solutions on disk, beside their matrix.
//!
//! ```text
//! DIR/solutions/NAME/solution.json   what was solved, how, how far, and the balance; which matrix it is of
//! DIR/solutions/NAME/radiosity.npy   f64, one row a right-hand side, one column a patch
//! DIR/solutions/NAME/irradiance.npy  the same of what arrives; and further quantities, one file each
//! ```
//!
//! `solution.json` has the checksum of each array, and its own as the last field `blake3`, like a manifest.
//!
//! One row a right-hand side: thousands of them are written as they are solved, and `numpy.load(mmap_mode="r")` reads
//! any of them at once.

use super::Block;
use hemicube_store::{
    DurableFile, ElementType, Error, FolderLock, Manifest, NpyHeader, NpzWriter, Result, Store, decode, file_checksum,
    is_sealed_or_plain_json, read_exact_at, seal_json,
};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Folder of solutions in a store's directory.
const DIRECTORY: &str = "solutions";
/// The report, written last: with it a solution is whole.
const REPORT: &str = "solution.json";
const FORMAT: &str = "hemicube solution";
/// A report of a hundred thousand right-hand sides has 50 MB; larger ones are not ours.
const REPORT_SIZE_MAX: u64 = 1 << 28;

/// Identifies the matrix of a solution: BLAKE3 of its manifest, and by the checksums in it of every bit.
fn identity(manifest: &Manifest, path: &Path) -> Result<String> {
    let text = manifest
        .to_json()
        .map_err(|error| Error::malformed(path, format!("has a manifest that is no JSON: {error}")))?;
    Ok(blake3::hash(text.as_bytes()).to_hex().to_string())
}

fn check_name(store: &Store, name: &str) -> Result<PathBuf> {
    let sound = !name.is_empty()
        && name.len() <= 100
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.'))
        && !name.starts_with('.');
    let path = store.directory().join(DIRECTORY);
    if sound {
        Ok(path.join(name))
    } else {
        Err(Error::refused(
            &path,
            format!("`{name}` is no name for a solution: letters, digits, `-`, `_` and `.` make one"),
        ))
    }
}

/// Returns whether a quantity can be called so: a file is.
fn is_quantity(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 100
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'))
}

/// Number of right-hand sides in a report that consumers may rely on.
///
/// # Errors
/// The first contradiction, as a clause about the report.
fn check_report(report: &Value, patches: u64) -> std::result::Result<u64, String> {
    let rows = report["rows"].as_u64().filter(|&rows| rows > 0);
    let rows = rows.ok_or("has no right-hand sides; solve again")?;
    if report["patches"].as_u64() != Some(patches) {
        return Err(format!("is not of the matrix's {patches} patches"));
    }
    let strings = |key: &str| -> Option<Vec<&str>> { report[key].as_array()?.iter().map(Value::as_str).collect() };
    let quantities = strings("quantities").filter(|names| !names.is_empty());
    let mut quantities = quantities.ok_or("names no quantities")?;
    if let Some(bad) = quantities.iter().find(|name| !is_quantity(name)) {
        return Err(format!("has a quantity called `{}`", bad.escape_debug()));
    }
    quantities.sort_unstable();
    if let Some(twice) = quantities.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(format!("has the quantity `{}` twice", twice[0]));
    }
    // Solutions written by embedders need not name their bands.
    if !report["bands"].is_null() {
        let bands = strings("bands")
            .filter(|bands| !bands.is_empty())
            .ok_or("has bands without names")?;
        let of_row = report["band_of_row"].as_array().map_or(&[][..], Vec::as_slice);
        let exists = |band: &Value| band.as_u64().is_some_and(|band| band < bands.len() as u64);
        if !of_row.is_empty() && of_row.len() as u64 != rows || !of_row.iter().all(exists) {
            return Err("has right-hand sides of bands that it does not have".into());
        }
    }
    Ok(rows)
}

/// Writes a solution, right-hand side by right-hand side.
///
/// ```
/// use hemicube_solve::solve::{Block, SolutionWriter, StoredSolution};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
///
/// let radiosity = Block::from_fn(6, 1, |patch, _| 0.5 * patch as f64);
/// let mut writer = SolutionWriter::create(&store, "lamp", &["radiosity"], 1)?;
/// writer.append(0, &radiosity)?;
/// assert!(StoredSolution::names(&store).is_empty(), "nothing is there before it is whole");
/// writer.finish(&serde_json::json!({ "bands": ["grey"] }))?;
///
/// assert_eq!(StoredSolution::names(&store), ["lamp"]);
/// let solution = StoredSolution::open(&store, "lamp")?;
/// assert!(radiosity.column(0).eq(solution.quantity("radiosity")?.row(0)?));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SolutionWriter {
    directory: PathBuf,
    /// Two writers of one solution would leave arrays of both under the report of one.
    lock: FolderLock,
    identity: String,
    patches: u64,
    files: Vec<Quantity>,
    rows: u64,
    /// Right-hand sides written, by quantity.
    written: Vec<u64>,
    /// Dropped last: then the folder has no file of an unfinished solution.
    _made: Option<MadeFolder>,
}

/// The file of a quantity, under its temporary name, and the checksum of what was written to it.
struct Quantity {
    name: String,
    path: PathBuf,
    file: DurableFile,
    hasher: blake3::Hasher,
}

impl Quantity {
    fn write(&mut self, bytes: &[u8], wanted: u64) -> Result<()> {
        self.hasher.update(bytes);
        let written = self.file.write_all(bytes);
        written.map_err(|error| Error::write(&self.path, wanted, error))
    }
}

/// A folder made for a solution: it goes with the solution that is not finished, if nothing else is in it.
struct MadeFolder(PathBuf);

impl Drop for MadeFolder {
    fn drop(&mut self) {
        // What holds files stays, and nobody waits for an answer here.
        if std::fs::remove_dir(&self.0).is_ok()
            && let Some(parent) = self.0.parent()
        {
            let _ = std::fs::remove_dir(parent);
        }
    }
}

impl std::fmt::Debug for SolutionWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SolutionWriter")
            .field("directory", &self.directory)
            .field("written", &self.written)
            .finish_non_exhaustive()
    }
}

impl SolutionWriter {
    /// Begins the solution `name` of `rows` right-hand sides, with a file for each of `quantities`. It replaces one of
    /// that name once all of its files are on the disk; a solution that is never finished leaves nothing.
    ///
    /// # Errors
    /// When `name` is no name, the place cannot be written, or another process writes a solution of this name.
    pub fn create(store: &Store, name: &str, quantities: &[&str], rows: u64) -> Result<Self> {
        let directory = check_name(store, name)?;
        if rows == 0 || !quantities.iter().all(|quantity| is_quantity(quantity)) {
            return Err(Error::refused(
                &directory,
                format!("{quantities:?} of {rows} right-hand sides are no solution"),
            ));
        }
        let made = (!directory.exists()).then(|| MadeFolder(directory.clone()));
        std::fs::create_dir_all(&directory).map_err(|error| Error::io(&directory, "created", error))?;
        let lock = FolderLock::take(&directory)?;
        let patches = u64::from(store.patch_count());
        let header = NpyHeader::bytes(ElementType::F64, &[rows, patches]);
        let mut files = Vec::new();
        for quantity in quantities {
            let path = directory.join(format!("{quantity}.npy"));
            let mut file = Quantity {
                name: (*quantity).to_owned(),
                file: DurableFile::create(&path)?,
                path,
                hasher: blake3::Hasher::new(),
            };
            file.write(&header, 8 * rows * patches)?;
            files.push(file);
        }
        Ok(Self {
            identity: identity(store.manifest(), store.directory())?,
            directory,
            lock,
            patches,
            written: vec![0; files.len()],
            files,
            rows,
            _made: made,
        })
    }

    /// Writes the next right-hand sides of a quantity, by its place in `quantities`.
    ///
    /// # Errors
    /// When the block is not of the matrix's patches, or cannot be written.
    pub fn append(&mut self, quantity: usize, block: &Block) -> Result<()> {
        let file = &mut self.files[quantity];
        if block.patches() as u64 != self.patches {
            return Err(Error::refused(&file.path, "the block is of another number of patches"));
        }
        let mut bytes = Vec::with_capacity(8 * block.patches());
        for column in 0..block.columns() {
            bytes.clear();
            for value in block.column(column) {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
            file.write(&bytes, 8 * self.rows * self.patches)?;
        }
        self.written[quantity] += block.columns() as u64;
        Ok(())
    }

    /// Ends the solution by its `report`, with the matrix's identity and the quantities added. Returns its folder, and
    /// the lock that protects it: a reader who follows holds that.
    ///
    /// # Errors
    /// When right-hand sides are missing, or the files cannot be written. An earlier solution stays then, unless it is
    /// the names that cannot be given.
    pub fn finish(mut self, report: &Value) -> Result<(PathBuf, FolderLock)> {
        if self.written.iter().any(|&written| written != self.rows) {
            return Err(Error::refused(
                &self.directory,
                format!("{:?} of {} right-hand sides were given", self.written, self.rows),
            ));
        }
        let wanted = 8 * self.rows * self.patches;
        let mut quantities = Vec::new();
        let mut checksums = serde_json::Map::new();
        for quantity in &mut self.files {
            let synced = quantity.file.sync();
            synced.map_err(|error| Error::write(&quantity.path, wanted, error))?;
            checksums.insert(
                quantity.name.clone(),
                quantity.hasher.finalize().to_hex().as_str().into(),
            );
            quantities.push(quantity.name.clone());
        }
        let mut whole = json!({
            "format": FORMAT,
            "version": 1,
            "matrix": self.identity,
            "quantities": quantities,
            "rows": self.rows,
            "patches": self.patches,
            "checksums": checksums,
        });
        if let (Some(whole), Some(report)) = (whole.as_object_mut(), report.as_object()) {
            for (key, value) in report {
                whole.insert(key.clone(), value.clone());
            }
        }
        let path = self.directory.join(REPORT);
        let text = serde_json::to_string_pretty(&whole)
            .map_err(|error| Error::refused(&path, format!("its report is no JSON: {error}")))?;
        let text = seal_json(text);
        let unwritten = |error| Error::write(&path, text.len() as u64, error);
        let mut report = DurableFile::create(&path)?;
        report
            .write_all(text.as_bytes())
            .and_then(|()| report.sync())
            .map_err(unwritten)?;
        // All is on the disk, and only names are left to give. Without its report the old solution is none any more.
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(Error::io(&path, "removed", error));
            }
            _ => {}
        }
        for quantity in self.files {
            let named = quantity.file.commit();
            named.map_err(|error| Error::write(&quantity.path, wanted, error))?;
        }
        report.commit().map_err(unwritten)?;
        Ok((self.directory, self.lock))
    }
}

/// A solution open for reading.
#[derive(Debug)]
pub struct StoredSolution {
    directory: PathBuf,
    report: Value,
    patches: u64,
    rows: u64,
}

impl StoredSolution {
    /// Opens the solution `name` of a matrix.
    ///
    /// # Errors
    /// When there is none of that name (the error lists those there are), or its matrix has changed since.
    pub fn open(store: &Store, name: &str) -> Result<Self> {
        let directory = check_name(store, name)?;
        let path = directory.join(REPORT);
        let text = match hemicube_scene::read_regular_text(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let there = Self::names(store);
                let there = if there.is_empty() {
                    "there is none".to_owned()
                } else {
                    format!("there are {}", there.join(", "))
                };
                return Err(Error::malformed(
                    store.directory(),
                    format!("has no solution `{name}`; {there}"),
                ));
            }
            Err(error) => return Err(Error::io(&path, "read", error)),
        };
        if text.len() as u64 > REPORT_SIZE_MAX {
            return Err(Error::malformed(&path, "is too large for the report of a solution"));
        }
        if !is_sealed_or_plain_json(&text) {
            return Err(Error::malformed(
                &path,
                "has changed since it was written: its checksum does not fit; solve again",
            ));
        }
        let report: Value =
            serde_json::from_str(&text).map_err(|error| Error::malformed(&path, format!("is no JSON: {error}")))?;
        if report["format"] != FORMAT || report["version"] != 1 {
            return Err(Error::malformed(&path, "is no solution that this version reads"));
        }
        if report["matrix"] != Value::String(identity(store.manifest(), store.directory())?) {
            return Err(Error::malformed(
                &path,
                "is of another matrix than the one beside it: that was computed anew; solve again",
            ));
        }
        let patches = u64::from(store.patch_count());
        let rows = check_report(&report, patches).map_err(|reason| Error::malformed(&path, reason))?;
        Ok(Self {
            directory,
            report,
            patches,
            rows,
        })
    }

    /// Names of a matrix's solutions.
    pub fn names(store: &Store) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(store.directory().join(DIRECTORY)) else {
            return Vec::new();
        };
        let mut names: Vec<String> = entries
            .filter_map(std::result::Result::ok)
            .filter(|entry| entry.path().join(REPORT).is_file())
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// The content of `solution.json`.
    pub fn report(&self) -> &Value {
        &self.report
    }

    /// The quantities written.
    pub fn quantities(&self) -> Vec<&str> {
        let list = self.report["quantities"].as_array();
        list.into_iter().flatten().filter_map(Value::as_str).collect()
    }

    /// A quantity, to be read right-hand side by right-hand side.
    ///
    /// # Errors
    /// When it was not kept, or its file is damaged.
    pub fn quantity(&self, name: &str) -> Result<ArrayFile> {
        let path = self.directory.join(format!("{name}.npy"));
        if !self.quantities().contains(&name) {
            let there = self.quantities().join(", ");
            return Err(Error::malformed(
                &self.directory,
                format!("has no `{}`; there are {there}", name.escape_debug()),
            ));
        }
        // Solutions of earlier versions have no checksums.
        if let Some(expected) = self.report["checksums"][name].as_str() {
            let found = file_checksum(&path)?;
            if found != expected {
                return Err(Error::malformed(
                    &path,
                    "has changed since it was written: its checksum does not fit; solve again",
                ));
            }
        }
        let mut array = ArrayFile::open(&path)?;
        if array.columns() != self.patches || array.rows() != self.rows {
            return Err(Error::malformed(
                &path,
                format!(
                    "has {} rows and {} columns, where {} right-hand sides of {} patches belong",
                    array.rows(),
                    array.columns(),
                    self.rows,
                    self.patches
                ),
            ));
        }
        array.is_finite = true;
        Ok(array)
    }

    /// Writes all quantities into one `.npz`: an array each, one row a right-hand side.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    pub fn write_npz(&self, path: &Path) -> Result<()> {
        let mut arrays = Vec::new();
        for name in self.quantities() {
            arrays.push((name, self.quantity(name)?));
        }
        let wanted = arrays
            .iter()
            .map(|(_, array)| 8 * array.rows() * array.columns() + 256)
            .sum();
        let on_write = |error| Error::write(path, wanted, error);
        let mut npz = NpzWriter::new(DurableFile::create(path)?);
        for (name, array) in &arrays {
            npz.begin(name, ElementType::F64, &[array.rows(), array.columns()])
                .map_err(on_write)?;
            for row in 0..array.rows() {
                npz.push(&array.row(row)?).map_err(on_write)?;
            }
        }
        npz.finish().and_then(DurableFile::commit).map_err(on_write)
    }
}

/// A `.npy` file with a matrix of f32 or f64, read row by row.
#[derive(Debug)]
pub struct ArrayFile {
    path: PathBuf,
    file: File,
    element: ElementType,
    offset: u64,
    rows: u64,
    columns: u64,
    /// True if it must hold numbers alone.
    is_finite: bool,
}

impl ArrayFile {
    /// Opens the array in `path`. One of a single dimension is one row.
    ///
    /// # Errors
    /// When it cannot be read, or is no array of one or two dimensions of f32 or f64 in C order.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
        let header = NpyHeader::read(&mut file)
            .map_err(|error| Error::io(path, "read", error))?
            .map_err(|reason| Error::malformed(path, reason))?;
        let (rows, columns) = match header.shape[..] {
            [columns] => (1, columns),
            [rows, columns] => (rows, columns),
            _ => return Err(Error::unsupported(path, "has neither one nor two dimensions")),
        };
        if header.fortran_order {
            return Err(Error::unsupported(
                path,
                "is in Fortran order; save `numpy.ascontiguousarray` of it",
            ));
        }
        if !matches!(header.element, ElementType::F32 | ElementType::F64) {
            return Err(Error::unsupported(path, "is not of f4 or f8; save it as float64"));
        }
        let length = file
            .seek(SeekFrom::End(0))
            .map_err(|error| Error::io(path, "read", error))?;
        if header.total_size() != Some(length) {
            return Err(Error::malformed(path, "is shorter or longer than its shape says"));
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            element: header.element,
            offset: header.size,
            rows,
            columns,
            is_finite: false,
        })
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> u64 {
        self.columns
    }

    /// A row.
    ///
    /// # Errors
    /// When there is no such row, or it cannot be read.
    pub fn row(&self, row: u64) -> Result<Vec<f64>> {
        if row >= self.rows {
            return Err(Error::malformed(
                &self.path,
                format!("has {} rows, and row {row} was asked for", self.rows),
            ));
        }
        let size = self.columns * self.element.size();
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(usize::MAX)];
        read_exact_at(&self.file, &mut bytes, self.offset + row * size)
            .map_err(|error| Error::io(&self.path, "read", error))?;
        let values: Vec<f64> = match self.element {
            ElementType::F32 => decode::<f32>(&bytes).into_iter().map(f64::from).collect(),
            _ => decode(&bytes),
        };
        match values.iter().find(|value| !value.is_finite()) {
            Some(bad) if self.is_finite => Err(Error::malformed(
                &self.path,
                format!("has {bad} in row {row}, which is no solution; solve again"),
            )),
            _ => Ok(values),
        }
    }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_store::Store;

    #[allow(
        dead_code,
        unreachable_pub,
        clippy::cast_possible_truncation,
        reason = "a file of the documentation's examples"
    )]
    mod room {
        include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs"));
    }

    /// The store of the process whose files cannot grow.
    const STORE: &str = "HEMICUBE_TEST_SOLUTION_STORE";

    fn write(store: &Store, rows: u64, report: &Value) -> Result<()> {
        let mut writer = SolutionWriter::create(store, "lamp", &["radiosity", "irradiance"], rows).expect("it begins");
        let columns = usize::try_from(rows).expect("few");
        let block = Block::from_fn(6, columns, |patch, row| (patch * columns + row) as f64);
        for quantity in [0, 1] {
            writer.append(quantity, &block).expect("it waits to be written");
        }
        writer.finish(report).map(drop)
    }

    #[test]
    fn a_full_disk_leaves_the_earlier_solution() {
        if let Some(path) = std::env::var_os(STORE) {
            // Files cannot grow: those of the arrays in the first case, the report in the second.
            let store = Store::open(Path::new(&path)).expect("a store");
            for (rows, words) in [(4000, 0), (1, 1 << 18)] {
                let report = json!({ "note": "word ".repeat(words) });
                let refused = write(&store, rows, &report).expect_err("no room");
                assert!(matches!(refused, Error::NoSpace { .. }), "{refused}");
            }
            return;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("room.hemicube");
        let store = room::stored(&path, 0.05).expect("a store");
        write(&store, 2, &json!({ "note": "first" })).expect("there is room");
        let name = "solve::files::tests::a_full_disk_leaves_the_earlier_solution";
        let limited = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 128; exec \"$@\"", "sh"])
            .arg(std::env::current_exe().expect("this program"))
            .args(["--exact", name])
            .env(STORE, &path)
            .output()
            .expect("sh runs");
        let said = String::from_utf8_lossy(&limited.stdout);
        assert!(limited.status.success() && said.contains("1 passed"), "{said}");
        let kept = StoredSolution::open(&store, "lamp").expect("the earlier solution");
        assert_eq!(kept.report()["note"], "first");
        for quantity in ["radiosity", "irradiance"] {
            let array = kept.quantity(quantity).expect("an array");
            assert_eq!(array.row(1).expect("a row"), [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]);
        }
        let left = std::fs::read_dir(path.join("solutions/lamp"))
            .expect("a folder")
            .count();
        assert_eq!(left, 3, "no temporary file is left");
        // And with room the new one takes its place.
        write(&store, 1, &json!({ "note": "second" })).expect("there is room");
        assert_eq!(
            StoredSolution::open(&store, "lamp").expect("a solution").report()["note"],
            "second"
        );
    }
}
