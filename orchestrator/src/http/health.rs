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
    /// Always `ok`; a failure is a problem.
    status: &'static str,
}

/// Check that the process answers.
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, body = Health)))]
async fn get_liveness() -> axum::Json<Health> {
    axum::Json(Health { status: "ok" })
}

/// Check that the database can be read and written, and that the server is not stopping.
///
/// The check writes at most one row a second.
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
    Ok(axum::Json(Health { status: "ok" }))
}
