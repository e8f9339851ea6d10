//! ESRI ASCII grids: a header of names and numbers, then a number a cell.

use super::{Raster, cells_of};
use crate::{Error, ReadOptions};

/// What has no value where the file does not say.
const NO_DATA: f64 = -9999.0;
/// Names of a header, in lower case.
const NAMES: [&str; 10] = [
    "ncols",
    "nrows",
    "xllcorner",
    "xllcenter",
    "yllcorner",
    "yllcenter",
    "cellsize",
    "dx",
    "dy",
    "nodata_value",
];
/// Characters of a word shown in an error.
const SHOWN: usize = 40;

fn number(word: &str, line: u64) -> Result<f64, Error> {
    word.parse().map_err(|_| {
        let shown: String = word.chars().take(SHOWN).collect();
        Error::malformed(format!("`{}` is no number", shown.escape_debug())).at(line)
    })
}

/// Reads an ASCII grid.
pub(super) fn read(bytes: &[u8], options: ReadOptions) -> Result<Raster, Error> {
    let bytes = crate::text::unmarked(bytes)?;
    let text = std::str::from_utf8(bytes)
        .map_err(|_| Error::malformed("is neither a TIFF nor a text: a height model is a GeoTIFF or an ASCII grid"))?;
    let mut header = [None; NAMES.len()];
    let mut lines = (1..).zip(text.lines()).peekable();
    while let Some((line, words)) = lines.next_if(|(_, words)| {
        let first = words.split_whitespace().next().map(str::to_ascii_lowercase);
        first.is_none_or(|first| NAMES.contains(&&*first))
    }) {
        let mut words = words.split_whitespace();
        let Some(name) = words.next() else { continue };
        let at = NAMES.iter().position(|known| name.eq_ignore_ascii_case(known));
        let (Some(at), Some(value), None) = (at, words.next(), words.next()) else {
            return Err(Error::malformed(format!("`{name}` needs one number beside it")).at(line));
        };
        header[at] = Some(number(value, line)?);
    }
    let of = |name: &str| header[NAMES.iter().position(|&known| known == name).unwrap_or(0)];
    let needed = |name: &str| {
        of(name).ok_or_else(|| Error::malformed(format!("is no ASCII grid of heights: its header has no `{name}`")))
    };
    let count = |name: &str| {
        let value = needed(name)?;
        // What is beyond is refused by its number of cells.
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole and in range"
        )]
        match value {
            _ if (1.0..=1e9).contains(&value) && value.fract() == 0.0 => Ok(value as u64),
            _ => Err(Error::malformed(format!(
                "`{name}` is {value}; a whole number from 1 on is needed"
            ))),
        }
    };
    let (columns, rows) = (count("ncols")?, count("nrows")?);
    let cell = match (of("cellsize"), of("dx"), of("dy")) {
        (Some(edge), _, _) => [edge; 2],
        (None, Some(dx), Some(dy)) => [dx, dy],
        _ => [needed("cellsize")?; 2],
    };
    let low = |corner: &str, center: &str, edge: f64| match of(center) {
        Some(center) => Ok(center - 0.5 * edge),
        None => needed(corner),
    };
    let west = low("xllcorner", "xllcenter", cell[0])?;
    let south = low("yllcorner", "yllcenter", cell[1])?;
    // A number takes two characters: a header alone takes no room.
    let least = columns.saturating_mul(rows).saturating_mul(2) - 1;
    if least > text.len() as u64 {
        return Err(Error::malformed(format!(
            "is cut short: {columns} × {rows} heights take {least} characters or more, and the file has {}",
            text.len()
        )));
    }
    let [columns, rows] = cells_of(columns, rows, options)?;
    let cells = columns * rows;
    let none = of("nodata_value").unwrap_or(NO_DATA);
    let mut heights = Vec::with_capacity(cells);
    for (line, words) in lines {
        for word in words.split_whitespace() {
            let height = number(word, line)?;
            if heights.len() == cells {
                return Err(Error::malformed(format!("has more than {columns} × {rows} heights")).at(line));
            }
            heights.push(if height == none { f64::NAN } else { height });
        }
    }
    if heights.len() < cells {
        let found = heights.len();
        return Err(Error::malformed(format!(
            "is cut short: it has {found} heights of {columns} × {rows}"
        )));
    }
    Ok(Raster {
        columns,
        rows,
        west,
        north: south + cell[1] * rows as f64,
        cell,
        heights,
        ground: None,
        canopy: None,
        crs: None,
    })
}
