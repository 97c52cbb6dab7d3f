//! Whether the server lives and is ready.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use tokio::sync::Mutex;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use crate::http::state::AppState;
use crate::engine::error::ServiceError;

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(livez)).routes(routes!(readyz))
}

/// For how long what was seen is believed: anybody may ask, and each look is a write.
const LOOK: Duration = Duration::from_secs(1);

/// When it was last looked whether the database can be written, and why not.
#[derive(Debug, Clone, Default)]
pub struct Looked(Arc<Mutex<Option<Seen>>>);

/// What was seen, and when.
type Seen = (Instant, Result<(), String>);

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
fn unwritable(error: &ServiceError) -> String {
    tracing::warn!(error = %error, "The server is not ready.");
    let why = match (error, error.outage()) {
        (_, Some(outage)) => outage.to_string(),
        (ServiceError::Busy | ServiceError::Stopping, _) => error.to_string(),
        _ => "the server's log says why".to_owned(),
    };
    format!("The database cannot be written: {why}.")
}

/// Whether the database can be written; why not.
pub(super) async fn writable(app: &AppState) -> Result<(), String> {
    let mut looked = app.looked.0.lock().await;
    let said = match looked.take().filter(|(at, _)| at.elapsed() < LOOK) {
        Some(looked) => looked,
        None => {
            let pinged = app.writer.change(crate::engine::write_probe::WriteProbe).await;
            (Instant::now(), pinged.map_err(|error| unwritable(&error)))
        }
    };
    let (_, ready) = looked.insert(said);
    ready.clone()
}

/// The database can be read and written (it writes a row, once a second at most however many ask), and the server is not going down.
#[utoipa::path(
    get, path = "/readyz", tag = "health",
    responses((status = 200, body = Health), (status = 503, body = Problem, description = "Not ready; the detail says why."))
)]
async fn readyz(State(app): State<AppState>) -> Result<axum::Json<Health>, Problem> {
    let not_ready = |why: String| Problem::new(StatusCode::SERVICE_UNAVAILABLE, "not_ready", why);
    if app.stopping.load(Ordering::SeqCst) {
        return Err(not_ready("The server is going down.".to_owned()));
    }
    writable(&app).await.map_err(not_ready)?;
    Ok(axum::Json(Health { status: "ok" }))
}
