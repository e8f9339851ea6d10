//! Backends by Python's keywords.

use crate::errors;
use hemicube::backend::HemicubeBackend;
use hemicube_backend_cpu::{CpuBackend, EngineChoice, with_close};
use hemicube_host::{Environment, Options, Registry, Search};
use pyo3::prelude::*;
use std::path::PathBuf;

/// The module's own backend.
pub(crate) const BUILT_IN: &str = "cpu";

/// A backend with everything needed to open it. Sessions are opened on demand.
#[derive(Clone, Debug)]
pub(crate) struct BackendChoice {
    name: String,
    engine: EngineChoice,
    options: Options,
    registry: Registry,
}

impl BackendChoice {
    /// The backend of the keywords `backend`, `backend_dir`, `backend_options` and `engine`.
    pub(crate) fn new(
        name: &str,
        directory: Option<PathBuf>,
        options: Vec<(String, String)>,
        engine: &str,
    ) -> PyResult<Self> {
        let pairs: Vec<String> = options.iter().map(|(key, value)| format!("{key}={value}")).collect();
        let options = Options::parse(&pairs).map_err(|error| errors::opening(&error))?;
        let choice = match engine {
            "auto" => EngineChoice::Auto,
            "depth" => EngineChoice::Depth,
            "order" => EngineChoice::Order,
            "claims" => EngineChoice::Claims,
            other => {
                return Err(errors::input(format!(
                    "`engine` is `{other}`; auto, depth, order or claims is needed"
                )));
            }
        };
        if name == BUILT_IN && !options.is_empty() {
            return Err(errors::input(format!(
                "backend `{BUILT_IN}` has no options, and `backend_options` is given"
            )));
        }
        if name != BUILT_IN && engine != "auto" {
            return Err(errors::input(format!(
                "`engine` is a setting of backend `{BUILT_IN}`, and `{name}` is asked for"
            )));
        }
        // The running program is Python: files beside it are not hemicube's.
        let environment = Environment {
            program: None,
            ..Environment::of_process()
        };
        let given: Vec<PathBuf> = directory.into_iter().collect();
        Ok(Self {
            name: name.to_owned(),
            engine: choice,
            options,
            registry: Registry::new(Search::new(&given, &environment), &[BUILT_IN]),
        })
    }

    /// A session. A named backend never becomes another.
    pub(crate) fn open(&self) -> PyResult<Box<dyn HemicubeBackend>> {
        if self.name == BUILT_IN {
            return Ok(Box::new(CpuBackend::new().with_engine(self.engine)));
        }
        let backend = self.registry.open(&self.name, &self.options);
        Ok(with_close(Box::new(backend.map_err(|error| errors::opening(&error))?)))
    }
}
