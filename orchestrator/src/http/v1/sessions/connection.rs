//! Life of a connection: it opens or resumes a session, serves it, and leaves it resumable if the connection is lost.

use std::ops::ControlFlow;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, close_code};
use tokio::time::Instant;

use super::SessionRoute;
use super::error_message::ErrorMessage;
use super::open::{OpenedSession, open_or_resume};
use super::vector::FrameReply;
use super::{single, vector};
use crate::http::socket::{
    ClientGone, Received, close, close_with, receive, run_to_completion, send_message,
};
use crate::http::state::AppState;
use crate::sessions::{CloseReason, CloseSignal, LEASE_CHECK_INTERVAL, ResumableSession, SessionAttachment};

/// Longest time from the connection to an open session.
const OPEN_TIMEOUT: Duration = Duration::from_secs(10);
/// Text of the error for a frame that is too large.
const TOO_LARGE: &str = "a frame must have at most 16 MiB";

/// Sends a text message.
async fn send_text(socket: &mut WebSocket, text: Bytes) -> Result<(), ClientGone> {
    // Every message is JSON, so that it is valid UTF-8.
    let text = Utf8Bytes::try_from(text).unwrap_or_default();
    send_message(socket, Message::Text(text)).await
}

/// Sends a last error and closes the connection.
async fn close_with_error(mut socket: WebSocket, error: &ErrorMessage) {
    let _ = send_text(&mut socket, error.to_json(None).into()).await;
    close(socket).await;
}

/// Error for a session that the server closes.
fn closing_error(reason: CloseReason) -> ErrorMessage {
    match reason {
        CloseReason::ServerStopping => {
            ErrorMessage::new("stopping", format!("{}; the session ended", reason.message()))
        }
        CloseReason::CredentialRevoked => {
            ErrorMessage::new("unauthenticated", format!("{}; the session ended", reason.message()))
        }
    }
}

/// Serves one connection until it closes.
pub(super) async fn serve(mut socket: WebSocket, route: SessionRoute) {
    let mut closing = route.app.sessions.close_signal(&route.client);
    let mut early = None;
    let opened = open_session(&mut socket, &route, &mut closing, &mut early).await;
    let app = route.app;
    let opened = match opened {
        Ok(opened) => opened,
        Err(Some(code)) => return close_with(socket, code, "").await,
        Err(None) => return,
    };
    let OpenedSession { attachment, text, frame, is_resumable } = opened;
    let mut sent = send_text(&mut socket, text.into()).await;
    if let (Ok(()), Some(frame)) = (&sent, frame) {
        sent = send_message(&mut socket, Message::Binary(frame)).await;
    }
    match (sent, is_resumable) {
        (Ok(()), _) => serve_session(socket, &app, attachment, closing, early).await,
        (Err(ClientGone), true) => {
            attachment.wait_for_resume(app.sessions.limits().resume_timeout, closing).await;
        }
        (Err(ClientGone), false) => {} // the client has no token to resume it
    }
}

/// Waits for the message that opens a session. Until then a connection uses a buffer, but no place of the session quota.
///
/// # Errors
/// Returns the code with which to close a connection that opens no session; `None` if the client is gone.
async fn open_session(
    socket: &mut WebSocket,
    route: &SessionRoute,
    closing: &mut CloseSignal,
    early: &mut Option<Received>,
) -> Result<OpenedSession, Option<u16>> {
    let until = Instant::now() + OPEN_TIMEOUT;
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = receive(socket, Some(until.saturating_duration_since(Instant::now()))) => received,
                reason = closing.closed() => Received::Stop(reason),
            },
        };
        let code = if matches!(received, Received::TooLarge) { close_code::SIZE } else { close_code::NORMAL };
        let error = match received {
            Received::Text(text) => {
                match run_to_completion(socket, early, open_or_resume(route, &text)).await {
                    Ok(opened) => return Ok(opened),
                    Err((id, error)) => {
                        if send_text(socket, error.to_json(id).into()).await.is_err() {
                            return Err(None);
                        }
                        continue;
                    }
                }
            }
            Received::Binary(_) => {
                ErrorMessage::new("not_open", "the first message must be text, of the type open or resume")
            }
            Received::Idle => ErrorMessage::new("idle_timeout", "no session was opened within 10 s").ending(),
            Received::Stop(reason) => closing_error(reason).ending(),
            Received::TooLarge => ErrorMessage::new("too_large", TOO_LARGE).ending(),
            Received::Left | Received::Gone => return Err(None),
        };
        send_text(socket, error.to_json(None).into()).await.map_err(|ClientGone| None)?;
        if error.ends_session {
            return Err(Some(code));
        }
    }
}

/// Next event of a session.
enum SessionInput {
    /// Message, or the end of the connection.
    Received(Received),
    /// Another connection has resumed the session.
    Superseded,
}

/// Waits for the next event and renews the lease of the session meanwhile.
async fn next_input(
    socket: &mut WebSocket,
    attachment: &mut SessionAttachment,
    closing: &mut CloseSignal,
    idle: Option<Duration>,
) -> SessionInput {
    let since = Instant::now();
    loop {
        let left = idle.map(|idle| idle.saturating_sub(since.elapsed()));
        tokio::select! {
            received = receive(socket, left) => return SessionInput::Received(received),
            reason = closing.closed() => return SessionInput::Received(Received::Stop(reason)),
            () = attachment.superseded() => return SessionInput::Superseded,
            () = tokio::time::sleep(LEASE_CHECK_INTERVAL) => {
                if let Some(session) = attachment.session() {
                    session.renew_lease().await;
                }
            }
        }
    }
}

/// Reply to a message.
enum Reply {
    /// Text message to the client.
    Text(Bytes),
    /// Binary frame to the client.
    Binary(Bytes),
    /// Last text message, after which the connection is closed.
    End(Bytes),
}

/// Answers a message of the client.
async fn reply(attachment: &mut SessionAttachment, received: Received, ttl_s: u64) -> Reply {
    let flow = match (attachment.session(), received) {
        (Some(ResumableSession::Single(single)), Received::Text(text)) => {
            single::answer(single, &text, ttl_s).await
        }
        (Some(ResumableSession::Single(_)), _) => {
            let words = "the session accepts text messages only; open one with `vector` for binary frames";
            ControlFlow::Continue(ErrorMessage::new("not_text", words).to_json(None).into())
        }
        (Some(ResumableSession::Vector(vector)), Received::Text(text)) => {
            vector::answer_text(vector, &text, ttl_s).await
        }
        (Some(ResumableSession::Vector(vector)), Received::Binary(bytes)) => {
            return match vector::answer_frame(vector, bytes).await {
                FrameReply::Frame(frame) => Reply::Binary(frame),
                FrameReply::Error(error) => Reply::Text(error),
                FrameReply::End(error) => Reply::End(error),
            };
        }
        // A session is missing only after an internal error.
        (_, _) => ControlFlow::Break(
            ErrorMessage::new("internal", "the session was lost; open a new one").to_json(None).into(),
        ),
    };
    match flow {
        ControlFlow::Continue(text) => Reply::Text(text),
        ControlFlow::Break(text) => Reply::End(text),
    }
}

/// Serves a session until it ends or its connection is lost.
async fn serve_session(
    mut socket: WebSocket,
    app: &AppState,
    mut attachment: SessionAttachment,
    mut closing: CloseSignal,
    mut early: Option<Received>,
) {
    let limits = app.sessions.limits();
    let ttl_s = limits.resume_timeout.as_secs();
    loop {
        let over = closing.reason().map(Received::Stop);
        let input = match over.or_else(|| early.take()) {
            _ if attachment.is_superseded() => SessionInput::Superseded,
            Some(received) => SessionInput::Received(received),
            None => next_input(&mut socket, &mut attachment, &mut closing, limits.idle_timeout).await,
        };
        let received = match input {
            SessionInput::Received(received @ (Received::Text(_) | Received::Binary(_))) => received,
            SessionInput::Superseded => {
                drop(attachment); // the new connection waits for this
                let words = "another connection resumed this session";
                return close_with_error(socket, &ErrorMessage::new("superseded", words).at("session")).await;
            }
            SessionInput::Received(Received::Idle) => {
                drop(attachment);
                return close_with_error(
                    socket,
                    &ErrorMessage::new("idle_timeout", "the session ended after its idle timeout"),
                )
                .await;
            }
            SessionInput::Received(Received::Stop(reason)) => {
                drop(attachment);
                return close_with_error(socket, &closing_error(reason)).await;
            }
            SessionInput::Received(Received::TooLarge) => {
                // The rest of the stream cannot be parsed, so that the connection is closed; the session can be resumed.
                close_with(socket, close_code::SIZE, TOO_LARGE).await;
                return attachment.wait_for_resume(limits.resume_timeout, closing).await;
            }
            SessionInput::Received(Received::Left) => return,
            SessionInput::Received(Received::Gone) => {
                drop(socket);
                return attachment.wait_for_resume(limits.resume_timeout, closing).await;
            }
        };
        let work = reply(&mut attachment, received, ttl_s);
        let sent = match run_to_completion(&mut socket, &mut early, work).await {
            Reply::Text(text) => send_text(&mut socket, text).await,
            Reply::Binary(frame) => send_message(&mut socket, Message::Binary(frame)).await,
            Reply::End(text) => {
                drop(attachment);
                let _ = send_text(&mut socket, text).await;
                return close(socket).await;
            }
        };
        if sent.is_err() {
            drop(socket);
            return attachment.wait_for_resume(limits.resume_timeout, closing).await;
        }
    }
}
