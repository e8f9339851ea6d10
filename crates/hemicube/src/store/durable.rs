//! Files that are there whole or not at all: written under a temporary name in the same directory, synced, renamed, and
//! the directory synced. Also reading at an offset, which needs no shared position.

use super::{Error, Result};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The end of every temporary name: it says whose file it is, so that one that a killed run left can be removed.
pub(crate) const TEMPORARY_SUFFIX: &str = ".hemicube-tmp";

/// A file that appears under its name when it is committed, and leaves nothing behind when it is dropped before.
pub(crate) struct DurableFile {
    path: PathBuf,
    temporary: PathBuf,
    /// `None` once committed.
    file: Option<BufWriter<File>>,
    /// Set by the first error: from then on nothing reaches the disk, nothing fails, and nothing can be committed. The
    /// zip writer ends its archive when it is dropped, and would complain on the standard error of a full disk.
    failed: bool,
    /// Where the next byte goes, and where the last one went.
    position: u64,
    end: u64,
}

impl DurableFile {
    pub(crate) fn create(path: &Path) -> Result<Self> {
        let mut name = OsString::from(".");
        name.push(path.file_name().ok_or_else(|| Error::InTheWay {
            path: path.to_owned(),
            reason: "names no file; add a file name",
        })?);
        name.push(TEMPORARY_SUFFIX);
        let temporary = path.with_file_name(name);
        match std::fs::remove_file(&temporary) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(Error::io(&temporary, "removed", error));
            }
            _ => {}
        }
        let file = File::options()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&temporary)
            .map_err(|error| Error::io(path, "created", error))?;
        Ok(Self {
            path: path.to_owned(),
            temporary,
            file: Some(BufWriter::with_capacity(1 << 20, file)),
            failed: false,
            position: 0,
            end: 0,
        })
    }

    /// Makes the file durable and gives it its name.
    pub(crate) fn commit(mut self) -> io::Result<()> {
        if self.failed {
            return Err(io::Error::other("an earlier part of the file was not written"));
        }
        if let Some(mut writer) = self.file.take() {
            let synced = writer.flush().and_then(|()| writer.get_ref().sync_all());
            // The flush failed, or nothing is buffered: either way the destructor must not write again.
            let (file, _) = writer.into_parts();
            drop(file);
            if let Err(error) = synced.and_then(|()| std::fs::rename(&self.temporary, &self.path)) {
                // The error that counts is the first one; a temporary file that cannot be removed is found by its name.
                let _ = std::fs::remove_file(&self.temporary);
                return Err(error);
            }
            sync_directory(&self.path)?;
        }
        Ok(())
    }

    fn attempt<T>(&mut self, act: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>) -> io::Result<T> {
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
            // What is still buffered is not wanted any more.
            let (file, _) = writer.into_parts();
            drop(file);
            // Best effort: a destructor cannot report, and the next writer removes what is left by its name.
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

/// Writes `bytes` as the whole content of `path`.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let wanted = bytes.len() as u64;
    let mut file = DurableFile::create(path)?;
    file.write_all(bytes)
        .and_then(|()| file.commit())
        .map_err(|error| Error::write(path, wanted, error))
}

/// A rename is durable only when the directory that holds the name is.
#[cfg(unix)]
fn sync_directory(path: &Path) -> io::Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    File::open(directory)?.sync_all()
}

/// Directories cannot be opened as files here; the file system orders renames itself.
#[cfg(not(unix))]
#[allow(clippy::unnecessary_wraps, reason = "the same shape as on Unix")]
fn sync_directory(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Fills `bytes` from `offset` on.
#[cfg(unix)]
pub(crate) fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Fills `bytes` from `offset` on.
#[cfg(windows)]
pub(crate) fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
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

/// The BLAKE3 checksum of a file, in hexadecimal.
pub(crate) fn file_checksum(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|error| Error::io(path, "opened", error))?;
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut io::BufReader::with_capacity(1 << 18, file), &mut hasher)
        .map_err(|error| Error::io(path, "read", error))?;
    Ok(hasher.finalize().to_hex().to_string())
}
