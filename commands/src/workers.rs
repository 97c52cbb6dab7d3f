//! `sparring workers`: lists the workers of a server.

use std::process::ExitCode;

use api_types::{RemoteWorker, RemoteWorkerList, RemoteWorkerState};

use crate::api::{Connection, ServerArgs, StartService};
use crate::output::{self, Column, JsonFlag, OutputTarget, TextTable};

/// List the workers on other machines.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Without --url the command finds the server of the database on this machine.

Examples:
  sparring workers
  sparring workers --json")]
pub struct Args {
    #[command(flatten)]
    server: ServerArgs,
    #[command(flatten)]
    output: JsonFlag,
}

/// Prints the workers of a server.
///
/// # Errors
/// Returns an error if no server can be reached.
pub fn run(args: &Args, start: StartService) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let connection = Connection::open(&args.server, start).await?;
        let is_server = connection.is_server();
        let listed: anyhow::Result<RemoteWorkerList> = connection.api.get("/v1/workers").await;
        connection.close().await;
        let list = listed?;
        anyhow::ensure!(
            is_server,
            "no server runs with this database; start one with `sparring serve --nats URL`"
        );
        if args.output.json {
            output::print_json(&list)?;
        } else {
            output::print(&text(&list))?;
        }
        Ok(ExitCode::SUCCESS)
    })
}

fn text(list: &RemoteWorkerList) -> String {
    if !list.distributed {
        return "The server does all jobs itself; `sparring serve --nats URL` lets workers join.".to_owned();
    }
    let mut text = String::new();
    if let Some(reason) = &list.degraded {
        text = format!("Degraded: {reason}.\n");
    }
    if list.workers.is_empty() {
        return text + "There are no workers; start one with `sparring worker --nats URL`.";
    }
    text + &table(&list.workers).render(OutputTarget::stdout())
}

fn table(workers: &[RemoteWorker]) -> TextTable {
    let mut table = TextTable::new([
        Column::text("worker"),
        Column::text("host"),
        Column::text("state"),
        Column::text("version").optional(2),
        Column::text("jobs of").optional(3),
        Column::number("active").optional(4),
        Column::number("jobs").optional(1),
        Column::number("jobs/s"),
        Column::number("errors"),
        Column::text("last seen"),
    ]);
    for worker in workers {
        table.add_row([
            worker.id.clone(),
            worker.host.clone(),
            state_name(worker.state).to_owned(),
            worker.version.clone(),
            worker.kinds.join(", "),
            format!("{} of {}", worker.active_jobs, worker.concurrency),
            worker.jobs.to_string(),
            format!("{:.1}", worker.jobs_per_s),
            worker.errors.to_string(),
            format!("{:.0} s ago", worker.last_seen_s),
        ]);
    }
    table
}

const fn state_name(state: RemoteWorkerState) -> &'static str {
    match state {
        RemoteWorkerState::Active => "active",
        RemoteWorkerState::Stalled => "stalled",
        RemoteWorkerState::Refused => "refused",
        RemoteWorkerState::Expelled => "expelled",
    }
}
