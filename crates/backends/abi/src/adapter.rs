//! From a [`Plugin`] to the table: pointers become slices, panics become statuses, scenes become a [`Geometry`].

use crate::panics::guarded;
use crate::plugin::{Device, Log, Plugin, capabilities_to_raw};
use crate::types::{
    HC_ABI_VERSION, HC_ERROR_DEVICE_LOST, HC_ERROR_INTERNAL, HC_ERROR_INVALID_ARGUMENT, HC_ERROR_OUT_OF_MEMORY,
    HC_ERROR_PANIC, HC_ERROR_UNSUPPORTED, HC_NO_NODE, HC_NO_PATCH, HC_OK, HcBackend, HcCounters, HcDevice, HcError,
    HcHemicube, HcHost, HcNode, HcPass, HcRays, HcRows, HcScene, HcSession, HcSessionInfo, HcSettings, HcStageTimes,
    HcStatus,
};
use core::ffi::{CStr, c_char};
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{
    BackendError, Culling, Geometry, Hemicube, HemicubeBackend, Pass, Rays, RenderSettings, StageTimes, Surface,
};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::pixel_count;
use hemicube_contract::row::RowBlock;
use hemicube_spatial::morton::Cube;
use hemicube_spatial::{Aabb, Fit, Node, Octree, OctreeOptions};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Bytes for a session's choices, the NUL included; longer ones are cut.
pub const CHOICES_SIZE: usize = 1024;

/// The contents of an [`HcSession`] of a plugin in Rust.
struct Open<S> {
    session: S,
    loaded: Option<Loaded>,
    rows: RowBlock,
    times: StageTimes,
    /// A call panicked, or ended the session by a fatal error.
    dead: bool,
}

struct Loaded {
    patch_count: u32,
    settings: RenderSettings,
}

/// The table of a plugin, exported by [`export_backend!`](crate::export_backend).
pub const fn table<P: Plugin>() -> HcBackend {
    #[allow(clippy::cast_possible_truncation, reason = "some dozens of bytes")]
    let struct_size = size_of::<HcBackend>() as u32;
    HcBackend {
        abi_version: HC_ABI_VERSION,
        struct_size,
        name: P::NAME.as_ptr(),
        version: P::VERSION.as_ptr(),
        devices: Some(devices::<P>),
        open: Some(open::<P>),
        info: Some(info::<P>),
        load: Some(load::<P>),
        rows: Some(rows::<P>),
        items: Some(items::<P>),
        close: Some(close::<P>),
        pass: Some(pass::<P>),
        rays: Some(rays::<P>),
    }
}

fn invalid<T>(message: impl Into<String>) -> Result<T, BackendError> {
    Err(BackendError::InvalidArgument(message.into()))
}

/// Writes `text` and a NUL, cut at a character if it is too long.
pub(crate) fn put(out: &mut [c_char], text: &str) {
    let Some(room) = out.len().checked_sub(1) else { return };
    let mut end = text.len().min(room);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    // A NUL inside would end it early.
    for (to, &from) in out.iter_mut().zip(&text.as_bytes()[..end]) {
        *to = if from == 0 { b' ' } else { from }.cast_signed() as c_char;
    }
    out[end] = 0;
}

/// Runs a call of the host, and returns its outcome as a status.
///
/// # Safety
/// `error` is NULL or valid for writes.
unsafe fn answer(error: *mut HcError, call: impl FnOnce() -> Result<(), BackendError>) -> HcStatus {
    let (status, message) = match guarded(call) {
        Ok(Ok(())) => return HC_OK,
        Ok(Err(failed)) => match failed {
            BackendError::InvalidArgument(message) => (HC_ERROR_INVALID_ARGUMENT, message),
            BackendError::Unsupported(message) => (HC_ERROR_UNSUPPORTED, message),
            BackendError::OutOfMemory(message) => (HC_ERROR_OUT_OF_MEMORY, message),
            BackendError::DeviceLost(message) => (HC_ERROR_DEVICE_LOST, message),
            BackendError::Internal(message) => (HC_ERROR_INTERNAL, message),
            other => (HC_ERROR_INTERNAL, other.to_string()),
        },
        Err(panicked) => (HC_ERROR_PANIC, panicked),
    };
    // SAFETY: NULL or valid, by this function's contract.
    if let Some(error) = unsafe { error.as_mut() } {
        put(&mut error.message, &message);
    }
    status
}

/// Runs a call on a session. A panic or a fatal error ends the session.
///
/// # Safety
/// `session` is NULL or given by `open` of the same plugin, and nobody else uses it meanwhile; `error` is NULL or valid
/// for writes.
unsafe fn answer_session<P: Plugin>(
    session: *mut HcSession,
    error: *mut HcError,
    call: impl FnOnce(&mut Open<P::Session>) -> Result<(), BackendError>,
) -> HcStatus {
    // SAFETY: it was made by `open` as a box of this type, and calls on a session do not overlap.
    let Some(open) = (unsafe { session.cast::<Open<P::Session>>().as_mut() }) else {
        // SAFETY: by this function's contract.
        return unsafe { answer(error, || invalid("the session is NULL")) };
    };
    let dead = open.dead;
    // SAFETY: by this function's contract.
    let status = unsafe {
        answer(error, || {
            if dead {
                return Err(BackendError::Internal(
                    "the session has failed before; it can only be closed".to_owned(),
                ));
            }
            call(&mut *open)
        })
    };
    open.dead |= matches!(status, HC_ERROR_DEVICE_LOST | HC_ERROR_INTERNAL | HC_ERROR_PANIC);
    status
}

/// Makes a slice of a pointer and a length. C may pass NULL for an empty one.
///
/// # Safety
/// Valid for reads of `length` values for `'a`, unless the length is 0.
unsafe fn slice<'a, T>(pointer: *const T, length: usize) -> Result<&'a [T], BackendError> {
    if length == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() || !pointer.is_aligned() {
        return invalid("an array is NULL or not aligned");
    }
    // SAFETY: not NULL, aligned, and valid by this function's contract.
    Ok(unsafe { std::slice::from_raw_parts(pointer, length) })
}

/// Makes a mutable slice of a pointer and a length.
///
/// # Safety
/// Valid for reads and writes of `length` values for `'a`, by nobody else, unless the length is 0.
unsafe fn slice_mut<'a, T>(pointer: *mut T, length: usize) -> Result<&'a mut [T], BackendError> {
    if length == 0 {
        return Ok(&mut []);
    }
    if pointer.is_null() || !pointer.is_aligned() {
        return invalid("an array is NULL or not aligned");
    }
    // SAFETY: not NULL, aligned, and valid by this function's contract.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, length) })
}

/// Borrows a struct of the host; its first field is its size.
///
/// # Safety
/// NULL, or valid for reads of a `u32`, and of a `T` for `'a` if its size says so.
unsafe fn sized<'a, T>(pointer: *const T, what: &str) -> Result<&'a T, BackendError> {
    if pointer.is_null() || !pointer.is_aligned() {
        return invalid(format!("{what} is NULL or not aligned"));
    }
    // SAFETY: not NULL, aligned; its first field is its size.
    let size = unsafe { pointer.cast::<u32>().read() } as usize;
    if size < size_of::<T>() {
        return invalid(format!("{what} has {size} bytes where {} are due", size_of::<T>()));
    }
    // SAFETY: the host says that it is as large.
    Ok(unsafe { &*pointer })
}

fn count(number: u64) -> Result<usize, BackendError> {
    usize::try_from(number).or_else(|_| invalid(format!("{number} is more than this machine can address")))
}

unsafe extern "C" fn devices<P: Plugin>(
    out: *mut HcDevice,
    capacity: u32,
    found: *mut u32,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI valid for `capacity` devices, a number, and an error or NULL.
    unsafe {
        answer(error, || {
            let devices = P::devices()?;
            if found.is_null() {
                return invalid("no place for the number of devices");
            }
            let written = devices.len().min(capacity as usize);
            for (to, device) in slice_mut(out, written)?.iter_mut().zip(&devices) {
                *to = raw_device(device);
            }
            *found = u32::try_from(devices.len()).unwrap_or(u32::MAX);
            Ok(())
        })
    }
}

fn raw_device(device: &Device) -> HcDevice {
    let mut raw = HcDevice {
        name: [0; 128],
        capabilities: capabilities_to_raw(device.capabilities),
        kind: device.kind.to_raw(),
        max_resolution: device.max_resolution,
        preferred_rows: u32::try_from(device.preferred_rows).unwrap_or(u32::MAX),
        reserved: [0; 9],
    };
    put(&mut raw.name, &device.name);
    raw
}

unsafe extern "C" fn open<P: Plugin>(
    host: *const HcHost,
    device: u32,
    options: *const c_char,
    session: *mut *mut HcSession,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a host or NULL, a C string or NULL, room for the session, an error or
    // NULL.
    unsafe {
        answer(error, || {
            if session.is_null() {
                return invalid("no place for the session");
            }
            *session = std::ptr::null_mut();
            let host = if host.is_null() {
                None
            } else {
                Some(sized(host, "the host")?)
            };
            let options = if options.is_null() {
                ""
            } else {
                CStr::from_ptr(options)
                    .to_str()
                    .or_else(|_| invalid("the options are not UTF-8"))?
            };
            let open = Open {
                session: P::open(device, options, Log::of(host))?,
                loaded: None,
                rows: RowBlock::default(),
                times: StageTimes::default(),
                dead: false,
            };
            *session = Box::into_raw(Box::new(open)).cast();
            Ok(())
        })
    }
}

unsafe extern "C" fn info<P: Plugin>(
    session: *mut HcSession,
    info: *mut HcSessionInfo,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, a struct to fill, an error or NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            sized(info, "the session's info")?;
            let (info, found) = (&mut *info, open.session.info());
            info.preferred_rows = u32::try_from(found.preferred_rows).unwrap_or(u32::MAX);
            info.capabilities = capabilities_to_raw(found.capabilities);
            put(&mut info.device, &found.device);
            put(&mut info.version, &found.version);
            put(&mut info.choices, &open.session.choices().join("\n"));
            Ok(())
        })
    }
}

unsafe extern "C" fn load<P: Plugin>(
    session: *mut HcSession,
    scene: *const HcScene,
    settings: *const HcSettings,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, a scene and settings with arrays of the
    // lengths given there, an error or NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            let (scene, settings) = (sized(scene, "the scene")?, sized(settings, "the settings")?);
            let render = render_settings(settings)?;
            open.loaded = None;
            open.session.load(&geometry(scene)?, render)?;
            open.times = open.session.stage_times();
            open.loaded = Some(Loaded {
                patch_count: scene.patch_count,
                settings: render,
            });
            Ok(())
        })
    }
}

/// Reads the settings, and refuses weights other than the contract's own table.
///
/// # Safety
/// `weights` has 3 N² values at resolution N.
unsafe fn render_settings(settings: &HcSettings) -> Result<RenderSettings, BackendError> {
    let resolution = settings.resolution;
    let wanted = RenderSettings {
        resolution,
        culling: if settings.culling == 1 {
            Culling::On
        } else {
            Culling::Off
        },
        covered: settings.covered == 1,
    };
    wanted.check()?;
    if settings.culling > 1 || settings.covered > 1 {
        return invalid("`culling` and `covered` are 0 or 1");
    }
    // SAFETY: by this function's contract.
    let weights = unsafe { slice(settings.weights, pixel_count(resolution)) }?;
    // The plugin's arithmetic is compiled into it. Should the host's ever differ, rows would be subtly wrong: refuse.
    if weights != DeltaTable::new(resolution).weights().as_slice() {
        return Err(BackendError::Unsupported(format!(
            "the host's weights at resolution {resolution} are not this plugin's; \
             build both from the same version of hemicube"
        )));
    }
    Ok(wanted)
}

/// Scenes held by sessions of this plugin. Sessions over one scene share everything derived from it.
static SCENES: Mutex<Vec<(u64, Weak<Geometry>)>> = Mutex::new(Vec::new());

/// Rebuilds the scene, or finds it with another session.
///
/// # Safety
/// Its arrays have the lengths given in it.
unsafe fn geometry(scene: &HcScene) -> Result<Arc<Geometry>, BackendError> {
    if scene.identity == 0 {
        // SAFETY: by this function's contract.
        return unsafe { rebuild(scene) }.map(Arc::new);
    }
    // Held during the rebuild: another session waiting for the same scene would only repeat it.
    let mut scenes = SCENES.lock().unwrap_or_else(PoisonError::into_inner);
    scenes.retain(|(_, geometry)| geometry.strong_count() > 0);
    let known = scenes.iter().find(|&&(identity, _)| identity == scene.identity);
    if let Some(geometry) = known.and_then(|(_, geometry)| geometry.upgrade())
        && geometry.patch_count == scene.patch_count
        && geometry.surfaces.len() as u64 == scene.surface_count
    {
        return Ok(geometry);
    }
    // SAFETY: by this function's contract.
    let geometry = Arc::new(unsafe { rebuild(scene) }?);
    scenes.push((scene.identity, Arc::downgrade(&geometry)));
    Ok(geometry)
}

/// # Safety
/// See [`geometry`].
unsafe fn rebuild(scene: &HcScene) -> Result<Geometry, BackendError> {
    let surface_count = count(scene.surface_count)?;
    // SAFETY: by this function's contract; an array of nine f64 is aligned as one.
    let (corners, front, back, nodes) = unsafe {
        (
            slice(scene.corners.cast::<[f64; 9]>(), surface_count)?,
            slice(scene.front, surface_count)?,
            slice(scene.back, surface_count)?,
            slice(scene.nodes, count(scene.node_count)?)?,
        )
    };
    let patch = |number: u32| {
        if number < scene.patch_count {
            Ok(InputPatch(number))
        } else {
            invalid(format!(
                "a surface has patch {number} of a scene of {}",
                scene.patch_count
            ))
        }
    };
    let mut surfaces = Vec::with_capacity(surface_count);
    for ((c, &front), &back) in corners.iter().zip(front).zip(back) {
        surfaces.push(Surface {
            corners: [0, 3, 6].map(|k| DVec3::new(c[k], c[k + 1], c[k + 2])),
            front: patch(front)?,
            back: if back == HC_NO_PATCH { None } else { Some(patch(back)?) },
        });
    }
    if !(scene.plane_tolerance.is_finite() && scene.plane_tolerance >= 0.0) {
        return invalid("the tolerance of planes is negative or not finite");
    }
    let boxes: Vec<Aabb> = surfaces.iter().map(|s| Aabb::from_points(s.corners)).collect();
    let order = (0..u32::MAX).take(surface_count).collect();
    let options = OctreeOptions {
        max_level: scene.octree_levels,
        min_items: scene.octree_min_items,
    };
    let cube = Cube {
        origin: scene.cube_origin.into(),
        half_edge: scene.cube_half_edge,
    };
    let fit = if scene.octree_loose == 0 {
        Fit::Whole
    } else {
        Fit::Loose
    };
    let octree = Octree::from_parts(fit, options, cube, order, nodes.iter().map(node).collect(), &boxes)
        .or_else(|defect| invalid(defect.to_string()))?;
    Ok(Geometry::new(
        surfaces,
        octree,
        scene.patch_count,
        scene.plane_tolerance,
    ))
}

fn node(raw: &HcNode) -> Node {
    Node {
        bounds: Aabb {
            min: raw.min.into(),
            max: raw.max.into(),
        },
        own_bounds: Aabb {
            min: raw.own_min.into(),
            max: raw.own_max.into(),
        },
        cell: raw.cell,
        level: raw.level,
        first_item: raw.first_surface,
        own_end: raw.own_end,
        item_end: raw.surface_end,
        first_child: raw.first_child,
        child_count: raw.child_count,
        parent: (raw.parent != HC_NO_NODE).then_some(raw.parent),
    }
}

fn hemicube(raw: &HcHemicube, patch_count: u32) -> Result<Hemicube, BackendError> {
    let a = &raw.axes;
    let hemicube = Hemicube {
        emitter: (raw.emitter != HC_NO_PATCH).then_some(InputPatch(raw.emitter)),
        origin: raw.origin.into(),
        axes: [0, 3, 6].map(|k| DVec3::new(a[k], a[k + 1], a[k + 2])),
    };
    hemicube.check(patch_count)?;
    Ok(hemicube)
}

fn not_loaded<T>() -> Result<T, BackendError> {
    invalid("no scene is loaded; call `load` first")
}

unsafe extern "C" fn rows<P: Plugin>(session: *mut HcSession, rows: *mut HcRows, error: *mut HcError) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, rows with arrays of the lengths given there,
    // an error or NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            sized(rows, "the rows")?;
            let raw = &mut *rows;
            let Some(loaded) = &open.loaded else {
                return not_loaded();
            };
            let row_count = raw.row_count as usize;
            let hemicubes = slice(raw.hemicubes, row_count)?
                .iter()
                .map(|raw| hemicube(raw, loaded.patch_count))
                .collect::<Result<Vec<_>, _>>()?;
            open.rows.clear();
            let counters = open.session.rows(&hemicubes, &mut open.rows)?;
            copy_rows(&open.rows, raw, loaded.settings.covered)?;
            raw.counters = HcCounters {
                hemicubes: counters.hemicubes,
                nodes_tested: counters.nodes_tested,
                nodes_outside: counters.nodes_outside,
                nodes_hidden: counters.nodes_hidden,
                triangles_transformed: counters.triangles_transformed,
                triangles_drawn: counters.triangles_drawn,
                queries: counters.queries,
                bytes_read_back: counters.bytes_read_back,
                reserved: [0; 8],
            };
            let (before, now) = (open.times, open.session.stage_times());
            open.times = now;
            raw.stage_times = HcStageTimes {
                cull: now.cull.saturating_sub(before.cull),
                render: now.render.saturating_sub(before.render),
                cover: now.cover.saturating_sub(before.cover),
                reduce: now.reduce.saturating_sub(before.reduce),
                read_back: now.read_back.saturating_sub(before.read_back),
                reserved: [0; 3],
            };
            Ok(())
        })
    }
}

/// Copies rows to the host's arrays, if they fit. The host judges their contents.
///
/// # Safety
/// The arrays of `raw` have the lengths given in it.
unsafe fn copy_rows(rows: &RowBlock, raw: &HcRows, covered: bool) -> Result<(), BackendError> {
    let (row_count, capacity) = (raw.row_count as usize, count(raw.capacity)?);
    let entries = rows.patches.len();
    for (what, found, wanted) in [
        ("row ends", rows.row_end.len(), row_count),
        ("escaped weights", rows.escaped.len(), row_count),
        ("blocked weights", rows.blocked.len(), row_count),
        ("visible weights", rows.visible.len(), entries),
        ("covered weights", rows.covered.len(), entries),
    ] {
        if found != wanted {
            return Err(BackendError::Internal(format!("{found} {what} where {wanted} are due")));
        }
    }
    if entries > capacity {
        return Err(BackendError::Internal(format!(
            "{entries} entries in {row_count} rows: there is only room for {capacity}"
        )));
    }
    // SAFETY: by this function's contract.
    unsafe {
        for (to, &from) in slice_mut(raw.row_end, row_count)?.iter_mut().zip(&rows.row_end) {
            *to = from as u64;
        }
        slice_mut(raw.escaped, row_count)?.copy_from_slice(&rows.escaped);
        slice_mut(raw.blocked, row_count)?.copy_from_slice(&rows.blocked);
        slice_mut(raw.patches, entries)?.copy_from_slice(&rows.patches);
        slice_mut(raw.visible, entries)?.copy_from_slice(&rows.visible);
        if covered {
            slice_mut(raw.covered, entries)?.copy_from_slice(&rows.covered);
        }
    }
    Ok(())
}

unsafe extern "C" fn items<P: Plugin>(
    session: *mut HcSession,
    raw: *const HcHemicube,
    out: *mut u32,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, a hemicube, room for an atlas, an error or
    // NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            let Some(loaded) = &open.loaded else {
                return not_loaded();
            };
            let [raw] = slice(raw, 1)? else {
                return invalid("no hemicube");
            };
            let items = open.session.items(&hemicube(raw, loaded.patch_count)?)?;
            let wanted = pixel_count(loaded.settings.resolution);
            if items.seen.len() != wanted {
                return Err(BackendError::Internal(format!(
                    "an item buffer of {} pixels where {wanted} are due",
                    items.seen.len()
                )));
            }
            slice_mut(out, wanted)?.copy_from_slice(&items.seen);
            Ok(())
        })
    }
}

unsafe extern "C" fn pass<P: Plugin>(
    session: *mut HcSession,
    raw: *const HcPass,
    out: *mut u32,
    error: *mut HcError,
) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, a pass with a mask of the length given there,
    // room for an atlas, an error or NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            let Some(loaded) = &open.loaded else {
                return not_loaded();
            };
            let raw = sized(raw, "the pass")?;
            let resolution = loaded.settings.resolution;
            let wanted = pixel_count(resolution);
            if count(raw.word_count)? != wanted / 32 {
                return invalid(format!(
                    "the mask of a pass has {} words where {} are due",
                    raw.word_count,
                    wanted / 32
                ));
            }
            let a = &raw.axes;
            let pass = Pass {
                origin: raw.origin.into(),
                axes: [0, 3, 6].map(|k| DVec3::new(a[k], a[k + 1], a[k + 2])),
                normal: raw.normal.into(),
                offset: raw.offset,
                open: slice(raw.open, wanted / 32)?,
            };
            pass.check(resolution)?;
            let items = open.session.pass(&pass)?;
            if items.seen.len() != wanted {
                return Err(BackendError::Internal(format!(
                    "an item buffer of {} pixels where {wanted} are due",
                    items.seen.len()
                )));
            }
            slice_mut(out, wanted)?.copy_from_slice(&items.seen);
            Ok(())
        })
    }
}

unsafe extern "C" fn rays<P: Plugin>(session: *mut HcSession, rays: *mut HcRays, error: *mut HcError) -> HcStatus {
    // SAFETY: the host's pointers, by the ABI: a session of this plugin, rays with arrays of the length given there, an
    // error or NULL.
    unsafe {
        answer_session::<P>(session, error, |open| {
            let Some(loaded) = &open.loaded else {
                return not_loaded();
            };
            let raw = sized(rays, "the rays")?;
            let wanted = count(raw.ray_count)?;
            // An array of six f64 is aligned as one.
            let ends: Vec<[DVec3; 2]> = slice(raw.ends.cast::<[f64; 6]>(), wanted)?
                .iter()
                .map(|e| [0, 3].map(|k| DVec3::new(e[k], e[k + 1], e[k + 2])))
                .collect();
            let rays = Rays {
                emitter: InputPatch(raw.emitter),
                normal: raw.normal.into(),
                offset: raw.offset,
                ends: &ends,
            };
            rays.check(loaded.patch_count)?;
            let met = open.session.rays(&rays)?;
            if met.len() != wanted {
                let found = met.len();
                return Err(BackendError::Internal(format!("{found} answers to {wanted} rays")));
            }
            slice_mut(raw.met, wanted)?.copy_from_slice(&met);
            Ok(())
        })
    }
}

unsafe extern "C" fn close<P: Plugin>(session: *mut HcSession) {
    if session.is_null() {
        return;
    }
    // SAFETY: made by `open` as a box of this type, and the host calls `close` once, last.
    let open = unsafe { Box::from_raw(session.cast::<Open<P::Session>>()) };
    // There is nobody to tell of a panic here.
    let _ = guarded(|| drop(open));
}
