//! Exports as text: Matrix Market and MATLAB's triplets. Values have the fewest digits that give the same f32 when
//! read.

use super::Source;
use crate::store::{DurableFile, Error, F32_COMMENT, Result, Row};
use hemicube_scene::InputPatch;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// `row column value`, 1-based, for every entry of a row.
fn push_lines(text: &mut String, patch: InputPatch, row: &Row) {
    for (&column, factor) in row.indices.iter().zip(&row.data) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{} {} {factor:e}", u64::from(patch.0) + 1, u64::from(column) + 1);
    }
}

fn market_header(source: &Source<'_>, entries: u64) -> String {
    let (rows, columns) = (source.row_count(), source.column_count());
    let sky = match source.sky {
        Some(_) => format!(
            "% column {} is the ground, those after it the patches of the sky\n",
            rows + 1
        ),
        None => String::new(),
    };
    format!(
        "%%MatrixMarket matrix coordinate real general\n\
         % form factors (view factors): F[i,j] is from i to j, the fraction of what leaves patch i that reaches \
         patch j\n\
         % rows and columns are patches in the order of the scene's file, from 1; a row that was not computed is \
         empty\n\
         {sky}{F32_COMMENT}\n\
         {rows} {columns} {entries}\n"
    )
}

/// Forecast of the file's size, from the text of evenly spaced rows.
pub(super) fn forecast(source: &Source<'_>, rows: usize) -> Result<u64> {
    let patches = source.store.computed_patches()?;
    let wanted = rows.min(patches.len());
    let (mut bytes, mut entries, mut text) = (0u64, 0u64, String::new());
    for number in 0..wanted {
        let patch = patches[number * patches.len() / wanted];
        if let Some(row) = source.row(patch)? {
            text.clear();
            push_lines(&mut text, patch, &row);
            bytes += text.len() as u64;
            entries += row.data.len() as u64;
        }
    }
    let all = source.entries()?;
    let per_entry = if entries == 0 {
        0.0
    } else {
        bytes as f64 / entries as f64
    };
    // Fewer than 2⁵³ bytes, or no disk would do.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive; `as` saturates"
    )]
    let lines = (per_entry * all as f64) as u64;
    Ok(lines.saturating_add(market_header(source, all).len() as u64))
}

fn write_lines(source: &Source<'_>, path: &Path, file: &mut DurableFile, forecast: u64) -> Result<()> {
    let mut text = String::new();
    for row in source.rows()? {
        let (patch, row) = row?;
        text.clear();
        push_lines(&mut text, patch, &row);
        file.write_all(text.as_bytes())
            .map_err(|error| Error::write(path, forecast, error))?;
    }
    Ok(())
}

pub(super) fn write_market(
    source: &Source<'_>,
    path: &Path,
    mut file: DurableFile,
    forecast: u64,
) -> Result<DurableFile> {
    file.write_all(market_header(source, source.entries()?).as_bytes())
        .map_err(|error| Error::write(path, forecast, error))?;
    write_lines(source, path, &mut file, forecast)?;
    Ok(file)
}

/// No comment at the top: some readers of plain numbers take none.
pub(super) fn write_triplets(
    source: &Source<'_>,
    path: &Path,
    mut file: DurableFile,
    forecast: u64,
) -> Result<DurableFile> {
    write_lines(source, path, &mut file, forecast)?;
    // `spconvert` takes the size from the largest row and column, and adds a zero to nothing.
    let (rows, columns) = (source.row_count(), source.column_count());
    writeln!(file, "{rows} {columns} 0").map_err(|error| Error::write(path, forecast, error))?;
    Ok(file)
}
