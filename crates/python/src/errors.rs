//! Errors as Python's exceptions: classes of `hemicube._errors` with the library's messages.

use crate::words;
use hemicube::driver::compute::ComputeError;
use hemicube::driver::input::InputError;
use hemicube::driver::job::JobError;
use hemicube::driver::level::LevelError;
use hemicube::driver::room::TooManyPatches;
use hemicube::driver::update::UpdateError;
use hemicube::solve::SolveError;
use hemicube::store::Error as StoreError;
use hemicube_host::OpenError;
use hemicube_scene::{Error as SceneError, ErrorKind, Subdivision};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::error::Error;
use std::io;

/// A class of `hemicube._errors`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// An argument cannot be used.
    Input,
    /// The operating system refused.
    File,
    /// A file or directory is not there.
    NotFound,
    /// A store's or file's content cannot be used, or not for this.
    Store,
    /// A backend failed, or is not there.
    Backend,
}

impl Class {
    fn name(self) -> &'static str {
        match self {
            Self::Input => "InputError",
            Self::File => "FileError",
            Self::NotFound => "MissingFileError",
            Self::Store => "StoreError",
            Self::Backend => "BackendError",
        }
    }

    fn of_io(error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::NotFound,
            _ => Self::File,
        }
    }

    /// The exception.
    fn raise(self, message: &str) -> PyErr {
        let message = message.to_owned();
        Python::attach(|py| {
            let class = py
                .import("hemicube._errors")
                .and_then(|module| module.getattr(self.name()))
                .and_then(|class| Ok(class.cast_into::<PyType>()?));
            match class {
                Ok(class) => PyErr::from_type(class, message),
                // An incomplete package; the message is more important.
                Err(_) => PyRuntimeError::new_err(message),
            }
        })
    }
}

/// An error with its causes. Libraries that paste their source into their own message would say it twice.
fn message(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let said = error.to_string();
        if !text.ends_with(&said) {
            text.push_str(": ");
            text.push_str(&said);
        }
        cause = error.source();
    }
    text
}

/// An argument that cannot be used.
pub(crate) fn input(message: impl Into<String>) -> PyErr {
    Class::Input.raise(&message.into())
}

/// Content of a file or a pickle that cannot be used.
pub(crate) fn content(message: impl Into<String>) -> PyErr {
    Class::Store.raise(&message.into())
}

pub(crate) fn scene(error: &SceneError) -> PyErr {
    match &error.kind {
        ErrorKind::Io(source) => Class::of_io(source),
        _ => Class::Input,
    }
    .raise(&match words::of_scene(error) {
        Some(step) => format!("{}; {step}", message(error)),
        None => message(error),
    })
}

pub(crate) fn uncut(error: &InputError) -> PyErr {
    match error {
        InputError::Patches(error) => scene(error),
        error => input(message(error)),
    }
}

/// More patches than there is memory for, with the keyword that fits.
pub(crate) fn no_room(error: &TooManyPatches) -> PyErr {
    let step = match error.finest {
        Some(Subdivision::Split(pieces)) => format!("`split={pieces}` is the finest that surely fits"),
        Some(Subdivision::PatchSize(length)) => format!("`patch_size={length}` is the finest that surely fits"),
        Some(Subdivision::None | Subdivision::Levels(_)) | None => "cut the scene into several".to_owned(),
    };
    input(format!("{error}; {step}"))
}

pub(crate) fn store(error: &StoreError) -> PyErr {
    let text = message(error);
    match error {
        StoreError::Io { source, .. } => Class::of_io(source).raise(&text),
        StoreError::NoSpace { .. } | StoreError::DiskTooSmall { .. } | StoreError::Locked { .. } => {
            Class::File.raise(&text)
        }
        StoreError::Exists { path } => {
            Class::Store.raise(&format!("`{}` exists; `overwrite=True` replaces it", path.display()))
        }
        StoreError::OtherRun { .. } => {
            Class::Store.raise(&format!("{text}; `overwrite=True` replaces it, another name leaves it"))
        }
        _ => Class::Store.raise(&text),
    }
}

pub(crate) fn compute(error: &ComputeError) -> PyErr {
    match error {
        ComputeError::Store(error) => store(error),
        ComputeError::Cancelled => PyKeyboardInterrupt::new_err(error.to_string()),
        error => Class::Backend.raise(&message(error)),
    }
}

/// A run that failed; errors name the keywords of `compute`.
pub(crate) fn job(error: &JobError) -> PyErr {
    match error {
        JobError::Partly(error) => input(error.to_string()),
        JobError::NoMatch(error) => input(format!("`{}`: {error}", error.list)),
        JobError::Level(LevelError::Compute(error)) | JobError::Compute(error) => compute(error),
        JobError::NoRows => {
            input("no row is left to compute: `rows`, `emitters` and `occluders` together exclude every patch")
        }
        JobError::Rows(failed) => compute(&failed.source),
        JobError::Update(error) | JobError::Level(LevelError::Update(error)) => update(error),
        JobError::Store(error) => store(error),
        JobError::MixedOptics { by, .. } => input(format!("{error}; `patches='{by}'` has no such patches")),
        error => input(message(error)),
    }
}

/// A matrix that rows cannot be taken over from.
pub(crate) fn update(error: &UpdateError) -> PyErr {
    match error {
        UpdateError::Store(error) => store(error),
        error => input(message(error)),
    }
}

pub(crate) fn opening(error: &OpenError) -> PyErr {
    Class::Backend.raise(&message(error))
}

pub(crate) fn backend(message: impl Into<String>) -> PyErr {
    Class::Backend.raise(&message.into())
}

pub(crate) fn solving(error: &SolveError) -> PyErr {
    match error {
        SolveError::Store(error) => store(error),
        SolveError::Interrupted => PyKeyboardInterrupt::new_err(error.to_string()),
        error => input(message(error)),
    }
}
