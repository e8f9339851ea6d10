//! The folders searched for backends, in order.
//!
//! A folder given, each folder of `HEMICUBE_BACKEND_PATH`, `backends` beside the program, the program's own folder
//! (for backends asked for by name), `../lib/hemicube/backends` from there, the user's data folder, the system's. Not
//! recursive.
//!
//! No manifest, because the file's name says it all. With raised privileges, folders chosen by the program's caller are
//! left out.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

/// The variable with further folders, separated like those of `PATH`.
pub const PATH_VARIABLE: &str = "HEMICUBE_BACKEND_PATH";

const FILE_STEM: &str = "hemicube_backend_";

/// Returns the file name of a backend on this platform.
///
/// ```
/// use hemicube_host::{file_name, name_of_file};
/// assert_eq!(name_of_file(&file_name("my-backend")).as_deref(), Some("my-backend"));
/// assert_eq!(name_of_file("README.md"), None);
/// # #[cfg(target_os = "linux")]
/// assert_eq!(file_name("my-backend"), "libhemicube_backend_my_backend.so");
/// ```
pub fn file_name(name: &str) -> String {
    format!("{DLL_PREFIX}{FILE_STEM}{}{DLL_SUFFIX}", name.replace('-', "_"))
}

/// Returns the name of the backend expected in a file of this name, if any.
pub fn name_of_file(file: &str) -> Option<String> {
    let stem = file.strip_prefix(DLL_PREFIX)?.strip_suffix(DLL_SUFFIX)?;
    let name = stem.strip_prefix(FILE_STEM)?;
    (!name.is_empty()).then(|| name.replace('_', "-"))
}

/// The source of a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Given by the caller.
    Given,
    /// `HEMICUBE_BACKEND_PATH`.
    Variable,
    /// Beside the program, in a folder for backends.
    Program,
    /// The program's own folder, as of a build. Backends there are opened by name, and never by `auto`.
    Build,
    /// The user's data folder.
    User,
    /// The system's library folder.
    System,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Given => "given",
            Self::Variable => PATH_VARIABLE,
            Self::Program => "beside the program",
            Self::Build => "the program's folder",
            Self::User => "user",
            Self::System => "system",
        })
    }
}

/// A folder to search.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder {
    /// Its path.
    pub path: PathBuf,
    /// Its source.
    pub origin: Origin,
}

/// The inputs of the search, so that tests can choose them.
#[derive(Clone, Debug, Default)]
pub struct Environment {
    /// The running program.
    pub program: Option<PathBuf>,
    /// The value of [`PATH_VARIABLE`].
    pub path_variable: Option<OsString>,
    /// The folder of the user's data.
    pub user_data: Option<PathBuf>,
    /// Folders of libraries.
    pub system: Vec<PathBuf>,
    /// True if the program has privileges beyond its caller's.
    pub raised: bool,
}

impl Environment {
    /// Reads the environment of this process.
    pub fn of_process() -> Self {
        let folder = |variable: &str| {
            std::env::var_os(variable)
                .filter(|value| !value.is_empty())
                .map(PathBuf::from)
        };
        let user_data = if cfg!(windows) {
            folder("LOCALAPPDATA")
        } else {
            folder("XDG_DATA_HOME").or_else(|| folder("HOME").map(|home| home.join(".local/share")))
        };
        let system: &[&str] = if cfg!(windows) {
            &[]
        } else {
            &["/usr/local/lib", "/usr/lib"]
        };
        Self {
            program: std::env::current_exe().ok(),
            path_variable: std::env::var_os(PATH_VARIABLE),
            user_data,
            system: system.iter().map(PathBuf::from).collect(),
            raised: is_raised(),
        }
    }
}

/// Returns true if the process has rights beyond its caller's (set-user-id, file capabilities).
#[cfg(unix)]
fn is_raised() -> bool {
    #[cfg(any(target_os = "linux", target_os = "android"))]
    {
        // SAFETY: reads a number given to the process by the kernel.
        if unsafe { libc::getauxval(libc::AT_SECURE) } != 0 {
            return true;
        }
    }
    // SAFETY: these only ask for numbers, and cannot fail.
    unsafe { libc::getuid() != libc::geteuid() || libc::getgid() != libc::getegid() }
}

#[cfg(not(unix))]
fn is_raised() -> bool {
    false
}

/// The folders searched for backends.
///
/// ```
/// use hemicube_host::{Environment, Origin, Search};
/// use std::path::PathBuf;
///
/// let environment = Environment { program: Some("/opt/bin/hemicube".into()), ..Environment::default() };
/// let origins = |environment| -> Vec<Origin> {
///     let search = Search::new(&[PathBuf::from("/home/ann/backends")], environment);
///     search.folders().iter().map(|folder| folder.origin).collect()
/// };
/// assert_eq!(origins(&environment), [Origin::Given, Origin::Program, Origin::Build, Origin::Program]);
///
/// // A program with raised privileges loads nothing put there by others.
/// let raised = Environment { raised: true, ..environment.clone() };
/// assert_eq!(origins(&raised), [Origin::Program, Origin::Build, Origin::Program]);
/// ```
#[derive(Clone, Debug)]
pub struct Search {
    folders: Vec<Folder>,
    raised: bool,
}

impl Search {
    /// Lists the folders of an environment, after those given.
    pub fn new(given: &[PathBuf], environment: &Environment) -> Self {
        let mut folders: Vec<Folder> = Vec::new();
        let mut add = |path: PathBuf, origin| {
            let path = std::path::absolute(&path).unwrap_or(path);
            if folders.iter().all(|folder| folder.path != path) {
                folders.push(Folder { path, origin });
            }
        };
        if !environment.raised {
            for path in given {
                add(path.clone(), Origin::Given);
            }
            for path in environment.path_variable.iter().flat_map(std::env::split_paths) {
                // An empty entry would be the working directory, never intended.
                if !path.as_os_str().is_empty() {
                    add(path, Origin::Variable);
                }
            }
        }
        if let Some(beside) = environment.program.as_deref().and_then(Path::parent) {
            add(beside.join("backends"), Origin::Program);
            add(beside.to_owned(), Origin::Build);
            if let Some(prefix) = beside.parent() {
                add(prefix.join("lib/hemicube/backends"), Origin::Program);
            }
        }
        if !environment.raised
            && let Some(data) = &environment.user_data
        {
            add(data.join("hemicube/backends"), Origin::User);
        }
        for path in &environment.system {
            add(path.join("hemicube/backends"), Origin::System);
        }
        Self {
            folders,
            raised: environment.raised,
        }
    }

    /// The folders in order of search.
    pub fn folders(&self) -> &[Folder] {
        &self.folders
    }

    /// Returns true if the process has raised privileges, so that only fixed folders are searched.
    pub fn is_raised(&self) -> bool {
        self.raised
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment() -> Environment {
        Environment {
            program: Some("/opt/hemicube/bin/hemicube".into()),
            path_variable: Some(std::env::join_paths(["/a", "", "/b", "/a"]).expect("plain paths")),
            user_data: Some("/home/u/.local/share".into()),
            system: vec!["/usr/lib".into()],
            raised: false,
        }
    }

    fn paths(search: &Search) -> Vec<String> {
        search
            .folders()
            .iter()
            .map(|folder| folder.path.display().to_string())
            .collect()
    }

    #[test]
    #[cfg(unix)]
    fn folders_are_in_order_and_not_twice() {
        let search = Search::new(&["/mine".into(), "/b".into()], &environment());
        assert_eq!(
            paths(&search),
            [
                "/mine",
                "/b",
                "/a",
                "/opt/hemicube/bin/backends",
                "/opt/hemicube/bin",
                "/opt/hemicube/lib/hemicube/backends",
                "/home/u/.local/share/hemicube/backends",
                "/usr/lib/hemicube/backends",
            ]
        );
        assert_eq!(search.folders()[1].origin, Origin::Given);
    }

    #[test]
    #[cfg(unix)]
    fn with_raised_privileges_nothing_is_the_users_choice() {
        let raised = Environment {
            raised: true,
            ..environment()
        };
        assert_eq!(
            paths(&Search::new(&["/mine".into()], &raised)),
            [
                "/opt/hemicube/bin/backends",
                "/opt/hemicube/bin",
                "/opt/hemicube/lib/hemicube/backends",
                "/usr/lib/hemicube/backends",
            ]
        );
    }

    #[test]
    fn names_and_files() {
        let file = file_name("rust-minimal");
        assert!(file.contains("hemicube_backend_rust_minimal"), "{file}");
        assert_eq!(name_of_file(&file).as_deref(), Some("rust-minimal"));
        for other in ["libm.so", "hemicube_backend_x.txt", "readme"] {
            assert_eq!(name_of_file(other), None, "{other}");
        }
        assert_eq!(name_of_file(&file_name("")), None);
    }
}
