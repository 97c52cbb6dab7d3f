//! `sparring runs delete`: deletes a run with all of its data.

use std::io::{IsTerminal, Write};

use anyhow::{Context, bail};
use api_types::{RunOverview, RunSummary};

use crate::api::{ApiClient, Connection, find_run};
use crate::output::{self, JsonFlag};

/// Delete an archived run with its leases, results, layouts and evaluations.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The deletion is permanent. On a terminal the command asks for the name of the run. Without a terminal it needs --yes.

A server deletes the data in the background. Without a server the command deletes it before it exits; after an interrupt, the \
next server or the next `sparring runs delete` continues. `sparring db vacuum` then makes the file smaller.

Examples:
  sparring runs archive baseline && sparring runs delete baseline
  sparring runs delete baseline --archive --yes")]
pub(super) struct Args {
    /// Run to delete with all of its data
    #[arg(value_name = "RUN")]
    run: String,
    /// Archive the run first, if it is not archived
    #[arg(long)]
    archive: bool,
    /// Delete without asking for the name of the run
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    output: JsonFlag,
}

pub(super) async fn run(connection: &Connection, args: &Args) -> anyhow::Result<()> {
    let api = &connection.api;
    let run = find_run(api, Some(&args.run)).await?;
    let is_archived = run.archived_at.is_some();
    if !is_archived && !args.archive {
        bail!("run {} is not archived: add --archive to archive and delete it", run.id);
    }
    if !args.yes {
        confirm(api, &run).await?;
    }
    if !is_archived {
        let _: RunSummary = api.post_empty(&format!("/v1/runs/{}/archive", run.id)).await?;
    }
    let deleted: RunSummary =
        api.delete(&format!("/v1/runs/{}", run.id), &[("name", run.name.as_str())]).await?;
    connection.finish_deletions().await.context("the run is deleted, but not all of its data")?;
    if args.output.json {
        output::print_json(&deleted)
    } else {
        output::print(&format!("{} is deleted", deleted.id))
    }
}

/// Asks the user for the name of the run.
///
/// # Errors
/// Returns an error if there is no terminal, or if the user enters another name.
async fn confirm(api: &ApiClient, run: &RunSummary) -> anyhow::Result<()> {
    if !std::io::stdin().is_terminal() {
        bail!("there is no terminal to confirm the deletion of run {}: add --yes to delete it", run.id);
    }
    let overview: RunOverview = api.get(&format!("/v1/runs/{}/overview", run.id)).await?;
    let mut stderr = std::io::stderr();
    write!(
        stderr,
        "This deletes run {} ({}) with {} episodes, its layouts and its evaluations. The deletion is permanent.\n\
         Enter the name of the run to delete it: ",
        run.id, run.name, overview.episodes
    )?;
    stderr.flush()?;
    // Ctrl-C ends the process while a thread of its own reads the line.
    let line = tokio::task::spawn_blocking(|| {
        let mut line = String::new();
        std::io::stdin().read_line(&mut line).map(|_| line)
    });
    let entered = line.await?.context("the name cannot be read")?;
    if entered.trim_end_matches(['\r', '\n']) != run.name {
        bail!("the name of the run is {:?}, got {:?}; nothing was deleted", run.name, entered.trim_end());
    }
    Ok(())
}
