//! What crosses the boundary: one table of functions, a few structs that the caller allocates, and integers.
//!
//! `include/hemicube_backend.h` is generated from this file (`tests/header.rs` compares; `BLESS=1` writes), so comments
//! here are the C author's manual. Rules that hold everywhere:
//!
//! - Whoever calls allocates, and nothing is ever freed by the other side. Pointers given to a call are valid until it
//!   returns.
//! - Structs that begin with `struct_size` may grow at the end; those that stand in arrays never do within an ABI version.
//! - Nothing unwinds out of a function, in either direction.

use core::ffi::{c_char, c_void};
use core::marker::{PhantomData, PhantomPinned};

/// Version of the ABI. A host loads a plugin only when the two are equal; within a version things are only appended.
pub const HC_ABI_VERSION: u32 = 1;
/// Weight of a whole hemicube: a form factor is a weight divided by this. The weights of the visible patches of a
/// hemicube, what escaped and what was blocked sum to exactly this.
pub const HC_WHOLE: u32 = 0x8000_0000;
/// Where a patch number may be missing: the emitter of a free point, the back of a one-sided surface.
pub const HC_NO_PATCH: u32 = 0xFFFF_FFFF;
/// In an item buffer: the pixel hit nothing.
pub const HC_ESCAPED: u32 = 0xFFFF_FFFF;
/// In an item buffer: the pixel hit the back of a one-sided surface.
pub const HC_BLOCKED: u32 = 0xFFFF_FFFE;
/// Parent of an octree's root.
pub const HC_NO_NODE: u32 = 0xFFFF_FFFF;

/// Done.
pub const HC_OK: i32 = 0;
/// A request that the contract does not allow. The session stays usable.
pub const HC_ERROR_INVALID_ARGUMENT: i32 = 1;
/// A legal request that this backend cannot serve. The session stays usable.
pub const HC_ERROR_UNSUPPORTED: i32 = 2;
/// Host or device memory ran out. The session stays usable.
pub const HC_ERROR_OUT_OF_MEMORY: i32 = 3;
/// The device is gone. Only `close` may follow.
pub const HC_ERROR_DEVICE_LOST: i32 = 4;
/// A defect of the backend, as is every number that is not in this list. Only `close` may follow.
pub const HC_ERROR_INTERNAL: i32 = 5;
/// A panic, or an exception, that was caught at the boundary. Only `close` may follow.
pub const HC_ERROR_PANIC: i32 = 6;

/// Fills in covered weights when asked.
pub const HC_CAN_COVERED: u64 = 1;
/// Reports patches that cover no pixel centre but are nearest at their centroid, when covered weights are asked for.
pub const HC_CAN_TINY_PATCHES: u64 = 2;
/// `items` works.
pub const HC_CAN_ITEMS: u64 = 4;
/// Rows with culling on and off are the same bits.
pub const HC_CAN_LOSSLESS_CULLING: u64 = 8;

/// A device of none of the kinds below.
pub const HC_DEVICE_OTHER: u32 = 0;
/// A processor, or a graphics driver that runs on one. `--backend auto` prefers the built-in backend to it.
pub const HC_DEVICE_SOFTWARE: u32 = 1;
/// A GPU that shares the processor's memory.
pub const HC_DEVICE_INTEGRATED_GPU: u32 = 2;
/// A GPU with memory of its own.
pub const HC_DEVICE_DISCRETE_GPU: u32 = 3;
/// A GPU handed through to a virtual machine.
pub const HC_DEVICE_VIRTUAL_GPU: u32 = 4;

/// An error of the program or the plugin.
pub const HC_LOG_ERROR: i32 = 1;
/// Something that a user should know of.
pub const HC_LOG_WARN: i32 = 2;
/// Something that a user may want to know.
pub const HC_LOG_INFO: i32 = 3;
/// For who looks for a defect.
pub const HC_LOG_DEBUG: i32 = 4;

/// `HC_OK` or an `HC_ERROR_…`. An integer, not an enum: any number may come from foreign code.
pub type HcStatus = i32;

/// Message of a failed call, UTF-8 and NUL-terminated, cut to fit. Zeroed by the host.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcError {
    /// The message.
    pub message: [c_char; 512],
}

/// An open device with a scene, as the plugin pleases: the host only hands it back.
#[repr(C)]
pub struct HcSession {
    _opaque: [u8; 0],
    _marker: PhantomData<(*mut u8, PhantomPinned)>,
}

/// A device that sessions can be opened on. Stands in arrays, so it does not grow.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcDevice {
    /// Name and driver in words, UTF-8 and NUL-terminated.
    pub name: [c_char; 128],
    /// `HC_CAN_…` bits.
    pub capabilities: u64,
    /// `HC_DEVICE_…`.
    pub kind: u32,
    /// Largest resolution that it takes: a multiple of 16 from 16 to 1024.
    pub max_resolution: u32,
    /// How many hemicubes a call it likes best; 0 is taken as 1.
    pub preferred_rows: u32,
    /// Zero.
    pub reserved: [u32; 9],
}

/// What the host offers. The struct is valid until `open` returns; `context` and `log` as long as the process.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcHost {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// To be handed back to `log`.
    pub context: *mut c_void,
    /// Says something, `level` one of `HC_LOG_…`, `message` UTF-8. [any-thread] May be NULL.
    pub log: Option<unsafe extern "C" fn(context: *mut c_void, level: i32, message: *const c_char)>,
}

/// What a session is, when that says more than the device's entry: filled by `info`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcSessionInfo {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// As in `HcDevice`, of this session.
    pub preferred_rows: u32,
    /// As in `HcDevice`, of this session.
    pub capabilities: u64,
    /// The device, in words.
    pub device: [c_char; 128],
    /// Version of the arithmetic: matrices of different versions are not mixed. May depend on the loaded scene.
    pub version: [c_char; 64],
    /// What was chosen for the loaded scene and why, a line each. May be empty.
    pub choices: [c_char; 1024],
}

/// A node of the octree: a range of surfaces. Stands in arrays, so it does not grow.
///
/// Own surfaces come first in the range, then the children's, each child's a contiguous range.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HcNode {
    /// Smallest box over all surfaces beneath this node.
    pub min: [f64; 3],
    /// Its other corner.
    pub max: [f64; 3],
    /// Smallest box over the node's own surfaces; `own_min` above `own_max` where there are none.
    pub own_min: [f64; 3],
    /// Its other corner.
    pub own_max: [f64; 3],
    /// First surface beneath this node.
    pub first_surface: u32,
    /// One past the last of the node's own surfaces.
    pub own_end: u32,
    /// One past the last surface beneath this node.
    pub surface_end: u32,
    /// First child, a node number; children are beside each other.
    pub first_child: u32,
    /// How many children there are; 0 for a leaf.
    pub child_count: u32,
    /// The node whose child this is; `HC_NO_NODE` for the root, which is the first node.
    pub parent: u32,
    /// The node's cell, counted from the cube's origin in cells of its level.
    pub cell: [u32; 3],
    /// Level of the cell; 0 is the whole cube.
    pub level: u32,
}

/// A scene. Coordinates are normalised: the middle of the scene's box is the origin, and its longest half side lies in
/// (1/2, 1].
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcScene {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// How many patches there are: numbers run from 0 to one below.
    pub patch_count: u32,
    /// Not 0: another call of `load` with this number brings the same scene, bit for bit, so that sessions can share
    /// what is made of it. 0: nothing is known.
    pub identity: u64,
    /// A corner nearer than this to the emitter's plane counts as lying in it.
    pub plane_tolerance: f64,
    /// How many surfaces there are.
    pub surface_count: u64,
    /// Nine numbers a surface: three corners, counter-clockwise seen from the front. In the octree's order.
    pub corners: *const f64,
    /// Patch on the front of each surface.
    pub front: *const u32,
    /// Patch on the back of each surface; `HC_NO_PATCH` for a one-sided one, whose back blocks.
    pub back: *const u32,
    /// How many nodes the octree has.
    pub node_count: u64,
    /// The octree, breadth first. Need not be used.
    pub nodes: *const HcNode,
    /// Lower corner of the octree's cube.
    pub cube_origin: [f64; 3],
    /// Half the edge of that cube.
    pub cube_half_edge: f64,
    /// Deepest level that the octree may have.
    pub octree_levels: u32,
    /// A node with no more surfaces than this is not divided.
    pub octree_min_items: u32,
    /// 1: a surface is in the cell that its middle is in and that it is no larger than; 0: in one that holds it all.
    pub octree_loose: u32,
    /// Zero.
    pub reserved: u32,
}

/// How hemicubes are rendered, from `load` on.
///
/// A hemicube has an atlas of 3 N² pixels, N wide: N rows of the top face, then N/2 rows of each side, +x, −x, +y, −y (of
/// the emitter's axes: tangent, bitangent, normal). A direction (x, y, z) in those axes meets a face at (u/w, v/w):
///
/// ```text
/// top  u =  x  v = y  w =  z      pixel column from u/w in -1…1, row from v/w in -1…1
/// +x   u =  y  v = z  w =  x      pixel column from u/w in -1…1, row from v/w in  0…1
/// -x   u = -y  v = z  w = -x
/// +y   u = -x  v = z  w =  y
/// -y   u =  x  v = z  w = -y
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcSettings {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// N: a multiple of 16 from 16 to 1024.
    pub resolution: u32,
    /// 1: skip what cannot be seen; 0: rasterise every surface. The rows are the same.
    pub culling: u32,
    /// 1: rows carry covered weights and tiny patches.
    pub covered: u32,
    /// Weight of each pixel of the atlas, 3 N² of them, which sum to `HC_WHOLE`.
    pub weights: *const u32,
}

/// Where a hemicube stands and how it is turned. Stands in arrays, so it does not grow.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HcHemicube {
    /// The patch it belongs to, whose surface is not seen; `HC_NO_PATCH` for a free point.
    pub emitter: u32,
    /// Zero.
    pub reserved: u32,
    /// The centre.
    pub origin: [f64; 3],
    /// Tangent, bitangent and normal, orthonormal and right-handed.
    pub axes: [f64; 9],
}

/// What was done for the rows of a call. Zeroed by the host; what is left 0 counts as none.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HcCounters {
    /// Hemicubes rendered.
    pub hemicubes: u64,
    /// Nodes of the hierarchy that were tested.
    pub nodes_tested: u64,
    /// Nodes found outside every face.
    pub nodes_outside: u64,
    /// Nodes found hidden behind what was drawn before.
    pub nodes_hidden: u64,
    /// Triangles transformed into a hemicube's frame.
    pub triangles_transformed: u64,
    /// Triangles rasterised, counted once a face.
    pub triangles_drawn: u64,
    /// Hardware occlusion queries issued.
    pub queries: u64,
    /// Bytes read back from a device.
    pub bytes_read_back: u64,
    /// Zero.
    pub reserved: [u64; 8],
}

/// Where the time of a call went, in nanoseconds. Zeroed by the host; what is left 0 was not measured.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HcStageTimes {
    /// Finding what can be seen.
    pub cull: u64,
    /// Drawing depths and ids.
    pub render: u64,
    /// Drawing visible patches alone, for covered weights.
    pub cover: u64,
    /// Adding up weights and picking the entries that are not zero.
    pub reduce: u64,
    /// Bringing rows back.
    pub read_back: u64,
    /// Zero.
    pub reserved: [u64; 3],
}

/// Hemicubes in, rows out. All arrays are the host's, and are large enough for any row.
///
/// Row k is the entries from `row_end[k - 1]` (0 for the first) to `row_end[k]`. A row depends on the scene, the settings
/// and its own hemicube only: not on its place in a call, nor on what was rendered before.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcRows {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// How many hemicubes there are.
    pub row_count: u32,
    /// How many entries there is room for: as many a row as the scene has patches.
    pub capacity: u64,
    /// In: `row_count` hemicubes.
    pub hemicubes: *const HcHemicube,
    /// Out: one past the last entry of each row.
    pub row_end: *mut u64,
    /// Out: the patch of each entry, strictly ascending within a row.
    pub patches: *mut u32,
    /// Out: weight of the pixels that show the patch.
    pub visible: *mut u32,
    /// Out: weight of the pixels that the patch would cover alone, by the same rasteriser, so at least `visible`; both 0
    /// for a tiny patch. NULL unless covered weights were asked for.
    pub covered: *mut u32,
    /// Out: weight that hit nothing, for each row.
    pub escaped: *mut u32,
    /// Out: weight that hit the back of a one-sided surface, for each row.
    pub blocked: *mut u32,
    /// Out: what was done.
    pub counters: HcCounters,
    /// Out: where the time went.
    pub stage_times: HcStageTimes,
}

/// The table: the one thing that a plugin exports, under the name `hemicube_backend`.
///
/// [any-thread]: may be called at any time from any thread, also at once. [session-thread]: never two calls at once with
/// one session, but the next may come from another thread; different sessions may be called at once. So what is bound to
/// a thread, such as a GL context, is made current when a call begins and released when it ends. The host holds no lock
/// during a call. Nothing may unwind out of a function. The image is never unloaded.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcBackend {
    /// `HC_ABI_VERSION`. Read before anything else.
    pub abi_version: u32,
    /// `sizeof(HcBackend)` in the plugin.
    pub struct_size: u32,
    /// Name, `[a-z0-9-]{1,32}`. The file is called `hemicube_backend_NAME`, with `_` for `-`, and what the platform puts
    /// before and after the name of a shared library.
    pub name: *const c_char,
    /// Version of the arithmetic: matrices of different versions are not mixed. UTF-8, not empty.
    pub version: *const c_char,
    /// Writes up to `capacity` devices, best first, and how many there are to `*count`. None is no error. [any-thread]
    pub devices: Option<
        unsafe extern "C" fn(out: *mut HcDevice, capacity: u32, count: *mut u32, error: *mut HcError) -> HcStatus,
    >,
    /// Opens a session on the device with that place in the list. `options` is `key=value,key=value`, UTF-8, or NULL; a
    /// key that is not known is an error. [any-thread]
    pub open: Option<
        unsafe extern "C" fn(
            host: *const HcHost,
            device: u32,
            options: *const c_char,
            session: *mut *mut HcSession,
            error: *mut HcError,
        ) -> HcStatus,
    >,
    /// Says what the session is, from `open` on, and again from `load` on. NULL: what `devices` and `version` say.
    /// [session-thread]
    pub info: Option<
        unsafe extern "C" fn(session: *mut HcSession, info: *mut HcSessionInfo, error: *mut HcError) -> HcStatus,
    >,
    /// Takes a scene, and how to render it, in place of what was loaded before. [session-thread]
    pub load: Option<
        unsafe extern "C" fn(
            session: *mut HcSession,
            scene: *const HcScene,
            settings: *const HcSettings,
            error: *mut HcError,
        ) -> HcStatus,
    >,
    /// Renders hemicubes and reduces them to rows. [session-thread]
    pub rows: Option<unsafe extern "C" fn(session: *mut HcSession, rows: *mut HcRows, error: *mut HcError) -> HcStatus>,
    /// The patch that each of the 3 N² pixels of a hemicube shows, or `HC_BLOCKED` or `HC_ESCAPED`. NULL where
    /// `HC_CAN_ITEMS` is missing. [session-thread]
    pub items: Option<
        unsafe extern "C" fn(
            session: *mut HcSession,
            hemicube: *const HcHemicube,
            items: *mut u32,
            error: *mut HcError,
        ) -> HcStatus,
    >,
    /// Ends a session, whatever state it is in. [session-thread]
    pub close: Option<unsafe extern "C" fn(session: *mut HcSession)>,
}

// SAFETY: the table is read only, and what it points to lives as long as the image, which is never unloaded.
unsafe impl Sync for HcBackend {}
// SAFETY: as above.
unsafe impl Send for HcBackend {}

/// The name that the table is exported under, NUL-terminated as loaders want it.
pub const SYMBOL: &core::ffi::CStr = c"hemicube_backend";

// The same numbers stand in the C test that `tests/header.rs` compiles; a field that moves is an ABI that broke.
#[cfg(target_pointer_width = "64")]
const _: () = {
    assert!(size_of::<HcError>() == 512);
    assert!(size_of::<HcDevice>() == 184);
    assert!(size_of::<HcHost>() == 24);
    assert!(size_of::<HcSessionInfo>() == 1232);
    assert!(size_of::<HcNode>() == 136);
    assert!(size_of::<HcScene>() == 120);
    assert!(size_of::<HcSettings>() == 24);
    assert!(size_of::<HcHemicube>() == 104);
    assert!(size_of::<HcCounters>() == 128);
    assert!(size_of::<HcStageTimes>() == 64);
    assert!(size_of::<HcRows>() == 264);
    assert!(size_of::<HcBackend>() == 80);
};
