//! Reported episodes of a run.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::{GroupRole, ScenarioBracket};

/// Availability of an episode's actions for a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReplayAvailability {
    /// The actions are stored.
    Available,
    /// The run no longer keeps the actions.
    Expired,
    /// The episode has no actions.
    None,
}

/// Episode, as lists show it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodeSummary {
    /// Id of the episode.
    pub episode: String,
    /// Id of the task.
    pub task: Option<String>,
    /// Level at which the scenario was drawn.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// Id of the layout, if the group was designed.
    pub layout: Option<String>,
    /// State of the episode.
    pub state: EpisodeState,
    /// Score of the replay.
    pub score: Option<f64>,
    /// True if the episode is a success by the run's rule.
    pub success: Option<bool>,
    /// Skill between floor (0) and reference (1), if the scenario defines one.
    pub skill: Option<f64>,
    /// Policy version that ran the episode.
    pub policy_version: Option<i64>,
    /// Time of the report, RFC 3339.
    pub reported_at: Option<String>,
    /// Availability of the actions for a replay.
    pub replay: ReplayAvailability,
}

/// Page of reported episodes.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodePage {
    /// Episodes: a list is ordered by lease and index, a search by its `order`.
    pub episodes: Vec<EpisodeSummary>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Query of a search for episodes.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct EpisodeSearchQuery {
    /// Id of the task.
    pub task: Option<String>,
    /// Level of the scenario.
    pub level: Option<u32>,
    /// State of the episode.
    #[param(inline)]
    pub state: Option<EpisodeStateFilter>,
    /// True for successful episodes, false for the others.
    pub success: Option<bool>,
    /// Failure mode. Only episodes that the failure profile keeps as examples of it are found.
    pub mode: Option<String>,
    /// Role of the group.
    #[param(inline)]
    pub role: Option<GroupRole>,
    /// Id of the layout.
    pub layout: Option<String>,
    /// Policy version that ran the episode.
    pub policy_version: Option<u32>,
    /// Order of the episodes (default `newest`).
    #[serde(default)]
    #[param(inline)]
    pub order: EpisodeSortOrder,
    /// Largest number of episodes on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page of the same search.
    pub cursor: Option<String>,
}

/// State of a reported episode, as a filter of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeStateFilter {
    /// The episode was run to its end.
    Finished,
    /// The infrastructure lost the episode.
    Failed,
    /// The episode was reported after its lease had ended.
    Late,
}

/// Order of the episodes of a search.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeSortOrder {
    /// Episodes of the latest lease first.
    #[default]
    Newest,
    /// Episodes of the earliest lease first.
    Oldest,
    /// Episodes with the lowest score first.
    WorstScore,
    /// Episodes with the highest score first.
    BestScore,
    /// Episodes with the lowest skill first.
    WorstSkill,
    /// Episodes with the highest skill first.
    BestSkill,
}

/// Outcome of an episode or a plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EpisodeOutcome {
    /// Score that the world computed.
    pub score: f64,
    /// Sum of the rewards.
    pub total_reward: f64,
    /// Number of steps of the episode.
    pub steps: u32,
    /// Number of agents lost.
    pub lost: u32,
    /// Quality of holding the goal towards the end, from 0 to 1; null for tasks without a goal.
    pub goal: Option<f64>,
    /// Fuel spent by all agents.
    pub fuel_used: f64,
    /// Duration, s; absent in a world that counts steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// Episode with its scenario.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Episode {
    /// The episode, as lists show it.
    #[serde(flatten)]
    pub summary: EpisodeSummary,
    /// True if the scenario is contested.
    pub contested: bool,
    /// Floor at the time of the report.
    pub floor: Option<f64>,
    /// Reference score at the time of the report.
    pub reference: Option<f64>,
    /// Outcome of the replay.
    pub outcome: Option<EpisodeOutcome>,
    /// Reason of a failure.
    pub reason: Option<String>,
    /// Metrics that the trainer reported.
    #[schema(value_type = Option<Object>)]
    pub metrics: Option<Value>,
    /// Id of the scenario; null if the run no longer keeps it.
    pub scenario_id: Option<String>,
    /// Complete scenario; null if the run no longer keeps it.
    #[schema(value_type = Option<Object>)]
    pub scenario: Option<Value>,
    /// Bracket of the scenario.
    pub bracket: Option<ScenarioBracket>,
    /// Actions, one entry for each step: a list of `[agent, value, …]`.
    #[schema(value_type = Option<Object>)]
    pub actions: Option<Value>,
    /// Other episodes of the run and of the group.
    pub neighbours: EpisodeNeighbours,
}

/// Reported episodes around an episode, among those that the run keeps complete.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodeNeighbours {
    /// Id of the episode before it, by lease and index; null for the first one.
    pub previous: Option<String>,
    /// Id of the episode after it, by lease and index; null for the last one.
    pub next: Option<String>,
    /// Episodes of the same group by index, the episode itself included, at most 64.
    pub group: Vec<EpisodeSummary>,
}

/// Replay of an episode, step by step.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodeReplay {
    /// Id of the episode.
    pub episode: String,
    /// Complete scenario, with all defaults filled in.
    #[schema(value_type = Object)]
    pub scenario: Value,
    /// Frame of the start, then one frame for each step: actions, rewards and the whole state, hidden bodies included. With
    /// `telemetry=true` each frame also has `observation`, what the agents observed.
    #[schema(value_type = Vec<Object>)]
    pub frames: Vec<Value>,
}

/// Query of a replay.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ReplayQuery {
    /// True if frames include the observations of the agents (default false).
    #[serde(default)]
    pub telemetry: bool,
    /// Actions to replay: of the agent, none, or of the reference plan (default `agent`).
    #[serde(default)]
    #[param(inline)]
    pub plan: ReplayPlan,
}

/// Actions of a replay.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReplayPlan {
    /// Reported actions of the agent.
    #[default]
    Agent,
    /// No actions at all.
    Hold,
    /// Actions of the reference plan.
    Reference,
}

/// State of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeState {
    /// The episode was not reported yet.
    Leased,
    /// The episode was run to its end.
    Finished,
    /// The infrastructure lost the episode.
    Failed,
    /// The episode was reported after its lease had ended.
    Late,
    /// The episode was not reported before its lease ended.
    Expired,
}
