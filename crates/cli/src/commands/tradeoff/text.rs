//! The report of `tradeoff` for people.

use super::report::{Recommendation, Report};
use super::setting::is_same;
use crate::level::percentage;
use crate::report::{counted, duration, figures, percent};
use hemicube::reference::Measured;
use std::path::Path;

/// The request, in the text's words.
#[derive(Clone, Copy)]
pub(super) struct Asked {
    pub(super) tolerance: f64,
    pub(super) sample_rows: u32,
    /// Show settings that a cheaper one is as good as, too.
    pub(super) all: bool,
}

/// An error in per cent; only its upper end if the reference's noise hides it.
fn error_figures(measured: &Measured) -> String {
    let high = measured.interval_of_rows.high;
    if measured.relative_frobenius < 0.5 * high {
        format!("< {}", hundredths(high))
    } else {
        hundredths(measured.relative_frobenius)
    }
}

/// Formats 0.0123 as `1.23`.
fn hundredths(share: f64) -> String {
    let value = 100.0 * share;
    if value > 0.0 && value < 5e-4 {
        "<.001".to_owned()
    } else if value > 0.0 && value < 0.0995 {
        format!("{value:.3}")
    } else {
        figures(value)
    }
}

/// The report for people.
pub(super) fn text(report: &Report, recommended: Option<&Recommendation>, asked: Asked, path: &Path) -> String {
    let mut text = format!(
        "`{}`, {}, {} with {}\n{} (seed {}) against rays, whose own noise is {}\n\n",
        path.display(),
        counted(report.patches, "patch"),
        report.backend.device,
        counted(report.threads as u64, "thread"),
        counted(report.sampled_rows as u64, "random row"),
        report.seed,
        percent(report.reference.noise),
    );
    text.push_str(&trials_text(report, asked.all));
    for skipped in &report.skipped {
        text.push_str(&format!(
            "skipped {}: some {} for these rows\n",
            skipped.name,
            duration(skipped.nominal_seconds)
        ));
    }
    text.push('\n');
    text.push_str(&match recommended {
        Some(best) => recommendation_text(report, best, asked),
        None => nearest_text(report, asked),
    });
    text
}

/// The table of trials, and the meaning of its columns.
fn trials_text(report: &Report, all: bool) -> String {
    let shown = report.trials.iter().filter(|trial| all || trial.is_on_front());
    let left_out = report.trials.len() - shown.clone().count();
    let lines = shown.map(|trial| {
        let m = &trial.measured;
        [
            if trial.is_on_front() { "*" } else { "" }.to_owned(),
            trial.name.clone(),
            figures(trial.milliseconds()),
            trial
                .timing
                .map_or_else(String::new, |t| duration(t.seconds_for_all_rows)),
            error_figures(m),
            format!(
                "{}..{}",
                hundredths(m.interval_of_matrix.low),
                hundredths(m.interval_of_matrix.high)
            ),
            hundredths(m.row_error.median),
            hundredths(m.row_error.percentile_90),
            hundredths(m.row_l1.median),
            hundredths(m.missed_mass),
            hundredths(m.row_sum_error.mean),
            m.worst_entry
                .map_or_else(|| "0".to_owned(), |worst| figures((worst.a - worst.b).abs())),
        ]
    });
    let mut text = right_aligned(
        [
            "",
            "setting",
            "ms/row",
            "all rows",
            "error %",
            "of matrix",
            "median",
            "90th",
            "L1",
            "missed",
            "sums",
            "worst",
        ],
        lines.collect(),
    );
    text.push_str(&format!(
        "\n* no cheaper setting is as good. ms/row: one thread; all rows: forecast for {}.\n\
         error: relative Frobenius of these rows, and where that of the matrix lies (95 %); of rows: median and 90th\n\
         percentile, median L1, mass missed, row sums; all in %. worst: the entry that differs most.\n",
        counted(report.threads as u64, "thread"),
    ));
    if left_out > 0 {
        text.push_str(&format!(
            "{} with a cheaper one as good {} not shown; `-v` shows all\n",
            counted(left_out as u64, "setting"),
            if left_out == 1 { "is" } else { "are" }
        ));
    }
    text
}

/// The recommended setting, the uncertainty left by the sample, and the result of the tolerance itself.
fn recommendation_text(report: &Report, best: &Recommendation, asked: Asked) -> String {
    let tolerance = percentage(asked.tolerance);
    let mut text = String::new();
    text.push_str(&format!(
        "For an error of {tolerance}: {}, {} at {} ms a row, about {} for all {}\n  {}\n",
        best.name,
        percent(best.error),
        figures(best.milliseconds_per_row),
        duration(best.seconds_for_all_rows),
        counted(report.patches, "row"),
        best.command,
    ));
    if best.error_of_matrix > asked.tolerance {
        text.push_str(&format!(
            "From these rows alone, the matrix may be off by up to {} %; `--rows {}` tells more\n",
            hundredths(best.error_of_matrix),
            4 * asked.sample_rows
        ));
    }
    let tolerance_itself = report
        .trials
        .iter()
        .find(|trial| trial.tolerance.is_some_and(|t| is_same(t, asked.tolerance)));
    if let Some(itself) = tolerance_itself.filter(|trial| trial.name != best.name) {
        text.push_str(&format!(
            "`--tolerance {tolerance}` {}: {} at {} ms a row\n",
            if itself.bound() <= asked.tolerance {
                "keeps it too"
            } else {
                "does not keep it"
            },
            percent(itself.bound()),
            figures(itself.milliseconds()),
        ));
    }
    text
}

/// The nearest setting, where none keeps the tolerance.
fn nearest_text(report: &Report, asked: Asked) -> String {
    let tolerance = percentage(asked.tolerance);
    let nearest = report.trials.iter().min_by(|a, b| a.bound().total_cmp(&b.bound()));
    format!(
        "For an error of {tolerance}: none of these{}; ask for more with a smaller `--tolerance`\n",
        nearest.map_or_else(String::new, |trial| format!(
            ": {} comes nearest with {}",
            trial.name,
            percent(trial.bound())
        )),
    )
}

/// A table with columns of numbers, from the third on, aligned to the right.
fn right_aligned<const N: usize>(headings: [&str; N], rows: Vec<[String; N]>) -> String {
    let width = |column: usize| {
        let cells = rows
            .iter()
            .filter_map(|row| row.get(column))
            .map(|cell| cell.chars().count());
        cells.chain([headings[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: [usize; N] = std::array::from_fn(width);
    let line = |cells: [&str; N]| {
        let mut line = String::new();
        for (column, (cell, width)) in cells.into_iter().zip(widths).enumerate() {
            line.push_str(&match column {
                0 | 1 => format!("{cell:width$} "),
                _ => format!(" {cell:>width$}"),
            });
        }
        format!("{}\n", line.trim_end())
    };
    let mut text = line(headings);
    for row in &rows {
        text.push_str(&line(std::array::from_fn(|column| row[column].as_str())));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_end_in_line() {
        let cell = |text: &str| text.to_owned();
        let text = right_aligned(
            ["", "name", "n"],
            vec![[cell("*"), cell("a"), cell("1")], [cell(""), cell("long"), cell("22")]],
        );
        assert_eq!(text, "  name   n\n* a      1\n  long  22\n");
        assert_eq!(
            [0.0123, 0.00012, 0.0, 0.25, 1e-9].map(hundredths),
            ["1.23", "0.012", "0", "25.0", "<.001"]
        );
    }
}
