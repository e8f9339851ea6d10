//! `hemicube export`: the matrix in the files that other programs read.

use crate::args::{Export as Arguments, FormatName, Talk, ZoneName};
use crate::exit::Exit;
use crate::progress::Bar;
use crate::report::{self, JsonReport, SCHEMA, count, counted, size};
use anyhow::Result;
use hemicube::export::{ExportFormat, ExportOptions, ExportReport, export};
use hemicube::store::Store;
use hemicube::zones::{GroupBy, Zone, ZoneFormat, write_zones, zones};
use serde::Serialize;
use std::path::Path;

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    export: &'a ExportReport,
}

impl From<FormatName> for ExportFormat {
    fn from(name: FormatName) -> Self {
        match name {
            FormatName::Npz => Self::Npz,
            FormatName::Mtx => Self::MatrixMarket,
            FormatName::Txt => Self::Triplets,
            FormatName::Npy => Self::Npy,
        }
    }
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::open(&arguments.report)?;
    if let Some(by) = arguments.by {
        return export_zones(arguments, by, json, talk);
    }
    let format = match arguments.format {
        Some(name) => name.into(),
        None => ExportFormat::of(&arguments.output)?,
    };
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let mut options = ExportOptions::default();
    options.overwrite = arguments.overwrite;
    options.allow_incomplete = arguments.allow_incomplete;
    let bar = Bar::spinner(talk, &format!("writing `{}`", arguments.output.display()));
    let found = export(&store, &arguments.output, format, options)?;
    drop(bar);
    talk.say(&format!(
        "`{}`: {}, {} of {} of {}",
        found.path.display(),
        size(found.bytes),
        counted(found.entries, "entry"),
        counted(found.rows, "row"),
        count(found.patch_count.into()),
    ));
    if let Some(how) = how_to_read(&found) {
        talk.say(&how);
    }
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            export: &found,
        })?;
    }
    Ok(Exit::Done)
}

impl From<ZoneName> for GroupBy {
    fn from(name: ZoneName) -> Self {
        match name {
            ZoneName::Object => Self::Object,
            ZoneName::Material => Self::Material,
            ZoneName::Face => Self::Face,
        }
    }
}

#[derive(Serialize)]
struct ZonesReport<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    path: &'a Path,
    format: ZoneFormat,
    by: GroupBy,
    bytes: u64,
    zones: &'a [Zone],
}

fn export_zones(arguments: &Arguments, by: ZoneName, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    let format = ZoneFormat::of(&arguments.output)?;
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let bar = Bar::spinner(talk, &format!("adding up `{}`", arguments.store.display()));
    let found = zones(&store, by.into())?;
    let materials = &store.manifest().materials;
    let bytes = write_zones(&found, materials, &arguments.output, format, arguments.overwrite)?;
    drop(bar);
    talk.say(&format!(
        "`{}`: {}, {} of {}",
        arguments.output.display(),
        size(bytes),
        counted(found.len() as u64, "zone"),
        counted(store.patch_count().into(), "patch"),
    ));
    if let Some(json) = json {
        json.write(&ZonesReport {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: &arguments.output,
            format,
            by: by.into(),
            bytes,
            zones: &found,
        })?;
    }
    Ok(Exit::Done)
}

/// What to type in the program that the file is for. F[i, j] is from i to j.
fn how_to_read(found: &ExportReport) -> Option<String> {
    let path = found.path.display().to_string();
    // Names that would need quoting in three languages are left to who chose them.
    if path.contains(['"', '\'', '\\']) {
        return None;
    }
    match found.format {
        ExportFormat::Npz => Some(format!("Python: F = scipy.sparse.load_npz(\"{path}\")")),
        ExportFormat::MatrixMarket => Some(format!("Python: F = scipy.io.mmread(\"{path}\").tocsr()")),
        ExportFormat::Triplets => Some(format!("MATLAB, Octave: F = spconvert(load('{path}'));")),
        ExportFormat::Npy => Some(format!("Python: F = numpy.load(\"{path}\", mmap_mode=\"r\")")),
        _ => None,
    }
}
