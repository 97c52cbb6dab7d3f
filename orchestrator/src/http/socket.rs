//! WebSockets: limits on frames, pings during long work, timeouts of slow clients, and the closing handshake.

use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use futures_util::SinkExt;

use crate::limits::constants::{MAX_TEXT_FRAME_BYTES, SEND_TIMEOUT, SEND_TIMEOUT_BYTES};
use crate::sessions::CloseReason;

/// Size of the read buffer in bytes. A step has a few hundred bytes, and every idle session holds a buffer.
const READ_BUFFER_BYTES: usize = 4 * 1024;

/// Limits frames to the size of text messages.
pub(super) fn limit_frames(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    limit_frames_to(upgrade, MAX_TEXT_FRAME_BYTES)
}

/// Limits frames to `max_bytes`.
pub(super) fn limit_frames_to(upgrade: WebSocketUpgrade, max_bytes: usize) -> WebSocketUpgrade {
    upgrade.max_message_size(max_bytes).max_frame_size(max_bytes).read_buffer_size(READ_BUFFER_BYTES)
}

/// Input of a WebSocket.
pub(super) enum Received {
    /// Text frame of the client.
    Text(Utf8Bytes),
    /// Binary frame of the client.
    Binary(Bytes),
    /// Frame beyond the size limit.
    TooLarge,
    /// No frame within the idle timeout.
    Idle,
    /// Request to close: the service stops, or the client's access ended.
    Stop(CloseReason),
    /// Normal closing handshake by the client.
    Left,
    /// Loss of the connection without a closing handshake.
    Gone,
}

/// Runs long work (a judge, the preparation of a scenario) and answers pings meanwhile. Returns `None` if the client leaves.
///
/// A client may send one frame before the response, which is stored in `early`. The work is boxed, so that an idle session
/// needs no memory for it.
pub(super) async fn run_while_connected<T>(
    socket: &mut WebSocket,
    early: &mut Option<Received>,
    work: impl Future<Output = T> + Send,
) -> Option<T> {
    let mut work = Box::pin(work);
    loop {
        tokio::select! {
            biased; // most work is ready at once, so that the socket is not polled
            result = &mut work => return Some(result),
            received = receive(socket, None), if early.is_none() => match received {
                Received::Gone | Received::Left => return None,
                received => *early = Some(received),
            },
        }
    }
}

/// Runs long work to completion, even if the client leaves; `early` is then the reason.
pub(super) async fn run_to_completion<T>(
    socket: &mut WebSocket,
    early: &mut Option<Received>,
    work: impl Future<Output = T> + Send,
) -> T {
    let mut work = Box::pin(work);
    loop {
        tokio::select! {
            biased;
            result = &mut work => return result,
            received = receive(socket, None), if early.is_none() => *early = Some(received),
        }
    }
}

/// Receives the next frame, without control frames, for at most `idle`.
///
/// The library answers pings. It reads on while the write buffer is full, so that the buffer would grow by the pongs of a client
/// that sends pings and does not read. Each read therefore waits until all pongs are written. The connection closes a client that
/// reads nothing for [`WRITE_TIMEOUT`](crate::limits::constants::WRITE_TIMEOUT).
pub(super) async fn receive(socket: &mut WebSocket, idle: Option<Duration>) -> Received {
    let frame = async {
        loop {
            if socket.flush().await.is_err() {
                return Received::Gone;
            }
            match socket.recv().await {
                Some(Ok(Message::Text(text))) => return Received::Text(text),
                Some(Ok(Message::Binary(bytes))) => return Received::Binary(bytes),
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                Some(Ok(Message::Close(frame))) => {
                    let _ = socket.flush().await; // sends the answer to the close frame
                    let is_normal = frame.is_none_or(|frame| frame.code == close_code::NORMAL);
                    return if is_normal { Received::Left } else { Received::Gone };
                }
                Some(Err(error)) => return end_after_error(socket, &error).await,
                None => return Received::Gone,
            }
        }
    };
    match idle {
        Some(idle) => tokio::time::timeout(idle, frame).await.unwrap_or(Received::Idle),
        None => frame.await,
    }
}

/// Closes a connection whose next frame is invalid, with the code for the error. A frame beyond the size limit is left to the
/// caller.
async fn end_after_error(socket: &mut WebSocket, error: &axum::Error) -> Received {
    use tokio_tungstenite::tungstenite::Error;
    use tokio_tungstenite::tungstenite::error::ProtocolError::ResetWithoutClosingHandshake;
    let source = std::error::Error::source(error).and_then(|source| source.downcast_ref::<Error>());
    let frame = match source {
        Some(Error::Capacity(_)) => return Received::TooLarge,
        Some(Error::Protocol(error)) if *error != ResetWithoutClosingHandshake => CloseFrame {
            code: close_code::PROTOCOL,
            reason: "the frame violates RFC 6455; use a WebSocket library".into(),
        },
        Some(Error::Utf8(_)) => CloseFrame {
            code: close_code::INVALID,
            reason: "a text message must be UTF-8; send other bytes in binary messages".into(),
        },
        _ => return Received::Gone, // the connection is lost
    };
    let _ = tokio::time::timeout(SEND_TIMEOUT, socket.send(Message::Close(Some(frame)))).await;
    Received::Gone
}

/// Error of a client that disconnected or does not read.
pub(super) struct ClientGone;

/// Sends JSON as a text frame.
pub(super) async fn send_text(socket: &mut WebSocket, frame: Vec<u8>) -> Result<(), ClientGone> {
    // JSON is always UTF-8.
    let text = String::from_utf8(frame).unwrap_or_default();
    send_message(socket, Message::Text(text.into())).await
}

/// Sends a message, with a timeout by its size.
pub(super) async fn send_message(socket: &mut WebSocket, message: Message) -> Result<(), ClientGone> {
    let bytes = match &message {
        Message::Binary(bytes) => bytes.len(),
        _ => 0,
    };
    let timeout = SEND_TIMEOUT + SEND_TIMEOUT * u32::try_from(bytes / SEND_TIMEOUT_BYTES).unwrap_or(0);
    let sent = tokio::time::timeout(timeout, socket.send(message)).await;
    sent.ok().and_then(Result::ok).ok_or(ClientGone)
}

/// Closes the connection as openenv-core does: code 1000, no reason.
pub(super) async fn close(socket: WebSocket) {
    close_with(socket, close_code::NORMAL, "").await;
}

/// Closes the connection after a frame that is too large: the rest of the stream cannot be parsed.
pub(super) async fn close_for_size(socket: WebSocket) {
    close_with(socket, close_code::SIZE, "a frame has at most 4 MiB").await;
}

/// Sends a close frame and waits for the client's, for at most a second.
pub(super) async fn close_with(mut socket: WebSocket, code: u16, reason: &'static str) {
    let frame = CloseFrame { code, reason: reason.into() };
    let _ = tokio::time::timeout(SEND_TIMEOUT, socket.send(Message::Close(Some(frame)))).await;
    // The client's close frame shows that it has read all messages.
    let handshake = async { while let Some(Ok(_)) = socket.recv().await {} };
    let _ = tokio::time::timeout(Duration::from_secs(1), handshake).await;
}
