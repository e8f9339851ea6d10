//! A page's blocks, run in their order in a folder of their own, from which the repository is in reach by the paths
//! that the book uses: `hemicube` and `./run` are the program, `cargo run --example` what is built already.

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
case " $* " in *" --manifest-path "*) exec env PATH="$PATH_OF_CARGO" cargo "${words[@]}" ;; esac
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
        for name in ["crates", "examples", "scripts"] {
            symlink(workspace().join(name), place.path(name)).expect("a link");
        }
        // As what embeds the crates would find them beside it.
        symlink(workspace(), place.path("hemicube")).expect("a link");
        symlink(program(), place.path("run")).expect("a link");
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

    /// Runs a page after the lines of bash that make what it takes for granted.
    ///
    /// # Errors
    /// The first block that fails, or says something else than stands there.
    pub(crate) fn page(&self, page: &Page, given: &str, extent: Extent) -> Result<(), String> {
        let (said, status) = self.bash(given, TIME_LIMIT, &[]);
        if !status.is_some_and(|status| status.success()) {
            return Err(format!("{}: what it takes for granted: {said}", page.name));
        }
        let mut last: Option<String> = None;
        for block in page.blocks() {
            let at = |what: String| format!("{}:{}: {what}\n{}", page.name, block.line, block.text);
            if block.is("output") {
                if let Some(said) = &last {
                    says(said, &block.text).map_err(at)?;
                }
                continue;
            }
            last = self.block(&block, extent).map_err(at)?;
        }
        Ok(())
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

/// Finds lines in the output: one directly after the other, but where a line of `…` is between them.
pub(crate) fn says(said: &str, wanted: &str) -> Result<(), String> {
    let said: Vec<&str> = said.lines().map(str::trim_end).collect();
    let wanted: Vec<&str> = wanted.lines().map(str::trim_end).collect();
    let mut rest = said.as_slice();
    for run in wanted.split(|line| *line == "…").filter(|run| !run.is_empty()) {
        let place = rest
            .windows(run.len())
            .position(|lines| lines.iter().zip(run).all(|(line, wanted)| fits(line, wanted)));
        let Some(place) = place else {
            return Err(format!(
                "says something else than\n{}\nnamely\n{}",
                run.join("\n"),
                said.join("\n")
            ));
        };
        rest = &rest[place + run.len()..];
    }
    Ok(())
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
