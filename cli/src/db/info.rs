//! `sparring db info`: prints the size and the contents of a database.

use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use store::integrity::{self, DatabaseSize, RunSize};

use super::{format_bytes, open_readers};
use clock::rfc3339;
use commands::output::{self, Column, JsonFlag, Report, TextTable};

/// Show the size of a database by table, and the contents of each run.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    output: JsonFlag,
}

#[derive(Debug, Serialize)]
struct Info {
    db: String,
    #[serde(flatten)]
    size: DatabaseSize,
    runs: Vec<RunSize>,
}

/// Largest number of tables in the text output.
const MAX_TABLES: usize = 8;

pub(super) async fn run(db: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let open_readers = open_readers(db).await?;
    let mut conn = open_readers.acquire().await?;
    let (size, runs) = (integrity::size(&mut conn).await?, integrity::runs(&mut conn).await?);
    let info = Info { db: db.display().to_string(), size, runs };
    if args.output.json {
        output::print_json(&info)?;
    } else {
        output::print_report(&report(&info))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn report(info: &Info) -> Report {
    let DatabaseSize { schema, bytes, free_bytes, tables } = &info.size;
    let mut report = Report::default();
    report.paragraph(format!(
        "{}: schema {schema}, {}, of which {} are free",
        info.db,
        format_bytes(*bytes),
        format_bytes(*free_bytes)
    ));
    let mut largest = TextTable::new([Column::text("table, with its indexes"), Column::number("size")]);
    for (name, bytes) in tables.iter().take(MAX_TABLES) {
        largest.add_row([name.clone(), format_bytes(*bytes)]);
    }
    report.table(largest);
    if info.runs.is_empty() {
        report.paragraph("There are no runs.");
    } else {
        report.table(run_table(&info.runs));
    }
    report
}

fn run_table(runs: &[RunSize]) -> TextTable {
    let mut table = TextTable::new([
        Column::text("run"),
        Column::text("status"),
        Column::text("created").optional(4),
        Column::number("active leases").optional(3),
        Column::number("episodes"),
        Column::number("compacted").optional(1),
        Column::number("claimed").optional(2),
        Column::number("level moves").optional(1),
        Column::number("layouts").optional(2),
    ]);
    for run in runs {
        let counts =
            [run.active, run.whole + run.compacted, run.compacted, run.claimed, run.moves, run.layouts];
        let words = [run.run.clone(), run.status.to_string(), rfc3339(run.created_at)];
        table.add_row(words.into_iter().chain(counts.map(|count| count.to_string())));
    }
    table
}
