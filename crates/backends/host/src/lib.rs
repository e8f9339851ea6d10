//! Backends in shared libraries: finding, loading and judging them, and sessions on them.
//!
//! A [`LoadedBackend`] implements [`HemicubeBackend`](hemicube_contract::backend::HemicubeBackend), like the built-in
//! one. The host checks every returned row, also in release builds. It closes a session at once after a fatal failure
//! and never calls it again. A plugin writing past the end of an array ends the process before anything wrong is
//! stored. Crashes and hangs cannot be caught in one process: `hemicube backends check` runs child processes for these.
//!
//! A program asks for a backend by name, by path, or for the best one. A failure names the reason for each place:
//!
//! ```
//! use hemicube_host::{Environment, OpenError, Options, Registry, Search};
//! # let folder = tempfile::tempdir()?;
//! # let given = folder.path().join("backends");
//! # std::fs::create_dir(&given)?;
//!
//! // `Environment::of_process()` in a program; an empty one here, to search the given folder only.
//! let search = Search::new(&[given.clone()], &Environment::default());
//! let registry = Registry::new(search, &["cpu"]);
//! let options = Options::parse(&["device=0"])?;
//!
//! let error = registry.open("vulkan", &options).expect_err("the folder is empty");
//! let OpenError::NotFound { name, tried } = error else { panic!("{error}") };
//! assert_eq!((&*name, tried.len(), &*tried[0].reason), ("vulkan", 1, "no such file"));
//! assert!(tried[0].path.starts_with(&given));
//!
//! // `auto` goes on without a plugin: the built-in backend is left.
//! let auto = registry.auto(&options, 2);
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
pub use hemicube_abi::{C_HEADER, Device, DeviceKind};
pub use load::{Library, LoadError, OPENS_LIBRARIES};
pub use loaded::LoadedBackend;
pub use registry::{Auto, Listed, OpenError, Options, PassedOver, Registry, State, Tried};
