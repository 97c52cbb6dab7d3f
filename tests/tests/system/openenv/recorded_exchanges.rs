//! Repeats the exchanges that `scripts/openenv-exchanges` recorded from the server of openenv 0.10: sessions that HTTP requests and
//! a WebSocket share, and the discovery of tasks.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::Value;
use system_tests::{ApiClient, Received, Server};

use super::socket::OpenEnvSocket;

/// Values of earlier responses by name, and the open sockets.
struct Replay {
    api: ApiClient,
    saved: BTreeMap<String, String>,
    sockets: BTreeMap<String, OpenEnvSocket>,
}

impl Replay {
    /// Replaces the names of saved values in a text.
    fn fill(&self, text: &str) -> String {
        self.saved
            .iter()
            .fold(text.to_owned(), |text, (name, value)| text.replace(&format!("{{{name}}}"), value))
    }

    /// Runs one step, and compares the response with the recorded one.
    async fn run(&mut self, step: &Value) {
        let text = |field: &str| step[field].as_str().unwrap_or_default();
        match text("do") {
            "post" | "get" => self.request(step).await,
            "connect" => {
                let socket = OpenEnvSocket::connect(&self.api, &self.fill(text("path"))).await;
                self.sockets.insert(text("socket").to_owned(), socket);
            }
            "send" => self.socket(text("socket")).send_text(text("text")).await,
            "close" => drop(self.sockets.remove(text("socket"))),
            "wait" => tokio::time::sleep(Duration::from_secs_f64(step["seconds"].as_f64().unwrap())).await,
            "receive" => match self.socket(text("socket")).receive().await {
                Received::Text(ours) => self.compare(step, &ours),
                Received::Closed(code) => assert_eq!(step["response"]["closed"], code, "{step}"),
                other => panic!("{step}: {other:?}"),
            },
            other => panic!("unknown step {other}"),
        }
    }

    fn socket(&mut self, name: &str) -> &mut OpenEnvSocket {
        self.sockets.get_mut(name).unwrap()
    }

    async fn request(&mut self, step: &Value) {
        let path = self.fill(step["path"].as_str().unwrap());
        let answer = if step["do"] == "get" {
            self.api.get(&path).await
        } else {
            self.api.post(&path, serde_json::from_str(&self.fill(&step["body"].to_string())).unwrap()).await
        };
        assert_eq!(step["response"]["status"], answer.status, "{step}: {}", answer.body);
        if let Some([name, pointer]) = step["save"].as_array().map(Vec::as_slice) {
            let value = answer.body.pointer(pointer.as_str().unwrap()).and_then(Value::as_str);
            self.saved.insert(name.as_str().unwrap().to_owned(), value.unwrap().to_owned());
        }
        self.compare(step, &answer.body);
    }

    /// Compares a response with the recorded one. Sessions, their errors and those of fields are equal; observations, tasks and
    /// schemas have the same fields at least.
    fn compare(&self, step: &Value, ours: &Value) {
        let recorded: Value =
            serde_json::from_str(&self.fill(&step["response"]["json"].to_string())).unwrap();
        if step["path"] == "/mcp" || recorded["data"]["code"] == "SESSION_ERROR" {
            assert_eq!(*ours, recorded, "{step}");
        }
        assert_eq!(missing_field(&recorded, ours, ""), None, "{step}: {ours}");
        // A step in the middle of an episode has no metadata.
        let metadata = |frame: &Value| frame["data"].get("metadata").is_some();
        assert_eq!(metadata(ours), metadata(&recorded), "{step}: {ours}");
    }
}

/// Fields whose values are equal wherever they are recorded.
const EQUAL_FIELDS: [&str; 5] = ["type", "code", "loc", "msg", "step_count"];

/// Paths of what belongs to the environment and not to the protocol.
const OF_ENVIRONMENT: [&str; 5] =
    ["/data/observation", "/action", "/observation", "/reset_observation", "/state"];

/// Returns the first recorded field that our response lacks, or whose value differs although it must be equal.
fn missing_field(recorded: &Value, ours: &Value, at: &str) -> Option<String> {
    match recorded {
        _ if OF_ENVIRONMENT.contains(&at) => None,
        Value::Object(fields) => {
            fields.iter().filter(|(name, _)| *name != "url").find_map(|(name, value)| {
                let at = format!("{at}/{name}");
                match ours.get(name) {
                    None => Some(at),
                    Some(ours) if EQUAL_FIELDS.contains(&name.as_str()) && ours != value => Some(at),
                    Some(ours) => missing_field(value, ours, &at),
                }
            })
        }
        Value::Array(items) => {
            let first = items.first().zip(ours.get(0));
            first.and_then(|(recorded, ours)| missing_field(recorded, ours, &format!("{at}/0")))
        }
        _ => None,
    }
}

#[tokio::test]
async fn recorded_exchanges_of_openenv_0_10_repeat() {
    let server = Server::start().await;
    let recorded: Value =
        serde_json::from_str(include_str!("../../../fixtures/openenv-0.10-exchanges.json")).unwrap();
    assert!(recorded["server"].as_str().unwrap().starts_with("openenv 0.10."));
    let mut replay = Replay { api: server.api(), saved: BTreeMap::new(), sockets: BTreeMap::new() };
    let steps = recorded["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 44);
    for step in steps {
        replay.run(step).await;
    }
}
