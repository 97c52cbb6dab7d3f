//! OpenEnv: what openenv-core 0.3.0 serves, so that its clients fly here unchanged. docs/openenv.md tells where this is meant
//! to be otherwise, and why.

mod about;
mod answer;
mod body;
mod mcp;
mod read;
mod refusal;
mod simulation;
mod socket;
mod ui;
mod web;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use env_core::TaskSpec;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(super) use self::read::{known, named};
use self::refusal::Refusal;
pub use self::ui::Boards;
use super::access::Caller;
use super::problem::Problem;
use crate::http::state::AppState;
use crate::sessions::SessionError;
use crate::engine::error::ServiceError;

/// All of its routes, at the root.
pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(about::health))
        .routes(routes!(about::metadata))
        .routes(routes!(about::schema))
        .routes(routes!(about::manifest))
        .routes(routes!(simulation::reset))
        .routes(routes!(simulation::step))
        .routes(routes!(simulation::state))
        .routes(routes!(mcp::routes::post))
        .routes(routes!(mcp_socket))
        .routes(routes!(socket))
        .routes(routes!(ui_socket))
        .route("/", get(web::home))
        .route("/web", get(web::home))
        .route("/web/", get(web::page))
        .route("/web/metadata", get(about::web_metadata))
        .route("/web/state", get(web::state))
        .route("/web/reset", post(web::reset))
        .route("/web/step", post(web::step))
}

type Upgrade = Result<WebSocketUpgrade, WebSocketUpgradeRejection>;

/// Fly over a WebSocket, in openenv-core's frames: `reset`, `step`, `state`, `close`.
#[utoipa::path(
    get, path = "/ws", tag = "openenv",
    responses((status = 101), (status = 404, body = Object, description = "It is not asked for as a WebSocket."))
)]
async fn socket(state: State<AppState>, Extension(caller): Extension<Caller>, upgrade: Upgrade) -> Response {
    match upgrade {
        Ok(upgrade) => socket::connect(state, caller.who, upgrade).await,
        // What answers sockets alone is not there for others, as the original has it.
        Err(_) => Refusal::new(StatusCode::NOT_FOUND, "Not Found").into_response(),
    }
}

/// JSON-RPC over a WebSocket: a session of its own.
#[utoipa::path(
    get, path = "/mcp", tag = "openenv",
    responses((status = 101), (status = 405, body = Object, description = "It is not asked for as a WebSocket."))
)]
async fn mcp_socket(state: State<AppState>, Extension(caller): Extension<Caller>, upgrade: Upgrade) -> Response {
    match upgrade {
        Ok(upgrade) => mcp::connect(state, caller.who, upgrade).await,
        Err(_) => {
            let refusal = Refusal::new(StatusCode::METHOD_NOT_ALLOWED, "Method Not Allowed");
            ([(axum::http::header::ALLOW, "POST")], refusal).into_response()
        }
    }
}

/// Look on while a web session flies, over a WebSocket.
#[utoipa::path(
    get, path = "/ws/ui", tag = "openenv",
    responses(
        (status = 101), (status = 400, body = Object),
        (status = 404, body = Object, description = "It is not asked for as a WebSocket."),
        (status = 503, body = Object)
    )
)]
async fn ui_socket(
    state: State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: axum::http::HeaderMap,
    upgrade: Upgrade,
) -> Response {
    match upgrade {
        Ok(upgrade) => ui::connect(state, &caller, headers, upgrade).await,
        Err(_) => Refusal::new(StatusCode::NOT_FOUND, "Not Found").into_response(),
    }
}

/// The task of an id that stands in this program.
pub(super) fn usual(id: &str) -> &'static dyn TaskSpec {
    let first = || env_core::tasks().next();
    // There is no world without a task, and an id that stands here is one.
    env_core::task(id).or_else(first).unwrap_or_else(|| unreachable!("there are tasks"))
}

/// A failure of a use case, without what only the log should say.
fn in_words(error: &ServiceError) -> String {
    match error {
        ServiceError::Restore(_) | ServiceError::Store(_) | ServiceError::NotCommitted { .. } => {
            tracing::error!(error = %error, "A session's request failed.");
            Problem::internal().words()
        }
        other => other.to_string(),
    }
}

/// A refusal of a session in a sentence.
fn refused_in_words(error: &SessionError) -> String {
    match error {
        SessionError::Service(failure) => in_words(failure),
        other => other.to_string(),
    }
}
