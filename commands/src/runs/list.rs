//! `sparring runs list`: lists runs, the newest first.

use api_types::{RunStatus, RunSummary};
use serde_json::Value;

use crate::api::{ApiClient, list_runs};
use crate::output::{self, Column, JsonFlag, OutputTarget, TextTable};

/// List runs, the newest first.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// List archived runs instead of the others
    #[arg(long)]
    archived: bool,
    /// List only the runs with this tag
    #[arg(long, value_name = "TAG")]
    tag: Option<String>,
    #[command(flatten)]
    output: JsonFlag,
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let mut runs = list_runs(api, args.archived, args.tag.as_deref()).await?;
    runs.reverse();
    if args.output.json {
        return output::print_json(&runs);
    }
    if runs.is_empty() && OutputTarget::stdout() != OutputTarget::Piped {
        return output::print(&match (args.archived, &args.tag) {
            (true, None) => "There are no archived runs.".to_owned(),
            (true, Some(tag)) => format!("There are no archived runs with the tag {tag}."),
            (false, None) => "There are no runs; `sparring runs create` creates one.".to_owned(),
            (false, Some(tag)) => {
                format!("There are no runs with the tag {tag}; `sparring runs tag` adds tags to runs.")
            }
        });
    }
    output::print(&table(&runs).render(OutputTarget::stdout()))
}

fn table(runs: &[RunSummary]) -> TextTable {
    let mut table = TextTable::new([
        Column::text("run"),
        Column::text("name"),
        Column::text("status"),
        Column::text("strategy").optional(2),
        Column::prose("tasks").optional(3),
        Column::number("policy version").optional(5),
        Column::prose("tags").optional(4),
        Column::text("created").optional(1),
    ]);
    for run in runs {
        table.add_row([
            run.id.clone(),
            run.name.clone(),
            status_name(run).to_owned(),
            strategy(&run.settings).to_owned(),
            tasks(&run.settings).join(", "),
            run.policy_version.to_string(),
            run.tags.join(", "),
            run.created_at.clone(),
        ]);
    }
    table
}

/// Returns the status of a run in one word.
pub(crate) const fn status_name(run: &RunSummary) -> &'static str {
    match (run.archived_at.is_some(), run.status) {
        (true, _) => "archived",
        (false, RunStatus::Active) => "active",
        (false, RunStatus::Paused) => "paused",
    }
}

/// Returns the strategy in a run's settings.
pub(super) fn strategy(settings: &Value) -> &str {
    settings["curriculum"]["strategy"].as_str().unwrap_or_default()
}

/// Returns the ids of the tasks in a run's settings.
pub(super) fn tasks(settings: &Value) -> Vec<&str> {
    let tasks = settings["curriculum"]["tasks"].as_array();
    tasks.into_iter().flatten().filter_map(|task| task["task"].as_str()).collect()
}
