//! Command lines: words to run, and text to copy into a shell.

use crate::shell::quoted;
use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The words after the program's name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Line {
    pub(super) words: Vec<OsString>,
}

impl Line {
    /// A subcommand, or two: `view sparsity`.
    pub(super) fn new(subcommand: &str) -> Self {
        Self {
            words: subcommand.split(' ').map(OsString::from).collect(),
        }
    }

    pub(super) fn with(mut self, word: impl Into<OsString>) -> Self {
        self.words.push(word.into());
        self
    }

    pub(super) fn with_all(mut self, words: impl IntoIterator<Item = OsString>) -> Self {
        self.words.extend(words);
        self
    }

    /// Adds a path, with `./` before a name that looks like an option.
    pub(super) fn with_path(self, path: &Path) -> Self {
        if path.as_os_str().as_encoded_bytes().starts_with(b"-") {
            self.with(Path::new(".").join(path))
        } else {
            self.with(path)
        }
    }

    /// The line for a POSIX shell.
    pub(super) fn shown(&self, program: &OsStr) -> String {
        let words = std::iter::once(program).chain(self.words.iter().map(OsString::as_os_str));
        let quoted: Vec<String> = words.map(quoted).collect();
        quoted.join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_never_taken_for_an_option() {
        let line = Line::new("check").with_path(Path::new("-x.hemicube"));
        assert_eq!(line.shown(OsStr::new("hemicube")), "hemicube check ./-x.hemicube");
    }

    #[cfg(unix)]
    #[test]
    fn a_shell_reads_back_what_is_shown() {
        use std::os::unix::ffi::OsStrExt;
        let words = ["it's \"quoted\" $x `y` \\ !", "höhe", "-n", "* ? [a]", "a=b ~ #", ""];
        let line = Line::new("x").with_all(words.iter().map(OsString::from));
        // Bytes that are no UTF-8 and control characters need `$'…'`, which not every `sh` has.
        let raw = OsStr::from_bytes(b"\xff\x01'1\n");
        for (shell, line) in [("sh", line.clone()), ("bash", line.with(raw))] {
            let script = format!("printf '%s\\0' {}", line.shown(OsStr::new("p")));
            let output = std::process::Command::new(shell).arg("-c").arg(&script).output();
            let output = output.expect("the shell runs");
            let read: Vec<&[u8]> = output.stdout.split(|&byte| byte == 0).collect();
            let mut meant: Vec<&[u8]> = vec![b"p"];
            meant.extend(line.words.iter().map(|word| word.as_bytes()));
            meant.push(b"");
            assert_eq!(read, meant, "{script}");
        }
    }
}
