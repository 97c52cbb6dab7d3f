//! `sparring report`: writes the report of a run, or the comparison of several, as one page.
//!
//! [`gather`] reads the contents from the database, [`page`] renders them; [`chart`] and [`rose`] draw the pictures. [`comparison`]
//! has the report of several runs, PDF documents, and files of figures.

mod chart;
mod comparison;
mod gather;
mod page;
mod rose;
mod sampler;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use sqlx::SqliteConnection;

use super::db::{DatabaseArgs, open_readers};
use clock::Clock;
use commands::files;
use commands::output;
use commands::run_names::find_stored_run;
use comparison::{FigureAxis, Grouping};

/// Write the report of a run, or a comparison of several runs.
///
/// The report of one run shows which levels the agent mastered and on which evidence, its failures and their angles, the layouts
/// that were designed for it, its evaluations, and the rules behind all decisions. A comparison shows the curves of several runs,
/// averages those with equal settings, and lists their evaluations and the settings that differ. The file is one self-contained
/// HTML page, or a PDF document of the comparison. A server may use the database at the same time.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  sparring report
  sparring report baseline --out baseline.html
  sparring report seed-1 seed-2 seed-3 --out seeds.pdf --figures figures
  sparring report mine --out /srv/www/mine.html \\
      --db /var/lib/sparring/sparring.sqlite3")]
pub struct Args {
    /// Runs of the report, each by id, prefix or name [default: the only run]
    #[arg(value_name = "RUN")]
    runs: Vec<String>,
    #[command(flatten)]
    database: DatabaseArgs,
    /// Path of the report, which ends in .html or .pdf; an existing file is overwritten
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Folder for the figures of the comparison, each as SVG, PNG, PDF and CSV
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Rule by which the runs of a comparison form groups, whose curves are averaged
    #[arg(long, value_enum, value_name = "RULE", default_value = "settings")]
    group_by: Grouping,
    /// Horizontal axis of a comparison
    #[arg(long = "x", value_enum, value_name = "AXIS", default_value = "episodes")]
    axis: FigureAxis,
}

/// Format of a report.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Html,
    Pdf,
}

/// Writes the report.
///
/// # Errors
/// Returns an error if the database cannot be used, a run does not exist, or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let format = match args.out.extension().and_then(|extension| extension.to_str()) {
        Some("pdf") => Format::Pdf,
        Some("html" | "htm") => Format::Html,
        _ => bail!("{} must end in .html or .pdf", args.out.display()),
    };
    files::check_writable(&args.out)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let text = runtime.block_on(async {
        let open_readers = open_readers(&args.database.db).await?;
        let mut conn = open_readers.acquire().await?;
        let runs = find_runs(&mut conn, &args.runs).await?;
        match (&runs[..], format, &args.figures) {
            ([run], Format::Html, None) => write_report(&mut conn, args, run).await,
            _ => write_comparison(&mut conn, args, &runs, format).await,
        }
    })?;
    output::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Returns the ids of the named runs, or that of the only run.
async fn find_runs(conn: &mut SqliteConnection, names: &[String]) -> anyhow::Result<Vec<String>> {
    if names.is_empty() {
        return Ok(vec![find_stored_run(conn, None).await?]);
    }
    let mut found = Vec::with_capacity(names.len());
    for name in names {
        let run = find_stored_run(conn, Some(name)).await?;
        if found.contains(&run) {
            bail!("run {run} is named twice; name it once");
        }
        found.push(run);
    }
    Ok(found)
}

/// Writes the report of one run, and returns a line about it.
async fn write_report(conn: &mut SqliteConnection, args: &Args, run: &str) -> anyhow::Result<String> {
    let report = gather::gather(conn, run, Clock::system().now()).await?;
    let text = page::render(&report)?;
    files::write(&args.out, &text)?;
    let kib = text.len().div_ceil(1024);
    Ok(format!("{}: {} episodes of {run} on one page of {kib} KiB", args.out.display(), report.episodes))
}

/// Writes the comparison of runs and the files of its figures, and returns lines about them.
async fn write_comparison(
    conn: &mut SqliteConnection,
    args: &Args,
    runs: &[String],
    format: Format,
) -> anyhow::Result<String> {
    let now = Clock::system().now();
    let comparison = comparison::gather(conn, runs, args.group_by, args.axis, now).await?;
    let contents = match format {
        Format::Html => comparison::render(&comparison)?.into_bytes(),
        Format::Pdf => comparison::render_pdf(&comparison)?,
    };
    files::write(&args.out, &contents)?;
    let kib = contents.len().div_ceil(1024);
    let (what, figures) = (comparison.describe(), comparison.figures());
    let mut text = format!("{}: comparison of {what} with {figures} figures, {kib} KiB", args.out.display());
    if let Some(folder) = &args.figures {
        let written = comparison::write_figures(&comparison, folder)?;
        text += &format!("\n{}: {written} files of figures", folder.display());
    }
    Ok(text)
}
