//! Helpers for whole-system tests and benchmarks: a real server on a real socket with a real SQLite file.
//!
//! The library has the server (in this process as [`Server`], or as [`ServerProcess`]), the HTTP client [`ApiClient`],
//! the crash test ([`crash`]) and a scripted language model ([`mock_llm`]). The tests themselves are in `tests/system`.

pub mod crash;
#[cfg(target_os = "linux")]
pub mod faults;
mod incomplete_post;
pub mod mock_llm;
mod polling;
mod process;
mod raw_socket;
mod websocket;

use std::path::PathBuf;

use clock::Clock;
use env_core::rollout::{Rollout, roll_out};
use env_core::{ActionLog, EpisodeOutcome, Recipe, Scenario, Seed};
use orchestrator::service::{Config, Service};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

pub use self::incomplete_post::IncompletePost;
use self::polling::Polling;
pub use self::polling::{try_wait_for, wait_for, wait_until};
pub use self::process::{ServerProcess, native_module, sparring_binary};
pub use self::raw_socket::{raw_frame, upgrade_raw};
pub use self::websocket::{Received, TestSocket};

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

/// Creates an HTTP client without TLS.
///
/// # Panics
/// Panics if the client cannot be built.
#[must_use]
pub fn http_client() -> reqwest::Client {
    llm::http_client_builder(llm::TrustedRoots::None)
        .expect("plain HTTP needs nothing")
        .build()
        .expect("a client")
}

/// HTTP client of the API, as a trainer uses it.
#[derive(Debug, Clone)]
pub struct ApiClient {
    client: reqwest::Client,
    base: String,
    token: Option<String>,
    /// Name of the OpenEnv session of all requests.
    session: Option<String>,
}

/// Response of the API: status, some headers and the JSON body.
#[derive(Debug, Clone)]
pub struct ApiResponse {
    /// HTTP status of the response.
    pub status: u16,
    /// Value of the `content-type` header; empty if absent.
    pub content_type: String,
    /// Value of the `retry-after` header, if present.
    pub retry_after: Option<String>,
    /// JSON body; a JSON string if the body is no JSON.
    pub body: Value,
}

impl ApiResponse {
    /// Returns the body after a check of the status.
    ///
    /// # Panics
    /// Panics if the status differs from `status`.
    #[must_use]
    #[track_caller]
    pub fn expect(self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.body);
        self.body
    }

    /// Parses the body as a type of the API after a check of the status.
    ///
    /// # Errors
    /// Returns an error with the body if the status is not a success or the body has another type.
    pub fn parse<T: DeserializeOwned>(self) -> anyhow::Result<T> {
        anyhow::ensure!((200..300).contains(&self.status), "status {}: {}", self.status, self.body);
        Ok(serde_json::from_value(self.body)?)
    }
}

impl ApiClient {
    /// Creates a client of the server at the URL `base`.
    #[must_use]
    pub fn new(base: &str) -> Self {
        Self { client: http_client(), base: base.to_owned(), token: None, session: None }
    }

    /// Returns the same client with a bearer token.
    #[must_use]
    pub fn with_token(self, token: &str) -> Self {
        Self { token: Some(token.to_owned()), ..self }
    }

    /// Returns the same client with a name of its OpenEnv session.
    #[must_use]
    pub fn with_session(self, name: &str) -> Self {
        Self { session: Some(name.to_owned()), ..self }
    }

    /// Token that the client sends, if any.
    #[must_use]
    pub fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// URL of the server.
    #[must_use]
    pub fn base(&self) -> &str {
        &self.base
    }

    /// Sends a request with any method, content type and body.
    ///
    /// # Panics
    /// Panics if the server does not respond.
    pub async fn request(
        &self,
        method: &str,
        path: &str,
        content_type: &str,
        body: impl Into<reqwest::Body>,
    ) -> ApiResponse {
        self.try_request(method, path, content_type, body).await.expect("the server responds")
    }

    /// Sends a request to a server that may be down.
    ///
    /// # Errors
    /// Returns the client's error if the server cannot be reached or closes the connection early.
    ///
    /// # Panics
    /// Panics if `method` is not a valid HTTP method.
    pub async fn try_request(
        &self,
        method: &str,
        path: &str,
        content_type: &str,
        body: impl Into<reqwest::Body>,
    ) -> Result<ApiResponse, reqwest::Error> {
        let method = method.parse().expect("a valid method");
        let mut request =
            self.client.request(method, format!("{}{path}", self.base)).header("content-type", content_type);
        if let Some(token) = &self.token {
            request = request.bearer_auth(token);
        }
        if let Some(session) = &self.session {
            request = request.header("x-session-id", session);
        }
        let response = request.body(body).send().await?;
        let header =
            |name: &str| response.headers().get(name).and_then(|v| v.to_str().ok()).map(str::to_owned);
        let (status, kind, retry_after) =
            (response.status().as_u16(), header("content-type").unwrap_or_default(), header("retry-after"));
        let bytes = response.bytes().await?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let body = serde_json::from_slice(&bytes).unwrap_or(Value::String(text));
        Ok(ApiResponse { status, content_type: kind, retry_after, body })
    }

    /// Sends a GET request.
    pub async fn get(&self, path: &str) -> ApiResponse {
        self.request("GET", path, "application/json", "").await
    }

    /// Sends a POST request with a JSON body.
    pub async fn post(&self, path: &str, body: Value) -> ApiResponse {
        self.send_json("POST", path, body).await
    }

    /// Sends a JSON body with any method.
    pub async fn send_json(&self, method: &str, path: &str, body: Value) -> ApiResponse {
        self.request(method, path, "application/json", body.to_string()).await
    }

    /// Leases groups of `run`; repeats the request while the server is still preparing scenarios.
    ///
    /// # Panics
    /// Panics if the server rejects the request.
    pub async fn lease(&self, run: &str, request: Value) -> Lease {
        let path = format!("/v1/runs/{run}/leases");
        let polling = Polling::start("scenarios are prepared");
        loop {
            let response = self.post(&path, request.clone()).await;
            if response.body["type"] != "urn:sparring:problem:not_ready" {
                return Lease(response.expect(201));
            }
            polling.pause().await.expect("the server prepares scenarios");
        }
    }

    /// Reports results to `run` and returns the response with one receipt a result.
    ///
    /// # Panics
    /// Panics if the server rejects the batch.
    pub async fn report(&self, run: &str, results: Vec<Value>) -> Value {
        self.post(&format!("/v1/runs/{run}/results"), json!({ "results": results })).await.expect(200)
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
