//! Tasks of all worlds: parameter spaces, options, levels, actions, policies and failure modes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::LevelTable;

/// Tasks of all worlds.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TaskList {
    /// Tasks, ordered by world.
    pub tasks: Vec<Task>,
}

/// Task of a world.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Task {
    /// Id of the task: `world/task`.
    pub id: String,
    /// World and its version.
    pub world: String,
    /// Description in one sentence.
    pub description: String,
    /// Parameter space of the task.
    pub params: Vec<TaskParam>,
    /// Physics options of the world.
    pub physics: Vec<PhysicsOption>,
    /// Default table of levels.
    pub levels: LevelTable,
    /// Start rungs: values of the param `start_scale`, from the easiest start to 1. Empty if the task has none.
    pub start_rungs: Vec<f64>,
    /// Number of agents at the start, at default params.
    pub agents: u32,
    /// Largest number of steps of an episode, at default params.
    pub horizon: u32,
    /// Time after which an episode is truncated, in seconds, at default params; null in a world that counts steps.
    pub time_limit_s: Option<f64>,
    /// Action space of an agent.
    pub actions: TaskActionSpace,
    /// Range of the score.
    pub score: TaskScoreRange,
    /// Built-in policies of the task.
    pub policies: Vec<BuiltInPolicy>,
    /// Names of the parameters of the trainable reflex policy, each from 0 to 1.
    pub reflex_params: Vec<String>,
    /// Failure modes: reasons why an episode loses score.
    pub failure_modes: Vec<TaskFailureMode>,
    /// Bands of relative speed in failure profiles.
    pub speed_bands: TaskSpeedBands,
    /// Angle by whose sectors failure profiles are divided.
    pub sector_quantity: SectorQuantity,
}

/// Param of a task: a number that determines its difficulty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TaskParam {
    /// Name of the param.
    pub name: String,
    /// Unit of the param; empty for a pure number.
    pub unit: String,
    /// Smallest value that is valid.
    pub min: f64,
    /// Largest value that is valid.
    pub max: f64,
    /// Step between the values that designers choose. Other values are valid too, integers only if `whole` is true.
    pub step: f64,
    /// True if only integers are valid.
    pub whole: bool,
    /// Default value of the param.
    pub default: f64,
    /// Direction in which the task becomes harder.
    pub harder: HarderDirection,
    /// Description of the param.
    pub description: String,
}

/// Direction in which a param makes a task harder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HarderDirection {
    /// A larger value is harder.
    Up,
    /// A smaller value is harder.
    Down,
}

/// Physics option of a world: a choice between named behaviours.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PhysicsOption {
    /// Name of the option.
    pub name: String,
    /// Type of the option.
    #[serde(rename = "type")]
    pub kind: PhysicsOptionType,
    /// Names of the choices.
    pub choices: Vec<String>,
    /// Name of the default choice.
    pub default: String,
    /// Description of the option.
    pub description: String,
    /// Choices that only scenarios made by hand may have; runs and suites reject them.
    pub manual_choices: Vec<ManualPhysicsChoice>,
}

/// Type of a physics option.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PhysicsOptionType {
    /// One of several names.
    Choice,
}

/// Choice of a physics option that only scenarios made by hand may have.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ManualPhysicsChoice {
    /// Name of the choice.
    pub choice: String,
    /// Reason of the restriction, as the end of a sentence.
    pub reason: String,
}

/// Kind of the values of an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TaskActionKind {
    /// Numbers within the bounds.
    Box,
    /// The index of one of several actions.
    Discrete,
}

/// Action space of one agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TaskActionSpace {
    /// Kind of the values.
    pub kind: TaskActionKind,
    /// Names of the actions of a discrete space, by index; empty for a box.
    pub names: Vec<String>,
    /// Names of the values of an action, in order.
    pub columns: Vec<String>,
    /// Smallest value; in a box lower ones are clamped.
    pub low: f64,
    /// Largest value; in a box higher ones are clamped.
    pub high: f64,
    /// Unit of the values.
    pub unit: String,
    /// Value of an agent that does nothing new: in frames, every value of its action equals this one; logs have no entry for it.
    pub hold: f64,
}

/// Range of the score of a task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TaskScoreRange {
    /// Lower bound of the score.
    pub min: f64,
    /// Upper bound of the score.
    pub max: f64,
}

/// Built-in policy of a task.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct BuiltInPolicy {
    /// Name of the policy.
    pub name: String,
    /// Description in one sentence, without a subject.
    pub description: String,
    /// True if the actions of the policy depend on its seed.
    pub stochastic: bool,
}

/// Failure mode of a task: a reason why an episode loses score.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TaskFailureMode {
    /// Name of the failure mode.
    pub name: String,
    /// Description in one sentence.
    pub description: String,
}

/// Bands of relative speed: the upper edges of all bands but the last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TaskSpeedBands {
    /// Edges in ascending order.
    pub edges: Vec<f64>,
    /// Unit of the edges.
    pub unit: String,
}

/// Angle by whose sectors the failure profiles of a task are divided.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SectorQuantity {
    /// Name of the angle, such as `bearing` or `orbit angle`.
    pub name: String,
    /// Description of the angle, with its origin and its positive direction.
    pub description: String,
    /// Names of the directions at 0°, 90°, 180° and 270°.
    pub directions: Vec<String>,
}
