//! `sparring status`: shows a server and its runs at a glance.

use std::process::ExitCode;

use api_types::{RunOverview, RunSummary, TaskOverview};
use serde::Serialize;

use super::runs::RunDetails;
use crate::api::{ApiClient, find_run, list_runs};
use crate::api::{Connection, ServerArgs, StartService};
use crate::output::{self, Column, JsonFlag, Report, TextTable};

/// Largest number of runs that are shown.
const MAX_RUNS: usize = 20;

/// Show the server and the progress of its runs.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
RUN is the id of a run, the beginning of one id only, or the name of one run only.

Examples:
  sparring status
  sparring status baseline
  watch -n 10 sparring status --url http://trainer.example.com:8700")]
pub struct Args {
    /// Run to show in detail [default: all runs that are not archived]
    #[arg(value_name = "RUN")]
    run: Option<String>,
    #[command(flatten)]
    server: ServerArgs,
    #[command(flatten)]
    output: JsonFlag,
}

/// Prints the status.
///
/// # Errors
/// Returns an error if the server cannot be reached or rejects the request, or the database cannot be used.
pub fn run(args: &Args, start: StartService) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let connection = Connection::open(&args.server, start).await?;
        let done = match &args.run {
            Some(run) => show_run(&connection.api, run, args.output.json).await,
            None => show_server(&connection, args.output.json).await,
        };
        connection.close().await;
        done.map(|()| ExitCode::SUCCESS)
    })
}

async fn show_run(api: &ApiClient, run: &str, json: bool) -> anyhow::Result<()> {
    let id = find_run(api, Some(run)).await?.id;
    let details = RunDetails::fetch(api, &id).await?;
    if json { output::print_json(&details) } else { output::print_report(&details.report()) }
}

#[derive(Debug, Serialize)]
struct ServerStatus {
    /// URL of the server; `None` if no server runs.
    url: Option<String>,
    /// Number of runs that are not archived.
    run_count: usize,
    runs: Vec<RunStatusLine>,
}

#[derive(Debug, Serialize)]
struct RunStatusLine {
    #[serde(flatten)]
    run: RunSummary,
    overview: RunOverview,
}

async fn show_server(connection: &Connection, json: bool) -> anyhow::Result<()> {
    let mut runs = list_runs(&connection.api, &[]).await?;
    runs.reverse();
    let run_count = runs.len();
    let mut lines = Vec::new();
    for run in runs.into_iter().take(MAX_RUNS) {
        let overview = connection.api.get(&format!("/v1/runs/{}/overview", run.id)).await?;
        lines.push(RunStatusLine { run, overview });
    }
    let url = connection.is_server().then(|| connection.api.url().to_owned());
    let status = ServerStatus { url, run_count, runs: lines };
    if json { output::print_json(&status) } else { output::print_report(&report(&status)) }
}

fn report(status: &ServerStatus) -> Report {
    let mut report = Report::default();
    let runs = if status.run_count == 1 { "1 run".to_owned() } else { format!("{} runs", status.run_count) };
    report.paragraph(match &status.url {
        Some(url) => format!("The server at {url} has {runs}."),
        None => format!("No server runs. The database has {runs}."),
    });
    if status.runs.is_empty() {
        report.line("`sparring runs create` creates a run.");
        return report;
    }
    let mut table = TextTable::new([
        Column::text("run"),
        Column::text("name").optional(1),
        Column::text("status"),
        Column::number("episodes"),
        Column::number("episodes/s"),
        Column::number("active leases").optional(2),
        Column::prose("levels (10 % to 90 % quantile)"),
        Column::text("latest event").optional(3),
    ]);
    for RunStatusLine { run, overview } in &status.runs {
        table.add_row([
            run.id.clone(),
            run.name.clone(),
            super::runs::status_name(run).to_owned(),
            overview.episodes.to_string(),
            format!("{:.1}", overview.episodes_per_s),
            overview.leases.to_string(),
            levels(overview),
            overview.latest_event.as_ref().map_or_else(String::new, |event| event.at.clone()),
        ]);
    }
    report.table(table);
    for RunStatusLine { run, overview } in &status.runs {
        for task in &overview.tasks {
            if let Some(held_back) = &task.held_back {
                report.line(format!("{}, {}: {held_back}.", run.id, short_name(task)));
            }
        }
    }
    if status.run_count > status.runs.len() {
        report.line(format!(
            "{} older runs are not shown; `sparring runs list` lists all.",
            status.run_count - status.runs.len()
        ));
    }
    report
}

/// Lists the levels of a run's tasks with their mastery, as "survival 3 (0.55 to 0.81), eco_station 1 (0.10 to 0.90, 12 % missing)".
fn levels(overview: &RunOverview) -> String {
    let level = |task: &TaskOverview| {
        let level = task.level.map_or_else(|| "–".to_owned(), |level| level.to_string());
        let interval = task.mastery_low.zip(task.mastery_high).map(|(low, high)| {
            let missing = task.missing.filter(|missing| *missing > 0.0);
            let missing =
                missing.map_or_else(String::new, |share| format!(", {:.0} % missing", 100.0 * share));
            format!(" ({low:.2} to {high:.2}{missing})")
        });
        format!("{} {level}{}", short_name(task), interval.unwrap_or_default())
    };
    overview.tasks.iter().map(level).collect::<Vec<_>>().join(", ")
}

/// Name of a task without its world.
fn short_name(task: &TaskOverview) -> &str {
    task.task.rsplit('/').next().unwrap_or(&task.task)
}
