//! Other programs that open our files.

use crate::scenes::skip;
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::process::Command;

/// A Python with `modules`, or a skip: `HEMICUBE_PYTHON`, otherwise `python3`. `HEMICUBE_REQUIRE_PYTHON=1` makes a
/// failure of it.
///
/// # Panics
/// When the named Python cannot be run, or lacks SciPy: naming one means it.
pub fn python(test: &str, modules: &[&str]) -> Option<OsString> {
    let named = std::env::var_os("HEMICUBE_PYTHON").filter(|program| !program.is_empty());
    let program = named.clone().unwrap_or_else(|| "python3".into());
    let imports = |modules: &[&str]| {
        let code = format!("import {}", modules.join(", "));
        Command::new(&program).args(["-c", &code]).output()
    };
    if named.is_some() {
        match imports(&["numpy", "scipy.sparse", "scipy.io"]) {
            Ok(output) if output.status.success() => {}
            Ok(output) => panic!(
                "`HEMICUBE_PYTHON` has no SciPy: {}",
                String::from_utf8_lossy(&output.stderr)
            ),
            Err(error) => panic!("`HEMICUBE_PYTHON` cannot be run: {error}"),
        }
    }
    if imports(modules).is_ok_and(|output| output.status.success()) {
        return Some(program);
    }
    let reason = format!("no Python with {}", modules.join(", "));
    skip(test, &reason, "HEMICUBE_REQUIRE_PYTHON");
    None
}

/// The folder of Debian's PETSc with petsc4py, for `PETSC_DIR`, by which `/usr/bin/python3` finds it; `None` without
/// it.
pub fn petsc_folder() -> Option<PathBuf> {
    let named = std::env::var_os("PETSC_DIR").map(PathBuf::from);
    let versions = std::fs::read_dir("/usr/lib/petscdir").into_iter().flatten().flatten();
    let builds = versions.flat_map(|version| std::fs::read_dir(version.path()).into_iter().flatten().flatten());
    let mut found: Vec<PathBuf> = named.into_iter().chain(builds.map(|build| build.path())).collect();
    found.retain(|folder| folder.join("lib/python3/dist-packages/petsc4py").is_dir());
    found.sort();
    found.pop()
}

/// Runs a program and parses its JSON.
///
/// # Panics
/// When it cannot be run, fails, or prints something else.
#[track_caller]
pub fn json_of(command: &mut Command) -> Value {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(
        output.status.success(),
        "{command:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

/// Node with a package: `HEMICUBE_NODE_MODULES` is npm's folder of it. A skip without it, and a failure with
/// `HEMICUBE_REQUIRE_NODE=1`.
pub fn node(test: &str, package: &str) -> Option<Command> {
    let modules = std::env::var_os("HEMICUBE_NODE_MODULES").filter(|folder| !folder.is_empty());
    let mut command = Command::new("node");
    if let Some(modules) = &modules {
        command.env("NODE_PATH", modules);
        let found = Command::new("node")
            .env("NODE_PATH", modules)
            .args([OsStr::new("-e"), OsStr::new(&format!("require('{package}')"))])
            .output();
        if found.is_ok_and(|output| output.status.success()) {
            return Some(command);
        }
    }
    let reason = format!("no Node with {package} in `HEMICUBE_NODE_MODULES`");
    skip(test, &reason, "HEMICUBE_REQUIRE_NODE");
    None
}
