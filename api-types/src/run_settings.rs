//! Requests that create and change runs, with the settings that they contain.

use std::collections::BTreeMap;

use curriculum::{StrategyKind, Target};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::{DesignerChoice, RetentionRequest};

/// Request to create a run. Every field may be left out.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunRequest {
    /// Id of the run: 1 to 64 characters of a-z, 0-9, - and _ (default: generated).
    pub id: Option<String>,
    /// Name of the run for people.
    pub name: Option<String>,
    /// Seed of the run's random streams, from 0 to 2^51 − 1 (default: drawn by the server).
    #[schema(minimum = 0, maximum = 2_251_799_813_685_247u64)]
    #[serde(default, deserialize_with = "crate::integers::optional_seed")]
    pub seed: Option<u64>,
    /// Strategy that chooses the scenarios (default `auto`).
    #[schema(value_type = Option<String>, example = "auto")]
    pub strategy: Option<StrategyKind>,
    /// Settings of the strategy, by name; the others have their defaults. `GET /v1/strategies` lists them.
    #[schema(schema_with = crate::strategy_settings_schema)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// Target of the ladder: `mastery`, or `half` (default if group_size > 1).
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// True to find the first level by bisection over the levels (default true).
    pub placement: Option<bool>,
    /// Share of proposals whose scenario must be contested, from 0 to 1 (default 0.5).
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub contested_share: Option<f64>,
    /// Share of proposals at the current level, from 0 to 1 (default 0.7).
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub frontier_share: Option<f64>,
    /// Number of episodes of one scenario in a group, from 1 to 1 024 (default 1).
    #[schema(minimum = 1, maximum = 1024, default = 1)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub group_size: Option<u32>,
    /// Number of finished episodes from which a partial group counts (default: half of group_size).
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub min_group: Option<u32>,
    /// Number of policy versions after which results no longer move the curriculum (default: no limit).
    pub max_staleness: Option<u32>,
    /// Leases whose results move mastery (default `train`).
    pub evidence_from: Option<EvidenceFrom>,
    /// Rule that decides whether an episode is a success (default `task`).
    pub success: Option<SuccessSetting>,
    /// Ids of the tasks (default: all tasks of kessler). Tasks of several worlds can be mixed if the agent can act in all of them.
    pub tasks: Option<Vec<String>>,
    /// Settings of the layouts that are designed for the agent's failures.
    pub design: DesignSettingsRequest,
    /// Number of groups of a lease of columns whose logs are replayed, from 1 to 1 024 (default 64).
    #[schema(minimum = 1, maximum = 1024, default = 64)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub audit_groups: Option<u32>,
    /// Judge of the steps in sessions of the run: `off`, `deterministic` or `llm` (default: the server's setting).
    #[schema(value_type = Option<String>, example = "off")]
    pub judge: Option<Judge>,
    /// Numbers of episodes that the run keeps complete.
    pub retention: RetentionRequest,
    /// Settings of single tasks, by task id.
    pub task_settings: BTreeMap<String, TaskSettingsRequest>,
    /// Tags of the run, at most 32. A tag has 1 to 64 of a-z, 0-9, _, ., : and -, and begins with a letter or a digit.
    pub tags: Vec<String>,
    /// Note of the team, at most 2 000 characters (default: empty).
    #[schema(max_length = 2000)]
    pub note: String,
}

/// Request to change a run. A field that is left out keeps its value. Tasks keep their level and mastery unless their levels or
/// physics change. A change of the strategy keeps the mastery of tasks and resets the state of the
/// strategy.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunUpdate {
    /// Name of the run for people.
    pub name: Option<String>,
    /// Strategy that chooses the scenarios.
    #[schema(value_type = Option<String>, example = "plr")]
    pub strategy: Option<StrategyKind>,
    /// Settings of the strategy, by name. The others keep their values, or get their defaults under another strategy.
    #[schema(schema_with = crate::strategy_settings_schema)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// Target of the ladder: `mastery` or `half`.
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// True to find the first level of new tasks by bisection over the levels.
    pub placement: Option<bool>,
    /// Share of proposals whose scenario must be contested, from 0 to 1.
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub contested_share: Option<f64>,
    /// Share of proposals at the current level, from 0 to 1.
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub frontier_share: Option<f64>,
    /// Number of episodes of one scenario in a group, from 1 to 1 024.
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub group_size: Option<u32>,
    /// Number of finished episodes from which a partial group counts.
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub min_group: Option<u32>,
    /// Number of policy versions after which results no longer move the curriculum.
    pub max_staleness: Option<u32>,
    /// Leases whose results move mastery.
    pub evidence_from: Option<EvidenceFrom>,
    /// Number of groups of a lease of columns whose logs are replayed, from 1 to 1 024.
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub audit_groups: Option<u32>,
    /// Ids of all tasks: a task of the run that is not among them is removed.
    pub tasks: Option<Vec<String>>,
    /// Settings of single tasks, by task id.
    pub task_settings: BTreeMap<String, TaskSettingsRequest>,
}

/// Settings of one task of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TaskSettingsRequest {
    /// Weight of the task among the tasks of the run, above 0 (default 1); each task gets at least 5 %.
    #[schema(exclusive_minimum = 0.0)]
    pub weight: Option<f64>,
    /// Score from which an episode is a success under `success: raw` (default 0.7).
    pub success_threshold: Option<f64>,
    /// Table of levels that replaces the world's.
    pub levels: Option<LevelTable>,
    /// Physics options by name, at every level; the others have their defaults. `GET /v1/tasks` lists them.
    #[schema(example = json!({"contact": "swept", "warnings": "exact"}))]
    pub physics: Option<BTreeMap<String, String>>,
}

/// Table of levels: the params of each level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LevelTable {
    /// Names of the params, one for each column.
    pub columns: Vec<String>,
    /// Values of each level in the order of `columns`, from easy to hard.
    pub rows: Vec<Vec<f64>>,
}

/// Leases whose results move mastery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EvidenceFrom {
    /// Leases with the purpose `train` and, as always, `probe`.
    Train,
    /// Leases with the purpose `probe`: the trainer neither explores nor learns.
    Probe,
}

/// Rule that decides whether an episode is a success.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SuccessSetting {
    /// The rule of the task, against floor and reference.
    Task,
    /// A threshold on the raw score.
    Raw,
}

/// Settings of the layouts that are designed for the agent's failures. Every field may be left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DesignSettingsRequest {
    /// Largest share of training groups that are designed, from 0 to 1 (default 0.3), once there are failures and the task's
    /// placement is done. 0 turns designs off.
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub share: Option<f64>,
    /// True if the share is always the largest (default false). Otherwise it follows what the agent learns from designed groups,
    /// compared with the others.
    pub fixed_share: Option<bool>,
    /// Designer of the layouts (default `auto`).
    pub designer: Option<DesignerChoice>,
    /// Largest share of training groups for one layout, above 0 and at most 1 (default 0.05); four groups are always allowed.
    #[schema(exclusive_minimum = 0.0, maximum = 1.0)]
    pub layout_share: Option<f64>,
    /// Number of active layouts near the current level that are kept in reserve for each task, from 1 to 64 (default 8).
    #[schema(minimum = 1, maximum = 64, default = 8)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 64>")]
    pub reserve: Option<u32>,
}

/// Judge that scores the steps of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Judge {
    /// No judge: clients receive the rewards of the world.
    #[default]
    Off,
    /// Rules of the world: the value of a step if no agent acts after it.
    Deterministic,
    /// A language model; the rules judge the same steps for comparison.
    Llm,
}
