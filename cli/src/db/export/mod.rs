//! `sparring db export`: writes the contents of a database as lines of JSON, or as tables.
//!
//! `records` defines the records, `tables` the columns of tables, and `sink` the destinations.

mod csv_file;
mod parquet_file;
mod records;
mod sink;
mod tables;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::ValueEnum;
use sqlx::SqliteConnection;
use store::layouts::{self, LayoutFilter};
use store::scenarios::ScenarioLoader;
use store::{compacted_leases, curriculum, episodes, groups, leases, runs, views};

use self::records::{ExportLine, ExportedClaim, ExportedEpisode, ExportedGroup};
use self::sink::{ExportSink, LineSink, TableFormat, TableSink};
use super::open_readers;
use commands::files;
use commands::output::{self, Report};
use commands::run_names::find_stored_run;

/// Export a database as lines of JSON (NDJSON), or as tables in CSV or Parquet files.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
NDJSON has one object per line with its kind: run, move, layout, claim, group, episode, mastery or trainer_metric. Each run is \
followed by its level moves with their evidence, its layouts, the contents of its leases in order, its mastery over time and the \
metrics of its trainer. CSV and Parquet have one file per kind in a new folder: runs, moves, layouts, claims, groups, episodes, \
mastery and trainer_metrics. docs/reference/data.md lists their columns.

Episodes older than the run's retention have `replay: expired`, without actions and scenario. The file or folder is written \
completely or not at all.

Examples:
  sparring db export --run baseline > run.ndjson
  sparring db export --actions --out everything.ndjson
  sparring db export --format parquet --out tables
  sparring db export --format csv --run baseline --out baseline-csv")]
pub(super) struct Args {
    /// Export only this run, by id, prefix or name
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    /// Include the scenario and the actions of each episode that has not expired; they are most of a database
    #[arg(long)]
    actions: bool,
    /// Format of the export
    #[arg(long, value_enum, default_value_t = ExportFormat::Ndjson)]
    format: ExportFormat,
    /// Path of the output, which must not exist: a file with NDJSON [default: stdout], else a folder
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// Format of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// One JSON object per line
    Ndjson,
    /// A folder with a CSV file for each table
    Csv,
    /// A folder with a Parquet file for each table
    Parquet,
}

/// Rows read at a time.
const PAGE_SIZE: i64 = 200;

pub(super) async fn run(db: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let open_readers = open_readers(db).await?;
    let mut moment = open_readers.begin().await?;
    let conn = &mut *moment;
    let ids = match &args.run {
        Some(run) => vec![find_stored_run(conn, Some(run)).await?],
        None => runs::names(conn).await?.into_iter().map(|run| run.id).collect(),
    };
    let format = match args.format {
        ExportFormat::Ndjson => None,
        ExportFormat::Csv => Some(TableFormat::Csv),
        ExportFormat::Parquet => Some(TableFormat::Parquet),
    };
    let Some(out) = &args.out else {
        if format.is_some() {
            bail!("--format csv and parquet need --out FOLDER, since they write several files");
        }
        let mut sink = ExportSink::Lines(LineSink::new(std::io::stdout()));
        write_all(conn, &ids, args.actions, &mut sink).await?;
        sink.finish()?;
        return Ok(ExitCode::SUCCESS);
    };
    if out.exists() {
        bail!("{} already exists; choose another path, or move it away", out.display());
    }
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut report = Report::default();
    if let Some(format) = format {
        let beside = tempfile::tempdir_in(folder).map_err(|error| files::write_fault(out, &error))?;
        // A temporary folder is private; one within it has the permissions of other folders.
        let tables = beside.path().join("tables");
        std::fs::create_dir(&tables).map_err(|error| files::write_fault(out, &error))?;
        let mut sink = ExportSink::Tables(TableSink::new(&tables, format)?);
        write_all(conn, &ids, args.actions, &mut sink).await?;
        let rows = sink.finish()?;
        std::fs::rename(&tables, out).map_err(|error| files::write_fault(out, &error))?;
        report.line(format!("{rows} rows are in the files of {}.", out.display()));
    } else {
        let beside = readable_file(folder).map_err(|error| files::write_fault(out, &error))?;
        let mut sink = ExportSink::Lines(LineSink::new(beside.reopen()?));
        write_all(conn, &ids, args.actions, &mut sink).await?;
        let lines = sink.finish()?;
        beside.as_file().sync_all()?;
        beside.persist_noclobber(out).map_err(|error| files::write_fault(out, &error.error))?;
        report.line(format!("{lines} lines are in {}.", out.display()));
    }
    output::print_report(&report)?;
    Ok(ExitCode::SUCCESS)
}

/// Creates a temporary file with the permissions of other files of the user; by default it would be private.
fn readable_file(folder: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

async fn write_all(
    conn: &mut SqliteConnection,
    ids: &[String],
    actions: bool,
    sink: &mut ExportSink,
) -> anyhow::Result<()> {
    for run in ids {
        if sink.is_closed() {
            break;
        }
        let row =
            runs::get(conn, run).await?.with_context(|| format!("run {run} does not exist any more"))?;
        sink.write(&ExportLine::run(row)?)?;
        let mut after = -1;
        loop {
            let moves = curriculum::moves(conn, run, after, PAGE_SIZE).await?;
            let Some(last) = moves.last() else { break };
            after = last.seq;
            for row in moves {
                sink.write(&ExportLine::moved(run, row)?)?;
            }
        }
        let mut before = i64::MAX;
        loop {
            let wanted = LayoutFilter { with_refused: true, ..LayoutFilter::default() };
            let page = layouts::of_run(conn, run, &wanted, before, PAGE_SIZE).await?;
            let Some(last) = page.last() else { break };
            before = last.id;
            for row in page {
                sink.write(&ExportLine::layout(run, row)?)?;
            }
        }
        write_leases(conn, run, actions, sink).await?;
        for row in views::mastery(conn, run).await? {
            sink.write(&ExportLine::Mastery { run, row })?;
        }
        for row in views::trainer_metrics(conn, run).await? {
            sink.write(&ExportLine::TrainerMetric { run, row })?;
        }
    }
    Ok(())
}

/// Writes a run's claims and episodes: first those of compacted leases, then those of complete leases, each in order.
async fn write_leases(
    conn: &mut SqliteConnection,
    run: &str,
    actions: bool,
    sink: &mut ExportSink,
) -> anyhow::Result<()> {
    let mut failed = Ok(());
    compacted_leases::each(conn, run, |lease| {
        for line in records::compacted_lines(run, &lease) {
            if failed.is_ok() {
                failed = sink.write(&line);
            }
        }
    })
    .await?;
    failed?;
    let (mut after, mut loader) = (0, ScenarioLoader::default());
    loop {
        let page = leases::page(conn, run, after, PAGE_SIZE).await?;
        let Some(last) = page.last() else { break };
        after = last.id;
        for lease in page {
            let claim = store::columns::claim(conn, lease.id).await?;
            if let Some(claim) = claim {
                let claim =
                    ExportedClaim { state: claim.state, episodes: claim.episodes, failed: claim.failed };
                sink.write(&ExportLine::claim(run, &lease, claim))?;
            }
            let of_lease = groups::of_lease(conn, lease.id).await?;
            for group in &of_lease {
                sink.write(&ExportLine::Group(Box::new(ExportedGroup::new(run, &lease, group))))?;
            }
            for row in episodes::of_leases(conn, &[lease.id]).await? {
                let number = row.number / lease.group_size.max(1);
                let Some(group) = of_lease.iter().find(|group| group.number == number) else { continue };
                let mut line = ExportedEpisode::new(run, &lease, group, &row)?;
                if actions {
                    let scenario = loader.get(conn, &group.scenario).await?;
                    let log = episodes::log(conn, lease.id, row.number).await?;
                    line.add_actions(&scenario, log.as_ref());
                }
                sink.write(&ExportLine::Episode(Box::new(line)))?;
            }
            if sink.is_closed() {
                return Ok(());
            }
        }
    }
    Ok(())
}
