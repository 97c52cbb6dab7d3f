//! A connection's life: it opens a session or comes back to one, serves it, and leaves it to wait where it drops.

use std::ops::ControlFlow;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, close_code};
use tokio::time::Instant;

use super::super::super::socket::{Gone, Received, close, close_with, deliver, next, to_its_end};
use super::opening::{Opened, begin};
use super::refusal::Refusal;
use super::vector::Told;
use super::{single, vector};
use crate::http::state::AppState;
use crate::sessions::{CloseSignal, ResumableSession, CloseReason, LEASE_CHECK_INTERVAL, SessionAttachment, ClientIdentity};

/// How long a connection may take to open a session.
const OPEN_WITHIN: Duration = Duration::from_secs(10);
const TOO_LARGE: &str = "a frame has at most 16 MiB";

async fn say(socket: &mut WebSocket, text: Bytes) -> Result<(), Gone> {
    // Everything written here is JSON.
    let text = Utf8Bytes::try_from(text).unwrap_or_default();
    deliver(socket, Message::Text(text)).await
}

/// A last word, and goodbye.
async fn bid(mut socket: WebSocket, refusal: &Refusal) {
    let _ = say(&mut socket, refusal.message(None).into()).await;
    close(socket).await;
}

fn ended(why: CloseReason) -> Refusal {
    match why {
        CloseReason::ServerStopping => Refusal::new("stopping", format!("{}; the session ended", why.message())),
        CloseReason::CredentialRevoked => Refusal::new("unauthenticated", format!("{}; the session ended", why.message())),
    }
}

/// Serves one connection.
pub(super) async fn serve(mut socket: WebSocket, app: AppState, who: ClientIdentity) {
    let mut closing = app.sessions.close_signal(&who);
    let mut early = None;
    let Some(opened) = opened(&mut socket, (&app, &who), &mut closing, &mut early).await else { return };
    let Opened { mooring, text, frame, known } = opened;
    let mut told = say(&mut socket, text.into()).await;
    if let (Ok(()), Some(frame)) = (&told, frame) {
        told = deliver(&mut socket, Message::Binary(frame)).await;
    }
    match (told, known) {
        (Ok(()), _) => on_board(socket, &app, mooring, closing, early).await,
        (Err(Gone), true) => mooring.wait_for_resume(app.sessions.limits().resume_timeout, closing).await,
        (Err(Gone), false) => {} // nobody knows how to come back to it
    }
}

/// Waits for the message that opens a session. Until then a connection costs a buffer, and takes no place.
async fn opened(
    socket: &mut WebSocket,
    (app, who): (&AppState, &ClientIdentity),
    closing: &mut CloseSignal,
    early: &mut Option<Received>,
) -> Option<Opened> {
    let until = Instant::now() + OPEN_WITHIN;
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = next(socket, Some(until.saturating_duration_since(Instant::now()))) => received,
                why = closing.closed() => Received::Stop(why),
            },
        };
        let refusal = match received {
            Received::Text(text) => match to_its_end(socket, early, begin(app, who, &text)).await {
                Ok(opened) => return Some(opened),
                Err((id, refusal)) => {
                    if say(socket, refusal.message(id).into()).await.is_err() {
                        return None;
                    }
                    continue;
                }
            },
            Received::Binary(_) => {
                Refusal::new("not_open", "the first message opens a session: send it as text")
            }
            Received::Idle => Refusal::new("silent", "no session was opened for too long").ending(),
            Received::Stop(why) => ended(why).ending(),
            Received::TooLarge => Refusal::new("too_large", TOO_LARGE).ending(),
            Received::Left | Received::Gone => return None,
        };
        let told = say(socket, refusal.message(None).into()).await;
        if told.is_err() || refusal.ends {
            return None;
        }
    }
}

/// What comes next for a session.
enum Came {
    Received(Received),
    Superseded,
}

async fn wait(
    socket: &mut WebSocket,
    mooring: &mut SessionAttachment,
    closing: &mut CloseSignal,
    idle: Option<Duration>,
) -> Came {
    let since = Instant::now();
    loop {
        let left = idle.map(|idle| idle.saturating_sub(since.elapsed()));
        tokio::select! {
            received = next(socket, left) => return Came::Received(received),
            why = closing.closed() => return Came::Received(Received::Stop(why)),
            () = mooring.superseded() => return Came::Superseded,
            () = tokio::time::sleep(LEASE_CHECK_INTERVAL) => {
                if let Some(session) = mooring.session() {
                    session.renew_lease().await;
                }
            }
        }
    }
}

/// What a message comes to.
enum Reply {
    Text(Bytes),
    Binary(Bytes),
    /// A last word.
    End(Bytes),
}

async fn reply(mooring: &mut SessionAttachment, received: Received, ttl_s: u64) -> Reply {
    let flow = match (mooring.session(), received) {
        (Some(ResumableSession::Single(single)), Received::Text(text)) => single::answer(single, &text, ttl_s).await,
        (Some(ResumableSession::Single(_)), _) => {
            let words = "binary frames are not read here: open a session with `vector` for them";
            ControlFlow::Continue(Refusal::new("not_text", words).message(None).into())
        }
        (Some(ResumableSession::Vector(vector)), Received::Text(text)) => vector::text(vector, &text, ttl_s).await,
        (Some(ResumableSession::Vector(vector)), Received::Binary(bytes)) => {
            return match vector::frame(vector, bytes).await {
                Told::Frame(frame) => Reply::Binary(frame),
                Told::Error(error) => Reply::Text(error),
                Told::End(error) => Reply::End(error),
            };
        }
        // Only where what serves it failed.
        (_, _) => ControlFlow::Break(Refusal::new("internal", "the session is gone").message(None).into()),
    };
    match flow {
        ControlFlow::Continue(text) => Reply::Text(text),
        ControlFlow::Break(text) => Reply::End(text),
    }
}

/// Serves a session until it ends, or its connection does.
async fn on_board(
    mut socket: WebSocket,
    app: &AppState,
    mut mooring: SessionAttachment,
    mut closing: CloseSignal,
    mut early: Option<Received>,
) {
    let limits = app.sessions.limits();
    let ttl_s = limits.resume_timeout.as_secs();
    loop {
        let over = closing.reason().map(Received::Stop);
        let came = match over.or_else(|| early.take()) {
            _ if mooring.is_superseded() => Came::Superseded,
            Some(received) => Came::Received(received),
            None => wait(&mut socket, &mut mooring, &mut closing, limits.idle_timeout).await,
        };
        let received = match came {
            Came::Received(received @ (Received::Text(_) | Received::Binary(_))) => received,
            Came::Superseded => {
                drop(mooring); // whoever has it now waits for that
                let words = "another connection resumed this session";
                return bid(socket, &Refusal::new("superseded", words).at("session")).await;
            }
            Came::Received(Received::Idle) => {
                drop(mooring);
                return bid(socket, &Refusal::new("silent", "the session was silent for too long and ended"))
                    .await;
            }
            Came::Received(Received::Stop(why)) => {
                drop(mooring);
                return bid(socket, &ended(why)).await;
            }
            Came::Received(Received::TooLarge) => {
                // What comes after its beginning cannot be told apart; the session can be come back to.
                close_with(socket, close_code::SIZE, TOO_LARGE).await;
                return mooring.wait_for_resume(limits.resume_timeout, closing).await;
            }
            Came::Received(Received::Left) => return,
            Came::Received(Received::Gone) => {
                drop(socket);
                return mooring.wait_for_resume(limits.resume_timeout, closing).await;
            }
        };
        let work = reply(&mut mooring, received, ttl_s);
        let sent = match to_its_end(&mut socket, &mut early, work).await {
            Reply::Text(text) => say(&mut socket, text).await,
            Reply::Binary(frame) => deliver(&mut socket, Message::Binary(frame)).await,
            Reply::End(text) => {
                drop(mooring);
                let _ = say(&mut socket, text).await;
                return close(socket).await;
            }
        };
        if sent.is_err() {
            drop(socket);
            return mooring.wait_for_resume(limits.resume_timeout, closing).await;
        }
    }
}
