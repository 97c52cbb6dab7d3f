//! Session on an OpenEnv server: a WebSocket that resets and steps one environment.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use llm::{sanitize_line, tls_config};
use reqwest::Url;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::handshake::client::Request;
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode, header::AUTHORIZATION};
use tokio_tungstenite::tungstenite::{self, Message, protocol::WebSocketConfig};
use tokio_tungstenite::{Connector, MaybeTlsStream, WebSocketStream, connect_async_tls_with_config};

use llm_policy::TimeStep;

use crate::api::CaArgs;
use crate::server_url::parse_server_url;

/// Largest message in bytes. An observation with 1000 pieces of debris has about 100 000 bytes.
const MAX_MESSAGE_BYTES: usize = 8 << 20;
/// Pause between two attempts on a server that has no free session.
const CAPACITY_RETRY_PAUSE: Duration = Duration::from_millis(500);
/// Error code of a server that has no free session.
const CAPACITY_REACHED: &str = "CAPACITY_REACHED";

/// Address of a server, with its WebSocket URL and TLS connector.
#[derive(Clone)]
pub(super) struct ServerAddress {
    base: Url,
    socket: Url,
    tls: Connector,
    /// Header `Authorization`, marked as sensitive.
    authorization: Option<HeaderValue>,
}

impl fmt::Debug for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.socket.as_str())
    }
}

/// Failure of a session.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SessionError {
    /// The server cannot be reached.
    #[error("the environment at {at} cannot be reached: {reason}")]
    Unreachable { at: String, reason: String },
    /// The connection was closed.
    #[error("the environment closed the connection: {reason}")]
    Broken { reason: String },
    /// The response did not arrive in time.
    #[error("the environment did not answer within {after_s} s")]
    Late { after_s: u64 },
    /// The server returned an error; the session continues.
    #[error("the environment rejected the request: {message} ({code})")]
    Refused { code: String, message: String },
    /// The response is no observation.
    #[error("the environment's response is invalid: {reason}")]
    Nonsense { reason: String },
}

/// URLs of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ServerUrls {
    /// URL of its pages, `http` or `https`.
    pub(crate) base: Url,
    /// URL of its sessions, `ws` or `wss`.
    pub(crate) socket: Url,
}

impl ServerUrls {
    /// Derives both URLs from one of them.
    ///
    /// # Errors
    /// Returns an error if the text is no http(s) or ws(s) URL, or has a user, password, query or fragment.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let url = parse_server_url(text, &["http", "https", "ws", "wss"])?;
        let (base, socket) = match url.scheme() {
            "https" | "wss" => ("https", "wss"),
            _ => ("http", "ws"),
        };
        let with = |scheme: &str| {
            Url::parse(&url.as_str().replacen(url.scheme(), scheme, 1)).map_err(|error| error.to_string())
        };
        let (base, mut socket) = (with(base)?, with(socket)?);
        let path = format!("{}/ws", socket.path().trim_end_matches('/'));
        socket.set_path(&path);
        Ok(Self { base, socket })
    }
}

impl ServerAddress {
    /// Parses the address of a server, as `http://127.0.0.1:8700`.
    ///
    /// # Errors
    /// Returns an error if the text is no http(s) or ws(s) URL, or has a user, password, query or fragment, or if the file of
    /// certificate authorities cannot be used.
    pub(super) fn parse(text: &str, ca: &CaArgs) -> anyhow::Result<Self> {
        let ServerUrls { base, socket } = ServerUrls::parse(text).map_err(anyhow::Error::msg)?;
        let tls = if base.scheme() == "https" {
            let config = tls_config(ca.roots(true)).map_err(anyhow::Error::msg)?;
            Connector::Rustls(Arc::new(config))
        } else {
            Connector::Plain
        };
        Ok(Self { base, socket, tls, authorization: None })
    }

    /// Sends this token when a session is opened.
    ///
    /// # Errors
    /// Returns an error if the token has characters that a header cannot have.
    pub(super) fn with_token(mut self, token: &str) -> anyhow::Result<Self> {
        let mut value = HeaderValue::from_str(&format!("Bearer {token}"))
            .map_err(|_| anyhow::anyhow!("the token has characters that a header cannot have"))?;
        value.set_sensitive(true);
        self.authorization = Some(value);
        Ok(self)
    }

    fn request(&self) -> Result<Request, tungstenite::Error> {
        let mut request = self.socket.as_str().into_client_request()?;
        if let Some(value) = &self.authorization {
            request.headers_mut().insert(AUTHORIZATION, value.clone());
        }
        Ok(request)
    }
}

/// Open session on a server.
#[derive(Debug)]
pub(super) struct Session {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    timeout: Duration,
}

impl Session {
    async fn open(address: &ServerAddress, timeout: Duration) -> Result<Self, SessionError> {
        let fault = |reason: String| SessionError::Unreachable {
            at: address.base.as_str().trim_end_matches('/').to_owned(),
            reason: sanitize_line(&reason),
        };
        let config = WebSocketConfig::default()
            .max_message_size(Some(MAX_MESSAGE_BYTES))
            .max_frame_size(Some(MAX_MESSAGE_BYTES));
        let request = address.request().map_err(|error| fault(error.to_string()))?;
        let opening = connect_async_tls_with_config(request, Some(config), true, Some(address.tls.clone()));
        match tokio::time::timeout(timeout, opening).await {
            Ok(Ok((socket, _))) => Ok(Self { socket, timeout }),
            Ok(Err(tungstenite::Error::Http(response))) if response.status() == StatusCode::UNAUTHORIZED => {
                let remedy = "name the environment variable that has a valid token with --env-token-env";
                Err(fault(format!("the server requires a token; {remedy}")))
            }
            Ok(Err(error)) => Err(fault(error.to_string())),
            Err(_) => Err(fault(format!("no answer within {} s", timeout.as_secs()))),
        }
    }

    /// Opens a session and resets it with this data. If the server has no free session, retries until `timeout` has passed.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the server cannot be reached or refuses the reset.
    pub(super) async fn begin(
        address: &ServerAddress,
        data: &Value,
        timeout: Duration,
    ) -> Result<(Self, TimeStep), SessionError> {
        let begun = tokio::time::Instant::now();
        loop {
            let mut session = Self::open(address, timeout).await?;
            match session.reset(data).await {
                Ok(seen) => return Ok((session, seen)),
                Err(SessionError::Refused { code, .. })
                    if code == CAPACITY_REACHED && begun.elapsed() < timeout =>
                {
                    tokio::time::sleep(CAPACITY_RETRY_PAUSE).await;
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Starts a new episode.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the exchange fails or the server refuses the data.
    pub(super) async fn reset(&mut self, data: &Value) -> Result<TimeStep, SessionError> {
        self.ask(&json!({"type": "reset", "data": data})).await
    }

    /// Steps the environment with an action.
    ///
    /// # Errors
    /// Returns [`SessionError`] if the exchange fails or the server refuses the action.
    pub(super) async fn step(&mut self, action: &Value) -> Result<TimeStep, SessionError> {
        self.ask(&json!({"type": "step", "data": action})).await
    }

    /// Closes the session within one second. Failures are ignored.
    pub(super) async fn close(mut self) {
        let goodbye = async {
            let _ = self.socket.send(Message::text(json!({"type": "close"}).to_string())).await;
            let _ = self.socket.close(None).await;
        };
        let _ = tokio::time::timeout(Duration::from_secs(1), goodbye).await;
    }

    async fn ask(&mut self, message: &Value) -> Result<TimeStep, SessionError> {
        let timeout = self.timeout;
        let answer = tokio::time::timeout(timeout, self.exchange(message.to_string())).await;
        let text = answer.map_err(|_| SessionError::Late { after_s: timeout.as_secs() })??;
        parse_response(&text)
    }

    async fn exchange(&mut self, message: String) -> Result<String, SessionError> {
        // A server without a free session sends its error first and closes. That error says more than a failed send.
        let sent = self.socket.send(Message::text(message)).await;
        loop {
            let broken = |reason: String| Err(SessionError::Broken { reason: sanitize_line(&reason) });
            match self.socket.next().await {
                Some(Ok(Message::Text(text))) => return Ok(text.as_str().to_owned()),
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                Some(Ok(Message::Close(frame))) => {
                    return broken(frame.map_or_else(
                        || "it closed".to_owned(),
                        |frame| format!("it closed with {} {}", u16::from(frame.code), frame.reason.as_str()),
                    ));
                }
                Some(Ok(_)) => {
                    return Err(SessionError::Nonsense { reason: "it is no text".to_owned() });
                }
                Some(Err(error)) => return broken(sent.err().unwrap_or(error).to_string()),
                None => return broken(tungstenite::Error::ConnectionClosed.to_string()),
            }
        }
    }
}

/// Parses a response of the server.
pub(crate) fn parse_response(text: &str) -> Result<TimeStep, SessionError> {
    let nonsense = |reason: &str| SessionError::Nonsense { reason: sanitize_line(reason) };
    let mut answer: Value = serde_json::from_str(text).map_err(|error| nonsense(&error.to_string()))?;
    let mut data = answer.get_mut("data").map_or(Value::Null, Value::take);
    match answer["type"].as_str() {
        Some("observation") if data["observation"].is_object() => Ok(TimeStep {
            // A reset has no reward.
            reward: data["reward"].as_f64().unwrap_or(0.0),
            done: data["done"].as_bool().unwrap_or(false),
            observation: data.get_mut("observation").map_or(Value::Null, Value::take),
        }),
        Some("error") => {
            let word = |name: &str| sanitize_line(data[name].as_str().unwrap_or("?"));
            let first = data.pointer("/errors/0").map(|error| {
                let at: Vec<String> = error["loc"]
                    .as_array()
                    .into_iter()
                    .flatten()
                    .map(|at| at.to_string().replace('"', ""))
                    .collect();
                format!(": {}: {}", at.join("."), error["msg"].as_str().unwrap_or_default())
            });
            let message = format!("{}{}", word("message"), first.unwrap_or_default());
            Err(SessionError::Refused { code: word("code"), message: sanitize_line(&message) })
        }
        Some(other) => Err(nonsense(&format!("its type is {other}, not observation"))),
        None => Err(nonsense("it has no type")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn server_addresses_are_validated() {
        let of = |text: &str| {
            ServerAddress::parse(text, &CaArgs::default())
                .map(|address| (address.base.to_string(), address.socket.to_string()))
        };
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(of("http://h:8000").unwrap(), pair("http://h:8000/", "ws://h:8000/ws"));
        assert_eq!(of("https://h/env/").unwrap(), pair("https://h/env/", "wss://h/env/ws"));
        assert_eq!(of("ws://http/x").unwrap(), pair("http://http/x", "ws://http/x/ws"));
        for bad in ["localhost:8000", "ftp://h", "http://me:key@h", "http://h?token=key", "h", "http://"] {
            let said = format!("{:#}", of(bad).unwrap_err());
            assert!(said.contains("must be") && !said.contains("key"), "{said}");
        }
    }

    #[test]
    fn answers_are_observations_or_say_why_not() {
        let seen = parse_response(
            r#"{"type":"observation","data":{"observation":{"a":1},"reward":null,"done":false}}"#,
        )
        .unwrap();
        assert_eq!(seen, TimeStep { observation: json!({"a": 1}), reward: 0.0, done: false });
        let error = json!({"type": "error", "data": {"message": "Invalid message", "code": "VALIDATION_ERROR", "errors":
            [{"type": "missing", "loc": ["burns", 0, "delta_vx"], "msg": "Field required\u{1b}[2J"}]}});
        let of = |text: &str| parse_response(text).unwrap_err().to_string();
        insta::assert_snapshot!(
            [
                of(&error.to_string()),
                of("{"),
                of("[]"),
                of(r#"{"type":"mcp"}"#),
                of(r#"{"type":"observation"}"#)
            ]
            .join("\n")
        );
    }
}
