//! `/ws/ui`: sends the state of a web session to its viewers.

use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use tokio::sync::watch;

use super::super::access::Caller;
use super::super::socket::{self, Received};
use super::error_response::ErrorResponse;
use super::simulation::web_session_key;
use crate::http::state::AppState;
use crate::limits::QuotaPermit;
use crate::sessions::CloseSignal;

/// Connects a viewer to a web session.
pub(super) async fn connect(
    State(app): State<AppState>,
    caller: &Caller,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Ok(permit) = app.episode_boards.acquire_viewer(caller.identity.name.as_ref()) else {
        return ErrorResponse::new(
            StatusCode::SERVICE_UNAVAILABLE,
            "The limit of viewers is reached; retry later.".to_owned(),
        )
        .into_response();
    };
    match web_session_key(&headers, caller) {
        Ok(session) => {
            let closing = app.sessions.close_signal(&caller.identity);
            let boards = Arc::clone(&app.episode_boards);
            socket::limit_frames(upgrade)
                .on_upgrade(move |socket| serve(socket, boards.subscribe(&session), closing, permit))
        }
        Err(error) => error.into_response(),
    }
}

async fn serve(
    mut socket: WebSocket,
    mut board: watch::Receiver<Value>,
    mut closing: CloseSignal,
    _permit: QuotaPermit,
) {
    loop {
        let update = json!({"type": "state_update", "episode_state": &*board.borrow_and_update()});
        if socket::send_text(&mut socket, update.to_string().into_bytes()).await.is_err() {
            return;
        }
        tokio::select! {
            changed = board.changed() => if changed.is_err() { return socket::close(socket).await },
            received = socket::receive(&mut socket, None) => match received {
                Received::Text(_) | Received::Binary(_) => {} // viewers send no requests; any message repeats the board
                Received::TooLarge => return socket::close_for_size(socket).await,
                Received::Idle | Received::Stop(_) => return socket::close(socket).await,
                Received::Left | Received::Gone => return,
            },
            _ = closing.closed() => return socket::close(socket).await,
        }
    }
}
