//! `hemicube export`: the matrix in the files that other programs read.

use crate::args::{Export as Arguments, FormatName, Talk};
use crate::exit::Exit;
use crate::progress::Bar;
use crate::report::{self, JsonReport, SCHEMA, count, counted, size};
use anyhow::Result;
use hemicube::export::{ExportFormat, ExportOptions, ExportReport, export};
use hemicube::store::Store;
use serde::Serialize;

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
