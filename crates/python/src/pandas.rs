//! Data frames with the names of surfaces, where pandas is there.

use crate::errors;
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Most patches of a matrix in a data frame: 400 MB.
pub(crate) const PATCHES_MAX: usize = 10_000;

/// Refuses a matrix too large for a data frame, which has a number for each pair.
pub(crate) fn require_few(patches: usize) -> PyResult<()> {
    if patches <= PATCHES_MAX {
        return Ok(());
    }
    Err(errors::input(format!(
        "a data frame has a number for each of {patches}² pairs, and up to {PATCHES_MAX}² are made: `to_scipy()` has \
         the entries alone, and `zones()` adds them up"
    )))
}

/// `pandas.DataFrame(data, index=…, columns=…)`; labels that are `None` are numbers from 0.
pub(crate) fn frame<'py>(
    py: Python<'py>,
    data: &Bound<'py, PyAny>,
    index: Option<&[String]>,
    columns: Option<&[String]>,
) -> PyResult<Bound<'py, PyAny>> {
    let pandas = py
        .import("pandas")
        .map_err(|error| match error.is_instance_of::<PyImportError>(py) {
            true => PyImportError::new_err("to_pandas() needs pandas, which is not installed: pip install pandas"),
            false => error,
        })?;
    let named = PyDict::new(py);
    for (name, labels) in [("index", index), ("columns", columns)] {
        if let Some(labels) = labels {
            named.set_item(name, labels)?;
        }
    }
    pandas.call_method("DataFrame", (data,), Some(&named))
}
