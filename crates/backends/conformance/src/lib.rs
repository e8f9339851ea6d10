//! What every backend must show, over any session of it: the rules of the [contract](hemicube::backend), the same rows
//! whatever the batches, culling on and off, and nearness to a reference.
//!
//! A [`Case`] is a check on a scene. What a backend does not claim is reported as [`Outcome::NotClaimed`], never as
//! held. Every comparator of [`compare`] is shown refusing doctored input by a test.
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
pub mod scenes;

pub use cases::{Case, Check, Outcome, cases, run};
