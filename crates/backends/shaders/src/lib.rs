//! What the GPU backends share: the shaders, and the host's side of them that knows no graphics API.
//!
//! A hemicube goes through these stages, one WGSL file each (`wgsl/`), which naga translates to SPIR-V and GLSL (`generated/`,
//! committed; `tests/generated.rs` translates again and compares, `BLESS=1` writes):
//!
//! ```text
//! cull_seen ▶ render (depths of what was seen lately) ▶ pyramid_of ▶ cull_hidden ▶ render (ids) ▶ reduce ▶ tiny ▶ compact ▶ cover ▶ pack
//! ```
//!
//! The first three only with occlusion culling, `tiny` and `cover` only with covered weights. With [`Edges::Exact`], ids tell
//! backs that block apart, and `reduce_sides ▶ near_edges ▶ settle ▶ put_settled` stands for `reduce`: pixels whose centres an
//! edge passes are given to the triangle that they lie in, as drivers do not quite; and `take_back` comes after `cover`. The ids are drawn by one list
//! of indirect draws in the order of [`Upload::chunks`], into a cleared depth buffer that the nearer wins, so that a row does
//! not depend on what was culled: of equal depths, the first drawn stays.
//!
//! A *layer* is a place for a hemicube in the images; a *slot* its place in a submission. Bindings are the same in all
//! stages: [`stage::binding`].

#![forbid(unsafe_code)]

pub mod chunks;
pub mod limits;
pub mod output;
pub mod stage;
pub mod upload;
pub mod view;

pub use chunks::Chunk;
pub use limits::{Edges, Limits, Plan};
pub use upload::Upload;
pub use view::{View, views};
