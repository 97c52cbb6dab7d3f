//! Scenarios that a user checks or rolls out by hand.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::{Critique, EpisodeActions, EpisodeOutcome, ScenarioBracket};

/// Scenario to check, and actions to replay on it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioRequest {
    /// The scenario: a task, a seed from 0 to 2^51 − 1, and optional params, physics and layout, which have defaults. A layout is
    /// `{mode, bodies, provenance}`: tables of rows that follow the drawn bodies (`extend`) or replace them (`replace`), at most 512
    /// rows in all.
    #[schema(value_type = Object, example = json!({"task": "kessler/survival", "params": {"debris": 100}, "seed": 7}))]
    pub scenario: Value,
    /// Action log to replay on the scenario.
    pub actions: Option<EpisodeActions>,
    /// True to return `frames`: the episode step by step, with the observations of the agents (default false). Without `actions` no
    /// agent acts.
    #[serde(default)]
    pub telemetry: bool,
}

/// Check of a scenario.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ScenarioCheck {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Complete scenario, with all defaults filled in.
    #[schema(value_type = Object)]
    pub scenario: Value,
    /// True if no agent is lost before it could act.
    pub fair: bool,
    /// Reason why the scenario is not fair.
    pub unfair_reason: Option<String>,
    /// True if the reference planner succeeds.
    pub solvable: bool,
    /// True if the reference planner succeeds and most blind plans do not.
    pub contested: bool,
    /// Bracket of the scenario.
    pub bracket: Option<ScenarioBracket>,
    /// Outcome of the actions, if there were any.
    pub outcome: Option<ReplayedOutcome>,
    /// Critique of the actions, if there were any.
    pub critique: Option<Critique>,
    /// With `telemetry` and a fair scenario: the start, then one frame for each step, as in the replay of a run's episode, with
    /// `observation`, what the agents observed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Object>>)]
    pub frames: Option<Vec<Value>>,
}

/// Outcome of replayed actions.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ReplayedOutcome {
    /// Outcome of the episode.
    #[serde(flatten)]
    pub outcome: EpisodeOutcome,
    /// Skill between floor (0) and reference (1), if the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success by the task's own rule.
    pub success: bool,
}

/// Scenario to roll out, with the actions so far.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "scenario": {"task": "kessler/survival", "params": {"debris": 30}, "seed": 7}, "steps": [[[0, 0.1, 0.0]], []]
}))]
pub struct RolloutRequest {
    /// The scenario, as in `POST /v1/scenarios`.
    #[schema(value_type = Object)]
    pub scenario: Value,
    /// One entry for each step so far, first step first: a list of `[agent, value, …]` (default: no steps).
    #[serde(default)]
    #[schema(value_type = Vec<Vec<Vec<Value>>>)]
    pub steps: Vec<Value>,
    /// Step up to which the episode goes on without actions (default: the end of `steps`).
    #[serde(default)]
    pub until: u32,
    /// First step whose frame is returned (default 0).
    #[serde(default)]
    pub from: u32,
}

/// Rolled-out part of an episode.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Rollout {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Complete scenario, with all defaults filled in.
    #[schema(value_type = Object)]
    pub scenario: Value,
    /// True if the episode is over.
    pub done: bool,
    /// Number of steps after which the episode is truncated.
    pub horizon: u32,
    /// Frames from step `from` to the last step; only the last frame if the episode ended before `from`. A frame has `step`,
    /// `actions`, `reward`, `done`, `state` (the truth) and `observation` (what the agents observed).
    #[schema(value_type = Vec<Object>)]
    pub frames: Vec<Value>,
}
