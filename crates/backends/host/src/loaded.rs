//! A session of a plugin under the contract's trait: structs become pointers, statuses become errors, and every row is
//! judged.

use crate::load::{Library, until_nul};
use hemicube_abi::types::{
    HC_ERROR_DEVICE_LOST, HC_ERROR_INTERNAL, HC_ERROR_INVALID_ARGUMENT, HC_ERROR_OUT_OF_MEMORY, HC_ERROR_PANIC,
    HC_ERROR_UNSUPPORTED, HC_NO_NODE, HC_NO_PATCH, HC_OK, HcCounters, HcError, HcHemicube, HcNode, HcPass, HcRays,
    HcRows, HcScene, HcSession, HcSessionInfo, HcSettings, HcStageTimes, HcStatus,
};
use hemicube_abi::{CHOICES_SIZE, Device, capabilities_from_raw};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Counters, Culling, Geometry, Hemicube, HemicubeBackend, Pass, Rays, RenderSettings,
    StageTimes,
};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::{Items, pixel_count};
use hemicube_contract::outline::Outlines;
use hemicube_contract::row::RowBlock;
use hemicube_spatial::glam::DVec3;
use std::ffi::{CString, c_char};
use std::hash::{BuildHasher, Hasher};
use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Largest room for entries of a call: reserved memory stays below a gigabyte for any scene. Pages beyond the rows are
/// never touched.
const CAPACITY_MAX: usize = 1 << 26;

/// Entries refilled before every call, besides those written in the call before.
const FILLED: usize = 1 << 12;

/// Words of a guard.
const GUARD: usize = 16;
/// The pattern in the guard. No weight, no patch, and no common filler of memory.
const GUARD_WORD: u32 = 0x48C3_9E5B;
/// The contents of outputs before a call: no row and no weight.
const NOTHING: u32 = u32::MAX;
/// The contents of a pixel before a call: no patch, and neither escaped nor blocked.
const UNWRITTEN: u32 = u32::MAX - 0x48C3;

/// Ends the process after a write past an array's end: nothing in memory can be relied on.
fn overrun(library: &Library, array: &str, call: &str) -> ! {
    let text = format!(
        "error: backend `{}` (`{}`) wrote past the end of `{array}` in `{call}`\n\
         hint: memory cannot be trusted any more, so the program ends here; what was stored before is as it was\n",
        library.name(),
        library.path().display()
    );
    // If standard error is closed, there is nobody to tell.
    let _ = std::io::stderr().write_all(text.as_bytes());
    std::process::abort();
}

/// A value with a guard behind it, for a plugin to write to.
#[repr(C)]
pub(crate) struct Guarded<T> {
    value: T,
    guard: [u32; GUARD],
}

impl<T: Copy> Guarded<T> {
    pub(crate) fn new(value: T) -> Self {
        Self {
            value,
            guard: [GUARD_WORD; GUARD],
        }
    }

    /// Returns the value for a plugin; the pointer covers the guard, too.
    pub(crate) fn as_mut_ptr(&mut self) -> *mut T {
        std::ptr::from_mut(self).cast()
    }

    pub(crate) fn check(&self, library: &Library, call: &'static str) {
        // Read anew: the compiler does not know of a plugin's writes.
        if std::hint::black_box(&self.guard).iter().any(|&word| word != GUARD_WORD) {
            overrun(library, "a struct", call);
        }
    }

    pub(crate) fn get(&self) -> T {
        self.value
    }
}

/// The answer of a call.
pub(crate) struct Answer(Guarded<HcError>);

impl Answer {
    pub(crate) fn new() -> Self {
        Self(Guarded::new(HcError { message: [0; 512] }))
    }

    pub(crate) fn as_mut_ptr(&mut self) -> *mut HcError {
        self.0.as_mut_ptr()
    }

    pub(crate) fn read(&self, library: &Library, call: &'static str, status: HcStatus) -> Result<(), BackendError> {
        self.0.check(library, call);
        if status == HC_OK {
            return Ok(());
        }
        let message = match until_nul(&self.0.value.message) {
            message if message.is_empty() => format!("`{call}` failed without a message"),
            message => message,
        };
        Err(match status {
            HC_ERROR_INVALID_ARGUMENT => BackendError::InvalidArgument(message),
            HC_ERROR_UNSUPPORTED => BackendError::Unsupported(message),
            HC_ERROR_OUT_OF_MEMORY => BackendError::OutOfMemory(message),
            HC_ERROR_DEVICE_LOST => BackendError::DeviceLost(message),
            HC_ERROR_INTERNAL => BackendError::Internal(message),
            HC_ERROR_PANIC => BackendError::Internal(format!("it panicked: {message}")),
            other => BackendError::Internal(format!("unknown status {other}: {message}")),
        })
    }
}

/// An array for a plugin to write to, with a guard behind it.
#[derive(Debug, Default)]
struct Array<T> {
    /// Longer than the plugin's part by at least the guard.
    all: Vec<T>,
    length: usize,
    /// The part written, by the plugin's own account.
    used: usize,
}

/// An element of the arrays.
trait Word: Copy + PartialEq {
    const GUARD: Self;
    const NOTHING: Self;
    const ZERO: Self;
}

impl Word for u32 {
    const GUARD: Self = GUARD_WORD;
    const NOTHING: Self = NOTHING;
    const ZERO: Self = 0;
}

impl Word for u64 {
    const GUARD: Self = (GUARD_WORD as u64) << 32 | GUARD_WORD as u64;
    const NOTHING: Self = Self::MAX;
    const ZERO: Self = 0;
}

impl<T: Word> Array<T> {
    /// Makes room for `length` values, filled with the pattern.
    fn prepare(&mut self, length: usize) -> *mut T {
        if self.all.len() < length + GUARD {
            // Zeroes straight from the system: unwritten memory is never touched.
            self.all = vec![T::ZERO; length + GUARD];
        } else {
            let dirty = self.used.max(FILLED).min(self.all.len());
            self.all[..dirty].fill(T::NOTHING);
        }
        let filled = length.min(FILLED);
        self.all[..filled].fill(T::NOTHING);
        self.all[length..length + GUARD].fill(T::GUARD);
        self.length = length;
        self.used = 0;
        self.all.as_mut_ptr()
    }

    /// Likewise, with all of them filled with `value`.
    fn prepare_with(&mut self, length: usize, value: T) -> *mut T {
        let out = self.prepare(length);
        self.all[..length].fill(value);
        out
    }

    /// Returns the first `used` values, written by the plugin on its own account.
    fn written(&mut self, used: usize) -> &[T] {
        self.used = used;
        &self.all[..used]
    }

    fn check(&mut self, library: &Library, name: &'static str, call: &'static str) {
        let guard = std::hint::black_box(&mut self.all[self.length..self.length + GUARD]);
        if guard.iter().any(|&word| word != T::GUARD) {
            overrun(library, name, call);
        }
        guard.fill(T::NOTHING);
    }
}

/// The arrays of `rows`.
#[derive(Debug, Default)]
struct Outputs {
    row_end: Array<u64>,
    patches: Array<u32>,
    visible: Array<u32>,
    covered: Array<u32>,
    escaped: Array<u32>,
    blocked: Array<u32>,
    /// The rows of a call, to be checked before they join the others.
    block: RowBlock,
}

#[derive(Clone, Debug)]
struct Loaded {
    geometry: Arc<Geometry>,
    settings: RenderSettings,
    /// Weight of each pixel of the atlas.
    weights: Arc<[u32]>,
    /// Covered weights, if they are asked for and the plugin does not count them.
    outlines: Option<Arc<Outlines>>,
}

/// A session of a plugin.
#[derive(Debug)]
pub struct LoadedBackend {
    library: Arc<Library>,
    device_number: u32,
    device: Device,
    options: CString,
    /// True if passes are the host's, whatever the session can.
    leaves_passes: bool,
    /// True if all rays are the host's.
    leaves_rays: bool,
    /// NULL once it has been closed.
    session: *mut HcSession,
    /// Why it was closed, once it has failed for good.
    failed: Option<String>,
    info: BackendInfo,
    choices: Vec<String>,
    loaded: Option<Loaded>,
    times: StageTimes,
    outputs: Outputs,
    items: Array<u32>,
}

// SAFETY: the ABI lets a session be used from one thread after another; `&mut self` and `Drop` keep calls apart.
unsafe impl Send for LoadedBackend {}

/// The data of a session's calls; [`Answer::read`] handles their outcome.
type Call<'a> = dyn FnOnce(*mut HcSession, *mut HcError) -> HcStatus + 'a;

impl LoadedBackend {
    /// Opens a session on a device by its place in [`Library::devices`]. `options` is `key=value,key=value`.
    ///
    /// # Errors
    /// The plugin's message.
    pub fn open(
        library: Arc<Library>,
        device_number: u32,
        device: Device,
        options: &str,
    ) -> Result<Self, BackendError> {
        let options =
            CString::new(options).map_err(|_| BackendError::InvalidArgument("an option has a NUL in it".to_owned()))?;
        let Some(open) = library.table().open else {
            unreachable!("judged when it was loaded")
        };
        let host = library.host();
        let mut session = Guarded::new(std::ptr::null_mut());
        let mut answer = Answer::new();
        // SAFETY: a function of the table, any-thread; every pointer is valid while it runs.
        let status = unsafe {
            open(
                &raw const host,
                device_number,
                options.as_ptr(),
                session.as_mut_ptr(),
                answer.as_mut_ptr(),
            )
        };
        session.check(&library, "open");
        answer.read(&library, "open", status)?;
        if session.get().is_null() {
            return Err(BackendError::Internal(
                "`open` gave no session, and no error".to_owned(),
            ));
        }
        let mut opened = Self {
            info: BackendInfo {
                name: library.name().to_owned(),
                version: library.version().to_owned(),
                device: device.name.clone(),
                capabilities: device.capabilities,
                preferred_rows: device.preferred_rows,
            },
            library,
            device_number,
            device,
            options,
            leaves_passes: false,
            leaves_rays: false,
            session: session.get(),
            failed: None,
            choices: Vec::new(),
            loaded: None,
            times: StageTimes::default(),
            outputs: Outputs::default(),
            items: Array::default(),
        };
        opened.ask_info()?;
        Ok(opened)
    }

    /// The session without [`pass`](HemicubeBackend::pass): the host draws what is seen through portals.
    #[must_use]
    pub fn without_passes(mut self) -> Self {
        self.leaves_passes = true;
        self.info.capabilities.passes = false;
        self
    }

    /// The session without [`rays`](HemicubeBackend::rays): the host casts them.
    #[must_use]
    pub fn without_rays(mut self) -> Self {
        self.leaves_rays = true;
        self.info.capabilities.rays = false;
        self
    }

    /// Its library.
    pub fn library(&self) -> &Arc<Library> {
        &self.library
    }

    /// Its device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Calls the plugin, unless the session has failed for good; closes it if it now has.
    fn call(&mut self, name: &'static str, call: Box<Call<'_>>) -> Result<(), BackendError> {
        if let Some(failed) = &self.failed {
            return Err(BackendError::Internal(format!(
                "the session was closed after it had failed: {failed}"
            )));
        }
        let mut answer = Answer::new();
        let status = call(self.session, answer.as_mut_ptr());
        let result = answer.read(&self.library, name, status);
        if let Err(error) = &result {
            self.judge(error);
        }
        result
    }

    /// Closes the session after an error that allows only `close`.
    fn judge(&mut self, error: &BackendError) {
        let usable = matches!(
            error,
            BackendError::InvalidArgument(_) | BackendError::Unsupported(_) | BackendError::OutOfMemory(_)
        );
        if !usable {
            self.failed = Some(error.to_string());
            self.close();
        }
    }

    /// Closes the session for a defect found by the host.
    fn defect(&mut self, what: String) -> BackendError {
        let error = BackendError::Internal(what);
        self.judge(&error);
        error
    }

    fn close(&mut self) {
        let session = std::mem::replace(&mut self.session, std::ptr::null_mut());
        if let Some(close) = self.library.table().close
            && !session.is_null()
        {
            // SAFETY: a session given by `open`, closed once, and never used again.
            unsafe { close(session) }
        }
    }

    /// Asks for the session's details, if the plugin can tell.
    fn ask_info(&mut self) -> Result<(), BackendError> {
        if let Some(info) = self.library.table().info {
            #[allow(clippy::cast_possible_truncation, reason = "some hundreds of bytes")]
            let mut raw = Guarded::new(HcSessionInfo {
                struct_size: size_of::<HcSessionInfo>() as u32,
                preferred_rows: 0,
                capabilities: 0,
                device: [0; 128],
                version: [0; 64],
                choices: [0; CHOICES_SIZE],
            });
            // SAFETY: a function of the table, with its own session; the struct is valid while it runs.
            let call = |session, error| unsafe { info(session, raw.as_mut_ptr(), error) };
            self.call("info", Box::new(call))?;
            raw.check(&self.library, "info");
            let raw = raw.get();
            self.info.preferred_rows = raw.preferred_rows.max(1) as usize;
            self.info.capabilities = capabilities_from_raw(raw.capabilities);
            let or = |text: &[c_char], other: &str| match until_nul(text) {
                text if text.is_empty() => other.to_owned(),
                text => text,
            };
            self.info.device = or(&raw.device, &self.device.name);
            self.info.version = or(&raw.version, self.library.version());
            self.choices = until_nul(&raw.choices).lines().map(str::to_owned).collect();
        }
        if self.info.capabilities.items && self.library.table().items.is_none() {
            return Err(self.defect("it claims item buffers, but its table has no `items`".to_owned()));
        }
        if self.info.capabilities.passes && self.library.table().pass.is_none() {
            return Err(self.defect("it claims passes through portals, but its table has no `pass`".to_owned()));
        }
        if self.info.capabilities.rays && self.library.table().rays.is_none() {
            return Err(self.defect("it claims rays, but its table has no `rays`".to_owned()));
        }
        self.info.capabilities.passes &= !self.leaves_passes;
        self.info.capabilities.rays &= !self.leaves_rays;
        Ok(())
    }

    fn load_with(&mut self, loaded: Loaded) -> Result<(), BackendError> {
        self.loaded = None;
        let Loaded {
            geometry,
            settings,
            weights,
            ..
        } = &loaded;
        let scene = Scene::new(geometry);
        let raw_scene = scene.raw(geometry);
        #[allow(clippy::cast_possible_truncation, reason = "some dozens of bytes")]
        let raw_settings = HcSettings {
            struct_size: size_of::<HcSettings>() as u32,
            resolution: settings.resolution,
            culling: u32::from(settings.culling == Culling::On),
            covered: u32::from(settings.covered),
            weights: weights.as_ptr(),
        };
        let Some(load) = self.library.table().load else {
            unreachable!("judged when it was loaded")
        };
        // SAFETY: a function of the table, with its own session; scene and settings are valid while it runs, and their
        // arrays as long as they say.
        let call = |session, error| unsafe { load(session, &raw const raw_scene, &raw const raw_settings, error) };
        self.call("load", Box::new(call))?;
        self.times = StageTimes::default();
        self.ask_info()?;
        self.loaded = Some(loaded);
        Ok(())
    }

    /// Refuses items that are no patch of the scene.
    fn judged(&mut self, items: Items, patch_count: u32) -> Result<Items, BackendError> {
        let legal = |&item: &u32| item < patch_count || item == Items::BLOCKED || item == Items::ESCAPED;
        match items.seen.iter().position(|item| !legal(item)) {
            None => Ok(items),
            Some(place) if items.seen[place] == UNWRITTEN => {
                Err(self.defect(format!("pixel {place} of an item buffer was not written")))
            }
            Some(place) => Err(self.defect(format!(
                "pixel {place} shows patch {} of a scene of {patch_count} patches",
                items.seen[place]
            ))),
        }
    }

    fn loaded(&self) -> Result<&Loaded, BackendError> {
        self.loaded
            .as_ref()
            .ok_or_else(|| BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned()))
    }

    /// Returns the number of rows that a call has room for.
    fn rows_of(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let loaded = self.loaded()?;
        let (patch_count, covered) = (loaded.geometry.patch_count, loaded.settings.covered);
        let row_count = hemicubes.len();
        let capacity = row_count * patch_count as usize;
        let raw_hemicubes: Vec<HcHemicube> = hemicubes.iter().map(raw_hemicube).collect();
        let outputs = &mut self.outputs;
        #[allow(
            clippy::cast_possible_truncation,
            reason = "some hundreds of bytes; fewer rows than entries"
        )]
        let mut rows = Guarded::new(HcRows {
            struct_size: size_of::<HcRows>() as u32,
            row_count: row_count as u32,
            capacity: capacity as u64,
            hemicubes: raw_hemicubes.as_ptr(),
            row_end: outputs.row_end.prepare(row_count),
            patches: outputs.patches.prepare(capacity),
            visible: outputs.visible.prepare(capacity),
            covered: if covered {
                outputs.covered.prepare(capacity)
            } else {
                std::ptr::null_mut()
            },
            escaped: outputs.escaped.prepare(row_count),
            blocked: outputs.blocked.prepare(row_count),
            counters: HcCounters::default(),
            stage_times: HcStageTimes::default(),
        });
        let Some(render) = self.library.table().rows else {
            unreachable!("judged when it was loaded")
        };
        // SAFETY: a function of the table, with its own session; the arrays are as long as is said, and nobody else
        // touches them while it runs.
        let call = |session, error| unsafe { render(session, rows.as_mut_ptr(), error) };
        let result = self.call("rows", Box::new(call));
        rows.check(&self.library, "rows");
        let (library, outputs) = (&self.library, &mut self.outputs);
        outputs.row_end.check(library, "row_end", "rows");
        outputs.patches.check(library, "patches", "rows");
        outputs.visible.check(library, "visible", "rows");
        if covered {
            outputs.covered.check(library, "covered", "rows");
        }
        outputs.escaped.check(library, "escaped", "rows");
        outputs.blocked.check(library, "blocked", "rows");
        result?;
        if let Err(defect) = self.outputs.collect(row_count, capacity, covered) {
            return Err(self.defect(defect));
        }
        if let Err(defect) = self.outputs.block.check(row_count, patch_count, covered) {
            return Err(self.defect(defect.to_string()));
        }
        match self.loaded.as_ref().and_then(|loaded| loaded.outlines.as_ref()) {
            Some(outlines) => append(&outlines.complete(hemicubes, &self.outputs.block), out),
            None => append(&self.outputs.block, out),
        }
        let rows = rows.get();
        add_times(&mut self.times, &rows.stage_times);
        Ok(counters(&rows.counters))
    }
}

impl Outputs {
    /// Takes the rows out of the arrays, if the ends of rows are plausible.
    fn collect(&mut self, row_count: usize, capacity: usize, covered: bool) -> Result<(), String> {
        let block = &mut self.block;
        block.clear();
        let mut start = 0;
        for (row, &end) in self.row_end.written(row_count).iter().enumerate() {
            let end = usize::try_from(end).unwrap_or(usize::MAX);
            if end < start || end > capacity {
                return Err(format!(
                    "row {row} of {row_count} ends at entry {end}; \
                     it begins at {start}, and there is room for {capacity}"
                ));
            }
            block.row_end.push(end);
            start = end;
        }
        block.patches.extend_from_slice(self.patches.written(start));
        block.visible.extend_from_slice(self.visible.written(start));
        if covered {
            block.covered.extend_from_slice(self.covered.written(start));
        } else {
            block.covered.resize(start, 0);
        }
        block.escaped.extend_from_slice(self.escaped.written(row_count));
        block.blocked.extend_from_slice(self.blocked.written(row_count));
        Ok(())
    }
}

impl Drop for LoadedBackend {
    fn drop(&mut self) {
        self.close();
    }
}

impl HemicubeBackend for LoadedBackend {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        let resolution = settings.resolution;
        settings.check()?;
        if resolution > self.device.max_resolution {
            return Err(BackendError::Unsupported(format!(
                "resolution {resolution} is more than the {} that `{}` takes",
                self.device.max_resolution, self.info.device
            )));
        }
        let outlines = (settings.covered && !self.info.capabilities.covered)
            .then(|| Arc::new(Outlines::new(geometry, resolution)));
        let weights = match &self.loaded {
            Some(loaded) if loaded.settings.resolution == resolution => Arc::clone(&loaded.weights),
            _ => DeltaTable::new(resolution).weights().into(),
        };
        self.load_with(Loaded {
            geometry: Arc::clone(geometry),
            settings: RenderSettings {
                covered: settings.covered && outlines.is_none(),
                ..settings
            },
            weights,
            outlines,
        })
    }

    fn choices(&self) -> Vec<String> {
        let mut choices = self.choices.clone();
        if self.loaded.as_ref().is_some_and(|loaded| loaded.outlines.is_some()) {
            choices.push("covered weights: counted on the processor, as the plugin supplies none".to_owned());
        }
        choices
    }

    fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Another session on the same device, with the same options and scene.
    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        let loaded = self.loaded()?.clone();
        let options = self.options.to_str().unwrap_or_default();
        let mut other = Self::open(
            Arc::clone(&self.library),
            self.device_number,
            self.device.clone(),
            options,
        )?;
        (other.leaves_passes, other.leaves_rays) = (self.leaves_passes, self.leaves_rays);
        other.load_with(loaded)?;
        Ok(Box::new(other))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let patch_count = self.loaded()?.geometry.patch_count;
        check_hemicubes(hemicubes, patch_count)?;
        let at_once = (CAPACITY_MAX / (patch_count as usize).max(1)).clamp(1, CAPACITY_MAX);
        let mut sum = Counters::default();
        for some in hemicubes.chunks(at_once) {
            sum += self.rows_of(some, out)?;
        }
        Ok(sum)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let loaded = self.loaded()?;
        let (patch_count, resolution) = (loaded.geometry.patch_count, loaded.settings.resolution);
        check_hemicubes(std::slice::from_ref(hemicube), patch_count)?;
        let Some(items) = self.library.table().items.filter(|_| self.info.capabilities.items) else {
            return Err(BackendError::Unsupported(format!(
                "backend `{}` does not hand out item buffers",
                self.info.name
            )));
        };
        let raw = raw_hemicube(hemicube);
        let pixels = pixel_count(resolution);
        let out = self.items.prepare_with(pixels, UNWRITTEN);
        // SAFETY: a function of the table, with its own session; there is room for the whole atlas.
        let call = |session, error| unsafe { items(session, &raw const raw, out, error) };
        let result = self.call("items", Box::new(call));
        self.items.check(&self.library, "items", "items");
        result?;
        let seen = self.items.written(pixels).to_vec();
        self.judged(Items { resolution, seen }, patch_count)
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        let loaded = self.loaded()?;
        let (patch_count, resolution) = (loaded.geometry.patch_count, loaded.settings.resolution);
        pass.check(resolution)?;
        let Some(draw) = self.library.table().pass.filter(|_| self.info.capabilities.passes) else {
            return Err(BackendError::Unsupported(format!(
                "backend `{}` does not draw what is seen through portals",
                self.info.name
            )));
        };
        #[allow(clippy::cast_possible_truncation, reason = "some dozens of bytes")]
        let raw = HcPass {
            struct_size: size_of::<HcPass>() as u32,
            reserved: 0,
            origin: pass.origin.to_array(),
            axes: raw_axes(&pass.axes),
            normal: pass.normal.to_array(),
            offset: pass.offset,
            word_count: pass.open.len() as u64,
            open: pass.open.as_ptr(),
        };
        let pixels = pixel_count(resolution);
        let out = self.items.prepare_with(pixels, UNWRITTEN);
        // SAFETY: a function of the table, with its own session; the mask is as long as the pass says, and there is
        // room for the whole atlas.
        let call = |session, error| unsafe { draw(session, &raw const raw, out, error) };
        let result = self.call("pass", Box::new(call));
        self.items.check(&self.library, "items", "pass");
        result?;
        let written = self.items.written(pixels).iter().enumerate();
        let seen = written.map(|(pixel, &item)| if pass.is_open(pixel) { item } else { Items::ESCAPED });
        let seen = seen.collect();
        self.judged(Items { resolution, seen }, patch_count)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let patch_count = self.loaded()?.geometry.patch_count;
        rays.check(patch_count)?;
        let Some(cast) = self.library.table().rays.filter(|_| self.info.capabilities.rays) else {
            return Err(BackendError::Unsupported(format!(
                "backend `{}` does not cast rays",
                self.info.name
            )));
        };
        let count = rays.ends.len();
        let ends: Vec<f64> = rays.ends.as_flattened().iter().flat_map(|end| end.to_array()).collect();
        #[allow(clippy::cast_possible_truncation, reason = "some dozens of bytes")]
        let mut raw = Guarded::new(HcRays {
            struct_size: size_of::<HcRays>() as u32,
            emitter: rays.emitter.0,
            normal: rays.normal.to_array(),
            offset: rays.offset,
            ray_count: count as u64,
            ends: ends.as_ptr(),
            met: self.items.prepare_with(count, UNWRITTEN),
        });
        // SAFETY: a function of the table, with its own session; the arrays are as long as the rays say.
        let call = |session, error| unsafe { cast(session, raw.as_mut_ptr(), error) };
        let result = self.call("rays", Box::new(call));
        raw.check(&self.library, "rays");
        self.items.check(&self.library, "met", "rays");
        result?;
        let met = self.items.written(count).to_vec();
        let is_answer =
            |&answer: &u32| answer < patch_count || [Items::ESCAPED, Items::BLOCKED, Rays::DOUBTFUL].contains(&answer);
        match met.iter().position(|answer| !is_answer(answer)) {
            None => Ok(met),
            Some(ray) => Err(self.defect(format!(
                "ray {ray} of {count} meets {}, which is no patch of a scene of {patch_count}",
                met[ray]
            ))),
        }
    }
}

/// Refuses requests against the contract before a plugin sees them.
fn check_hemicubes(hemicubes: &[Hemicube], patch_count: u32) -> Result<(), BackendError> {
    hemicubes.iter().try_for_each(|hemicube| hemicube.check(patch_count))
}

fn raw_hemicube(hemicube: &Hemicube) -> HcHemicube {
    HcHemicube {
        emitter: hemicube.emitter.map_or(HC_NO_PATCH, |patch| patch.0),
        reserved: 0,
        origin: hemicube.origin.to_array(),
        axes: raw_axes(&hemicube.axes),
    }
}

fn raw_axes(of: &[DVec3; 3]) -> [f64; 9] {
    let mut axes = [0.0; 9];
    for (to, from) in axes.chunks_exact_mut(3).zip(of) {
        to.copy_from_slice(&from.to_array());
    }
    axes
}

fn append(from: &RowBlock, to: &mut RowBlock) {
    let start = to.patches.len();
    to.row_end.extend(from.row_end.iter().map(|end| start + end));
    to.patches.extend_from_slice(&from.patches);
    to.visible.extend_from_slice(&from.visible);
    to.covered.extend_from_slice(&from.covered);
    to.escaped.extend_from_slice(&from.escaped);
    to.blocked.extend_from_slice(&from.blocked);
}

fn counters(raw: &HcCounters) -> Counters {
    Counters {
        hemicubes: raw.hemicubes,
        nodes_tested: raw.nodes_tested,
        nodes_outside: raw.nodes_outside,
        nodes_hidden: raw.nodes_hidden,
        triangles_transformed: raw.triangles_transformed,
        triangles_drawn: raw.triangles_drawn,
        queries: raw.queries,
        bytes_read_back: raw.bytes_read_back,
    }
}

/// Sums of a plugin's arbitrary numbers must not overflow.
fn add_times(sum: &mut StageTimes, raw: &HcStageTimes) {
    for (sum, time) in [
        (&mut sum.cull, raw.cull),
        (&mut sum.render, raw.render),
        (&mut sum.cover, raw.cover),
        (&mut sum.reduce, raw.reduce),
        (&mut sum.read_back, raw.read_back),
    ] {
        *sum = sum.saturating_add(time);
    }
}

/// A scene's number, unique in this process, over all hosts in it.
struct Identity(u64);

impl Identity {
    fn of(geometry: &Geometry) -> u64 {
        static SEED: OnceLock<u64> = OnceLock::new();
        static NEXT: AtomicU64 = AtomicU64::new(0);
        geometry
            .kept(|_| {
                let seed = SEED.get_or_init(|| std::hash::RandomState::new().build_hasher().finish());
                Self(seed.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)).max(1))
            })
            .0
    }
}

/// A scene's arrays in the table's layout.
struct Scene {
    corners: Vec<f64>,
    front: Vec<u32>,
    back: Vec<u32>,
    nodes: Vec<HcNode>,
}

impl Scene {
    fn new(geometry: &Geometry) -> Self {
        let surfaces = &geometry.surfaces;
        let nodes = geometry.octree.nodes().iter().map(|node| HcNode {
            min: node.bounds.min.to_array(),
            max: node.bounds.max.to_array(),
            own_min: node.own_bounds.min.to_array(),
            own_max: node.own_bounds.max.to_array(),
            first_surface: node.first_item,
            own_end: node.own_end,
            surface_end: node.item_end,
            first_child: node.first_child,
            child_count: node.child_count,
            parent: node.parent.unwrap_or(HC_NO_NODE),
            cell: node.cell,
            level: node.level,
        });
        Self {
            corners: surfaces
                .iter()
                .flat_map(|s| s.corners)
                .flat_map(|c| c.to_array())
                .collect(),
            front: surfaces.iter().map(|s| s.front.0).collect(),
            back: surfaces
                .iter()
                .map(|s| s.back.map_or(HC_NO_PATCH, |patch| patch.0))
                .collect(),
            nodes: nodes.collect(),
        }
    }

    fn raw(&self, geometry: &Geometry) -> HcScene {
        let (octree, cube) = (&geometry.octree, geometry.octree.cube());
        #[allow(clippy::cast_possible_truncation, reason = "some hundreds of bytes")]
        HcScene {
            struct_size: size_of::<HcScene>() as u32,
            patch_count: geometry.patch_count,
            identity: Identity::of(geometry),
            plane_tolerance: geometry.plane_tolerance,
            surface_count: self.front.len() as u64,
            corners: self.corners.as_ptr(),
            front: self.front.as_ptr(),
            back: self.back.as_ptr(),
            node_count: self.nodes.len() as u64,
            nodes: self.nodes.as_ptr(),
            cube_origin: cube.origin.to_array(),
            cube_half_edge: cube.half_edge,
            octree_levels: octree.options().max_level,
            octree_min_items: octree.options().min_items,
            octree_loose: u32::from(octree.fit() == hemicube_spatial::Fit::Loose),
            reserved: 0,
        }
    }
}
