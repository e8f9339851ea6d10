//! Tables of names and numbers as Apache Parquet, for results over time.

use crate::{Error, Result};

/// A column of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum TableColumn {
    /// Names.
    Names(Vec<String>),
    /// Numbers, where there are any.
    Numbers(Vec<Option<f64>>),
}

/// Returns columns of one length, with their names, as a file of Apache Parquet: names as STRING, numbers as DOUBLE,
/// and null where there is none.
///
/// ```
/// # #[cfg(feature = "parquet")] {
/// use hemicube_export::{TableColumn, parquet_table};
///
/// let moment = TableColumn::Names(vec!["09:00".to_owned(), "10:00".to_owned()]);
/// let kelvin = TableColumn::Numbers(vec![Some(293.15), None]);
/// let bytes = parquet_table(&[("moment".to_owned(), moment), ("mean_K".to_owned(), kelvin)])?;
/// assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
/// # }
/// # Ok::<(), hemicube_export::Error>(())
/// ```
///
/// # Errors
/// For columns of different lengths, and without the feature `parquet`.
pub fn parquet_table(columns: &[(String, TableColumn)]) -> Result<Vec<u8>> {
    #[cfg(feature = "parquet")]
    return writer::bytes(columns).map_err(|error| Error::Table(error.to_string()));
    #[cfg(not(feature = "parquet"))]
    {
        let _ = columns;
        Err(Error::NotBuilt { feature: "parquet" })
    }
}

#[cfg(feature = "parquet")]
mod writer {
    use super::TableColumn;
    use parquet::basic::{LogicalType, Repetition, Type as PhysicalType};
    use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
    use parquet::errors::{ParquetError, Result};
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::types::Type;
    use std::sync::Arc;

    pub(super) fn bytes(columns: &[(String, TableColumn)]) -> Result<Vec<u8>> {
        let field = |(name, column): &(String, TableColumn)| {
            let field = match column {
                TableColumn::Names(_) => Type::primitive_type_builder(name, PhysicalType::BYTE_ARRAY)
                    .with_repetition(Repetition::REQUIRED)
                    .with_logical_type(Some(LogicalType::String)),
                TableColumn::Numbers(_) => {
                    Type::primitive_type_builder(name, PhysicalType::DOUBLE).with_repetition(Repetition::OPTIONAL)
                }
            };
            field.build().map(Arc::new)
        };
        let fields = columns.iter().map(field).collect::<Result<_>>()?;
        let schema = Type::group_type_builder("table").with_fields(fields).build()?;
        let properties = WriterProperties::builder().set_created_by(format!("hemicube {}", env!("CARGO_PKG_VERSION")));
        let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties.build()))?;
        let mut group = writer.next_row_group()?;
        for (_, column) in columns {
            let mut writer = group
                .next_column()?
                .ok_or_else(|| ParquetError::General("the schema has fewer columns".to_owned()))?;
            match column {
                TableColumn::Names(names) => {
                    let names: Vec<ByteArray> = names.iter().map(|name| name.as_str().into()).collect();
                    writer.typed::<ByteArrayType>().write_batch(&names, None, None)?;
                }
                TableColumn::Numbers(numbers) => {
                    let levels: Vec<i16> = numbers.iter().map(|number| i16::from(number.is_some())).collect();
                    let numbers: Vec<f64> = numbers.iter().copied().flatten().collect();
                    writer
                        .typed::<DoubleType>()
                        .write_batch(&numbers, Some(&levels), None)?;
                }
            }
            writer.close()?;
        }
        group.close()?;
        writer.into_inner()
    }
}
