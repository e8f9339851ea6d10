//! The common part of the GPU backends: shaders, and host code free of any graphics API.
//!
//! A hemicube goes through these stages, one WGSL file each (`wgsl/`). naga translates them to SPIR-V and GLSL
//! (`generated/`, committed; `tests/generated.rs` translates again and compares, `BLESS=1` writes):
//!
//! ```text
//! cull_seen ▶ render (depths of chunks seen lately) ▶ pyramid_of ▶ cull_hidden
//!           ▶ render (ids) ▶ reduce ▶ tiny ▶ compact ▶ cover ▶ pack
//! ```
//!
//! [`recording`] lists them as data. The first line needs occlusion culling, `tiny` and `cover` need covered weights.
//! With [`Edges::Exact`], ids tell blocking backs apart, `reduce_sides ▶ near_edges ▶ settle ▶ put_settled` replace
//! `reduce`, and `take_back` follows `cover`: a pixel centre near an edge goes to the triangle containing it, not to
//! the driver's choice.
//!
//! With [`Draw::Compute`] no rasteriser is asked: `draw_tiles ▶ compact ▶ pack` make a row, and with covered weights
//! `keep_tiles ▶ tiny_of_all ▶ compact ▶ cover_tiles ▶ pack`. Each thread owns pixels of a tile and keeps the nearest
//! triangle, of equally near ones the smaller id, so that any order gives the same row. Passes are drawn.
//!
//! Rays go through one stage, `cast_rays` ([`rays`]), with a tree of their own.
//!
//! Ids are drawn by one list of indirect draws, in the order of [`Upload::chunks`], into a cleared depth buffer. The
//! nearer depth wins; of equal depths the first drawn stays. A row therefore does not depend on culling.
//!
//! A *layer* is a hemicube's place in the images, a *slot* its place in a submission. All stages share their bindings:
//! [`stage::binding`].
//!
//! No reuse of the occluders' depths for the ids, because ids would then depend on two pipelines computing the same
//! bits.
//!
//! No vertex for each corner of each triangle, because software drivers are slow at vertices. A triangle owns its first
//! corner, which carries its patches, and shares the others: one vertex a triangle instead of three.
//!
//! No exact test of every pixel or fragment, because an edge passes through the centre of only one in a hundred of the
//! pixels it crosses. Walking the edges of visible triangles finds these for less than a test of each: testing
//! fragments in the cover stage made it five times slower and more on llvmpipe, which runs both branches. The cover
//! stage counts by the driver's edges, and `take_back` corrects the difference pixel by pixel.
//!
//! Blocking backs are lowered in the fragment shader, because a vertex shared by triangles cannot know the side. It
//! costs 5 % on llvmpipe; without it, shared walls are seen from behind at random.

#![forbid(unsafe_code)]

pub mod chunks;
pub mod limits;
pub mod options;
pub mod output;
pub mod pass;
pub mod probe;
pub mod rays;
pub mod recording;
pub mod session;
pub mod stage;
pub mod upload;
pub mod view;

pub use chunks::Chunk;
pub use limits::{Draw, Edges, Limits, OfStage, Plan};
pub use recording::{Action, Cull, Goal, Phase, Recording, Step};
pub use upload::Upload;
pub use view::{View, views};
