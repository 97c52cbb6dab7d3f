//! A client of OpenEnv's routes, as near to the wire as the captured exchanges are.

use std::io::Read;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use system_tests::Api;
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

/// A WebSocket to the server.
pub(crate) struct Socket(WebSocketStream<MaybeTlsStream<TcpStream>>);

/// What came over it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Came {
    /// A frame of JSON.
    Frame(Value),
    /// It was closed, with this code.
    Closed(u16),
    /// Nothing, for as long as one waits.
    Nothing,
}

impl Socket {
    /// Connects to a path.
    pub(crate) async fn to(api: &Api, path: &str) -> Self {
        let url = format!("{}{path}", api.base().replacen("http", "ws", 1));
        Self(connect_async(url).await.unwrap().0)
    }

    /// Sends text.
    pub(crate) async fn text(&mut self, text: &str) {
        self.0.send(Message::text(text)).await.unwrap();
    }

    /// Sends text; false where the connection is cut meanwhile.
    pub(crate) async fn try_text(&mut self, text: &str) -> bool {
        self.0.send(Message::text(text)).await.is_ok()
    }

    /// Sends bytes.
    pub(crate) async fn bytes(&mut self, bytes: &[u8]) {
        self.0.send(Message::binary(bytes.to_vec())).await.unwrap();
    }

    /// Sends a ping.
    pub(crate) async fn ping(&mut self) {
        self.0.send(Message::Ping(b"there?".to_vec().into())).await.unwrap();
    }

    /// Whether what comes next is its answer.
    pub(crate) async fn ponged(&mut self) -> bool {
        let came = tokio::time::timeout(std::time::Duration::from_secs(10), self.0.next()).await;
        matches!(came, Ok(Some(Ok(Message::Pong(bytes)))) if bytes.as_ref() == b"there?")
    }

    /// What comes next.
    pub(crate) async fn next(&mut self) -> Came {
        self.next_within(10.0).await
    }

    /// What comes within some seconds.
    pub(crate) async fn next_within(&mut self, seconds: f64) -> Came {
        let patience = std::time::Duration::from_secs_f64(seconds);
        loop {
            match tokio::time::timeout(patience, self.0.next()).await {
                Err(_) => return Came::Nothing,
                Ok(Some(Ok(Message::Text(text)))) => {
                    return Came::Frame(serde_json::from_str(&text).unwrap());
                }
                Ok(Some(Ok(Message::Close(frame)))) => {
                    return Came::Closed(frame.map_or(1005, |frame| frame.code.into()));
                }
                Ok(Some(Ok(_))) => {}
                Ok(Some(Err(_)) | None) => return Came::Closed(1006),
            }
        }
    }

    /// Asks, and what is answered.
    pub(crate) async fn ask(&mut self, message: &Value) -> Value {
        self.text(&message.to_string()).await;
        match self.next().await {
            Came::Frame(frame) => frame,
            other => panic!("{message}: {other:?}"),
        }
    }

    /// Resets with this data; the answer's data.
    pub(crate) async fn reset(&mut self, data: Value) -> Value {
        let told = self.ask(&json!({"type": "reset", "data": data})).await;
        assert_eq!(told["type"], "observation", "{told}");
        told["data"].clone()
    }

    /// Steps with this action; the answer's data.
    pub(crate) async fn step(&mut self, action: Value) -> Value {
        let told = self.ask(&json!({"type": "step", "data": action})).await;
        assert_eq!(told["type"], "observation", "{told}");
        told["data"].clone()
    }

    /// Where the session stands.
    pub(crate) async fn state(&mut self) -> Value {
        self.ask(&json!({"type": "state"})).await["data"].clone()
    }

    /// Goes without a word.
    pub(crate) fn drop_dead(self) {
        drop(self);
    }
}

/// The captured exchanges.
pub(crate) fn exchanges() -> serde_json::Map<String, Value> {
    let bytes = include_bytes!("../../../fixtures/openenv-exchanges.json.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(&bytes[..]).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Words that clients go by: they must be the same. Other texts must be there, and may say it otherwise.
const EXACT: [&str; 7] = ["type", "code", "jsonrpc", "mission_objective", "msg", "id", "closed"];

/// Where an answer is not what was captured: fields, types, codes; `None` if it is. The values of an episode are its own.
pub(crate) fn difference(captured: &Value, ours: &Value, at: &str) -> Option<String> {
    match (captured, ours) {
        (Value::Object(theirs), Value::Object(us)) => {
            // Links into another library's documentation.
            let known = theirs.iter().filter(|(key, _)| *key != "url");
            for (key, value) in known {
                let Some(ours) = us.get(key) else { return Some(format!("{at}.{key} is missing")) };
                let found = difference(value, ours, &format!("{at}.{key}"));
                if found.is_some() {
                    return found;
                }
            }
            us.keys().find(|key| !theirs.contains_key(*key)).map(|key| format!("{at}.{key} is more"))
        }
        (Value::Array(theirs), Value::Array(us)) => {
            if exact_list(at) {
                if theirs.len() != us.len() {
                    return Some(format!("{at} has {} entries and not {}", us.len(), theirs.len()));
                }
                return theirs
                    .iter()
                    .zip(us)
                    .enumerate()
                    .find_map(|(i, (a, b))| difference(a, b, &format!("{at}.{i}")));
            }
            theirs.first().zip(us.first()).and_then(|(a, b)| difference(a, b, &format!("{at}.0")))
        }
        (Value::String(theirs), Value::String(us)) => {
            let last = at.rsplit('.').find(|part| part.parse::<usize>().is_err()).unwrap_or_default();
            let free = ["message", "error"].contains(&last) && !capacity(theirs);
            let exact =
                EXACT.contains(&last) || at.contains(".loc.") || at.contains(".input") || capacity(theirs);
            (exact && !free && theirs != us).then(|| format!("{at} is {us:?} and not {theirs:?}"))
        }
        (Value::Number(theirs), Value::Number(us)) => {
            // Where a text stops being JSON is the parser's to say.
            let place = at.contains(".errors.") && at.contains(".loc.");
            let exact = place || at.ends_with(".code") || at.contains(".ctx");
            (exact && theirs.as_f64() != us.as_f64()).then(|| format!("{at} is {us} and not {theirs}"))
        }
        (Value::Bool(theirs), Value::Bool(us)) => (theirs != us).then(|| format!("{at} is {us}")),
        (Value::Null, Value::Null) => None,
        _ => Some(format!("{at} is {ours} and not {captured}")),
    }
}

fn exact_list(at: &str) -> bool {
    at.ends_with("errors") || at.ends_with("detail") || at.ends_with(".loc")
}

fn capacity(text: &str) -> bool {
    text.starts_with("Server at capacity")
        || text.starts_with("Unknown session_id")
        || text.starts_with("Method not found")
}
