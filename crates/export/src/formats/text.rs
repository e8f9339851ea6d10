//! The matrix as text: Matrix Market and MATLAB's triplets. Values have the fewest digits that read back to the same
//! f32, of a double store f64.

use super::{Forecast, MatrixWriter};
use crate::Result;
use crate::matrix::Export;
use crate::write::Cancellable;
use hemicube_scene::InputPatch;
use hemicube_store::{F32_COMMENT, Precision, Row};
use std::fmt::Write as _;
use std::io::Write as _;

/// `row column value`, 1-based, for every entry of a row.
fn push_lines(text: &mut String, patch: InputPatch, row: &Row) {
    for (&column, factor) in row.indices.iter().zip(&row.data) {
        // Writing to a string cannot fail.
        let factor = row.data.precision().digits(factor);
        let _ = writeln!(text, "{} {} {factor}", u64::from(patch.0) + 1, u64::from(column) + 1);
    }
}

fn market_header(export: &Export<'_>, entries: u64) -> String {
    let (rows, columns) = (export.row_count(), export.column_count());
    let sky = match export.sky {
        Some(_) => format!(
            "% column {} is the ground, those after it the patches of the sky\n",
            rows + 1
        ),
        None => String::new(),
    };
    let width = match export.precision() {
        Precision::Single => format!("{F32_COMMENT}\n"),
        Precision::Double => String::new(),
    };
    format!(
        "%%MatrixMarket matrix coordinate real general\n\
         % form factors (view factors): F[i,j] is from i to j, the fraction of what leaves patch i that reaches \
         patch j\n\
         % rows and columns are patches in the order of the scene's file, from 1; a row that was not \
         computed is empty\n\
         {sky}{width}\
         {rows} {columns} {entries}\n"
    )
}

/// Rows whose text is measured to forecast the size of a file.
const FORECAST_ROWS: usize = 256;

/// Size of the file, from the text of evenly spaced rows; it may be an eighth too high.
fn forecast(export: &Export<'_>) -> Result<Option<Forecast>> {
    let patches = export.computed_patches()?;
    let wanted = FORECAST_ROWS.min(patches.len());
    let (mut bytes, mut entries, mut text) = (0u64, 0u64, String::new());
    for number in 0..wanted {
        let patch = patches[number * patches.len() / wanted];
        if let Some(row) = export.row(patch)? {
            text.clear();
            push_lines(&mut text, patch, &row);
            bytes += text.len() as u64;
            entries += row.data.len() as u64;
        }
    }
    let all = export.entries()?;
    let per_entry = if entries == 0 {
        0.0
    } else {
        bytes as f64 / entries as f64
    };
    // Fewer than 2⁵³ bytes: no disk has more.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive; `as` saturates"
    )]
    let lines = (per_entry * all as f64) as u64;
    let bytes = lines.saturating_add(market_header(export, all).len() as u64);
    let least = bytes - bytes / 8;
    Ok(Some(Forecast { bytes, least }))
}

fn write_lines(export: &Export<'_>, file: &mut Cancellable<'_>) -> Result<()> {
    let mut text = String::new();
    for row in export.rows()? {
        let (patch, row) = row?;
        text.clear();
        push_lines(&mut text, patch, &row);
        file.write_all(text.as_bytes())
            .map_err(|error| export.on_write(error))?;
    }
    Ok(())
}

pub(super) struct MatrixMarket;

impl MatrixWriter for MatrixMarket {
    fn forecast(&self, export: &Export<'_>) -> Result<Option<Forecast>> {
        forecast(export)
    }

    fn write<'a>(&self, export: &Export<'_>, mut file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        let header = market_header(export, export.entries()?);
        file.write_all(header.as_bytes())
            .map_err(|error| export.on_write(error))?;
        write_lines(export, &mut file)?;
        Ok(file)
    }
}

/// No comment at the top: some readers of plain numbers take none.
pub(super) struct Triplets;

impl MatrixWriter for Triplets {
    fn forecast(&self, export: &Export<'_>) -> Result<Option<Forecast>> {
        forecast(export)
    }

    fn write<'a>(&self, export: &Export<'_>, mut file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        write_lines(export, &mut file)?;
        // `spconvert` takes the size from the largest row and column, and adds a zero to nothing.
        let (rows, columns) = (export.row_count(), export.column_count());
        writeln!(file, "{rows} {columns} 0").map_err(|error| export.on_write(error))?;
        Ok(file)
    }
}
