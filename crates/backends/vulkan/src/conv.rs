//! Between Vulkan's words and ours.

use ash::vk;
use hemicube_abi::DeviceKind;
use hemicube_contract::backend::BackendError;

/// Translates Vulkan's refusal of `what`.
pub(crate) fn error(what: &str, result: vk::Result) -> BackendError {
    match result {
        vk::Result::ERROR_DEVICE_LOST => BackendError::DeviceLost(format!(
            "{what}: the driver gave up on the device; run again, what is stored is kept"
        )),
        vk::Result::ERROR_OUT_OF_HOST_MEMORY
        | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY
        | vk::Result::ERROR_OUT_OF_POOL_MEMORY
        | vk::Result::ERROR_FRAGMENTED_POOL => BackendError::OutOfMemory(format!(
            "{what}: {result}; take a lower resolution, a coarser scene or fewer sessions"
        )),
        vk::Result::ERROR_FEATURE_NOT_PRESENT
        | vk::Result::ERROR_EXTENSION_NOT_PRESENT
        | vk::Result::ERROR_LAYER_NOT_PRESENT
        | vk::Result::ERROR_INCOMPATIBLE_DRIVER
        | vk::Result::ERROR_INITIALIZATION_FAILED
        | vk::Result::ERROR_FORMAT_NOT_SUPPORTED
        | vk::Result::ERROR_TOO_MANY_OBJECTS => {
            BackendError::Unsupported(format!("{what}: {result}; take another device or the CPU"))
        }
        _ => BackendError::Internal(format!("{what}: {result}")),
    }
}

/// Returns whether a session can go on after an error.
pub(crate) fn is_fatal(error: &BackendError) -> bool {
    !matches!(
        error,
        BackendError::InvalidArgument(_) | BackendError::Unsupported(_) | BackendError::OutOfMemory(_)
    )
}

/// Translates the kind of a device.
pub(crate) fn device_kind(kind: vk::PhysicalDeviceType) -> DeviceKind {
    match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::DiscreteGpu,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::IntegratedGpu,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::VirtualGpu,
        vk::PhysicalDeviceType::CPU => DeviceKind::Software,
        _ => DeviceKind::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_device_ends_a_session_and_want_of_memory_does_not() {
        let lost = error("submitting", vk::Result::ERROR_DEVICE_LOST);
        assert!(matches!(lost, BackendError::DeviceLost(_)));
        assert!(is_fatal(&lost));
        let memory = error("a buffer", vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        assert!(matches!(memory, BackendError::OutOfMemory(_)));
        assert!(!is_fatal(&memory));
        assert!(is_fatal(&error("x", vk::Result::ERROR_UNKNOWN)));
    }
}
