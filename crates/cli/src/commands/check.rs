//! `hemicube check`: whether a store holds what a form-factor matrix must be.

use crate::args::{Report as ReportArguments, Talk, not_negative};
use crate::exit::Exit;
use crate::help::examples;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, SCHEMA, counted, figures, percent};
use anyhow::Result;
use clap::Args;
use hemicube::analysis::balance::BalanceEntry;
use hemicube::analysis::check::{Check, CheckOptions, CheckReport, check};
use hemicube::store::Store;
use serde::Serialize;
use std::path::PathBuf;

/// A scene of which no more escapes on average is nearly closed.
const NEARLY_CLOSED: f64 = 0.05;

/// Check a matrix: closure, reciprocity, range, checksums; exit 1 when a bound is broken
#[derive(Args, Debug)]
#[command(after_long_help = examples("  hemicube check room.hemicube\n  hemicube check room.hemicube --reciprocity 0.05", false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Bound on how far from 1 a row may sum [default: 1e-6]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) closure: Option<f64>,
    /// Bound on the part of a row that escapes, for closed scenes: 0.001 [default: none, it is reported only]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) escaped: Option<f64>,
    /// Bound on the relative difference of A_i F_ij and A_j F_ji [default: none, it is reported only]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) reciprocity: Option<f64>,
    /// Accept a matrix of which parts are missing, such as that of an interrupted run
    #[arg(long)]
    pub(crate) allow_incomplete: bool,
    /// How many of the rows that sum worst are listed
    #[arg(long, value_name = "N", default_value = "5", value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub(crate) worst: u16,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().store([&self.store]).reports(&self.report)
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    check: &'a CheckReport,
    /// What was done to the matrix after it was computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    balance: Option<&'a BalanceEntry>,
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::open(&arguments.report)?;
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let mut options = CheckOptions::default();
    options.closure = arguments.closure;
    options.escaped = arguments.escaped;
    options.reciprocity = arguments.reciprocity;
    options.worst_rows = arguments.worst.into();
    options.allow_incomplete = arguments.allow_incomplete;
    let bar = Bar::spinner(talk, "checking");
    let found = check(&store, &options)?;
    drop(bar);
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            check: &found,
            balance: store.manifest().balance.as_ref(),
        })?;
    }
    if !arguments.report.is_to_stdout() {
        report::print(&text(&found, &store))?;
    }
    Ok(if found.ok { Exit::Done } else { Exit::NotHeld })
}

/// What the matrix is, and where the weight of its rows went. A page goes to others, and does not name the directory.
pub(super) fn facts(found: &CheckReport, store: &Store, is_named: bool) -> Listing {
    let manifest = store.manifest();
    let parts = if found.complete {
        "all parts are there".to_owned()
    } else {
        format!("{} of {} parts are there", manifest.parts.len(), manifest.part_count)
    };
    let mut list = Listing::default();
    let scene = format!("of `{}`", manifest.scene.file);
    list.add(
        "matrix",
        if is_named {
            format!("{} {scene}", found.store.display())
        } else {
            scene
        },
    );
    if found.value_error > 0.0 {
        list.add(
            "form",
            format!(
                "compact: form factors within {} of themselves",
                percent(found.value_error)
            ),
        );
    }
    if manifest.min_factor > 0.0 {
        let entries = manifest.thinning.map_or_else(String::new, |thinning| {
            format!(
                "{} with {} of what all carry, which the others of their row carry now; ",
                counted(thinning.entries_dropped, "entry"),
                percent(thinning.mass_dropped)
            )
        });
        list.add(
            "left out",
            format!("{entries}form factors below {}", figures(manifest.min_factor)),
        );
    }
    if let Some(balance) = &manifest.balance {
        list.add("balanced", super::balance::summary(balance));
    }
    list.add("patches", report::count(found.patch_count.into()));
    list.add("rows", format!("{} ({parts})", report::count(found.rows)));
    let per_row = found.entries_per_row;
    list.add(
        "entries",
        format!(
            "{} ({} a row in the median, from {} to {})",
            report::count(found.entries),
            report::count(per_row.median),
            report::count(per_row.min),
            report::count(per_row.max)
        ),
    );
    list.add(
        "escaped",
        format!(
            "{} of the view, on average: it leaves the scene",
            percent(found.escaped)
        ),
    );
    list.add(
        "blocked",
        format!(
            "{} of the view, on average: backs of one-sided surfaces, in {}",
            percent(found.blocked),
            counted(found.blocked_rows, "row")
        ),
    );
    if found.unselected > 0.0 {
        list.add(
            "unselected",
            format!(
                "{} of the view, on average: no columns for it",
                percent(found.unselected)
            ),
        );
    }
    list
}

/// What was checked, and what came of it.
pub(super) struct Verdict {
    pub(super) name: &'static str,
    /// `ok`, `FAILED`, or `-` for what is measured and has no bound.
    pub(super) state: &'static str,
    pub(super) what: String,
}

pub(super) fn verdicts(found: &CheckReport) -> Vec<Verdict> {
    let failed = |checks: &[Check]| {
        if found.failures.iter().any(|failure| checks.contains(&failure.check)) {
            "FAILED"
        } else {
            "ok"
        }
    };
    let mut verdicts = Vec::new();
    let mut add = |name, state, what| verdicts.push(Verdict { name, state, what });
    add(
        "files",
        failed(&[Check::Files, Check::Table, Check::Manifest, Check::Complete]),
        "checksums, patch table, totals".to_owned(),
    );
    add(
        "weights",
        failed(&[Check::Weights, Check::Visible]),
        "every row's weights are its hemicubes', exactly".to_owned(),
    );
    add(
        "range",
        failed(&[Check::Range, Check::Diagonal, Check::Columns]),
        "every form factor is from 0 to 1, F_ii = 0, columns ascend".to_owned(),
    );
    add(
        "closure",
        if found.closure.bound.is_some() {
            failed(&[Check::Closure])
        } else {
            "-"
        },
        format!(
            "|sum of F + escaped + blocked - 1| is at most {}, on average {}; {}",
            figures(found.closure.max),
            figures(found.closure.mean),
            found.closure.bound.map_or_else(
                || "no bound (`--closure X` sets one)".to_owned(),
                |bound| format!("bound {}", figures(bound))
            )
        ),
    );
    // Of scenes that are closed but for a little, and where it was asked for.
    if found.escaped_bound.is_some() || (found.escaped > 0.0 && found.escaped <= NEARLY_CLOSED) {
        let bound = found.escaped_bound.map_or_else(
            || {
                "the scene is nearly closed; no bound (`--escaped X` sets one, `inspect` says where it leaks)"
                    .to_owned()
            },
            |bound| format!("bound {}", figures(bound)),
        );
        add(
            "escaped",
            if found.escaped_bound.is_some() {
                failed(&[Check::Escaped])
            } else {
                "-"
            },
            format!(
                "at most {} of a row leaves the scene; {bound}",
                percent(found.escaped_max)
            ),
        );
    }
    if found.failures.iter().any(|failure| failure.check == Check::Entries) {
        add("entries", "FAILED", "no row has an entry".to_owned());
    }
    let pairs = found.reciprocity;
    let (state, bound) = match pairs.bound {
        Some(bound) => (failed(&[Check::Reciprocity]), format!("bound {}", figures(bound))),
        None => ("-", "no bound (`--reciprocity X` sets one)".to_owned()),
    };
    add(
        "reciprocity",
        state,
        if pairs.pairs == 0 {
            "no pair of rows to compare".to_owned()
        } else {
            format!(
                "A_i F_ij and A_j F_ji differ by {} in {} of {}; {bound}",
                percent(pairs.residual),
                counted(pairs.pairs, "pair"),
                counted(pairs.rows, "row")
            )
        },
    );
    let sky = found.sky.map(|sky| {
        let others = if sky.rows_as_in_matrix == sky.rows {
            String::new()
        } else {
            format!(
                ", the others at most {} of the view more or less",
                percent(sky.difference)
            )
        };
        format!(
            "{} add up to what escaped, weight for weight; {} of {} lost there what they lost in the matrix{others}",
            counted(sky.columns.into(), "column"),
            report::count(sky.rows_as_in_matrix),
            counted(sky.rows, "row"),
        )
    });
    if sky.is_some() || found.failures.iter().any(|failure| failure.check == Check::Sky) {
        add(
            "sky",
            failed(&[Check::Sky]),
            sky.unwrap_or_else(|| "sky rows beside the matrix".to_owned()),
        );
    }
    verdicts
}

/// The name of a check, as it is said.
pub(super) fn name(check: Check) -> String {
    format!("{check:?}").to_ascii_lowercase()
}

fn text(found: &CheckReport, store: &Store) -> String {
    let mut text = facts(found, store, true).text();
    text.push('\n');
    let mut checks = Listing::default();
    for Verdict { name, state, what } in verdicts(found) {
        checks.add(name, format!("{state:6}  {what}"));
    }
    text.push_str(&checks.text());
    if !found.worst_rows.is_empty() && found.closure.max > 0.0 {
        text.push_str("\nThe rows that sum worst:\n");
        text.push_str(&report::table(
            ["patch", "closure error", "sum of F", "escaped", "blocked"],
            found.worst_rows.iter().map(|row| {
                [
                    row.patch.to_string(),
                    figures(row.closure_error),
                    format!("{:.6}", row.row_sum),
                    percent(row.escaped),
                    percent(row.blocked),
                ]
            }),
        ));
    }
    text.push('\n');
    for failure in &found.failures {
        text.push_str(&format!(
            "FAILED {}: {}, the first: {}\n",
            name(failure.check),
            counted(failure.count, "case"),
            failure.first
        ));
    }
    if found.ok {
        text.push_str("Everything holds.\n");
    }
    text
}
