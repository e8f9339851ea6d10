//! The program within the package: what `hemicube` and `python -m hemicube` run.

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the program by the words that follow its name, and returns its exit code. `again` starts it as a process of its
/// own. Once in a process, on the main thread, with Python's handler of Ctrl-C taken away.
#[pyfunction]
#[pyo3(name = "_main")]
pub(crate) fn main(py: Python<'_>, words: Vec<OsString>, again: Vec<OsString>) -> u8 {
    py.detach(|| hemicube_cli::main_within(again, words))
}
