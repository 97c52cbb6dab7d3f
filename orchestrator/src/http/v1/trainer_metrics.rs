//! Metrics that a run's trainer logs about its training, such as a loss.

use std::sync::Arc;

use api_types::{
    TrainerMetric, TrainerMetrics, TrainerMetricsQuery, TrainerMetricsReceipt, TrainerMetricsRequest,
};
use axum::extract::State;
use store::trainer_metrics::{self, MetricName, MetricPoint, MetricWindow};

use super::time_window::{TimeWindow, read_points};
use crate::http::extract::{Json, NoQuery, Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::runs::log_metrics::LogMetrics;

/// Groups points by metric.
fn metrics_of(points: Vec<MetricPoint>) -> Vec<TrainerMetric> {
    let mut metrics = Vec::<TrainerMetric>::new();
    for MetricPoint { name, step, at, value, last_value } in points {
        if metrics.last().is_none_or(|last| last.name != name) {
            metrics.push(TrainerMetric { name, ..TrainerMetric::default() });
        }
        if let Some(metric) = metrics.last_mut() {
            metric.step.push(step);
            metric.at.push(at as f64 / 1000.0);
            metric.value.push(value);
            metric.last_value = last_value;
        }
    }
    metrics
}

/// Log metrics of the trainer, such as loss, KL divergence and entropy, at one of its steps.
///
/// A later request with the same step replaces its values, so that a request can be repeated. A run accepts ten requests a second, in
/// bursts of twenty. It has at most 100 metrics. Of a metric with more than 4 000 points, every second one is deleted.
#[utoipa::path(
    post, path = "/runs/{run}/metrics", tag = "mastery", request_body = TrainerMetricsRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = TrainerMetricsReceipt), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn log_trainer_metrics(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<TrainerMetricsRequest>,
) -> Result<axum::Json<TrainerMetricsReceipt>, Problem> {
    let run = parse_run_id(&run)?;
    let key: Arc<str> = run.as_str().into();
    let change = LogMetrics::from_request(run, request)?;
    app.metrics_rate.check(&key)?;
    Ok(axum::Json(app.writer.change(change).await?))
}

/// Get the metrics that the trainer of a run logged.
#[utoipa::path(
    get, path = "/runs/{run}/metrics", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), TrainerMetricsQuery),
    responses(
        (status = 200, body = TrainerMetrics), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn get_trainer_metrics(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<TrainerMetricsQuery>,
) -> Result<axum::Json<TrainerMetrics>, Problem> {
    let run = parse_run_id(&run)?;
    let name = query.name.as_deref().map(str::parse::<MetricName>).transpose();
    let name = name.map_err(|error| Problem::invalid("name", error.to_string()))?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let now = app.clock.now();
    let window = TimeWindow::read(&mut conn, &run, query.from.as_ref(), query.to.as_ref(), now).await?;
    let window = MetricWindow { from: window.from, to: window.to, points: read_points(query.points)? };
    let name = name.as_ref().map(MetricName::as_str);
    let points = trainer_metrics::curves(&mut conn, run.as_str(), name, window).await?;
    Ok(axum::Json(TrainerMetrics { metrics: metrics_of(points) }))
}
