//! Binary PLY (Turk 1994, *The PLY Polygon File Format*): little-endian, coordinates as doubles.
//!
//! Every patch has three vertices of its own, so that the vertices carry its colour, too: most viewers look for it
//! there. Corners shared by patches are equal bit for bit, and tools merge them.

use super::PatchWriter;
use crate::ascii::{line, words};
use crate::write::{on_write, too_large, write_file};
use crate::{Colors, PatchResults, Result, Values, WriteOptions};
use std::io::{self, BufWriter, Write};
use std::path::Path;

pub(super) struct Ply;

impl PatchWriter for Ply {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        let (corners, colors) = (results.corners_for(path)?, results.colors_for(path)?);
        if i32::try_from(3 * corners.len()).is_err() {
            return Err(too_large(
                path,
                "PLY counts vertices in 32 bits, and these are more; `.vtp` has room",
            ));
        }
        write_file(path, options, |mut file| {
            write(results, corners, colors, &mut file).map_err(|error| on_write(path, error))?;
            Ok(file)
        })
    }
}

fn write(results: &PatchResults, corners: &[[[f64; 3]; 3]], colors: &Colors, out: &mut impl Write) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, out);
    let labels: Vec<(String, &str)> = results
        .columns
        .iter()
        .flat_map(|column| {
            let kind = match column.values {
                Values::Whole(_) | Values::Named(..) => "uint",
                Values::Real(_) => "double",
            };
            column.labels().into_iter().map(move |label| (label, kind))
        })
        .collect();
    let count = corners.len();
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(
        out,
        "comment hemicube {}: patches of {}",
        env!("CARGO_PKG_VERSION"),
        line(&results.scene)
    )?;
    let legend = &colors.legend;
    write!(
        out,
        "comment colors {}, {}",
        line(&legend.quantity),
        line(&legend.color_map)
    )?;
    match legend.range {
        Some([low, high]) => writeln!(out, " from {low} to {high}")?,
        None => writeln!(out)?,
    }
    for column in &results.columns {
        if let Values::Named(_, names) = &column.values {
            for (index, name) in names.iter().enumerate() {
                writeln!(out, "comment {} {index} {}", column.name, line(name))?;
            }
        }
    }
    writeln!(out, "element vertex {}", 3 * count)?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    let channels = "property uchar red\nproperty uchar green\nproperty uchar blue";
    writeln!(
        out,
        "{channels}\nelement face {count}\nproperty list uchar int vertex_indices\n{channels}"
    )?;
    let names = words(labels.iter().map(|(label, _)| label.as_str()));
    for (name, (_, kind)) in names.iter().zip(&labels) {
        writeln!(out, "property {kind} {name}")?;
    }
    writeln!(out, "end_header")?;
    for (corners, color) in corners.iter().zip(&colors.srgb) {
        for corner in corners {
            for coordinate in corner {
                out.write_all(&coordinate.to_le_bytes())?;
            }
            out.write_all(color)?;
        }
    }
    for (patch, color) in colors.srgb.iter().enumerate() {
        out.write_all(&[3])?;
        for vertex in 3 * patch..3 * patch + 3 {
            // Counted by the caller.
            let vertex = i32::try_from(vertex).map_err(io::Error::other)?;
            out.write_all(&vertex.to_le_bytes())?;
        }
        out.write_all(color)?;
        for column in &results.columns {
            match &column.values {
                Values::Whole(values) | Values::Named(values, _) => out.write_all(&values[patch].to_le_bytes())?,
                Values::Real(values) => {
                    for value in &values[patch * column.width()..][..column.width()] {
                        out.write_all(&value.to_le_bytes())?;
                    }
                }
            }
        }
    }
    out.flush()
}
