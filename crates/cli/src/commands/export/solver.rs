//! `hemicube export --for`: the matrix in a radiation solver's files.

use super::{Arguments, interruptible};
use crate::args::Talk;
use crate::exit::{Exit, hinted};
use crate::report::{self, JsonReport, SCHEMA, counted, size};
use anyhow::{Context, Result, anyhow};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command};
use hemicube::store::Store;
use hemicube_export::{Grouping, SolverFormat, SolverOptions, SolverReport, export_for};
use serde::Serialize;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Bytes of a file of an order, at most: a name of 100 characters for each of 10⁷ faces.
const ORDER_BYTES_MAX: u64 = 1 << 30;

/// The solvers, for `--for`: a name, or a name and a version, `calculix:2.21`.
#[derive(Clone)]
pub(super) struct Programs(PossibleValuesParser);

impl Programs {
    pub(super) fn parser() -> Self {
        let named = |format: &SolverFormat| PossibleValue::new(format.label()).help(format.about());
        Self(SolverFormat::ALL.iter().map(named).collect::<Vec<_>>().into())
    }
}

impl TypedValueParser for Programs {
    type Value = String;

    fn parse_ref(&self, command: &Command, argument: Option<&Arg>, value: &OsStr) -> Result<String, clap::Error> {
        let text = value.to_string_lossy();
        self.0.parse_ref(command, argument, named(&text).0.as_ref())?;
        Ok(text.into_owned())
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        self.0.possible_values()
    }
}

/// Name and version of `--for`.
fn named(program: &str) -> (&str, Option<&str>) {
    match program.split_once(':') {
        Some((name, version)) => (name, Some(version)),
        None => (program, None),
    }
}

/// The files that OUT stands for, if it stands for others than itself.
pub(super) fn files(arguments: &Arguments) -> Option<Vec<PathBuf>> {
    let output = arguments.output();
    match SolverFormat::named_as(named(arguments.program.as_deref()?).0)? {
        SolverFormat::OpenFoam => Some(["F", "globalFaceFaces", "mapDist"].map(|name| output.join(name)).into()),
        SolverFormat::Udales => {
            let name = output.file_name()?.to_string_lossy().replace("vfsparse", "svf");
            let beside = output.with_file_name(name);
            // A name of another form is refused with the matrix.
            let both = if beside == output {
                vec![beside]
            } else {
                vec![output.to_owned(), beside]
            };
            Some(both)
        }
        _ => None,
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(rename = "for")]
    solver: &'static str,
    #[serde(flatten)]
    export: &'a SolverReport,
}

/// Names of rows, a line each; an empty last line is none.
fn order(path: &Path) -> Result<Vec<String>> {
    let failed = || format!("`{}` cannot be read", path.display());
    let bytes = std::fs::metadata(path).with_context(failed)?.len();
    if bytes > ORDER_BYTES_MAX {
        return Err(anyhow!(
            "`{}` has {}, more than an order of rows",
            path.display(),
            size(bytes)
        ));
    }
    let text = std::fs::read_to_string(path).with_context(failed)?;
    let text = text.trim_start_matches('\u{feff}');
    Ok(text.lines().map(|line| line.trim().to_owned()).collect())
}

pub(super) fn run(arguments: &Arguments, program: &str, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    let (program, version) = named(program);
    let Some(format) = SolverFormat::named_as(program) else {
        return Err(anyhow!("there is no solver `{program}`"));
    };
    for (name, given, wanted) in [
        ("--zone", arguments.zone.is_some(), format == SolverFormat::EnergyPlus),
        (
            ":VERSION",
            version.is_some(),
            matches!(format, SolverFormat::EnergyPlus | SolverFormat::Calculix),
        ),
    ] {
        if given && !wanted {
            return Err(hinted(
                anyhow!("`{name}` has no meaning for {}", format.program()),
                "leave it out; `hemicube export --help` says which solvers it is for",
            ));
        }
    }
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let order = arguments.order.as_deref().map(order).transpose()?;
    let written = interruptible(arguments, talk, |write| {
        let options = SolverOptions {
            grouping: arguments.by.map(|by| Grouping::By(by.into())),
            order: order.as_deref(),
            zone: arguments.zone.as_deref(),
            version,
            write,
        };
        export_for(&store, arguments.output(), format, &options)
    });
    let Some(found) = written? else {
        return Ok(Exit::Interrupted);
    };
    for file in &found.files {
        talk.say(&format!("`{}`: {}", file.path.display(), size(file.bytes)));
    }
    let rows = match found.grouping {
        Grouping::Patch => counted(found.rows, "patch"),
        grouping => counted(found.rows, grouping.word()),
    };
    let reciprocity = match found.found.reciprocity {
        Some(residual) => format!(", reciprocal to {residual:.0e}"),
        None => String::new(),
    };
    talk.say(&format!(
        "{rows}, {}; rows sum to {:.6} to {:.6}{reciprocity}",
        counted(found.found.entries, "entry"),
        found.found.sums[0],
        found.found.sums[1]
    ));
    talk.say(&found.next);
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            solver: format.label(),
            export: &found,
        })?;
    }
    Ok(Exit::Done)
}
