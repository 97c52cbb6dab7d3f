//! Event stream of a run (Server-Sent Events).

use std::collections::VecDeque;
use std::convert::Infallible;
use std::time::Duration;

use api_types::EventQuery;
use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use futures_util::Stream;
use serde_json::{Value, json};
use sqlx::SqlitePool;
use store::events::{self, EventKind, EventRow};
use store::ids::RunId;
use store::{StoreError, from_json};
use tokio::sync::watch;

use crate::http::access::Caller;
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::limits::QuotaPermit;
use crate::sessions::CloseSignal;
use clock::{Clock, rfc3339};

/// Number of events that are read at once.
const EVENT_BATCH: i64 = 256;
/// Longest silence before a comment is sent, which shows both sides that the connection is alive.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// Largest number of past events that a stream starts with.
const MAX_PAST_EVENTS: u32 = 1000;

/// Stream the events of a run as Server-Sent Events.
///
/// Kinds of events: `run` (created, changed, tagged, paused, resumed, archived, deleted), `lease` (created, renewed, done, released,
/// expired), `group` (closed), `move` (level move with its evidence), `claim` (of columns), `failures` (new critiques), `design` (end
/// of a design request), `worker` (a worker joined or left) and `warning` (for operators). Every event has an id. A client that
/// reconnects sends the last id as `Last-Event-ID`. It misses no event if at most 10 000 other events happened since; otherwise the
/// first event is `gap`. A stream without an id starts with an id without data, from which the client can resume. The stream ends
/// when the run is deleted.
#[utoipa::path(
    get, path = "/runs/{run}/events", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), EventQuery,
           ("Last-Event-ID" = Option<i64>, Header, description = "Id of the last received event.")),
    responses(
        (status = 200, content_type = "text/event-stream", body = String), (status = 400, body = Problem),
        (status = 404, body = Problem), (status = 429, body = Problem, description = "Too many event streams are open.")
    )
)]
pub(super) async fn stream_events(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Query(query): Query<EventQuery>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let run = parse_run_id(&run)?;
    let kinds = parse_kinds(query.kind.as_deref())?;
    let changes = app.events.subscribe();
    let mut conn = acquire_run_reader(&app, &run).await?;
    let last =
        match headers.get("last-event-id").map(|id| id.to_str().ok().and_then(|id| id.trim().parse().ok())) {
            Some(Some(id)) => Some(id),
            Some(None) => {
                let message = "must be the id of an event, an integer";
                return Err(Problem::new(StatusCode::BAD_REQUEST, "bad_header", message).at("Last-Event-ID"));
            }
            None => query.after,
        };
    let after = match (last, query.last) {
        (Some(id), _) => id.max(0),
        (None, Some(n @ ..=MAX_PAST_EVENTS)) => {
            events::before_last(&mut conn, run.as_str(), &kinds, n).await?
        }
        (None, Some(n)) => {
            return Err(Problem::invalid("last", format!("must be from 0 to {MAX_PAST_EVENTS}, got {n}")));
        }
        (None, None) => events::newest(&mut conn, run.as_str()).await?,
    };
    drop(conn);
    let permit = app.listeners.acquire(caller.identity.name.as_ref());
    let permit = permit.map_err(|_| {
        let message = "too many event streams are open; close one, or retry in a few seconds";
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_listeners", message).with_retry_after(5)
    })?;
    let stream = EventStream {
        readers: app.readers.clone(),
        clock: app.clock.clone(),
        changes,
        closing: app.sessions.close_signal(&caller.identity),
        run,
        kinds,
        after,
        // A client without a last id gets one to resume from: an id alone is not an event, but clients remember it.
        pending: last.is_none().then(|| Event::default().id(after.to_string())).into_iter().collect(),
        is_checked: false,
        has_more: false,
        is_deleted: false,
        _permit: permit,
    };
    let events = futures_util::stream::unfold(stream, |mut stream| async {
        let event = stream.next().await?;
        Some((Ok(event), stream))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

/// Parses a list of kinds of events; without a list, returns all kinds.
pub(in crate::http) fn parse_kinds(list: Option<&str>) -> Result<Vec<EventKind>, Problem> {
    let Some(list) = list else { return Ok(EventKind::ALL.to_vec()) };
    let parse = |word: &str| {
        word.trim().parse().map_err(|_| {
            let (known, word) = (EventKind::WORDS.join(", "), shorten(word, MAX_QUOTED_CHARS));
            Problem::invalid("kind", format!("must be some of {known}, separated by commas; got {word:?}"))
        })
    };
    list.split(',').map(parse).collect()
}

/// State of one event stream.
struct EventStream {
    readers: SqlitePool,
    clock: Clock,
    changes: watch::Receiver<u64>,
    closing: CloseSignal,
    run: RunId,
    /// Kinds of the events that the client wants.
    kinds: Vec<EventKind>,
    /// Id of the last event that was read.
    after: i64,
    pending: VecDeque<Event>,
    /// True once the start of the stream was checked against the stored events.
    is_checked: bool,
    /// True if the last read may have left events behind.
    has_more: bool,
    /// True once the run was deleted: the stream ends after the pending events.
    is_deleted: bool,
    _permit: QuotaPermit,
}

impl EventStream {
    /// Returns the next event; `None` if the server stops, the client's token is no longer valid, or the run was deleted.
    async fn next(&mut self) -> Option<Event> {
        loop {
            if self.closing.reason().is_some() {
                return None;
            }
            if let Some(event) = self.pending.pop_front() {
                return Some(event);
            }
            if self.is_deleted {
                return None;
            }
            self.changes.mark_unchanged();
            if let Err(error) = self.read().await {
                tracing::warn!(run = %self.run, %error, "Events cannot be read; the stream is closed.");
                return None;
            }
            // A batch without an event of the wanted kinds may be followed by others.
            if self.pending.is_empty() && !self.is_deleted && !self.has_more {
                tokio::select! {
                    changed = self.changes.changed() => changed.ok()?,
                    _ = self.closing.closed() => return None,
                }
            }
        }
    }

    /// Queues a `gap` event: events between the last one and `up_to` are missing.
    fn push_gap(&mut self, up_to: i64, message: &str) {
        let gap = json!({"after": self.after, "up_to": up_to, "message": message});
        self.pending.push_back(sse_event(up_to, "gap", &gap));
        self.after = up_to;
    }

    /// Reads the events after the last one.
    async fn read(&mut self) -> Result<(), StoreError> {
        let mut conn = self.readers.acquire().await?;
        let run = self.run.clone();
        let run = run.as_str();
        let deleted = events::last_deleted(&mut conn, run).await?;
        let exists = deleted.is_some();
        let deleted = deleted.unwrap_or(0);
        if self.after < deleted {
            self.push_gap(deleted, "the events in between are no longer kept");
        } else if self.after > 0 && !self.is_checked {
            let newest = events::newest(&mut conn, run).await?.max(deleted);
            if self.after > newest {
                self.push_gap(
                    newest,
                    "no event has this id; the database was replaced or restored from a backup",
                );
            }
        }
        self.is_checked = true;
        let rows = events::after(&mut conn, run, self.after, EVENT_BATCH).await?;
        self.has_more = rows.len() as i64 == EVENT_BATCH;
        self.is_deleted = !exists && !self.has_more;
        for EventRow { id, kind, body, at } in rows {
            self.after = id;
            if !self.kinds.contains(&kind) {
                continue;
            }
            let mut data: Value = from_json("an event", &body)?;
            if let Some(fields) = data.as_object_mut() {
                fields.insert("at".to_owned(), rfc3339(at).into());
            }
            self.pending.push_back(sse_event(id, kind.as_str(), &data));
        }
        if self.is_deleted {
            // This event is not stored: the events of a deleted run may be gone before a listener reads them.
            let data = json!({"state": "deleted", "at": rfc3339(self.clock.now())});
            self.pending.push_back(sse_event(self.after, EventKind::Run.as_str(), &data));
        }
        Ok(())
    }
}

fn sse_event(id: i64, kind: &str, data: &Value) -> Event {
    // Compact JSON has no line breaks.
    Event::default().id(id.to_string()).event(kind).data(data.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_kind_is_quoted_in_short() {
        assert_eq!(
            parse_kinds(Some("move, warning")).expect("both are known"),
            [EventKind::Move, EventKind::Warning]
        );
        let problem = parse_kinds(Some(&"x".repeat(100_000))).expect_err("it is no kind");
        assert!(problem.message().len() < 1000, "{}", problem.message().len());
    }
}
