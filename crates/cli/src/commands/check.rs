//! `hemicube check`: the properties of a form-factor matrix, checked on a store.

use crate::args::{Report as ReportArguments, Talk, not_negative};
use crate::escape::shown;
use crate::exit::Exit;
use crate::help::examples;
use crate::level::asked as asked_for;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, SCHEMA, counted, figures, percent, small_percent};
use anyhow::Result;
use clap::Args;
use hemicube::analysis::balance::BalanceEntry;
use hemicube::analysis::check::verdict::{Doubt, State, Subject, Verdict};
use hemicube::analysis::check::{Check, CheckOptions, CheckReport, check};
use hemicube::driver::settings::{LossRecord, ReadingRecord};
use hemicube::store::{Form, Store};
use serde::Serialize;
use std::path::PathBuf;

/// Largest mean escaped share of a nearly closed scene.
const NEARLY_CLOSED: f64 = 0.05;

const EXAMPLES: &str = "  \
  hemicube check room.hemicube
  hemicube check room.hemicube --max-reciprocity 0.05
  hemicube check room.hemicube --strict";

/// Check a matrix: integrity, conservation, quality; exit 1 when a law or a bound is broken, or parts are missing
///
/// integrity: checksums, structure, all parts. conservation: each hemicube's weights add up; limits given here hold.
/// quality: DOUBTFUL where the closure error of a row, |sum of F + escaped + blocked - 1|, is above the run's tolerance
/// (2 % for sums of pixels), A_i F_ij and A_j F_ji differ by more than twice that, more than 1 % of the view is blocked
/// by backs of surfaces, or a row sees mostly backs. A doubt alone is exit 0, and 1 with `--strict`.
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Fail where the closure error of a row is above X [default: doubt above the run's tolerance; for sums of pixels
    /// fail above 1e-6]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) max_closure: Option<f64>,
    /// Fail where A_i F_ij and A_j F_ji differ by more than X [default: doubt above twice the run's
    /// tolerance, or three standard errors]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) max_reciprocity: Option<f64>,
    /// Exit 1 where the quality is doubtful, too
    #[arg(long)]
    pub(crate) strict: bool,
    /// Accept a matrix of which parts are missing, such as that of an interrupted run
    #[arg(long)]
    pub(crate) allow_incomplete: bool,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().store([&self.store])
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    check: &'a CheckReport,
    /// What was not taken as the scene's file says.
    losses: Vec<LossRecord>,
    /// The last balancing of the matrix, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    balance: Option<&'a BalanceEntry>,
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let mut options = CheckOptions::default();
    options.closure = arguments.max_closure;
    options.reciprocity = arguments.max_reciprocity;
    options.worst_rows = if talk.verbose { 20 } else { 5 };
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
            losses: ReadingRecord::of_settings(&store.manifest().settings).losses,
            balance: store.manifest().balance.as_ref(),
        })?;
    }
    if !arguments.report.json {
        report::print_verdicts(&text(&found, &store))?;
    }
    let holds = found.ok && (found.verdicts.are_ok() || !arguments.strict);
    Ok(if holds { Exit::Done } else { Exit::NotHeld })
}

/// Facts about the matrix, and where its rows' weight went. A page is given to others, and does not name the directory.
pub(super) fn facts(found: &CheckReport, store: &Store, is_named: bool) -> Listing {
    let manifest = store.manifest();
    let parts = if found.complete {
        "all parts are there".to_owned()
    } else {
        format!("{} of {} parts are there", manifest.parts.len(), manifest.part_count)
    };
    let mut list = Listing::default();
    let reading = ReadingRecord::of_settings(&manifest.settings);
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
    if found.form == Form::Double {
        list.add("form", "double: form factors in f64");
    }
    if let (Some(asked), Some(expected)) = (found.tolerance, found.expected_error) {
        list.add("error", error_against(expected, asked));
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
    for sentence in reading
        .warnings
        .iter()
        .cloned()
        .chain(reading.losses.iter().map(LossRecord::sentence))
    {
        list.add("of the file", shown(&sentence).into_owned());
    }
    if let Some(crs) = &reading.crs {
        list.add("coordinates", format!("in `{}`", shown(crs)));
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
    if let (Some(mean), Some(largest)) = (found.cut_off, found.cut_off_max) {
        list.add(
            "cut off",
            format!(
                "{} of the view, on average, after the last portal; {} of a row at most",
                percent(mean),
                percent(largest)
            ),
        );
    }
    list
}

/// An expected error against the tolerance asked for.
pub(super) fn error_against(expected: f64, asked: f64) -> String {
    let verdict = if expected > asked { ": not reached" } else { "" };
    format!(
        "{} expected, {} asked{verdict}",
        small_percent(expected),
        asked_for(asked)
    )
}

/// A verdict in words.
pub(super) struct Sentence {
    pub(super) subject: &'static str,
    pub(super) state: State,
    pub(super) what: String,
}

/// The three verdicts in words.
pub(super) fn sentences(found: &CheckReport) -> [Sentence; 3] {
    found.verdicts.each().map(|(subject, verdict)| Sentence {
        subject: match subject {
            Subject::Integrity => "integrity",
            Subject::Conservation => "conservation",
            Subject::Quality => "quality",
        },
        state: verdict.state,
        what: reasons(found, subject, verdict),
    })
}

/// The word for a state in a table.
pub(super) fn word(state: State) -> &'static str {
    match state {
        State::Ok => "ok",
        State::Doubtful => "DOUBTFUL",
        State::Unfinished => "UNFINISHED",
        State::Failed => "FAILED",
    }
}

fn reasons(found: &CheckReport, subject: Subject, verdict: &Verdict) -> String {
    if verdict.state == State::Ok {
        return match subject {
            Subject::Integrity if !found.complete => "what is there is as it was written; parts are missing".to_owned(),
            Subject::Integrity => "the files are as they were written".to_owned(),
            Subject::Conservation => "the weights of every hemicube add up exactly".to_owned(),
            Subject::Quality if found.closure.rows == 0 => "no row to judge by".to_owned(),
            Subject::Quality => format!(
                "rows close within {} (limit {}), and {} of the view is blocked by backs",
                figures(found.closure.max),
                figures(found.quality.closure_limit),
                percent(found.blocked)
            ),
        };
    }
    let failed = verdict.failed.iter().map(|&check| match check {
        Check::Complete => "parts are still to be computed".to_owned(),
        other => format!("{} failed", name(other)),
    });
    let doubts = verdict.doubts.iter().map(|doubt| match doubt {
        Doubt::Closure => format!(
            "{} a closure error above {}, {} at most",
            number_of_rows(found.quality.closure_rows, "has", "have"),
            figures(found.quality.closure_limit),
            figures(found.closure.max)
        ),
        Doubt::Reciprocity => format!(
            "A_i F_ij and A_j F_ji differ by {}, more than {}",
            percent(found.reciprocity.residual),
            figures(found.quality.reciprocity_limit)
        ),
        Doubt::Blocked => format!(
            "{} of the view is blocked by backs of surfaces, more than 1 %",
            percent(found.blocked)
        ),
        Doubt::Warned => format!(
            "{} mostly backs of surfaces",
            number_of_rows(found.quality.warned_rows, "sees", "see")
        ),
    });
    failed.chain(doubts).collect::<Vec<_>>().join("; ")
}

/// What to do about a verdict that is not ok.
fn next_steps(found: &CheckReport, store: &Store, verdict: &Verdict) -> Vec<String> {
    let matrix = crate::shell::word(store.directory());
    let scene = crate::shell::word(store.manifest().scene.file.as_ref());
    let again = "compute it again with a smaller `--tolerance`";
    let balance = format!("`hemicube balance {matrix} -o OUT` writes a copy that closes and is reciprocal");
    let inspect = format!("`hemicube inspect {scene}` says where");
    let closer = || match found.tolerance {
        Some(_) => format!("{again}, or {balance}"),
        None => format!("compute it without `--correction pixel`, or {balance}"),
    };
    let failed = verdict.failed.iter().map(|check| match check {
        Check::Complete => {
            "the command that began it goes on; `--allow-incomplete` accepts the parts that are there".to_owned()
        }
        Check::Closure | Check::Reciprocity => closer(),
        Check::Escaped => inspect.clone(),
        Check::Winding | Check::Entries => {
            format!("{inspect}; `compute --flip all` turns a model round that is wound outwards")
        }
        Check::Sky => format!("`hemicube sky {scene} --matrix {matrix}` computes the sky rows anew"),
        _ => "it is damaged: compute it again with `--overwrite`".to_owned(),
    });
    let doubts = verdict.doubts.iter().map(|doubt| match doubt {
        Doubt::Closure | Doubt::Reciprocity => closer(),
        Doubt::Blocked | Doubt::Warned => format!(
            "{inspect} patches lie inside solids or are wound the wrong way (`--exclude`, `--flip`); form factors \
             between the others hold"
        ),
    });
    let mut steps: Vec<String> = failed.chain(doubts).collect();
    steps.dedup();
    steps
}

/// `1 row has`, `4,103 rows have`.
fn number_of_rows(rows: u64, one: &str, many: &str) -> String {
    format!("{} {}", counted(rows, "row"), if rows == 1 { one } else { many })
}

/// A group of checks and their outcome.
pub(super) struct Group {
    pub(super) name: &'static str,
    /// `ok`, `DOUBT`, `FAILED`, or `-` for figures without a bound.
    pub(super) state: &'static str,
    pub(super) what: String,
}

impl Group {
    /// By whether one of `checks` failed.
    fn by(found: &CheckReport, checks: &[Check], name: &'static str, what: impl Into<String>) -> Self {
        Self {
            name,
            state: if has_failed(found, checks) { "FAILED" } else { "ok" },
            what: what.into(),
        }
    }

    /// Doubtful unless it failed.
    fn doubted(self, is_doubted: bool) -> Self {
        match self.state {
            "ok" if is_doubted => Self { state: "DOUBT", ..self },
            _ => self,
        }
    }

    /// By a check with an optional bound.
    fn bounded(found: &CheckReport, check: Check, bound: Option<f64>, name: &'static str, what: String) -> Self {
        let group = Self::by(found, &[check], name, what);
        match bound {
            Some(_) => group,
            None => Self { state: "-", ..group },
        }
    }
}

/// `limit 0.00100, the run's tolerance`.
fn limit_text(found: &CheckReport, limit: f64) -> String {
    let whose = if found.tolerance.is_some() {
        "the run's tolerance"
    } else {
        "for sums of pixels"
    };
    format!("limit {}, {whose}", figures(limit))
}

/// Each of two rows may be off by the tolerance, or by three of its standard errors.
fn reciprocity_limit_text(found: &CheckReport) -> String {
    let limit = found.quality.reciprocity_limit;
    if found.tolerance.is_some_and(|tolerance| limit > 2.0 * tolerance) {
        return format!("limit {}, three standard errors of both readings", figures(limit));
    }
    limit_text(found, limit).replace(", the run's", ", twice the run's")
}

fn has_failed(found: &CheckReport, checks: &[Check]) -> bool {
    found.failures.iter().any(|failure| checks.contains(&failure.check))
}

/// `bound 1.00e-6`, or how to set one.
fn bound_text(bound: Option<f64>, without: &str) -> String {
    bound.map_or_else(|| without.to_owned(), |bound| format!("bound {}", figures(bound)))
}

/// The outcome of all checks, in the order of the report.
pub(super) fn groups(found: &CheckReport) -> Vec<Group> {
    let files = [Check::Files, Check::Table, Check::Manifest];
    let range = [Check::Range, Check::Diagonal, Check::Columns];
    let mut groups = vec![
        Group::by(found, &files, "files", "checksums, patch table, totals"),
        Group::by(
            found,
            &[Check::Weights, Check::Visible, Check::Passed],
            "weights",
            "every row's weights are its hemicubes', exactly",
        ),
        Group::by(
            found,
            &range,
            "range",
            if found.patch_kind.is_triangle() {
                "every form factor is from 0 to 1, F_ii = 0, columns ascend"
            } else {
                "every form factor is from 0 to 1, F_ii = 0 where a patch is flat, columns ascend"
            },
        ),
        closure(found),
    ];
    groups.extend(row_errors(found));
    groups.extend(escaped(found));
    if has_failed(found, &[Check::Entries]) {
        groups.push(Group::by(found, &[Check::Entries], "entries", "no row has an entry"));
    }
    if has_failed(found, &[Check::Winding]) {
        groups.push(Group::by(
            found,
            &[Check::Winding],
            "winding",
            "the model is wound inwards",
        ));
    }
    groups.push(reciprocity(found));
    groups.extend(sky(found));
    groups
}

fn closure(found: &CheckReport) -> Group {
    let what = format!(
        "|sum of F + escaped + blocked - 1| is at most {}, on average {}; {}",
        figures(found.closure.max),
        figures(found.closure.mean),
        bound_text(found.closure.bound, &limit_text(found, found.quality.closure_limit))
    );
    let is_doubted = found.verdicts.quality.doubts.contains(&Doubt::Closure);
    Group::by(found, &[Check::Closure], "closure", what).doubted(is_doubted)
}

/// The standard errors that rows state, where a tolerance was asked for.
fn row_errors(found: &CheckReport) -> Option<Group> {
    let errors = found.row_errors?;
    let tolerance = asked_for(found.tolerance.unwrap_or_default());
    let rows = match errors.uncertain_rows {
        0 => format!("three of them are at most {tolerance}"),
        rows => format!(
            "three of them are more than {tolerance} in {}, most for patch {}",
            counted(rows, "row"),
            errors.worst_patch
        ),
    };
    let what = format!(
        "standard error of a row's sum {} in 95 % of the rows, of its escaped share {}; {rows}",
        figures(errors.sum_95),
        figures(errors.escaped_95),
    );
    Some(Group {
        name: "row errors",
        state: "-",
        what,
    })
}

/// The escaped share, of nearly closed scenes or with a bound.
fn escaped(found: &CheckReport) -> Option<Group> {
    let is_told = found.escaped_bound.is_some() || (found.escaped > 0.0 && found.escaped <= NEARLY_CLOSED);
    let bound = bound_text(
        found.escaped_bound,
        "the scene is nearly closed; `inspect` says where it leaks",
    );
    let what = format!(
        "at most {} of a row leaves the scene; {bound}",
        percent(found.escaped_max)
    );
    is_told.then(|| Group::bounded(found, Check::Escaped, found.escaped_bound, "escaped", what))
}

fn reciprocity(found: &CheckReport) -> Group {
    let pairs = found.reciprocity;
    let what = if pairs.pairs == 0 {
        "no pair of rows to compare".to_owned()
    } else {
        format!(
            "A_i F_ij and A_j F_ji differ by {} in {} of {}; {}",
            percent(pairs.residual),
            counted(pairs.pairs, "pair"),
            counted(pairs.rows, "row"),
            bound_text(pairs.bound, &reciprocity_limit_text(found))
        )
    };
    let is_doubted = found.verdicts.quality.doubts.contains(&Doubt::Reciprocity);
    let is_measured = (pairs.pairs > 0).then_some(found.quality.reciprocity_limit);
    Group::bounded(found, Check::Reciprocity, is_measured, "reciprocity", what).doubted(is_doubted)
}

/// The sky rows beside the matrix, if there are any or they should be.
fn sky(found: &CheckReport) -> Option<Group> {
    let what = found.sky.map(|sky| {
        let others = if sky.rows_as_in_matrix == sky.rows {
            String::new()
        } else {
            format!(
                ", the others at most {} of the view more or less",
                percent(sky.difference)
            )
        };
        format!(
            "the {} agree with the escaped energy of {} of {}{others}",
            counted(sky.columns.into(), "column"),
            report::count(sky.rows_as_in_matrix),
            counted(sky.rows, "row"),
        )
    });
    let is_told = what.is_some() || has_failed(found, &[Check::Sky]);
    let what = what.unwrap_or_else(|| "sky rows beside the matrix".to_owned());
    is_told.then(|| Group::by(found, &[Check::Sky], "sky", what))
}

/// The name of a check in messages.
pub(super) fn name(check: Check) -> String {
    format!("{check:?}").to_ascii_lowercase()
}

fn text(found: &CheckReport, store: &Store) -> String {
    let mut text = verdicts_text(found, store);
    text.push('\n');
    text.push_str(&facts(found, store, true).text());
    text.push('\n');
    let mut checks = Listing::default();
    for Group { name, state, what } in groups(found) {
        checks.add(name, format!("{state:6}  {what}"));
    }
    text.push_str(&checks.text());
    if !found.worst_rows.is_empty() && found.closure.max > 0.0 {
        text.push_str("\nRows with the largest closure error:\n");
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
    text
}

/// The verdicts, what failed, and the next steps.
fn verdicts_text(found: &CheckReport, store: &Store) -> String {
    let mut list = Listing::default();
    let verdicts: Vec<&Verdict> = found.verdicts.each().into_iter().map(|(_, verdict)| verdict).collect();
    for (Sentence { subject, state, what }, verdict) in sentences(found).into_iter().zip(verdicts) {
        list.add(subject, format!("{:10}  {what}", word(state)));
        for failure in found
            .failures
            .iter()
            .filter(|failure| verdict.failed.contains(&failure.check))
        {
            let first = if failure.check == Check::Complete {
                failure.first.clone()
            } else {
                format!(
                    "{}: {}, the first: {}",
                    name(failure.check),
                    counted(failure.count, "case"),
                    failure.first
                )
            };
            list.add("", format!("{:10}  {first}", ""));
        }
        if state != State::Ok {
            for step in next_steps(found, store, verdict) {
                list.add("", format!("{:10}  next: {step}", ""));
            }
        }
    }
    let mut text = list.text();
    text.push_str(match (found.ok, found.verdicts.quality.state) {
        (true, State::Ok) if found.complete => "Everything holds.\n",
        (true, State::Ok) => "What is there holds.\n",
        (true, _) => "No bound is broken, and the quality is doubtful (`--strict` makes that exit 1).\n",
        (false, _) => "",
    });
    text
}
