//! `hemicube backends list`: the engines, their devices and what they can do.

use crate::args::Backends;
use crate::exit::Exit;
use crate::report::{self, JsonReport, SCHEMA};
use anyhow::Result;
use hemicube::backend::{BackendInfo, HemicubeBackend};
use hemicube_backend_cpu::CpuBackend;
use serde::Serialize;

#[derive(Serialize)]
struct ListReport {
    schema: u32,
    backends: Vec<Entry>,
}

#[derive(Serialize)]
struct Entry {
    name: String,
    version: String,
    device: String,
    capabilities: Vec<&'static str>,
}

impl Entry {
    fn new(info: &BackendInfo) -> Self {
        let can = &info.capabilities;
        let capabilities = [
            (can.covered, "covered"),
            (can.tiny_patches, "tiny-patches"),
            (can.items, "items"),
            (can.lossless_culling, "lossless-culling"),
        ];
        Self {
            name: info.name.clone(),
            version: info.version.clone(),
            device: info.device.clone(),
            capabilities: capabilities
                .into_iter()
                .filter_map(|(can, name)| can.then_some(name))
                .collect(),
        }
    }
}

pub(crate) fn run(command: &Backends) -> Result<Exit> {
    let Backends::List(arguments) = command;
    let json = JsonReport::open(&arguments.report)?;
    let backends = vec![Entry::new(CpuBackend::new().info())];
    if let Some(json) = json {
        json.write(&ListReport {
            schema: SCHEMA,
            backends,
        })?;
        return Ok(Exit::Done);
    }
    let rows = backends
        .into_iter()
        .map(|entry| [entry.name, entry.version, entry.device, entry.capabilities.join(", ")]);
    report::print(&report::table(["name", "version", "device", "capabilities"], rows))?;
    Ok(Exit::Done)
}
