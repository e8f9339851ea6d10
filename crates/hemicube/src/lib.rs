//! Form-factor (view-factor) matrices by the hemicube method.
//!
//! F_ij is the fraction of the diffuse energy leaving patch i that reaches patch j directly. A hemicube is put on each
//! patch, the scene's patch ids are rendered onto its five faces, and the delta form factors of the pixels that each
//! patch covers add up to one row of F (Cohen & Greenberg 1985).
//!
//! From a scene to a row on the disk. What renders is a crate of its own: here `hemicube-backend-cpu`, otherwise a
//! plugin that `hemicube-host` loads, or a [`backend::HemicubeBackend`] of yours.
//!
//! ```
//! use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
//! use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
//! use hemicube::store::{PatchTable, Store, StoreWriter};
//! use hemicube::{HierarchyOptions, InputPatch, Model};
//! use hemicube_backend_cpu::CpuBackend;
//! use hemicube_scene::{Patches, Subdivision, generate};
//! # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
//! # let folder = tempfile::tempdir()?;
//! # let directory = folder.path().join("room.hemicube");
//!
//! let scene = generate::cornell_box(); // `hemicube_scene::load` reads files
//! let patches = Patches::new(&scene, Subdivision::Split(2))?;
//! let model = Model::new(patches.into(), HierarchyOptions::default())?;
//! let plan = Plan::new(&model, RowChoice::All, Selection::default(), 1, true);
//! let backend = CpuBackend::new();
//! # let settings = room::settings(&plan.correction);
//!
//! // `settings` are `settings::RowSettings`: what rows depend on, for whoever reads the store.
//! let header = settings.header(&scene, model.patches(), "room.obj".as_ref(), &plan, backend.info())?;
//! let table = PatchTable::new(&scene, model.patches());
//! let mut writer = StoreWriter::create(&directory, header, &table, false)?;
//! let render = RenderSettings { resolution: 64, culling: Culling::On, covered: false };
//! compute(&model, &plan, render, Box::new(backend), Execution::default(), &mut writer, &mut |_| {})?;
//! writer.finish()?;
//!
//! let store = Store::open(&directory)?;
//! let row = store.row(InputPatch(32))?.ok_or("row 32 was not computed")?; // of the ceiling
//! let sum: f32 = row.data.iter().sum();
//! assert!((sum - 1.0).abs() < 1e-5, "the room is closed: all that leaves the ceiling arrives somewhere");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod accuracy;
pub mod analysis;
pub mod diagnose;
pub mod driver;
pub mod factor;
pub mod frame;
mod geometry;
mod model;
pub mod reference;
mod sampling;
mod simd;
pub mod sky;
pub mod solve;
pub mod store;
mod visibility;

pub use hemicube_contract::{backend, bvh, delta, face, outline, row};
pub use hemicube_scene::InputPatch;
pub use model::{HierarchyOptions, Model, ModelError};
