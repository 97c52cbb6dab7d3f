//! What a report tells, from the database.

use anyhow::{Context, bail};
use env_core::TaskSpec;
use sqlx::{Acquire, SqliteConnection};

use orchestrator::clock::Millis;
use orchestrator::evaluation::report::ReportRow;
use orchestrator::store::layouts::{self, LayoutRow, LayoutFilter};
use orchestrator::store::curriculum::{self, LevelMoveRow};
use orchestrator::store::evaluations::{self, EvaluationRow, EvaluationState};
use orchestrator::store::failures::{self, FailureCell};
use orchestrator::store::history::{self, HistoryPoint, HistoryWindow};
use orchestrator::store::runs::{self, RunRow};
use orchestrator::store::task_counters::TaskCounters;
use orchestrator::store::overview;
use orchestrator::evaluation::read;
use orchestrator::engine::task_history::standings;
use orchestrator::queries::run_progress::RunProgress;
use orchestrator::queries::standing::update_last_points;
use ::curriculum::{Explanation, Mastery, TaskStatus};

/// Points of a curve.
const POINTS: i64 = 240;
/// Layouts that are named: those that the agent fails most.
const LAYOUTS: usize = 12;
/// How many are read at a time: of layouts and evaluations the newest so many.
const MOST: i64 = 500;

/// A run, as it is told.
pub(super) struct Told {
    /// The run.
    pub(super) row: RunRow,
    /// When this was.
    pub(super) now: Millis,
    /// How long a point of its curves is, milliseconds.
    pub(super) width: Millis,
    /// When its curves begin and end.
    pub(super) stretch: (Millis, Millis),
    /// Episodes that finished, on designed layouts and in accepted columns, too.
    pub(super) episodes: i64,
    /// The rules that it goes by, in words.
    pub(super) explanation: Explanation,
    /// Its tasks.
    pub(super) tasks: Vec<Task>,
    /// The layouts that the agent fails most, of those that were flown.
    pub(super) layouts: Vec<LayoutRow>,
    /// Its evaluations that are complete, with all tasks and parts of each.
    pub(super) evaluations: Vec<(EvaluationRow, Vec<ReportRow>)>,
}

/// A task of it.
pub(super) struct Task {
    /// The task.
    pub(super) spec: &'static dyn TaskSpec,
    /// Where it stands.
    pub(super) status: TaskStatus,
    /// What was mastered at that level.
    pub(super) mastery: Option<Mastery>,
    /// Plain sums: what was designed or claimed is not in them.
    pub(super) sums: TaskCounters,
    /// Its curves.
    pub(super) points: Vec<HistoryPoint>,
    /// How its level moved.
    pub(super) moves: Vec<LevelMoveRow>,
    /// What it fails at.
    pub(super) failures: Vec<FailureCell>,
}

/// Reads all of it in one transaction, so that it is of one moment.
pub(super) async fn gather(conn: &mut SqliteConnection, run: &str, now: Millis) -> anyhow::Result<Told> {
    let mut conn = conn.begin().await?;
    let Some(row) = runs::get(&mut conn, run).await? else { bail!("there is no run {run}") };
    let standing = RunProgress::stored(&mut conn, run).await.context("the run's curriculum")?;
    let RunProgress { status, mastery, explanation, sums: plain, .. } = standing;
    let window = HistoryWindow::new(row.created_at, now, POINTS, now);
    let mut points = history::curve(&mut conn, run, window).await?;
    update_last_points(&mut points, &standings(&status, &mastery));
    let moves = all_moves(&mut conn, run).await?;
    let mut tasks = Vec::new();
    for status in status {
        let Some(spec) = env_core::task(&status.task) else { continue };
        let failures = failures::profile(&mut conn, run, &status.task).await?;
        let of = |task: &str| task == status.task;
        tasks.push(Task {
            spec,
            mastery: mastery.iter().find(|m| of(&m.task) && m.level == status.level).cloned(),
            sums: plain.get(&status.task).cloned().unwrap_or_default(),
            points: points.iter().filter(|point| of(&point.task)).cloned().collect(),
            moves: moves.iter().filter(|row| of(&row.task)).cloned().collect(),
            failures,
            status,
        });
    }
    let episodes = overview::counts(&mut conn, run).await?.episodes;
    let begins = points.iter().map(|point| point.start).min().unwrap_or(window.from);
    let ends = points.iter().map(|point| point.start + window.width).max().unwrap_or(window.to);
    Ok(Told {
        episodes,
        explanation,
        tasks,
        layouts: hardest(&mut conn, run).await?,
        evaluations: evaluated(&mut conn, run).await?,
        width: window.width,
        stretch: (begins, ends),
        now,
        row,
    })
}

async fn all_moves(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<LevelMoveRow>> {
    let mut all: Vec<LevelMoveRow> = Vec::new();
    loop {
        let after = all.last().map_or(-1, |row| row.seq);
        let page = curriculum::moves(conn, run, after, MOST).await?;
        if page.is_empty() {
            return Ok(all);
        }
        all.extend(page);
    }
}

/// The newest layouts that were flown, those that the agent fails most first.
async fn hardest(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<LayoutRow>> {
    let mut flown = layouts::of_run(conn, run, &LayoutFilter::default(), i64::MAX, MOST).await?;
    flown.retain(|row| row.episodes > 0);
    let share = |row: &LayoutRow| row.successes as f64 / row.episodes as f64;
    flown.sort_by(|a, b| share(a).total_cmp(&share(b)).then(b.episodes.cmp(&a.episodes)));
    flown.truncate(LAYOUTS);
    Ok(flown)
}

async fn evaluated(
    conn: &mut SqliteConnection,
    run: &str,
) -> anyhow::Result<Vec<(EvaluationRow, Vec<ReportRow>)>> {
    let mut found = Vec::new();
    for row in evaluations::page(conn, i64::MAX, MOST).await? {
        if row.run.as_deref() == Some(run) && row.state == EvaluationState::Complete {
            let flown = read::read(conn, row.id).await?;
            found.push((row, read::report(&flown)?.rows));
        }
    }
    found.reverse();
    Ok(found)
}
