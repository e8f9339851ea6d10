//! Plugins to load: the ones in Rust from Cargo, the ones in C built by `cc` here.
//!
//! The Rust ones are members of the workspace and lie beside the program, `target/release/libhemicube_backend_NAME.so`;
//! `./test`, or `cargo build --release --workspace`, builds them.

use hemicube_host::{Environment, Library, LoadedBackend, Options, Registry, Search, file_name};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use tempfile::TempDir;

/// A plugin of the workspace.
///
/// # Panics
/// When it was not built.
pub fn rust(name: &str) -> PathBuf {
    let path = super::scenes::profile_folder().join(file_name(name));
    assert!(
        path.is_file(),
        "`{}` is missing: run `cargo build --release --workspace` first",
        path.display()
    );
    path
}

/// The folder of plugins' sources.
pub fn sources() -> PathBuf {
    super::scenes::workspace().join("tests/plugins")
}

/// A plugin in C: `source` beneath the folder of sources, built into `folder` as the backend `name`, with macros.
///
/// # Panics
/// When `cc` cannot be run or refuses it.
pub fn c(source: &str, folder: &Path, name: &str, macros: &[&str]) -> PathBuf {
    c_with(source, folder, name, macros, &[])
}

/// Likewise, linked with something else.
///
/// # Panics
/// As [`c`].
pub fn c_with(source: &str, folder: &Path, name: &str, macros: &[&str], linked: &[&str]) -> PathBuf {
    let path = folder.join(file_name(name));
    let output = Command::new("cc")
        .args([
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-pedantic",
            "-Werror",
            "-O2",
            "-shared",
            "-fPIC",
        ])
        .args(macros.iter().map(|word| format!("-D{word}")))
        .arg("-I")
        .arg(super::scenes::workspace().join("crates/backends/abi/include"))
        .arg(sources().join(source))
        .args(linked)
        .arg("-o")
        .arg(&path)
        .output()
        .unwrap_or_else(|error| panic!("`cc` cannot be run: {error}; install gcc"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    path
}

/// The smallest plugin in C, in a folder of its own.
///
/// # Panics
/// As [`c`].
pub fn c_minimal() -> (TempDir, PathBuf) {
    let place = tempfile::tempdir().expect("a temporary directory");
    let path = c("c_minimal/backend.c", place.path(), "c-minimal", &[]);
    (place, path)
}

/// A session of the plugin in a file.
///
/// # Panics
/// When it does not open.
pub fn session(path: &Path, options: &[&str]) -> LoadedBackend {
    try_session(path, options).unwrap_or_else(|error| panic!("{error}"))
}

/// Likewise, or the reason why not.
///
/// # Errors
/// The host's reason.
///
/// # Panics
/// When the options are not of the right form.
pub fn try_session(path: &Path, options: &[&str]) -> Result<LoadedBackend, hemicube_host::OpenError> {
    let registry = Registry::new(Search::new(&[], &Environment::default()), &[]);
    let options = Options::parse(options).expect("options of the right form");
    registry.open(path.to_str().expect("a path in UTF-8"), &options)
}

/// The library in a file.
///
/// # Errors
/// The host's reason.
pub fn library(path: &Path) -> Result<Arc<Library>, hemicube_host::LoadError> {
    Library::load(path).map(Arc::new)
}
