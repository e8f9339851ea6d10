//! Numbers of each patch, to colour the model by.

use crate::args::Talk;
use crate::report::count;
use crate::stored;
use anyhow::Result;
use hemicube::sky::{sky_beside, sky_view_factors_beside};
use hemicube::solve::StoredSolution;
use hemicube::store::{RowTable, Store};
use serde::Serialize;

/// A quantity or property to colour the model by, for the viewer.
#[derive(Debug, Serialize)]
pub(super) struct Field {
    pub(super) key: String,
    label: String,
    note: String,
    /// Names of the blocks with a number a patch.
    columns: Vec<String>,
    /// True for a scale. Light is mapped to tones, and objects have arbitrary colours.
    scale: bool,
    /// True if the scale is logarithmic at first.
    logarithmic: bool,
    light: bool,
}

impl Field {
    fn scale(key: &str, label: &str, note: &str, logarithmic: bool) -> Self {
        Self {
            key: key.to_owned(),
            label: label.to_owned(),
            note: note.to_owned(),
            columns: vec![key.to_owned()],
            scale: true,
            logarithmic,
            light: false,
        }
    }
}

/// Numbers of each patch, and how they may be shown.
pub(super) struct Columns {
    pub(super) fields: Vec<Field>,
    /// Name of the block, and a number a patch.
    pub(super) numbers: Vec<(String, Vec<f64>)>,
}

impl Columns {
    fn add(&mut self, field: Field, numbers: Vec<f64>) {
        self.numbers.push((field.key.clone(), numbers));
        self.fields.push(field);
    }

    /// Adds the fields without numbers of their own: the row of a selected patch, and the object.
    pub(super) fn add_choices(&mut self, has_rows: bool, has_objects: bool) {
        if has_rows {
            self.fields.push(Field {
                columns: Vec::new(),
                ..Field::scale("row", "Row of the selected patch", "", true)
            });
        }
        if has_objects {
            self.fields.push(Field {
                columns: Vec::new(),
                scale: false,
                ..Field::scale("object", "Objects", "each object in a colour of its own", false)
            });
        }
    }
}

/// Returns whether there is anything to see in these numbers.
fn tells(numbers: &[f64]) -> bool {
    numbers.iter().any(|&number| number > 0.0)
}

/// Gathers all numbers of each patch in a store and beside it, in the order of the page's menu.
///
/// # Errors
/// When a named solution, or the sky, cannot be read.
pub(super) fn columns(
    store: &Store,
    rows: &RowTable,
    seen: Vec<f64>,
    wanted: &[String],
    talk: Talk,
) -> Result<Columns> {
    let mut columns = Columns {
        fields: Vec::new(),
        numbers: Vec::new(),
    };
    let names = if wanted.is_empty() {
        StoredSolution::names(store)
    } else {
        wanted.to_vec()
    };
    for name in names {
        match stored::solution(store, &name) {
            Ok(solution) => add_solution(&mut columns, &name, &solution)?,
            // An unnamed one may be outdated.
            Err(error) if wanted.is_empty() => talk.warn(&format!("left out: {error}")),
            Err(error) => return Err(error),
        }
    }
    if sky_beside(store).exists() {
        match stored::sky(store) {
            Ok(_) => {
                let factors = sky_view_factors_beside(store)?;
                let note = "sky view factor: of what leaves a patch, what reaches the sky";
                columns.add(Field::scale("sky", "Sky view factor", note, false), factors);
            }
            Err(error) => talk.warn(&format!("left out: {error}")),
        }
    }
    let closure = (0..rows.row_sum.len())
        .map(|patch| {
            let all = rows.row_sum[patch] + rows.escaped[patch] + rows.blocked[patch] + rows.unselected[patch];
            (all - 1.0 - rows.passed_of(patch)).abs()
        })
        .collect();
    let escapes = tells(&rows.escaped);
    if escapes {
        let note = "escaped: of what leaves a patch, what leaves the scene (sky, and ground below the horizon)";
        columns.add(Field::scale("escaped", "Escaped", note, false), rows.escaped.clone());
    }
    columns.add(
        Field::scale(
            "seen",
            "Patches seen",
            "entries of the row: patches that a patch sees",
            false,
        ),
        seen,
    );
    columns.add(
        Field::scale("row_sum", "Sum of the row", "sum of the form factors of the row", false),
        rows.row_sum.clone(),
    );
    if tells(&rows.error) {
        let note = "expected error: √Σ (F − true F)² of the row, as estimated while it was computed";
        columns.add(Field::scale("error", "Expected error", note, true), rows.error.clone());
    }
    let note = "closure error: |sum of F + escaped + blocked − 1|";
    columns.add(Field::scale("closure", "Closure error", note, true), closure);
    if tells(&rows.blocked) {
        let note = "blocked: of what leaves a patch, what ends on the back of a one-sided surface";
        columns.add(Field::scale("blocked", "Blocked", note, false), rows.blocked.clone());
    }
    Ok(columns)
}

fn add_solution(columns: &mut Columns, name: &str, solution: &StoredSolution) -> Result<()> {
    let light = solution.report()["quantity"] == "light";
    for quantity in solution.quantities() {
        let (label, unit) = match quantity {
            "radiosity" => ("Radiosity", ""),
            "flux" => ("Net flux", ", W/m²"),
            "temperature" => ("Temperature", ", K"),
            _ => continue,
        };
        let array = solution.quantity(quantity)?;
        let key = format!("{name}-{quantity}");
        let label = if name == quantity {
            label.to_owned()
        } else {
            format!("{label} ({name})")
        };
        if light && array.rows() == 3 {
            let bands: Vec<String> = ["r", "g", "b"].iter().map(|band| format!("{key}-{band}")).collect();
            for (row, band) in (0..).zip(&bands) {
                columns.numbers.push((band.clone(), array.row(row)?));
            }
            columns.fields.push(Field {
                key,
                label,
                note: "radiosity in red, green and blue; the average over the patches is shown as middle grey"
                    .to_owned(),
                columns: bands,
                scale: false,
                logarithmic: false,
                light: true,
            });
        } else {
            let first = if array.rows() > 1 {
                format!(", the first right-hand side of {}", count(array.rows()))
            } else {
                String::new()
            };
            let note = format!("{}{unit}{first}", label.to_lowercase());
            columns.add(Field::scale(&key, &label, &note, false), array.row(0)?);
        }
    }
    Ok(())
}
