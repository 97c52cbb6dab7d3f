//! WebSocket client for tests, close to the wire: it sees frames, close codes and missing replies.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::Value;
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

use crate::ApiClient;

/// Time that [`TestSocket::receive`] waits for a message: generous, because machines that run tests are often busy.
const RECEIVE_TIMEOUT: Duration = Duration::from_secs(120);
/// Payload of the pings of this client.
const PING: &[u8] = b"there?";

/// WebSocket to a server. All methods but those that return a result panic if the connection fails.
#[derive(Debug)]
pub struct TestSocket(WebSocketStream<MaybeTlsStream<TcpStream>>);

/// Frame, end of the connection or timeout of [`TestSocket::receive`].
#[derive(Debug, Clone, PartialEq)]
pub enum Received {
    /// Text frame with JSON.
    Text(Value),
    /// Binary frame with its payload.
    Binary(Vec<u8>),
    /// End of the connection with its close code: 1005 without a code, 1006 without a close frame.
    Closed(u16),
    /// Nothing within the timeout.
    Timeout,
}

impl TestSocket {
    /// Connects to a path of the server, with the token of the client if it has one.
    ///
    /// # Panics
    /// Panics if the server rejects the connection.
    pub async fn connect(api: &ApiClient, path: &str) -> Self {
        let mut request = api.websocket_url(path).into_client_request().expect("a URL");
        if let Some(token) = api.token() {
            let value = format!("Bearer {token}").parse().expect("a token is a header value");
            request.headers_mut().insert("authorization", value);
        }
        Self(connect_async(request).await.expect("the server accepts the connection").0)
    }

    /// Sends a text frame.
    ///
    /// # Panics
    /// Panics if the connection is closed.
    pub async fn send_text(&mut self, text: impl Into<String>) {
        self.0.send(Message::text(text.into())).await.expect("the connection is open");
    }

    /// Sends a binary frame.
    ///
    /// # Panics
    /// Panics if the connection is closed.
    pub async fn send_bytes(&mut self, bytes: &[u8]) {
        self.0.send(Message::binary(bytes.to_vec())).await.expect("the connection is open");
    }

    /// Sends a text frame that the server may reject midway; returns false if it closed the connection.
    pub async fn try_send_text(&mut self, text: &str) -> bool {
        self.0.send(Message::text(text)).await.is_ok()
    }

    /// Sends a binary frame that the server may reject midway; returns false if it closed the connection.
    pub async fn try_send_bytes(&mut self, bytes: &[u8]) -> bool {
        self.0.send(Message::binary(bytes.to_vec())).await.is_ok()
    }

    /// Sends a ping.
    ///
    /// # Panics
    /// Panics if the connection is closed.
    pub async fn ping(&mut self) {
        self.0.send(Message::Ping(PING.into())).await.expect("the connection is open");
    }

    /// Returns true if the next message is the pong of [`Self::ping`].
    pub async fn receive_pong(&mut self) -> bool {
        let message = tokio::time::timeout(RECEIVE_TIMEOUT, self.0.next()).await;
        matches!(message, Ok(Some(Ok(Message::Pong(bytes)))) if bytes.as_ref() == PING)
    }

    /// Receives the next frame, or times out after two minutes.
    ///
    /// # Panics
    /// Panics if a text frame is not JSON.
    pub async fn receive(&mut self) -> Received {
        loop {
            match tokio::time::timeout(RECEIVE_TIMEOUT, self.0.next()).await {
                Err(_) => return Received::Timeout,
                Ok(Some(Ok(Message::Text(text)))) => {
                    return Received::Text(serde_json::from_str(&text).expect("JSON"));
                }
                Ok(Some(Ok(Message::Binary(bytes)))) => return Received::Binary(bytes.to_vec()),
                Ok(Some(Ok(Message::Close(frame)))) => {
                    return Received::Closed(frame.map_or(1005, |frame| frame.code.into()));
                }
                Ok(Some(Ok(_))) => {}
                Ok(Some(Err(_)) | None) => return Received::Closed(1006),
            }
        }
    }

    /// Receives the next frame, which must be text.
    ///
    /// # Panics
    /// Panics if anything else is received.
    pub async fn receive_text(&mut self) -> Value {
        match self.receive().await {
            Received::Text(text) => text,
            other => panic!("{other:?} instead of text"),
        }
    }

    /// Receives the next frame, which must be binary.
    ///
    /// # Panics
    /// Panics if anything else is received.
    pub async fn receive_bytes(&mut self) -> Vec<u8> {
        match self.receive().await {
            Received::Binary(bytes) => bytes,
            other => panic!("{other:?} instead of a binary frame"),
        }
    }

    /// Sends a message and receives the reply.
    ///
    /// # Panics
    /// Panics if the reply is not text.
    pub async fn request(&mut self, message: &Value) -> Value {
        self.send_text(message.to_string()).await;
        match self.receive().await {
            Received::Text(reply) => reply,
            other => panic!("{message}: {other:?}"),
        }
    }

    /// Resets the TCP connection: no close frame is sent, and unread data is lost.
    ///
    /// # Panics
    /// Panics if the connection is closed already.
    pub fn abort(mut self) {
        let MaybeTlsStream::Plain(stream) = self.0.get_mut() else { panic!("tests do not use TLS") };
        stream.set_zero_linger().expect("the connection is open");
    }

    /// Sends a close frame.
    ///
    /// # Panics
    /// Panics if the connection is closed already.
    pub async fn close(mut self) {
        self.0.close(None).await.expect("the connection is open");
    }
}
