//! The shaders' entry points in WGSL, SPIR-V and GLSL, and the numbers of their bindings.

/// The kind of an entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A vertex shader.
    Vertex,
    /// A fragment shader.
    Fragment,
    /// A compute shader.
    Compute,
}

/// An entry point, translated.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// The WGSL file without its ending.
    pub file: &'static str,
    /// The source of that file after the shared part, for APIs taking WGSL.
    pub wgsl: &'static str,
    /// The entry point's name, in SPIR-V too; in GLSL it is `main`.
    pub entry: &'static str,
    /// Its kind.
    pub kind: Kind,
    /// SPIR-V 1.3, little-endian words.
    pub spirv: &'static [u8],
    /// GLSL 4.50 core. Bindings of uniform and storage blocks and of textures are the numbers of [`binding`].
    pub glsl: &'static str,
    /// Bindings of group 1 that are only read.
    pub reads: &'static [u32],
    /// Bindings of group 1 that may be written.
    pub writes: &'static [u32],
}

impl Stage {
    /// Returns the words of the SPIR-V.
    pub fn words(&self) -> Vec<u32> {
        let (words, _) = self.spirv.as_chunks::<4>();
        words.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect()
    }
}

/// The parts of a file's source, in this order, by their names in `wgsl/`.
pub fn parts(file: &str) -> Vec<&str> {
    match file {
        "settle" | "tiles" | "covered" => vec!["shared", "exact", file],
        _ => vec!["shared", file],
    }
}

macro_rules! source {
    ("settle") => {
        source!("settle" after "exact")
    };
    ("tiles") => {
        source!("tiles" after "exact")
    };
    ("covered") => {
        source!("covered" after "exact")
    };
    ($file:tt $(after $part:tt)?) => {
        concat!(
            include_str!("../wgsl/shared.wgsl"),
            "\n",
            $(include_str!(concat!("../wgsl/", $part, ".wgsl")), "\n",)?
            include_str!(concat!("../wgsl/", $file, ".wgsl"))
        )
    };
}

macro_rules! stages {
    ($(
        $(#[$doc:meta])*
        $name:ident: $file:tt $entry:literal $kind:ident
            reads [$($read:ident)*] writes [$($write:ident)*];
    )*) => {
        $(
            $(#[$doc])*
            pub const $name: Stage = Stage {
                file: $file,
                wgsl: source!($file),
                entry: $entry,
                kind: Kind::$kind,
                spirv: include_bytes!(concat!("../generated/", $entry, ".spv")),
                glsl: include_str!(concat!("../generated/", $entry, ".glsl")),
                reads: &[$(binding::$read),*],
                writes: &[$(binding::$write),*],
            };
        )*
        /// All of them.
        pub const ALL: &[Stage] = &[$($name),*];
    };
}

stages! {
    /// Corners to a face: attributes 0 (high), 1 (low), 2 (patches), 3 (normal) of [`crate::upload::VERTEX_BYTES`].
    RENDER: "render" "render" Vertex
        reads [] writes [];
    /// The id of the side facing the eye.
    IDENTIFY: "render" "identify" Fragment
        reads [SETTINGS] writes [];
    /// [`IDENTIFY`] without the emitter: see [`crate::view::stands_on_emitter`].
    IDENTIFY_OTHERS: "render" "identify_others" Fragment
        reads [SETTINGS] writes [];
    /// [`IDENTIFY`] with blocking backs told apart: for [`crate::Edges::Exact`].
    IDENTIFY_SIDES: "render" "identify_sides" Fragment
        reads [SETTINGS] writes [];
    /// [`IDENTIFY_SIDES`] without the emitter.
    IDENTIFY_OTHER_SIDES: "render" "identify_other_sides" Fragment
        reads [SETTINGS] writes [];
    /// For depths alone, without the emitter.
    OCCLUDE_OTHERS: "render" "occlude_others" Fragment
        reads [] writes [];
    /// [`RENDER`] with heights above a portal's plane, for [`IDENTIFY_THROUGH`].
    THROUGH: "through" "through" Vertex
        reads [] writes [];
    /// [`IDENTIFY`] of what is seen through a portal.
    IDENTIFY_THROUGH: "through" "identify_through" Fragment
        reads [SETTINGS] writes [];
    /// All pixels of an image, for [`PRESET_DEPTHS`]: three corners.
    EVERY_PIXEL: "through" "every_pixel" Vertex
        reads [] writes [];
    /// The first depths of a pass, [`crate::pass::first_depths`] in [`binding::DEPTH_COPY`], for APIs that cannot copy
    /// depths into an image.
    PRESET_DEPTHS: "through" "preset_depths" Fragment
        reads [SETTINGS DEPTH_COPY] writes [];
    /// Groups: resolution / 16, 3 × resolution / 16, layers.
    PYRAMID_OF: "pyramid" "pyramid_of" Compute
        reads [SETTINGS DEPTHS] writes [PYRAMID];
    /// [`PYRAMID_OF`] from the copied depths in [`binding::DEPTH_COPY`].
    PYRAMID_OF_COPY: "pyramid" "pyramid_of_copy" Compute
        reads [SETTINGS DEPTH_COPY] writes [PYRAMID];
    /// Groups: 5, layers.
    CULL_SEEN: "cull" "cull_seen" Compute
        reads [SETTINGS VIEWS CHUNKS PYRAMID SEEN] writes [DRAWS DRAW_COUNTS DRAWN TALLIES];
    /// Groups: 5, layers.
    CULL_HIDDEN: "cull" "cull_hidden" Compute
        reads [SETTINGS VIEWS CHUNKS PYRAMID SEEN] writes [DRAWS DRAW_COUNTS DRAWN TALLIES];
    /// Groups: 5, layers.
    CULL_OUTSIDE: "cull" "cull_outside" Compute
        reads [SETTINGS VIEWS CHUNKS PYRAMID SEEN] writes [DRAWS DRAW_COUNTS DRAWN TALLIES];
    /// Groups: [`crate::Plan::reduce_groups`], layers.
    REDUCE: "reduce" "reduce" Compute
        reads [SETTINGS ITEMS WEIGHTS] writes [VISIBLE TOUCHED];
    /// Groups: [`crate::Plan::tiny_groups`] in x and z, layers in y.
    TINY: "tiny" "tiny" Compute
        reads [SETTINGS VIEWS CHUNKS DEPTHS DRAWN ITEMS VERTICES INDICES TRIANGLE_OF_PATCH CENTROIDS] writes [TOUCHED];
    /// [`TINY`] of all triangles, by depths in [`binding::DEPTH_COPY`]. Groups: any number, layers.
    TINY_OF_ALL: "tiny" "tiny_of_all" Compute
        reads [SETTINGS VIEWS ITEMS VERTICES INDICES TRIANGLE_OF_PATCH CENTROIDS DEPTH_COPY] writes [TOUCHED];
    /// Groups: layers.
    COMPACT: "compact" "compact" Compute
        reads [SETTINGS CHUNK_OF_PATCH] writes [SEEN VISIBLE TOUCHED ENTRIES COVER_DRAWS TOTALS HIDDEN];
    /// Three corners an entry.
    COVER: "cover" "cover" Vertex
        reads [SETTINGS VERTICES INDICES TRIANGLE_OF_PATCH ENTRIES] writes [];
    /// Adds hidden weight.
    ADD_HIDDEN: "cover" "add_hidden" Fragment
        reads [SETTINGS ITEMS WEIGHTS] writes [HIDDEN];
    /// Groups: any number (for bandwidth), layers.
    PACK: "pack" "pack" Compute
        reads [SETTINGS ENTRIES TOTALS HIDDEN] writes [TALLIES OUTPUT];
    /// Replaces [`REDUCE`] with exact edges. Groups: likewise.
    REDUCE_SIDES: "settle" "reduce_sides" Compute
        reads [SETTINGS ITEMS WEIGHTS] writes [NEAR LISTED SIDES];
    /// Groups: [`crate::limits::SETTLE_GROUPS`], layers.
    NEAR_EDGES: "settle" "near_edges" Compute
        reads [SETTINGS VIEWS VERTICES INDICES TRIANGLE_OF_PATCH] writes [VISIBLE TOUCHED NEAR LISTED SIDES];
    /// Groups: [`crate::limits::SETTLE_GROUPS`], layers.
    SETTLE: "settle" "settle" Compute
        reads [SETTINGS VIEWS ITEMS WEIGHTS VERTICES INDICES TRIANGLE_OF_PATCH] writes [VISIBLE TOUCHED NEAR LISTED];
    /// Groups: [`crate::limits::SETTLE_GROUPS`], layers.
    PUT_SETTLED: "settle" "put_settled" Compute
        reads [SETTINGS] writes [VISIBLE TOUCHED NEAR LISTED SETTLED_ITEMS];
    /// Follows [`COVER`] with exact edges. Groups: [`crate::limits::SETTLE_GROUPS`], layers.
    TAKE_BACK: "settle" "take_back" Compute
        reads [SETTINGS WEIGHTS ENTRIES TOTALS] writes [HIDDEN NEAR LISTED];
    /// Draws and reduces with [`crate::Draw::Compute`], for uncovered rows. Groups:
    /// [`crate::Plan::tile_groups`], layers.
    DRAW_TILES: "tiles" "draw_tiles" Compute
        reads [SETTINGS VIEWS CHUNKS WEIGHTS VERTICES INDICES] writes [VISIBLE TOUCHED];
    /// [`DRAW_TILES`] that keeps ids and depths.
    KEEP_TILES: "tiles" "keep_tiles" Compute
        reads [SETTINGS VIEWS CHUNKS WEIGHTS VERTICES INDICES] writes [VISIBLE TOUCHED DEPTH_COPY SETTLED_ITEMS];
    /// [`COVER`] by compute. Groups: any number, layers.
    COVER_TILES: "covered" "cover_tiles" Compute
        reads [SETTINGS VIEWS ITEMS WEIGHTS VERTICES INDICES TRIANGLE_OF_PATCH ENTRIES TOTALS] writes [HIDDEN];
    /// The first surface on each ray, see [`crate::rays`]. Groups: [`crate::rays::groups`].
    CAST_RAYS: "rays" "cast_rays" Compute
        reads [RAY_NODES RAY_TRIANGLES RAYS] writes [MET];
}

/// Binding numbers. [`VIEW`](binding::VIEW) is in group 0, with a dynamic offset; all others are in group 1.
pub mod binding {
    /// Uniform: the [`View`](crate::View) of a draw; for compute stages, face 0 of a group's first slot.
    pub const VIEW: u32 = 0;
    /// Uniform: [`crate::view::settings_words`].
    pub const SETTINGS: u32 = 1;
    /// Storage: the views of all slots, five each.
    pub const VIEWS: u32 = 2;
    /// Storage: [`crate::Upload::chunks`], and runs of them.
    pub const CHUNKS: u32 = 3;
    /// Texture: depths, an array of layers.
    pub const DEPTHS: u32 = 4;
    /// Storage: farthest depths of tiles.
    pub const PYRAMID: u32 = 5;
    /// Storage and indirect: draws of five words, `[layer][face][chunk]`.
    pub const DRAWS: u32 = 6;
    /// Storage and indirect: how many draws, `[layer][face]`.
    pub const DRAW_COUNTS: u32 = 7;
    /// Storage: when a chunk was last seen. Zeroed once.
    pub const SEEN: u32 = 8;
    /// Storage: 1 for a drawn chunk, `[layer][face][chunk]`. Without culling, the host sets all to 1.
    pub const DRAWN: u32 = 9;
    /// Storage: counters, eight words a layer. Zeroed once.
    pub const TALLIES: u32 = 10;
    /// Texture: the item buffer, an array of layers of R32Uint. Cleared to `patch_count + 1`: escaped.
    pub const ITEMS: u32 = 11;
    /// Storage: the weight of each pixel of the atlas.
    pub const WEIGHTS: u32 = 12;
    /// Storage: visible weights, `[layer][patch_count + 2]`. Zeroed once.
    pub const VISIBLE: u32 = 13;
    /// Storage: a bit a patch, `[layer][word_count]`. Zeroed once.
    pub const TOUCHED: u32 = 14;
    /// Storage and vertex: [`crate::Upload::vertices`].
    pub const VERTICES: u32 = 15;
    /// Storage and index: [`crate::Upload::indices`]; for exact edges [`crate::Upload::sides`] after them.
    pub const INDICES: u32 = 16;
    /// Storage: [`crate::Upload::triangle_of_patch`].
    pub const TRIANGLE_OF_PATCH: u32 = 17;
    /// Storage: patch and visible weight, `[layer][capacity]`.
    pub const ENTRIES: u32 = 18;
    /// Storage: [`crate::Upload::chunk_of_patch`].
    pub const CHUNK_OF_PATCH: u32 = 19;
    /// Storage and indirect: draws of four words, a layer each.
    pub const COVER_DRAWS: u32 = 20;
    /// Storage: entries, escaped, blocked of each slot, four words each.
    pub const TOTALS: u32 = 21;
    /// Storage: hidden weight, `[layer][capacity]`.
    pub const HIDDEN: u32 = 22;
    /// Storage: read by the host, see [`crate::output`].
    pub const OUTPUT: u32 = 23;
    /// Storage: [`crate::Upload::centroids`]; one triangle's for uncovered rows.
    pub const CENTROIDS: u32 = 24;
    /// Storage: depths, `[layer][pixel]`, for [`PYRAMID_OF_COPY`](super::PYRAMID_OF_COPY) and
    /// [`PRESET_DEPTHS`](super::PRESET_DEPTHS).
    pub const DEPTH_COPY: u32 = 25;
    /// Storage: a bit for each pixel near an edge, and two counts, `[layer][pixels / 32 + 2]`. Zeroed once.
    pub const NEAR: u32 = 26;
    /// Storage: pixels near edges, three words each, and visible ids, a word each: `[layer][4 × pixels]`.
    pub const LISTED: u32 = 27;
    /// Storage: the visible weight of each id, `[layer][2 × patch_count + 2]`. Zeroed once.
    pub const SIDES: u32 = 28;
    /// Written image: the item buffer again. In GLSL image unit 0, because image units are few.
    pub const SETTLED_ITEMS: u32 = 29;
    /// One past the last of hemicubes. Rays have sets of their own.
    pub const COUNT: u32 = 30;
    /// Storage: [`RayTree::nodes`](crate::rays::RayTree::nodes).
    pub const RAY_NODES: u32 = 30;
    /// Storage: [`RayTree::triangles`](crate::rays::RayTree::triangles).
    pub const RAY_TRIANGLES: u32 = 31;
    /// Storage: [`RayTree::words`](crate::rays::RayTree::words).
    pub const RAYS: u32 = 32;
    /// Storage, read by the host: the answer to each ray.
    pub const MET: u32 = 33;
    /// The textures. All others are storage buffers, but for the uniforms and [`SETTLED_ITEMS`].
    pub const TEXTURES: [u32; 2] = [DEPTHS, ITEMS];
}
