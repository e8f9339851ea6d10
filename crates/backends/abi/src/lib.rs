//! The C ABI of hemicube backends loaded at run time, and its safe side for authors in Rust.
//!
//! A plugin is a shared library with one exported table, [`HcBackend`]. In C it is written against
//! `include/hemicube_backend.h`, generated from [`types`]. In Rust, [`export_backend!`] makes it of a [`Plugin`]. The
//! plugin's sessions implement [`HemicubeBackend`](contract::backend::HemicubeBackend), like the built-in backend; the
//! author's crate can forbid `unsafe`:
//!
//! ```
//! #![forbid(unsafe_code)]
//! use hemicube_abi::contract::{backend::*, row::RowBlock};
//! use hemicube_abi::{Device, DeviceKind, Log, Options, Plugin, export_backend};
//! use std::{ffi::CStr, sync::Arc};
//!
//! /// Sees nothing in any scene.
//! struct Blind(BackendInfo);
//!
//! impl Plugin for Blind {
//!     const NAME: &'static CStr = c"blind";
//!     const VERSION: &'static CStr = c"1";
//!     type Session = Self;
//!
//!     fn devices() -> Result<Vec<Device>, BackendError> {
//!         let (name, kind) = ("nothing at all".to_owned(), DeviceKind::Software);
//!         let capabilities = Capabilities::default();
//!         Ok(vec![Device { name, kind, capabilities, max_resolution: 1024, preferred_rows: 1 }])
//!     }
//!
//!     fn open(device: u32, options: &str, _log: Log) -> Result<Self, BackendError> {
//!         Options::parse(options)?.finish()?;
//!         Ok(Self(Self::devices()?[device as usize].info::<Self>()))
//!     }
//! }
//!
//! impl HemicubeBackend for Blind {
//!     fn info(&self) -> &BackendInfo {
//!         &self.0
//!     }
//!
//!     fn load(&mut self, _: &Arc<Geometry>, _: RenderSettings) -> Result<(), BackendError> {
//!         Ok(())
//!     }
//!
//!     // Never called through the table: the host opens another session instead.
//!     fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
//!         Ok(Box::new(Self(self.0.clone())))
//!     }
//!
//!     fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
//!         hemicubes.iter().for_each(|_| out.end_row(WHOLE, 0));
//!         Ok(Counters::default())
//!     }
//! }
//!
//! export_backend!(Blind);
//! # fn main() { assert_eq!(hemicube_backend.abi_version, hemicube_abi::types::HC_ABI_VERSION) }
//! ```
//!
//! The package is a `cdylib` called `hemicube_backend_NAME` (`_` for `-`), built with `panic = "unwind"`; the macro
//! insists on that.
//!
//! No allocation across the boundary and no callback but the log, because nothing can then be freed by the wrong side,
//! nor called in an unforeseen state.

mod adapter;
mod options;
mod panics;
mod plugin;
pub mod types;

pub use adapter::{CHOICES_SIZE, table};
pub use hemicube_contract as contract;
pub use options::Options;
pub use plugin::{Device, DeviceKind, Log, Plugin, capabilities_from_raw, capabilities_to_raw};
pub use types::HcBackend;

/// The header for plugins in C.
pub const C_HEADER: &str = include_str!("../include/hemicube_backend.h");

/// Exports the table of a [`Plugin`] under the name `hemicube_backend`.
///
/// Use it once in a linked image: two would be one symbol twice. A crate linked as an `rlib`, too, for its tests, must
/// not be linked together with another such crate; tests of several plugins at once load them, like the program.
#[macro_export]
macro_rules! export_backend {
    ($plugin:ty) => {
        #[cfg(not(panic = "unwind"))]
        compile_error!("a hemicube backend must be built with `panic = \"unwind\"`: the host must survive its panics");

        /// The table for the host.
        #[allow(non_upper_case_globals, reason = "the name is part of the ABI")]
        #[unsafe(no_mangle)]
        pub static hemicube_backend: $crate::HcBackend = $crate::table::<$plugin>();
    };
}
