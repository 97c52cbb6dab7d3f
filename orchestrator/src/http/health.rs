//! Probes of an orchestrator such as Kubernetes: `/livez` and `/readyz`.

use std::sync::atomic::Ordering;

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::http::state::AppState;

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(get_liveness)).routes(routes!(get_readiness))
}

/// Health of the server.
#[derive(Serialize, ToSchema)]
struct Health {
    /// `ok`, or `degraded` if the server serves without the workers that it is configured for. A failure is a problem.
    status: &'static str,
    /// Why the server is degraded.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl Health {
    const OK: Self = Self { status: "ok", reason: None };
}

/// Check that the process answers.
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, body = Health)))]
async fn get_liveness() -> axum::Json<Health> {
    axum::Json(Health::OK)
}

/// Check that the database can be read and written, and that the server is not stopping.
///
/// The check writes at most one row a second. A server whose workers are away is ready and degraded: it does their jobs itself.
#[utoipa::path(
    get, path = "/readyz", tag = "health",
    responses((status = 200, body = Health), (status = 503, body = Problem, description = "The server is not ready; the detail has the reason."))
)]
async fn get_readiness(State(app): State<AppState>) -> Result<axum::Json<Health>, Problem> {
    let not_ready = |reason: String| Problem::new(StatusCode::SERVICE_UNAVAILABLE, "not_ready", reason);
    if app.stopping.load(Ordering::SeqCst) {
        return Err(not_ready("The server is shutting down.".to_owned()));
    }
    app.readiness.check_writable(&app.writer).await.map_err(not_ready)?;
    let degraded = app.lease_service.audits.queue.status().degraded;
    Ok(axum::Json(degraded.map_or(Health::OK, |reason| Health { status: "degraded", reason: Some(reason) })))
}
