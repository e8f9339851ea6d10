//! The author's side: the trait of a backend in Rust.

use crate::types::{
    HC_CAN_COVERED, HC_CAN_ITEMS, HC_CAN_LOSSLESS_CULLING, HC_CAN_PASSES, HC_CAN_RAYS, HC_CAN_TINY_PATCHES,
    HC_DEVICE_DISCRETE_GPU, HC_DEVICE_INTEGRATED_GPU, HC_DEVICE_OTHER, HC_DEVICE_SOFTWARE, HC_DEVICE_VIRTUAL_GPU,
    HC_LEAVES_CLOSE, HC_LOG_DEBUG, HC_LOG_ERROR, HC_LOG_INFO, HC_LOG_WARN, HcHost,
};
use core::ffi::{CStr, c_char, c_void};
use hemicube_contract::backend::{BackendError, BackendInfo, Capabilities, HemicubeBackend};
use std::ffi::CString;
use std::fmt;

/// A backend loaded at run time: [`export_backend!`](crate::export_backend) makes its table.
pub trait Plugin: 'static {
    /// The name for `--backend`, `[a-z0-9-]{1,32}`.
    const NAME: &'static CStr;
    /// Version of the arithmetic; a session's [`info`](HemicubeBackend::info) may be more precise.
    const VERSION: &'static CStr;
    /// A session.
    type Session: HemicubeBackend + 'static;

    /// The devices there are, best first. None is no error.
    ///
    /// # Errors
    /// When they cannot be asked for: no driver, say.
    fn devices() -> Result<Vec<Device>, BackendError>;

    /// Opens a session on a device by its place in [`devices`](Self::devices). `options` is `key=value,key=value`, see
    /// [`Options`](crate::Options); an unknown key must be an error.
    ///
    /// # Errors
    /// When there is no such device or option, or the device does not open.
    fn open(device: u32, options: &str, log: Log) -> Result<Self::Session, BackendError>;
}

/// The kind of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// None of the others.
    #[default]
    Other,
    /// A processor, or a graphics driver running on one.
    Software,
    /// A GPU sharing the processor's memory.
    IntegratedGpu,
    /// A GPU with memory of its own.
    DiscreteGpu,
    /// A GPU handed through to a virtual machine.
    VirtualGpu,
}

impl DeviceKind {
    /// Returns the table's number.
    pub fn to_raw(self) -> u32 {
        match self {
            Self::Other => HC_DEVICE_OTHER,
            Self::Software => HC_DEVICE_SOFTWARE,
            Self::IntegratedGpu => HC_DEVICE_INTEGRATED_GPU,
            Self::DiscreteGpu => HC_DEVICE_DISCRETE_GPU,
            Self::VirtualGpu => HC_DEVICE_VIRTUAL_GPU,
        }
    }

    /// From the table; a number of a later version is [`Other`](Self::Other).
    pub fn from_raw(kind: u32) -> Self {
        match kind {
            HC_DEVICE_SOFTWARE => Self::Software,
            HC_DEVICE_INTEGRATED_GPU => Self::IntegratedGpu,
            HC_DEVICE_DISCRETE_GPU => Self::DiscreteGpu,
            HC_DEVICE_VIRTUAL_GPU => Self::VirtualGpu,
            _ => Self::Other,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Other => "other",
            Self::Software => "software",
            Self::IntegratedGpu => "integrated GPU",
            Self::DiscreteGpu => "discrete GPU",
            Self::VirtualGpu => "virtual GPU",
        }
    }
}

/// Returns the table's bits of capabilities.
pub fn capabilities_to_raw(can: Capabilities) -> u64 {
    [
        (can.covered, HC_CAN_COVERED),
        (can.tiny_patches, HC_CAN_TINY_PATCHES),
        (can.items, HC_CAN_ITEMS),
        (can.lossless_culling, HC_CAN_LOSSLESS_CULLING),
        (can.passes, HC_CAN_PASSES),
        (can.rays, HC_CAN_RAYS),
        (can.leaves_close, HC_LEAVES_CLOSE),
    ]
    .into_iter()
    .fold(0, |bits, (can, bit)| if can { bits | bit } else { bits })
}

/// Capabilities from the bits of the table; bits of a later version are not looked at.
pub fn capabilities_from_raw(bits: u64) -> Capabilities {
    Capabilities {
        covered: bits & HC_CAN_COVERED != 0,
        tiny_patches: bits & HC_CAN_TINY_PATCHES != 0,
        items: bits & HC_CAN_ITEMS != 0,
        lossless_culling: bits & HC_CAN_LOSSLESS_CULLING != 0,
        passes: bits & HC_CAN_PASSES != 0,
        rays: bits & HC_CAN_RAYS != 0,
        leaves_close: bits & HC_LEAVES_CLOSE != 0,
    }
}

/// A device for sessions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Device {
    /// Name and driver, in words; cut after 127 bytes.
    pub name: String,
    /// Its kind.
    pub kind: DeviceKind,
    /// The capabilities of a session on it.
    pub capabilities: Capabilities,
    /// Its largest resolution.
    pub max_resolution: u32,
    /// The preferred number of hemicubes a call.
    pub preferred_rows: usize,
}

impl Device {
    /// Describes a session of the plugin `P` on this device, by the device's entry.
    pub fn info<P: Plugin>(&self) -> BackendInfo {
        BackendInfo {
            name: P::NAME.to_string_lossy().into_owned(),
            version: P::VERSION.to_string_lossy().into_owned(),
            device: self.name.clone(),
            capabilities: self.capabilities,
            preferred_rows: self.preferred_rows,
        }
    }
}

/// Says things to the user of the program, in its log. May be kept, cloned and used on any thread.
#[derive(Clone, Copy)]
pub struct Log {
    write: Option<unsafe extern "C" fn(*mut c_void, i32, *const c_char)>,
    context: *mut c_void,
}

// SAFETY: the host promises that `log` may be called with `context` from any thread for the life of the process.
unsafe impl Send for Log {}
// SAFETY: as above.
unsafe impl Sync for Log {}

impl fmt::Debug for Log {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Log").field("heard", &self.write.is_some()).finish()
    }
}

impl Log {
    /// A log without a reader: for a backend's own tests.
    pub fn silent() -> Self {
        Self {
            write: None,
            context: std::ptr::null_mut(),
        }
    }

    pub(crate) fn of(host: Option<&HcHost>) -> Self {
        host.map_or_else(Self::silent, |host| Self {
            write: host.log,
            context: host.context,
        })
    }

    /// An error not reported by any call.
    pub fn error(&self, message: &str) {
        self.write(HC_LOG_ERROR, message);
    }

    /// News that a user should know.
    pub fn warn(&self, message: &str) {
        self.write(HC_LOG_WARN, message);
    }

    /// News that a user may want to know.
    pub fn info(&self, message: &str) {
        self.write(HC_LOG_INFO, message);
    }

    /// Details for finding a defect.
    pub fn debug(&self, message: &str) {
        self.write(HC_LOG_DEBUG, message);
    }

    fn write(&self, level: i32, message: &str) {
        if let Some(write) = self.write {
            // A NUL in the text would end it early; nothing else can be wrong with it.
            let text = CString::new(message.replace('\0', "�")).unwrap_or_default();
            // SAFETY: the host's own function with its own context; the text ends in NUL and outlives the call.
            unsafe { write(self.context, level, text.as_ptr()) }
        }
    }
}
