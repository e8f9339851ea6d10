//! `hemicube backends`: the engines, their devices and capabilities.

mod check;

use crate::args::{Report as ReportArguments, Talk};
use crate::exit::Exit;
use crate::help::examples;
use crate::outputs::Paths;
use crate::prepare::{BUILT_IN, registry};
use crate::report::{self, JsonReport, SCHEMA};
use anyhow::Result;
use clap::{Args, Subcommand};
use hemicube::backend::{Capabilities, HemicubeBackend};
use hemicube_backend_cpu::CpuBackend;
use hemicube_host::{Device, Listed, LoadError, OPENS_LIBRARIES, State};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

const EXAMPLES_OF_CHECK: &str = "  \
  hemicube backends check vulkan
  hemicube backends check ./libhemicube_backend_mine.so --only 'room/*'";

/// Subcommands of `backends`.
#[derive(Debug, Subcommand)]
pub(crate) enum Backends {
    /// List the backends, their devices and what they can do, and why others cannot be used
    List(ListArguments),
    /// Hold a backend against the contract, each case in a process of its own; exit 1 when one is not kept
    #[command(after_long_help = examples(EXAMPLES_OF_CHECK, false))]
    Check(check::Arguments),
    /// Print the header for backends in C: `hemicube backends header > hemicube_backend.h`
    Header,
}

/// `hemicube backends list`
#[derive(Args, Debug)]
pub(crate) struct ListArguments {
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Backends {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        match self {
            Self::List(_) => Paths::default(),
            Self::Check(arguments) => arguments.paths(),
            Self::Header => Paths::default(),
        }
    }
}

#[derive(Serialize)]
struct ListReport {
    schema: u32,
    backends: Vec<Entry>,
    /// Unusable files that look like backends.
    unusable: Vec<Unusable>,
    /// Searched folders, in order.
    folders: Vec<FolderEntry>,
}

/// A device of a backend.
#[derive(Serialize)]
struct Entry {
    name: String,
    version: String,
    /// Place in the backend's list, for `--backend-option device=`.
    device_number: usize,
    device: String,
    kind: &'static str,
    capabilities: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<PathBuf>,
}

#[derive(Serialize)]
struct Unusable {
    name: String,
    path: PathBuf,
    reason: String,
}

#[derive(Serialize)]
struct FolderEntry {
    path: PathBuf,
    origin: String,
    exists: bool,
}

fn capabilities(can: Capabilities) -> Vec<&'static str> {
    [
        (can.covered, "covered"),
        (can.tiny_patches, "tiny-patches"),
        (can.items, "items"),
        (can.lossless_culling, "lossless-culling"),
        (can.passes, "passes"),
        (can.rays, "rays"),
        (can.leaves_close, "leaves-close"),
    ]
    .into_iter()
    .filter_map(|(can, name)| can.then_some(name))
    .collect()
}

impl Entry {
    fn built_in() -> Self {
        let backend = CpuBackend::new();
        let info = backend.info();
        Self {
            name: info.name.clone(),
            version: info.version.clone(),
            device_number: 0,
            device: info.device.clone(),
            kind: "processor",
            capabilities: capabilities(info.capabilities),
            path: None,
        }
    }

    fn of(name: &str, version: &str, path: PathBuf, device_number: usize, device: &Device) -> Self {
        Self {
            name: name.to_owned(),
            version: version.to_owned(),
            device_number,
            device: device.name.clone(),
            kind: device.kind.name(),
            capabilities: capabilities(device.capabilities),
            path: Some(path),
        }
    }
}

pub(crate) fn run(command: &Backends, talk: Talk) -> Result<Exit> {
    match command {
        Backends::List(arguments) => list(arguments),
        Backends::Check(arguments) => check::run(arguments, talk),
        Backends::Header => report::print(hemicube_host::C_HEADER).map(|()| Exit::Done),
    }
}

fn list(arguments: &ListArguments) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    let registry = registry();
    let (mut backends, mut unusable) = (vec![Entry::built_in()], Vec::new());
    for Listed { name, path, state, .. } in registry.list() {
        let reason = match state {
            State::Usable { version, devices } if !devices.is_empty() => {
                let entries = devices.iter().enumerate();
                backends.extend(entries.map(|(k, device)| Entry::of(&name, &version, path.clone(), k, device)));
                continue;
            }
            State::Usable { .. } => "finds no device".to_owned(),
            State::Failing { error, .. } => error.to_string(),
            State::Shadowed { by: Some(first) } => format!("shadowed by `{}`", first.display()),
            State::Shadowed { by: None } => format!("shadowed by the built-in `{BUILT_IN}`"),
            State::Unusable(reason) => reason.to_string(),
            other => format!("{other:?}"),
        };
        unusable.push(Unusable { name, path, reason });
    }
    if let Some(json) = json {
        let folders = registry.search().folders().iter().map(|folder| FolderEntry {
            path: folder.path.clone(),
            origin: folder.origin.to_string(),
            exists: folder.path.is_dir(),
        });
        json.write(&ListReport {
            schema: SCHEMA,
            backends,
            unusable,
            folders: folders.collect(),
        })?;
        return Ok(Exit::Done);
    }
    let rows = backends.into_iter().map(|entry| {
        let place = entry
            .path
            .map_or_else(|| "built in".to_owned(), |path| path.display().to_string());
        let device = match entry.device_number {
            0 => entry.device,
            number => format!("{} (device={number})", entry.device),
        };
        [entry.name, entry.version, device, entry.capabilities.join(", "), place]
    });
    let mut text = report::table(["name", "version", "device", "capabilities", "file"], rows);
    if !unusable.is_empty() {
        text.push_str("\nnot usable:\n");
        for Unusable { name, path, reason } in unusable {
            let _ = writeln!(text, "{name}  {}  {reason}", path.display());
        }
    }
    if !OPENS_LIBRARIES {
        let _ = writeln!(text, "\nno others: {}", LoadError::Static);
    }
    report::print(&text)?;
    Ok(Exit::Done)
}
