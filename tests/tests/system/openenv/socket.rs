//! Client of OpenEnv's WebSocket routes, and the comparison with captured exchanges.

use std::io::Read;
use std::ops::{Deref, DerefMut};

use serde_json::{Value, json};
use system_tests::{ApiClient, TestSocket};

/// WebSocket to one of OpenEnv's routes.
pub(crate) struct OpenEnvSocket(TestSocket);

impl Deref for OpenEnvSocket {
    type Target = TestSocket;

    fn deref(&self) -> &TestSocket {
        &self.0
    }
}

impl DerefMut for OpenEnvSocket {
    fn deref_mut(&mut self) -> &mut TestSocket {
        &mut self.0
    }
}

impl OpenEnvSocket {
    pub(crate) async fn connect(api: &ApiClient, path: &str) -> Self {
        Self(TestSocket::connect(api, path).await)
    }

    /// Resets with this data and returns the data of the observation.
    pub(crate) async fn reset(&mut self, data: Value) -> Value {
        self.request_observation(&json!({"type": "reset", "data": data})).await
    }

    /// Steps with this action and returns the data of the observation.
    pub(crate) async fn step(&mut self, action: Value) -> Value {
        self.request_observation(&json!({"type": "step", "data": action})).await
    }

    async fn request_observation(&mut self, message: &Value) -> Value {
        let reply = self.request(message).await;
        assert_eq!(reply["type"], "observation", "{reply}");
        reply["data"].clone()
    }

    /// Returns the state of the session.
    pub(crate) async fn state(&mut self) -> Value {
        self.request(&json!({"type": "state"})).await["data"].clone()
    }
}

/// Returns the captured exchanges by name.
pub(crate) fn captured_exchanges() -> serde_json::Map<String, Value> {
    let bytes = include_bytes!("../../../fixtures/openenv-exchanges.json.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(&bytes[..]).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Fields whose text clients depend on, so that it must be equal. Other texts must be present and may differ.
const EXACT_FIELDS: [&str; 7] = ["type", "code", "jsonrpc", "mission_objective", "msg", "id", "closed"];

/// Returns the first difference in fields, types or codes between a captured response and ours. Values of observations may
/// differ.
pub(crate) fn find_difference(captured: &Value, ours: &Value, at: &str) -> Option<String> {
    match (captured, ours) {
        (Value::Object(theirs), Value::Object(us)) => {
            // `url` is a link to the documentation of pydantic.
            let known = theirs.iter().filter(|(key, _)| *key != "url");
            for (key, value) in known {
                let Some(ours) = us.get(key) else { return Some(format!("{at}.{key} is missing")) };
                let found = find_difference(value, ours, &format!("{at}.{key}"));
                if found.is_some() {
                    return found;
                }
            }
            // Later versions of OpenEnv have `metadata` beside an observation.
            let is_later = |key: &str| key == "metadata" && us.contains_key("observation");
            us.keys()
                .find(|key| !theirs.contains_key(*key) && !is_later(key))
                .map(|key| format!("{at}.{key} is not in the captured response"))
        }
        (Value::Array(theirs), Value::Array(us)) => {
            if is_exact_list(at) {
                if theirs.len() != us.len() {
                    return Some(format!("{at} has {} entries and not {}", us.len(), theirs.len()));
                }
                return theirs
                    .iter()
                    .zip(us)
                    .enumerate()
                    .find_map(|(i, (a, b))| find_difference(a, b, &format!("{at}.{i}")));
            }
            theirs.first().zip(us.first()).and_then(|(a, b)| find_difference(a, b, &format!("{at}.0")))
        }
        (Value::String(theirs), Value::String(us)) => {
            let last = at.rsplit('.').find(|part| part.parse::<usize>().is_err()).unwrap_or_default();
            let free = ["message", "error"].contains(&last) && !is_exact_message(theirs);
            let exact = EXACT_FIELDS.contains(&last)
                || at.contains(".loc.")
                || at.contains(".input")
                || is_exact_message(theirs);
            (exact && !free && theirs != us).then(|| format!("{at} is {us:?} and not {theirs:?}"))
        }
        (Value::Number(theirs), Value::Number(us)) => {
            // The position of a JSON syntax error depends on the parser.
            let place = at.contains(".errors.") && at.contains(".loc.");
            let exact = place || at.ends_with(".code") || at.contains(".ctx");
            (exact && theirs.as_f64() != us.as_f64()).then(|| format!("{at} is {us} and not {theirs}"))
        }
        (Value::Bool(theirs), Value::Bool(us)) => (theirs != us).then(|| format!("{at} is {us}")),
        (Value::Null, Value::Null) => None,
        _ => Some(format!("{at} is {ours} and not {captured}")),
    }
}

fn is_exact_list(at: &str) -> bool {
    at.ends_with("errors") || at.ends_with("detail") || at.ends_with(".loc")
}

fn is_exact_message(text: &str) -> bool {
    text.starts_with("Server at capacity")
        || text.starts_with("Unknown session_id")
        || text.starts_with("Method not found")
}
