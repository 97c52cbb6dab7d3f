//! Whole-system tests: a real server on a real socket with a real SQLite file, and real clients.

pub mod model;
mod process;
pub mod survival;

use std::path::PathBuf;

use env_core::rollout::fly;
use env_core::{ActionLog, Flown, Recipe, Scenario, Seed};
use orchestrator::clock::Clock;
use orchestrator::service::{Config, Service};
use serde_json::{Value, json};

pub use self::process::{Process, binary, native};

/// A server in this process, on a database of its own.
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
    /// Starts one.
    ///
    /// # Panics
    /// Where it cannot start.
    pub async fn start() -> Self {
        Self::set_up(|config| config).await
    }

    /// Starts one that reads this clock.
    ///
    /// # Panics
    /// Where it cannot start.
    pub async fn with_clock(clock: Clock) -> Self {
        Self::set_up(move |config| Config { clock: clock.clone(), ..config }).await
    }

    /// Starts one that is set up so, now and whenever it starts again.
    ///
    /// # Panics
    /// Where it cannot start.
    pub async fn set_up(setup: impl Fn(Config) -> Config + Send + Sync + 'static) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut server = Self { service: None, folder, setup: Box::new(setup) };
        server.open().await;
        server
    }

    async fn open(&mut self) {
        let config = (self.setup)(Config::local(self.db()));
        self.service = Some(Service::start(config).await.expect("the server starts"));
    }

    /// The database file.
    #[must_use]
    pub fn db(&self) -> PathBuf {
        self.folder.path().join("sparring.sqlite3")
    }

    /// A client of it.
    ///
    /// # Panics
    /// Where it is stopped.
    #[must_use]
    pub fn api(&self) -> Api {
        Api::new(&self.service.as_ref().expect("the server runs").url())
    }

    /// Stops it in good order, and starts it again on the same database.
    pub async fn restart(&mut self) {
        self.stop().await;
        self.open().await;
    }

    /// Stops it in good order.
    pub async fn stop(&mut self) {
        if let Some(service) = self.service.take() {
            service.stop().await;
        }
    }
}

/// An HTTP client, without TLS.
///
/// # Panics
/// Where there can be none.
#[must_use]
pub fn http_client() -> reqwest::Client {
    designer::llm::http_client(false).expect("plain HTTP needs nothing").build().expect("a client")
}

/// A trainer's side of the API.
#[derive(Debug, Clone)]
pub struct Api {
    client: reqwest::Client,
    base: String,
    token: Option<String>,
}

/// A status and a JSON body.
#[derive(Debug, Clone)]
pub struct Answer {
    /// The HTTP status.
    pub status: u16,
    /// `content-type`.
    pub kind: String,
    /// `retry-after`.
    pub retry_after: Option<String>,
    /// The body.
    pub body: Value,
}

impl Answer {
    /// The body of an answer that must have this status.
    ///
    /// # Panics
    /// Where it has another.
    #[must_use]
    #[track_caller]
    pub fn expect(self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.body);
        self.body
    }
}

impl Api {
    /// A client of the server at this URL.
    #[must_use]
    pub fn new(base: &str) -> Self {
        Self { client: http_client(), base: base.to_owned(), token: None }
    }

    /// The same with a token.
    #[must_use]
    pub fn with_token(self, token: &str) -> Self {
        Self { token: Some(token.to_owned()), ..self }
    }

    /// Where the server is.
    #[must_use]
    pub fn base(&self) -> &str {
        &self.base
    }

    /// Sends a request as it is.
    ///
    /// # Panics
    /// Where the server does not answer.
    pub async fn raw(&self, method: &str, path: &str, kind: &str, body: impl Into<reqwest::Body>) -> Answer {
        self.attempt(method, path, kind, body).await.expect("the server answers")
    }

    /// The same, where it may be that nobody answers.
    ///
    /// # Errors
    /// Nobody answers, or not to the end.
    ///
    /// # Panics
    /// Where the method is none.
    pub async fn attempt(
        &self,
        method: &str,
        path: &str,
        kind: &str,
        body: impl Into<reqwest::Body>,
    ) -> Result<Answer, reqwest::Error> {
        let method = method.parse().expect("a method");
        let mut request =
            self.client.request(method, format!("{}{path}", self.base)).header("content-type", kind);
        if let Some(token) = &self.token {
            request = request.bearer_auth(token);
        }
        let response = request.body(body).send().await?;
        let header =
            |name: &str| response.headers().get(name).and_then(|v| v.to_str().ok()).map(str::to_owned);
        let (status, kind, retry_after) =
            (response.status().as_u16(), header("content-type").unwrap_or_default(), header("retry-after"));
        let bytes = response.bytes().await?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let body = serde_json::from_slice(&bytes).unwrap_or(Value::String(text));
        Ok(Answer { status, kind, retry_after, body })
    }

    /// GET.
    pub async fn get(&self, path: &str) -> Answer {
        self.raw("GET", path, "application/json", "").await
    }

    /// POST of JSON.
    pub async fn post(&self, path: &str, body: Value) -> Answer {
        self.send("POST", path, body).await
    }

    /// Sends JSON by any method.
    pub async fn send(&self, method: &str, path: &str, body: Value) -> Answer {
        self.raw(method, path, "application/json", body.to_string()).await
    }

    /// Takes a lease of `run`.
    ///
    /// # Panics
    /// Where it is not granted.
    pub async fn lease(&self, run: &str, wish: Value) -> Lease {
        Lease(self.post(&format!("/v1/runs/{run}/leases"), wish).await.expect(201))
    }

    /// Reports results to `run`.
    ///
    /// # Panics
    /// Where the batch is refused.
    pub async fn report(&self, run: &str, results: Vec<Value>) -> Value {
        self.post(&format!("/v1/runs/{run}/results"), json!({ "results": results })).await.expect(200)
    }
}

/// A lease as it was answered.
#[derive(Debug, Clone)]
pub struct Lease(pub Value);

impl Lease {
    /// Its id.
    ///
    /// # Panics
    /// Where it has none.
    #[must_use]
    pub fn id(&self) -> &str {
        self.0["lease"].as_str().expect("an id")
    }

    /// (episode, scenario) of every episode, group by group.
    ///
    /// # Panics
    /// Where the lease is malformed.
    #[must_use]
    pub fn episodes(&self) -> Vec<(String, Scenario)> {
        let mut episodes = Vec::new();
        for group in self.0["groups"].as_array().expect("groups") {
            let scenario = self.scenario(group);
            for episode in group["episodes"].as_array().expect("episodes") {
                episodes.push((episode.as_str().expect("a name").to_owned(), scenario.clone()));
            }
        }
        episodes
    }

    /// A group's scenario, from its recipe and seed as a trainer makes it.
    ///
    /// # Panics
    /// Where the lease is malformed.
    #[must_use]
    pub fn scenario(&self, group: &Value) -> Scenario {
        let recipe = &self.0["recipes"][group["recipe"].as_u64().expect("an index") as usize];
        let recipe = Recipe::from_json(recipe).expect("a recipe");
        Scenario::new(recipe, Seed::new(group["seed"].as_u64().expect("a seed")).expect("a valid seed"))
    }
}

/// Flies a scenario by a built-in policy.
///
/// # Panics
/// Where it cannot be flown.
#[must_use]
pub fn flown(scenario: &Scenario, policy: &str) -> (Flown, ActionLog) {
    let mut policy = scenario.task().policy(policy, scenario, 1).expect("a policy");
    fly(scenario, &mut *policy).expect("a flight")
}

/// A log in the wire form.
#[must_use]
pub fn wire(log: &ActionLog) -> Value {
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

/// A result: this episode flown by this policy.
#[must_use]
pub fn result(episode: &str, scenario: &Scenario, policy: &str) -> Value {
    json!({ "episode": episode, "actions": wire(&flown(scenario, policy).1) })
}
