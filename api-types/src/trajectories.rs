//! Trajectory feed of a run: finished groups with every step of their episodes.
//!
//! The server writes groups with types of its own, which keep observations as text; a test compares both forms.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::{ActionStopReason, GroupRole, ScenarioBracket};

/// Query of the trajectory feed.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryQuery {
    /// Largest number of groups, from 1 to 256 (default 8). A response has at most 32 MiB of JSON, or a single group.
    #[param(minimum = 1, maximum = 256, default = 8)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 256>")]
    pub limit: Option<u32>,
    /// Longest wait for the first group, seconds, from 0 to 60 (default 0). The server waits at most 55 s, since proxies end requests
    /// without a response after 60 s.
    #[param(minimum = 0, maximum = 60, default = 0)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 60>")]
    pub wait_s: Option<u32>,
    /// Id after which groups are read, acknowledged or not (default 0: from the first one that is kept).
    #[param(default = 0)]
    pub after: Option<u64>,
}

/// Request to claim groups that no consumer has claimed or acknowledged.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryClaim {
    /// Largest number of groups, from 1 to 256 (default 8). A response has at most 32 MiB of JSON, or a single group.
    #[schema(minimum = 1, maximum = 256, default = 8)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 256>")]
    pub limit: Option<u32>,
    /// Longest wait for the first group, seconds, from 0 to 60 (default 0). The server waits at most 55 s, since proxies end requests
    /// without a response after 60 s.
    #[schema(minimum = 0, maximum = 60, default = 0)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 60>")]
    pub wait_s: Option<u32>,
    /// Duration of the claim, seconds, from 1 to 86 400 (default 600). A group that is not acknowledged by then is delivered again.
    #[schema(minimum = 1, maximum = 86_400, default = 600)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 86_400>")]
    pub ttl_s: Option<u32>,
}

/// Acknowledgement of delivered groups.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AcknowledgeRequest {
    /// Ids of groups, at most 10 000.
    pub ids: Vec<u64>,
}

/// Response to an acknowledgement.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AcknowledgeResponse {
    /// Ids of groups that are acknowledged, now or before.
    pub acknowledged: Vec<i64>,
    /// Ids without a group in this run: they never existed or are no longer kept.
    pub unknown: Vec<i64>,
}

/// Groups of a trajectory feed.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryPage {
    /// Groups, in order of their ids.
    pub groups: Vec<DeliveredGroup>,
    /// Id of the last group, for `after`.
    pub next: Option<i64>,
}

/// Group of the feed with its delivery.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DeliveredGroup {
    /// Id of the group, unique and never reused.
    pub id: i64,
    /// Number of deliveries, this one included. If it is above 1, the trainer may have used the group before.
    pub deliveries: i64,
    /// Content of the group.
    #[serde(flatten)]
    pub group: TrajectoryGroup,
}

/// Finished group, without its id in the feed and the number of its deliveries.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryGroup {
    /// Id of the run.
    pub run: String,
    /// Id of the lease under which the group was rolled out.
    pub lease: String,
    /// Number of the group in its lease, from 0.
    pub group: i64,
    /// Id of the task.
    pub task: String,
    /// Level of the scenario, if the task has levels.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// Id of the layout, if the scenario was designed.
    pub layout: Option<String>,
    /// Scenario without its seed: world, task, params, physics and layout.
    #[schema(value_type = Object)]
    pub recipe: Value,
    /// Seed that makes the recipe a scenario.
    pub seed: u64,
    /// Id of the scenario.
    pub scenario: String,
    /// True if the scenario is contested: the reference succeeds and most blind plans do not.
    pub contested: bool,
    /// Bracket of the scenario. It is for the trainer, never for the agent.
    pub bracket: ScenarioBracket,
    /// Name of the policy that was rolled out.
    pub policy: String,
    /// Version of the policy.
    pub policy_version: i64,
    /// Presence of observations in the steps.
    pub observations: ObservationContent,
    /// Presence of the conversations with the language model.
    pub messages: MessageContent,
    /// Number of episodes that the infrastructure lost. They are not in `episodes`, and do not count.
    pub failed: usize,
    /// Finished episodes, in order of their index.
    pub episodes: Vec<TrajectoryEpisode>,
}

/// Presence of observations in a trajectory group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationContent {
    /// Every step has its observation, in the wire form.
    Telemetry,
    /// The policy of the run is set to record no observations.
    None,
    /// Observations were removed, since the group would be larger than 16 MiB with them.
    Dropped,
}

/// Presence of conversations in a trajectory group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MessageContent {
    /// A built-in policy has no conversations.
    None,
    /// Every completion has its messages.
    Kept,
    /// Messages were removed, since the group would be larger than 16 MiB with them.
    Dropped,
}

/// Finished episode of a group.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryEpisode {
    /// Id of the episode.
    pub id: String,
    /// Score of the replay.
    pub score: f64,
    /// Skill between floor (0) and reference (1), if the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success by the run's rule.
    pub success: bool,
    /// Reason why the agent was stopped before the end of the episode.
    pub stopped: Option<ActionStopReason>,
    /// Metrics of the language model; left out for a built-in policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<TrajectoryMetrics>,
    /// Steps of the episode, in order.
    pub steps: Vec<TrajectoryStep>,
    /// Observation of the agents after the last step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub last_observation: Option<Value>,
}

/// Step of an episode.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryStep {
    /// Observation of the agents before the step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub observation: Option<Value>,
    /// Actions of the agents, as in results: a list of `[agent, value, …]`. Null if the agent was stopped at this step.
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub action: Option<Value>,
    /// Reward of the team. At the step where the agent was stopped: the sum of all rewards without actions from there on.
    pub reward: f64,
    /// Results of the agents that were alive before the step.
    pub agents: Vec<AgentResult>,
    /// True if the episode is over.
    pub done: bool,
    /// Reason why the agent gave no action.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Calls of the language model for this step: one, or two if its first reply was repaired.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub completions: Option<Vec<TrajectoryCompletion>>,
}

/// Result of a step for one agent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AgentResult {
    /// Index of the agent.
    pub agent: u32,
    /// Reward of the agent itself.
    pub reward: f64,
    /// True if the agent left the episode by the rules of the task.
    pub terminated: bool,
    /// True if the horizon truncated the episode.
    pub truncated: bool,
}

/// Call of the language model for one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryCompletion {
    /// Messages of the prompt; empty if `messages` of the group is `dropped`.
    pub messages: Vec<ChatMessage>,
    /// Text of the reply, unchanged; null if the call failed.
    pub text: Option<String>,
    /// True if the reply was cut off at the maximum number of tokens.
    pub truncated: bool,
    /// Error of the call, or the reason why the reply is not an action.
    pub error: Option<String>,
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Duration of the call with its retries, milliseconds.
    pub latency_ms: u64,
    /// Token ids and log-probabilities, if the server requests them and the endpoint returns them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens: Option<CompletionTokens>,
}

/// Message of a conversation with a language model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ChatMessage {
    /// Author of the message.
    pub role: ChatRole,
    /// Text of the message.
    pub content: String,
}

/// Author of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChatRole {
    /// Instructions to the model.
    System,
    /// Observations and requests to the model.
    User,
    /// Replies of the model.
    Assistant,
}

/// Token ids and log-probabilities of a call.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CompletionTokens {
    /// Token ids of the prompt, as the model read it.
    pub prompt: Option<Vec<u32>>,
    /// Token ids of the reply.
    pub completion: Option<Vec<u32>>,
    /// Natural logarithm of the probability of each token of the reply.
    pub logprobs: Option<Vec<f64>>,
}

/// Metrics of a language model over an episode, by the names under which trainers log them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrajectoryMetrics {
    /// Sampling temperature, if one was set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// True if a reply was cut off at the maximum number of tokens.
    pub truncated: bool,
    /// Number of replies that are not a valid action.
    pub invalid_actions: u64,
}
