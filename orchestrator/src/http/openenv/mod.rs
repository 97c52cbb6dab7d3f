//! OpenEnv: the routes of openenv 0.10 and openenv-core 0.3.0, so that their clients work with this server unchanged.
//!
//! `simulation` serves single HTTP requests, `socket` a session over a WebSocket, `harness` turns of the server's language model, `mcp`
//! the Model Context Protocol, `task_discovery` the lists of scenarios, and `web` the page. Sessions themselves are in `crate::sessions`.
//! docs/reference/openenv.md lists the intended differences to openenv-core. Start reading at [`routes`].

mod body;
mod episode_boards;
mod error_message;
mod error_response;
pub(super) mod fields;
mod harness;
mod harness_turn;
pub(super) mod mcp;
mod metadata;
mod simulation;
mod socket;
mod step_response;
mod task_discovery;
mod tasks;
mod viewer_socket;
mod web;

use axum::Extension;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use self::episode_boards::EpisodeBoards;
use self::error_response::ErrorResponse;
use self::fields::QueryParams;
use self::harness::HarnessQuery;
pub(super) use self::tasks::{built_in_task, known_tasks, task_by_name};
use super::access::Caller;
use crate::http::state::AppState;

/// Paths that are served with and without a slash at the end. `/web` is a redirect to `/web/`.
pub(super) const PATHS: [&str; 21] = [
    "/health",
    "/metadata",
    "/schema",
    "/manifest.json",
    "/list_environments",
    "/sparring/splits",
    "/sparring/tasks",
    "/sparring/num_tasks",
    "/sparring/task",
    "/sparring/task_range",
    "/reset",
    "/step",
    "/state",
    "/mcp",
    "/ws",
    "/ws/ui",
    "/harness",
    "/web/metadata",
    "/web/state",
    "/web/reset",
    "/web/step",
];

/// Returns all routes, which are at the root.
pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(metadata::get_health))
        .routes(routes!(metadata::get_environment_metadata))
        .routes(routes!(metadata::get_environment_schema))
        .routes(routes!(metadata::get_manifest))
        .routes(routes!(task_discovery::list_environments))
        .routes(routes!(task_discovery::list_splits))
        .routes(routes!(task_discovery::list_split_tasks))
        .routes(routes!(task_discovery::count_split_tasks))
        .routes(routes!(task_discovery::get_split_task))
        .routes(routes!(task_discovery::list_split_task_range))
        .routes(routes!(simulation::reset_environment))
        .routes(routes!(simulation::step_environment))
        .routes(routes!(simulation::get_environment_state))
        .routes(routes!(mcp::routes::call_mcp, mcp::routes::end_mcp_session))
        .routes(routes!(connect_mcp_session))
        .routes(routes!(connect_environment_session))
        .routes(routes!(connect_ui_session))
        .routes(routes!(connect_harness_session))
        .route("/", get(web::home))
        .route("/web", get(web::without_slash))
        .route("/web/", get(web::page))
        .route("/web/metadata", get(metadata::web_metadata))
        .route("/web/state", get(web::state))
        .route("/web/reset", post(web::reset))
        .route("/web/step", post(web::step))
}

type Upgrade = Result<WebSocketUpgrade, WebSocketUpgradeRejection>;

/// Run episodes over a WebSocket in OpenEnv's frames: `reset`, `step`, `state`, `close`.
///
/// With `session_id` the connection attaches to a session of `POST /mcp`, which outlives it.
#[utoipa::path(
    get, path = "/ws", tag = "openenv",
    params(("session_id" = Option<String>, Query, description = "Id of a session that `openenv/session/create` returned.")),
    responses((status = 101), (status = 404, body = Object, description = "The request is not a WebSocket upgrade."))
)]
async fn connect_environment_session(
    state: State<AppState>,
    Extension(caller): Extension<Caller>,
    Query(query): Query<QueryParams>,
    upgrade: Upgrade,
) -> Response {
    match upgrade {
        Ok(upgrade) => socket::connect(state, caller.identity, query, upgrade).await,
        // Like openenv-core, a route that is only a WebSocket does not exist for other requests.
        Err(_) => ErrorResponse::new(StatusCode::NOT_FOUND, "Not Found").into_response(),
    }
}

/// Use JSON-RPC over a WebSocket, with a session for each connection.
#[utoipa::path(
    get, path = "/mcp", tag = "openenv",
    responses((status = 101), (status = 405, body = Object, description = "The request is not a WebSocket upgrade."))
)]
async fn connect_mcp_session(
    state: State<AppState>,
    Extension(caller): Extension<Caller>,
    upgrade: Upgrade,
) -> Response {
    match upgrade {
        Ok(upgrade) => mcp::connect(state, caller.identity, upgrade).await,
        Err(_) => {
            let error = ErrorResponse::new(StatusCode::METHOD_NOT_ALLOWED, "Method Not Allowed");
            ([(axum::http::header::ALLOW, "POST, DELETE")], error).into_response()
        }
    }
}

/// Let the language model of the server act, turn by turn over a WebSocket, in OpenEnv's frames of harnesses.
///
/// Each message of the client is an instruction. The model then acts until the episode is over, and every call and action is an event.
/// The query selects the scenario: `task`, `seed`, `run`.
#[utoipa::path(
    get, path = "/harness", tag = "openenv",
    params(
        ("task" = Option<String>, Query, description = "Id or name of a task (default: the first task)."),
        ("seed" = Option<String>, Query, description = "Seed of the first scenario, an integer."),
        ("run" = Option<String>, Query, description = "Run from whose curriculum the episodes are leased.")
    ),
    responses(
        (status = 101), (status = 400, body = Object), (status = 404, body = Object, description = "The request is not a WebSocket upgrade.")
    )
)]
async fn connect_harness_session(
    state: State<AppState>,
    Extension(caller): Extension<Caller>,
    Query(query): Query<QueryParams>,
    upgrade: Upgrade,
) -> Response {
    match upgrade {
        Ok(upgrade) => harness::connect(state, caller.identity, HarnessQuery(query), upgrade).await,
        Err(_) => ErrorResponse::new(StatusCode::NOT_FOUND, "Not Found").into_response(),
    }
}

/// Receive the state of a web session over a WebSocket.
#[utoipa::path(
    get, path = "/ws/ui", tag = "openenv",
    responses(
        (status = 101), (status = 400, body = Object),
        (status = 404, body = Object, description = "The request is not a WebSocket upgrade."),
        (status = 503, body = Object)
    )
)]
async fn connect_ui_session(
    state: State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: axum::http::HeaderMap,
    upgrade: Upgrade,
) -> Response {
    match upgrade {
        Ok(upgrade) => viewer_socket::connect(state, &caller, headers, upgrade).await,
        Err(_) => ErrorResponse::new(StatusCode::NOT_FOUND, "Not Found").into_response(),
    }
}
