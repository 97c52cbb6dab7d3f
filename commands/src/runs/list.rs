//! `sparring runs list`: lists runs, the newest first or in another order.

use api_types::{RunActivity, RunStatus, RunSummary};
use clap::builder::PossibleValuesParser;
use curriculum::StrategyKind;
use env_core::text::shorten;
use serde_json::Value;

use crate::api::{ApiClient, list_runs};
use crate::output::{self, Column, JsonFlag, OutputTarget, TextTable};

/// List runs, the newest first.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  sparring runs list --search 'baseline lr:3e-4'
  sparring runs list --activity running --sort skill
  sparring runs list --strategy plr --sort name --order asc")]
pub(super) struct Args {
    /// List archived runs instead of the others
    #[arg(long)]
    archived: bool,
    /// List only the runs with this tag
    #[arg(long, value_name = "TAG")]
    tag: Option<String>,
    /// List only the runs that have all of these words in their id, name, note or tags
    #[arg(long, value_name = "TEXT")]
    search: Option<String>,
    /// List only the runs with this strategy
    #[arg(long, value_name = "STRATEGY", value_parser = PossibleValuesParser::new(StrategyKind::ALL.map(StrategyKind::name)))]
    strategy: Option<String>,
    /// List only the runs with this activity
    #[arg(long, value_name = "ACTIVITY", value_parser = ["waiting", "running", "idle", "paused", "archived"])]
    activity: Option<String>,
    /// Value to sort by; runs without the value come last
    #[arg(long, value_name = "KEY", default_value = "created",
          value_parser = ["created", "name", "episodes", "last_results", "skill"])]
    sort: String,
    /// Direction of the order; desc lists the highest value first
    #[arg(long, value_name = "ORDER", default_value = "desc", value_parser = ["asc", "desc"])]
    order: String,
    #[command(flatten)]
    output: JsonFlag,
}

impl Args {
    /// Returns the parameters of the request.
    fn parameters(&self) -> Vec<(&str, &str)> {
        let mut parameters = vec![("sort", self.sort.as_str()), ("order", self.order.as_str())];
        if self.archived {
            parameters.push(("archived", "true"));
        }
        parameters.extend(self.filters());
        parameters
    }

    /// Returns the filters that are set.
    fn filters(&self) -> impl Iterator<Item = (&str, &str)> {
        let all = [
            ("tag", &self.tag),
            ("search", &self.search),
            ("strategy", &self.strategy),
            ("activity", &self.activity),
        ];
        all.into_iter().filter_map(|(name, value)| value.as_deref().map(|value| (name, value)))
    }

    /// Sentence that says why the list is empty.
    fn empty_text(&self) -> String {
        let archived = if self.archived { "archived " } else { "" };
        let only_tag = self.filters().all(|(name, _)| name == "tag");
        match &self.tag {
            _ if !only_tag => format!("No {archived}runs match these filters."),
            None if self.archived => "There are no archived runs.".to_owned(),
            None => "There are no runs; `sparring runs create` creates one.".to_owned(),
            Some(tag) if self.archived => format!("There are no archived runs with the tag {tag}."),
            Some(tag) => {
                format!("There are no runs with the tag {tag}; `sparring runs tag` adds tags to runs.")
            }
        }
    }
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let runs = list_runs(api, &args.parameters()).await?;
    if args.output.json {
        return output::print_json(&runs);
    }
    if runs.is_empty() && OutputTarget::stdout() != OutputTarget::Piped {
        return output::print(&args.empty_text());
    }
    output::print(&table(&runs).render(OutputTarget::stdout()))
}

/// Largest number of characters of a note in the table, which shows its first line.
const MAX_NOTE_CHARS: usize = 60;

fn table(runs: &[RunSummary]) -> TextTable {
    let mut table = TextTable::new([
        Column::text("run"),
        Column::text("name"),
        Column::text("activity"),
        Column::text("strategy").optional(2),
        Column::prose("tasks").optional(5),
        Column::number("episodes").optional(1),
        Column::number("skill").optional(1),
        Column::number("policy version").optional(7),
        Column::prose("tags").optional(4),
        Column::prose("note").optional(6),
        Column::text("created").optional(3),
    ]);
    for run in runs {
        table.add_row([
            run.id.clone(),
            run.name.clone(),
            activity_name(run.activity).to_owned(),
            strategy(&run.settings).to_owned(),
            tasks(&run.settings).join(", "),
            run.episodes.to_string(),
            run.skill.map_or_else(String::new, |skill| format!("{skill:.2}")),
            run.policy_version.to_string(),
            run.tags.join(", "),
            shorten(run.note.lines().next().unwrap_or_default(), MAX_NOTE_CHARS),
            run.created_at.clone(),
        ]);
    }
    table
}

/// Returns the activity of a run in one word.
const fn activity_name(activity: RunActivity) -> &'static str {
    match activity {
        RunActivity::Waiting => "waiting",
        RunActivity::Running => "running",
        RunActivity::Idle => "idle",
        RunActivity::Paused => "paused",
        RunActivity::Archived => "archived",
    }
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
