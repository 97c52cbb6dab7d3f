//! Destinations of the records of an export: lines of JSON, or a file for each table.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use serde::Serialize;

use super::csv_file::CsvFile;
use super::parquet_file::ParquetFile;
use super::tables::{TABLES, Table};

/// Destination of the records of an export.
pub(super) enum ExportSink {
    /// Lines of JSON, to a file or stdout.
    Lines(LineSink),
    /// A file for each table.
    Tables(TableSink),
}

impl ExportSink {
    /// Writes one record to the destination.
    pub(super) fn write(&mut self, record: &impl Serialize) -> anyhow::Result<()> {
        match self {
            Self::Lines(lines) => lines.write(record),
            Self::Tables(tables) => tables.write(record),
        }
    }

    /// True once no reader is left, as in `sparring db export | head`.
    pub(super) const fn is_closed(&self) -> bool {
        matches!(self, Self::Lines(LineSink { is_closed: true, .. }))
    }

    /// Completes the files. Returns the number of records.
    pub(super) fn finish(self) -> anyhow::Result<u64> {
        match self {
            Self::Lines(mut lines) => {
                let flushed = lines.out.flush();
                lines.handle(flushed)?;
                Ok(lines.lines)
            }
            Self::Tables(tables) => tables.finish(),
        }
    }
}

/// Lines of JSON, to a file or a pipe.
pub(super) struct LineSink {
    out: Box<dyn Write>,
    /// True once the reader has closed the pipe.
    is_closed: bool,
    /// Number of written lines.
    lines: u64,
}

impl LineSink {
    pub(super) fn new(out: impl Write + 'static) -> Self {
        Self { out: Box::new(std::io::BufWriter::new(out)), is_closed: false, lines: 0 }
    }

    fn write(&mut self, record: &impl Serialize) -> anyhow::Result<()> {
        if !self.is_closed {
            let written = serde_json::to_vec(record)
                .map_err(std::io::Error::from)
                .and_then(|bytes| self.out.write_all(&bytes).and_then(|()| self.out.write_all(b"\n")));
            self.handle(written)?;
            self.lines += 1;
        }
        Ok(())
    }

    fn handle(&mut self, written: std::io::Result<()>) -> anyhow::Result<()> {
        match written {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => self.is_closed = true,
            written => written.context("the lines cannot be written")?,
        }
        Ok(())
    }
}

/// Format of the files of tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TableFormat {
    Csv,
    Parquet,
}

impl TableFormat {
    /// Ending of the files' names.
    const fn extension(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
        }
    }
}

/// A file for each table in one folder.
pub(super) struct TableSink {
    files: Vec<(Table, TableFile)>,
    rows: u64,
}

enum TableFile {
    Csv(CsvFile),
    Parquet(ParquetFile),
}

impl TableSink {
    /// Creates the files in an existing folder.
    pub(super) fn new(folder: &Path, format: TableFormat) -> anyhow::Result<Self> {
        let create = |table: Table| {
            let path = folder.join(format!("{}.{}", table.name, format.extension()));
            let file =
                File::create(&path).with_context(|| format!("{} cannot be written", path.display()))?;
            let file = match format {
                TableFormat::Csv => TableFile::Csv(CsvFile::new(&table, file)?),
                TableFormat::Parquet => TableFile::Parquet(ParquetFile::new(&table, file)?),
            };
            Ok((table, file))
        };
        Ok(Self { files: TABLES.into_iter().map(create).collect::<anyhow::Result<_>>()?, rows: 0 })
    }

    fn write(&mut self, record: &impl Serialize) -> anyhow::Result<()> {
        let record = serde_json::to_value(record)?;
        let kind = record["kind"].as_str().unwrap_or_default();
        let found = self.files.iter_mut().find(|(table, _)| table.kind == kind);
        let (table, file) = found.with_context(|| format!("no table has records of the kind {kind:?}"))?;
        let row = table.row(&record);
        self.rows += 1;
        match file {
            TableFile::Csv(file) => file.write(row),
            TableFile::Parquet(file) => file.write(row),
        }
    }

    fn finish(self) -> anyhow::Result<u64> {
        for (_, file) in self.files {
            match file {
                TableFile::Csv(file) => file.finish()?,
                TableFile::Parquet(file) => file.finish()?,
            }
        }
        Ok(self.rows)
    }
}
