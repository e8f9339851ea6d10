//! Tables of the worst rows.

use crate::report::{figures, percent};
use hemicube::analysis::check::CheckReport;
use hemicube::store::RowTable;

/// Rows of each table.
pub(super) const WORST_ROWS: usize = 10;

/// A table of the worst rows.
pub(super) struct Worst {
    pub(super) heading: &'static str,
    pub(super) columns: Vec<&'static str>,
    /// The patch, and the other cells of its line.
    pub(super) rows: Vec<(u32, Vec<String>)>,
}

/// Tables of the rows with the largest closure errors and expected errors.
pub(super) fn worst(checked: &CheckReport, rows: &RowTable) -> Vec<Worst> {
    let mut tables = Vec::new();
    if checked.closure.max > 0.0 {
        tables.push(Worst {
            heading: "By closure error",
            columns: vec!["patch", "closure error", "sum of F", "escaped", "blocked"],
            rows: checked
                .worst_rows
                .iter()
                .map(|row| {
                    let facts = vec![
                        figures(row.closure_error),
                        format!("{:.6}", row.row_sum),
                        percent(row.escaped),
                        percent(row.blocked),
                    ];
                    (row.patch, facts)
                })
                .collect(),
        });
    }
    let mut order: Vec<u32> = (0u32..)
        .zip(&rows.error)
        .filter(|(_, error)| **error > 0.0)
        .map(|(patch, _)| patch)
        .collect();
    if !order.is_empty() {
        let error = |patch: u32| rows.error[patch as usize];
        order.sort_by(|&a, &b| error(b).total_cmp(&error(a)).then(a.cmp(&b)));
        order.truncate(WORST_ROWS);
        tables.push(Worst {
            heading: "By expected error",
            columns: vec!["patch", "expected √Σ (F − true F)²", "sum of F"],
            rows: order
                .into_iter()
                .map(|patch| {
                    let facts = vec![figures(error(patch)), format!("{:.6}", rows.row_sum[patch as usize])];
                    (patch, facts)
                })
                .collect(),
        });
    }
    tables
}
