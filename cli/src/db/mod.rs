//! `sparring db`: inspects, checks, copies, compacts and exports a database. One file or folder per subcommand.

mod backup;
mod check;
mod export;
mod info;
mod vacuum;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Subcommand;
use sqlx::SqlitePool;

use commands::files;
use commands::interrupt::{INTERRUPTED, StopSignal};

/// Inspect, check, back up, compact or export a database.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
All subcommands except vacuum can run while a server uses the database. A copy made by `backup` is a complete database: \
`sparring serve --db COPY` continues from it.

Examples:
  sparring db info
  sparring db check --replay 1000
  sparring db backup /backups/sparring-$(date +%F).sqlite3
  sparring db vacuum
  sparring db export --run baseline | \\
      jq -c 'select(.kind == \"episode\") | [.task, .level, .success]'")]
pub struct Args {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: Command,
}

/// Path of the database on the command line.
#[derive(Debug, clap::Args)]
pub(super) struct DatabaseArgs {
    /// Path of the SQLite database
    #[arg(long, global = true, default_value = "sparring.sqlite3", value_name = "PATH", env = "SPARRING_DB")]
    pub(super) db: PathBuf,
}

#[derive(Debug, Subcommand)]
enum Command {
    Info(info::Args),
    Check(check::Args),
    Vacuum(vacuum::Args),
    Backup(backup::Args),
    Export(export::Args),
}

/// Runs the subcommand.
///
/// # Errors
/// Returns an error if the database cannot be used.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let db = &args.database.db;
    let work = async {
        match &args.command {
            Command::Info(of) => info::run(db, of).await,
            Command::Check(of) => check::run(db, of).await,
            Command::Vacuum(of) => vacuum::run(db, of).await,
            Command::Backup(of) => backup::run(db, of).await,
            Command::Export(of) => export::run(db, of).await,
        }
    };
    runtime.block_on(async {
        tokio::select! {
            ended = work => ended,
            // Work that is dropped deletes its temporary files.
            stopped = stop_requested() => stopped.context("the handler of signals cannot be installed").map(|()| {
                // If stderr is closed, the exit code still reports the interrupt.
                let _ = writeln!(std::io::stderr(), "sparring: interrupted");
                ExitCode::from(INTERRUPTED)
            }),
        }
    })
}

/// Waits for Ctrl-C or SIGTERM.
async fn stop_requested() -> std::io::Result<()> {
    StopSignal::install()?.received().await.map(|_| ())
}

/// Opens read connections to a database with this program's schema.
///
/// # Errors
/// Returns an error if the file is missing, empty, or has another schema.
pub(super) async fn open_readers(db: &Path) -> anyhow::Result<SqlitePool> {
    // Opening an empty file would turn it into a database.
    let there = std::fs::metadata(db).map_err(|error| files::read_fault(db, &error))?;
    ensure!(there.len() > 0, "{} is empty", db.display());
    Ok(store::open_current_readers(db).await?)
}

/// Formats a number of bytes with a binary unit.
fn format_bytes(bytes: i64) -> String {
    indicatif::BinaryBytes(u64::try_from(bytes).unwrap_or(0)).to_string()
}
