//! `/v1/sessions`: environments on the server, stepped over one WebSocket: one by text messages, or many by binary frames.
//!
//! `connection` is the life of a connection, `open` reads its first message, `single` and `vector` answer the messages of a session,
//! `messages` and `error_message` write responses. Sessions themselves are in `crate::sessions`. docs/reference/stepping.md has all frames.

mod connection;
pub(in crate::http) mod error_message;
mod messages;
pub(in crate::http) mod open;
pub(in crate::http) mod session_request;
mod single;
mod vector;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use store::ids::RunId;

use crate::http::access::Caller;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::socket::limit_frames_to;
use crate::http::state::AppState;
use crate::sessions::ClientIdentity;
use crate::sessions::vector::frame::MAX_REQUEST_BYTES;

/// State of the server, client and run of a connection.
pub(super) struct SessionRoute {
    app: AppState,
    client: ClientIdentity,
    /// Run of the path, which all sessions of the connection have.
    run: Option<RunId>,
}

/// Connect to a session on the server over a WebSocket.
///
/// The first message opens a session: `{"type": "open", "version": 2, …}`, with the fields of an OpenEnv reset (`task`, `params`,
/// `physics`, `seed`, `scenario`, or `run`, `lease_id`, `group_id`). With `vector` the session has many environments, which binary
/// frames step. A client that lost its connection resumes the session by `{"type": "resume", "session": …}` instead.
/// `docs/reference/stepping.md` describes all messages and frames.
#[utoipa::path(
    get, path = "/sessions", tag = "sessions",
    responses(
        (status = 101, description = "The WebSocket is open; the server sends errors as messages from here on."),
        (status = 400, body = Problem),
        (status = 426, body = Problem, description = "The request is not a WebSocket upgrade.")
    )
)]
pub(super) async fn connect_session(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    connect(app, caller, None, upgrade)
}

/// Connect to a session of a run over a WebSocket.
///
/// As `GET /v1/sessions`, with the run in the path: a proxy that routes by shard finds its server. The message `open` needs no `run`,
/// and may have no other one.
#[utoipa::path(
    get, path = "/runs/{run}/sessions", tag = "sessions", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 101, description = "The WebSocket is open; the server sends errors as messages from here on."),
        (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 426, body = Problem, description = "The request is not a WebSocket upgrade.")
    )
)]
pub(super) async fn connect_run_session(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let run = parse_run_id(&run)?;
    drop(acquire_run_reader(&app, &run).await?);
    Ok(connect(app, caller, Some(run), upgrade))
}

/// Serves the connection, for sessions of a run or of any.
fn connect(
    app: AppState,
    caller: Caller,
    run: Option<RunId>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    match upgrade {
        Ok(upgrade) => limit_frames_to(upgrade, MAX_REQUEST_BYTES).on_upgrade(move |socket| {
            connection::serve(socket, SessionRoute { app, client: caller.identity, run })
        }),
        Err(_) => {
            let words = "The request must be a WebSocket upgrade.";
            let problem = Problem::new(StatusCode::UPGRADE_REQUIRED, "upgrade_required", words);
            ([(axum::http::header::UPGRADE, "websocket")], problem).into_response()
        }
    }
}
