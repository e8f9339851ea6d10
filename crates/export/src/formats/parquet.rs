//! The matrix as Apache Parquet: a table of triplets for DuckDB, pyarrow, Polars, Spark.
//!
//! Columns `row`, `col` (INT32, from 0) and `value` (FLOAT; DOUBLE of a double store), sorted by row and column;
//! F\[row, col\] is from `row` to `col`. `row` and `col` are packed differences, hardly more than a byte an entry.
//! `value` is plain; the repeating values of a compact store get a dictionary. No further compression: form factors are
//! noise to a compressor. Uncomputed rows and rows without entries have no triplets, so the size of the matrix is
//! metadata: `patch_count`.

use super::{Forecast, MatrixWriter};
use crate::Result;
use crate::matrix::Export;
use crate::write::{Cancellable, on_write};
use hemicube_store::{FactorSlice, FactorVec, Form, Precision};
use parquet::basic::Encoding;
use parquet::data_type::{DataType, DoubleType, FloatType, Int32Type};
use parquet::errors::{ParquetError, Result as ParquetResult};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnPath;
use std::io::{self, Write};
use std::sync::Arc;

/// Entries of a row group, some 12 MB in memory; a reader takes a group at once.
const GROUP: usize = 1 << 20;

/// The schema, with the type of `value`.
fn schema(precision: Precision) -> String {
    let value = match precision {
        Precision::Single => "float",
        Precision::Double => "double",
    };
    format!("message form_factors {{ required int32 row; required int32 col; required {value} value; }}")
}

#[derive(Default)]
struct Triplets {
    rows: Vec<i32>,
    columns: Vec<i32>,
    values: FactorVec,
}

impl Triplets {
    fn write<W: Write + Send>(&mut self, writer: &mut SerializedFileWriter<W>) -> ParquetResult<()> {
        let mut group = writer.next_row_group()?;
        column::<Int32Type, _>(&mut group, &self.rows)?;
        column::<Int32Type, _>(&mut group, &self.columns)?;
        match self.values.as_slice() {
            FactorSlice::Single(values) => column::<FloatType, _>(&mut group, values)?,
            FactorSlice::Double(values) => column::<DoubleType, _>(&mut group, values)?,
        }
        group.close()?;
        self.rows.clear();
        self.columns.clear();
        self.values.clear();
        Ok(())
    }
}

fn column<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
) -> ParquetResult<()> {
    let mut column = group
        .next_column()?
        .ok_or_else(|| ParquetError::General("the schema has fewer columns".to_owned()))?;
    column.typed::<T>().write_batch(values, None, None)?;
    column.close()
}

pub(super) struct Parquet;

impl MatrixWriter for Parquet {
    /// Only writing tells the size of packed differences.
    fn forecast(&self, _: &Export<'_>) -> Result<Option<Forecast>> {
        Ok(None)
    }

    fn write<'a>(&self, export: &Export<'_>, file: Cancellable<'a>) -> Result<Cancellable<'a>> {
        let on_parquet = |error: ParquetError| match error {
            ParquetError::External(inner) => match inner.downcast::<io::Error>() {
                Ok(error) => on_write(export.path, *error),
                Err(other) => on_write(export.path, io::Error::other(other)),
            },
            error => on_write(export.path, io::Error::other(error)),
        };
        let manifest = export.store.manifest();
        let pair = |key: &str, value: String| KeyValue::new(format!("hemicube.{key}"), value);
        let mut properties = WriterProperties::builder()
            .set_created_by(format!("hemicube {}", env!("CARGO_PKG_VERSION")))
            .set_dictionary_enabled(false)
            .set_key_value_metadata(Some(vec![
                pair("patch_count", export.row_count().to_string()),
                pair("scene", manifest.scene.file.clone()),
                pair("scene_blake3", manifest.scene.blake3.clone()),
                pair("convention", "F[row, col] is from row to col".to_owned()),
            ]));
        for name in ["row", "col"] {
            properties = properties.set_column_encoding(ColumnPath::from(name), Encoding::DELTA_BINARY_PACKED);
        }
        if manifest.form == Form::Compact {
            properties = properties.set_column_dictionary_enabled(ColumnPath::from("value"), true);
        }
        let schema = Arc::new(parse_message_type(&schema(export.precision())).map_err(on_parquet)?);
        let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties.build())).map_err(on_parquet)?;
        let mut triplets = Triplets {
            values: FactorVec::new(export.precision()),
            ..Triplets::default()
        };
        for row in export.rows()? {
            let (patch, row) = row?;
            for (&column, value) in row.indices.iter().zip(&row.data) {
                triplets.rows.push(patch.0.cast_signed());
                triplets.columns.push(column.cast_signed());
                triplets.values.push(value);
                if triplets.values.len() == GROUP {
                    triplets.write(&mut writer).map_err(on_parquet)?;
                }
            }
        }
        if !triplets.values.is_empty() {
            triplets.write(&mut writer).map_err(on_parquet)?;
        }
        writer.into_inner().map_err(on_parquet)
    }
}
