//! A finished group of a trajectory feed, as trainers receive it.

use serde::Serialize;
use serde_json::Value;
use serde_json::value::RawValue;
use utoipa::ToSchema;

use crate::policy::Completion;
use api_types::ScenarioBracket;

/// Size of a group as JSON, in bytes, above which observations are left out, then conversations.
pub const MAX_GROUP_BYTES: usize = 16 << 20;

/// A finished group, without its id in the feed and the number of its deliveries.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrajectoryGroup {
    /// Id of the run.
    pub run: String,
    /// Id of the lease that the group was rolled out under.
    pub lease: String,
    /// Number of the group in its lease.
    pub group: i64,
    /// Id of the task.
    pub task: String,
    /// Level of the scenario, if the task has levels.
    pub level: Option<i64>,
    /// `placement`, `frontier`, `rehearsal`, `sample` or `designed`.
    pub role: String,
    /// Id of the layout, if the scenario was designed.
    pub layout: Option<String>,
    /// The scenario without its seed: world, task, params, physics, layout.
    #[schema(value_type = Object)]
    pub recipe: Value,
    /// The seed that makes the recipe a scenario.
    pub seed: u64,
    /// Id of the scenario.
    pub scenario: String,
    /// True if acting well matters on this scenario.
    pub contested: bool,
    /// Floor and reference of the scenario. For the trainer, never for the agent.
    pub bracket: ScenarioBracket,
    /// The policy that was rolled out.
    pub policy: String,
    /// Version of the policy.
    pub policy_version: i64,
    /// `telemetry`, `none` (as configured), or `dropped`: with them the group would be larger than 16 MiB.
    pub observations: &'static str,
    /// `none`: a built-in policy has no conversations; `kept`; or `dropped` like observations.
    pub messages: &'static str,
    /// Episodes that the infrastructure lost: they are not in `episodes`, and do not count.
    pub failed: usize,
    /// Episodes that finished, in order.
    pub episodes: Vec<TrajectoryEpisode>,
}

/// A finished episode of a group.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrajectoryEpisode {
    /// Id of the episode.
    pub id: String,
    /// The score, by replay.
    pub score: f64,
    /// The skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success by the run's rule.
    pub success: bool,
    /// Why the agent was stopped: `unparsable`, `too_long` or `too_late`.
    pub stopped: Option<&'static str>,
    /// Metrics of the language model; left out for a built-in policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<ModelMetrics>,
    /// Steps of the episode, in order.
    pub steps: Vec<TrajectoryStep>,
    /// Observation of the agents after the last step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub last_observation: Option<Box<RawValue>>,
}

/// One step of an episode.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct TrajectoryStep {
    /// Observation of the agents before the step, in the wire form.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub observation: Option<Box<RawValue>>,
    /// Actions of the agents, as in results: a list of `[agent, value, …]`. Null if the agent gave none: the episode was stopped at
    /// this step.
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub action: Option<Value>,
    /// The team's reward. At the step where the episode was stopped: the sum of all that doing nothing earned from there on.
    pub reward: f64,
    /// Every agent that was alive before the step.
    pub agents: Vec<AgentEnd>,
    /// True if the episode is over.
    pub done: bool,
    /// Why the agent gave no action.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Calls of the language model for this step: one, or two if its first answer was repaired.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Object>>)]
    pub completions: Option<Vec<Completion>>,
}

/// Result of a step for one agent.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
pub struct AgentEnd {
    /// Number of the agent.
    pub agent: u32,
    /// The agent's own reward.
    pub reward: f64,
    /// True if the agent left the episode by the rules of the task.
    pub terminated: bool,
    /// True if the episode was cut off by its horizon.
    pub truncated: bool,
}

/// Metrics of a language model over an episode, by the names under which trainers log them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, ToSchema)]
pub struct ModelMetrics {
    /// Sampling temperature, if one was set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// True if an answer was cut off.
    pub truncated: bool,
    /// Answers that were no action.
    pub invalid_actions: u64,
}

impl TrajectoryGroup {
    /// Removes the observations of every step.
    pub fn drop_observations(&mut self) {
        self.observations = "dropped";
        for episode in &mut self.episodes {
            episode.last_observation = None;
            episode.steps.iter_mut().for_each(|step| step.observation = None);
        }
    }

    /// Removes the conversations; the model's answers are kept.
    pub fn drop_messages(&mut self) {
        self.messages = "dropped";
        let steps = self.episodes.iter_mut().flat_map(|episode| &mut episode.steps);
        for completion in steps.filter_map(|step| step.completions.as_mut()).flatten() {
            completion.messages.clear();
        }
    }
}
