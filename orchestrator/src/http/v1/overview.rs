//! Overview of a run.

use crate::api_enums::ConvertEnum;
use api_types::{LatestEvent, RunOverview, TaskOverview};
use axum::extract::State;
use store::history::{self, HistoryWindow, MINUTE};
use store::{events, overview, runs};

use crate::engine::error::ServiceError;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::run_series::{RunPoints, SeriesContent, SeriesPoint, points_over_time};
use crate::queries::task_levels::{TaskLevel, TaskLevelsQuery};
use clock::rfc3339;

/// Number of parts of the skill series.
const SKILL_POINTS: usize = 60;
/// Window of the throughput, in minutes.
const THROUGHPUT_MINUTES: i64 = 5;

/// Get the overview of a run: results, throughput and levels.
#[utoipa::path(
    get, path = "/runs/{run}/overview", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = RunOverview), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn get_overview(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunOverview>, Problem> {
    let run = parse_run_id(&run)?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let now = app.clock.now();
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let (from, recent) = (row.created_at, now - THROUGHPUT_MINUTES * MINUTE);
    let span = history::active_span(&mut conn, run.as_str()).await?;
    let skill = match span {
        Some(span) => {
            let window = HistoryWindow::new(span.first_at, span.last_at + 1, SKILL_POINTS as i64, now);
            let content = SeriesContent::Results;
            skill_series(&points_over_time(&mut conn, run.as_str(), window, SKILL_POINTS, content).await?)
        }
        None => Vec::new(),
    };
    let recent_window = HistoryWindow::new(recent, now, THROUGHPUT_MINUTES, now);
    let recent_points = history::curve(&mut conn, run.as_str(), recent_window).await?;
    let reported: i64 =
        recent_points.iter().map(|point| point.bucket.episodes + point.bucket.claimed_episodes).sum();
    // The first minute of the window is usually longer ago than five minutes.
    let seconds = (now - recent_window.from.max(from)).max(1000) as f64 / 1000.0;
    let counts = overview::counts(&mut conn, run.as_str()).await?;
    let last = events::last(&mut conn, run.as_str()).await?;
    let tasks = app.writer.query(TaskLevelsQuery { run: run.clone() }).await?;
    Ok(axum::Json(RunOverview {
        run: run.to_string(),
        episodes: counts.episodes,
        episodes_per_s: reported as f64 / seconds,
        first_results_at: span.map(|span| rfc3339(span.first_at)),
        last_results_at: span.map(|span| rfc3339(span.last_at)),
        leases: counts.leases,
        prepared: counts.prepared,
        proposed: counts.proposed,
        tasks: tasks.into_iter().map(TaskOverview::from).collect(),
        skill,
        latest_event: last.map(|last| LatestEvent { kind: last.kind.convert(), at: rfc3339(last.at) }),
    }))
}

impl From<TaskLevel> for TaskOverview {
    fn from(TaskLevel { task, level, mastery, held_back }: TaskLevel) -> Self {
        let known = mastery.as_ref();
        Self {
            task,
            level: level.map(i64::from),
            mastery: known.map(|known| known.mean),
            mastery_low: known.map(|known| known.q10),
            mastery_high: known.map(|known| known.q90),
            missing: known.map(|known| known.missing),
            held_back,
        }
    }
}

/// Mean skill of all tasks in equal parts of the time of the points.
fn skill_series(points: &RunPoints) -> Vec<Option<f64>> {
    let all = || points.tasks.values().flatten();
    let (from, to) = (all().map(|point| point.from).min(), all().map(|point| point.to).max());
    let most = points.tasks.values().map(Vec::len).max().unwrap_or(0);
    let parts = most.min(SKILL_POINTS);
    let mut sums = vec![(0.0, 0_i64); parts];
    let Some((from, duration)) = from.zip(to).map(|(from, to)| (from, (to - from).max(1))) else {
        return Vec::new();
    };
    for SeriesPoint { from: begin, to: end, bucket, .. } in all() {
        let at = (begin.midpoint(*end) - from) as f64 / duration as f64 * parts as f64;
        // Results of one moment at the end belong to the last part.
        if let Some(sum) = sums.get_mut((at as usize).min(parts.saturating_sub(1))) {
            *sum = (sum.0 + bucket.skill_sum, sum.1 + bucket.episodes_with_skill);
        }
    }
    sums.into_iter().map(|(sum, n)| (n > 0).then(|| sum / n as f64)).collect()
}
