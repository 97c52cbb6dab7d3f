//! `/metrics`: the server's metrics in the Prometheus text format. docs/guides/operations.md describes each metric.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use axum::extract::{MatchedPath, Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use store::{critiques, integrity};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::http::state::AppState;
use crate::metrics;
use crate::queries::mastery_gauges::{MasteryGauge, MasteryGaugesQuery};

/// Buckets of durations in seconds, from a fast read to the request timeout.
const DURATION_BUCKETS_S: [f64; 14] =
    [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0, 60.0];
/// Buckets of the number of changes in one commit.
const BATCH_SIZE_BUCKETS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// Longest time that a request waits for the writer, or for a reader of the database.
const MAX_WAIT: Duration = Duration::from_millis(500);

/// Recorder of this process; `None` if it could not be installed. Several services in one process, as in tests, share it.
static RECORDER: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Installs the metrics recorder of this process, if it is not installed yet.
pub fn install_recorder() {
    RECORDER.get_or_init(|| {
        let recorder = PrometheusBuilder::new()
            .set_buckets_for_metric(Matcher::Suffix("_seconds".to_owned()), &DURATION_BUCKETS_S)
            .and_then(|builder| {
                builder.set_buckets_for_metric(Matcher::Suffix("_changes".to_owned()), &BATCH_SIZE_BUCKETS)
            })
            .map(PrometheusBuilder::build_recorder);
        let handle = recorder.ok().and_then(|recorder| {
            let handle = recorder.handle();
            ::metrics::set_global_recorder(recorder).ok().map(|()| handle)
        });
        if handle.is_none() {
            tracing::warn!("/metrics has no data: this process installed another metrics recorder.");
        }
        metrics::register();
        handle
    });
}

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(get_metrics))
}

/// Get the metrics in the Prometheus text format.
#[utoipa::path(
    get, path = "/metrics", tag = "health",
    responses(
        (status = 200, body = String, content_type = "text/plain"),
        (status = 503, body = Problem, description = "The metrics are not available; the detail has the reason.")
    )
)]
async fn get_metrics(State(app): State<AppState>) -> Result<Response, Problem> {
    let Some(Some(handle)) = RECORDER.get() else {
        return Err(Problem::new(
            axum::http::StatusCode::SERVICE_UNAVAILABLE,
            "not_counted",
            "No metrics recorder is installed.",
        ));
    };
    // The three parts wait for different things; after a time, what is known is reported.
    let (writable, gauges, _) = tokio::join!(
        app.readiness.check_writable(&app.writer),
        tokio::time::timeout(MAX_WAIT, app.writer.query(MasteryGaugesQuery)),
        tokio::time::timeout(MAX_WAIT, read_database_gauges(&app)),
    );
    metrics::set_writable(writable.is_ok()); // a failed check is a metric too
    for MasteryGauge { run, task, level, mastery } in gauges.into_iter().flatten().flatten() {
        metrics::set_task(&run, &task, level, mastery.as_ref());
    }
    let crate::engine::writer::QueueLengths { urgent, bulk } = app.writer.queue_lengths();
    metrics::set_writer_queue(urgent, bulk);
    metrics::set_sessions(app.sessions.active(), app.sessions.limits().max_sessions);
    metrics::set_remote_workers(&app.lease_service.audits.queue.status());
    handle.run_upkeep();
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], handle.render())
        .into_response())
}

/// Sets the gauges that are read from the database.
async fn read_database_gauges(app: &AppState) {
    let Ok(mut conn) = app.readers.acquire().await else { return };
    if let Ok(waiting) = critiques::waiting_by_run(&mut conn).await {
        metrics::set_critique_waiting(waiting.values().sum());
    }
    if let Ok(pages) = integrity::page_bytes(&mut conn).await {
        metrics::set_database_bytes(pages.all, pages.free);
    }
}

/// Middleware that records the count and duration of requests.
pub(super) async fn record_requests(request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("none", MatchedPath::as_str).to_owned();
    let (method, started_at) = (request.method().clone(), Instant::now());
    let response = next.run(request).await;
    metrics::record_request(&method, route, response.status(), started_at.elapsed());
    response
}
