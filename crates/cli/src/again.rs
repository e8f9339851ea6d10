//! How the program starts itself: the dialogue and `backends check` run commands in processes of their own. Where it is
//! a guest of another program, as of Python, that one's file is not the program.

use anyhow::{Context, Result};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// The words that start the program, where it is a guest.
static WORDS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Makes it a guest, which these words start. The first call counts.
pub(crate) fn be_guest(words: Vec<OsString>) {
    // There is one program in a process, and one way to start it.
    let _ = WORDS.set(words);
}

/// Returns whether this process is of another program.
pub(crate) fn is_guest() -> bool {
    WORDS.get().is_some()
}

/// A command that starts the program, to which its arguments are added.
///
/// # Errors
/// When the system does not tell which file it runs.
pub(crate) fn command() -> Result<Command> {
    let own = || std::env::current_exe().context("the program's own path cannot be found");
    let mut words = WORDS.get().into_iter().flatten();
    let program = words.next().map_or_else(own, |word| Ok(PathBuf::from(word)))?;
    let mut command = Command::new(program);
    command.args(words);
    Ok(command)
}
