//! `sparring runs pause`, `resume` and `archive`: change the status of runs.

use api_types::RunSummary;

use super::list::status_name;
use crate::api::{ApiClient, find_run};
use crate::output::{self, JsonFlag};

/// Runs whose status to change.
#[derive(Debug, clap::Args)]
struct RunNames {
    /// Runs to change [default: the only run]
    #[arg(value_name = "RUN")]
    runs: Vec<String>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Pause runs: they grant no leases, and results of earlier leases still count.
#[derive(Debug, clap::Args)]
pub(super) struct PauseArgs {
    #[command(flatten)]
    names: RunNames,
}

/// Resume paused or archived runs.
#[derive(Debug, clap::Args)]
pub(super) struct ResumeArgs {
    #[command(flatten)]
    names: RunNames,
}

/// Archive runs: they are paused, and lists leave them out.
#[derive(Debug, clap::Args)]
pub(super) struct ArchiveArgs {
    #[command(flatten)]
    names: RunNames,
}

pub(super) async fn pause(api: &ApiClient, args: &PauseArgs) -> anyhow::Result<()> {
    change(api, &args.names, "pause").await
}

pub(super) async fn resume(api: &ApiClient, args: &ResumeArgs) -> anyhow::Result<()> {
    change(api, &args.names, "resume").await
}

pub(super) async fn archive(api: &ApiClient, args: &ArchiveArgs) -> anyhow::Result<()> {
    change(api, &args.names, "archive").await
}

/// Applies an action to all named runs. All names are resolved before the first change.
async fn change(api: &ApiClient, names: &RunNames, action: &str) -> anyhow::Result<()> {
    let mut runs = Vec::new();
    if names.runs.is_empty() {
        runs.push(find_run(api, None).await?.id);
    }
    for name in &names.runs {
        runs.push(find_run(api, Some(name)).await?.id);
    }
    let mut changed: Vec<RunSummary> = Vec::new();
    for run in runs {
        changed.push(api.post_empty(&format!("/v1/runs/{run}/{action}")).await?);
    }
    if names.output.json {
        return output::print_json(&changed);
    }
    let lines = changed.iter().map(|run| format!("{} is {}", run.id, status_name(run)));
    output::print(&lines.collect::<Vec<_>>().join("\n"))
}
