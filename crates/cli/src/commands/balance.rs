//! `hemicube balance`: a reciprocal, closed or thinned copy of a matrix.

use crate::args::{Report as ReportArguments, Talk, number, share};
use crate::exit::{Exit, hinted, watch_interrupts};
use crate::help::examples;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, SCHEMA, count, counted, figures, percent, size};
use anyhow::{Result, bail};
use clap::Args;
use hemicube::analysis::balance::{BalanceEntry, BalanceOptions, BalanceReport, TOLERANCE_MIN, balance};
use hemicube::store::{Error, Store};
use serde::Serialize;
use std::path::PathBuf;

/// What closing does unless options say otherwise: largest scale, closure error, sweeps.
const MAX_SCALE: f64 = 1.1;
const CLOSURE_ERROR: f64 = 1e-6;
const SWEEPS: u32 = 1000;

const EXAMPLES: &str = "  \
  hemicube balance room.hemicube -o closed.hemicube
  hemicube balance city.hemicube -o small.hemicube --min-factor 1e-5 --reciprocity";

/// Write a balanced copy of a matrix: reciprocal, closed, or without small entries
#[derive(Args, Debug)]
#[command(override_usage = "hemicube balance [OPTIONS] DIR -o OUT", after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The directory to write the balanced matrix to
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Scale rows and columns until each row closes (sum of F + escaped + blocked = 1) and A_i F_ij = A_j F_ji [default
    /// without `--reciprocity` and `--min-factor`]
    #[arg(long)]
    pub(crate) closure: bool,
    /// Only make A_i F_ij and A_j F_ji equal
    #[arg(long)]
    pub(crate) reciprocity: bool,
    /// Leave out form factors below F and rescale the row
    #[arg(long, value_name = "F", value_parser = share, allow_negative_numbers = true)]
    pub(crate) min_factor: Option<f64>,
    /// The closure error of a row at which the scaling ends [default: 1e-6]
    #[arg(long, value_name = "X", value_parser = residual, allow_negative_numbers = true)]
    pub(crate) max_closure: Option<f64>,
    /// Sweeps of the scaling before it gives up, with exit 1 [default: 1000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), hide_short_help = true)]
    pub(crate) max_iterations: Option<u32>,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().store([&self.store]).makes([&self.output])
    }
}

impl Arguments {
    /// True if rows are closed: where it is asked for, and where nothing else is.
    fn closes(&self) -> bool {
        self.closure || !self.reciprocity && self.min_factor.is_none()
    }

    /// An option that only closing has.
    fn of_closing(&self) -> Option<&'static str> {
        let given = [
            (self.max_closure.is_some(), "max-closure"),
            (self.max_iterations.is_some(), "max-iterations"),
        ];
        given.into_iter().find(|(is_given, _)| *is_given).map(|(_, name)| name)
    }
}

fn residual(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if (TOLERANCE_MIN..1.0).contains(&number) {
        Ok(number)
    } else {
        Err("a number from 1e-7 up to 1 is needed: form factors are stored with seven digits".to_owned())
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    report: &'a BalanceReport,
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let closure = arguments.closes();
    if let (false, Some(name)) = (closure, arguments.of_closing()) {
        bail!("`--{name}` is of closing, and rows are not closed: add `--closure`");
    }
    let options = BalanceOptions {
        closure,
        reciprocity: arguments.reciprocity,
        min_factor: arguments.min_factor.unwrap_or(0.0),
        max_scale: MAX_SCALE,
        tolerance: arguments.max_closure.unwrap_or(CLOSURE_ERROR),
        max_sweeps: arguments.max_iterations.unwrap_or(SWEEPS),
        overwrite: arguments.overwrite,
    };
    // Nothing of a balanced matrix is worth keeping but all of it: an interrupt ends the program at once.
    watch_interrupts()?;
    let bar = Bar::spinner(talk, "balancing");
    let found = balance(&store, &arguments.output, &options).map_err(|error| hint(error, arguments))?;
    drop(bar);
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            report: &found,
        })?;
    }
    if !arguments.report.json {
        report::print(&text(&found))?;
    }
    for warning in warnings(&found.balance) {
        talk.warn(&warning);
    }
    Ok(if found.balance.converged {
        Exit::Done
    } else {
        Exit::NotHeld
    })
}

/// Adds the next step to errors without one.
fn hint(error: Error, arguments: &Arguments) -> anyhow::Error {
    let step = match &error {
        Error::Refused { .. } => Some("`hemicube balance --help` has examples".to_owned()),
        Error::Checksum { .. } | Error::Malformed { .. } => Some(format!(
            "`hemicube check {}` looks at all of it",
            arguments.store.display()
        )),
        _ => None,
    };
    match step {
        Some(step) => hinted(error.into(), step),
        None => error.into(),
    }
}

/// The operations, in a few words.
pub(crate) fn summary(entry: &BalanceEntry) -> String {
    let mut words = Vec::new();
    if entry.closure {
        words.push(format!(
            "scaled to closure in {}",
            counted(entry.sweeps.into(), "sweep")
        ));
    }
    if entry.reciprocity {
        words.push("made reciprocal".to_owned());
    }
    if entry.min_factor > 0.0 {
        words.push(format!(
            "without {} below {}",
            counted(entry.entries_dropped, "entry"),
            figures(entry.min_factor)
        ));
    }
    words.join(", ")
}

fn text(found: &BalanceReport) -> String {
    let entry = &found.balance;
    let mut list = Listing::default();
    list.add(
        "matrix",
        format!("`{}` from `{}`", found.output.display(), found.source.display()),
    );
    list.add("balanced", summary(entry));
    if entry.reciprocity {
        list.add(
            "pairs",
            format!(
                "{}, of which one row lacked {}",
                count(entry.pairs),
                count(entry.pairs_one_sided)
            ),
        );
    }
    if entry.min_factor > 0.0 {
        list.add(
            "dropped",
            format!(
                "{} with {} of what all carry; the others carry it now",
                counted(entry.entries_dropped, "entry"),
                percent(entry.mass_dropped)
            ),
        );
    }
    list.add(
        "scaled",
        format!("entries by {} to {}", factor(entry.scale_min), factor(entry.scale_max)),
    );
    let mut text = list.text();
    text.push('\n');
    let (before, after) = (entry.before, entry.after);
    let row = |name: &str, before: String, after: String| [name.to_owned(), before, after];
    let mut rows = vec![
        row("entries", count(entry.entries_before), count(entry.entries_after)),
        row("size", size(found.bytes_before), size(found.bytes_after)),
        row(
            "closure error, worst row",
            figures(before.closure_max),
            figures(after.closure_max),
        ),
        row(
            "closure error, root mean square",
            figures(before.closure_rms),
            figures(after.closure_rms),
        ),
        row(
            "reciprocity residual",
            figures(before.reciprocity),
            figures(after.reciprocity),
        ),
        row(
            "reciprocity, worst pair",
            figures(before.reciprocity_worst),
            figures(after.reciprocity_worst),
        ),
    ];
    let uncounted = entry.rows_at_bound + entry.rows_empty + entry.rows_without_target;
    if entry.closure && uncounted > 0 {
        rows.insert(
            3,
            row(
                "closure error, worst of those that can be closed",
                String::new(),
                figures(entry.closure_max_of_others),
            ),
        );
    }
    text.push_str(&report::table(["", "before", "after"], rows));
    text
}

/// A factor near 1, with enough digits to tell it from 1.
fn factor(value: f64) -> String {
    format!("{value:.4}")
}

fn warnings(entry: &BalanceEntry) -> Vec<String> {
    let mut warnings = Vec::new();
    if !entry.converged {
        warnings.push(format!(
            "the rows did not settle within {} to {}; allow more by `--max-iterations`, or \
             ask for less by `--max-closure`",
            counted(entry.sweeps.into(), "sweep"),
            figures(entry.tolerance)
        ));
    }
    let mut rows = |number: u64, why: &str| {
        if number > 0 {
            warnings.push(format!("{} {why}", counted(number, "row")));
        }
    };
    rows(
        entry.rows_empty,
        "cannot be closed: no entries, though the hemicubes saw patches",
    );
    rows(
        entry.rows_without_target,
        "cannot be closed: their hemicubes saw no patch, and yet they have entries, of patches that see them",
    );
    rows(
        entry.rows_at_bound,
        &format!("would have to be scaled by more than {MAX_SCALE} to close; the closure error of the worst is above"),
    );
    rows(
        entry.rows_kept_whole,
        "kept entries below `--min-factor`: nearly all of theirs are",
    );
    warnings
}
