//! Resuming a store, and merging one from shards.
//!
//! A part's file tells whether it is whole (its last bytes are the checksum of those before) and its run (`run`).
//! Resuming therefore does not need the manifest that a killed run could not write. Every part is read and checked
//! against both before it is kept; the others are computed again.
//!
//! No journal beside the parts, because a sealed part tells all that a journal could, cannot disagree with it, and may
//! be copied from another machine. Reading every part takes a fraction of a per cent of computing it.

use super::durable::{DurableFile, TEMPORARY_SUFFIX, sealed_checksum};
use super::lock::{Lock, Mode};
use super::manifest::{FileEntry, MANIFEST_FILE, PARTS_DIRECTORY, PATCHES_FILE, part_file};
use super::npz::Npz;
use super::read::{RUN, open_part, read_part, read_patches, require_backed};
use super::write::{check_header, claim, remove_temporaries};
use super::{Error, Header, Manifest, Part, PatchTable, Result, Shard, StoreWriter};
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// A file at the place of a part that is not resumed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotKept {
    /// Index of the part.
    pub part: u32,
    /// Why, with the file's name.
    pub reason: String,
}

/// Parts of a store that is resumed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resumed {
    /// True if a store was there at all.
    pub was_there: bool,
    /// True if it was complete and has not changed: there is nothing to do.
    pub is_complete: bool,
    /// Number of parts resumed.
    pub parts: u32,
    /// Their rows.
    pub rows: u64,
    /// Parts that are computed again, with the reasons.
    pub not_kept: Vec<NotKept>,
}

/// A part that is there, whole, and of the run.
struct WholePart {
    part: Part,
    checksum: String,
}

/// Looks at the file of a part: `None` when there is none, the reason when it is not to be relied on.
///
/// # Errors
/// When the system cannot read it; that is no defect of the part.
fn look(
    directory: &Path,
    manifest: &Manifest,
    run: &[u8; 32],
    index: u32,
) -> Result<Option<std::result::Result<WholePart, String>>> {
    let file = part_file(index);
    let path = directory.join(&file);
    let shown = path.display();
    let checksum = match sealed_checksum(&path) {
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
        Ok(Some(checksum)) => checksum,
        Ok(None) => {
            return Ok(Some(Err(format!(
                "`{shown}` is truncated or has changed since it was written"
            ))));
        }
        Err(error) => return Err(error),
    };
    let found = || -> Result<std::result::Result<WholePart, String>> {
        let (mut npz, csr) = open_part(&path, manifest, index)?;
        if npz.array::<u8>(RUN)? != run {
            return Ok(Err(format!(
                "`{shown}` is of another run: another scene, other settings or another version"
            )));
        }
        let part = read_part(&path, &mut npz, &csr, manifest, index)?;
        Ok(Ok(WholePart { part, checksum }))
    };
    match found() {
        Ok(found) => Ok(Some(found)),
        Err(error @ Error::Io { .. }) => Err(error),
        // Whole as written, and no part of this matrix.
        Err(error) => Ok(Some(Err(error.to_string()))),
    }
}

/// Looks at many parts on several threads and hands them on in order; in memory are no more than the threads hold.
fn look_at_all(
    directory: &Path,
    manifest: &Manifest,
    run: &[u8; 32],
    parts: &[u32],
    threads: usize,
    each: &mut dyn FnMut(u32, std::result::Result<WholePart, String>) -> Result<()>,
) -> Result<()> {
    for some in parts.chunks(threads.max(1)) {
        let found: Vec<_> = std::thread::scope(|scope| {
            let looking: Vec<_> = some
                .iter()
                .map(|&index| scope.spawn(move || look(directory, manifest, run, index)))
                .collect();
            looking.into_iter().map(std::thread::ScopedJoinHandle::join).collect()
        });
        for (&index, found) in some.iter().zip(found) {
            let found = found.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            if let Some(found) = found {
                each(index, found)?;
            }
        }
    }
    Ok(())
}

/// The checksum of the patch table, if it is whole and of the run.
fn patches_of(directory: &Path, run: &[u8; 32]) -> Result<Option<FileEntry>> {
    let path = directory.join(PATCHES_FILE);
    let checksum = match sealed_checksum(&path) {
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
        checksum => checksum?,
    };
    let is_of_run = || {
        Npz::open(&path)
            .and_then(|mut npz| npz.array::<u8>(RUN))
            .is_ok_and(|of| of == run)
    };
    Ok(checksum.filter(|_| is_of_run()).map(|blake3| FileEntry {
        file: PATCHES_FILE.to_owned(),
        blake3,
    }))
}

/// Leaves an empty file with the number of shards, for a merge.
fn mark_shards(directory: &Path, shard: Shard) -> Result<()> {
    let path = directory.join(format!("{SHARDS_MARK}{}{TEMPORARY_SUFFIX}", shard.count()));
    match File::create_new(&path) {
        // Another shard's, or whatever has the name: it is not opened.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        created => created.map(|_| ()).map_err(|error| Error::io(&path, "created", error)),
    }
}

const SHARDS_MARK: &str = ".shards-";

/// The number of shards that worked in these directories, if all marks agree.
fn shard_count(directories: &[&Path]) -> Option<u32> {
    let mut counts = BTreeSet::new();
    for directory in directories {
        for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let count = name
                .to_string_lossy()
                .strip_prefix(SHARDS_MARK)
                .and_then(|rest| rest.strip_suffix(TEMPORARY_SUFFIX)?.parse::<u32>().ok());
            counts.extend(count);
        }
    }
    (counts.len() == 1).then(|| counts.first().copied()).flatten()
}

impl StoreWriter {
    /// Makes a store, or resumes the one in `directory`: its whole parts are kept and handed to `each` in order, and
    /// [`Self::missing_parts`] are left to do. A `shard` reads its own parts only, and other shards may work in the
    /// same directory meanwhile.
    ///
    /// The result equals, to the bit, a store written without interruption.
    ///
    /// # Errors
    /// [`Error::OtherRun`] when the store is of another scene, other settings or another version; otherwise those of
    /// [`Self::create`].
    pub fn resume(
        directory: &Path,
        header: Header,
        patches: &PatchTable,
        shard: Option<Shard>,
        threads: usize,
        each: &mut dyn FnMut(&Part),
    ) -> Result<(Self, Resumed)> {
        check_header(directory, &header, patches)?;
        claim(directory, true)?;
        let mut locks = vec![Lock::take(
            directory,
            "",
            if shard.is_some() { Mode::Shared } else { Mode::Alone },
        )?];
        let mut begin_lock = None;
        if let Some(shard) = shard {
            locks.push(Lock::take(directory, &shard.label(), Mode::Alone)?);
            // Shards that start together make the store one after the other: the second finds it made.
            begin_lock = Some(Lock::take(directory, "-begin", Mode::Waiting)?);
            mark_shards(directory, shard)?;
        } else {
            remove_temporaries(directory).or_else(|error| is_missing(&error).then_some(()).ok_or(error))?;
        }

        let mut ours = Manifest::new(header);
        let is_there = Manifest::is_in(directory);
        let mut resumed = Resumed {
            was_there: is_there,
            ..Resumed::default()
        };
        let mut before = None;
        if is_there {
            match Manifest::read(directory) {
                Ok(theirs) => {
                    if let Some(difference) = theirs.difference(&ours) {
                        return Err(Error::OtherRun {
                            path: directory.to_owned(),
                            difference,
                        });
                    }
                    // An equal scene under another name: the store keeps its first name.
                    ours.scene.file.clone_from(&theirs.scene.file);
                    before = Some(theirs);
                }
                // A damaged manifest: the parts tell their run.
                Err(error @ Error::Malformed { .. }) => refuse_foreign_parts(directory, &ours, error)?,
                Err(error) => return Err(error),
            }
        }
        let run = ours.run_id();
        if !is_there {
            refuse_what_is_no_part(directory)?;
        }
        ours.patches = patches_of(directory, &run)?;
        let has_table = ours.patches.is_some();
        let mut writer = Self::new(directory, ours, shard, locks);
        let is_begun = has_table
            && before.as_ref().is_some_and(|theirs| theirs.patches.is_some())
            && directory.join(PARTS_DIRECTORY).is_dir();
        if !is_begun {
            writer.begin((!has_table).then_some(patches), false)?;
        }
        drop(begin_lock);

        let manifest = writer.manifest().clone();
        let parts = writer.missing_parts();
        look_at_all(directory, &manifest, &run, &parts, threads, &mut |index, found| {
            let reason = match found {
                Ok(found) => match writer.take_over(&found.part, found.checksum) {
                    Ok(()) => {
                        each(&found.part);
                        return Ok(());
                    }
                    Err(reason) => format!("`{}`: {reason}", directory.join(part_file(index)).display()),
                },
                Err(reason) => reason,
            };
            resumed.not_kept.push(NotKept { part: index, reason });
            Ok(())
        })?;
        resumed.parts = u32::try_from(writer.manifest().parts.len()).unwrap_or(u32::MAX);
        resumed.rows = writer.manifest().rows_present();
        let complete = before.filter(|theirs| theirs.complete);
        match complete {
            Some(theirs) if theirs.parts == writer.manifest().parts && theirs.patches == writer.manifest().patches => {
                resumed.is_complete = true;
                writer.has_been_complete(theirs);
            }
            // Something of a complete store is damaged; until it is repaired, the store is not complete.
            Some(_) if shard.is_none() => writer.note_parts()?,
            _ => {}
        }
        Ok((writer, resumed))
    }
}

/// Refuses to replace an unreadable manifest where a part contradicts the new one.
fn refuse_foreign_parts(directory: &Path, ours: &Manifest, error: Error) -> Result<()> {
    let run = ours.run_id();
    let entries = std::fs::read_dir(directory.join(PARTS_DIRECTORY))
        .into_iter()
        .flatten()
        .flatten();
    for entry in entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(".npz")) {
        let of = Npz::open(&entry.path()).and_then(|mut npz| npz.array::<u8>(RUN));
        if of.is_ok_and(|of| of != run) {
            return Err(error);
        }
    }
    Ok(())
}

/// Refuses, without a manifest, files with a part's name that are no parts: they are somebody else's and would be
/// replaced.
fn refuse_what_is_no_part(directory: &Path) -> Result<()> {
    let entries = std::fs::read_dir(directory.join(PARTS_DIRECTORY))
        .into_iter()
        .flatten()
        .flatten();
    for entry in entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(".npz")) {
        let path = entry.path();
        if Npz::open(&path).and_then(|mut npz| npz.array::<u8>(RUN)).is_err() {
            return Err(Error::InTheWay {
                path,
                reason: "is no part of a matrix, and there is no manifest beside it; remove it, or choose another \
                         directory",
            });
        }
    }
    Ok(())
}

fn is_missing(error: &Error) -> bool {
    matches!(error, Error::Io { source, .. } if source.kind() == io::ErrorKind::NotFound)
}

/// Result of a merge.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The manifest of the whole; not complete when parts are missing.
    pub manifest: Manifest,
    /// Number of parts copied from other directories.
    pub copied: u32,
    /// Parts that are missing, or nowhere whole.
    pub missing: Vec<u32>,
    /// Files at the places of parts that were passed over.
    pub not_kept: Vec<NotKept>,
    /// Number of shards that computed here, where it is known.
    pub shard_count: Option<u32>,
}

impl Merged {
    /// The shards with missing parts, from 1; empty where the number of shards is not known.
    pub fn missing_shards(&self) -> Vec<u32> {
        let Some(count) = self.shard_count else {
            return Vec::new();
        };
        let shards: BTreeSet<u32> = self.missing.iter().map(|part| part % count + 1).collect();
        shards.into_iter().collect()
    }
}

/// Merges the parts computed by shards in `directory` and, if they worked elsewhere, in `sources`, whose parts are
/// copied. Checks that the directories are of one run, and every part as when resuming. With nothing missing the store
/// is complete, equal to the bit to that of one process. Otherwise only the copied parts have changed, and the merge
/// may be tried again.
///
/// # Errors
/// [`Error::OtherRun`] when a directory is of another run; [`Error::Refused`] when two of them have one part in two
/// versions; [`Error::Locked`] while somebody is writing; [`Error::Malformed`] when a directory is no store.
///
/// Two processes with nothing in common but a directory; here one after the other:
///
/// ```
/// use hemicube_store::{Shard, StoreWriter, merge};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let (directory, whole) = (folder.path().join("room"), folder.path().join("whole"));
/// # let whole = room::stored(&whole, 0.05)?;
/// # let (header, table, parts) = (room::header(), room::table(), room::parts(0.05));
///
/// for shard in ["1/2", "2/2"] {
///     let shard: Shard = shard.parse()?;
///     let (mut writer, _resumed) =
///         StoreWriter::resume(&directory, header.clone(), &table, Some(shard), 0, &mut |_| ())?;
///     let missing = writer.missing_parts();
///     assert!(!missing.is_empty() && missing.len() < parts.len(), "a shard has some of the parts");
///     for part in parts.iter().filter(|part| missing.contains(&part.index)) {
///         writer.write_part(part)?;
///     }
///     writer.finish()?;
/// }
/// let merged = merge(&directory, &[], 0)?;
/// assert!(merged.missing.is_empty() && merged.manifest.complete);
/// assert_eq!(&merged.manifest, whole.manifest(), "the same to the bit as by one process");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn merge(directory: &Path, sources: &[PathBuf], threads: usize) -> Result<Merged> {
    let home = if Manifest::is_in(directory) {
        directory
    } else {
        sources.first().map_or(directory, PathBuf::as_path)
    };
    let theirs = Manifest::read(home)?;
    claim(directory, true)?;
    let locks = vec![Lock::take(directory, "", Mode::Alone)?];
    for source in sources {
        let other = Manifest::read(source)?;
        if let Some(difference) = other.difference(&theirs) {
            return Err(Error::OtherRun {
                path: source.clone(),
                difference,
            });
        }
    }
    let run = theirs.run_id();
    let was_complete = home == directory && theirs.complete;
    let mut ours = Manifest {
        patches: None,
        parts: Vec::new(),
        entries: 0,
        complete: false,
        thinning: None,
        ..theirs.clone()
    };
    let mut places = vec![directory];
    places.extend(sources.iter().map(PathBuf::as_path));
    ours.patches = gather_patches(&places, &run)?;
    if ours.patches.is_none() {
        return Err(Error::malformed(
            &home.join(PATCHES_FILE),
            "is damaged, and no other directory has it; run `compute` with the scene again, which mends it",
        ));
    }
    // Memory is not allocated by the manifest's word alone, and files that no reader takes are not merged.
    let table = directory.join(PATCHES_FILE);
    require_backed(&table, ours.patch_count)?;
    read_patches(&table, &mut Npz::open(&table)?, &ours)?;
    let shard_count = shard_count(&places);
    let mut writer = StoreWriter::new(directory, ours, None, locks);
    if home != directory || !directory.join(PARTS_DIRECTORY).is_dir() {
        writer.begin(None, false)?;
    }
    let (copied, mut not_kept) = gather_parts(&mut writer, &places, &run, threads)?;
    let missing = writer.missing_parts();
    let is_there = |part: &NotKept| missing.binary_search(&part.part).is_ok();
    not_kept.retain(is_there);
    let manifest = if missing.is_empty() {
        if was_complete && theirs.parts == writer.manifest().parts && theirs.patches == writer.manifest().patches {
            writer.has_been_complete(theirs);
        }
        writer.finish()?
    } else {
        writer.manifest().clone()
    };
    Ok(Merged {
        manifest,
        copied,
        missing,
        not_kept,
        shard_count,
    })
}

/// Copies the first whole table of patches to the first place, unless it has one. Returns what the manifest says of it.
fn gather_patches(places: &[&Path], run: &[u8; 32]) -> Result<Option<FileEntry>> {
    for place in places {
        let found = patches_of(place, run)?;
        if found.is_some() {
            if *place != places[0] {
                copy(&place.join(PATCHES_FILE), &places[0].join(PATCHES_FILE))?;
            }
            return Ok(found);
        }
    }
    Ok(None)
}

/// Copies the parts that the first place lacks to it. Returns their number, and those that are damaged.
fn gather_parts(
    writer: &mut StoreWriter,
    places: &[&Path],
    run: &[u8; 32],
    threads: usize,
) -> Result<(u32, Vec<NotKept>)> {
    let directory = places[0];
    let manifest = writer.manifest().clone();
    let (mut copied, mut not_kept) = (0, Vec::new());
    for place in places {
        // All of them, so that two versions of one part are noticed.
        let all: Vec<u32> = (0..manifest.part_count).collect();
        look_at_all(place, &manifest, run, &all, threads, &mut |index, found| {
            let path = place.join(part_file(index));
            let there = writer
                .manifest()
                .parts
                .binary_search_by_key(&index, |entry| entry.index);
            let reason = match (found, there) {
                (Err(reason), _) => reason,
                (Ok(found), Ok(at)) => {
                    if writer.manifest().parts[at].blake3 == found.checksum {
                        return Ok(());
                    }
                    let reason = "two directories have this part in two versions, though of one run: were they \
                                  computed by the same program, and on disks that can be trusted? a check of a \
                                  whole store of either tells";
                    return Err(Error::refused(&path, reason));
                }
                (Ok(found), Err(_)) => {
                    if *place != directory {
                        copy(&path, &directory.join(part_file(index)))?;
                        copied += 1;
                    }
                    match writer.take_over(&found.part, found.checksum) {
                        Ok(()) => return Ok(()),
                        Err(reason) => format!("`{}`: {reason}", path.display()),
                    }
                }
            };
            not_kept.push(NotKept { part: index, reason });
            Ok(())
        })?;
    }
    Ok((copied, not_kept))
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    let mut source = hemicube_scene::open_regular(from).map_err(|error| Error::io(from, "opened", error))?;
    let size = source.metadata().map_err(|error| Error::io(from, "read", error))?.len();
    let mut file = DurableFile::create(to)?;
    io::copy(&mut source, &mut file)
        .and_then(|_| file.commit())
        .map_err(|error| Error::write(to, size, error))
}

/// Returns whether a directory has a store's manifest.
impl StoreWriter {
    /// Returns whether a store, in whatever state, is in `directory`.
    pub fn is_in(directory: &Path) -> bool {
        directory.join(MANIFEST_FILE).exists() && Manifest::is_in(directory)
    }
}
