//! Devices and contexts: EGL without a window, and the functions of OpenGL missing in glow.
//!
//! Displays are opened by the device platform (`EGL_EXT_platform_device`). Mesa's surfaceless platform is used only if
//! that gives none, or for a second session at once (below): its display is one for the whole process, and anybody
//! terminating it takes our contexts with it. For the same reason we never terminate displays; they live as long as the
//! process.
//!
//! A call of the backend makes its context current when it begins and releases it when it ends, so that the next call
//! may come from any thread.
//!
//! Contexts of one display of Mesa's llvmpipe share their rasteriser, and not soundly: with 22.3.6, about one run in
//! thirty of two sessions at once ended in a segmentation fault inside the driver. On software devices, contexts of a
//! display therefore take turns. Another display has its own rasteriser. A software device's contexts are spread over
//! its display and the surfaceless one, if both lead to the same driver, so that two go on at once. There is no third:
//! a platform always gives the same display.

use crate::conv;
use glow::HasContext;
use hemicube_contract::backend::BackendError;
use hemicube_shaders::OfStage;
use std::ffi::{CStr, c_char, c_void};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

type Pointer = *mut c_void;

/// The functions of EGL 1.5 in use, by their own names.
struct Egl {
    get_proc_address: unsafe extern "system" fn(*const c_char) -> Pointer,
    get_error: unsafe extern "system" fn() -> i32,
    query_string: unsafe extern "system" fn(Pointer, i32) -> *const c_char,
    get_platform_display: unsafe extern "system" fn(u32, Pointer, *const isize) -> Pointer,
    initialize: unsafe extern "system" fn(Pointer, *mut i32, *mut i32) -> u32,
    bind_api: unsafe extern "system" fn(u32) -> u32,
    create_context: unsafe extern "system" fn(Pointer, Pointer, Pointer, *const i32) -> Pointer,
    destroy_context: unsafe extern "system" fn(Pointer, Pointer) -> u32,
    make_current: unsafe extern "system" fn(Pointer, Pointer, Pointer, Pointer) -> u32,
    query_devices: Option<unsafe extern "system" fn(i32, *mut Pointer, *mut i32) -> u32>,
    query_device_string: Option<unsafe extern "system" fn(Pointer, i32) -> *const c_char>,
    /// Never unloaded: drivers leave threads and thread-local destructors behind.
    _library: libloading::Library,
}

const EGL_EXTENSIONS: i32 = 0x3055;
const EGL_NONE: i32 = 0x3038;
const EGL_NOT_INITIALIZED: i32 = 0x3001;
const EGL_OPENGL_API: u32 = 0x30A2;
const EGL_CONTEXT_MAJOR_VERSION: i32 = 0x3098;
const EGL_CONTEXT_MINOR_VERSION: i32 = 0x30FB;
const EGL_CONTEXT_OPENGL_PROFILE_MASK: i32 = 0x30FD;
const EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT: i32 = 1;
const EGL_CONTEXT_OPENGL_DEBUG: i32 = 0x31B0;
const EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY: i32 = 0x31BD;
const EGL_LOSE_CONTEXT_ON_RESET: i32 = 0x31BF;
const EGL_PLATFORM_DEVICE_EXT: u32 = 0x313F;
const EGL_PLATFORM_SURFACELESS_MESA: u32 = 0x31DD;

impl Egl {
    fn load() -> Result<Self, String> {
        let name = "libEGL.so.1";
        let missing = |error: libloading::Error| format!("`{name}` cannot be loaded: {error}");
        // SAFETY: the library is EGL's loader, whose initialisers have no preconditions, and each symbol is given the
        // type that EGL 1.5 declares for it.
        unsafe {
            let library = libloading::Library::new(name).map_err(missing)?;
            macro_rules! symbol {
                ($symbol:literal) => {
                    *library.get($symbol).map_err(missing)?
                };
            }
            let get_proc_address: unsafe extern "system" fn(*const c_char) -> Pointer = symbol!(b"eglGetProcAddress\0");
            Ok(Self {
                get_proc_address,
                get_error: symbol!(b"eglGetError\0"),
                query_string: symbol!(b"eglQueryString\0"),
                get_platform_display: symbol!(b"eglGetPlatformDisplay\0"),
                initialize: symbol!(b"eglInitialize\0"),
                bind_api: symbol!(b"eglBindAPI\0"),
                create_context: symbol!(b"eglCreateContext\0"),
                destroy_context: symbol!(b"eglDestroyContext\0"),
                make_current: symbol!(b"eglMakeCurrent\0"),
                query_devices: std::mem::transmute::<
                    Pointer,
                    Option<unsafe extern "system" fn(i32, *mut Pointer, *mut i32) -> u32>,
                >(get_proc_address(c"eglQueryDevicesEXT".as_ptr())),
                query_device_string: std::mem::transmute::<
                    Pointer,
                    Option<unsafe extern "system" fn(Pointer, i32) -> *const c_char>,
                >(get_proc_address(c"eglQueryDeviceStringEXT".as_ptr())),
                _library: library,
            })
        }
    }

    fn error(&self) -> String {
        // SAFETY: no preconditions.
        let code = unsafe { (self.get_error)() };
        let name = match code {
            0x3000 => "success",
            0x3001 => "not initialised",
            0x3002 => "bad access",
            0x3003 => "bad allocation",
            0x3004 => "bad attribute",
            0x3005 => "bad configuration",
            0x3006 => "bad context",
            0x3008 => "bad display",
            0x3009 => "bad match",
            0x300C => "bad parameter",
            0x300E => "context lost",
            _ => "unknown",
        };
        format!("EGL error {code:#x}, {name}")
    }

    fn string(&self, display: Pointer) -> String {
        // SAFETY: the display is one that EGL gave, or none, and the string is EGL's own.
        unsafe { text((self.query_string)(display, EGL_EXTENSIONS)) }
    }

    /// Opens every display, hardware first. Returns the reasons of failures, too.
    fn displays(&self) -> (Vec<Display>, Vec<String>) {
        let (mut found, mut reasons) = (Vec::new(), Vec::new());
        if let (Some(query), Some(describe)) = (self.query_devices, self.query_device_string) {
            let mut devices = [std::ptr::null_mut(); 32];
            let mut count = 0;
            // SAFETY: there is room for the 32 devices asked for; a device's string is EGL's own.
            let described: Vec<(Pointer, String)> = unsafe {
                if query(32, devices.as_mut_ptr(), &mut count) == 0 {
                    reasons.push(format!("no EGL device can be listed: {}", self.error()));
                    count = 0;
                }
                let count = usize::try_from(count).unwrap_or(0).min(devices.len());
                devices[..count]
                    .iter()
                    .map(|&device| (device, text(describe(device, EGL_EXTENSIONS))))
                    .collect()
            };
            for (number, (device, extensions)) in described.into_iter().enumerate() {
                let software = extensions.contains("EGL_MESA_device_software");
                match self.open_display(EGL_PLATFORM_DEVICE_EXT, device) {
                    Ok(handle) => found.push(Display::new(handle, software)),
                    Err(reason) => reasons.push(format!("EGL device {number}: {reason}")),
                }
            }
        } else {
            reasons.push("EGL lists no devices (EGL_EXT_device_enumeration is missing)".to_owned());
        }
        if found.is_empty() {
            match self.open_display(EGL_PLATFORM_SURFACELESS_MESA, std::ptr::null_mut()) {
                Ok(handle) => found.push(Display::new(handle, false)),
                Err(reason) => reasons.push(format!("surfaceless display: {reason}")),
            }
        }
        found.sort_by_key(|display| display.software);
        (found, reasons)
    }

    fn open_display(&self, platform: u32, native: Pointer) -> Result<Pointer, String> {
        const NO_ATTRIBUTES: [isize; 1] = [EGL_NONE as isize];
        // SAFETY: `native` is a device of this platform or none; the list of attributes is ended.
        let handle = unsafe { (self.get_platform_display)(platform, native, NO_ATTRIBUTES.as_ptr()) };
        if handle.is_null() {
            return Err(self.error());
        }
        self.initialize(handle)?;
        let extensions = self.string(handle);
        for wanted in ["EGL_KHR_no_config_context", "EGL_KHR_surfaceless_context"] {
            if !extensions.contains(wanted) {
                return Err(format!("`{wanted}` is missing"));
            }
        }
        Ok(handle)
    }

    fn initialize(&self, display: Pointer) -> Result<(), String> {
        // SAFETY: the display is one that EGL gave; initialising one twice is allowed.
        match unsafe { (self.initialize)(display, std::ptr::null_mut(), std::ptr::null_mut()) } {
            0 => Err(self.error()),
            _ => Ok(()),
        }
    }

    /// Makes a context of OpenGL 4.5; one that reports its loss, if the driver has such.
    fn create_context(&self, display: Pointer, debug: bool) -> Result<Pointer, String> {
        // SAFETY: binding an interface has no preconditions.
        if unsafe { (self.bind_api)(EGL_OPENGL_API) } == 0 {
            return Err(format!("EGL has no OpenGL: {}", self.error()));
        }
        let plain = [
            EGL_CONTEXT_MAJOR_VERSION,
            4,
            EGL_CONTEXT_MINOR_VERSION,
            5,
            EGL_CONTEXT_OPENGL_PROFILE_MASK,
            EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
            EGL_CONTEXT_OPENGL_DEBUG,
            i32::from(debug),
        ];
        let tells_of_loss = [
            EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY,
            EGL_LOSE_CONTEXT_ON_RESET,
        ];
        let create = |attributes: &[i32]| {
            let attributes = [attributes, &[EGL_NONE]].concat();
            // SAFETY: the display is open, no configuration is allowed by EGL_KHR_no_config_context, and the list of
            // attributes is ended.
            unsafe { (self.create_context)(display, std::ptr::null_mut(), std::ptr::null_mut(), attributes.as_ptr()) }
        };
        let mut context = create(&[&plain[..], &tells_of_loss].concat());
        // SAFETY: no preconditions.
        if context.is_null() && unsafe { (self.get_error)() } == EGL_NOT_INITIALIZED {
            // Another library in this process has terminated the display: it opens again.
            self.initialize(display)?;
            context = create(&[&plain[..], &tells_of_loss].concat());
        }
        if context.is_null() {
            context = create(&plain);
        }
        if context.is_null() {
            return Err(format!("no context of OpenGL 4.5: {}", self.error()));
        }
        Ok(context)
    }
}

/// Copies a C string; empty for null.
///
/// # Safety
/// `string` is null or points at a string ending in a zero byte.
unsafe fn text(string: *const c_char) -> String {
    if string.is_null() {
        return String::new();
    }
    // SAFETY: the caller's promise.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}

/// An open display. Handles of EGL may be used from any thread.
struct Display {
    handle: Pointer,
    software: bool,
    /// Name of the GPU and its driver, once asked for; `None` if that did not open.
    driver: OnceLock<Option<String>>,
    /// Number of its contexts.
    contexts: AtomicUsize,
    /// Held while a context is made, and on a software device while one is in use.
    turn: Mutex<()>,
}

impl Display {
    fn new(handle: Pointer, software: bool) -> Self {
        Self {
            handle,
            software,
            driver: OnceLock::new(),
            contexts: AtomicUsize::new(0),
            turn: Mutex::new(()),
        }
    }

    /// Waits for the right to use one of its contexts, until the guard is dropped.
    fn turn(&self) -> MutexGuard<'_, ()> {
        // The lock guards no data, so none can be left half changed.
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// EGL and its displays; one for the process.
struct System {
    egl: Egl,
    displays: Vec<Display>,
    reasons: Vec<String>,
    /// Another display of the software device, opened when first wanted; `None` if there is none.
    another: OnceLock<Option<Display>>,
    choosing: Mutex<()>,
}

impl System {
    /// Chooses the display of a new context: `display`, or another of the same driver with fewer contexts.
    fn place(&'static self, display: &'static Display) -> Place {
        // Whoever comes next has to find this one counted.
        let _choosing = self.choosing.lock().unwrap_or_else(PoisonError::into_inner);
        let busy = display.contexts.load(Ordering::Relaxed);
        let another = if busy > 0 { self.another(display) } else { None };
        Place::on(
            another
                .filter(|another| another.contexts.load(Ordering::Relaxed) < busy)
                .unwrap_or(display),
        )
    }

    /// Finds another display leading to the driver of a software device's display.
    fn another(&'static self, display: &'static Display) -> Option<&'static Display> {
        if !display.software {
            return None;
        }
        let another = self.another.get_or_init(|| {
            let (platform, native) = (EGL_PLATFORM_SURFACELESS_MESA, std::ptr::null_mut());
            let handle = self.egl.open_display(platform, native).ok()?;
            let is_new = self.displays.iter().all(|known| known.handle != handle);
            is_new.then(|| Display::new(handle, true))
        });
        // On a machine with a GPU, it may lead there.
        let driver = |display: &'static Display| {
            let driver = || {
                Device::open_on(self, Place::on(display), 0, false)
                    .ok()
                    .map(|device| device.name.clone())
            };
            display.driver.get_or_init(driver).as_deref()
        };
        another
            .as_ref()
            .filter(|another| driver(another).is_some() && driver(another) == driver(display))
    }
}

/// A context's place on its display, counted until it is dropped.
struct Place(&'static Display);

impl Place {
    fn on(display: &'static Display) -> Self {
        display.contexts.fetch_add(1, Ordering::Relaxed);
        Self(display)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.contexts.fetch_sub(1, Ordering::Relaxed);
    }
}

// SAFETY: EGL's functions may be called from any thread, and its displays are not bound to one.
unsafe impl Send for System {}
// SAFETY: as above.
unsafe impl Sync for System {}

/// EGL, loaded when first asked for.
fn system() -> Result<&'static System, String> {
    static SYSTEM: OnceLock<Result<System, String>> = OnceLock::new();
    let system = SYSTEM.get_or_init(|| {
        let egl = Egl::load()?;
        let (displays, reasons) = egl.displays();
        Ok(System {
            egl,
            displays,
            reasons,
            another: OnceLock::new(),
            choosing: Mutex::new(()),
        })
    });
    system.as_ref().map_err(Clone::clone)
}

/// A device for sessions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct DeviceInfo {
    /// The GPU and its driver, in the driver's words.
    pub(crate) name: String,
    /// True for a program on the CPU in place of a GPU.
    pub(crate) software: bool,
    /// The largest resolution.
    pub(crate) max_resolution: u32,
}

/// Why a machine has no device for this backend: EGL itself, every display tried, and every context.
fn no_device(contexts: &[BackendError]) -> BackendError {
    let mut reasons = match system() {
        Err(reason) => vec![reason],
        Ok(system) => system.reasons.clone(),
    };
    reasons.extend(contexts.iter().map(|error| match error {
        BackendError::Unsupported(reason) => reason.clone(),
        other => other.to_string(),
    }));
    BackendError::Unsupported(format!(
        "no device with OpenGL 4.5: {}; \
         install a driver (on Debian `libegl1 libgl1-mesa-dri` for the software one)",
        reasons.join("; ")
    ))
}

/// Lists the devices of this machine, hardware first.
///
/// # Errors
/// [`BackendError::Unsupported`] when there is none, with the reasons.
pub(crate) fn devices() -> Result<Vec<DeviceInfo>, BackendError> {
    let count = system().map_or(0, |system| system.displays.len());
    let (mut devices, mut reasons) = (Vec::new(), Vec::new());
    for number in 0..count {
        match Device::open(u32::try_from(number).unwrap_or(u32::MAX), false) {
            Ok(device) => devices.push(DeviceInfo {
                name: device.name.clone(),
                software: device.software,
                max_resolution: (device.limits.texture_size / 3).min(1024),
            }),
            Err(reason) => reasons.push(reason),
        }
    }
    if devices.is_empty() {
        return Err(no_device(&reasons));
    }
    Ok(devices)
}

/// Number of storage bindings in the shaders.
pub(crate) const STORAGE_BINDINGS: i32 = 32;

/// The limits of a driver.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Bytes of a shader storage block.
    pub(crate) storage_range: u64,
    /// Pixels along the edge of a texture.
    pub(crate) texture_size: u32,
    /// Layers of a texture.
    pub(crate) layers: u32,
    /// Those of a compute stage.
    pub(crate) of_stage: OfStage,
}

/// Functions of OpenGL 4.5 missing in glow.
pub(crate) struct More {
    clip_control: unsafe extern "system" fn(u32, u32),
    provoking_vertex: unsafe extern "system" fn(u32),
    multi_draw_elements: unsafe extern "system" fn(u32, *const i32, u32, *const *const c_void, i32),
    /// `None` without ARB_indirect_parameters.
    multi_draw_elements_indirect_count: Option<unsafe extern "system" fn(u32, u32, *const c_void, isize, i32, i32)>,
    clear_named_buffer_sub_data: unsafe extern "system" fn(u32, u32, isize, isize, u32, u32, *const c_void),
    get_graphics_reset_status: unsafe extern "system" fn() -> u32,
}

/// A device with a context of its own.
pub(crate) struct Device {
    system: &'static System,
    place: Place,
    context: Pointer,
    gl: glow::Context,
    more: More,
    pub(crate) limits: Limits,
    pub(crate) name: String,
    pub(crate) software: bool,
    pub(crate) number: u32,
    messages: Arc<Mutex<Vec<String>>>,
}

// SAFETY: a context may be used from any thread, one at a time; it is current in a thread only between `enter` and the
// drop of what that returns, which borrows the device and cannot leave the thread.
unsafe impl Send for Device {}

/// A device with its context current in this thread, until this is dropped.
pub(crate) struct Entered<'a> {
    device: &'a Device,
    pub(crate) gl: &'a glow::Context,
    /// Given up after the context is released: `Drop` runs before fields are dropped.
    _turn: Option<MutexGuard<'static, ()>>,
    /// A context is current in one thread, so this stays in it.
    _thread: std::marker::PhantomData<*const ()>,
}

impl Drop for Entered<'_> {
    fn drop(&mut self) {
        let none = std::ptr::null_mut();
        // SAFETY: the display is open; releasing a thread's context has no other precondition.
        unsafe { (self.device.system.egl.make_current)(self.device.place.0.handle, none, none, none) };
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let display = self.place.0;
        let _turn = self.software.then(|| display.turn());
        // SAFETY: the context is this device's own and, as nothing borrows the device, current in no thread. What it
        // holds of buffers and textures goes with it, as it shares with no other.
        unsafe { (self.system.egl.destroy_context)(display.handle, self.context) };
    }
}

/// Loads the functions of a context.
///
/// # Safety
/// A context of OpenGL 4.5 is current in this thread, and lives while the functions are called.
unsafe fn functions(egl: &Egl) -> Result<(glow::Context, More), String> {
    let load = |name: &CStr| -> Pointer {
        // SAFETY: the name ends in a zero byte.
        unsafe { (egl.get_proc_address)(name.as_ptr()) }
    };
    // SAFETY: a context is current by the caller's promise; each function is given the type that OpenGL 4.5 declares.
    unsafe {
        let gl = glow::Context::from_loader_function_cstr(|name| load(name).cast_const());
        macro_rules! function {
            ($name:literal) => {{
                let pointer = load($name);
                if pointer.is_null() {
                    return Err(format!("the driver lacks `{}`", $name.to_string_lossy()));
                }
                std::mem::transmute(pointer)
            }};
        }
        let extensions = gl.supported_extensions();
        let version = gl.version();
        let indirect_count = if (version.major, version.minor) >= (4, 6) {
            load(c"glMultiDrawElementsIndirectCount")
        } else if extensions.contains("GL_ARB_indirect_parameters") {
            load(c"glMultiDrawElementsIndirectCountARB")
        } else {
            std::ptr::null_mut()
        };
        let indirect_count = std::mem::transmute::<
            Pointer,
            Option<unsafe extern "system" fn(u32, u32, *const c_void, isize, i32, i32)>,
        >(indirect_count);
        #[allow(clippy::missing_transmute_annotations, reason = "the fields' types say it")]
        let more = More {
            clip_control: function!(c"glClipControl"),
            provoking_vertex: function!(c"glProvokingVertex"),
            multi_draw_elements: function!(c"glMultiDrawElements"),
            multi_draw_elements_indirect_count: indirect_count,
            clear_named_buffer_sub_data: function!(c"glClearNamedBufferSubData"),
            get_graphics_reset_status: function!(c"glGetGraphicsResetStatus"),
        };
        Ok((gl, more))
    }
}

impl Device {
    /// Opens the device with a context of its own. With `debug`, the driver checks each call, and its messages become
    /// errors (see [`Entered::check`]).
    pub(crate) fn open(number: u32, debug: bool) -> Result<Self, BackendError> {
        let system = system().map_err(|_| no_device(&[]))?;
        let Some(display) = system.displays.get(number as usize) else {
            return Err(match system.displays.len() {
                0 => no_device(&[]),
                count => {
                    BackendError::InvalidArgument(format!("there is no device {number}: this machine has {count}"))
                }
            });
        };
        Self::open_on(system, system.place(display), number, debug)
    }

    fn open_on(system: &'static System, place: Place, number: u32, debug: bool) -> Result<Self, BackendError> {
        let unusable = |reason: String| BackendError::Unsupported(format!("device {number}: {reason}"));
        let (egl, display) = (&system.egl, place.0);
        // The name tells a software device only at the end.
        let _turn = display.turn();
        let context = egl.create_context(display.handle, debug).map_err(unusable)?;
        // From here on the context is destroyed with `Owned` on every way out.
        struct Owned(&'static Egl, Pointer, Pointer);
        impl Drop for Owned {
            fn drop(&mut self) {
                let none = std::ptr::null_mut();
                // SAFETY: the context was made by this display and is given up by no one else.
                unsafe {
                    (self.0.make_current)(self.1, none, none, none);
                    (self.0.destroy_context)(self.1, self.2);
                }
            }
        }
        let owned = Owned(egl, display.handle, context);
        let none = std::ptr::null_mut();
        // SAFETY: the context was made for this display and is current nowhere.
        if unsafe { (egl.make_current)(display.handle, none, none, context) } == 0 {
            return Err(unusable(format!("its context cannot be made current: {}", egl.error())));
        }
        // SAFETY: the context just made is current, and is destroyed with what is loaded.
        let (mut gl, more) = unsafe { functions(egl) }.map_err(unusable)?;
        let messages = Arc::new(Mutex::new(Vec::new()));
        // SAFETY: the context is current; what is asked for exists in OpenGL 4.5.
        let (name, limits) = unsafe {
            let at_least_zero = |value: i32| u32::try_from(value).unwrap_or(0);
            let bindings = gl.get_parameter_i32(glow::MAX_SHADER_STORAGE_BUFFER_BINDINGS);
            if bindings < STORAGE_BINDINGS {
                return Err(unusable(format!(
                    "{bindings} bindings of storage buffers; the shaders need {STORAGE_BINDINGS}"
                )));
            }
            let limits = Limits {
                storage_range: u64::from(at_least_zero(gl.get_parameter_i32(glow::MAX_SHADER_STORAGE_BLOCK_SIZE))),
                texture_size: at_least_zero(gl.get_parameter_i32(glow::MAX_TEXTURE_SIZE)),
                layers: at_least_zero(gl.get_parameter_i32(glow::MAX_ARRAY_TEXTURE_LAYERS)),
                of_stage: OfStage {
                    threads: at_least_zero(gl.get_parameter_i32(glow::MAX_COMPUTE_WORK_GROUP_INVOCATIONS)),
                    shared_bytes: at_least_zero(gl.get_parameter_i32(glow::MAX_COMPUTE_SHARED_MEMORY_SIZE)),
                    storage_buffers: at_least_zero(gl.get_parameter_i32(glow::MAX_COMPUTE_SHADER_STORAGE_BLOCKS)),
                },
            };
            if debug {
                let sink = Arc::clone(&messages);
                gl.debug_message_callback(move |_, kind, id, severity, message| {
                    if kind == glow::DEBUG_TYPE_ERROR
                        || kind == glow::DEBUG_TYPE_UNDEFINED_BEHAVIOR
                        || severity == glow::DEBUG_SEVERITY_HIGH
                    {
                        sink.lock()
                            .unwrap_or_else(PoisonError::into_inner)
                            .push(format!("{id:#x}: {message}"));
                    }
                });
                gl.enable(glow::DEBUG_OUTPUT);
                gl.enable(glow::DEBUG_OUTPUT_SYNCHRONOUS);
            }
            let renderer = gl.get_parameter_string(glow::RENDERER);
            (
                format!("{renderer}, OpenGL {}", gl.get_parameter_string(glow::VERSION)),
                limits,
            )
        };
        let software = display.software || name.contains("llvmpipe") || name.contains("softpipe");
        // SAFETY: the display is open, and this releases the context just made current.
        unsafe { (egl.make_current)(display.handle, none, none, none) };
        std::mem::forget(owned);
        Ok(Self {
            system,
            place,
            context,
            gl,
            more,
            limits,
            name,
            software,
            number,
            messages,
        })
    }

    /// Returns whether indirect draws can take their number from a buffer.
    pub(crate) fn can_count_draws(&self) -> bool {
        self.more.multi_draw_elements_indirect_count.is_some()
    }

    /// Makes the context current in this thread until the guard is dropped.
    pub(crate) fn enter(&self) -> Result<Entered<'_>, BackendError> {
        let egl = &self.system.egl;
        let display = self.place.0;
        let turn = self.software.then(|| display.turn());
        let none = std::ptr::null_mut();
        // SAFETY: the context belongs to the display, and is current in no other thread (see `Send`). The interface is
        // bound anew because EGL keeps it by thread.
        let current = unsafe {
            (egl.bind_api)(EGL_OPENGL_API) != 0 && (egl.make_current)(display.handle, none, none, self.context) != 0
        };
        if !current {
            return Err(BackendError::DeviceLost(format!(
                "the context of `{}` cannot be made current: {}",
                self.name,
                egl.error()
            )));
        }
        Ok(Entered {
            device: self,
            gl: &self.gl,
            _turn: turn,
            _thread: std::marker::PhantomData,
        })
    }
}

impl Entered<'_> {
    /// Sets the shaders' conventions: depth from 0 to 1, rows upwards, and flat values from a triangle's first corner.
    /// OpenGL's defaults differ.
    pub(crate) fn set_conventions(&self) {
        // SAFETY: the context is current.
        unsafe {
            (self.device.more.clip_control)(glow::LOWER_LEFT, glow::ZERO_TO_ONE);
            (self.device.more.provoking_vertex)(glow::FIRST_VERTEX_CONVENTION);
        }
    }

    /// Draws several runs of the bound indices: `firsts[k]` is a place in bytes, `counts[k]` a number of indices.
    ///
    /// # Safety
    /// See `glMultiDrawElements`: the runs are within the bound indices, and these within the bound vertices.
    pub(crate) unsafe fn draw_runs(&self, firsts: &[usize], counts: &[i32]) {
        assert_eq!(firsts.len(), counts.len(), "one count for each run");
        let runs = i32::try_from(firsts.len()).unwrap_or(i32::MAX);
        // SAFETY: the lists are as long as is said, and places in bytes go where pointers went before there were
        // buffers; the rest is the caller's.
        unsafe {
            (self.device.more.multi_draw_elements)(
                glow::TRIANGLES,
                counts.as_ptr(),
                glow::UNSIGNED_INT,
                firsts.as_ptr().cast(),
                runs,
            );
        }
    }

    /// Draws by the bound indirect buffer from byte `first`, with the number of draws at byte `count` of the parameter
    /// buffer. Needs [`can_count_draws`](Device::can_count_draws).
    ///
    /// # Safety
    /// See `glMultiDrawElementsIndirectCount`.
    pub(crate) unsafe fn draw_indirect(&self, first: usize, count: usize, at_most: u32) {
        let Some(draw) = self.device.more.multi_draw_elements_indirect_count else {
            return;
        };
        let (count, at_most) = (
            isize::try_from(count).unwrap_or(0),
            i32::try_from(at_most).unwrap_or(i32::MAX),
        );
        // SAFETY: the caller's.
        unsafe {
            draw(
                glow::TRIANGLES,
                glow::UNSIGNED_INT,
                std::ptr::without_provenance(first),
                count,
                at_most,
                20,
            )
        };
    }

    /// Fills whole words of a buffer with zeros.
    pub(crate) fn clear_words(&self, buffer: glow::Buffer, words: std::ops::Range<usize>) {
        let byte = |word: usize| isize::try_from(word * 4).unwrap_or(isize::MAX);
        // SAFETY: the context is current, the buffer is its own, and a range beyond it is an error of OpenGL, not of
        // memory.
        unsafe {
            (self.device.more.clear_named_buffer_sub_data)(
                buffer.0.get(),
                glow::R32UI,
                byte(words.start),
                byte(words.end) - byte(words.start),
                glow::RED_INTEGER,
                glow::UNSIGNED_INT,
                std::ptr::null(),
            );
        }
    }

    /// Fails for errors since the last call: a lost device, want of memory, or a mistake of ours.
    pub(crate) fn check(&self, doing: &str) -> Result<(), BackendError> {
        // SAFETY: the context is current.
        let (reset, error) = unsafe { ((self.device.more.get_graphics_reset_status)(), self.gl.get_error()) };
        let messages = std::mem::take(&mut *self.device.messages.lock().unwrap_or_else(PoisonError::into_inner));
        conv::error(doing, &self.device.name, reset, error, &messages)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device, or a loud skip.
    fn some_device() -> Option<Device> {
        match Device::open(0, true) {
            Ok(device) => Some(device),
            Err(error) => {
                crate::skip(&error);
                None
            }
        }
    }

    #[test]
    fn a_device_that_is_not_there_is_refused_and_the_reason_names_it() {
        let Err(error) = Device::open(1000, false) else {
            panic!("device 1000 was opened")
        };
        assert!(
            matches!(&error, BackendError::InvalidArgument(text) if text.contains("1000"))
                || matches!(&error, BackendError::Unsupported(text) if text.contains("no device")),
            "{error}"
        );
    }

    #[test]
    fn a_mistake_of_ours_is_an_error_of_the_call_and_is_told_once() {
        let Some(device) = some_device() else { return };
        let entered = device.enter().expect("a context of our own");
        entered.check("nothing").expect("nothing was done");
        // SAFETY: the context is current; the mistake is on purpose.
        unsafe { entered.gl.enable(0xFFFF) };
        let error = entered
            .check("a mistake")
            .expect_err("an unknown capability was enabled");
        assert!(
            matches!(&error, BackendError::Internal(text) if text.contains("a mistake")),
            "{error}"
        );
        entered.check("after it").expect("a mistake is told once");
    }

    /// Returns true if a thread can use and give up `other`, while another thread uses `used`.
    fn can_be_used_beside(used: &Device, other: Device) -> bool {
        let entered = used.enter().expect("a context of our own");
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                drop(other.enter().expect("entered"));
                sender.send(()).expect("the receiver is there");
            });
            let is_early = receiver.recv_timeout(std::time::Duration::from_millis(200)).is_ok();
            drop(entered);
            if !is_early {
                receiver.recv().expect("now it is the other's turn");
            }
            is_early
        })
    }

    #[test]
    fn contexts_of_a_display_of_a_software_device_take_turns() {
        let Some(device) = some_device() else { return };
        let open =
            |display| Device::open_on(device.system, Place::on(display), 0, false).expect("there was one before");
        assert_ne!(can_be_used_beside(&device, open(device.place.0)), device.software);
        if let Some(another) = device.system.another(device.place.0) {
            let there = open(another);
            assert_eq!(there.name, device.name);
            assert!(!can_be_used_beside(&there, open(another)), "its own contexts at once");
            assert!(can_be_used_beside(&device, there), "two displays take turns");
        }
    }

    #[test]
    fn two_sessions_are_on_two_displays_where_there_are() {
        let Some(device) = some_device() else { return };
        // Other tests of this process may open and close contexts of their own in between.
        let is_apart = || {
            let two = [0, 1].map(|_| Device::open(0, false).expect("there was one before"));
            !std::ptr::eq(two[0].place.0, two[1].place.0)
        };
        assert_eq!(
            (0..100).any(|_| is_apart()),
            device.system.another(device.place.0).is_some()
        );
    }

    #[test]
    fn a_context_serves_one_thread_after_the_other() {
        let Some(mut device) = some_device() else { return };
        for _ in 0..3 {
            let there = std::thread::spawn(move || {
                device
                    .enter()
                    .and_then(|entered| entered.check("from a thread"))
                    .expect("entered");
                device
            });
            device = there.join().expect("the thread ended well");
        }
        drop(device.enter().expect("entered by the first thread again"));
    }
}
