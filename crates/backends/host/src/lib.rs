//! Backends that are shared libraries: where they are looked for, what is demanded of them, and sessions on them.
//!
//! A [`LoadedBackend`] is the same [`HemicubeBackend`](hemicube_contract::backend::HemicubeBackend) that the built-in
//! one is. What it returns was checked row by row, also in release builds; a session that failed for good is closed at
//! once and never called again; and a plugin that writes past the end of an array ends the process before anything
//! wrong is kept. What cannot be caught in one process (a crash, a hang) is what `hemicube backends check` runs child
//! processes for.
//!
//! Libraries are never unloaded: drivers leave threads and thread-local destructors behind.
//!
//! A program asks for a backend by name, by path, or for the best that there is, and is told why where there is none:
//!
//! ```
//! use hemicube_host::{Environment, OpenError, Options, Registry, Search};
//! # let folder = tempfile::tempdir()?;
//! # let given = folder.path().join("backends");
//! # std::fs::create_dir(&given)?;
//!
//! // `Environment::of_process()` in a program; an empty one here, so that nothing but the folder given is looked into.
//! let search = Search::new(&[given.clone()], &Environment::default());
//! let registry = Registry::new(search, &["cpu"]);
//! let options = Options::parse(&["device=0"])?;
//!
//! let error = registry.open("vulkan", &options).expect_err("the folder is empty");
//! let OpenError::NotFound { name, tried } = error else { panic!("{error}") };
//! assert_eq!((&*name, tried.len(), &*tried[0].reason), ("vulkan", 1, "no such file"));
//! assert!(tried[0].path.starts_with(&given));
//!
//! // `auto` goes on without: what is built in is what is left.
//! let auto = registry.auto(&options);
//! assert!(auto.taken.is_none());
//! assert!(auto.passed_over.iter().all(|over| !over.installed && over.reason == "not installed"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! No unloading of plugins, because drivers leave threads and thread-local destructors behind.
//!
//! No manifests of plugins, because a file's name and its table say all there is, and a manifest can be wrong.

mod discover;
#[cfg(unix)]
mod image;
mod load;
mod loaded;
mod registry;

pub use discover::{Environment, Folder, Origin, PATH_VARIABLE, Search, file_name, name_of_file};
pub use hemicube_abi::{Device, DeviceKind};
pub use load::{Library, LoadError};
pub use loaded::LoadedBackend;
pub use registry::{Auto, Listed, OpenError, Options, PassedOver, Registry, State, Tried};
