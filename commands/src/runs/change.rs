//! `sparring runs pause`, `resume` and `archive`: change the status of runs.

use api_types::{ArchiveRequest, ArchivedRuns, RunSummary};
use clock::{Clock, rfc3339};

use super::list::status_name;
use crate::api::{ApiClient, find_run, list_runs};
use crate::output::{self, JsonFlag};

/// Largest number of runs that one request archives.
const MAX_RUNS_PER_REQUEST: usize = 1000;
/// Milliseconds of a day.
const MILLIS_PER_DAY: i64 = 24 * 3600 * 1000;

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
#[command(after_help = "\
`sparring runs resume` restores an archived run.

Examples:
  sparring runs archive baseline
  sparring runs archive --tag sweep-3
  sparring runs archive --older-than 30")]
pub(super) struct ArchiveArgs {
    #[command(flatten)]
    names: RunNames,
    /// Archive all runs with this tag
    #[arg(long, value_name = "TAG", conflicts_with = "runs")]
    tag: Option<String>,
    /// Archive all runs that were created more than this many days ago
    #[arg(long, value_name = "DAYS", conflicts_with = "runs")]
    older_than: Option<u32>,
}

pub(super) async fn pause(api: &ApiClient, args: &PauseArgs) -> anyhow::Result<()> {
    change(api, &args.names, "pause").await
}

pub(super) async fn resume(api: &ApiClient, args: &ResumeArgs) -> anyhow::Result<()> {
    change(api, &args.names, "resume").await
}

pub(super) async fn archive(api: &ApiClient, args: &ArchiveArgs) -> anyhow::Result<()> {
    if args.tag.is_none() && args.older_than.is_none() {
        return change(api, &args.names, "archive").await;
    }
    let latest =
        args.older_than.map(|days| Clock::system().now() - i64::from(days) * MILLIS_PER_DAY).map(rfc3339);
    let filter: Vec<_> = args.tag.iter().map(|tag| ("tag", tag.as_str())).collect();
    let mut runs = list_runs(api, &filter).await?;
    // Times in RFC 3339 with the same precision are ordered as text.
    runs.retain(|run| latest.as_ref().is_none_or(|latest| run.created_at < *latest));
    let mut archived = Vec::with_capacity(runs.len());
    for part in runs.chunks(MAX_RUNS_PER_REQUEST) {
        let request = ArchiveRequest { runs: part.iter().map(|run| run.id.clone()).collect() };
        let answer: ArchivedRuns = api.post("/v1/archive", &request).await?;
        archived.extend(answer.runs);
    }
    if archived.is_empty() && !args.names.output.json {
        return output::print("No run matches, so none was archived.");
    }
    print_changed(&archived, &args.names.output)
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
    print_changed(&changed, &names.output)
}

fn print_changed(changed: &[RunSummary], flag: &JsonFlag) -> anyhow::Result<()> {
    if flag.json {
        return output::print_json(&changed);
    }
    let lines = changed.iter().map(|run| format!("{} is {}", run.id, status_name(run)));
    output::print(&lines.collect::<Vec<_>>().join("\n"))
}
