//! Who may write a store: one run, or any number of its shards, or a merge.
//!
//! A lock is the operating system's, on a file in the store: it ends with the process that holds it, however that ends, so
//! that a file which a killed run left locks nothing. The file says who holds it, for the message to who comes second.
//! A whole run holds [`FILE`] alone; shards share it, and each has a file of its own beside it.

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
    /// Who wants to be alone.
    Shared,
    /// Everybody else, who then waits: for the short work of making a store.
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

/// The name of a lock of a store.
pub(super) fn file_name(label: &str) -> String {
    format!(".lock{label}{TEMPORARY_SUFFIX}")
}

impl Lock {
    /// Takes a lock of the store in `directory`, which exists.
    pub(super) fn take(directory: &Path, label: &str, mode: Mode) -> Result<Self> {
        let path = directory.join(file_name(label));
        loop {
            let mut file = File::options()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(|error| Error::io(&path, "created", error))?;
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
            // Who held it before may have removed the file between our opening and our locking it.
            if !is_still_at(&file, &path) {
                continue;
            }
            if mode == Mode::Alone {
                // A courtesy to who comes second.
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

    /// Whether the file system keeps others out. Where it does not, whoever starts a second writer is not stopped.
    pub(super) fn holds(&self) -> bool {
        self.file.is_some()
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Before the lock ends, so that nobody holds a lock on a file that is about to go. Others may share ours.
        if self.mode != Mode::Shared && (self.file.is_some() || self.mode == Mode::Alone) {
            let _ = std::fs::remove_file(&self.path);
        }
        self.file = None;
    }
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
    // ENOLCK and ENOSYS: network file systems that were mounted without locks.
    error.kind() == io::ErrorKind::Unsupported
        || matches!(error.raw_os_error(), Some(37 | 38) if cfg!(target_os = "linux"))
}

#[cfg(unix)]
fn is_still_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(ours), Ok(there)) => (ours.dev(), ours.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// A file that is open cannot lose its name here.
#[cfg(not(unix))]
fn is_still_at(_: &File, path: &Path) -> bool {
    path.exists()
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
