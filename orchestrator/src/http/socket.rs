//! What every socket does here: bounded frames, pings answered while work is done, a client that does not read, a goodbye.

use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};

use crate::sessions::CloseReason;

/// Largest frame of text that is read, bytes.
pub(super) const MAX_FRAME: usize = 4 * 1024 * 1024;
/// Bytes that are read at once: a step has a few hundred, and every idle session holds a buffer.
const READ_AT_ONCE: usize = 4 * 1024;

/// How sockets of text are read here.
pub(super) fn bounded(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    bounded_by(upgrade, MAX_FRAME)
}

/// How sockets are read whose frames are larger.
pub(super) fn bounded_by(upgrade: WebSocketUpgrade, most: usize) -> WebSocketUpgrade {
    upgrade.max_message_size(most).max_frame_size(most).read_buffer_size(READ_AT_ONCE)
}

/// What came.
pub(super) enum Received {
    /// A text frame.
    Text(Utf8Bytes),
    /// A binary frame.
    Binary(Bytes),
    /// A frame that is larger than is read.
    TooLarge,
    /// Nothing for too long.
    Idle,
    /// The service stops, or the client may not stay.
    Stop(CloseReason),
    /// The client said goodbye.
    Left,
    /// The client is gone.
    Gone,
}

/// Waits for what takes a while (a judge, a scenario that is prepared) and answers pings meanwhile; none where the client
/// goes away. The one frame that it may send before it is answered is `early`. The work is boxed, so that a session that is
/// silent holds no room for it.
pub(super) async fn meanwhile<T>(
    socket: &mut WebSocket,
    early: &mut Option<Received>,
    work: impl Future<Output = T> + Send,
) -> Option<T> {
    let mut work = Box::pin(work);
    loop {
        tokio::select! {
            biased; // most work is done at once, and the socket is not looked at
            done = &mut work => return Some(done),
            received = next(socket, None), if early.is_none() => match received {
                Received::Gone | Received::Left => return None,
                received => *early = Some(received),
            },
        }
    }
}

/// The same for work that is done to its end even where the client goes away, which is what comes `early` then.
pub(super) async fn to_its_end<T>(
    socket: &mut WebSocket,
    early: &mut Option<Received>,
    work: impl Future<Output = T> + Send,
) -> T {
    let mut work = Box::pin(work);
    loop {
        tokio::select! {
            biased;
            done = &mut work => return done,
            received = next(socket, None), if early.is_none() => *early = Some(received),
        }
    }
}

/// The next frame that is not about the connection.
pub(super) async fn next(socket: &mut WebSocket, idle: Option<Duration>) -> Received {
    let frame = async {
        loop {
            match socket.recv().await {
                Some(Ok(Message::Text(text))) => return Received::Text(text),
                Some(Ok(Message::Binary(bytes))) => return Received::Binary(bytes),
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {} // answered by the library
                Some(Err(error)) if is_too_large(&error) => return Received::TooLarge,
                Some(Ok(Message::Close(frame)))
                    if frame.as_ref().is_none_or(|frame| frame.code == close_code::NORMAL) =>
                {
                    return Received::Left;
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return Received::Gone,
            }
        }
    };
    match idle {
        Some(idle) => tokio::time::timeout(idle, frame).await.unwrap_or(Received::Idle),
        None => frame.await,
    }
}

/// How long a client may take to read what it asked for, and as long again for every so many bytes of it.
const SLOW: Duration = Duration::from_secs(10);
const BYTES_PER_SLOW: usize = 10 << 20;

/// The client is gone, or does not read.
pub(super) struct Gone;

/// Sends a frame of text.
pub(super) async fn send(socket: &mut WebSocket, frame: Vec<u8>) -> Result<(), Gone> {
    // Everything written here is JSON.
    let text = String::from_utf8(frame).unwrap_or_default();
    deliver(socket, Message::Text(text.into())).await
}

/// Sends a message.
pub(super) async fn deliver(socket: &mut WebSocket, message: Message) -> Result<(), Gone> {
    let bytes = match &message {
        Message::Binary(bytes) => bytes.len(),
        _ => 0,
    };
    let patience = SLOW + SLOW * u32::try_from(bytes / BYTES_PER_SLOW).unwrap_or(0);
    let sent = tokio::time::timeout(patience, socket.send(message)).await;
    sent.ok().and_then(Result::ok).ok_or(Gone)
}

fn is_too_large(error: &axum::Error) -> bool {
    use tokio_tungstenite::tungstenite::Error;
    let source = std::error::Error::source(error).and_then(|source| source.downcast_ref::<Error>());
    matches!(source, Some(Error::Capacity(_)))
}

/// Says goodbye as openenv-core does: code 1000, no reason.
pub(super) async fn close(socket: WebSocket) {
    close_with(socket, close_code::NORMAL, "").await;
}

/// Says goodbye to who sent a frame that is too large: what comes after its beginning cannot be told apart.
pub(super) async fn close_for_size(socket: WebSocket) {
    close_with(socket, close_code::SIZE, "a frame has at most 4 MiB").await;
}

/// Says goodbye.
pub(super) async fn close_with(mut socket: WebSocket, code: u16, reason: &'static str) {
    let frame = CloseFrame { code, reason: reason.into() };
    let _ = tokio::time::timeout(SLOW, socket.send(Message::Close(Some(frame)))).await;
    // Until the client has answered, so that what was sent before is read.
    let farewell = async { while let Some(Ok(_)) = socket.recv().await {} };
    let _ = tokio::time::timeout(Duration::from_secs(1), farewell).await;
}
