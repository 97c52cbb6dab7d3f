//! `sparring db info`: prints the size and the contents of a database.

use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use store::integrity::{self, DatabaseSize, RunSize};

use super::super::output::{self, Format};
use super::{format_bytes, open_readers};
use orchestrator::clock::rfc3339;

/// Show the size of a database by table, and the contents of each run.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Set the output format
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
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
    match args.format {
        Format::Json => output::print_json(&info)?,
        Format::Table => output::print(&words(&info))?,
    }
    Ok(ExitCode::SUCCESS)
}

fn words(info: &Info) -> String {
    let DatabaseSize { schema, bytes, free_bytes, tables } = &info.size;
    let mut text = format!(
        "{}: schema {schema}, {}, of which {} are free\n",
        info.db,
        format_bytes(*bytes),
        format_bytes(*free_bytes)
    );
    let mut largest = output::table(&["table, with its indexes", "size"], 1);
    for (name, bytes) in tables.iter().take(MAX_TABLES) {
        largest.add_row([name.clone(), format_bytes(*bytes)]);
    }
    text.push_str(&format!("{largest}\n"));
    if info.runs.is_empty() {
        text.push_str("There are no runs.");
        return text;
    }
    let header = [
        "run",
        "status",
        "since",
        "active leases",
        "episodes",
        "of them compacted",
        "claimed",
        "moves",
        "layouts",
    ];
    let mut runs = output::table(&header, 3);
    for run in &info.runs {
        let counts =
            [run.active, run.whole + run.compacted, run.compacted, run.claimed, run.moves, run.layouts];
        let words = [run.run.clone(), run.status.to_string(), rfc3339(run.created_at)];
        runs.add_row(words.into_iter().chain(counts.map(|count| count.to_string())));
    }
    text.push_str(&runs.to_string());
    text
}
