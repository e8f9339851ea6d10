//! Writing a store. Refusals come before the first row is computed.

use super::BalanceEntry;
use super::durable::{DurableFile, SEAL_SIZE, TEMPORARY_SUFFIX, read_exact_at, seal, sync_directory, write_whole};
use super::lock::{Lock, Mode};
use super::manifest::{FileEntry, PARTS_DIRECTORY, PATCH_COUNT_MAX, PATCHES_FILE, part_file};
use super::npy::{Element, ElementType};
use super::npz::{Elements, Npz, NpzWriter};
use super::read::{CORNERS, CUT_OFF, DRAWN_BY, PASSED, PATCH_SIZE, RUN, SHARES, THINNING};
use super::{
    Error, FactorSlice, Form, Header, Manifest, Part, PartEntry, PartThinning, Passage, PatchTable, Result, RowSums,
    RowTable, Shard, compact, validate,
};
use std::collections::BTreeMap;
use std::io::{self, Cursor, Write};
use std::path::{Path, PathBuf};

/// Columns of the patch table known before the run, in the file's order. The last two may be missing.
const GEOMETRY: [&str; 9] = [
    "face", "object", "material", "side", "area", "centroid", "normal", CORNERS, DRAWN_BY,
];

/// Elements copied at a time.
const COPY: usize = 1 << 16;

/// A store being written.
///
/// Parts may come in any order. A writer dropped without [`Self::finish`] or [`Self::interrupt`] leaves the parts
/// written, and a manifest that does not name them.
#[derive(Debug)]
pub struct StoreWriter {
    directory: PathBuf,
    manifest: Manifest,
    /// For the patch table.
    columns: RowTable,
    /// True for each input patch with a row in some part.
    written: Vec<bool>,
    /// The id of the run, in every part.
    run: [u8; 32],
    /// Effect of leaving out small form factors, by part, to be added up in order.
    thinned: BTreeMap<u32, PartThinning>,
    shard: Option<Shard>,
    locks: Vec<Lock>,
}

impl StoreWriter {
    /// Makes the directory and writes everything known before the first row.
    ///
    /// # Errors
    /// [`Error::Exists`] when a store is there and `overwrite` is not set; [`Error::InTheWay`] when something else is;
    /// [`Error::Locked`] when somebody is writing it; [`Error::Refused`] when header and table do not fit together;
    /// [`Error::Io`] or [`Error::NoSpace`] when the place cannot be written.
    pub fn create(directory: &Path, header: Header, patches: &PatchTable, overwrite: bool) -> Result<Self> {
        check_header(directory, &header, patches)?;
        let is_there = claim(directory, false)?;
        if is_there && !overwrite {
            return Err(Error::Exists {
                path: directory.to_owned(),
            });
        }
        let lock = Lock::take(directory, "", Mode::Alone)?;
        let mut writer = Self::new(directory, Manifest::new(header), None, vec![lock]);
        writer.begin(Some(patches), is_there)?;
        Ok(writer)
    }

    /// A writer that has written nothing yet.
    pub(super) fn new(directory: &Path, manifest: Manifest, shard: Option<Shard>, locks: Vec<Lock>) -> Self {
        let count = manifest.patch_count as usize;
        let columns = RowTable::unknown(count).with_passages(manifest.has_portals());
        Self {
            directory: directory.to_owned(),
            run: manifest.run_id(),
            manifest,
            columns,
            written: vec![false; count],
            thinned: BTreeMap::new(),
            shard,
            locks,
        }
    }

    /// Writes manifest and patch table; without `patches` the table is there already. A writer without other shards
    /// removes the remains of another store.
    pub(super) fn begin(&mut self, patches: Option<&PatchTable>, replaces: bool) -> Result<()> {
        let parts = self.directory.join(PARTS_DIRECTORY);
        std::fs::create_dir_all(&parts).map_err(|error| Error::io(&parts, "created", error))?;
        // The names of the parts' directory and of the store are to last, too.
        sync_directory(&self.directory).map_err(|error| Error::io(&self.directory, "made durable", error))?;
        if let Some(parent) = self.directory.parent() {
            match sync_directory(parent) {
                // A directory that may be passed through but not read: the system syncs it in its time.
                Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {}
                synced => synced.map_err(|error| Error::io(parent, "made durable", error))?,
            }
        }
        let label = self.label();
        if let Some(patches) = patches {
            // First the manifest: from here on the directory is a store, if an incomplete one, whatever happens.
            self.manifest.patches = None;
            self.manifest.write_as(&self.directory, &label)?;
            if replaces {
                remove_parts(&parts)?;
            }
            self.write_patches(patches)?;
        }
        self.manifest.write_as(&self.directory, &label)
    }

    /// Label in temporary names.
    fn label(&self) -> String {
        self.shard.map_or_else(String::new, Shard::label)
    }

    /// Returns whether other writers are kept out; on a file system without locks they are not.
    pub fn is_locked(&self) -> bool {
        self.locks.iter().all(Lock::holds)
    }

    /// The parts still to be written, of the shard if there is one.
    pub fn missing_parts(&self) -> Vec<u32> {
        let is_there = |part: &u32| {
            self.manifest
                .parts
                .binary_search_by_key(part, |entry| entry.index)
                .is_ok()
        };
        let is_ours = |part: &u32| self.shard.is_none_or(|shard| shard.has(*part));
        (0..self.manifest.part_count)
            .filter(is_ours)
            .filter(|part| !is_there(part))
            .collect()
    }

    /// The store's directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The manifest as it stands; a shard's names the shard's parts only.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Writes a part. It is on the disk when this returns. The compact form rounds its form factors ([`Form::round`]),
    /// if they are not rounded yet.
    ///
    /// # Errors
    /// [`Error::Refused`] when readers could not rely on the part: a wrong number of rows, rows or columns that do not
    /// exist or do not ascend, form factors that are no numbers (in the compact form also negative ones and those from
    /// 2 on), weights that do not sum to the hemicubes'. [`Error::NoSpace`] or [`Error::Io`] when it cannot be written:
    /// the parts before it are then intact, and it can be tried again.
    pub fn write_part(&mut self, part: &Part) -> Result<()> {
        let file = part_file(part.index);
        let path = self.directory.join(&file);
        let sums = self.inspect(part).map_err(|reason| Error::refused(&path, reason))?;
        let form = self.manifest.form;
        let (bytes, checksum) =
            encode(part, self.manifest.patch_count, form, &self.run).map_err(|error| Error::write(&path, 0, error))?;
        write_whole(&path, &bytes, &self.label())?;
        self.record(part, checksum, sums);
        Ok(())
    }

    /// Takes over the file of a part, with its checksum.
    ///
    /// # Errors
    /// The reason why no reader could rely on it.
    pub(super) fn take_over(&mut self, part: &Part, checksum: String) -> std::result::Result<(), String> {
        let sums = self.inspect(part)?;
        self.record(part, checksum, sums);
        Ok(())
    }

    /// Enters a part on the disk into manifest and patch table.
    fn record(&mut self, part: &Part, checksum: String, sums: RowSums) {
        let form = self.manifest.form;
        let entry = PartEntry {
            index: part.index,
            file: part_file(part.index),
            rows: self.manifest.rows_of_part(part.index),
            entries: part.data.len() as u64,
            blake3: checksum,
            sums,
        };
        if let Some(thinning) = part.thinning {
            self.thinned.insert(part.index, thinning);
        }
        self.manifest.entries += entry.entries;
        let place = self.manifest.parts.partition_point(|other| other.index < entry.index);
        self.manifest.parts.insert(place, entry);
        for &patch in &part.rows {
            self.written[patch as usize] = true;
        }
        self.columns.add(part, form);
    }

    /// Enters the effect of leaving out small form factors into the manifest, over the parts present.
    fn add_up_thinning(&mut self) {
        let mut all = PartThinning::default();
        self.thinned.values().for_each(|of_part| all.merge(of_part));
        self.manifest.thinning = (!self.thinned.is_empty()).then(|| all.finish(self.manifest.min_factor));
    }

    /// Writes the manifest of an incomplete store with the parts present.
    pub(super) fn note_parts(&mut self) -> Result<()> {
        self.manifest.write_as(&self.directory, &self.label())
    }

    /// Nothing is left to do: the manifest on the disk stays.
    pub(super) fn has_been_complete(&mut self, manifest: Manifest) {
        self.manifest = manifest;
    }

    /// Enters into the manifest a change made to the matrix after it was computed.
    #[doc(hidden)]
    pub fn record_balance(&mut self, entry: BalanceEntry) {
        self.manifest.balance = Some(entry);
    }

    /// Finishes a store with all parts written: the patch table gets its last columns, the manifest is complete. A
    /// shard ends with its own parts and leaves table and manifest to [`merge`](super::merge); the manifest returned
    /// names the shard's parts.
    ///
    /// # Errors
    /// [`Error::Incomplete`] when parts are missing; [`Error::NoSpace`] or [`Error::Io`].
    pub fn finish(mut self) -> Result<Manifest> {
        let missing = u32::try_from(self.missing_parts().len()).unwrap_or(u32::MAX);
        if missing > 0 {
            let present = u32::try_from(self.manifest.parts.len()).unwrap_or(u32::MAX);
            return Err(Error::Incomplete {
                path: self.directory,
                present,
                expected: present.saturating_add(missing),
            });
        }
        if self.manifest.complete {
            remove_temporaries(&self.directory)?;
            return Ok(self.manifest);
        }
        self.add_up_thinning();
        if self.shard.is_some() {
            return Ok(self.manifest);
        }
        self.complete_patches()?;
        self.manifest.complete = true;
        self.manifest.write(&self.directory)?;
        remove_temporaries(&self.directory)?;
        Ok(self.manifest)
    }

    /// Ends a run early, with a manifest that names the parts present and is not complete.
    ///
    /// # Errors
    /// [`Error::NoSpace`] or [`Error::Io`]; the parts are there all the same.
    pub fn interrupt(mut self) -> Result<Manifest> {
        if self.missing_parts().is_empty() {
            return self.finish();
        }
        self.add_up_thinning();
        if self.shard.is_none() {
            self.manifest.write(&self.directory)?;
        }
        Ok(self.manifest)
    }

    /// Checks a part for readers. Returns the sums over all rows.
    fn inspect(&self, part: &Part) -> std::result::Result<RowSums, String> {
        if part.index >= self.manifest.part_count {
            return Err(format!("it is part {} of {}", part.index, self.manifest.part_count));
        }
        if self.manifest.parts.iter().any(|other| other.index == part.index) {
            return Err("it was written before".into());
        }
        let count = self.manifest.rows_of_part(part.index) as usize;
        let total = validate::part(part, count, &self.manifest, validate::Entries::Given)
            .map_err(|reason| format!("it {reason}"))?;
        match part
            .rows
            .iter()
            .find(|&&patch| self.written.get(patch as usize) != Some(&false))
        {
            Some(&patch) => Err(format!("it {}", validate::no_row(patch))),
            None => Ok(total),
        }
    }

    fn write_patches(&mut self, patches: &PatchTable) -> Result<()> {
        let path = self.directory.join(PATCHES_FILE);
        let optional = 72 * patches.corners.len() as u64 + 4 * patches.drawn_by.len() as u64;
        let wanted = PATCH_SIZE * u64::from(self.manifest.patch_count) + optional + 4096;
        let (columns, run) = (&self.columns, self.run);
        let checksum = write_archive(&path, wanted, &self.label(), |npz| {
            let count = patches.len() as u64;
            npz.array(GEOMETRY[0], &[count], &patches.face)?;
            npz.array(GEOMETRY[1], &[count], &patches.object)?;
            npz.array(GEOMETRY[2], &[count], &patches.material)?;
            npz.array(GEOMETRY[3], &[count], &patches.side)?;
            npz.array(GEOMETRY[4], &[count], &patches.area)?;
            npz.array(GEOMETRY[5], &[count, 3], patches.centroid.as_flattened())?;
            npz.array(GEOMETRY[6], &[count, 3], patches.normal.as_flattened())?;
            if !patches.corners.is_empty() {
                npz.array(CORNERS, &[count, 3, 3], patches.corners.as_flattened().as_flattened())?;
            }
            if !patches.drawn_by.is_empty() {
                npz.array(DRAWN_BY, &[count], &patches.drawn_by)?;
            }
            columns.write(npz)?;
            npz.array(RUN, &[32], &run)
        })?;
        self.manifest.patches = Some(FileEntry {
            file: PATCHES_FILE.to_owned(),
            blake3: checksum,
        });
        Ok(())
    }

    /// Writes the patch table anew, with the rows' columns. Its geometry is read from the file: it need not stay in
    /// memory through the run.
    fn complete_patches(&mut self) -> Result<()> {
        let path = self.directory.join(PATCHES_FILE);
        let mut known = Npz::open(&path)?;
        let mut sources = Vec::with_capacity(GEOMETRY.len());
        for name in GEOMETRY {
            if !known.has(name) {
                continue;
            }
            let header = known.header(name)?.clone();
            let elements = known.elements(name)?;
            let Some(size) = header.total_size().map(|size| size - header.size) else {
                return Err(Error::malformed(&path, format!("has an array `{name}` without a size")));
            };
            sources.push((name, header, elements, size));
        }
        let file = known.into_file();
        let geometry: u64 = sources.iter().map(|(_, _, _, size)| size).sum();
        let wanted = PATCH_SIZE * u64::from(self.manifest.patch_count) + geometry + 4096;
        let (columns, run) = (&self.columns, self.run);
        // The table is read up to its last byte and closed before the new one takes its name: some systems replace no
        // open file.
        let checksum = write_archive(&path, wanted, &self.label(), move |npz| {
            let mut buffer = vec![0; COPY];
            for (name, header, elements, size) in &sources {
                npz.begin(name, header.element, &header.shape)?;
                match elements {
                    Elements::Memory(bytes) => npz.write_all(bytes)?,
                    Elements::Stored(offset) => {
                        let mut done = 0;
                        while done < *size {
                            let chunk = usize::try_from(size - done).unwrap_or(COPY).min(COPY);
                            read_exact_at(&file, &mut buffer[..chunk], offset + done)?;
                            npz.write_all(&buffer[..chunk])?;
                            done += chunk as u64;
                        }
                    }
                }
            }
            columns.write(npz)?;
            npz.array(RUN, &[32], &run)
        })?;
        self.manifest.patches = Some(FileEntry {
            file: PATCHES_FILE.to_owned(),
            blake3: checksum,
        });
        Ok(())
    }
}

impl RowTable {
    fn write<W: Write + io::Seek>(&self, npz: &mut NpzWriter<W>) -> io::Result<()> {
        let count = self.row_sum.len() as u64;
        npz.array("escaped", &[count], &self.escaped)?;
        npz.array("blocked", &[count], &self.blocked)?;
        npz.array("unselected", &[count], &self.unselected)?;
        npz.array("row_sum", &[count], &self.row_sum)?;
        npz.array("error", &[count], &self.error)?;
        npz.array("sum_error", &[count], &self.sum_error)?;
        npz.array("escaped_error", &[count], &self.escaped_error)?;
        npz.array("hemicube_escaped", &[count], &self.hemicube_escaped)?;
        npz.array("hemicube_blocked", &[count], &self.hemicube_blocked)?;
        npz.array("hemicube_unselected", &[count], &self.hemicube_unselected)?;
        if self.passed.is_empty() {
            return Ok(());
        }
        npz.array(PASSED, &[count], &self.passed)?;
        npz.array(CUT_OFF, &[count], &self.cut_off)
    }
}

/// Refuses numbers that contradict each other.
pub(super) fn check_header(directory: &Path, header: &Header, patches: &PatchTable) -> Result<()> {
    let refused = |reason: String| Err(Error::refused(directory, reason));
    if header.patch_count > PATCH_COUNT_MAX || header.row_count > header.patch_count || header.rows_per_part == 0 {
        return refused(format!(
            "{} rows of {} patches in parts of {} rows are no matrix",
            header.row_count, header.patch_count, header.rows_per_part
        ));
    }
    if !patches.is_of(header.patch_count) {
        return refused(format!("the patch table does not have {} patches", header.patch_count));
    }
    let kind = header.patch_kind();
    validate::patches(patches, header.objects.len(), header.materials.len(), kind)
        .or_else(|reason| refused(format!("the patch table {reason}")))
}

/// Makes `directory`, or checks that it is free for a store or holds one. Returns true for one that holds a store. With
/// `may_take_over`, parts without a manifest are allowed.
pub(super) fn claim(directory: &Path, may_have_parts: bool) -> Result<bool> {
    let in_the_way = |reason| Error::InTheWay {
        path: directory.to_owned(),
        reason,
    };
    match std::fs::metadata(directory) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            std::fs::create_dir_all(directory).map_err(|error| Error::io(directory, "created", error))?;
            Ok(false)
        }
        Err(error) => Err(Error::io(directory, "read", error)),
        Ok(metadata) if !metadata.is_dir() => {
            Err(in_the_way("is a file, and a store is a directory; choose another name"))
        }
        Ok(_) if Manifest::is_in(directory) => Ok(true),
        Ok(_) => {
            let entries = std::fs::read_dir(directory).map_err(|error| Error::io(directory, "read", error))?;
            for entry in entries {
                let entry = entry.map_err(|error| Error::io(directory, "read", error))?;
                // Remains of a run killed at its very start; parts carry their run themselves.
                let name = entry.file_name();
                let is_ours = |name: &str| name.ends_with(TEMPORARY_SUFFIX) || may_have_parts && is_part(name);
                let ours = name.to_string_lossy().ends_with(TEMPORARY_SUFFIX)
                    || name == PARTS_DIRECTORY
                        && std::fs::read_dir(entry.path()).is_ok_and(|parts| {
                            parts.flatten().all(|part| is_ours(&part.file_name().to_string_lossy()))
                        });
                if !ours {
                    return Err(in_the_way(
                        "is a directory that holds something, and no store; choose another name",
                    ));
                }
            }
            Ok(false)
        }
    }
}

/// Removes the parts of a store being replaced, and remains of killed runs; nothing else.
fn remove_parts(parts: &Path) -> Result<()> {
    let entries = std::fs::read_dir(parts).map_err(|error| Error::io(parts, "read", error))?;
    for entry in entries {
        let entry = entry.map_err(|error| Error::io(parts, "read", error))?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if is_part(&name) || name.ends_with(TEMPORARY_SUFFIX) {
            std::fs::remove_file(entry.path()).map_err(|error| Error::io(&entry.path(), "removed", error))?;
        }
    }
    sync_directory(parts).map_err(|error| Error::io(parts, "made durable", error))
}

fn is_part(name: &str) -> bool {
    name.starts_with("part-") && name.ends_with(".npz")
}

/// Removes remains of killed runs from a store without another writer.
pub(super) fn remove_temporaries(directory: &Path) -> Result<()> {
    let ours = super::lock::file_name("");
    for place in [directory, &directory.join(PARTS_DIRECTORY)] {
        let entries = std::fs::read_dir(place).map_err(|error| Error::io(place, "read", error))?;
        for entry in entries {
            let entry = entry.map_err(|error| Error::io(place, "read", error))?;
            let name = entry.file_name();
            if name.to_string_lossy().ends_with(TEMPORARY_SUFFIX) && name != ours.as_str() {
                match std::fs::remove_file(entry.path()) {
                    // A trial of whether the directory can be written removes its own file.
                    Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                    removed => removed.map_err(|error| Error::io(&entry.path(), "removed", error))?,
                }
            }
        }
    }
    Ok(())
}

/// Writes an archive of about `wanted` bytes to `path`, sealed, whole or not at all; its checksum.
fn write_archive(
    path: &Path,
    wanted: u64,
    label: &str,
    write: impl FnOnce(&mut NpzWriter<DurableFile>) -> io::Result<()>,
) -> Result<String> {
    let mut npz = NpzWriter::new(DurableFile::create_as(path, label)?);
    write(&mut npz)
        .and_then(|()| npz.finish_unsealed())
        .and_then(DurableFile::commit_sealed)
        .map_err(|error| Error::write(path, wanted, error))
}

/// The bytes of a part's file and their checksum. In memory, because its checksum is wanted and zip headers are written
/// last; a part is in memory anyway.
fn encode(part: &Part, patch_count: u32, form: Form, run: &[u8; 32]) -> io::Result<(Vec<u8>, String)> {
    let (rows, entries, columns) = (part.rows.len() as u64, part.data.len() as u64, u64::from(patch_count));
    let per_entry = match form {
        Form::Plain => 8,
        Form::Compact => 3,
        Form::Double => 12,
    };
    let capacity = 4096 + per_entry * part.data.len() + 88 * part.rows.len();
    let mut npz = NpzWriter::new(Cursor::new(Vec::with_capacity(capacity)));
    match form {
        Form::Plain | Form::Double => {
            npz.csr_preamble(rows, columns)?;
            match part.data.as_slice() {
                FactorSlice::Single(factors) => npz.array("data", &[entries], factors)?,
                FactorSlice::Double(factors) => npz.array("data", &[entries], factors)?,
            }
            npz.array("indices", &[entries], &part.indices)?;
        }
        Form::Compact => {
            let misfit = || io::Error::other("a form factor does not fit the compact form");
            let FactorSlice::Single(factors) = part.data.as_slice() else {
                return Err(misfit());
            };
            let codes = |scale: f32| -> Option<Vec<u16>> {
                let codes = factors.iter().map(|&factor| compact::code(factor / scale));
                codes.collect()
            };
            let (format, codes): (&[u8; 3], _) = match codes(1.0) {
                Some(codes) => (b"run", codes),
                None => (b"r15", codes(compact::RAISED).ok_or_else(misfit)?),
            };
            npz.preamble(format, rows, columns)?;
            npz.array("codes", &[entries], &codes)?;
            let runs = compact::Runs::new(&part.indptr, &part.indices);
            let count = runs.gaps.len() as u64;
            npz.array("gaps", &[count], &runs.gaps)?;
            npz.array("lengths", &[count], &runs.lengths)?;
            npz.array("runptr", &[rows + 1], &runs.runptr)?;
        }
    }
    npz.array("indptr", &[rows + 1], &part.indptr)?;
    npz.array("rows", &[rows], &part.rows)?;
    npz.begin("sums", ElementType::U64, &[rows, 4])?;
    let mut bytes = Vec::with_capacity(32 * part.sums.len());
    for sums in &part.sums {
        for weight in [sums.visible, sums.escaped, sums.blocked, sums.unselected] {
            weight.put(&mut bytes);
        }
    }
    npz.write_all(&bytes)?;
    let shares: Vec<[f64; 3]> = part.shares.iter().map(|shares| shares.to_array()).collect();
    npz.array(SHARES, &[rows, 3], shares.as_flattened())?;
    npz.array("hemicubes", &[rows], &part.hemicubes)?;
    let errors: Vec<[f32; 3]> = part.errors.iter().map(|errors| errors.to_array()).collect();
    npz.array("errors", &[rows, 3], errors.as_flattened())?;
    npz.array("rays", &[rows], &part.rays)?;
    if let Some(thinning) = &part.thinning {
        let numbers = thinning.numbers();
        npz.array(THINNING, &[numbers.len() as u64], &numbers)?;
    }
    if !part.passages.is_empty() {
        let of = |share: fn(&Passage) -> f64| part.passages.iter().map(share).collect::<Vec<f64>>();
        npz.array(PASSED, &[rows], &of(|passage| passage.passed))?;
        npz.array(CUT_OFF, &[rows], &of(|passage| passage.cut_off))?;
    }
    npz.array(RUN, &[run.len() as u64], run)?;
    let mut bytes = npz.finish_unsealed()?.into_inner();
    bytes.truncate(bytes.len().saturating_sub(usize::try_from(SEAL_SIZE).unwrap_or(0)));
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes);
    let (seal, checksum) = seal(hasher);
    bytes.extend_from_slice(seal.as_bytes());
    Ok((bytes, checksum))
}
