//! Files that are there whole or not at all: written under a temporary name in the same directory, synced, renamed, and
//! the directory synced. Also reading at an offset, without a shared position.
//!
//! A temporary file is always new (`O_CREAT | O_EXCL`), with ten random characters in its name: no link can wait at its
//! place, and two writers of one file meet only in the last step, a rename.

use super::{Error, Result};
use std::fs::{File, TryLockError};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// The end of every temporary name. Remains of a killed run are recognised and removed by it.
pub(crate) const TEMPORARY_SUFFIX: &str = ".hemicube-tmp";

/// Bytes of a seal: a BLAKE3 checksum in hexadecimal of everything before it. Archives have it as their comment, the
/// end of a zip file.
pub(crate) const SEAL_SIZE: u64 = 64;

/// The seal behind bytes already hashed, and the checksum of both.
pub(crate) fn seal(mut hasher: blake3::Hasher) -> (String, String) {
    let seal = hasher.finalize().to_hex().to_string();
    hasher.update(seal.as_bytes());
    (seal, hasher.finalize().to_hex().to_string())
}

/// Logs a step of writing a file. Tests end the process at such steps.
fn tell(step: &'static str, path: &Path) {
    tracing::trace!(target: "hemicube::store", step, file = %path.display());
}

/// Random characters of a temporary name: 62¹⁰ names.
const RANDOM: usize = 10;

/// Bytes of the file's own name that its temporary name repeats; file systems take 255 in all.
const REPEATED_MAX: usize = 180;

/// A new file beside another, under a name of its own. It takes the other's place at the end, or is removed when
/// dropped. It is locked while open; remains of a killed run are not locked, and the next writer of the same file
/// removes them.
///
/// Not synced, unlike [`DurableFile`]: for contents of the moment.
///
/// ```
/// use hemicube_store::TemporaryFile;
/// use std::io::Write;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("progress.json");
///
/// let mut file = TemporaryFile::create(&path)?;
/// file.get_mut().write_all(b"{}")?;
/// assert!(!path.exists());
/// file.rename()?;
/// assert_eq!(std::fs::read(&path)?, b"{}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct TemporaryFile {
    path: PathBuf,
    temporary: TempPath,
    file: File,
}

impl TemporaryFile {
    /// Creates the file that will become `path`.
    ///
    /// # Errors
    /// When `path` names something other than a file, or its directory cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        let prefix = prefix(path, "")?;
        remove_left_behind(path, &prefix);
        Self::create_as(path, &prefix)
    }

    fn create_as(path: &Path, prefix: &str) -> Result<Self> {
        let failed = |error| Error::io(path, "created", without_path(error));
        match std::fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => {
                return Err(Error::InTheWay {
                    path: path.to_owned(),
                    reason: "is a directory; give the name of a file",
                });
            }
            // A rename would put a file in the place of `/dev/null`.
            Ok(metadata) if !metadata.is_file() => {
                return Err(Error::InTheWay {
                    path: path.to_owned(),
                    reason: "is a pipe, a device or a socket; give the name of a file",
                });
            }
            _ => {}
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(prefix).rand_bytes(RANDOM).suffix(TEMPORARY_SUFFIX);
        // With the permissions of any new file, and on Windows without the mark of temporary files: the system delays
        // writing those, and the mark would stay.
        let open = |path: &Path| File::options().read(true).write(true).create_new(true).open(path);
        loop {
            let created = builder.make_in(directory_of(path), open).map_err(failed)?;
            let (file, temporary) = created.into_parts();
            match file.try_lock() {
                // Another writer's clean-up came between creating and locking.
                Err(TryLockError::WouldBlock) => {}
                // Without locks there is no clean-up.
                Ok(()) | Err(TryLockError::Error(_)) => {
                    return Ok(Self {
                        path: path.to_owned(),
                        temporary,
                        file,
                    });
                }
            }
        }
    }

    /// The file.
    pub fn get_mut(&mut self) -> &mut File {
        &mut self.file
    }

    /// Renames the file to its final name, replacing a file there.
    ///
    /// # Errors
    /// When the name cannot be given; the file is removed then.
    pub fn rename(self) -> io::Result<()> {
        // Open until it has its name, for the lock's sake.
        replace(&self.temporary, &self.path)?;
        // It has no temporary name left to be removed.
        let _ = self.temporary.keep();
        drop(self.file);
        Ok(())
    }
}

impl Write for TemporaryFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for TemporaryFile {
    fn seek(&mut self, target: SeekFrom) -> io::Result<u64> {
        self.file.seek(target)
    }
}

#[cfg(not(windows))]
fn replace(from: &Path, to: &Path) -> io::Result<()> {
    std::fs::rename(from, to)
}

/// Renames, and tries again for a second: virus scanners and indexers open what was just written, and for a moment the
/// file can be neither renamed nor replaced. A longer wait would delay the error of a file that another program keeps
/// open.
#[cfg(windows)]
fn replace(from: &Path, to: &Path) -> io::Result<()> {
    /// ERROR_ACCESS_DENIED and ERROR_SHARING_VIOLATION.
    const HELD: [i32; 2] = [5, 32];
    let mut wait = std::time::Duration::from_millis(1);
    loop {
        match std::fs::rename(from, to) {
            Err(error) if wait.as_millis() < 1000 && error.raw_os_error().is_some_and(|code| HELD.contains(&code)) => {
                std::thread::sleep(wait);
                wait *= 2;
            }
            renamed => return renamed,
        }
    }
}

/// The system's error, without the temporary name added by `tempfile`.
fn without_path(error: io::Error) -> io::Error {
    let inner = error
        .get_ref()
        .and_then(|wrapped| wrapped.source()?.downcast_ref::<io::Error>());
    match inner.and_then(io::Error::raw_os_error) {
        Some(code) => io::Error::from_raw_os_error(code),
        None => error,
    }
}

/// The directory of a file.
fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Beginning of a file's temporary names.
fn prefix(path: &Path, label: &str) -> Result<String> {
    let name = path.file_name().ok_or_else(|| Error::InTheWay {
        path: path.to_owned(),
        reason: "names no file; add a file name",
    })?;
    let name = name.to_string_lossy();
    if cfg!(windows) && is_device(&name) {
        return Err(Error::InTheWay {
            path: path.to_owned(),
            reason: "is the name of a device on Windows; give another name",
        });
    }
    let mut end = name.len().min(REPEATED_MAX);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    Ok(format!(".{}{label}.", &name[..end]))
}

/// Returns whether Windows takes a file name for a device, whatever its folder and its end (`NUL`, `con.txt`).
fn is_device(name: &str) -> bool {
    let stem = name.split(['.', ':']).next().unwrap_or_default().trim_end();
    let stem = stem.to_ascii_uppercase();
    let numbered = stem.strip_prefix("COM").or_else(|| stem.strip_prefix("LPT"));
    matches!(&*stem, "CON" | "PRN" | "AUX" | "NUL" | "CONIN$" | "CONOUT$")
        || numbered
            .is_some_and(|number| matches!(number, "¹" | "²" | "³") || matches!(number.as_bytes(), [b'0'..=b'9']))
}

/// Removes remains of killed writers of this file: regular files under its temporary names that nobody has locked. Best
/// effort: readers pass over the rest.
fn remove_left_behind(path: &Path, prefix: &str) {
    let is_left = |name: &str| {
        let random = name
            .strip_prefix(prefix)
            .and_then(|rest| rest.strip_suffix(TEMPORARY_SUFFIX));
        random.is_some_and(|random| random.len() == RANDOM && random.chars().all(|c| c.is_ascii_alphanumeric()))
    };
    for entry in std::fs::read_dir(directory_of(path)).into_iter().flatten().flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if !is_file || !is_left(&entry.file_name().to_string_lossy()) {
            continue;
        }
        if let Ok(file) = hemicube_scene::open_regular(&entry.path())
            && file.try_lock().is_ok()
        {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// A file that appears under its name when committed, and leaves nothing behind when dropped before.
///
/// ```
/// use hemicube_store::DurableFile;
/// use std::io::Write;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("result.txt");
///
/// let mut file = DurableFile::create(&path)?;
/// file.write_all(b"0.19982")?;
/// assert!(!path.exists(), "whoever looks now sees no half of it");
/// file.commit()?;
/// assert_eq!(std::fs::read(&path)?, b"0.19982");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct DurableFile {
    path: PathBuf,
    /// `None` once committed.
    file: Option<BufWriter<TemporaryFile>>,
    /// Set by the first error: from then on nothing reaches the disk, nothing fails, and nothing can be committed. The
    /// zip writer ends its archive when it is dropped, and would complain on the standard error of a full disk.
    failed: bool,
    /// Offset of the next byte, and of the last one written.
    position: u64,
    end: u64,
}

impl std::fmt::Debug for DurableFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DurableFile")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl DurableFile {
    /// Begins the file `path`, under a temporary name beside it.
    ///
    /// # Errors
    /// When there can be none.
    pub fn create(path: &Path) -> Result<Self> {
        tell("create", path);
        Ok(Self::of(TemporaryFile::create(path)?))
    }

    /// [`Self::create`] with a `label` in the temporary name, in a directory whose writer removes such names itself.
    pub(crate) fn create_as(path: &Path, label: &str) -> Result<Self> {
        tell("create", path);
        Ok(Self::of(TemporaryFile::create_as(path, &prefix(path, label)?)?))
    }

    fn of(file: TemporaryFile) -> Self {
        tell("write", &file.path);
        Self {
            path: file.path.clone(),
            file: Some(BufWriter::with_capacity(1 << 20, file)),
            failed: false,
            position: 0,
            end: 0,
        }
    }

    /// Writes all of the file to the disk, under its temporary name: what a full disk refuses is refused here, and
    /// [`Self::commit`] has but a name to give. For files that are to replace others together.
    ///
    /// # Errors
    /// When anything of it was not written.
    pub fn sync(&mut self) -> io::Result<()> {
        if self.failed {
            return Err(io::Error::other("an earlier part of the file was not written"));
        }
        self.attempt(|writer| {
            writer.flush()?;
            writer.get_ref().file.sync_all()
        })
    }

    /// Makes the file durable and gives it its name.
    ///
    /// # Errors
    /// When anything of it was not written, or the name cannot be given; nothing is left behind then.
    pub fn commit(mut self) -> io::Result<()> {
        if self.failed {
            return Err(io::Error::other("an earlier part of the file was not written"));
        }
        if let Some(mut writer) = self.file.take() {
            let synced = writer.flush().and_then(|()| {
                tell("sync", &self.path);
                writer.get_ref().file.sync_all()
            });
            // The flush failed, or nothing is buffered: either way the destructor must not write again.
            let (file, _) = writer.into_parts();
            synced?;
            tell("rename", &self.path);
            file.rename()?;
            tell("sync-directory", &self.path);
            sync_directory(directory_of(&self.path))?;
            tell("written", &self.path);
        }
        Ok(())
    }

    /// Replaces the last [`SEAL_SIZE`] bytes, reserved for it, by the checksum of all before them, and makes the file
    /// durable under its name. Returns the checksum of the whole.
    #[doc(hidden)]
    pub fn commit_sealed(mut self) -> io::Result<String> {
        if self.failed {
            return Err(io::Error::other("an earlier part of the file was not written"));
        }
        let body = self
            .end
            .checked_sub(SEAL_SIZE)
            .ok_or_else(|| io::Error::other("the file has no room for its seal"))?;
        let hasher = self.attempt(|writer| {
            writer.flush()?;
            let file = writer.get_mut().get_mut();
            file.rewind()?;
            let mut hasher = blake3::Hasher::new();
            io::copy(&mut BufReader::with_capacity(1 << 18, &*file).take(body), &mut hasher)?;
            file.seek(SeekFrom::Start(body))?;
            Ok(hasher)
        })?;
        let (seal, whole) = seal(hasher);
        self.position = body;
        self.write_all(seal.as_bytes())?;
        self.commit()?;
        Ok(whole)
    }

    fn attempt<T>(&mut self, act: impl FnOnce(&mut BufWriter<TemporaryFile>) -> io::Result<T>) -> io::Result<T> {
        let writer = self
            .file
            .as_mut()
            .ok_or_else(|| io::Error::other("the file is already committed"))?;
        let result = act(writer);
        self.failed |= result.is_err();
        result
    }
}

impl Write for DurableFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = if self.failed {
            bytes.len()
        } else {
            self.attempt(|writer| writer.write(bytes))?
        };
        self.position += count as u64;
        self.end = self.end.max(self.position);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.failed {
            Ok(())
        } else {
            self.attempt(BufWriter::flush)
        }
    }
}

impl Seek for DurableFile {
    fn seek(&mut self, target: SeekFrom) -> io::Result<u64> {
        let target = match target {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(distance) => self.position.checked_add_signed(distance),
            SeekFrom::End(distance) => self.end.checked_add_signed(distance),
        };
        let target = target.ok_or(io::ErrorKind::InvalidInput)?;
        if !self.failed {
            self.attempt(|writer| writer.seek(SeekFrom::Start(target)))?;
        }
        self.position = target;
        Ok(target)
    }
}

impl Drop for DurableFile {
    fn drop(&mut self) {
        if let Some(writer) = self.file.take() {
            // Buffered bytes are not wanted any more.
            let (file, _) = writer.into_parts();
            drop(file);
        }
    }
}

/// Writes `bytes` as the whole content of `path`.
pub fn write_whole(path: &Path, bytes: &[u8], label: &str) -> Result<()> {
    let wanted = bytes.len() as u64;
    let mut file = DurableFile::create_as(path, label)?;
    file.write_all(bytes)
        .and_then(|()| file.commit())
        .map_err(|error| Error::write(path, wanted, error))
}

/// A rename is durable only when its directory is.
#[cfg(unix)]
pub(crate) fn sync_directory(directory: &Path) -> io::Result<()> {
    let directory = if directory.as_os_str().is_empty() {
        Path::new(".")
    } else {
        directory
    };
    File::open(directory)?.sync_all()
}

/// The standard library opens no directories here. NTFS keeps a journal of renames; when they last is up to it.
#[cfg(not(unix))]
#[allow(clippy::unnecessary_wraps, reason = "the same shape as on Unix")]
pub(crate) fn sync_directory(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Fills `bytes` from `offset` on.
#[cfg(unix)]
pub fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Fills `bytes` from `offset` on.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                bytes = &mut bytes[count..];
                offset += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// The checksum of a sealed file; `None` when the seal does not match its bytes.
pub fn sealed_checksum(path: &Path) -> Result<Option<String>> {
    let file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
    let read = |error| Error::io(path, "read", error);
    let Some(body) = file.metadata().map_err(read)?.len().checked_sub(SEAL_SIZE) else {
        return Ok(None);
    };
    let mut reader = io::BufReader::with_capacity(1 << 18, file);
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut reader.by_ref().take(body), &mut hasher).map_err(read)?;
    let mut found = Vec::new();
    reader.take(SEAL_SIZE).read_to_end(&mut found).map_err(read)?;
    let (seal, whole) = seal(hasher);
    Ok((found == seal.as_bytes()).then_some(whole))
}

/// The BLAKE3 checksum of a file, in hexadecimal.
pub fn file_checksum(path: &Path) -> Result<String> {
    let file = hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?;
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut io::BufReader::with_capacity(1 << 18, file), &mut hasher)
        .map_err(|error| Error::io(path, "read", error))?;
    Ok(hasher.finalize().to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_devices_are_known_by_their_stems() {
        for name in [
            "NUL", "con.txt", "aux .npz", "Com1", "lpt9.a.b", "COM³", "nul:x", "conin$",
        ] {
            assert!(is_device(name), "{name}");
        }
        for name in ["null", "COM", "com10", "console.npz", "lpt", "F.nul", ""] {
            assert!(!is_device(name), "{name}");
        }
    }

    #[test]
    fn a_file_that_replaces_another_is_as_any_new_file() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("file");
        write_whole(&path, b"before", "").unwrap();
        std::fs::write(place.path().join("plain"), "x").unwrap();
        let permissions = |name: &str| std::fs::metadata(place.path().join(name)).unwrap().permissions();
        assert_eq!(permissions("file"), permissions("plain"));
        write_whole(&path, b"after", "").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 2);
    }
}
