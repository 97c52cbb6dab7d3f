//! The policy of a run, as it is asked for, checked and stored.

use llm::LlmClient;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::RunId;
use crate::store::run_policies::{self, RunPolicy, RunPolicyRow};
use crate::store::{from_json, to_json};
use crate::runs::settings::within;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Groups that a feed may hold unacknowledged, where nothing is said.
const AHEAD: u32 = 32;
/// Exchanges that a model is told again, where nothing is said: what `sparring play` does.
const HISTORY: u32 = 2;

/// The model that chat policies ask: the one that the server was started with, and no other.
#[derive(Debug, Clone)]
pub struct Endpoint {
    /// How it is asked.
    pub llm: LlmClient,
    /// How freely it chooses its words, where a run does not say.
    pub temperature: Option<f64>,
}

/// What is kept of observations.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Observations {
    /// What the agents were told in each step, in the wire form.
    #[default]
    Telemetry,
    /// Nothing.
    None,
}

/// The policy of a run, as it is asked for. What is left out is at its default, not as it was; but for `version`.
#[derive(Debug, Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolicyRequest {
    /// `off`, `chat` (the language model that the server was started with), or a built-in policy that every task of the run
    /// has (`GET /v1/tasks` lists them).
    #[schema(example = "heuristic")]
    pub policy: String,
    /// Its version: raised once new weights are behind the endpoint. Groups begun later carry it. It never goes down; left
    /// out it stays as it is.
    pub version: Option<u32>,
    /// Sampling temperature of `chat`, 0 to 5 (what the server was started with, else the endpoint's own).
    pub temperature: Option<f64>,
    /// Exchanges that a `chat` model is told again, 0 to 64 (2).
    pub history: Option<u32>,
    /// Tokens of one answer of `chat`, 16 to 131 072 (what the server was started with).
    pub max_tokens: Option<u32>,
    /// Whether trajectories have what the agents saw: `telemetry` (default) or `none`.
    pub observations: Option<Observations>,
    /// Groups that may wait in the feed unacknowledged, 1 to 4 096 (32). Nothing is flown beyond.
    pub ahead: Option<u32>,
    /// Whether groups whose episodes all have the same score are kept out of the feed, and others flown in their place (false).
    pub refill: Option<bool>,
}

/// The same, complete, as stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PolicySettings {
    /// Sampling temperature of `chat`; none: the endpoint's own.
    pub temperature: Option<f64>,
    /// Exchanges that a `chat` model is told again.
    pub history: u32,
    /// Tokens of one answer of `chat`; none: as the server was started.
    pub max_tokens: Option<u32>,
    /// Whether trajectories have what the agents saw.
    pub observations: Observations,
    /// Groups that may wait in the feed unacknowledged.
    pub ahead: u32,
    /// Whether groups whose episodes all have the same score are kept out of the feed.
    #[serde(default)]
    pub refill: bool,
}

impl Default for PolicySettings {
    fn default() -> Self {
        Self {
            temperature: None,
            history: HISTORY,
            max_tokens: None,
            observations: Observations::default(),
            ahead: AHEAD,
            refill: false,
        }
    }
}

impl PolicySettings {
    /// What is stored of a run.
    ///
    /// # Errors
    /// Something stored that cannot be read.
    pub fn of(row: &RunPolicyRow) -> Result<Self, ServiceError> {
        Ok(from_json("a run's policy", &row.settings)?)
    }

    fn read(wish: &PolicyRequest, endpoint: Option<&Endpoint>) -> Result<Self, ServiceError> {
        let usual = Self::default();
        let temperature = wish.temperature.or_else(|| endpoint.and_then(|endpoint| endpoint.temperature));
        if let Some(temperature) = temperature.filter(|temperature| !(0.0..=5.0).contains(temperature)) {
            return Err(ServiceError::invalid(
                "temperature",
                format!("it is {temperature}, outside 0 to 5"),
            ));
        }
        let settings = Self {
            temperature,
            history: wish.history.unwrap_or(usual.history),
            max_tokens: wish.max_tokens,
            observations: wish.observations.unwrap_or_default(),
            ahead: wish.ahead.unwrap_or(usual.ahead),
            refill: wish.refill.unwrap_or(usual.refill),
        };
        within("history", settings.history, 0, 64)?;
        within("ahead", settings.ahead, 1, 4096)?;
        if let Some(tokens) = settings.max_tokens {
            within("max_tokens", tokens, 16, 131_072)?;
        }
        Ok(settings)
    }
}

/// Sets the policy of a run.
#[derive(Debug)]
pub struct PutPolicy {
    run: RunId,
    policy: RunPolicy,
    version: Option<u32>,
    settings: PolicySettings,
}

impl PutPolicy {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(run: RunId, wish: &PolicyRequest, endpoint: Option<&Endpoint>) -> Result<Self, ServiceError> {
        let policy = RunPolicy::from(wish.policy.clone());
        if policy == RunPolicy::Chat && endpoint.is_none() {
            let reason =
                "this server has no language model that flies; serve with --policy-url and --policy-model";
            return Err(ServiceError::invalid("policy", reason));
        }
        let settings = PolicySettings::read(wish, endpoint)?;
        Ok(Self { run, policy, version: wish.version, settings })
    }
}

impl Change for PutPolicy {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let now = tx.now;
        let RunTx { state: mind, conn, .. } = tx.run(self.run.as_str()).await?;
        if let RunPolicy::BuiltIn(name) = &self.policy {
            for plan in &mind.settings.curriculum.tasks {
                has(&plan.task, name)?;
            }
        }
        let before = run_policies::get(conn, self.run.as_str()).await?.map_or(0, |row| row.version);
        let version = self.version.map_or(before, i64::from);
        if version < before {
            let reason =
                format!("it is {version}, but the run is at {before} already; versions never go down");
            return Err(ServiceError::invalid("version", reason));
        }
        let settings = to_json(&self.settings)?;
        run_policies::put(conn, self.run.as_str(), &self.policy, version, &settings, now).await?;
        tx.outbox.signal(Signal::Rollout);
        Ok(())
    }
}

/// Whether a task has a built-in policy.
fn has(task: &str, policy: &str) -> Result<(), ServiceError> {
    let specs = env_core::task(task).map(|task| task.policies()).unwrap_or_default();
    if specs.iter().any(|spec| spec.name == policy) {
        return Ok(());
    }
    let known: Vec<&str> = specs.iter().map(|spec| spec.name).collect();
    let policy: String = policy.chars().take(60).collect();
    let reason = format!(
        "there is no policy {policy:?} for {task}; choose {}, {}, or one of {}",
        RunPolicy::Off,
        RunPolicy::Chat,
        known.join(", ")
    );
    Err(ServiceError::invalid("policy", reason))
}

/// Remembers what went wrong with a run's policy, for people.
#[derive(Debug)]
pub struct ReportTrouble {
    /// Of which run.
    pub run: String,
    /// What, in a sentence.
    pub words: String,
}

impl Change for ReportTrouble {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        Ok(run_policies::set_trouble(&mut tx.conn, &self.run, &self.words, tx.now).await?)
    }
}
