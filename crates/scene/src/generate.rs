//! Stub.
use crate::Scene;
/// The measured Cornell box.
pub fn cornell_box() -> Scene { Scene::default() }
