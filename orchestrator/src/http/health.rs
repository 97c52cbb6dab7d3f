//! Whether the server lives and is ready.

use std::sync::atomic::Ordering;

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::service::App;
use crate::training::TrainingError;

pub(super) fn routes() -> OpenApiRouter<App> {
    OpenApiRouter::new().routes(routes!(livez)).routes(routes!(readyz))
}

/// How the server is.
#[derive(Serialize, ToSchema)]
struct Health {
    /// `ok`.
    status: &'static str,
}

/// The process answers.
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, body = Health)))]
async fn livez() -> axum::Json<Health> {
    axum::Json(Health { status: "ok" })
}

/// Why nothing can be written. The database's own words are for the log.
fn unwritable(error: &TrainingError) -> String {
    tracing::warn!(error = %error, "The server is not ready.");
    let why = match (error, error.trouble()) {
        (_, Some(trouble)) => trouble.to_string(),
        (TrainingError::Busy | TrainingError::Stopping, _) => error.to_string(),
        _ => "the server's log says why".to_owned(),
    };
    format!("The database cannot be written: {why}.")
}

/// The database can be read and written (it writes a row), and the server is not going down.
#[utoipa::path(
    get, path = "/readyz", tag = "health",
    responses((status = 200, body = Health), (status = 503, body = Problem, description = "Not ready; the detail says why."))
)]
async fn readyz(State(app): State<App>) -> Result<axum::Json<Health>, Problem> {
    let not_ready = |why: String| Problem::new(StatusCode::SERVICE_UNAVAILABLE, "not_ready", why);
    if app.stopping.load(Ordering::SeqCst) {
        return Err(not_ready("The server is going down.".to_owned()));
    }
    app.writer.change(crate::training::status::Ping).await.map_err(|error| not_ready(unwritable(&error)))?;
    Ok(axum::Json(Health { status: "ok" }))
}
