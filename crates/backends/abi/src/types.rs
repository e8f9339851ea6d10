//! The types across the boundary: one table of functions, a few structs allocated by the caller, and integers.
//!
//! `include/hemicube_backend.h` is generated from this file (`tests/header.rs` compares; `BLESS=1` writes): comments
//! here are the C author's manual. General rules:
//!
//! - The caller allocates; the other side never frees anything. Pointers given to a call are valid until it returns.
//! - Structs beginning with `struct_size` may grow at the end; structs in arrays never do within an ABI version.
//! - Nothing unwinds out of a function, in either direction.

use core::ffi::{c_char, c_void};
use core::marker::{PhantomData, PhantomPinned};

/// Version of the ABI. A host loads a plugin only when the two are equal; within a version things are only appended.
pub const HC_ABI_VERSION: u32 = 1;
/// Weight of a whole hemicube: a form factor is a weight divided by this. The weights of a hemicube's visible patches
/// and its escaped and blocked weight sum to exactly this.
pub const HC_WHOLE: u32 = 0x8000_0000;
/// In place of a missing patch number: the emitter of a free point, the back of a one-sided surface.
pub const HC_NO_PATCH: u32 = 0xFFFF_FFFF;
/// In an item buffer: the pixel hit nothing.
pub const HC_ESCAPED: u32 = 0xFFFF_FFFF;
/// In an item buffer: the pixel hit the back of a one-sided surface.
pub const HC_BLOCKED: u32 = 0xFFFF_FFFE;
/// The answer to a ray that has no certain one.
pub const HC_DOUBTFUL: u32 = 0xFFFF_FFFD;
/// Parent of an octree's root.
pub const HC_NO_NODE: u32 = 0xFFFF_FFFF;

/// Done.
pub const HC_OK: i32 = 0;
/// A request against the contract. The session stays usable.
pub const HC_ERROR_INVALID_ARGUMENT: i32 = 1;
/// A legal request beyond this backend. The session stays usable.
pub const HC_ERROR_UNSUPPORTED: i32 = 2;
/// Host or device memory ran out. The session stays usable.
pub const HC_ERROR_OUT_OF_MEMORY: i32 = 3;
/// The device is gone. Only `close` may follow.
pub const HC_ERROR_DEVICE_LOST: i32 = 4;
/// A defect of the backend, like every number not in this list. Only `close` may follow.
pub const HC_ERROR_INTERNAL: i32 = 5;
/// A panic or an exception, caught at the boundary. Only `close` may follow.
pub const HC_ERROR_PANIC: i32 = 6;

/// Fills in covered weights when asked.
pub const HC_CAN_COVERED: u64 = 1;
/// Reports patches without a pixel centre but nearest at their centroid, if covered weights are asked for.
pub const HC_CAN_TINY_PATCHES: u64 = 2;
/// `items` works.
pub const HC_CAN_ITEMS: u64 = 4;
/// Rows with culling on and off are the same bits.
pub const HC_CAN_LOSSLESS_CULLING: u64 = 8;
/// `pass` works.
pub const HC_CAN_PASSES: u64 = 16;
/// Hemicubes with a surface above their plane and within 2⁻¹⁸ normalised units of their origin may be wrong: the host
/// has them drawn on the processor. A host that does not know this bit asks for them all the same.
pub const HC_LEAVES_CLOSE: u64 = 32;
/// `rays` works.
pub const HC_CAN_RAYS: u64 = 64;

/// A device of none of the kinds below.
pub const HC_DEVICE_OTHER: u32 = 0;
/// A processor, or a graphics driver running on one. `--backend auto` prefers the built-in backend to it.
pub const HC_DEVICE_SOFTWARE: u32 = 1;
/// A GPU sharing the processor's memory.
pub const HC_DEVICE_INTEGRATED_GPU: u32 = 2;
/// A GPU with memory of its own.
pub const HC_DEVICE_DISCRETE_GPU: u32 = 3;
/// A GPU handed through to a virtual machine.
pub const HC_DEVICE_VIRTUAL_GPU: u32 = 4;

/// An error of the program or the plugin.
pub const HC_LOG_ERROR: i32 = 1;
/// News that a user should know.
pub const HC_LOG_WARN: i32 = 2;
/// News that a user may want to know.
pub const HC_LOG_INFO: i32 = 3;
/// Details for finding a defect.
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

/// An open device with a scene. Its contents are the plugin's: the host only hands it back.
#[repr(C)]
pub struct HcSession {
    _opaque: [u8; 0],
    _marker: PhantomData<(*mut u8, PhantomPinned)>,
}

/// A device for sessions. Stands in arrays, so it does not grow.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcDevice {
    /// Name and driver in words, UTF-8 and NUL-terminated.
    pub name: [c_char; 128],
    /// `HC_CAN_…` bits.
    pub capabilities: u64,
    /// `HC_DEVICE_…`.
    pub kind: u32,
    /// Its largest resolution: a multiple of 16 from 16 to 1024.
    pub max_resolution: u32,
    /// Preferred number of hemicubes a call; 0 counts for 1.
    pub preferred_rows: u32,
    /// Zero.
    pub reserved: [u32; 9],
}

/// The host's services. The struct is valid until `open` returns; `context` and `log` live for the whole process.
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

/// Details of a session beyond its device's entry: filled by `info`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcSessionInfo {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// See `HcDevice`; for this session.
    pub preferred_rows: u32,
    /// See `HcDevice`; for this session.
    pub capabilities: u64,
    /// The device, in words.
    pub device: [c_char; 128],
    /// Version of the arithmetic: matrices of different versions are not mixed. May depend on the loaded scene.
    pub version: [c_char; 64],
    /// Choices made for the loaded scene and their reasons, a line each. May be empty.
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
    /// Smallest box over the node's own surfaces; `own_min` above `own_max` if there are none.
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
    /// Number of children; 0 for a leaf.
    pub child_count: u32,
    /// The node's parent; `HC_NO_NODE` for the root, the first node.
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
    /// Number of patches, numbered from 0.
    pub patch_count: u32,
    /// Not 0: another call of `load` with this number brings the same scene, bit for bit; sessions can share everything
    /// derived from it. 0: nothing is known.
    pub identity: u64,
    /// A corner nearer than this to the emitter's plane counts for lying in it.
    pub plane_tolerance: f64,
    /// Number of surfaces.
    pub surface_count: u64,
    /// Nine numbers a surface: three corners, counter-clockwise seen from the front. In the octree's order.
    pub corners: *const f64,
    /// Patch on the front of each surface.
    pub front: *const u32,
    /// Patch on the back of each surface; `HC_NO_PATCH` for a one-sided one: its back blocks.
    pub back: *const u32,
    /// Number of nodes of the octree.
    pub node_count: u64,
    /// The octree, breadth first. Need not be used.
    pub nodes: *const HcNode,
    /// Lower corner of the octree's cube.
    pub cube_origin: [f64; 3],
    /// Half the edge of that cube.
    pub cube_half_edge: f64,
    /// Deepest level allowed for the octree.
    pub octree_levels: u32,
    /// A node with no more surfaces than this is not divided.
    pub octree_min_items: u32,
    /// 1: a surface is in the cell of its middle, of an edge no smaller than the surface; 0: in a cell holding it all.
    pub octree_loose: u32,
    /// Zero.
    pub reserved: u32,
}

/// Settings of hemicubes, from `load` on.
///
/// A hemicube has an atlas of 3 N² pixels, N wide: N rows of the top face, then N/2 rows of each side, +x, −x, +y, −y
/// (of the emitter's axes: tangent, bitangent, normal). A direction (x, y, z) in those axes meets a face at (u/w, v/w):
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
    /// 1: skip invisible surfaces; 0: rasterise every surface. The rows are the same.
    pub culling: u32,
    /// 1: rows carry covered weights and tiny patches.
    pub covered: u32,
    /// Weight of each pixel of the atlas, 3 N² of them, with the sum `HC_WHOLE`.
    pub weights: *const u32,
}

/// Position and axes of a hemicube. Stands in arrays, so it does not grow.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HcHemicube {
    /// Its own patch, never seen; `HC_NO_PATCH` for a free point.
    pub emitter: u32,
    /// Zero.
    pub reserved: u32,
    /// The centre.
    pub origin: [f64; 3],
    /// Tangent, bitangent and normal, orthonormal and right-handed.
    pub axes: [f64; 9],
}

/// The view through a mirror or a pane, in the pixels of a hemicube that show it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcPass {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// The eye: behind a mirror the hemicube's, reflected.
    pub origin: [f64; 3],
    /// Tangent, bitangent and normal, orthonormal; left-handed behind a mirror. Fronts stay fronts.
    pub axes: [f64; 9],
    /// Normal of the portal's plane, of unit length.
    pub normal: [f64; 3],
    /// Only points p with normal · p > `offset` are seen.
    pub offset: f64,
    /// Number of words of `open`: 3 N² / 32.
    pub word_count: u64,
    /// A bit for each pixel of the atlas, from the lowest of the first word on: 1 where it is open.
    pub open: *const u32,
}

/// Rays from one patch, and what they meet.
///
/// A ray meets the first surface strictly between its ends, but none of the emitter's, and none without a corner more
/// than `plane_tolerance` above the emitter's plane. What rounding might decide is `HC_DOUBTFUL`, and the host's to
/// decide: an edge, an end, the plane, and which of two surfaces is first within 40,000 × `plane_tolerance` of each
/// other. Within 100 × `plane_tolerance` of an edge, across the ray, no answer is certain: the host may take pieces of
/// a wall for one polygon. A certain answer that is wrong makes a matrix wrong in silence.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcRays {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// The patch that they start from.
    pub emitter: u32,
    /// Normal of its plane, of unit length, on the side that the rays leave to.
    pub normal: [f64; 3],
    /// The plane: normal · p = `offset`.
    pub offset: f64,
    /// Number of rays.
    pub ray_count: u64,
    /// In: six numbers a ray: its start and its end.
    pub ends: *const f64,
    /// Out: the patch that each meets, `HC_BLOCKED` for a back, `HC_ESCAPED` for nothing, or `HC_DOUBTFUL`.
    pub met: *mut u32,
}

/// Counters of a call. Zeroed by the host; a 0 counts for none.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HcCounters {
    /// Hemicubes rendered.
    pub hemicubes: u64,
    /// Nodes of the hierarchy tested.
    pub nodes_tested: u64,
    /// Nodes found outside every face.
    pub nodes_outside: u64,
    /// Nodes found hidden behind earlier surfaces.
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

/// Times of a call, in nanoseconds. Zeroed by the host; a 0 was not measured.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HcStageTimes {
    /// Choosing the surfaces to draw.
    pub cull: u64,
    /// Drawing depths and ids.
    pub render: u64,
    /// Drawing visible patches alone, for covered weights.
    pub cover: u64,
    /// Adding up weights and picking nonzero entries.
    pub reduce: u64,
    /// Bringing rows back.
    pub read_back: u64,
    /// Zero.
    pub reserved: [u64; 3],
}

/// Hemicubes in, rows out. All arrays are the host's, large enough for any row.
///
/// Row k is the entries from `row_end[k - 1]` (0 for the first) to `row_end[k]`. A row depends on the scene, the
/// settings and its own hemicube only: not on its place in a call, nor on earlier calls.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcRows {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Number of hemicubes.
    pub row_count: u32,
    /// Room for entries: the number of patches, for each row.
    pub capacity: u64,
    /// In: `row_count` hemicubes.
    pub hemicubes: *const HcHemicube,
    /// Out: one past the last entry of each row.
    pub row_end: *mut u64,
    /// Out: the patch of each entry, strictly ascending within a row.
    pub patches: *mut u32,
    /// Out: weight of the patch's visible pixels.
    pub visible: *mut u32,
    /// Out: weight of the pixels covered by the patch alone, by the same rasteriser, so at least `visible`; both 0 for
    /// a sub-pixel patch. NULL unless covered weights were asked for.
    pub covered: *mut u32,
    /// Out: escaped weight of each row.
    pub escaped: *mut u32,
    /// Out: weight blocked by backs of one-sided surfaces, for each row.
    pub blocked: *mut u32,
    /// Out: counters.
    pub counters: HcCounters,
    /// Out: times.
    pub stage_times: HcStageTimes,
}

/// The table: the one export of a plugin, under the name `hemicube_backend`.
///
/// [any-thread]: may be called at any time from any thread, also at once. [session-thread]: never two calls at once
/// with one session, but the next may come from another thread; different sessions may be called at once. State bound
/// to a thread, such as a GL context, is therefore made current when a call begins and released when it ends. The host
/// holds no lock during a call. Nothing may unwind out of a function. The image is never unloaded.
///
/// The first version ended at `close`, and such a table stays valid: a host takes entries beyond `struct_size` for
/// NULL.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HcBackend {
    /// `HC_ABI_VERSION`. Read before anything else.
    pub abi_version: u32,
    /// `sizeof(HcBackend)` in the plugin.
    pub struct_size: u32,
    /// Name, `[a-z0-9-]{1,32}`. The file is called `hemicube_backend_NAME`, with `_` for `-`, between the platform's
    /// prefix and suffix of shared libraries.
    pub name: *const c_char,
    /// Version of the arithmetic: matrices of different versions are not mixed. UTF-8, not empty.
    pub version: *const c_char,
    /// Writes up to `capacity` devices, best first, and how many there are to `*count`. None is no error. [any-thread]
    pub devices: Option<
        unsafe extern "C" fn(out: *mut HcDevice, capacity: u32, count: *mut u32, error: *mut HcError) -> HcStatus,
    >,
    /// Opens a session on a device by its place in the list. `options` is `key=value,key=value`, UTF-8, or NULL; an
    /// unknown key is an error. [any-thread]
    pub open: Option<
        unsafe extern "C" fn(
            host: *const HcHost,
            device: u32,
            options: *const c_char,
            session: *mut *mut HcSession,
            error: *mut HcError,
        ) -> HcStatus,
    >,
    /// Describes the session, from `open` on, and again from `load` on. NULL: it is described by `devices` and
    /// `version`. [session-thread]
    pub info: Option<
        unsafe extern "C" fn(session: *mut HcSession, info: *mut HcSessionInfo, error: *mut HcError) -> HcStatus,
    >,
    /// Takes a scene and its settings, in place of the one before. [session-thread]
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
    /// Writes the visible patch of each of the 3 N² pixels of a hemicube, or `HC_BLOCKED` or `HC_ESCAPED`. NULL without
    /// `HC_CAN_ITEMS`. [session-thread]
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
    /// Writes what each open pixel of a pass shows, as `items` does; closed pixels may hold anything. NULL, or not
    /// there, without `HC_CAN_PASSES`: the host then draws passes itself. [session-thread]
    pub pass: Option<
        unsafe extern "C" fn(
            session: *mut HcSession,
            pass: *const HcPass,
            items: *mut u32,
            error: *mut HcError,
        ) -> HcStatus,
    >,
    /// Casts rays. NULL, or not there, without `HC_CAN_RAYS`: the host then casts all rays itself. [session-thread]
    pub rays: Option<unsafe extern "C" fn(session: *mut HcSession, rays: *mut HcRays, error: *mut HcError) -> HcStatus>,
}

/// Bytes of the smallest table: that of the first version, which ended at `close`.
pub const TABLE_MIN: usize = core::mem::offset_of!(HcBackend, pass);

// SAFETY: the table is read only, and what it points to lives as long as the image, which is never unloaded.
unsafe impl Sync for HcBackend {}
// SAFETY: as above.
unsafe impl Send for HcBackend {}

/// The exported name of the table, NUL-terminated for loaders.
pub const SYMBOL: &core::ffi::CStr = c"hemicube_backend";

// The C test compiled by `tests/header.rs` has the same numbers; a moved field breaks the ABI.
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
    assert!(size_of::<HcPass>() == 152);
    assert!(size_of::<HcRays>() == 64);
    assert!(TABLE_MIN == 80);
    assert!(size_of::<HcBackend>() == 96);
};
