//! `hemicube compare`: how far one matrix is from another.

use crate::args::{Compare as Arguments, Talk};
use crate::exit::Exit;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, SCHEMA, count, figures};
use anyhow::Result;
use hemicube::compare::{CompareOptions, Comparison, OverRows, compare};
use hemicube::store::Matrix;
use serde::Serialize;

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    comparison: &'a Comparison,
    equal: bool,
    max_error: Option<f64>,
    ok: bool,
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::open(&arguments.report)?;
    report::require(&arguments.matrix)?;
    report::require(&arguments.reference)?;
    let (matrix, reference) = (Matrix::open(&arguments.matrix)?, Matrix::open(&arguments.reference)?);
    let mut options = CompareOptions::default();
    options.rows = arguments.rows.map(|rows| rows.start..rows.end.unwrap_or(u32::MAX));
    let bar = Bar::spinner(talk, "comparing");
    let found = compare(&matrix, &reference, &options)?;
    drop(bar);
    // Not `>`: an error that is no number is above every bound.
    let ok = arguments
        .max_error
        .is_none_or(|bound| found.relative_frobenius <= bound);
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            comparison: &found,
            equal: found.is_equal(),
            max_error: arguments.max_error,
            ok,
        })?;
    }
    if !arguments.report.is_to_stdout() {
        report::print(&text(&found, arguments.max_error, ok))?;
    }
    Ok(if ok { Exit::Done } else { Exit::NotHeld })
}

fn text(found: &Comparison, bound: Option<f64>, ok: bool) -> String {
    let mut list = Listing::default();
    list.add("matrix", found.matrix.display().to_string());
    list.add("reference", found.reference.display().to_string());
    let only = |rows: u64, of: &str| {
        if rows > 0 {
            format!(", {} only in the {of}", count(rows))
        } else {
            String::new()
        }
    };
    list.add(
        "rows",
        format!(
            "{} compared{}{}",
            count(found.rows_compared),
            only(found.rows_only_in_matrix, "matrix"),
            only(found.rows_only_in_reference, "reference")
        ),
    );
    list.add(
        "entries",
        format!(
            "{}, in the reference {}",
            count(found.entries_in_matrix),
            count(found.entries_in_reference)
        ),
    );
    list.add("relative Frobenius error", relative(found.relative_frobenius));
    list.add(
        "missed mass",
        format!(
            "{}, in the worst row {}",
            relative(found.missed_mass),
            relative(found.missed_mass_worst_row)
        ),
    );
    list.add("spurious mass", relative(found.spurious_mass));
    if let Some(worst) = found.worst_entry {
        list.add(
            "worst entry",
            format!(
                "F[{}, {}] is {}, in the reference {}",
                worst.i,
                worst.j,
                figures(worst.a),
                figures(worst.b)
            ),
        );
    }
    if found.rows_without_reference > 0 {
        list.add(
            "rows without reference",
            format!("{}, empty there and not here", count(found.rows_without_reference)),
        );
    }
    let mut text = list.text();
    text.push('\n');
    let row = |name: &str, over: OverRows, show: fn(f64) -> String| {
        [
            name.to_owned(),
            show(over.median),
            show(over.percentile_90),
            show(over.mean),
            show(over.max),
        ]
    };
    text.push_str(&report::table(
        ["over the rows", "median", "90 %", "mean", "worst"],
        [
            row("relative error", found.row_error, relative),
            row("relative L1", found.row_l1, relative),
            row("row-sum error", found.row_sum_error, figures),
        ],
    ));
    text.push('\n');
    text.push_str(&match bound {
        _ if found.is_equal() => "The matrices are equal.\n".to_owned(),
        None => "The matrices differ.\n".to_owned(),
        Some(bound) if ok => format!("The error is within the bound of {}.\n", relative(bound)),
        Some(bound) => format!("FAILED: the error is above the bound of {}.\n", relative(bound)),
    });
    text
}

/// A relative quantity: as a percentage with digits enough to compare.
fn relative(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if !value.is_finite() {
        "infinite".to_owned()
    } else {
        format!("{} %", figures(100.0 * value))
    }
}
