//! Tables as Parquet files, compressed with zstd.

use std::fs::File;
use std::sync::Arc;

use anyhow::Context;
use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as PhysicalType, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::tables::{Cell, Column, ColumnKind, Table};

/// Rows of a row group. They are in memory until the group is written.
const ROWS_PER_GROUP: usize = 20_000;

/// Parquet file of one table. All columns are optional; a time is a timestamp in milliseconds, UTC.
pub(super) struct ParquetFile {
    writer: SerializedFileWriter<File>,
    columns: &'static [Column],
    rows: Vec<Vec<Cell>>,
}

impl ParquetFile {
    /// Begins a file with the columns of a table.
    pub(super) fn new(table: &Table, file: File) -> anyhow::Result<Self> {
        let fields = table.columns.iter().map(|column| Ok(Arc::new(field(column)?)));
        let fields = fields.collect::<anyhow::Result<_>>()?;
        let schema = Type::group_type_builder(table.name).with_fields(fields).build()?;
        let compression = Compression::ZSTD(ZstdLevel::default());
        let properties = WriterProperties::builder().set_compression(compression).build();
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?;
        Ok(Self { writer, columns: table.columns, rows: Vec::new() })
    }

    pub(super) fn write(&mut self, row: Vec<Cell>) -> anyhow::Result<()> {
        self.rows.push(row);
        if self.rows.len() >= ROWS_PER_GROUP { self.write_group() } else { Ok(()) }
    }

    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        self.write_group()?;
        self.writer.close()?;
        Ok(())
    }

    /// Writes the rows in memory as one row group.
    fn write_group(&mut self) -> anyhow::Result<()> {
        if self.rows.is_empty() {
            return Ok(());
        }
        let mut group = self.writer.next_row_group()?;
        for (at, column) in self.columns.iter().enumerate() {
            let mut writer = group.next_column()?.context("a column is missing in the schema")?;
            let cells = self.rows.iter().filter_map(|row| row.get(at));
            write_column(writer.untyped(), column, cells)?;
            writer.close()?;
        }
        group.close()?;
        self.rows.clear();
        Ok(())
    }
}

/// Schema of a column.
fn field(column: &Column) -> anyhow::Result<Type> {
    let (physical, logical) = match column.kind {
        // polars reads the logical type JSON as bytes.
        ColumnKind::Text | ColumnKind::Json => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
        ColumnKind::Integer => (PhysicalType::INT64, None),
        ColumnKind::Real => (PhysicalType::DOUBLE, None),
        ColumnKind::Boolean => (PhysicalType::BOOLEAN, None),
        ColumnKind::Time => {
            let time = LogicalType::timestamp(true, TimeUnit::MILLIS);
            (PhysicalType::INT64, Some(time))
        }
    };
    let builder = Type::primitive_type_builder(column.name, physical);
    Ok(builder.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build()?)
}

/// Writes the cells of a column. The definition level of a null is 0.
fn write_column<'a>(
    writer: &mut ColumnWriter<'_>,
    column: &Column,
    cells: impl Iterator<Item = &'a Cell>,
) -> anyhow::Result<()> {
    let cells: Vec<&Cell> = cells.collect();
    let levels: Vec<i16> = cells.iter().map(|cell| i16::from(**cell != Cell::Null)).collect();
    let cells = cells.into_iter();
    match writer {
        ColumnWriter::BoolColumnWriter(writer) => {
            let values: Vec<bool> = cells
                .filter_map(|cell| if let Cell::Boolean(value) = cell { Some(*value) } else { None })
                .collect();
            writer.write_batch(&values, Some(&levels), None)?;
        }
        ColumnWriter::Int64ColumnWriter(writer) => {
            let values = cells.filter(|cell| **cell != Cell::Null).map(integer);
            let values = values.collect::<anyhow::Result<Vec<i64>>>()?;
            writer.write_batch(&values, Some(&levels), None)?;
        }
        ColumnWriter::DoubleColumnWriter(writer) => {
            let values: Vec<f64> = cells
                .filter_map(|cell| if let Cell::Real(value) = cell { Some(*value) } else { None })
                .collect();
            writer.write_batch(&values, Some(&levels), None)?;
        }
        ColumnWriter::ByteArrayColumnWriter(writer) => {
            let text = |cell: &Cell| {
                if let Cell::Text(text) = cell { Some(ByteArray::from(text.as_str())) } else { None }
            };
            let values: Vec<ByteArray> = cells.filter_map(text).collect();
            writer.write_batch(&values, Some(&levels), None)?;
        }
        _ => anyhow::bail!("the column {} has an unexpected type", column.name),
    }
    Ok(())
}

/// Integer of a cell: a number, or a time in milliseconds since 1970 UTC.
fn integer(cell: &Cell) -> anyhow::Result<i64> {
    match cell {
        Cell::Integer(number) => Ok(*number),
        Cell::Text(time) => {
            let time: jiff::Timestamp = time.parse().with_context(|| format!("the time {time:?}"))?;
            Ok(time.as_millisecond())
        }
        other => anyhow::bail!("{other:?} is not an integer"),
    }
}
