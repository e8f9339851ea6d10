//! Results of each patch as a table: CSV for people and spreadsheets, `.npz` for programs.

use super::PatchWriter;
use crate::write::{on_write, write_file};
use crate::{PatchResults, Result, Values, WriteOptions};
use hemicube_solve::analysis::zones::table_text;
use hemicube_store::{ElementType, NpzWriter};
use std::io::{self, Seek, Write};
use std::path::Path;

pub(super) struct Csv;

impl PatchWriter for Csv {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        write_file(path, options, |mut file| {
            write_csv(results, &mut file).map_err(|error| on_write(path, error))?;
            Ok(file)
        })
    }
}

pub(super) struct Npz;

impl PatchWriter for Npz {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        write_file(path, options, |file| {
            write_npz(results, file).map_err(|error| on_write(path, error))
        })
    }
}

/// Numbers have the fewest digits that read back to the same f64; an unknown number is an empty field.
fn write_csv(results: &PatchResults, out: &mut impl Write) -> io::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    let corner_labels = ["a", "b", "c"].map(|corner| ["x", "y", "z"].map(|axis| format!("{corner}_{axis}")));
    let mut header: Vec<String> = results.columns.iter().flat_map(crate::Column::labels).collect();
    if results.corners.is_some() {
        header.extend(corner_labels.into_iter().flatten());
    }
    writer.write_record(header.iter().map(|label| table_text(label).into_owned()))?;
    for patch in 0..results.patch_count() {
        for column in &results.columns {
            match &column.values {
                Values::Whole(values) => writer.write_field(values[patch].to_string())?,
                Values::Named(values, names) => {
                    let name = names.get(values[patch] as usize).map_or("", String::as_str);
                    writer.write_field(table_text(name).as_bytes())?;
                }
                Values::Real(values) => {
                    for value in &values[patch * column.width()..][..column.width()] {
                        let text = if value.is_nan() {
                            String::new()
                        } else {
                            // Not −0.
                            (value + 0.0).to_string()
                        };
                        writer.write_field(text)?;
                    }
                }
            }
        }
        if let Some(corners) = &results.corners {
            for coordinate in corners[patch].as_flattened() {
                writer.write_field(coordinate.to_string())?;
            }
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.flush()
}

/// An array a column, a row a patch; names and components beside them as arrays of text; corners where known.
fn write_npz<W: Write + Seek>(results: &PatchResults, out: W) -> io::Result<W> {
    let count = results.patch_count() as u64;
    let mut npz = NpzWriter::new(out);
    for column in &results.columns {
        let name = &column.name;
        let mut shape = vec![count];
        if !column.components.is_empty() {
            shape.push(column.components.len() as u64);
        }
        match &column.values {
            Values::Whole(values) => npz.array(name, &shape, values)?,
            Values::Named(values, names) => {
                npz.array(name, &shape, values)?;
                texts(&mut npz, &format!("{name}_names"), names)?;
            }
            Values::Real(values) => npz.array(name, &shape, values)?,
        }
        if !column.components.is_empty() {
            texts(&mut npz, &format!("{name}_components"), &column.components)?;
        }
    }
    if let Some(corners) = &results.corners {
        npz.array("corners", &[count, 3, 3], corners.as_flattened().as_flattened())?;
    }
    npz.finish()
}

/// Text as NumPy has it: UTF-32, every string padded to the longest.
fn texts<W: Write + Seek>(npz: &mut NpzWriter<W>, name: &str, texts: &[String]) -> io::Result<()> {
    let longest = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
    let length = u32::try_from(longest).map_err(|_| io::Error::other("a name is too long"))?;
    npz.begin(name, ElementType::Text(length), &[texts.len() as u64])?;
    for text in texts {
        let mut bytes: Vec<u8> = text.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
        bytes.resize(4 * longest, 0);
        npz.write_all(&bytes)?;
    }
    Ok(())
}
