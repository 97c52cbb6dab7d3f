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

use crate::http::access::Caller;
use crate::http::extract::NoQuery;
use crate::http::problem::Problem;
use crate::http::socket::limit_frames_to;
use crate::http::state::AppState;
use crate::sessions::vector::frame::MAX_REQUEST_BYTES;

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
    match upgrade {
        Ok(upgrade) => limit_frames_to(upgrade, MAX_REQUEST_BYTES)
            .on_upgrade(move |socket| connection::serve(socket, app, caller.identity)),
        Err(_) => {
            let words = "The request must be a WebSocket upgrade.";
            let problem = Problem::new(StatusCode::UPGRADE_REQUIRED, "upgrade_required", words);
            ([(axum::http::header::UPGRADE, "websocket")], problem).into_response()
        }
    }
}
