//! Contents of a pickle: paths, the bytes of a store, arrays and numbers. What comes back is read like a file of a
//! stranger, and nothing in it is run.

use crate::errors;
use crate::matrix::{Matrix, stored, temporary};
use hemicube::store::Store;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use std::path::{Path, PathBuf};

/// A function and its arguments, as `__reduce__` returns them.
pub(crate) type Reduced<'py> = (Bound<'py, PyAny>, Bound<'py, PyTuple>);

/// A function of this module by its name.
pub(crate) fn maker<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("hemicube._native")?.getattr(name)
}

/// The scene and settings of a store, in hexadecimal.
fn identity(store: &Store) -> String {
    let manifest = store.manifest();
    format!("{}-{}", manifest.scene.blake3, manifest.settings_hash)
}

fn io<T>(path: &Path, result: std::io::Result<T>) -> PyResult<T> {
    result.map_err(|source| {
        let (path, action) = (path.to_owned(), "read");
        errors::store(&hemicube::store::Error::Io { path, action, source })
    })
}

/// The path of a stored matrix, or the files of a store of one in memory.
pub(crate) fn matrix<'py>(py: Python<'py>, matrix: &Matrix) -> PyResult<Reduced<'py>> {
    if let Some(store) = matrix.store() {
        let path = io(store.directory(), std::path::absolute(store.directory()))?;
        let arguments = (path, identity(store)).into_pyobject(py)?;
        return Ok((maker(py, "_matrix_at")?, arguments));
    }
    let temporary = temporary(None)?;
    let directory = temporary.path().join("matrix.hemicube");
    matrix.write(py, &directory)?;
    let files = PyDict::new(py);
    let store = stored(Store::open(&directory))?;
    let manifest = store.manifest();
    let parts = manifest.parts.iter().map(|part| part.file.as_str());
    let others = manifest.patches.iter().map(|patches| patches.file.as_str());
    for name in ["manifest.json"].into_iter().chain(others).chain(parts) {
        let path = directory.join(name);
        files.set_item(name, PyBytes::new(py, &io(&path, std::fs::read(&path))?))?;
    }
    Ok((maker(py, "_matrix_of")?, (files,).into_pyobject(py)?))
}

/// The matrix at a path, if it is of the scene and the settings that it was of.
#[pyfunction]
#[pyo3(name = "_matrix_at", signature = (path, identity))]
pub(crate) fn matrix_at(py: Python<'_>, path: PathBuf, identity: &str) -> PyResult<Matrix> {
    let store = stored(py.detach(|| Store::open(&path)))?;
    if self::identity(&store) != identity {
        return Err(errors::content(format!(
            "`{}` is of another scene or other settings than when it was pickled; `hemicube.open` opens what is there",
            path.display()
        )));
    }
    Ok(Matrix::stored(store))
}

/// Returns whether a name is that of a file of a store.
fn is_file_of_store(name: &str) -> bool {
    let is_part = name
        .strip_prefix("parts/part-")
        .and_then(|rest| rest.strip_suffix(".npz"))
        .is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()));
    is_part || name == "manifest.json" || name == "patches.npz"
}

/// The matrix of the files of a store, in memory.
#[pyfunction]
#[pyo3(name = "_matrix_of", signature = (files))]
pub(crate) fn matrix_of(py: Python<'_>, files: &Bound<'_, PyDict>) -> PyResult<Matrix> {
    let temporary = temporary(None)?;
    let directory = temporary.path().join("matrix.hemicube");
    io(&directory, std::fs::create_dir_all(directory.join("parts")))?;
    for (name, bytes) in files {
        let name: String = name.extract()?;
        if !is_file_of_store(&name) {
            return Err(errors::content(format!(
                "a pickled matrix has a file `{name}`, which no store has"
            )));
        }
        let path = directory.join(&name);
        io(&path, std::fs::write(&path, bytes.cast::<PyBytes>()?.as_bytes()))?;
    }
    py.detach(|| {
        let store = stored(Store::open(&directory))?;
        stored(store.verify_patches())?;
        for place in 0..store.manifest().parts.len() {
            stored(store.verify_part(place))?;
        }
        Matrix::read(&store)
    })
}
