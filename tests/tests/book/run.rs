//! A page's blocks, run in their order in a folder of their own. The README and pages for developers are run as in the
//! clone, whose `./run` is the program; pages for users in an empty folder beside the clone, `hemicube`. In both,
//! `hemicube` is the program, and `cargo run --example` what is built already.

use super::page::{Block, Page};
use hemicube_tests::readers::{petsc_folder, python};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{profile_folder, program, say, scenes_dir, scenes_or_skip, skip, unpack, workspace};
use std::ffi::OsString;
use std::fs::File;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

/// How much of a page is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// Blocks that take seconds.
    Quick,
    /// Everything.
    Full,
}

/// A block that takes longer hangs.
const TIME_LIMIT: Duration = Duration::from_secs(900);

/// How long a command that takes hours is watched.
const BEGINNING: Duration = Duration::from_secs(20);

/// Stands for Cargo: what it would build is built, and is not built again with other features.
const CARGO: &str = r#"#!/usr/bin/env bash
set -euo pipefail
words=("$@")
case " $* " in
    *" --manifest-path hemicube/Cargo.toml "*) ;;
    *" --manifest-path "*) exec env PATH="$PATH_OF_CARGO" cargo "${words[@]}" ;;
esac
[ "$1" = build ] && exit 0
[ "$1" = run ] || { echo "nothing stands for \`cargo $1\`" >&2; exit 2; }
shift
while [ $# -gt 0 ]; do
    case "$1" in
        --release) shift ;;
        -p) shift 2 ;;
        --example)
            example=$2
            shift 2
            [ "${1:-}" = -- ] && shift
            exec "$BUILT/examples/$example" "$@"
            ;;
        *) break ;;
    esac
done
echo "nothing stands for \`cargo ${words[*]}\`" >&2
exit 2
"#;

/// The folder that a page is run in.
#[derive(Debug)]
pub(crate) struct Folder {
    place: Place,
    test: String,
    python: Option<OsString>,
}

/// The output of a block, standard output and error as they came, and its exit status; `None` after the time limit.
type Said = (String, Option<ExitStatus>);

impl Folder {
    /// For a page; a test of that name says what it skips.
    pub(crate) fn new(test: &str, page: &Page) -> Self {
        let place = Place::new();
        if page.is_for_users() && page.name.starts_with("docs/") {
            symlink(workspace(), place.path("hemicube")).expect("a link");
        } else {
            for name in ["crates", "examples", "scripts"] {
                symlink(workspace().join(name), place.path(name)).expect("a link");
            }
            symlink(program(), place.path("run")).expect("a link");
        }
        std::fs::create_dir(place.path("bin")).expect("a folder");
        symlink(program(), place.path("bin/hemicube")).expect("a link");
        let wants_python = |block: &Block| {
            block.language == "python" && !block.needs_package() || block.value("needs") == Some("scipy")
        };
        let python = page
            .blocks()
            .iter()
            .any(wants_python)
            .then(|| python(test, &["numpy", "scipy.sparse"]));
        let python = python.flatten();
        let folder = Self {
            place,
            test: test.to_owned(),
            python,
        };
        folder.script("cargo", CARGO);
        if let Some(python) = &folder.python {
            folder.script(
                "python3",
                &format!("#!/bin/sh\nexec '{}' \"$@\"\n", python.to_string_lossy()),
            );
        }
        folder
    }

    /// A file in it.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.place.path(name)
    }

    fn script(&self, name: &str, text: &str) {
        let path = self.path("bin").join(name);
        std::fs::write(&path, text).expect("a script");
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("may be run");
    }

    /// A command in the folder, in the environment of the program's tests.
    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(name);
        for (name, value) in self.place.command("").get_envs() {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        let mut path = self.path("bin").into_os_string();
        path.push(":");
        path.push(std::env::var_os("PATH").unwrap_or_default());
        let home = std::env::var_os("HOME").map(PathBuf::from).unwrap_or_default();
        let or_beneath_home = |name: &str, folder: &str| std::env::var_os(name).unwrap_or(home.join(folder).into());
        command
            .current_dir(self.path(""))
            .env("PATH", path)
            .env("HEMICUBE_THREADS", "2")
            .env("BUILT", profile_folder())
            .envs(scenes_dir().map(|folder| ("HEMICUBE_SCENES", folder)))
            .env("PATH_OF_CARGO", std::env::var_os("PATH").unwrap_or_default())
            .env("CARGO_HOME", or_beneath_home("CARGO_HOME", ".cargo"))
            .env("RUSTUP_HOME", or_beneath_home("RUSTUP_HOME", ".rustup"))
            .env("CARGO_NET_OFFLINE", "true")
            .env("CARGO_TARGET_DIR", self.path("target"))
            // Open MPI thinks better of root, and of more processes than cores, unless told.
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1");
        command
    }

    /// Runs a command until it ends or the time is over, and then ends it with all that it has begun.
    fn watch(&self, mut command: Command, limit: Duration) -> Said {
        let path = self.path("said");
        let said = File::create(&path).expect("a file");
        command
            .stdout(said.try_clone().expect("the same file"))
            .stderr(said)
            .process_group(0);
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let started = Instant::now();
        let status = loop {
            match child.try_wait().expect("a child") {
                Some(status) => break Some(status),
                None if started.elapsed() > limit => break None,
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        if status.is_none() {
            let group = format!("-{}", child.id());
            let killed = Command::new("kill").args(["-KILL", "--", &group]).status();
            assert!(
                killed.is_ok_and(|status| status.success()),
                "process group {group} does not end"
            );
            child.wait().expect("a child");
        }
        let said = String::from_utf8_lossy(&std::fs::read(&path).expect("what it said")).into_owned();
        std::fs::remove_file(path).expect("removed");
        (said, status)
    }

    /// Runs lines of bash; the first that fails ends them.
    pub(crate) fn bash(&self, lines: &str, limit: Duration, environment: &[(&str, OsString)]) -> Said {
        let mut command = self.command("bash");
        let script = format!("trap 'echo \"this failed: $BASH_COMMAND\"' ERR\n{lines}");
        command.args(["-euo", "pipefail", "-c", &script]);
        command.envs(environment.iter().map(|(name, value)| (name, value)));
        self.watch(command, limit)
    }

    /// The variables that a block needs; `None`, said on the terminal, where what they name is not there.
    fn need(&self, what: &str) -> Option<Vec<(&'static str, OsString)>> {
        match what {
            "scipy" => self.python.as_ref().map(|_| Vec::new()),
            "scenes" => {
                let tile = scenes_or_skip(&self.test)?.join("city/denhaag-8897.obj");
                let packed = tile.with_extension("obj.zst");
                let bytes = if packed.is_file() {
                    unpack(&packed)
                } else {
                    std::fs::read(&tile).expect("a scene")
                };
                std::fs::write(self.path("denhaag-8897.obj"), bytes).expect("room for a scene");
                Some(Vec::new())
            }
            "mpirun" => {
                if self
                    .bash("command -v mpirun", TIME_LIMIT, &[])
                    .1
                    .is_some_and(|status| status.success())
                {
                    return Some(Vec::new());
                }
                skip(&self.test, "no mpirun", "HEMICUBE_REQUIRE_CLUSTER");
                None
            }
            "petsc4py" => {
                if let Some(folder) = petsc_folder() {
                    return Some(vec![("PETSC_DIR", folder.into_os_string())]);
                }
                skip(&self.test, "no petsc4py", "HEMICUBE_REQUIRE_SOLVERS");
                None
            }
            "ccx" | "viewFactorsGen" => {
                let there = self.bash(&format!("command -v {what}"), TIME_LIMIT, &[]).1;
                if there.is_some_and(|status| status.success()) {
                    return Some(vec![("WM_PROJECT_DIR", "/usr/share/openfoam".into())]);
                }
                skip(&self.test, &format!("no {what}"), "HEMICUBE_REQUIRE_SOLVERS");
                None
            }
            backend => {
                let there = vec![("HEMICUBE_BACKEND_PATH", profile_folder().into_os_string())];
                let listed = self.bash("hemicube backends list", TIME_LIMIT, &there).0;
                if listed
                    .lines()
                    .any(|line| line.starts_with(&format!("{backend} ")) && line.contains(".so"))
                {
                    return Some(there);
                }
                let required = std::env::var("HEMICUBE_REQUIRE_BACKENDS").unwrap_or_default();
                assert!(
                    !required.split(',').any(|name| name.trim() == backend),
                    "`{backend}` is required: {listed}"
                );
                say(&format!("SKIP {}: no backend {backend}", self.test));
                None
            }
        }
    }

    /// Runs a block; what it said, or `None` where it was not run.
    fn block(&self, block: &Block, extent: Extent) -> Result<Option<String>, String> {
        if let Some(name) = block.value("file") {
            let path = self.path(name);
            std::fs::create_dir_all(path.parent().expect("beneath the folder")).expect("a folder");
            std::fs::write(path, &block.text).expect("a file");
            return Ok(None);
        }
        let is_dear = block.is("full") || block.is("hours");
        let is_left_out = block.is("not-run") || is_dear && extent == Extent::Quick;
        let (said, status) = match block.language.as_str() {
            "console" if !is_left_out => {
                let environment = match block.value("needs").map(|what| self.need(what)) {
                    None => Vec::new(),
                    Some(Some(environment)) => environment,
                    Some(None) => return Ok(None),
                };
                let limit = if block.is("hours") { BEGINNING } else { TIME_LIMIT };
                self.bash(&block.text, limit, &environment)
            }
            "python" if !block.needs_package() => {
                if self.python.is_none() {
                    return Ok(None);
                }
                let mut command = self.command("python3");
                command.args(["-c", &block.text]);
                self.watch(command, TIME_LIMIT)
            }
            _ => return Ok(None),
        };
        match status {
            None if block.is("hours") => Ok(None),
            None => Err(format!("did not end within {} s\n{said}", TIME_LIMIT.as_secs())),
            Some(status) if status.success() => Ok(Some(said)),
            Some(status) => Err(format!("{status}\n{said}")),
        }
    }

    /// Runs a page, and hands each block of output to `look` with what the command before it said.
    fn run(
        &self,
        page: &Page,
        extent: Extent,
        mut look: impl FnMut(&Block, &str) -> Result<(), String>,
    ) -> Result<(), String> {
        let mut last: Option<String> = None;
        for block in page.blocks() {
            let at = |what: String| format!("{}:{}: {what}\n{}", page.name, block.line, block.text);
            if block.is("output") {
                if let Some(said) = &last {
                    look(&block, said).map_err(at)?;
                }
                continue;
            }
            last = self.block(&block, extent).map_err(at)?;
        }
        Ok(())
    }

    /// Runs a page.
    ///
    /// # Errors
    /// The first block that fails, or says something else than stands there.
    pub(crate) fn page(&self, page: &Page, extent: Extent) -> Result<(), String> {
        self.run(page, extent, |block, said| says(said, &block.text))
    }

    /// Runs a page, and makes its text with what the commands say now.
    ///
    /// # Errors
    /// The first block that fails.
    pub(crate) fn blessed(&self, page: &Page, extent: Extent) -> Result<String, String> {
        let mut blocks = Vec::new();
        self.run(page, extent, |block, said| {
            blocks.push((block.clone(), updated(said, &block.text)));
            Ok(())
        })?;
        let mut lines: Vec<&str> = page.text.lines().collect();
        for (block, text) in blocks.iter().rev() {
            lines.splice(block.line..block.line + block.text.lines().count(), text.lines());
        }
        Ok(lines.join("\n") + "\n")
    }
}

/// Compares a line with the book's, where `…` stands for anything.
fn fits(line: &str, wanted: &str) -> bool {
    let mut pieces = wanted.split('…');
    let Some(mut rest) = pieces.next().and_then(|first| line.strip_prefix(first)) else {
        return false;
    };
    let pieces: Vec<&str> = pieces.collect();
    let Some((last, between)) = pieces.split_last() else {
        return rest.is_empty();
    };
    for piece in between {
        let Some((_, after)) = rest.split_once(piece) else {
            return false;
        };
        rest = after;
    }
    rest.ends_with(last)
}

/// Tells which of the lines said stand in the book: all of them, but where a line of `…` stands for some. `None` where
/// they differ.
fn shown(said: &[&str], wanted: &[&str]) -> Option<Vec<bool>> {
    let runs: Vec<&[&str]> = wanted.split(|line| *line == "…").collect();
    let mut shown = vec![false; said.len()];
    let mut start = 0;
    for (k, run) in runs.iter().enumerate() {
        let latest = said.len().checked_sub(run.len()).filter(|&latest| latest >= start)?;
        let holds = |&place: &usize| run.iter().zip(&said[place..]).all(|(wanted, line)| fits(line, wanted));
        let mut places = match (k == 0, k + 1 == runs.len()) {
            (true, true) if latest > 0 => return None,
            (true, _) => 0..=0,
            (false, true) => latest..=latest,
            (false, false) => start..=latest,
        };
        let place = places.find(holds)?;
        shown[place..place + run.len()].fill(true);
        start = place + run.len();
    }
    Some(shown)
}

/// Compares output with the book's: all of it, but where a line of `…` stands for some lines, which hides no warning.
pub(crate) fn says(said: &str, wanted: &str) -> Result<(), String> {
    let said: Vec<&str> = said.lines().map(str::trim_end).collect();
    let wanted: Vec<&str> = wanted.lines().map(str::trim_end).collect();
    let Some(shown) = shown(&said, &wanted) else {
        return Err(format!(
            "says something else than\n{}\nnamely\n{}",
            wanted.join("\n"),
            said.join("\n")
        ));
    };
    let hidden = said
        .iter()
        .zip(shown)
        .find(|(line, is_shown)| line.starts_with("warning:") && !is_shown);
    match hidden {
        Some((line, _)) => Err(format!("the output shown hides `{line}`")),
        None => Ok(()),
    }
}

/// How alike a line is to the book's: 3 where it fits, 2 with the same two words at the beginning, 1 with one.
fn likeness(line: &str, wanted: &str) -> usize {
    let equal = line.split_whitespace().zip(wanted.split_whitespace()).take(2);
    if fits(line, wanted) {
        3
    } else {
        equal.take_while(|(a, b)| a == b).count()
    }
}

/// The book's output with the lines that are said now: those that fit stay as they are, with their `…`, and warnings are
/// added. What was a line of `…` alone becomes all that is said.
pub(crate) fn updated(said: &str, wanted: &str) -> String {
    let said: Vec<&str> = said.lines().map(str::trim_end).collect();
    let wanted: Vec<&str> = wanted.lines().map(str::trim_end).collect();
    let runs: Vec<&[&str]> = wanted
        .split(|line| *line == "…")
        .filter(|run| !run.is_empty())
        .collect();
    let mut kept: Vec<Option<&str>> = vec![None; said.len()];
    let mut start = 0;
    for run in &runs {
        let places = start..=said.len().saturating_sub(run.len()).max(start);
        let value = |place: usize| {
            let pairs = run.iter().zip(said.get(place..).unwrap_or_default());
            pairs.map(|(wanted, line)| likeness(line, wanted)).sum::<usize>()
        };
        // The first of the best.
        let place = places.rev().max_by_key(|&place| value(place)).unwrap_or(start);
        for (wanted, (line, kept)) in run.iter().zip(said.iter().zip(&mut kept).skip(place)) {
            *kept = Some(if fits(line, wanted) { wanted } else { line });
        }
        start = (place + run.len()).min(said.len());
    }
    for (line, kept) in said.iter().zip(&mut kept) {
        if runs.is_empty() || line.starts_with("warning:") {
            kept.get_or_insert(line);
        }
    }
    let mut text = String::new();
    let mut is_gap = false;
    for line in kept {
        match line {
            Some(line) => text += &format!("{line}\n"),
            None if !is_gap => text += "…\n",
            None => {}
        }
        is_gap = line.is_none();
    }
    text
}

/// The pixels of a picture, and its size.
fn pixels(path: &Path) -> Result<((u32, u32), Vec<u8>), String> {
    let at = |what: String| format!("`{}`: {what}", path.display());
    let file = File::open(path).map_err(|error| at(error.to_string()))?;
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .map_err(|error| at(error.to_string()))?;
    let mut pixels = vec![0; reader.output_buffer_size().ok_or("a picture that is too large")?];
    let info = reader.next_frame(&mut pixels).map_err(|error| at(error.to_string()))?;
    Ok(((info.width, info.height), pixels))
}

/// Compares two pictures: curves and letters may differ by roundings.
pub(crate) fn same_picture(found: &Path, wanted: &Path) -> Result<(), String> {
    let (found_pixels, wanted_pixels) = (pixels(found)?, pixels(wanted)?);
    let what = format!("`{}` is not what the page's commands make", wanted.display());
    if found_pixels.0 != wanted_pixels.0 || found_pixels.1.len() != wanted_pixels.1.len() {
        return Err(format!("{what}: {:?}, not {:?}", found_pixels.0, wanted_pixels.0));
    }
    let pairs = found_pixels.1.iter().zip(&wanted_pixels.1);
    let off: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    let mean = off as f64 / found_pixels.1.len() as f64;
    if mean > 0.5 {
        Err(format!("{what}: {mean:.2} of 255 off on average"))
    } else {
        Ok(())
    }
}
