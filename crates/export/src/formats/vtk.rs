//! VTK's XML formats (*VTK File Formats*, Kitware): PolyData and UnstructuredGrid, arrays as raw little-endian bytes at
//! the end of the file.
//!
//! Points are shared where corners are equal bit for bit, as those of neighbouring patches are. PolyData has the names
//! of objects and materials as field data: the string arrays `object_names` and `material_names`. An UnstructuredGrid
//! has none, because meshio, its main reader, refuses a file with strings.
//!
//! No XML crate for writing, because the header is some twenty lines around raw bytes, with one escaped value.

use super::PatchWriter;
use crate::write::{on_write, write_file};
use crate::{PatchResults, Result, Values, WriteOptions};
use std::collections::HashMap;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// VTK's number for a triangle among cells.
const VTK_TRIANGLE: u8 = 5;

/// Numbers of an array, in VTK's types.
enum Numbers<'a> {
    Whole(&'a [u32]),
    Real(&'a [f64]),
    /// Signed, by VTK's rule for ids.
    Ids(Vec<i64>),
    Bytes(Vec<u8>),
}

impl Numbers<'_> {
    fn kind(&self) -> &'static str {
        match self {
            Self::Whole(_) => "UInt32",
            Self::Real(_) => "Float64",
            Self::Ids(_) => "Int64",
            Self::Bytes(_) => "UInt8",
        }
    }

    fn size(&self) -> u64 {
        let bytes = match self {
            Self::Whole(values) => 4 * values.len(),
            Self::Real(values) => 8 * values.len(),
            Self::Ids(values) => 8 * values.len(),
            Self::Bytes(values) => values.len(),
        };
        bytes as u64
    }

    fn write(&self, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Whole(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
            Self::Real(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
            Self::Ids(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
            Self::Bytes(values) => out.write_all(values),
        }
    }
}

struct Array<'a> {
    name: &'a str,
    components: &'a [String],
    numbers: Numbers<'a>,
}

/// Text between quotes in XML.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() => escaped.push(' '),
            c => escaped.push(c),
        }
    }
    escaped
}

/// Points without repetition, in order of their first use, and the points of each triangle.
fn weld(corners: &[[[f64; 3]; 3]]) -> (Vec<[f64; 3]>, Vec<i64>) {
    let (mut points, mut used, mut place) = (Vec::new(), Vec::with_capacity(3 * corners.len()), HashMap::new());
    for corner in corners.as_flattened() {
        // −0 and 0 are one place.
        let key = corner.map(|coordinate| (coordinate + 0.0).to_bits());
        let point = *place.entry(key).or_insert_with(|| {
            points.push(*corner);
            points.len() as i64 - 1
        });
        used.push(point);
    }
    (points, used)
}

pub(super) struct PolyData;

impl PatchWriter for PolyData {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        write_vtk(results, path, options, true)
    }
}

pub(super) struct UnstructuredGrid;

impl PatchWriter for UnstructuredGrid {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        write_vtk(results, path, options, false)
    }
}

fn write_vtk(results: &PatchResults, path: &Path, options: WriteOptions<'_>, polygons: bool) -> Result<u64> {
    let corners = results.corners_for(path)?;
    write_file(path, options, |mut file| {
        write(results, corners, polygons, &mut file).map_err(|error| on_write(path, error))?;
        Ok(file)
    })
}

/// Writes the names of each column of names.
fn write_names(results: &PatchResults, out: &mut impl Write) -> io::Result<()> {
    for column in &results.columns {
        if let Values::Named(_, names) = &column.values {
            // Strings are written as the codes of their bytes, each ended by a zero.
            writeln!(
                out,
                "<Array type=\"String\" Name=\"{}_names\" NumberOfTuples=\"{}\" format=\"ascii\">",
                escaped(&column.name),
                names.len()
            )?;
            for name in names {
                for byte in name.bytes() {
                    write!(out, "{byte} ")?;
                }
                writeln!(out, "0")?;
            }
            writeln!(out, "</Array>")?;
        }
    }
    Ok(())
}

fn write(results: &PatchResults, corners: &[[[f64; 3]; 3]], polygons: bool, out: &mut impl Write) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, out);
    let (points, used) = weld(corners);
    let count = corners.len();
    let triples = ["x", "y", "z"].map(str::to_owned);
    let points_array = Array {
        name: "Points",
        components: &triples,
        numbers: Numbers::Real(points.as_flattened()),
    };
    let plain = |name, numbers| Array {
        name,
        components: &[],
        numbers,
    };
    let mut cells = vec![
        plain("connectivity", Numbers::Ids(used)),
        plain(
            "offsets",
            Numbers::Ids((1..).take(count).map(|end: i64| 3 * end).collect()),
        ),
    ];
    if !polygons {
        cells.push(plain("types", Numbers::Bytes(vec![VTK_TRIANGLE; count])));
    }
    let data: Vec<Array<'_>> = results
        .columns
        .iter()
        .map(|column| Array {
            name: &column.name,
            components: &column.components,
            numbers: match &column.values {
                Values::Whole(values) | Values::Named(values, _) => Numbers::Whole(values),
                Values::Real(values) => Numbers::Real(values),
            },
        })
        .collect();

    let kind = if polygons { "PolyData" } else { "UnstructuredGrid" };
    writeln!(
        out,
        "<?xml version=\"1.0\"?>\n<!-- hemicube {}: patches of {} -->\n\
         <VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <{kind}>\n<FieldData>",
        env!("CARGO_PKG_VERSION"),
        // Two hyphens end a comment.
        escaped(&results.scene).replace('-', "\u{2010}"),
    )?;
    if polygons {
        write_names(results, &mut out)?;
    }
    writeln!(out, "</FieldData>")?;
    let of_cells = if polygons { "Polys" } else { "Cells" };
    writeln!(
        out,
        "<Piece NumberOfPoints=\"{}\" NumberOf{of_cells}=\"{count}\">",
        points.len()
    )?;
    let mut offset = 0;
    let mut list = |out: &mut BufWriter<_>, tag: &str, arrays: &[Array<'_>]| -> io::Result<()> {
        writeln!(out, "<{tag}>")?;
        for array in arrays {
            write!(
                out,
                "<DataArray type=\"{}\" Name=\"{}\"",
                array.numbers.kind(),
                escaped(array.name)
            )?;
            // A missing number means one; with a number, meshio makes a matrix of one column.
            if !array.components.is_empty() {
                write!(out, " NumberOfComponents=\"{}\"", array.components.len())?;
            }
            for (number, component) in array.components.iter().enumerate() {
                write!(out, " ComponentName{number}=\"{}\"", escaped(component))?;
            }
            writeln!(out, " format=\"appended\" offset=\"{offset}\"/>")?;
            offset += 8 + array.numbers.size();
        }
        writeln!(out, "</{}>", tag.split(' ').next().unwrap_or(tag))
    };
    list(&mut out, "Points", std::slice::from_ref(&points_array))?;
    list(&mut out, of_cells, &cells)?;
    list(&mut out, "CellData Scalars=\"escaped\" Normals=\"normal\"", &data)?;
    writeln!(out, "</Piece>\n</{kind}>\n<AppendedData encoding=\"raw\">")?;
    out.write_all(b"_")?;
    for array in std::iter::once(&points_array).chain(&cells).chain(&data) {
        out.write_all(&array.numbers.size().to_le_bytes())?;
        array.numbers.write(&mut out)?;
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")?;
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_shared() {
        let (points, used) = weld(&[
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[1.0, -0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        ]);
        assert_eq!(points.len(), 4);
        assert_eq!(used, [0, 1, 2, 1, 3, 2]);
    }

    #[test]
    fn names_in_xml() {
        assert_eq!(escaped("a<b> & \"c\"\n"), "a&lt;b&gt; &amp; &quot;c&quot; ");
    }
}
