//! Tables as CSV files (RFC 4180), with a header.

use std::fs::File;
use std::io::BufWriter;

use super::tables::{Cell, Table};

/// CSV file of one table. Null is an empty field.
pub(super) struct CsvFile {
    writer: csv::Writer<BufWriter<File>>,
}

impl CsvFile {
    /// Begins a file with the names of the columns.
    pub(super) fn new(table: &Table, file: File) -> anyhow::Result<Self> {
        let mut writer = csv::Writer::from_writer(BufWriter::new(file));
        writer.write_record(table.columns.iter().map(|column| column.name))?;
        Ok(Self { writer })
    }

    pub(super) fn write(&mut self, row: Vec<Cell>) -> anyhow::Result<()> {
        Ok(self.writer.write_record(row.into_iter().map(text))?)
    }

    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        Ok(self.writer.flush()?)
    }
}

/// Text of a cell. A real has the fewest digits that are exact, and always a point or an exponent, by which readers tell it from an
/// integer.
fn text(cell: Cell) -> String {
    match cell {
        Cell::Null => String::new(),
        Cell::Text(text) => text,
        Cell::Integer(number) => number.to_string(),
        Cell::Real(number) => format!("{number:?}"),
        Cell::Boolean(value) => value.to_string(),
    }
}
