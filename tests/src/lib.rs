//! Helpers for whole-system tests and benchmarks: a real server on a real socket with a real SQLite file.
//!
//! The library has the server (in this process as [`Server`], or as [`ServerProcess`]), the HTTP client [`ApiClient`],
//! the crash test ([`crash`]) and a scripted language model ([`mock_llm`]). The tests themselves are in `tests/system`.

mod api_client;
#[path = "../../job-queue/src/child_group.rs"]
mod child_group;
pub mod crash;
#[cfg(target_os = "linux")]
pub mod faults;
mod incomplete_post;
pub mod mock_llm;
#[path = "../../job-queue/src/testing.rs"]
pub mod nats_server;
pub mod nginx;
mod polling;
mod process;
mod raw_socket;
pub mod scale;
pub mod shard_cluster;
mod tls;
mod websocket;
pub mod worker_cluster;

use std::path::PathBuf;

use clock::Clock;
use env_core::rollout::{Rollout, roll_out};
use env_core::{ActionLog, EpisodeOutcome, Recipe, Scenario, Seed};
use orchestrator::service::{Config, Service};
use serde_json::{Value, json};

pub use self::api_client::{ApiClient, ApiResponse, http_client};
pub use self::incomplete_post::IncompletePost;
pub use self::polling::{try_wait_for, wait_for, wait_until};
pub use self::process::{ServerProcess, native_module, sparring_binary};
pub use self::raw_socket::{raw_frame, upgrade_raw};
pub use self::tls::TlsFiles;
pub use self::websocket::{Received, TestSocket};

/// Returns true if the variable `SPARRING_LONG_TESTS` is set: `make test-heavy` runs the long forms of tests.
pub fn is_long_test() -> bool {
    std::env::var_os("SPARRING_LONG_TESTS").is_some()
}

/// Server in this process with its own temporary database.
pub struct Server {
    service: Option<Service>,
    folder: tempfile::TempDir,
    setup: Box<dyn Fn(Config) -> Config + Send + Sync>,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server")
            .field("service", &self.service)
            .field("folder", &self.folder)
            .finish_non_exhaustive()
    }
}

impl Server {
    /// Starts a server with the default configuration.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub async fn start() -> Self {
        Self::with_config(|config| config).await
    }

    /// Starts a server that reads `clock` instead of the system clock.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub async fn with_clock(clock: Clock) -> Self {
        Self::with_config(move |config| Config { clock: clock.clone(), ..config }).await
    }

    /// Starts a server whose configuration `setup` adjusts, at this start and at every restart.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub async fn with_config(setup: impl Fn(Config) -> Config + Send + Sync + 'static) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut server = Self { service: None, folder, setup: Box::new(setup) };
        server.open().await;
        server
    }

    async fn open(&mut self) {
        let config = (self.setup)(Config::local(self.db_path()));
        self.service = Some(Service::start(config).await.expect("the server starts"));
    }

    /// Path of the database file.
    #[must_use]
    pub fn db_path(&self) -> PathBuf {
        self.folder.path().join("sparring.sqlite3")
    }

    /// Creates a client of this server.
    ///
    /// # Panics
    /// Panics if the server is stopped.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        ApiClient::new(&self.service.as_ref().expect("the server runs").url())
    }

    /// Stops the server gracefully and starts it again on the same database.
    pub async fn restart(&mut self) {
        self.stop().await;
        self.open().await;
    }

    /// Stops the server gracefully; does nothing if it is stopped already.
    pub async fn stop(&mut self) {
        if let Some(service) = self.service.take() {
            service.stop().await;
        }
    }
}

/// Lease as the server returned it.
#[derive(Debug, Clone)]
pub struct Lease(pub Value);

impl Lease {
    /// Id of the lease.
    ///
    /// # Panics
    /// Panics if the lease has no id.
    #[must_use]
    pub fn id(&self) -> &str {
        self.0["lease"].as_str().expect("the lease has an id")
    }

    /// Episode id and scenario of every episode, group by group.
    ///
    /// # Panics
    /// Panics if the lease is malformed.
    #[must_use]
    pub fn episodes(&self) -> Vec<(String, Scenario)> {
        let mut episodes = Vec::new();
        for group in self.0["groups"].as_array().expect("groups") {
            let scenario = self.scenario(group);
            for episode in group["episodes"].as_array().expect("episodes") {
                episodes.push((episode.as_str().expect("an episode id").to_owned(), scenario.clone()));
            }
        }
        episodes
    }

    /// Runs every episode with a built-in policy and returns the results as the API expects them.
    ///
    /// # Panics
    /// Panics if the lease is malformed.
    #[must_use]
    pub fn results(&self, policy: &str) -> Vec<Value> {
        self.episodes().iter().map(|(id, scenario)| episode_result(id, scenario, policy)).collect()
    }

    /// Builds a group's scenario from its recipe and seed, as a trainer does.
    ///
    /// # Panics
    /// Panics if the lease is malformed.
    #[must_use]
    pub fn scenario(&self, group: &Value) -> Scenario {
        let recipe = &self.0["recipes"][group["recipe"].as_u64().expect("an index") as usize];
        let recipe = Recipe::from_json(recipe).expect("a recipe");
        Scenario::new(recipe, Seed::new(group["seed"].as_u64().expect("a seed")).expect("a valid seed"))
    }
}

/// Episode that a built-in policy ran in this process.
#[derive(Debug, Clone)]
pub struct PolicyRollout {
    /// Outcome of the episode.
    pub outcome: EpisodeOutcome,
    /// Actions of the policy.
    pub log: ActionLog,
}

/// Runs an episode of `scenario` with a built-in policy.
///
/// # Panics
/// Panics if the task has no such policy or the scenario has no valid start.
#[must_use]
pub fn run_policy(scenario: &Scenario, policy: &str) -> PolicyRollout {
    let mut policy = scenario.task().policy(policy, scenario, 1).expect("a built-in policy");
    let Rollout { outcome, log } = roll_out(scenario, &mut *policy).expect("an episode");
    PolicyRollout { outcome, log }
}

/// Converts a log to the JSON form of the API.
#[must_use]
pub fn log_to_json(log: &ActionLog) -> Value {
    let steps: Vec<Value> = log
        .steps()
        .map(|step| {
            let entries = step.agents.iter().zip(step.values.chunks(log.dim()));
            let entry = |(agent, values): (&u32, &[f64])| {
                let cells = std::iter::once(json!(agent)).chain(values.iter().map(|value| json!(value)));
                cells.collect::<Value>()
            };
            entries.map(entry).collect()
        })
        .collect();
    json!({ "steps": steps })
}

/// Runs an episode with a built-in policy and returns the result as the API expects it.
#[must_use]
pub fn episode_result(episode: &str, scenario: &Scenario, policy: &str) -> Value {
    json!({ "episode": episode, "actions": log_to_json(&run_policy(scenario, policy).log) })
}
