//! A hemicube backend on OpenGL 4.5, without a window.
//!
//! Shaders, and the form in which a scene is uploaded, are those of the other GPU backends (`hemicube-shaders`); here
//! are EGL, the culling that OpenGL alone has, by hardware occlusion queries, and two baselines as settings:
//! *original*, without culling, one hemicube a call and whole rows read back, and *thesis*, the octree with occlusion
//! queries and coherence of Vázquez and Guartes 2017.
//!
//! Options: `baseline=best|original|thesis`, `cull=auto|off|view|frustum|queries|marks|depth`, `edges=exact|driver`
//! (who says on which side of an edge a pixel lies: docs/gpu.md), `max_level=N` and `min_patches=N` of the octree for
//! queries and marks, `batch=N`, `group=N`, `memory=BYTES`, `timing=on`, `debug=on`.

mod ask;
mod conv;
mod cull;
mod device;
mod objects;
mod options;
mod render;

pub use conv::Gl;
pub use conv::Session;

hemicube_abi::export_backend!(Gl);

/// Says past the capture of test output that a test is skipped for want of a device.
///
/// # Panics
/// Where `HEMICUBE_REQUIRE_BACKENDS` names this backend: there a skip is a failure.
#[cfg(test)]
fn skip(reason: &hemicube_contract::backend::BackendError) {
    use std::io::Write;
    let required = std::env::var("HEMICUBE_REQUIRE_BACKENDS").unwrap_or_default();
    assert!(
        !required.split(',').any(|name| name == "gl"),
        "gl would be skipped: {reason}"
    );
    let _ = std::io::stderr().write_all(format!("SKIP gl: {reason}\n").as_bytes());
}
