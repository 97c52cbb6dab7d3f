//! Reads the contents of a report from the database.

use std::ops::Range;

use anyhow::{Context, bail};
use api_types::EvaluationEstimates;
use env_core::TaskSpec;
use sqlx::{Acquire, SqliteConnection};

use ::curriculum::{Explanation, Mastery, SamplerState, TaskStatus};
use clock::Millis;
use orchestrator::engine::task_history::mastery_samples;
use orchestrator::evaluations::read;
use orchestrator::queries::run_progress::RunProgress;
use orchestrator::queries::run_series::{SeriesContent, SeriesPoint, points_over_time};
use store::curriculum::{self, LevelMoveRow};
use store::evaluations::{self, EvaluationRow, EvaluationState};
use store::failures::{self, FailureCell};
use store::history::HistoryWindow;
use store::layouts::{self, LayoutFilter, LayoutRow};
use store::overview;
use store::runs::{self, RunRow};
use store::task_counters::TaskCounters;

/// Number of points of a curve.
const CURVE_POINTS: i64 = 240;
/// Largest number of listed layouts: those that the agent fails most often.
pub(super) const MAX_LAYOUTS: usize = 12;
/// Rows read at a time. Of layouts and evaluations, only the newest page is read.
const PAGE_SIZE: i64 = 500;

/// Contents of a run's report.
pub(super) struct RunReport {
    /// Row of the run.
    pub(super) row: RunRow,
    /// Time of the report.
    pub(super) now: Millis,
    /// Time range of the curves.
    pub(super) range: Range<Millis>,
    /// Finished episodes, including those on designed layouts and in accepted columns.
    pub(super) episodes: i64,
    /// Rules of the curriculum as text.
    pub(super) explanation: Explanation,
    /// Tasks of the run.
    pub(super) tasks: Vec<TaskReport>,
    /// Layouts that the agent fails most often, of those with episodes.
    pub(super) layouts: Vec<LayoutRow>,
    /// Complete evaluations of the run, the oldest first.
    pub(super) evaluations: Vec<EvaluationResult>,
}

/// Complete evaluation with its rows for all tasks and parts.
pub(super) struct EvaluationResult {
    /// Row of the evaluation.
    pub(super) evaluation: EvaluationRow,
    /// Results by task, part and policy.
    pub(super) rows: Vec<EvaluationEstimates>,
}

/// Contents of the report for one task.
pub(super) struct TaskReport {
    /// Specification of the task.
    pub(super) spec: &'static dyn TaskSpec,
    /// Current level and params.
    pub(super) status: TaskStatus,
    /// Sampler of the task.
    pub(super) sampler: Option<SamplerState>,
    /// Mastery of the current level.
    pub(super) mastery: Option<Mastery>,
    /// Counters over all episodes except those of designed layouts and claimed columns.
    pub(super) sums: TaskCounters,
    /// Points of the curves.
    pub(super) points: Vec<SeriesPoint>,
    /// Level moves, the oldest first.
    pub(super) moves: Vec<LevelMoveRow>,
    /// Failures by mode and encounter.
    pub(super) failures: Vec<FailureCell>,
}

/// Reads the report in one transaction, so that all parts belong to one moment.
///
/// # Errors
/// Returns an error if the run does not exist or the database cannot be read.
pub(super) async fn gather(conn: &mut SqliteConnection, run: &str, now: Millis) -> anyhow::Result<RunReport> {
    let mut conn = conn.begin().await?;
    let Some(row) = runs::get(&mut conn, run).await? else { bail!("there is no run {run}") };
    let progress = RunProgress::stored(&mut conn, run).await.context("the run's curriculum")?;
    let RunProgress { status, mastery, explanation, samplers, sums: plain, .. } = progress;
    let window = HistoryWindow::new(row.created_at, now, CURVE_POINTS, now);
    let mut points =
        points_over_time(&mut conn, run, window, CURVE_POINTS as usize, SeriesContent::Results).await?;
    points.set_current_mastery(&mastery_samples(&status, &mastery));
    let all = || points.tasks.values().flatten();
    let begins = all().map(|point| point.from).min().unwrap_or(window.from);
    let ends = all().map(|point| point.to).max().unwrap_or(window.to);
    let moves = all_moves(&mut conn, run).await?;
    let mut tasks = Vec::new();
    for status in status {
        let Some(spec) = env_core::task(&status.task) else { continue };
        let failures = failures::profile(&mut conn, run, &status.task).await?;
        let of = |task: &str| task == status.task;
        tasks.push(TaskReport {
            spec,
            sampler: samplers.iter().find(|sampler| of(&sampler.task)).cloned(),
            mastery: mastery.iter().find(|m| of(&m.task) && m.level == status.level).cloned(),
            sums: plain.get(&status.task).cloned().unwrap_or_default(),
            points: points.tasks.get(&status.task).cloned().unwrap_or_default(),
            moves: moves.iter().filter(|row| of(&row.task)).cloned().collect(),
            failures,
            status,
        });
    }
    let episodes = overview::counts(&mut conn, run).await?.episodes;
    Ok(RunReport {
        episodes,
        explanation,
        tasks,
        layouts: hardest_layouts(&mut conn, run).await?,
        evaluations: complete_evaluations(&mut conn, run).await?,
        range: begins..ends,
        now,
        row,
    })
}

async fn all_moves(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<LevelMoveRow>> {
    let mut all: Vec<LevelMoveRow> = Vec::new();
    loop {
        let after = all.last().map_or(-1, |row| row.seq);
        let page = curriculum::moves(conn, run, after, PAGE_SIZE).await?;
        if page.is_empty() {
            return Ok(all);
        }
        all.extend(page);
    }
}

/// Returns the newest layouts with episodes, sorted by the agent's share of successes.
async fn hardest_layouts(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<LayoutRow>> {
    let mut hardest = layouts::of_run(conn, run, &LayoutFilter::default(), i64::MAX, PAGE_SIZE).await?;
    hardest.retain(|row| row.episodes > 0);
    let share = |row: &LayoutRow| row.successes as f64 / row.episodes as f64;
    hardest.sort_by(|a, b| share(a).total_cmp(&share(b)).then(b.episodes.cmp(&a.episodes)));
    hardest.truncate(MAX_LAYOUTS);
    Ok(hardest)
}

async fn complete_evaluations(
    conn: &mut SqliteConnection,
    run: &str,
) -> anyhow::Result<Vec<EvaluationResult>> {
    let mut found = Vec::new();
    for row in evaluations::page(conn, i64::MAX, PAGE_SIZE).await? {
        if row.run.as_deref() == Some(run) && row.state == EvaluationState::Complete {
            let evaluation = read::load_evaluation(conn, row.id).await?;
            let rows = read::report_evaluation(&evaluation)?.rows;
            found.push(EvaluationResult { evaluation: row, rows });
        }
    }
    found.reverse();
    Ok(found)
}
