//! An OpenEnv server behind whose protocol real episodes are flown: frames as they were captured of the public one.

use std::sync::{Arc, Mutex};

use axum::Router;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::routing::get;
use env_core::log::Precision;
use env_core::task::{Episode, StepReport};
use env_core::{ActionLog, Recipe, Scenario, Seed, TaskSpec};
use serde_json::{Value, json};

/// Which tasks a server flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Takes {
    /// The one that is asked for, as Sparring does.
    TaskAndSeed,
    /// Three in turn on every connection, whatever is asked for, as the public kessler-env does.
    InTurn,
}

/// What a server does.
#[derive(Debug, Clone)]
pub(crate) struct Ways {
    pub(crate) takes: Takes,
    /// Drops the connection instead of answering this step.
    pub(crate) drops_at: Option<u32>,
    /// Refuses all burns.
    pub(crate) refuses: bool,
    /// Is full for so many connections.
    pub(crate) full_for: u32,
    /// What has happened: a task at each reset, then `step` at its first step.
    pub(crate) seen: Arc<Mutex<Vec<String>>>,
}

impl Ways {
    pub(crate) fn new(takes: Takes) -> Self {
        Self { takes, drops_at: None, refuses: false, full_for: 0, seen: Arc::default() }
    }

    /// The tasks that were flown, in the order in which they were begun.
    pub(crate) fn flown(&self) -> Vec<String> {
        let seen = self.seen.lock().unwrap();
        seen.windows(2).filter(|pair| pair[1] == "step").map(|pair| pair[0].clone()).collect()
    }
}

/// The scenario that a server flies.
pub(crate) fn scenario(task: &str, seed: u64) -> Scenario {
    let task = env_core::task(task).unwrap();
    Scenario::new(Recipe::new(task).unwrap(), Seed::user(seed).unwrap())
}

/// The seed of a server that takes none.
pub(crate) const OWN_SEED: u64 = 5;

/// Starts a server; its address.
pub(crate) async fn serve(ways: &Ways) -> String {
    let connections = Arc::new(Mutex::new(0));
    let app = Router::new().route("/ws", get(connect)).with_state((ways.clone(), connections));
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move { axum::serve(listener, app).await });
    format!("http://{address}")
}

type Shared = (Ways, Arc<Mutex<u32>>);

async fn connect(
    State((ways, connections)): State<Shared>,
    upgrade: WebSocketUpgrade,
) -> axum::response::Response {
    let number = {
        let mut connections = connections.lock().unwrap();
        *connections += 1;
        *connections
    };
    upgrade.on_upgrade(move |socket| async move { session(socket, ways, number).await })
}

/// One flight on a connection.
struct Flight {
    task: &'static dyn TaskSpec,
    episode: Box<dyn Episode>,
}

fn error(message: &str, code: &str) -> Value {
    json!({"type": "error", "data": {"message": message, "code": code}})
}

impl Flight {
    fn begin(ways: &Ways, data: &Value, resets: usize) -> Result<Self, Value> {
        let three = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];
        let (task, seed) = match ways.takes {
            Takes::InTurn => (three[resets % 3], OWN_SEED),
            Takes::TaskAndSeed => {
                (data["task"].as_str().unwrap_or(three[0]), data["seed"].as_u64().unwrap_or(OWN_SEED))
            }
        };
        if env_core::task(task).is_none() {
            return Err(error(&format!("Unknown task: {task}"), "VALIDATION_ERROR"));
        }
        ways.seen.lock().unwrap().push(task.to_owned());
        let scenario = scenario(task, seed);
        Ok(Self { task: scenario.task(), episode: scenario.task().start(&scenario).unwrap() })
    }

    fn step(&mut self, ways: &Ways, data: &Value) -> Result<f64, Value> {
        if self.episode.steps() == 0 {
            ways.seen.lock().unwrap().push("step".to_owned());
        }
        let burns = data["burns"].as_array();
        if ways.refuses && burns.is_some_and(|burns| !burns.is_empty()) {
            let detail = json!([{"type": "missing", "loc": ["burns", 0, "mood"], "msg": "Field required"}]);
            let mut refusal = error("Invalid message", "VALIDATION_ERROR");
            refusal["data"]["errors"] = detail;
            return Err(refusal);
        }
        let entry = |thrust: &Value| {
            json!([thrust["deputy_id"], thrust["thrust_x"], thrust["thrust_y"], thrust["thrust_z"]])
        };
        let step = match data["thrusts"].as_array() {
            Some(thrusts) => thrusts.iter().map(entry).collect(),
            None => data["burns"].clone(),
        };
        let mut log = ActionLog::new(self.task.action_space().columns.len(), Precision::F64);
        self.task
            .read_step(&step, &mut log)
            .map_err(|fault| error(&fault.to_string(), "VALIDATION_ERROR"))?;
        log.end_step();
        let mut report = StepReport::default();
        let stepped = self.episode.step(log.step(0), &mut report);
        stepped.map_err(|fault| error(&fault.to_string(), "EXECUTION_ERROR"))?;
        Ok(report.reward)
    }

    /// What is seen, with reward and end beside it.
    fn answer(&self, reward: f64) -> Value {
        let mut observation = self.episode.telemetry();
        observation.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
        let data = json!({"observation": observation, "reward": reward, "done": self.episode.done()});
        json!({"type": "observation", "data": data})
    }
}

async fn session(mut socket: WebSocket, ways: Ways, number: u32) {
    if number <= ways.full_for {
        let full = error(
            "Server at capacity: 1/1 sessions active. Cannot accept new connections.",
            "CAPACITY_REACHED",
        );
        let _ = socket.send(Message::text(full.to_string())).await;
        let _ = socket.send(Message::Close(None)).await;
        return;
    }
    let mut flight: Option<Flight> = None;
    let mut resets = 0;
    while let Some(Ok(Message::Text(text))) = socket.recv().await {
        let message: Value = serde_json::from_str(&text).unwrap();
        let answer = match message["type"].as_str().unwrap() {
            "reset" => match Flight::begin(&ways, &message["data"], resets) {
                Ok(begun) => {
                    resets += 1;
                    flight.insert(begun).answer(0.0)
                }
                Err(refusal) => refusal,
            },
            "step" => {
                let flight = flight.as_mut().unwrap();
                if ways.drops_at == Some(flight.episode.steps() + 1) {
                    return; // without a word
                }
                match flight.step(&ways, &message["data"]) {
                    Ok(reward) => flight.answer(reward),
                    Err(refusal) => refusal,
                }
            }
            _ => {
                let _ = socket.send(Message::Close(None)).await;
                return;
            }
        };
        if socket.send(Message::text(answer.to_string())).await.is_err() {
            return;
        }
    }
}
