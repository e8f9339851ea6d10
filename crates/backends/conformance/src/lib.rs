//! The conformance of backends, over any session: the rules of the [contract](hemicube::backend), equal rows in any
//! batches, with culling on and off, and nearness to a reference.
//!
//! A [`Case`] is a check on a scene. A capability not claimed by the backend is reported [`Outcome::NotClaimed`], never
//! held. A test shows every comparator of [`compare`] refusing doctored input.
//!
//! ```
//! use hemicube_backend_cpu::CpuBackend;
//! use hemicube_conformance::{Case, Outcome, cases, run};
//!
//! let case = "empty-room/unoccluded".parse::<Case>()?;
//! let outcome = run(case, &mut CpuBackend::new(), &mut CpuBackend::new());
//! assert!(matches!(outcome, Outcome::Held(_)), "{outcome:?}");
//! assert!(cases().contains(&case));
//! # Ok::<(), String>(())
//! ```

mod cases;
pub mod compare;
mod passes;
mod rays;
pub mod scenes;

pub use cases::{Case, Check, Outcome, cases, run};
