//! Events: what happens in a run, as it happens.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::Stream;
use serde::Deserialize;
use serde_json::{Value, json};
use sqlx::SqlitePool;
use tokio::sync::watch;
use utoipa::IntoParams;

use super::super::access::Caller;
use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::{reader_of, run_id};
use crate::clock::rfc3339;
use crate::ids::RunId;
use crate::http::state::AppState;
use crate::sessions::{CloseSignal, QuotaPermit};
use crate::store::events::{self, EventRow};
use crate::store::{StoreError, from_json};

/// Events that are read at once.
const PAGE: i64 = 256;
/// How long nothing may be said, so that both sides know that the other is there.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// Where to go on.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct From {
    /// The event after which to begin: 0 for all that are kept. Left out, only what happens from now on; the header
    /// `Last-Event-ID` goes before it.
    after: Option<i64>,
    /// Where `after` is left out: begin with so many of the last, 1 000 at most.
    #[param(maximum = 1000)]
    last: Option<u32>,
}

/// Most of the last events that one begins with.
const LAST: u32 = 1000;

/// Listen to what happens in a run (Server-Sent Events): `run` (created, changed, paused, resumed, archived), `lease` (taken, renewed, done, released,
/// expired), `group` (how it ended), `move` (a level, with its evidence), `claim` (of columns), `failures` (that were criticised),
/// `design` (what a designer came to) and `health` (what whoever watches should know). Every event has an id; a listener that
/// comes again with it as `Last-Event-ID` misses nothing, as long as at most 10 000 others came since: else the first event is `gap`.
/// Where it has none the stream begins by an id without data, from which to go on.
#[utoipa::path(
    get, path = "/runs/{run}/events", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), From,
           ("Last-Event-ID" = Option<i64>, Header, description = "The last event that was heard.")),
    responses(
        (status = 200, content_type = "text/event-stream", body = String), (status = 400, body = Problem),
        (status = 404, body = Problem), (status = 429, body = Problem, description = "As many listen as may.")
    )
)]
pub(super) async fn listen(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Query(from): Query<From>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let run = run_id(&run)?;
    let changes = app.events.subscribe();
    let mut conn = reader_of(&app, &run).await?;
    let last =
        match headers.get("last-event-id").map(|id| id.to_str().ok().and_then(|id| id.trim().parse().ok())) {
            Some(Some(id)) => Some(id),
            Some(None) => {
                let words = "It is not the id of an event: those are whole numbers.";
                return Err(Problem::new(StatusCode::BAD_REQUEST, "bad_header", words).at("Last-Event-ID"));
            }
            None => from.after,
        };
    let after = match (last, from.last) {
        (Some(id), _) => id.max(0),
        (None, Some(n @ ..=LAST)) => events::before_last(&mut conn, run.as_str(), n).await?,
        (None, Some(n)) => {
            return Err(Problem::invalid("last", format!("is {n}, but must be from 0 to {LAST}")));
        }
        (None, None) => events::newest(&mut conn, run.as_str()).await?,
    };
    drop(conn);
    let seat = app.listeners.acquire(caller.who.name.as_ref());
    let seat = seat.map_err(|_| {
        let words = "As many listen as may; try again in a moment.";
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_listeners", words).again_in(5)
    })?;
    let listener = Listener {
        readers: app.readers.clone(),
        changes,
        closing: app.sessions.close_signal(&caller.who),
        run,
        after,
        // Whoever has heard nothing yet knows from where to go on: an id alone is no event, but is remembered like one's.
        waiting: last.is_none().then(|| Event::default().id(after.to_string())).into_iter().collect(),
        begun: false,
        _seat: seat,
    };
    let stream = futures_util::stream::unfold(listener, |mut listener| async {
        let event = listener.next().await?;
        Some((Ok(event), listener))
    });
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

/// Whoever listens to one run.
struct Listener {
    readers: SqlitePool,
    changes: watch::Receiver<u64>,
    closing: CloseSignal,
    run: RunId,
    /// The last event that was told.
    after: i64,
    waiting: VecDeque<Event>,
    /// Whether it was looked at where the listener left off.
    begun: bool,
    _seat: QuotaPermit,
}

impl Listener {
    /// The next event; none when the service stops, or whoever listens may not any more.
    async fn next(&mut self) -> Option<Event> {
        loop {
            if self.closing.reason().is_some() {
                return None;
            }
            if let Some(event) = self.waiting.pop_front() {
                return Some(event);
            }
            self.changes.mark_unchanged();
            if let Err(error) = self.read().await {
                tracing::warn!(run = %self.run, %error, "Events could not be read; the listener is let go.");
                return None;
            }
            if self.waiting.is_empty() {
                tokio::select! {
                    changed = self.changes.changed() => changed.ok()?,
                    _ = self.closing.closed() => return None,
                }
            }
        }
    }

    /// Tells that there is no way from the last event to what follows.
    fn gap(&mut self, up_to: i64, words: &str) {
        let gap = json!({"after": self.after, "up_to": up_to, "words": words});
        self.waiting.push_back(event(up_to, "gap", &gap));
        self.after = up_to;
    }

    /// Reads what came after the last.
    async fn read(&mut self) -> Result<(), StoreError> {
        let mut conn = self.readers.acquire().await?;
        let run = self.run.clone();
        let run = run.as_str();
        let forgotten = events::last_deleted(&mut conn, run).await?;
        if self.after < forgotten {
            self.gap(forgotten, "what happened between is not kept any more");
        } else if self.after > 0 && !self.begun {
            let newest = events::newest(&mut conn, run).await?.max(forgotten);
            if self.after > newest {
                self.gap(
                    newest,
                    "no event so far has such a number: the database is another, or an older one",
                );
            }
        }
        self.begun = true;
        for EventRow { id, kind, body, at } in events::after(&mut conn, run, self.after, PAGE).await? {
            let mut told: Value = from_json("an event", &body)?;
            if let Some(fields) = told.as_object_mut() {
                fields.insert("at".to_owned(), rfc3339(at).into());
            }
            self.waiting.push_back(event(id, kind.as_str(), &told));
            self.after = id;
        }
        Ok(())
    }
}

fn event(id: i64, kind: &str, data: &Value) -> Event {
    // JSON of ours has no line ends.
    Event::default().id(id.to_string()).event(kind).data(data.to_string())
}
