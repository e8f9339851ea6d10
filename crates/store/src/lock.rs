//! Locks of writers of a store: one run, or any number of its shards, or a merge.
//!
//! A lock is the operating system's, on a file in the store. It ends with its process, however that ends: a file left
//! by a killed run locks nothing. The file names its holder, for the message to a second writer. A run without shards
//! holds [`FILE`] alone; shards share it, and each has a file of its own beside it.

use super::durable::TEMPORARY_SUFFIX;
use super::{Error, Result};
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Whom a lock keeps out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    /// Everybody else.
    Alone,
    /// Alone; others are refused.
    Shared,
    /// Alone, after waiting for the others: for the short work of making a store.
    Waiting,
}

/// A lock, until it is dropped.
#[derive(Debug)]
pub(super) struct Lock {
    path: PathBuf,
    /// `None` where the file system has no locks.
    file: Option<File>,
    mode: Mode,
}

/// Keeps other writers out of a folder of files that belong together, such as a solution's, until it is dropped. On a
/// file system without locks it keeps out nobody.
///
/// ```
/// use hemicube_store::FolderLock;
/// # let folder = tempfile::tempdir()?;
/// let lock = FolderLock::take(folder.path())?;
/// assert!(FolderLock::take(folder.path()).is_err(), "one at a time");
/// drop(lock);
/// assert_eq!(std::fs::read_dir(folder.path())?.count(), 0, "nothing is left of it");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct FolderLock {
    _lock: Lock,
}

impl FolderLock {
    /// Takes the lock of an existing folder.
    ///
    /// # Errors
    /// [`Error::Refused`] when somebody else has it, and names them.
    pub fn take(folder: &Path) -> Result<Self> {
        match Lock::take(folder, "", Mode::Alone) {
            Ok(lock) => Ok(Self { _lock: lock }),
            Err(Error::Locked { path, holder }) => Err(Error::Refused {
                path,
                reason: format!("{holder} is writing it; wait for that, or choose another place"),
            }),
            Err(error) => Err(error),
        }
    }
}

/// The name of a lock of a store.
pub(super) fn file_name(label: &str) -> String {
    format!(".lock{label}{TEMPORARY_SUFFIX}")
}

impl Lock {
    /// Takes a lock of the store in `directory`, which exists.
    pub(super) fn take(directory: &Path, label: &str, mode: Mode) -> Result<Self> {
        let path = directory.join(file_name(label));
        loop {
            let mut file = open(&path)?;
            let taken = match mode {
                Mode::Alone => file.try_lock(),
                Mode::Shared => file.try_lock_shared(),
                Mode::Waiting => file.lock().map_err(TryLockError::Error),
            };
            match taken {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    // Not known for a moment after the lock was taken; the message is true without it.
                    let _ = (&mut file).take(256).read_to_string(&mut holder);
                    return Err(Error::Locked {
                        path: directory.to_owned(),
                        holder: match holder.trim() {
                            "" => "another process".to_owned(),
                            holder => holder.to_owned(),
                        },
                    });
                }
                Err(TryLockError::Error(error)) if is_unsupported(&error) => {
                    return Ok(Self { path, file: None, mode });
                }
                Err(TryLockError::Error(error)) => return Err(Error::io(&path, "locked", error)),
            }
            // The holder before may have removed the file between opening and locking.
            if !is_still_at(&file, &path) {
                continue;
            }
            if mode == Mode::Alone {
                // For the message to a second writer.
                let _ = file
                    .set_len(0)
                    .and_then(|()| file.rewind())
                    .and_then(|()| file.write_all(holder().as_bytes()));
            }
            return Ok(Self {
                path,
                file: Some(file),
                mode,
            });
        }
    }

    /// Returns whether the file system keeps others out. On one without locks a second writer is not stopped.
    pub(super) fn holds(&self) -> bool {
        self.file.is_some()
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Before the lock ends: nobody may hold a lock on a file about to be removed. Others may share ours.
        if self.mode != Mode::Shared && (self.file.is_some() || self.mode == Mode::Alone) {
            let _ = std::fs::remove_file(&self.path);
        }
        self.file = None;
    }
}

/// Opens the lock's file, or makes it. Its name can be foreseen by others: a link, a pipe, a device or a file with a
/// second name there is not followed, waited for or written to.
fn open(path: &Path) -> Result<File> {
    let mut options = File::options();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags(
            (OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY)
                .bits()
                .cast_signed(),
        );
    }
    let in_the_way = || Error::InTheWay {
        path: path.to_owned(),
        reason: "is not the file that writers of the store lock (a link, or no plain file); remove it",
    };
    if std::fs::symlink_metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        return Err(in_the_way());
    }
    let file = options.open(path).map_err(|error| Error::io(path, "created", error))?;
    let metadata = file.metadata().map_err(|error| Error::io(path, "read", error))?;
    #[cfg(unix)]
    let has_other_names = std::os::unix::fs::MetadataExt::nlink(&metadata) > 1;
    #[cfg(not(unix))]
    let has_other_names = false;
    if !metadata.is_file() || has_other_names {
        return Err(in_the_way());
    }
    Ok(file)
}

fn holder() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let on = match host.trim() {
        "" => String::new(),
        host => format!(" on {host}"),
    };
    format!("process {}{on}", std::process::id())
}

fn is_unsupported(error: &io::Error) -> bool {
    // ENOLCK and ENOSYS: network file systems mounted without locks.
    error.kind() == io::ErrorKind::Unsupported
        || matches!(error.raw_os_error(), Some(37 | 38) if cfg!(target_os = "linux"))
}

#[cfg(unix)]
fn is_still_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(ours), Ok(there)) => (ours.dev(), ours.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// Files are compared by what Windows knows them by; a removed one is no longer found by its name.
#[cfg(windows)]
fn is_still_at(file: &File, path: &Path) -> bool {
    let ours = file.try_clone().and_then(same_file::Handle::from_file);
    matches!((ours, same_file::Handle::from_path(path)), (Ok(ours), Ok(there)) if ours == there)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_keeps_others_out_until_it_is_dropped_and_leaves_nothing() {
        let place = tempfile::tempdir().unwrap();
        let alone = Lock::take(place.path(), "", Mode::Alone).unwrap();
        assert!(alone.holds());
        for mode in [Mode::Alone, Mode::Shared] {
            let error = Lock::take(place.path(), "", mode).unwrap_err();
            let text = error.to_string();
            assert!(
                text.contains(&format!("process {}", std::process::id())) && matches!(error, Error::Locked { .. }),
                "{text}"
            );
        }
        Lock::take(place.path(), "-1-of-2", Mode::Alone).unwrap();
        drop(alone);
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);

        let shared = Lock::take(place.path(), "", Mode::Shared).unwrap();
        let other = Lock::take(place.path(), "", Mode::Shared).unwrap();
        assert!(Lock::take(place.path(), "", Mode::Alone).is_err());
        drop((shared, other));
        Lock::take(place.path(), "", Mode::Alone).unwrap();
    }

    #[test]
    fn what_a_killed_run_left_locks_nothing() {
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join(file_name("")), "process 1 on elsewhere").unwrap();
        Lock::take(place.path(), "", Mode::Alone).unwrap();
    }
}
