//! Series of a run over time or over episodes.

use api_types::{ParamSeries, RunSeries, SeriesQuery, TaskSeries};
use axum::extract::State;
use store::history::HistoryBucket;

use super::run_points::{CurrentPoints, read_run_points};
use crate::api_enums::ConvertEnum;
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::current_mastery::CurrentMastery;
use crate::queries::run_series::{SeriesContent, SeriesPoint};
use clock::rfc3339;

/// Appends a point to the series of a task.
fn push_point(series: &mut TaskSeries, point: &SeriesPoint) {
    let mean = |sum: f64, n: i64| (n > 0).then(|| sum / n as f64);
    let SeriesPoint { from, to, position, bucket } = point;
    let mastery = bucket.mastery;
    series.at.push(*from as f64 / 1000.0);
    series.until.push(*to as f64 / 1000.0);
    series.first_episode.push(position.map(|at| at.first_episode));
    series.first_step.push(position.map(|at| at.first_step));
    series.steps.push(position.map(|_| bucket.steps));
    series.version_low.push(bucket.versions.map(|versions| versions.low));
    series.version_high.push(bucket.versions.map(|versions| versions.high));
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

fn task_series(task: String, points: &[SeriesPoint]) -> TaskSeries {
    let mut series = TaskSeries { task, ..TaskSeries::default() };
    points.iter().for_each(|point| push_point(&mut series, point));
    series
}

/// Get the series of a run: success, skill, mastery, levels and params of each task, over time or over episodes.
///
/// Over time, a point covers an interval with results, of at least one minute in the last week and one hour before; a run or a window
/// of some minutes has points of consecutive episodes instead. Over episodes, a task has at most 1 025 points for its whole training.
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
    let CurrentPoints { mut points, is_current } =
        read_run_points(&mut conn, &run, &query, SeriesContent::Results, app.clock.now()).await?;
    if is_current {
        points.set_current_mastery(&app.writer.query(CurrentMastery { run }).await?);
    }
    Ok(axum::Json(RunSeries {
        from: rfc3339(points.from),
        to: rfc3339(points.to),
        resolution: points.resolution.convert(),
        tasks: points.tasks.into_iter().map(|(task, points)| task_series(task, &points)).collect(),
    }))
}
