//! OpenEnv server for tests that runs real episodes; its frames have the form that was captured from the public server.

use std::sync::{Arc, Mutex};

use axum::Router;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::routing::get;
use env_core::log::Precision;
use env_core::task::{Episode, StepReport};
use env_core::{ActionLog, Recipe, Scenario, Seed, TaskSpec};
use serde_json::{Value, json};

/// How a server chooses the task of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TaskChoice {
    /// Uses the requested task and seed, as Sparring does.
    OnRequest,
    /// Cycles through three tasks on each connection, whatever is requested, as the public kessler-env does.
    Cycle,
}

/// Behaviour of a server, and a log of what it did.
#[derive(Debug, Clone)]
pub(crate) struct ServerOptions {
    pub(crate) task_choice: TaskChoice,
    /// Drops the connection at this step instead of a reply.
    pub(crate) drop_at_step: Option<u32>,
    /// True if the server rejects all burns.
    pub(crate) rejects_burns: bool,
    /// Number of connections that the server rejects because it is full.
    pub(crate) full_connections: u32,
    /// Log of resets and first steps: the task at each reset, `step` at the first step of an episode.
    pub(crate) log: Arc<Mutex<Vec<String>>>,
}

impl ServerOptions {
    pub(crate) fn new(task_choice: TaskChoice) -> Self {
        Self {
            task_choice,
            drop_at_step: None,
            rejects_burns: false,
            full_connections: 0,
            log: Arc::default(),
        }
    }

    /// Returns the tasks of the episodes that were stepped, in the order of their resets.
    pub(crate) fn episode_tasks(&self) -> Vec<String> {
        let log = self.log.lock().unwrap();
        log.windows(2).filter(|pair| pair[1] == "step").map(|pair| pair[0].clone()).collect()
    }
}

/// Returns the scenario of a task and a user seed with default params.
pub(crate) fn standard_scenario(task: &str, seed: u64) -> Scenario {
    let task = env_core::task(task).unwrap();
    Scenario::new(Recipe::new(task).unwrap(), Seed::user(seed).unwrap())
}

/// Seed of a server that ignores the requested seed, and of requests without one.
pub(crate) const DEFAULT_SEED: u64 = 5;

/// Starts a server and returns its URL.
pub(crate) async fn serve(options: &ServerOptions) -> String {
    let connections = Arc::new(Mutex::new(0));
    let app = Router::new().route("/ws", get(connect)).with_state((options.clone(), connections));
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move { axum::serve(listener, app).await });
    format!("http://{address}")
}

type SharedState = (ServerOptions, Arc<Mutex<u32>>);

async fn connect(
    State((options, connections)): State<SharedState>,
    upgrade: WebSocketUpgrade,
) -> axum::response::Response {
    let connection_number = {
        let mut connections = connections.lock().unwrap();
        *connections += 1;
        *connections
    };
    upgrade.on_upgrade(move |socket| async move { run_session(socket, options, connection_number).await })
}

/// Episode in progress on a connection.
struct RunningEpisode {
    task: &'static dyn TaskSpec,
    episode: Box<dyn Episode>,
}

fn error_frame(message: &str, code: &str) -> Value {
    json!({"type": "error", "data": {"message": message, "code": code}})
}

impl RunningEpisode {
    fn start(options: &ServerOptions, data: &Value, resets: usize) -> Result<Self, Value> {
        let tasks = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];
        let (task, seed) = match options.task_choice {
            TaskChoice::Cycle => (tasks[resets % 3], DEFAULT_SEED),
            TaskChoice::OnRequest => {
                (data["task"].as_str().unwrap_or(tasks[0]), data["seed"].as_u64().unwrap_or(DEFAULT_SEED))
            }
        };
        if env_core::task(task).is_none() {
            return Err(error_frame(&format!("Unknown task: {task}"), "VALIDATION_ERROR"));
        }
        options.log.lock().unwrap().push(task.to_owned());
        let scenario = standard_scenario(task, seed);
        Ok(Self { task: scenario.task(), episode: scenario.task().start(&scenario).unwrap() })
    }

    fn step(&mut self, options: &ServerOptions, data: &Value) -> Result<f64, Value> {
        if self.episode.steps() == 0 {
            options.log.lock().unwrap().push("step".to_owned());
        }
        let burns = data["burns"].as_array();
        if options.rejects_burns && burns.is_some_and(|burns| !burns.is_empty()) {
            let detail = json!([{"type": "missing", "loc": ["burns", 0, "mood"], "msg": "Field required"}]);
            let mut rejection = error_frame("Invalid message", "VALIDATION_ERROR");
            rejection["data"]["errors"] = detail;
            return Err(rejection);
        }
        let entry = |thrust: &Value| {
            json!([thrust["deputy_id"], thrust["thrust_x"], thrust["thrust_y"], thrust["thrust_z"]])
        };
        let step = match data["thrusts"].as_array() {
            Some(thrusts) => thrusts.iter().map(entry).collect(),
            None => data["burns"].clone(),
        };
        let mut log = ActionLog::new(self.task.action_space().dim(), Precision::F64);
        self.task
            .read_step(&step, &mut log)
            .map_err(|fault| error_frame(&fault.to_string(), "VALIDATION_ERROR"))?;
        log.end_step();
        let mut report = StepReport::default();
        let stepped = self.episode.step(log.step(0), &mut report);
        stepped.map_err(|fault| error_frame(&fault.to_string(), "EXECUTION_ERROR"))?;
        Ok(report.reward)
    }

    /// Builds a frame with the observation, the reward and the end of the episode.
    fn observation_frame(&self, reward: f64) -> Value {
        let mut observation = self.episode.telemetry();
        observation.as_object_mut().unwrap().retain(|name, _| name != "reward" && name != "done");
        let data = json!({"observation": observation, "reward": reward, "done": self.episode.done()});
        json!({"type": "observation", "data": data})
    }
}

async fn run_session(mut socket: WebSocket, options: ServerOptions, connection_number: u32) {
    if connection_number <= options.full_connections {
        let full = error_frame(
            "Server at capacity: 1/1 sessions active. Cannot accept new connections.",
            "CAPACITY_REACHED",
        );
        let _ = socket.send(Message::text(full.to_string())).await;
        let _ = socket.send(Message::Close(None)).await;
        return;
    }
    let mut running: Option<RunningEpisode> = None;
    let mut resets = 0;
    while let Some(Ok(Message::Text(text))) = socket.recv().await {
        let message: Value = serde_json::from_str(&text).unwrap();
        let observation_frame = match message["type"].as_str().unwrap() {
            "reset" => match RunningEpisode::start(&options, &message["data"], resets) {
                Ok(started) => {
                    resets += 1;
                    running.insert(started).observation_frame(0.0)
                }
                Err(rejection) => rejection,
            },
            "step" => {
                let running = running.as_mut().unwrap();
                if options.drop_at_step == Some(running.episode.steps() + 1) {
                    return; // without a close frame
                }
                match running.step(&options, &message["data"]) {
                    Ok(reward) => running.observation_frame(reward),
                    Err(rejection) => rejection,
                }
            }
            _ => {
                let _ = socket.send(Message::Close(None)).await;
                return;
            }
        };
        if socket.send(Message::text(observation_frame.to_string())).await.is_err() {
            return;
        }
    }
}
