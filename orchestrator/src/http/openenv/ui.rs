//! `/ws/ui`: what happens in a web session, told to whoever looks.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use tokio::sync::watch;

use super::super::access::Caller;
use super::super::socket;
use super::refusal::Refusal;
use super::{answer, web};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::sessions::{CloseSignal, SessionKey, QuotaPermit, Quota, Session};

/// Steps that are told of an episode.
const MOST_LOGS: usize = 200;
/// Boards that are kept of sessions at which nobody looks.
const MOST_BOARDS: usize = 256;

/// How many may look at once; of each a quarter.
const MOST_WATCHERS: usize = 256;

/// One board a web session: what it shows, and who waits for the next.
#[derive(Debug)]
pub struct Boards {
    boards: Mutex<HashMap<SessionKey, watch::Sender<Value>>>,
    seats: Quota,
}

impl Default for Boards {
    fn default() -> Self {
        Self { boards: Mutex::default(), seats: Quota::new(MOST_WATCHERS, MOST_WATCHERS / 4) }
    }
}

impl Boards {
    fn hold(&self) -> MutexGuard<'_, HashMap<SessionKey, watch::Sender<Value>>> {
        // Nothing that holds it can panic; if something did, the map is still a map.
        self.boards.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn look(&self, name: &SessionKey) -> watch::Receiver<Value> {
        let mut boards = self.hold();
        if boards.len() >= MOST_BOARDS {
            boards.retain(|_, board| board.receiver_count() > 0);
        }
        boards.entry(name.clone()).or_insert_with(|| watch::Sender::new(blank())).subscribe()
    }

    /// Tells that an episode began.
    pub(super) fn began(&self, name: &SessionKey, session: &Session) {
        self.show(name, session, None);
    }

    /// Tells that a step was taken.
    pub(super) fn stepped(&self, name: &SessionKey, session: &Session, action: &Value, now: i64) {
        self.show(name, session, Some((action, now)));
    }

    fn show(&self, name: &SessionKey, session: &Session, stepped: Option<(&Value, i64)>) {
        let Ok(shown) = session.view() else { return };
        let told = answer::value(&shown);
        let standing = session.status();
        let _ = self.look(name);
        let boards = self.hold();
        let Some(board) = boards.get(name) else { return };
        board.send_modify(|state| {
            let mut logs = match state["action_logs"].take() {
                Value::Array(logs) if stepped.is_some() => logs,
                _ => Vec::new(),
            };
            if let Some((action, now)) = stepped {
                logs.push(json!({
                    "timestamp": rfc3339(now), "action": action, "observation": told["observation"],
                    "reward": told["reward"], "done": told["done"], "step_count": standing.steps,
                }));
                let over = logs.len().saturating_sub(MOST_LOGS);
                logs.drain(..over);
            }
            *state = json!({
                "episode_id": standing.episode_id, "step_count": standing.steps,
                "current_observation": told["observation"], "action_logs": logs, "is_reset": stepped.is_none(),
            });
        });
    }
}

fn blank() -> Value {
    json!({"episode_id": null, "step_count": 0, "current_observation": null, "action_logs": [], "is_reset": true})
}

/// Looks at a web session.
pub(super) async fn connect(
    State(app): State<AppState>,
    caller: &Caller,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Ok(seat) = app.boards.seats.acquire(caller.who.name.as_ref()) else {
        return Refusal::new(
            StatusCode::SERVICE_UNAVAILABLE,
            "as many look as may; try again in a moment".to_owned(),
        )
        .into_response();
    };
    match web::name(&headers, caller) {
        Ok(name) => {
            let closing = app.sessions.close_signal(&caller.who);
            let boards = Arc::clone(&app.boards);
            socket::bounded(upgrade)
                .on_upgrade(move |socket| serve(socket, boards.look(&name), closing, seat))
        }
        Err(refusal) => refusal.into_response(),
    }
}

async fn serve(mut socket: WebSocket, mut board: watch::Receiver<Value>, mut closing: CloseSignal, _seat: QuotaPermit) {
    loop {
        let told = json!({"type": "state_update", "episode_state": &*board.borrow_and_update()});
        if socket::send(&mut socket, told.to_string().into_bytes()).await.is_err() {
            return;
        }
        tokio::select! {
            changed = board.changed() => if changed.is_err() { return socket::close(socket).await },
            received = socket.recv() => match received {
                Some(Ok(axum::extract::ws::Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => {} // nothing is asked for here; the board is told again
            },
            _ = closing.closed() => return socket::close(socket).await,
        }
    }
}
