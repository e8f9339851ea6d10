//! Stub.
use crate::{Error, ReadOptions, Scene};
use std::path::Path;

/// Reads a scene from the bytes of a file.
///
/// # Errors
/// Always, for now.
pub fn read(_bytes: &[u8], _base_dir: Option<&Path>, _options: ReadOptions) -> Result<Scene, Error> {
    Err(Error::unsupported("not written yet"))
}
