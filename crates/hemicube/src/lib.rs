//! Form-factor (view-factor) matrices by the hemicube method.
//!
//! F_ij is the fraction of the diffuse energy leaving patch i that reaches patch j directly. A hemicube is put on each
//! patch, the scene's patch ids are rendered onto its five faces, and the delta form factors of the pixels that each
//! patch covers add up to one row of F (Cohen & Greenberg 1985).
//!
//! A run is a [`driver::job::Job`]: from a scene to a store, here with form factors between the scene's objects. The
//! renderer is a crate of its own: here `hemicube-backend-cpu`, otherwise a plugin loaded by `hemicube-host`, or a
//! [`backend::HemicubeBackend`] of yours.
//!
//! ```
//! use hemicube::analysis::zones::{GroupBy, zones};
//! use hemicube::driver::{input::SceneInput, job::Job, job::Sessions};
//! use hemicube_backend_cpu::CpuBackend;
//! use hemicube_scene::{Subdivision, generate};
//! # let folder = tempfile::tempdir()?;
//! # let directory = folder.path().join("room.hemicube");
//!
//! let scene = generate::cornell_box(); // `hemicube_scene::load` reads files
//! let scene = SceneInput::new(scene, "room.obj", Subdivision::Split(2).into())?;
//! let (model, job) = (scene.model(Default::default())?, Job::default().with_tolerance(0.05));
//! let store = job.store(&scene, &model, Sessions::new(CpuBackend::new), &directory)?;
//!
//! for zone in zones(&store, GroupBy::Object)? {
//!     let sum: f64 = zone.factors.iter().map(|&(_to, factor)| factor).sum();
//!     let all = sum + zone.escaped + zone.blocked;
//!     assert!((all - 1.0).abs() < 0.05, "the energy that leaves {} ends somewhere: {all}", zone.name);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod accuracy;
pub mod diagnose;
pub mod driver;
pub mod factor;
pub mod frame;
mod geometry;
mod model;
pub mod points;
pub mod portal;
pub mod reference;
mod sampling;
mod simd;
pub mod sky;
mod steps;
mod visibility;

pub use hemicube_contract::{backend, bvh, close, delta, escaped, face, outline, row};
pub use hemicube_scene::InputPatch;
pub use hemicube_solve::{analysis, groups, solve};
pub use hemicube_store::{self as store, Grouping, PatchKind};
pub use model::{HierarchyOptions, Model, ModelError};
