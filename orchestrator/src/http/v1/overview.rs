//! A run in a glance.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::{NoQuery, Path};
use super::super::problem::Problem;
use super::{reader_of, run_id};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::store::history::{self, MINUTE, HistoryPoint, HistoryWindow};
use crate::store::{events, overview, runs};
use crate::engine::error::ServiceError;
use crate::queries::task_levels::{TaskLevel, TaskLevelsQuery};

/// Points of the curve of skill.
const POINTS: i64 = 60;
/// Over how many minutes the pace is taken.
const PACE_MINUTES: i64 = 5;

/// A run in a glance.
#[derive(Serialize, ToSchema)]
pub(super) struct Overview {
    /// The run.
    run: String,
    /// Episodes that finished, those of columns included.
    episodes: i64,
    /// Episodes a second over the last five minutes.
    episodes_per_s: f64,
    /// Active leases.
    leases: i64,
    /// Scenarios that wait to be leased.
    prepared: i64,
    /// Proposals whose scenarios are being made.
    proposed: i64,
    /// Its tasks, and where they stand.
    tasks: Vec<TaskGlance>,
    /// Mean skill over the run's life in at most 60 parts, all tasks together; null where nothing came back.
    skill: Vec<Option<f64>>,
    /// What happened last.
    last: Option<Last>,
}

/// A task in a glance.
#[derive(Serialize, ToSchema)]
struct TaskGlance {
    /// The task.
    task: String,
    /// Its level; none where there are none, and during placement.
    level: Option<i64>,
    /// The posterior over success on contested scenarios there: its mean; none before there is evidence.
    mastery: Option<f64>,
    /// Its 10 % quantile.
    mastery_low: Option<f64>,
    /// Its 90 % quantile.
    mastery_high: Option<f64>,
}

/// What happened last.
#[derive(Serialize, ToSchema)]
struct Last {
    /// The kind of event.
    kind: String,
    /// When, RFC 3339.
    at: String,
}

/// Show a run in a glance: how much came back, how fast, where it stands.
#[utoipa::path(
    get, path = "/runs/{run}/overview", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = Overview), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Overview>, Problem> {
    let run = run_id(&run)?;
    let mut conn = reader_of(&app, &run).await?;
    let now = app.clock.now();
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let (from, recent) = (row.created_at, now - PACE_MINUTES * MINUTE);
    let window = HistoryWindow::new(from, now.max(from + POINTS * MINUTE), POINTS, now);
    let points = history::curve(&mut conn, run.as_str(), window).await?;
    let lately = HistoryWindow::new(recent, now, PACE_MINUTES, now);
    let pace = history::curve(&mut conn, run.as_str(), lately).await?;
    let came: i64 = pace.iter().map(|point| point.bucket.episodes + point.bucket.claimed).sum();
    // Since the first of these minutes began, not since so long ago.
    let over = (now - lately.from.max(from)).max(1000) as f64 / 1000.0;
    let counts = overview::counts(&mut conn, run.as_str()).await?;
    let last = events::last(&mut conn, run.as_str()).await?;
    let tasks = app.writer.query(TaskLevelsQuery { run: run.clone() }).await?;
    Ok(axum::Json(Overview {
        run: run.to_string(),
        episodes: counts.episodes,
        episodes_per_s: came as f64 / over,
        leases: counts.leases,
        prepared: counts.prepared,
        proposed: counts.proposed,
        tasks: tasks.into_iter().map(TaskGlance::of).collect(),
        skill: skill(&points, window, now),
        last: last.map(|last| Last { kind: last.kind.to_string(), at: rfc3339(last.at) }),
    }))
}

impl TaskGlance {
    fn of(TaskLevel { task, level, mastery }: TaskLevel) -> Self {
        let known = mastery.as_ref();
        Self {
            task,
            level: level.map(i64::from),
            mastery: known.map(|known| known.mean),
            mastery_low: known.map(|known| known.q10),
            mastery_high: known.map(|known| known.q90),
        }
    }
}

/// Mean skill of all tasks in each bucket of a window, as far as it has come.
fn skill(points: &[HistoryPoint], window: HistoryWindow, now: i64) -> Vec<Option<f64>> {
    let parts =
        usize::try_from((now - window.from) / window.width + 1).unwrap_or_default().min(POINTS as usize + 1);
    let mut sums = vec![(0.0, 0_i64); parts];
    for HistoryPoint { start, bucket, .. } in points {
        let at = usize::try_from((start - window.from) / window.width).unwrap_or_default();
        if let Some(sum) = sums.get_mut(at) {
            *sum = (sum.0 + bucket.skill, sum.1 + bucket.skilled);
        }
    }
    sums.into_iter().map(|(sum, n)| (n > 0).then(|| sum / n as f64)).collect()
}
