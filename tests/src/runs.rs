//! Runs of the program: in a directory of their own, without settings of the user or the environment.

use crate::scenes::program;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A run longer than this hangs.
pub const TIME_LIMIT: Duration = Duration::from_secs(300);

/// The outcome of a run.
#[derive(Clone, Debug)]
pub struct Ran {
    /// The exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Ran {
    /// It ended with this code.
    ///
    /// # Panics
    /// When it did not.
    #[track_caller]
    #[allow(
        clippy::must_use_candidate,
        clippy::return_self_not_must_use,
        reason = "called for the assertion"
    )]
    pub fn is(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "stdout: {}\nstderr: {}", self.out, self.err);
        self
    }

    /// It said these words, as results or as messages.
    ///
    /// # Panics
    /// When one is missing.
    #[track_caller]
    #[allow(
        clippy::must_use_candidate,
        clippy::return_self_not_must_use,
        reason = "called for the assertion"
    )]
    pub fn says(self, words: &[&str]) -> Self {
        for word in words {
            let is_said = self.err.contains(word) || self.out.contains(word);
            assert!(is_said, "`{word}` is not in: {}{}", self.out, self.err);
        }
        self
    }

    /// Standard output, parsed as JSON.
    ///
    /// # Panics
    /// When it is none.
    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error} in: {}", self.out))
    }
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        let ran = Self {
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        };
        assert!(!ran.err.contains("panicked"), "{}", ran.err);
        ran
    }
}

/// A directory to run the program in, removed when dropped.
#[derive(Debug)]
pub struct Place {
    directory: TempDir,
}

impl Default for Place {
    fn default() -> Self {
        Self::new()
    }
}

impl Place {
    /// An empty one.
    ///
    /// # Panics
    /// When there can be none.
    pub fn new() -> Self {
        Self {
            directory: tempfile::tempdir().expect("a temporary directory"),
        }
    }

    /// A path in it.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.directory.path().join(name)
    }

    /// A run of the program, not started yet, of a line of words without blanks in them, variables first.
    pub fn command(&self, line: &str) -> Command {
        let mut command = command_in(&program(), self.directory.path());
        with_words(&mut command, line)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Writes a file into it, below folders made for it.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn write(&self, name: impl AsRef<Path>, text: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a directory");
        std::fs::write(path, text).expect("a file");
    }

    /// Runs it to the end.
    ///
    /// # Panics
    /// When it cannot be started, or panics.
    #[track_caller]
    pub fn line(&self, line: &str) -> Ran {
        finish(self.spawn(self.command(line)))
    }

    /// Starts it.
    ///
    /// # Panics
    /// When it cannot be started.
    #[track_caller]
    pub fn spawn(&self, mut command: Command) -> Child {
        command.spawn().expect("the program starts")
    }
}

/// A run of a program in a folder, without settings of the user or the environment; it has no arguments yet.
pub fn command_in(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new(program);
    command
        .current_dir(folder)
        .env("HOME", folder.join("home"))
        .env_remove("XDG_CONFIG_HOME")
        .env_remove("XDG_DATA_HOME");
    // Variables of a scheduler running these tests are not meant for them.
    let foreign = ["HEMICUBE_", "SLURM_", "OMPI_", "PMI_", "JOB_COMPLETION_"];
    for (name, _) in std::env::vars_os() {
        if foreign.iter().any(|prefix| name.to_string_lossy().starts_with(prefix)) {
            command.env_remove(name);
        }
    }
    command
}

/// Adds the words of a line: variables before a command, as a shell takes them, and arguments.
pub fn with_words<'a>(command: &'a mut Command, line: &str) -> &'a mut Command {
    let mut words = line.split_whitespace().peekable();
    while let Some((name, value)) = words.peek().and_then(|word| word.split_once('='))
        && name.chars().all(|c| c.is_ascii_uppercase() || c == '_')
    {
        command.env(name, value);
        words.next();
    }
    command.args(words)
}

/// Waits for a run.
///
/// # Panics
/// When it panics.
pub fn finish(child: Child) -> Ran {
    child.wait_with_output().expect("the program ends").into()
}

/// Waits until something holds.
///
/// # Panics
/// When it never does.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let started = Instant::now();
    while !holds() {
        assert!(started.elapsed() < TIME_LIMIT, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Every file beneath a directory and its bytes, by path.
///
/// # Panics
/// When one cannot be read.
pub fn files(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut left = vec![directory.to_owned()];
    while let Some(next) = left.pop() {
        for entry in std::fs::read_dir(&next).expect("a directory") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                left.push(path);
                continue;
            }
            let name = path.strip_prefix(directory).expect("it is beneath");
            let name = name.to_string_lossy().into_owned();
            found.insert(name, std::fs::read(&path).expect("a file"));
        }
    }
    found
}

/// Two stores are the same to the bit, and nothing else lies in either.
///
/// # Panics
/// When they are not; it names the files.
#[track_caller]
pub fn assert_same(one: &Path, other: &Path) {
    let (one, other) = (files(one), files(other));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&one), names(&other));
    let different: Vec<&String> = one.keys().filter(|name| one[*name] != other[*name]).collect();
    assert!(different.is_empty(), "{different:?} differ");
}
