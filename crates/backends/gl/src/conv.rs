//! Between OpenGL's words and ours.

use hemicube_abi::DeviceKind;
use hemicube_contract::backend::BackendError;

/// `GL_CONTEXT_LOST`.
const CONTEXT_LOST: u32 = 0x0507;

/// The kind of a device. OpenGL does not tell GPUs apart.
pub(crate) fn device_kind(is_software: bool) -> DeviceKind {
    if is_software {
        DeviceKind::Software
    } else {
        DeviceKind::Other
    }
}

/// The error behind `glGetGraphicsResetStatus` and `glGetError` while `doing`; `messages` are the debug context's.
pub(crate) fn error(
    doing: &str,
    device: &str,
    reset: u32,
    error: u32,
    messages: &[String],
) -> Result<(), BackendError> {
    if reset != 0 {
        return Err(BackendError::DeviceLost(format!(
            "{doing}: `{device}` was reset ({reset:#x})"
        )));
    }
    match error {
        glow::NO_ERROR if messages.is_empty() => Ok(()),
        glow::OUT_OF_MEMORY => Err(BackendError::OutOfMemory(format!(
            "{doing}: the driver of `{device}` has no more memory"
        ))),
        CONTEXT_LOST => Err(BackendError::DeviceLost(format!(
            "{doing}: the context of `{device}` is lost"
        ))),
        _ => Err(BackendError::Internal(format!(
            "{doing}: OpenGL error {error:#x}: {}",
            messages.join("; ")
        ))),
    }
}

/// Narrows a number of bytes to the type of OpenGL's bindings.
pub(crate) fn size(bytes: u64) -> Result<i32, BackendError> {
    i32::try_from(bytes).map_err(|_| {
        BackendError::Unsupported(format!(
            "{bytes} bytes in one buffer: OpenGL's bindings take 2 GiB; use a smaller scene"
        ))
    })
}

/// Returns the bytes of words in the device's order.
pub(crate) fn bytes_of(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_ne_bytes()).collect()
}
