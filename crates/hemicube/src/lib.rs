//! Form-factor (view-factor) matrices by the hemicube method.
//!
//! F_ij is the fraction of the diffuse energy leaving patch i that reaches patch j directly. A hemicube is put on each
//! patch, the scene's patch ids are rendered onto its five faces, and the delta form factors of the pixels that each
//! patch covers add up to one row of F (Cohen & Greenberg 1985).

pub mod balance;
mod candidates;
pub mod check;
mod clip;
pub mod compare;
pub mod compute;
pub mod correct;
pub mod diagnose;
pub mod export;
pub mod factor;
pub mod frame;
mod model;
pub mod probe;
mod random;
pub mod reference;
mod refine;
pub mod rung;
pub mod selection;
pub mod settings;
pub mod settle;
mod shaft;
pub mod sky;
pub mod solve;
pub mod store;
pub mod tree;
pub mod zones;

pub use hemicube_contract::{backend, delta, face, outline, row};
pub use hemicube_scene::InputPatch;
pub use model::{HierarchyOptions, Model, ModelError};
