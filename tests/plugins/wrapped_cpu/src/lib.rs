//! The built-in backend behind the table: whatever it does directly it must do here, to the bit.
#![forbid(unsafe_code)]

use hemicube_abi::contract::backend::{BackendError, HemicubeBackend};
use hemicube_abi::{Device, DeviceKind, Log, Options, Plugin, export_backend};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use std::ffi::CStr;

struct Wrapped;
export_backend!(Wrapped);

impl Plugin for Wrapped {
    const NAME: &'static CStr = c"wrapped-cpu";
    const VERSION: &'static CStr = c"1";
    type Session = CpuBackend;

    fn devices() -> Result<Vec<Device>, BackendError> {
        let backend = CpuBackend::new();
        let info = backend.info();
        Ok(vec![Device {
            name: info.device.clone(),
            kind: DeviceKind::Software,
            capabilities: info.capabilities,
            max_resolution: 1024,
            preferred_rows: info.preferred_rows,
        }])
    }

    fn open(_device: u32, options: &str, log: Log) -> Result<CpuBackend, BackendError> {
        let mut options = Options::parse(options)?;
        let engine = match options.take("engine") {
            None | Some("auto") => EngineChoice::Auto,
            Some("depth") => EngineChoice::Depth,
            Some("order") => EngineChoice::Order,
            Some(other) => return Err(BackendError::InvalidArgument(format!("there is no engine `{other}`"))),
        };
        options.finish()?;
        log.debug("opened");
        Ok(CpuBackend::new().with_engine(engine))
    }
}
