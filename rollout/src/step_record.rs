//! Recorded steps of an episode. Their JSON is that of `api_types::TrajectoryStep`.

use api_types::AgentResult;
use llm_policy::Completion;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

/// Size of a group as JSON, in bytes, above which observations are left out, then conversations.
pub const MAX_GROUP_BYTES: usize = 16 << 20;

/// One step of an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StepRecord {
    /// Observation of the agents before the step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observation: Option<Box<RawValue>>,
    /// Actions of the agents, as in results: a list of `[agent, value, …]`. Null if the agent gave none: the episode was stopped at
    /// this step.
    pub action: Option<Box<RawValue>>,
    /// The team's reward. At the step where the episode was stopped: the sum of all that doing nothing earned from there on.
    pub reward: f64,
    /// Every agent that was alive before the step.
    pub agents: Vec<AgentResult>,
    /// True if the episode is over.
    pub done: bool,
    /// Why the agent gave no action.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Calls of the language model for this step: one, or two if its first answer was repaired.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub completions: Option<Vec<Completion>>,
}
