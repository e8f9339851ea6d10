//! The matrix as Apache Parquet: a table of triplets for DuckDB, pyarrow, Polars, Spark.
//!
//! Columns `row`, `col` (INT32, from 0) and `value` (FLOAT), sorted by row and column; F\[row, col\] is from `row` to
//! `col`. `row` and `col` are packed differences, hardly more than a byte an entry, `value` is plain; of a store in the
//! compact form, whose values repeat, it has a dictionary. Not compressed beyond that: factors are noise to a
//! compressor. Rows that were not computed and rows without entries have no triplets, so that the size of the matrix is
//! metadata: `patch_count`.

use crate::write::{on_write, write_file};
use crate::{Error, Result, WriteOptions};
use hemicube::store::{Form, Store};
use parquet::basic::Encoding;
use parquet::data_type::{DataType, FloatType, Int32Type};
use parquet::errors::{ParquetError, Result as ParquetResult};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnPath;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Entries of a row group: what is in memory of a file, some 12 MB, and what a reader takes at once.
const GROUP: usize = 1 << 20;

const SCHEMA: &str = "message form_factors { required int32 row; required int32 col; required float value; }";

#[derive(Default)]
struct Triplets {
    rows: Vec<i32>,
    columns: Vec<i32>,
    values: Vec<f32>,
}

impl Triplets {
    fn write<W: Write + Send>(&mut self, writer: &mut SerializedFileWriter<W>) -> ParquetResult<()> {
        let mut group = writer.next_row_group()?;
        column::<Int32Type, _>(&mut group, &self.rows)?;
        column::<Int32Type, _>(&mut group, &self.columns)?;
        column::<FloatType, _>(&mut group, &self.values)?;
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

/// Writes the matrix of `store` to `path` as triplets; returns the file's size.
///
/// # Errors
/// When the store is incomplete and `allow_incomplete` is not set, or cannot be read; when the file exists and is not
/// to be replaced, cannot be written, or was cancelled.
///
/// ```
/// use hemicube_export::{WriteOptions, write_parquet};
/// use std::sync::atomic::AtomicBool;
/// # use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../hemicube/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), Correction::Pixel)?;
/// # let path = folder.path().join("room.parquet");
///
/// let options = WriteOptions { overwrite: false, cancel: &AtomicBool::new(false) };
/// let bytes = write_parquet(&store, &path, false, options)?;
/// assert_eq!(std::fs::read(&path)?.len() as u64, bytes);
/// assert!(std::fs::read(&path)?.starts_with(b"PAR1"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_parquet(store: &Store, path: &Path, allow_incomplete: bool, options: WriteOptions<'_>) -> Result<u64> {
    if !allow_incomplete {
        store.require_complete()?;
    }
    let on_parquet = |error: ParquetError| match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(error) => on_write(path, *error),
            Err(other) => on_write(path, io::Error::other(other)),
        },
        error => on_write(path, io::Error::other(error)),
    };
    let manifest = store.manifest();
    let pair = |key: &str, value: String| KeyValue::new(format!("hemicube.{key}"), value);
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("hemicube {}", env!("CARGO_PKG_VERSION")))
        .set_dictionary_enabled(false)
        .set_key_value_metadata(Some(vec![
            pair("patch_count", store.patch_count().to_string()),
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
    let schema = Arc::new(parse_message_type(SCHEMA).map_err(on_parquet)?);
    let properties = Arc::new(properties.build());
    write_file(path, options, |file| {
        let mut writer = SerializedFileWriter::new(file, schema, properties).map_err(on_parquet)?;
        let mut triplets = Triplets::default();
        for row in store.rows()? {
            let (patch, row) = row?;
            if options.cancel.load(Ordering::Relaxed) {
                return Err(Error::Interrupted { path: path.to_owned() });
            }
            for (&column, &value) in row.indices.iter().zip(&row.data) {
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
    })
}
