//! `sparring runs show`: shows one run with its progress.

use api_types::{Run, RunMastery, RunOverview};
use serde::Serialize;

use super::list::{status_name, strategy};
use super::tag::listed;
use crate::api::{ApiClient, find_run};
use crate::output::{self, Column, JsonFlag, Report, TextTable};

/// Show a run: its progress by task, its settings and warnings.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Run to show [default: the only run]
    #[arg(value_name = "RUN")]
    run: Option<String>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Run with its progress.
#[derive(Debug, Serialize)]
pub(crate) struct RunDetails {
    #[serde(flatten)]
    run: Run,
    overview: RunOverview,
    mastery: RunMastery,
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let id = find_run(api, args.run.as_deref()).await?.id;
    let details = RunDetails::fetch(api, &id).await?;
    if args.output.json { output::print_json(&details) } else { output::print_report(&details.report()) }
}

impl RunDetails {
    /// Fetches a run with its progress.
    pub(crate) async fn fetch(api: &ApiClient, id: &str) -> anyhow::Result<Self> {
        Ok(Self {
            run: api.get(&format!("/v1/runs/{id}")).await?,
            overview: api.get(&format!("/v1/runs/{id}/overview")).await?,
            mastery: api.get(&format!("/v1/runs/{id}/mastery")).await?,
        })
    }

    /// Reports the progress, the settings and the warnings.
    pub(crate) fn report(&self) -> Report {
        let Self { run: Run { summary, warnings, .. }, overview, mastery } = self;
        let mut report = Report::default();
        report.paragraph(format!(
            "Run {} ({}): {}, seed {}, created {}.",
            summary.id,
            summary.name,
            status_name(summary),
            summary.seed,
            summary.created_at
        ));
        if summary.seed_reused {
            report
                .line("Another run has or had the same seed, so the scenarios and their plans may be known.");
        }
        if !summary.tags.is_empty() {
            report.line(format!("Tags: {}.", summary.tags.join(", ")));
        }
        if let Some(owner) = &summary.owner {
            report.line(format!("Owner: {owner}. Members: {}.", listed(&summary.members)));
        }
        report.line(format!(
            "{} episodes, {:.1} episodes/s over the last 5 minutes, {} active leases, policy version {}.",
            overview.episodes, overview.episodes_per_s, overview.leases, summary.policy_version
        ));
        report.line(format!("Strategy {}: {}", strategy(&summary.settings), mastery.explanation.summary));
        report.separate_table(task_table(mastery));
        for task in &mastery.explanation.tasks {
            report.paragraph(format!("{}: {}", task.task, task.current_state));
            if let Some(last) = &task.last_move {
                report.item(format!("Last level move: {last}"));
            }
        }
        for task in &mastery.tasks {
            for warning in &task.warnings {
                report.paragraph(format!("Warning of {}: {warning}", task.task));
            }
        }
        for warning in &warnings.newest {
            report.paragraph(format!("Warning at {}: {}", warning.at, warning.message));
        }
        report
    }
}

fn task_table(mastery: &RunMastery) -> TextTable {
    const NONE: &str = "–";
    let share = |value: Option<f64>| value.map_or_else(|| NONE.to_owned(), |value| format!("{value:.2}"));
    let mut table = TextTable::new([
        Column::text("task"),
        Column::number("level"),
        Column::number("mastery (10–90\u{a0}%)"),
        Column::number("block").optional(2),
        Column::number("success"),
        Column::number("skill"),
        Column::number("episodes").optional(1),
    ]);
    for task in &mastery.tasks {
        let level = match (task.level, task.probe_level) {
            (Some(level), _) => level.to_string(),
            (None, Some(probe)) => format!("probing {probe}"),
            (None, None) => NONE.to_owned(),
        };
        let mastery = task.mastery.filter(|known| known.n > 0);
        let block = task.status.block.as_ref();
        table.add_row([
            task.task.clone(),
            level,
            mastery.map_or_else(|| NONE.to_owned(), |m| format!("{:.2} ({:.2}–{:.2})", m.mean, m.q10, m.q90)),
            block.map_or_else(|| NONE.to_owned(), |block| format!("{}/{}", block.n, block.size)),
            share(task.results.success),
            share(task.results.skill),
            task.results.episodes.to_string(),
        ]);
    }
    table
}
