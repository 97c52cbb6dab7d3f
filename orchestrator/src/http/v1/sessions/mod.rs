//! `/v1/sessions`: environments on the server, stepped over one WebSocket, singly by text or many at once by binary frames.
//! docs/stepping.md has the frames.

mod answer;
mod opening;
mod refusal;
mod serve;
mod single;
mod vector;
mod wish;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::super::access::Caller;
use super::super::extract::NoQuery;
use super::super::problem::Problem;
use super::super::socket::bounded_by;
use crate::http::state::AppState;
use crate::sessions::vector::frame::MAX_REQUEST_BYTES;

/// Fly on the server, over a WebSocket. The first message opens a session, `{"type": "open", "version": 1, …}` with what
/// OpenEnv's reset may say (`task`, `params`, `physics`, `seed`, `scenario`, or `run`, `lease_id`, `group_id`) and, for many
/// environments stepped by binary frames, `vector`; or comes back to one, `{"type": "resume", "session": …}`. One whose
/// connection drops waits for that. `docs/stepping.md` has every frame.
#[utoipa::path(
    get, path = "/sessions", tag = "sessions",
    responses(
        (status = 101, description = "The WebSocket is open; errors are messages from here on."),
        (status = 400, body = Problem),
        (status = 426, body = Problem, description = "The request does not ask for a WebSocket.")
    )
)]
pub(super) async fn connect(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    match upgrade {
        Ok(upgrade) => {
            bounded_by(upgrade, MAX_REQUEST_BYTES).on_upgrade(move |socket| serve::serve(socket, app, caller.who))
        }
        Err(_) => {
            let words = "Sessions are WebSockets: ask for the protocol to be upgraded.";
            let problem = Problem::new(StatusCode::UPGRADE_REQUIRED, "upgrade_required", words);
            ([(axum::http::header::UPGRADE, "websocket")], problem).into_response()
        }
    }
}
