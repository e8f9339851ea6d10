//! The parts of a session free of any graphics API: names, capabilities, checks.

use crate::limits::{Draw, Edges};
use hemicube_contract::backend::{BackendError, Capabilities, Geometry, Hemicube};
use std::ffi::CStr;

/// The version of the arithmetic with [`Edges::Driver`]: raised when any row could change by a bit on the same driver.
pub const VERSION: &CStr = c"gpu-3";

/// The version with [`Edges::Exact`]: its rows differ.
const EXACT_VERSION: &CStr = c"gpu-4-exact";

/// The version with [`Draw::Compute`]: depths are rounded otherwise.
const COMPUTE_VERSION: &CStr = c"gpu-3-compute";

/// The version reported by a session.
pub fn version(draw: Draw, edges: Edges) -> String {
    let version = match (draw, edges) {
        (Draw::Compute, _) => COMPUTE_VERSION,
        (_, Edges::Driver) => VERSION,
        (_, Edges::Exact) => EXACT_VERSION,
    };
    version.to_string_lossy().into_owned()
}

/// Covered weights, sub-pixel patches, item buffers, culling invisible in rows, passes and rays; close hemicubes are left.
pub const CAPABILITIES: Capabilities = Capabilities {
    covered: true,
    tiny_patches: true,
    items: true,
    lossless_culling: true,
    passes: true,
    rays: true,
    leaves_close: true,
};

/// The choice of a session with [`Draw::Compute`].
pub const BY_TILES: &str = "drawn by compute, tile by tile";

/// Hemicubes of a call, for submissions of `batch`: four submissions. One is read back while the next is under way, and
/// the device seldom runs dry.
pub fn preferred_rows(batch: u32) -> usize {
    4 * batch as usize
}

/// The error of a call before [`load`](hemicube_contract::backend::HemicubeBackend::load).
pub fn not_loaded() -> BackendError {
    BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned())
}

/// Checks the hemicubes of a call.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for the first illegal one.
pub fn check(geometry: &Geometry, hemicubes: &[Hemicube]) -> Result<(), BackendError> {
    hemicubes
        .iter()
        .try_for_each(|hemicube| hemicube.check(geometry.patch_count))
}
