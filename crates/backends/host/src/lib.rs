//! Backends that are shared libraries: where they are looked for, what is demanded of them, and sessions on them.
//!
//! A [`LoadedBackend`] is the same [`HemicubeBackend`](hemicube_contract::backend::HemicubeBackend) that the built-in one
//! is. What it returns was checked row by row, also in release builds; a session that failed for good is closed at once and
//! never called again; and a plugin that writes past the end of an array ends the process before anything wrong is kept.
//! What cannot be caught in one process (a crash, a hang) is what `hemicube backends check` runs child processes for.
//!
//! Libraries are never unloaded: drivers leave threads and thread-local destructors behind.

mod discover;
mod load;
mod loaded;
mod registry;

pub use discover::{Environment, Folder, Origin, PATH_VARIABLE, Search, file_name, name_of_file};
pub use hemicube_abi::{Device, DeviceKind};
pub use load::{Library, LoadError};
pub use loaded::LoadedBackend;
pub use registry::{Auto, Listed, OpenError, Options, PassedOver, Registry, State, Tried};
