//! `sparring report`: writes the report of a run as one HTML page.
//!
//! [`gather`] reads the contents from the database, [`page`] renders them; [`chart`] and [`rose`] draw the pictures.

mod chart;
mod gather;
mod page;
mod rose;
mod sampler;

use std::path::PathBuf;
use std::process::ExitCode;

use super::db::{DatabaseArgs, open_readers};
use clock::Clock;
use commands::files;
use commands::output;
use commands::run_names::find_stored_run;

/// Write the report of a run as one self-contained HTML file.
///
/// The report shows which levels the agent mastered and on which evidence, its failures and their angles, the layouts that
/// were designed for it, its evaluations, and the rules behind all decisions. A server may use the database at the same time.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  sparring report
  sparring report baseline --out baseline.html
  sparring report mine --out /srv/www/mine.html \\
      --db /var/lib/sparring/sparring.sqlite3")]
pub struct Args {
    /// Run of the report, by id, prefix or name [default: the only run]
    run: Option<String>,
    #[command(flatten)]
    database: DatabaseArgs,
    /// Path of the report; an existing file is overwritten
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
}

/// Writes the report.
///
/// # Errors
/// Returns an error if the database cannot be used, the run does not exist, or the file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    files::check_writable(&args.out)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (run, report) = runtime.block_on(async {
        let open_readers = open_readers(&args.database.db).await?;
        let mut conn = open_readers.acquire().await?;
        let run = find_stored_run(&mut conn, args.run.as_deref()).await?;
        let report = gather::gather(&mut conn, &run, Clock::system().now()).await?;
        anyhow::Ok((run, report))
    })?;
    let text = page::render(&report)?;
    files::write(&args.out, &text)?;
    let kib = text.len().div_ceil(1024);
    output::print(&format!(
        "{}: {} episodes of {run} on one page of {kib} KiB",
        args.out.display(),
        report.episodes,
    ))?;
    Ok(ExitCode::SUCCESS)
}
