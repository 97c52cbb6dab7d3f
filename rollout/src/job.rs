//! A group to roll out: scenario, policy and seeds, in memory and as a message.

use env_core::{Recipe, Scenario, Seed};
use jobs::JobKind;
use policy_files::PolicyReference;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::wire_error::RolloutWireError;

/// Group of episodes to roll out.
#[derive(Debug, Clone)]
pub struct RolloutJob {
    /// Id of the run. It pays for the calls of a language model, and names the state that workers watch.
    pub run: String,
    /// Version of the policy.
    pub policy_version: i64,
    /// Scenario of every episode.
    pub scenario: Scenario,
    /// Policy to roll out.
    pub policy: RolloutPolicy,
    /// Seeds of a stochastic policy, one for each episode.
    pub seeds: Vec<u64>,
    /// True if observations are recorded.
    pub records_observations: bool,
}

/// Policy of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RolloutPolicy {
    /// Text of a [`PolicyReference`]: a built-in policy, or a policy file with its hash.
    Reference(String),
    /// The language model of the process that rolls out.
    Chat(ChatSampling),
}

/// Settings of the policy `chat` that travel with a job.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChatSampling {
    /// Sampling temperature; `None` for the setting of the endpoint.
    pub temperature: Option<f64>,
    /// Number of earlier exchanges in the prompt.
    pub history: u32,
    /// Largest number of tokens of one reply; `None` for the setting of the endpoint.
    pub max_tokens: Option<u32>,
}

impl RolloutPolicy {
    /// Returns the kind of jobs that roll out this policy.
    #[must_use]
    pub fn kind(&self) -> JobKind {
        match self {
            Self::Chat(_) => JobKind::RolloutChat,
            Self::Reference(text) if PolicyReference::parse(text).is_file() => JobKind::RolloutFile,
            Self::Reference(_) => JobKind::RolloutBuiltIn,
        }
    }
}

/// Form of a [`RolloutJob`] as JSON.
#[derive(Serialize, Deserialize)]
struct WireJob {
    run: String,
    policy_version: i64,
    recipe: Value,
    seed: u64,
    policy: RolloutPolicy,
    seeds: Vec<u64>,
    records_observations: bool,
}

impl RolloutJob {
    /// Writes the job.
    ///
    /// # Errors
    /// Returns [`RolloutWireError::Json`] if a value cannot be written.
    pub fn encode(&self) -> Result<Vec<u8>, RolloutWireError> {
        Ok(serde_json::to_vec(&WireJob {
            run: self.run.clone(),
            policy_version: self.policy_version,
            recipe: self.scenario.recipe().to_json(),
            seed: self.scenario.seed().get(),
            policy: self.policy.clone(),
            seeds: self.seeds.clone(),
            records_observations: self.records_observations,
        })?)
    }

    /// Reads a job.
    ///
    /// # Errors
    /// Returns [`RolloutWireError`] if the bytes are no valid job.
    pub fn decode(bytes: &[u8]) -> Result<Self, RolloutWireError> {
        let wire: WireJob = serde_json::from_slice(bytes)?;
        let scenario = Scenario::new(Recipe::from_json(&wire.recipe)?, Seed::new(wire.seed)?);
        Ok(Self {
            run: wire.run,
            policy_version: wire.policy_version,
            scenario,
            policy: wire.policy,
            seeds: wire.seeds,
            records_observations: wire.records_observations,
        })
    }
}
