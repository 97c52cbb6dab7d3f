//! Last states of web sessions, for their viewers.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;
use serde_json::{Value, json};
use tokio::sync::watch;

use super::step_response;
use crate::limits::constants::{MAX_VIEWERS, MAX_VIEWERS_PER_CLIENT};
use crate::limits::{Quota, QuotaExceeded, QuotaPermit};
use crate::sessions::{Session, SessionKey};
use clock::rfc3339;

/// Maximum number of steps that a board shows of an episode.
const MAX_LOGGED_STEPS: usize = 200;
/// Number of boards from which those without viewers are removed.
const MAX_IDLE_BOARDS: usize = 256;

/// Boards of web sessions: each has the last state of its episode and notifies its viewers.
#[derive(Debug)]
pub struct EpisodeBoards {
    boards: Mutex<HashMap<SessionKey, watch::Sender<Value>>>,
    viewers: Quota,
}

/// Step that a board adds to its log.
#[derive(Clone, Copy)]
struct LoggedStep<'a> {
    action: &'a Value,
    now: i64,
}

impl Default for EpisodeBoards {
    fn default() -> Self {
        Self { boards: Mutex::default(), viewers: Quota::new(MAX_VIEWERS, MAX_VIEWERS_PER_CLIENT) }
    }
}

impl EpisodeBoards {
    /// Takes a viewer's permit for a client.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] if there are too many viewers, in total or of the client.
    pub(super) fn acquire_viewer(&self, client: Option<&Arc<str>>) -> Result<QuotaPermit, QuotaExceeded> {
        self.viewers.acquire(client)
    }

    /// Subscribes to the board of a session, which is created if there is none.
    pub(super) fn subscribe(&self, session: &SessionKey) -> watch::Receiver<Value> {
        let mut boards = self.boards.lock();
        if boards.len() >= MAX_IDLE_BOARDS {
            boards.retain(|_, board| board.receiver_count() > 0);
        }
        boards.entry(session.clone()).or_insert_with(|| watch::Sender::new(blank_board())).subscribe()
    }

    /// Shows that an episode began.
    pub(super) fn show_reset(&self, key: &SessionKey, session: &Session) {
        self.update(key, session, None);
    }

    /// Shows a step at time `now`.
    pub(super) fn show_step(&self, key: &SessionKey, session: &Session, action: &Value, now: i64) {
        self.update(key, session, Some(LoggedStep { action, now }));
    }

    fn update(&self, key: &SessionKey, session: &Session, step: Option<LoggedStep<'_>>) {
        let Ok(view) = session.view() else { return };
        let shown = step_response::step_value(&view);
        let status = session.status();
        let _ = self.subscribe(key);
        let boards = self.boards.lock();
        let Some(board) = boards.get(key) else { return };
        board.send_modify(|state| {
            let mut logs = match state["action_logs"].take() {
                Value::Array(logs) if step.is_some() => logs,
                _ => Vec::new(),
            };
            if let Some(LoggedStep { action, now }) = step {
                logs.push(json!({
                    "timestamp": rfc3339(now), "action": action, "observation": shown["observation"],
                    "reward": shown["reward"], "done": shown["done"], "step_count": status.steps,
                }));
                let excess = logs.len().saturating_sub(MAX_LOGGED_STEPS);
                logs.drain(..excess);
            }
            *state = json!({
                "episode_id": status.episode_id, "step_count": status.steps,
                "current_observation": shown["observation"], "action_logs": logs, "is_reset": step.is_none(),
            });
        });
    }
}

fn blank_board() -> Value {
    json!({"episode_id": null, "step_count": 0, "current_observation": null, "action_logs": [], "is_reset": true})
}
