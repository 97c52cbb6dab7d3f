//! The policy of a run: its request, its stored settings, and the changes that set it.

use llm::LlmClient;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::ids::RunId;
use crate::runs::validate::check_range;
use crate::store::run_policies::{self, RunPolicy, RunPolicyRow};
use crate::store::{from_json, to_json};

/// Default number of unacknowledged groups in a feed.
const DEFAULT_AHEAD: u32 = 32;
/// Default number of earlier exchanges in a prompt, the same as in `sparring play`.
const DEFAULT_HISTORY: u32 = 2;

/// The language model of chat policies: the one that the server was started with.
#[derive(Debug, Clone)]
pub struct Endpoint {
    /// Client of the model.
    pub llm: LlmClient,
    /// Sampling temperature of runs that set none.
    pub temperature: Option<f64>,
}

/// Kind of observations in trajectories.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Observations {
    /// The observation of each step, in the wire form.
    #[default]
    Telemetry,
    /// Trajectories have no observations.
    None,
}

/// Request to set the policy of a run. A field that is left out gets its default, not its previous value; only `version` stays.
#[derive(Debug, Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolicyRequest {
    /// `off`, `chat` (the language model that the server was started with), or a built-in policy that every task of the run
    /// has (`GET /v1/tasks` lists them).
    #[schema(example = "heuristic")]
    pub policy: String,
    /// Version of the policy: raise it once the endpoint serves new weights. Groups that start later carry it. It never
    /// decreases; if left out, it stays.
    pub version: Option<u32>,
    /// Sampling temperature of `chat`, 0 to 5 (the setting that the server was started with, else the endpoint's own).
    pub temperature: Option<f64>,
    /// Earlier exchanges in the prompt of a `chat` model, 0 to 64 (2).
    pub history: Option<u32>,
    /// Maximum tokens of one answer of `chat`, 16 to 131 072 (the setting that the server was started with).
    pub max_tokens: Option<u32>,
    /// Observations in trajectories: `telemetry` (default) or `none`.
    pub observations: Option<Observations>,
    /// Maximum number of unacknowledged groups in the feed, 1 to 4 096 (32). No more are rolled out.
    pub ahead: Option<u32>,
    /// True to keep groups whose episodes all have the same score out of the feed, and roll out others in their place (false).
    pub refill: Option<bool>,
}

/// Settings of a run's policy, complete, as stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PolicySettings {
    /// Sampling temperature of `chat`; `None` uses the endpoint's own.
    pub temperature: Option<f64>,
    /// Earlier exchanges in the prompt of a `chat` model.
    pub history: u32,
    /// Maximum tokens of one answer of `chat`; `None` uses the server's setting.
    pub max_tokens: Option<u32>,
    /// Observations that trajectories have.
    pub observations: Observations,
    /// Maximum number of unacknowledged groups in the feed.
    pub ahead: u32,
    /// True if groups whose episodes all have the same score are kept out of the feed.
    #[serde(default)]
    pub refill: bool,
}

impl Default for PolicySettings {
    fn default() -> Self {
        Self {
            temperature: None,
            history: DEFAULT_HISTORY,
            max_tokens: None,
            observations: Observations::default(),
            ahead: DEFAULT_AHEAD,
            refill: false,
        }
    }
}

impl PolicySettings {
    /// Reads the settings of a stored policy.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if the stored JSON cannot be read.
    pub fn from_row(row: &RunPolicyRow) -> Result<Self, ServiceError> {
        Ok(from_json("a run's policy", &row.settings)?)
    }

    /// Checks a request and returns complete settings.
    fn from_request(request: &PolicyRequest, endpoint: Option<&Endpoint>) -> Result<Self, ServiceError> {
        let defaults = Self::default();
        let temperature = request.temperature.or_else(|| endpoint.and_then(|endpoint| endpoint.temperature));
        if let Some(temperature) = temperature.filter(|temperature| !(0.0..=5.0).contains(temperature)) {
            return Err(ServiceError::invalid("temperature", format!("it is {temperature}, outside 0 to 5")));
        }
        let settings = Self {
            temperature,
            history: request.history.unwrap_or(defaults.history),
            max_tokens: request.max_tokens,
            observations: request.observations.unwrap_or_default(),
            ahead: request.ahead.unwrap_or(defaults.ahead),
            refill: request.refill.unwrap_or(defaults.refill),
        };
        check_range("history", settings.history, 0, 64)?;
        check_range("ahead", settings.ahead, 1, 4096)?;
        if let Some(tokens) = settings.max_tokens {
            check_range("max_tokens", tokens, 16, 131_072)?;
        }
        Ok(settings)
    }
}

/// Sets the policy of a run, after checking that its tasks have it.
#[derive(Debug)]
pub struct SetPolicy {
    run: RunId,
    policy: RunPolicy,
    version: Option<u32>,
    settings: PolicySettings,
}

impl SetPolicy {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn from_request(
        run: RunId,
        request: &PolicyRequest,
        endpoint: Option<&Endpoint>,
    ) -> Result<Self, ServiceError> {
        let policy = RunPolicy::from(request.policy.clone());
        if policy == RunPolicy::Chat && endpoint.is_none() {
            let reason =
                "this server has no language model that flies; serve with --policy-url and --policy-model";
            return Err(ServiceError::invalid("policy", reason));
        }
        let settings = PolicySettings::from_request(request, endpoint)?;
        Ok(Self { run, policy, version: request.version, settings })
    }
}

impl Change for SetPolicy {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let run = tx.run(self.run.as_str()).await?;
        if let RunPolicy::BuiltIn(name) = &self.policy {
            for plan in &run.state.settings.curriculum.tasks {
                check_policy(&plan.task, name)?;
            }
        }
        let before = run_policies::get(run.conn, self.run.as_str()).await?.map_or(0, |row| row.version);
        let version = self.version.map_or(before, i64::from);
        if version < before {
            let reason =
                format!("it is {version}, but the run is at {before} already; versions never go down");
            return Err(ServiceError::invalid("version", reason));
        }
        let settings = to_json(&self.settings)?;
        run_policies::put(run.conn, self.run.as_str(), &self.policy, version, &settings, run.now).await?;
        run.outbox.signal(Signal::Rollout);
        Ok(())
    }
}

/// Checks that a task has a built-in policy.
fn check_policy(task: &str, policy: &str) -> Result<(), ServiceError> {
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

/// Stores why a run's policy failed, for display.
#[derive(Debug)]
pub struct SetPolicyTrouble {
    /// Id of the run.
    pub run: String,
    /// Why it failed, as a sentence.
    pub trouble: String,
}

impl Change for SetPolicyTrouble {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        Ok(run_policies::set_trouble(&mut tx.conn, &self.run, &self.trouble, tx.now).await?)
    }
}
