//! Reads the compared runs from the database.

use std::collections::BTreeMap;

use anyhow::bail;
use clock::Millis;
use orchestrator::evaluations::read;
use orchestrator::queries::run_series::{EpisodeRange, points_over_episodes};
use sqlx::{Acquire, SqliteConnection};
use store::evaluations::{self, EvaluationRow, EvaluationState};
use store::from_json;
use store::overview;
use store::runs;

use super::compared_run::ComparedRun;
use super::curves::{FigureAxis, Line, Quantity, line};
use super::figure::{Figure, task_figure};
use super::groups::{Grouping, RunGroup, group_runs};

/// Number of points of a run's curve.
const CURVE_POINTS: usize = 300;
/// Number of the newest evaluations among which those of the runs are.
const MAX_EVALUATIONS: i64 = 2000;

/// Contents of a comparison.
pub(in crate::report) struct Comparison {
    /// Time of the report.
    pub(super) now: Millis,
    /// Runs in the order in which the user named them.
    pub(super) runs: Vec<ComparedRun>,
    /// Groups of the runs whose curves are averaged.
    pub(super) groups: Vec<RunGroup>,
    /// Figures and final values of each task.
    pub(super) tasks: Vec<TaskComparison>,
}

/// Comparison on one task.
pub(in crate::report) struct TaskComparison {
    /// Id of the task.
    pub(super) task: String,
    /// One figure for each quantity that a run has.
    pub(super) figures: Vec<Figure>,
    /// Lines of the runs by quantity, in the order of the figures and of the runs.
    pub(super) lines: Vec<(Quantity, Vec<Line>)>,
}

impl Comparison {
    /// Returns the number of all figures.
    pub(in crate::report) fn figures(&self) -> usize {
        self.tasks.iter().map(|task| task.figures.len()).sum()
    }

    /// Returns the number of runs, and of groups if any has several runs, as text.
    pub(in crate::report) fn describe(&self) -> String {
        let runs = self.runs.len();
        let groups = self.groups.iter().filter(|group| group.runs.len() > 1).count();
        let noun = |n: usize, noun: &str| format!("{n} {noun}{}", if n == 1 { "" } else { "s" });
        match groups {
            0 => noun(runs, "run"),
            _ => format!("{} in {}", noun(runs, "run"), noun(self.groups.len(), "group")),
        }
    }
}

/// Reads the runs in one transaction, so that all parts belong to one moment.
///
/// # Errors
/// Returns an error if a run does not exist or the database cannot be read.
pub(in crate::report) async fn gather(
    conn: &mut SqliteConnection,
    ids: &[String],
    grouping: Grouping,
    axis: FigureAxis,
    now: Millis,
) -> anyhow::Result<Comparison> {
    let mut conn = conn.begin().await?;
    let all = evaluations::page(&mut conn, i64::MAX, MAX_EVALUATIONS).await?;
    let mut runs = Vec::with_capacity(ids.len());
    for id in ids {
        runs.push(read_run(&mut conn, id, &all).await?);
    }
    let groups = group_runs(&runs, grouping);
    let mut names: Vec<String> = Vec::new();
    for task in runs.iter().flat_map(|run| run.points.keys()) {
        if !names.contains(task) {
            names.push(task.clone());
        }
    }
    let tasks = names.into_iter().map(|task| compare_task(task, &runs, &groups, axis)).collect();
    Ok(Comparison { now, runs, groups, tasks })
}

async fn read_run(
    conn: &mut SqliteConnection,
    id: &str,
    all: &[EvaluationRow],
) -> anyhow::Result<ComparedRun> {
    let Some(row) = runs::get(conn, id).await? else { bail!("there is no run {id}") };
    let mut loaded = Vec::new();
    for row in newest_evaluations(id, all) {
        loaded.push(read::load_evaluation(conn, row.id).await?);
    }
    Ok(ComparedRun {
        settings: from_json("a run's settings", &row.settings)?,
        episodes: overview::counts(conn, id).await?.episodes,
        points: points_over_episodes(conn, id, EpisodeRange { from: 0, to: i64::MAX }, CURVE_POINTS).await?,
        evaluations: loaded,
        row,
    })
}

/// Returns the complete evaluation of the highest policy version on each suite; `all` has the newest first.
fn newest_evaluations<'a>(run: &str, all: &'a [EvaluationRow]) -> Vec<&'a EvaluationRow> {
    let mut newest = BTreeMap::<&str, &EvaluationRow>::new();
    for row in all {
        if row.run.as_deref() == Some(run) && row.state == EvaluationState::Complete {
            let best = newest.entry(&row.suite_hash).or_insert(row);
            if row.policy_version > best.policy_version {
                *best = row;
            }
        }
    }
    newest.into_values().collect()
}

fn compare_task(task: String, runs: &[ComparedRun], groups: &[RunGroup], axis: FigureAxis) -> TaskComparison {
    let lines_of = |quantity: Quantity| -> Vec<Line> {
        let of = |run: &ComparedRun| {
            let points = run.points.get(&task).map_or(&[][..], Vec::as_slice);
            line(quantity, points, axis, run.row.created_at)
        };
        runs.iter().map(of).collect()
    };
    let lines: Vec<(Quantity, Vec<Line>)> = Quantity::ALL
        .into_iter()
        .map(|quantity| (quantity, lines_of(quantity)))
        .filter(|(_, lines)| lines.iter().any(|line| !line.points.is_empty()))
        .collect();
    let figures =
        lines.iter().map(|(quantity, lines)| task_figure(&task, *quantity, axis, lines, groups)).collect();
    TaskComparison { task, figures, lines }
}
