//! Time series of a run.

use api_types::{ParamSeries, RunSeries, SeriesQuery, TaskSeries};
use axum::extract::State;
use store::history::{self, HistoryBucket, HistoryPoint, HistoryWindow};

use super::time_window::{TimeWindow, read_points};
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::current_mastery::{CurrentMastery, update_last_points};
use clock::{Millis, rfc3339};

/// Appends a point to the series of a task.
fn push_point(series: &mut TaskSeries, start: Millis, bucket: &HistoryBucket) {
    let mean = |sum: f64, n: i64| (n > 0).then(|| sum / n as f64);
    let mastery = bucket.mastery;
    series.at.push(start.div_euclid(1000));
    series.episodes.push(bucket.episodes);
    series.claimed.push(bucket.claimed_episodes);
    let lost = bucket.failed + bucket.expired;
    series.lost.push(lost);
    series.success.push(mean(bucket.successes as f64, bucket.episodes + lost));
    series.score.push(mean(bucket.score_sum, bucket.episodes));
    series.duration_s.push(mean(bucket.durations.seconds, bucket.durations.episodes));
    series.skill.push(mean(bucket.skill_sum, bucket.episodes_with_skill));
    series.contested_success.push(mean(bucket.success_rate_sum, bucket.contested_groups));
    series.contested_scenarios.push(bucket.contested_groups);
    series.panel_success.push(mean(bucket.panel_success_rate_sum, bucket.panel_groups));
    series.zero_variance_share.push(mean(bucket.zero_variance_groups as f64, bucket.groups));
    series.level_low.push(bucket.lowest_level);
    series.level_high.push(bucket.highest_level);
    series.level.push(mastery.and_then(|at| at.level));
    series.mastery.push(mastery.map(|at| at.mean));
    series.mastery_low.push(mastery.map(|at| at.q10));
    series.mastery_high.push(mastery.map(|at| at.q90));
    push_params(series, bucket);
}

/// Appends a value or null to each param. A param that appears late has nulls before.
fn push_params(series: &mut TaskSeries, bucket: &HistoryBucket) {
    let earlier = series.at.len() - 1;
    for name in bucket.params.keys() {
        series.params.entry(name.clone()).or_insert_with(|| ParamSeries {
            mean: vec![None; earlier],
            low: vec![None; earlier],
            high: vec![None; earlier],
        });
    }
    for (name, values) in &mut series.params {
        let spread = bucket.params.get(name);
        values.mean.push(spread.map(|spread| spread.total / spread.n.max(1) as f64));
        values.low.push(spread.map(|spread| spread.low));
        values.high.push(spread.map(|spread| spread.high));
    }
}

/// Groups points by task. A gap without results has an empty point at its start and at its end, since a line across it would show
/// values that were never measured.
fn series_by_task(points: Vec<HistoryPoint>, width: Millis) -> Vec<TaskSeries> {
    let mut tasks = Vec::<TaskSeries>::new();
    for HistoryPoint { task, start, bucket } in points {
        if tasks.last().is_none_or(|last| last.task != task) {
            tasks.push(TaskSeries { task, ..TaskSeries::default() });
        }
        if let Some(last) = tasks.last_mut() {
            let gap = last.at.last().map(|at| (at * 1000 + width, start - width));
            if let Some((first, end)) = gap.filter(|(first, end)| first <= end) {
                push_point(last, first, &HistoryBucket::default());
                if first < end {
                    push_point(last, end, &HistoryBucket::default());
                }
            }
            push_point(last, start, &bucket);
        }
    }
    tasks
}

/// Get the time series of a run: success, skill, mastery, levels and params of each task.
///
/// A point covers an interval with results, of at least one minute in the last week and one hour before.
#[utoipa::path(
    get, path = "/runs/{run}/series", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), SeriesQuery),
    responses(
        (status = 200, body = RunSeries), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn get_series(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<SeriesQuery>,
) -> Result<axum::Json<RunSeries>, Problem> {
    let run = parse_run_id(&run)?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let now = app.clock.now();
    let TimeWindow { from, to } =
        TimeWindow::read(&mut conn, &run, query.from.as_ref(), query.to.as_ref(), now).await?;
    let window = HistoryWindow::new(from, to, i64::from(read_points(query.points)?), now);
    let mut points = history::curve(&mut conn, run.as_str(), window).await?;
    if to >= now {
        update_last_points(&mut points, &app.writer.query(CurrentMastery { run }).await?);
    }
    let tasks = series_by_task(points, window.width);
    Ok(axum::Json(RunSeries {
        from: rfc3339(window.from),
        to: rfc3339(window.to),
        width_s: window.width / 1000,
        tasks,
    }))
}
