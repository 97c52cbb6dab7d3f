//! `sparring db export`: writes the contents of a database as JSON lines.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde::Serialize;
use sqlx::SqliteConnection;
use store::layouts::{self, LayoutFilter};
use store::scenarios::ScenarioLoader;
use store::{compacted_leases, curriculum, episodes, groups, leases, runs};

use super::lines::{self, ExportLine};
use super::open_readers;
use commands::files;
use commands::output::{self, Report};
use commands::run_names::find_stored_run;

/// Export a database as JSON lines (NDJSON), each with its kind: run, move, layout, claim or episode.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each run is followed by its level moves with their evidence, its layouts, and the contents of its leases in order: reported \
episodes, and claims in columns. Episodes older than the run's retention have `replay: expired`, without actions and \
scenario. The file is written completely or not at all.

Examples:
  sparring db export --run baseline > run.ndjson
  sparring db export --actions --out everything.ndjson")]
pub(super) struct Args {
    /// Export only this run, by id, prefix or name
    #[arg(long, value_name = "RUN")]
    run: Option<String>,
    /// Include the scenario and the actions of each episode that has not expired; they are most of a database
    #[arg(long)]
    actions: bool,
    /// Path of the output file, which must not exist [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
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
    match &args.out {
        None => {
            let mut sink = LineSink {
                out: Box::new(std::io::BufWriter::new(std::io::stdout().lock())),
                is_closed: false,
                lines: 0,
            };
            write_all(conn, &ids, args.actions, &mut sink).await?;
        }
        Some(file) => {
            if file.exists() {
                bail!("{} already exists; choose another file, or move it away", file.display());
            }
            let folder =
                file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let beside =
                tempfile::NamedTempFile::new_in(folder).map_err(|error| files::write_fault(file, &error))?;
            let mut sink = LineSink {
                out: Box::new(std::io::BufWriter::new(beside.reopen()?)),
                is_closed: false,
                lines: 0,
            };
            write_all(conn, &ids, args.actions, &mut sink).await?;
            let lines = sink.lines;
            beside.as_file().sync_all()?;
            beside.persist_noclobber(file).map_err(|error| files::write_fault(file, &error.error))?;
            let mut report = Report::default();
            report.line(format!("{lines} lines are in {}.", file.display()));
            output::print_report(&report)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Destination of the exported lines.
struct LineSink {
    out: Box<dyn Write>,
    /// True once the reader has closed the pipe, as in `sparring db export | head`.
    is_closed: bool,
    /// Number of written lines.
    lines: u64,
}

impl LineSink {
    fn write(&mut self, line: &impl Serialize) -> anyhow::Result<()> {
        if !self.is_closed {
            let written = serde_json::to_vec(line)
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

async fn write_all(
    conn: &mut SqliteConnection,
    ids: &[String],
    actions: bool,
    sink: &mut LineSink,
) -> anyhow::Result<()> {
    for run in ids {
        if sink.is_closed {
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
    }
    let flushed = sink.out.flush();
    sink.handle(flushed)
}

/// Writes a run's claims and episodes: first those of compacted leases, then those of complete leases, each in order.
async fn write_leases(
    conn: &mut SqliteConnection,
    run: &str,
    actions: bool,
    sink: &mut LineSink,
) -> anyhow::Result<()> {
    let mut failed = Ok(());
    compacted_leases::each(conn, run, |lease| {
        for line in lines::compacted_lines(run, &lease) {
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
                let claim = lines::ExportedClaim {
                    state: claim.state,
                    episodes: claim.episodes,
                    failed: claim.failed,
                };
                sink.write(&ExportLine::claim(run, &lease, claim))?;
            }
            let of_lease = groups::of_lease(conn, lease.id).await?;
            for row in episodes::of_leases(conn, &[lease.id]).await? {
                let number = row.number / lease.group_size.max(1);
                let Some(group) = of_lease.iter().find(|group| group.number == number) else { continue };
                let mut line = lines::ExportedEpisode::new(run, &lease, group, &row)?;
                if actions {
                    let scenario = loader.get(conn, &group.scenario).await?;
                    let log = episodes::log(conn, lease.id, row.number).await?;
                    line.add_actions(&scenario, log.as_ref());
                }
                sink.write(&ExportLine::Episode(Box::new(line)))?;
            }
            if sink.is_closed {
                return Ok(());
            }
        }
    }
    Ok(())
}
