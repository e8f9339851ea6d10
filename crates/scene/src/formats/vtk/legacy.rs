//! The legacy format: keywords in text, arrays in text or in binary, highest byte first.

use super::{Cells, Grid, Kind, Piece, Texts, Values, is_group};
use crate::cursor::{Cursor, shown};
use crate::{Error, ErrorKind};

pub(super) fn read(bytes: &[u8], grid: &mut Grid) -> Result<(), Error> {
    let mut cursor = Cursor::new(bytes);
    let first = cursor.line().unwrap_or_default();
    let version = first.rsplit(|&byte| byte == b' ').next().unwrap_or_default();
    let lists = !version.first().is_some_and(|&digit| (b'5'..=b'9').contains(&digit));
    // The title.
    cursor.line();
    let binary = match cursor.word().map(<[u8]>::to_ascii_lowercase).as_deref() {
        Some(b"ascii") => false,
        Some(b"binary") => true,
        _ => return Err(cursor.fail("`ASCII` or `BINARY` is due")),
    };
    let mut reader = Reader {
        cursor,
        binary,
        lists,
        piece: Piece::default(),
        types: None,
        grid_cells: None,
        count: 0,
        of_cells: false,
    };
    while reader.keyword(grid)? {}
    let Reader {
        mut piece,
        types,
        grid_cells,
        cursor,
        ..
    } = reader;
    if let Some((points, ends)) = grid_cells {
        let types = types.ok_or_else(|| cursor.fail("the cells have no `CELL_TYPES`; the file is cut short"))?;
        piece.cells.push(Cells {
            kind: Kind::Types(types),
            points,
            ends,
        });
    }
    // The order of VTK's cell numbers, whatever that of the file.
    piece.cells.sort_by_key(|cells| match cells.kind {
        Kind::Lesser("vertex cell") => 0,
        Kind::Lesser(_) => 1,
        Kind::Polygons => 2,
        _ => 3,
    });
    grid.add(piece)
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    binary: bool,
    /// Cells are lists, each with its length before it, as up to version 4.
    lists: bool,
    piece: Piece,
    types: Option<Vec<i64>>,
    /// Points and ends of the cells of an unstructured grid.
    grid_cells: Option<(Vec<i64>, Vec<i64>)>,
    /// Points or cells that the arrays which follow belong to.
    count: usize,
    of_cells: bool,
}

impl Reader<'_> {
    fn word(&mut self) -> Result<String, Error> {
        match self.cursor.word() {
            Some(word) => Ok(String::from_utf8_lossy(word).into_owned()),
            None => Err(self.cursor.cut_short()),
        }
    }

    /// Reads a keyword with what belongs to it; false at the end of the file.
    fn keyword(&mut self, grid: &mut Grid) -> Result<bool, Error> {
        let Some(word) = self.cursor.word() else {
            return Ok(false);
        };
        let keyword = String::from_utf8_lossy(word).to_ascii_lowercase();
        match keyword.as_str() {
            "dataset" => match self.word()?.to_ascii_lowercase().as_str() {
                "polydata" | "unstructured_grid" => {}
                other => {
                    let mut error = self.cursor.fail("");
                    error.kind = ErrorKind::Unsupported(format!(
                        "`{}` has no surface cells; extract its surface (in ParaView: Extract Surface) and open that",
                        shown(other.as_bytes())
                    ));
                    return Err(error);
                }
            },
            "points" => {
                let count = self.cursor.count(8)?;
                let kind = self.word()?;
                self.piece.points = self.values(3, count, &kind)?.reals("coordinates")?;
            }
            "cells" => self.grid_cells = Some(self.list()?),
            "cell_types" => {
                let count = self.cursor.count(8)?;
                self.types = Some(self.values(1, count, "int")?.wholes("types of cells")?);
            }
            "vertices" => self.cells(Kind::Lesser("vertex cell"))?,
            "lines" => self.cells(Kind::Lesser("line cell"))?,
            "polygons" => self.cells(Kind::Polygons)?,
            "triangle_strips" => self.cells(Kind::Strips)?,
            "point_data" | "cell_data" => {
                self.count = self.cursor.count(8)?;
                self.of_cells = keyword == "cell_data";
            }
            "metadata" => self.metadata(),
            "field" => self.field(grid)?,
            _ => self.attribute(&keyword)?,
        }
        Ok(true)
    }

    fn metadata(&mut self) {
        self.cursor.line();
        while self.cursor.line().is_some_and(|line| !line.trim_ascii().is_empty()) {}
    }

    fn cells(&mut self, kind: Kind) -> Result<(), Error> {
        let (points, ends) = self.list()?;
        self.piece.cells.push(Cells { kind, points, ends });
        Ok(())
    }

    /// The points of all cells, and where each ends.
    fn list(&mut self) -> Result<(Vec<i64>, Vec<i64>), Error> {
        let (count, size) = (self.cursor.count(8)?, self.cursor.count(8)?);
        if self.lists {
            let all = self.values(1, size, "int")?.wholes("points of cells")?;
            let (mut points, mut ends) = (Vec::with_capacity(size.saturating_sub(count)), Vec::new());
            let mut at = 0;
            while at < all.len() {
                let length = usize::try_from(all[at]).unwrap_or(usize::MAX);
                let Some(cell) = all.get(at + 1..).and_then(|rest| rest.get(..length)) else {
                    return Err(self
                        .cursor
                        .fail(format!("a cell of {} points is longer than the list", all[at])));
                };
                points.extend_from_slice(cell);
                ends.push(points.len() as i64);
                at += 1 + length;
            }
            if ends.len() != count {
                return Err(self
                    .cursor
                    .fail(format!("{count} cells are announced, and {} are there", ends.len())));
            }
            return Ok((points, ends));
        }
        let mut named = |due: &str, count| {
            let word = self.word()?;
            if !word.eq_ignore_ascii_case(due) {
                return Err(self
                    .cursor
                    .fail(format!("`{}` where `{due}` is due", shown(word.as_bytes()))));
            }
            let kind = self.word()?;
            self.values(1, count, &kind)?.wholes("points of cells")
        };
        let mut ends = named("OFFSETS", count)?;
        let points = named("CONNECTIVITY", size)?;
        // The first is 0.
        if !ends.is_empty() {
            ends.remove(0);
        }
        Ok((points, ends))
    }

    /// An array of point or cell data by its keyword.
    fn attribute(&mut self, keyword: &str) -> Result<(), Error> {
        let unknown = self.cursor.clone();
        let unknown = || unknown.fail(format!("`{}` is no keyword of VTK's format", shown(keyword.as_bytes())));
        let known = [
            "scalars",
            "color_scalars",
            "lookup_table",
            "vectors",
            "normals",
            "tensors",
            "tensors6",
            "texture_coordinates",
            "global_ids",
            "pedigree_ids",
            "edge_flags",
        ];
        if !known.contains(&keyword) {
            return Err(unknown());
        }
        let name = self.word()?;
        let (components, count, kind) = match keyword {
            "scalars" => {
                let line = String::from_utf8_lossy(self.cursor.line().unwrap_or_default()).into_owned();
                let mut words = line.split_whitespace();
                let kind = words.next().unwrap_or_default().to_owned();
                let components = words.next().map_or(Ok(1), str::parse).map_err(|_| unknown())?;
                // The table of colours; the oldest files have none.
                let mut ahead = self.cursor.clone();
                if ahead
                    .word()
                    .is_some_and(|word| word.eq_ignore_ascii_case(b"lookup_table"))
                {
                    ahead.word();
                    self.cursor = ahead;
                    self.cursor.line();
                }
                let values = self.values_here(components, self.count, &kind)?;
                self.keep(name, components, values);
                return Ok(());
            }
            "color_scalars" => (self.cursor.count(8)?, self.count, self.colours()),
            "lookup_table" => (4, self.cursor.count(8)?, self.colours()),
            "texture_coordinates" => (self.cursor.count(8)?, self.count, self.word()?),
            "tensors" => (9, self.count, self.word()?),
            "tensors6" => (6, self.count, self.word()?),
            "vectors" | "normals" => (3, self.count, self.word()?),
            _ => (1, self.count, self.word()?),
        };
        let values = self.values(components, count, &kind)?;
        self.keep(name, components, values);
        Ok(())
    }

    /// The type of colours: bytes in binary, and numbers from 0 to 1 in text.
    fn colours(&self) -> String {
        if self.binary { "unsigned_char" } else { "float" }.to_owned()
    }

    fn keep(&mut self, name: String, components: usize, values: Values) {
        let name = unescaped(&name);
        if self.of_cells && components == 1 && is_group(&name) {
            self.piece.cell_data.push((name, values));
        }
    }

    fn field(&mut self, grid: &mut Grid) -> Result<(), Error> {
        self.word()?;
        let arrays = self.cursor.count(8)?;
        for _ in 0..arrays {
            let mut name = self.word()?;
            while name == "METADATA" {
                self.metadata();
                name = self.word()?;
            }
            let (components, count) = (self.cursor.count(8)?, self.cursor.count(8)?);
            let kind = self.word()?;
            let values = self.values(components, count, &kind)?;
            match values {
                // Before the data of points and cells: data of the whole.
                Values::Names(names) if self.count == 0 => {
                    grid.names.insert(unescaped(&name).to_ascii_lowercase(), names);
                }
                values => self.keep(name, components, values),
            }
        }
        Ok(())
    }

    /// An array from the next line on.
    fn values(&mut self, components: usize, count: usize, kind: &str) -> Result<Values, Error> {
        self.cursor.line();
        self.values_here(components, count, kind)
    }

    fn values_here(&mut self, components: usize, count: usize, kind: &str) -> Result<Values, Error> {
        let kind = kind.to_ascii_lowercase();
        let number = components.saturating_mul(count);
        if kind == "string" {
            return self.strings(number);
        }
        let Some((size, real)) = numeric(&kind) else {
            let kind = shown(kind.as_bytes());
            return Err(self.cursor.fail(format!("`{kind}` is no type of VTK's arrays")));
        };
        let left = self.cursor.rest().len();
        let bytes = match (self.binary, kind.as_str()) {
            (true, "bit") => number.div_ceil(8),
            (true, _) => number.saturating_mul(size),
            // A digit and a space.
            (false, _) => number.saturating_mul(2).saturating_sub(1),
        };
        if bytes > left {
            return Err(self.cursor.fail(format!(
                "{number} numbers are announced, and {left} bytes are left; the file is cut short or damaged"
            )));
        }
        if !self.binary {
            return if real {
                let mut values = Vec::with_capacity(number);
                for _ in 0..number {
                    values.push(self.cursor.real()?);
                }
                Ok(Values::Real(values))
            } else {
                let mut values = Vec::with_capacity(number);
                for _ in 0..number {
                    values.push(self.cursor.whole(8)?);
                }
                Ok(Values::Whole(values))
            };
        }
        let bytes = self.cursor.bytes(bytes)?;
        Ok(match kind.as_str() {
            "bit" => Values::Whole(
                (0..number)
                    .map(|at| i64::from(bytes[at / 8] >> (7 - at % 8) & 1))
                    .collect(),
            ),
            _ => super::xml::numbers(
                bytes,
                size,
                real,
                !kind.starts_with("unsigned") && !kind.contains("uint"),
                true,
            ),
        })
    }

    /// Names: a line each, or in binary each after its length.
    fn strings(&mut self, count: usize) -> Result<Values, Error> {
        let mut names = Texts::default();
        for _ in 0..count {
            let text = if self.binary {
                // The two highest bits say how many bytes the length has.
                let first = self.cursor.bytes(1)?[0];
                let more = match first >> 6 {
                    3 => 0,
                    2 => 1,
                    1 => 3,
                    _ => 7,
                };
                let mut length = usize::from(first & 0x3F);
                for &byte in self.cursor.bytes(more)? {
                    length = length.checked_mul(256).ok_or_else(|| self.cursor.cut_short())? + usize::from(byte);
                }
                String::from_utf8_lossy(self.cursor.bytes(length)?).into_owned()
            } else {
                let line = self.cursor.line().ok_or_else(|| self.cursor.cut_short())?;
                unescaped(&String::from_utf8_lossy(line))
            };
            names.push(&text);
        }
        Ok(Values::Names(names))
    }
}

/// Bytes of a number, and whether it is one of floating point.
fn numeric(kind: &str) -> Option<(usize, bool)> {
    Some(match kind {
        "bit" | "unsigned_char" | "char" | "signed_char" => (1, false),
        "unsigned_short" | "short" => (2, false),
        // Ids have 32 bits in files, whatever VTK was built with.
        "unsigned_int" | "int" | "vtkidtype" => (4, false),
        "unsigned_long" | "long" | "unsigned_long_long" | "long_long" | "vtktypeint64" | "vtktypeuint64" => (8, false),
        "float" => (4, true),
        "double" => (8, true),
        _ => return None,
    })
}

/// Text with `%20` and its like replaced by what they stand for.
fn unescaped(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|two| std::str::from_utf8(two).ok());
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(code) if byte == b'%' => {
                bytes.push(code);
                rest = after.get(2..).unwrap_or_default();
            }
            _ => {
                bytes.push(byte);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
