//! Arrays from Python, with their types looked at: NumPy would make 0.5 an index of 0 without a word.

use crate::errors;
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

/// Any argument of NumPy's `asarray`, as an array of one type. `kinds` are the letters of the types accepted.
fn array<'py>(
    given: &Bound<'py, PyAny>,
    what: &str,
    kinds: &str,
    kind: &str,
    dtype: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = given.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (given,))?;
    let found: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let size: usize = array.getattr("size")?.extract()?;
    // An empty list is an array of floats.
    if size > 0 && !kinds.contains(&found) {
        let dtype = array.getattr("dtype")?;
        return Err(errors::input(format!(
            "`{what}` is an array of {dtype}; {kind} are needed"
        )));
    }
    numpy.call_method1("ascontiguousarray", (array, dtype))
}

/// An array's shape for messages.
fn shape(array: &Bound<'_, PyAny>) -> PyResult<String> {
    Ok(array.getattr("shape")?.str()?.to_string())
}

/// One number a row.
fn one<T: Element + Copy>(array: Bound<'_, PyAny>, what: &str, len: usize) -> PyResult<Vec<T>> {
    let wrong = shape(&array)?;
    match array.cast_into::<PyArray1<T>>() {
        Ok(array) if array.len()? == len => Ok(array.readonly().as_slice()?.to_vec()),
        _ => Err(errors::input(format!(
            "`{what}` has the shape {wrong}; ({len},) is needed"
        ))),
    }
}

/// `N` numbers a row.
fn rows<T: Element + Copy + Default, const N: usize>(array: Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[T; N]>> {
    let wrong = shape(&array)?;
    match array.cast_into::<PyArray2<T>>() {
        Ok(array) if array.readonly().as_array().ncols() == N => {
            let array = array.readonly();
            Ok(array.as_slice()?.as_chunks::<N>().0.to_vec())
        }
        _ => Err(errors::input(format!(
            "`{what}` has the shape {wrong}; (n, {N}) is needed"
        ))),
    }
}

/// Points or directions.
pub(crate) fn points(given: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[f64; 3]>> {
    rows(array(given, what, "fiu", "numbers", "float64")?, what)
}

/// `N` indices or ids a row.
pub(crate) fn rows_of_ids<const N: usize>(given: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[i64; N]>> {
    rows(array(given, what, "iu", "integers", "int64")?, what)
}

/// Three indices a row.
pub(crate) fn triples(given: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[i64; 3]>> {
    rows_of_ids(given, what)
}

/// An id a row.
pub(crate) fn ids(given: &Bound<'_, PyAny>, what: &str, len: usize) -> PyResult<Vec<i64>> {
    one(array(given, what, "iu", "integers", "int64")?, what, len)
}

/// A truth for all, or one a row.
pub(crate) fn flags(given: &Bound<'_, PyAny>, what: &str, len: usize) -> PyResult<Vec<bool>> {
    if let Ok(flag) = given.extract::<bool>() {
        return Ok(vec![flag; len]);
    }
    one(array(given, what, "b", "truth values", "bool")?, what, len)
}

/// A vector of this length.
pub(crate) fn vector(given: &Bound<'_, PyAny>, what: &str, len: usize) -> PyResult<Vec<f64>> {
    one(array(given, what, "fiu", "numbers", "float64")?, what, len)
}

/// A number for all patches, one a patch, or a row of them a patch: the values, patch by patch, the number a patch, and
/// whether they had a dimension of their own.
pub(crate) fn columns(given: &Bound<'_, PyAny>, what: &str, patches: usize) -> PyResult<(Vec<f64>, usize, bool)> {
    let array = array(given, what, "fiu", "numbers", "float64")?;
    // `ascontiguousarray` makes one number an array of one.
    if given.extract::<f64>().is_ok() {
        let value = given.extract::<f64>()?;
        return Ok((vec![value; patches], 1, false));
    }
    let wrong = || -> PyResult<PyErr> {
        Ok(errors::input(format!(
            "`{what}` has the shape {}; ({patches},) or ({patches}, k) is needed",
            shape(&array)?
        )))
    };
    if let Ok(vector) = array.cast::<PyArray1<f64>>() {
        let vector: PyReadonlyArray1<'_, f64> = vector.readonly();
        let values = vector.as_slice()?;
        return if values.len() == patches {
            Ok((values.to_vec(), 1, false))
        } else {
            Err(wrong()?)
        };
    }
    match array.cast::<PyArray2<f64>>() {
        Ok(block) => {
            let block = block.readonly();
            let (rows, columns) = block.as_array().dim();
            if rows == patches && columns > 0 {
                Ok((block.as_slice()?.to_vec(), columns, true))
            } else {
                Err(wrong()?)
            }
        }
        Err(_) => Err(wrong()?),
    }
}

/// A vector as an array that owns it, without copying. Read-only: arrays handed out more than once, and read by other
/// threads, stay unchanged.
pub(crate) fn frozen<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    let array = PyArray1::from_vec(py, values);
    drop(array.readwrite().make_nonwriteable());
    array
}
