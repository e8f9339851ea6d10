//! What the GPU backends share: the shaders, and the host's side of them that knows no graphics API.
//!
//! A hemicube goes through these stages, one WGSL file each (`wgsl/`), which naga translates to SPIR-V and GLSL
//! (`generated/`, committed; `tests/generated.rs` translates again and compares, `BLESS=1` writes):
//!
//! ```text
//! cull_seen ▶ render (depths of what was seen lately) ▶ pyramid_of ▶ cull_hidden ▶ render (ids) ▶ reduce ▶ tiny ▶ compact ▶ cover ▶ pack
//! ```
//!
//! The first three only with occlusion culling, `tiny` and `cover` only with covered weights. With [`Edges::Exact`],
//! ids tell backs that block apart, and `reduce_sides ▶ near_edges ▶ settle ▶ put_settled` stands for `reduce`: pixels
//! whose centres an edge passes are given to the triangle that they lie in, as drivers do not quite; and `take_back`
//! comes after `cover`. The ids are drawn by one list of indirect draws in the order of [`Upload::chunks`], into a
//! cleared depth buffer that the nearer wins, so that a row does not depend on what was culled: of equal depths, the
//! first drawn stays.
//!
//! A *layer* is a place for a hemicube in the images; a *slot* its place in a submission. Bindings are the same in all
//! stages: [`stage::binding`].
//!
//! No reuse of the occluders' depths for the ids on GPUs, because then ids would hang on two pipelines computing the
//! same bits. Ids are drawn into a cleared buffer, always in the octree's order, so that of equal depths the first
//! stays whatever was culled.
//!
//! No vertex of its own for each corner on GPUs, because software drivers are slow at vertices: a triangle owns its
//! first corner, which carries its patches, and shares the others, which makes one vertex a triangle instead of three.
//!
//! No exact test of every pixel or fragment on GPUs, because an edge passes the centre of one in a hundred that it
//! crosses, and finding those by walking the edges of what is shown costs less than a test of each: one of fragments in
//! the cover stage made that five times as slow and more on llvmpipe, which runs both branches. What the cover stage
//! counts by the driver's edges is taken back pixel by pixel.
//!
//! Blocking backs are lowered in the fragment shader, because only there the side is known without a vertex of its own
//! for each corner; it costs 5 % on llvmpipe, and without it shared walls are seen from behind at random.

#![forbid(unsafe_code)]

pub mod chunks;
pub mod limits;
pub mod options;
pub mod output;
pub mod recording;
pub mod session;
pub mod stage;
pub mod upload;
pub mod view;

pub use chunks::Chunk;
pub use limits::{Edges, Limits, Plan};
pub use recording::{Action, Cull, Goal, Phase, Recording, Step};
pub use upload::Upload;
pub use view::{View, views};
