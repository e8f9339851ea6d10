//! The map of a comparison: the difference of each row as columns of the matrix's patches.
//!
//! ```text
//! difference           ‖aᵢ − bᵢ‖₂
//! relative_difference  ‖aᵢ − bᵢ‖₂ / ‖bᵢ‖₂
//! sum_difference       Σⱼ aᵢⱼ − Σⱼ bᵢⱼ
//! escaped_difference   what escapes of row i in the matrix, less what does in the reference
//! ```
//!
//! All are over patches that both matrices have, and unknown where the reference lacks the patch.

use crate::exit::hinted;
use anyhow::{Result, anyhow};
use hemicube::analysis::compare::RowDifference;
use hemicube::store::{Matrix, Store};
use hemicube_export::{Colors, PatchFormat, PatchResults};
use hemicube_scene::Axis;

/// What colours show: not the relative difference, which is largest where there was next to nothing.
const SHOWN: &str = "difference";

/// The columns of a comparison's rows.
///
/// # Errors
/// When the matrix is no store, or does not have what the format needs.
pub(super) fn of(
    rows: &[RowDifference],
    [matrix, reference]: [&Matrix; 2],
    format: PatchFormat,
) -> Result<PatchResults> {
    let Some(store) = matrix.store().filter(|store| store.manifest().patches.is_some()) else {
        return Err(hinted(
            anyhow!("`{}` does not say what its patches are", matrix.path().display()),
            "compare a whole store, or draw the errors as .svg or .png".to_owned(),
        ));
    };
    let table = store.patches()?;
    let (manifest, corners) = (store.manifest(), table.corners.clone());
    let names = [&manifest.objects[..], &manifest.materials[..]];
    let mut results = PatchResults::of_table(table, names, &manifest.scene.file);
    let by_patch = |value: &dyn Fn(&RowDifference) -> f64| {
        let mut values = vec![f64::NAN; results.patch_count()];
        for row in rows {
            values[row.row as usize] = value(row);
        }
        values
    };
    let finite = |value: f64| if value.is_finite() { value } else { f64::NAN };
    let mut columns = vec![
        (SHOWN, by_patch(&|row| row.distance)),
        ("relative_difference", by_patch(&|row| finite(row.relative()))),
        ("sum_difference", by_patch(&|row| row.sum)),
    ];
    if let [Some(own), Some(other)] = [escaped(Some(store))?, escaped(reference.store())?] {
        let change = |row: &RowDifference| own[row.row as usize] - other[row.reference_row as usize];
        columns.push(("escaped_difference", by_patch(&change)));
    }
    if format.has_colors() {
        let shown = columns.iter().find(|(name, _)| *name == SHOWN);
        results.colors = shown.map(|(name, values)| Colors::on_scale(name, values, None));
    }
    for (name, values) in columns {
        results.push(name, values)?;
    }
    if format.needs_corners() {
        if corners.is_empty() {
            return Err(hinted(
                anyhow!(
                    "`{}` does not have the corners of its patches",
                    store.directory().display()
                ),
                "write a .csv, or compare matrices of triangles".to_owned(),
            ));
        }
        results.corners = Some(corners);
    }
    if format.is_upright() {
        results.up = up(store)?;
    }
    Ok(results)
}

/// What escapes by patch, of a store that has it.
fn escaped(store: Option<&Store>) -> Result<Option<Vec<f64>>> {
    let whole = store.filter(|store| store.manifest().patches.is_some());
    Ok(whole.map(Store::row_table).transpose()?.map(|table| table.escaped))
}

/// The axis that points up in a store's scene.
fn up(store: &Store) -> Result<Axis> {
    match store.manifest().settings["up"].as_str() {
        Some("x") => Ok(Axis::X),
        Some("y") => Ok(Axis::Y),
        Some("z") => Ok(Axis::Z),
        _ => Err(hinted(
            anyhow!(
                "`{}` does not know which axis points up, as a .glb has to",
                store.directory().display()
            ),
            "write a .ply or .vtp, or compute the matrix with `--up`".to_owned(),
        )),
    }
}
