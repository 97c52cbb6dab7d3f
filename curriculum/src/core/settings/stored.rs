//! Settings as they are stored and sent: plain columns and rows instead of checked level tables.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::strategy_kind::StrategyKind;
use super::target::Target;

/// Stored form of [`Settings`](super::Settings), unchecked. Columns and rows become a level table only if the task's
/// parameter space accepts them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredSettings {
    /// Strategy that makes the proposals.
    pub strategy: StrategyKind,
    /// Hyperparameters of the strategy by name; omitted from JSON if the strategy has none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub strategy_settings: BTreeMap<String, Value>,
    /// Rule by which the ladder moves.
    pub target: Target,
    /// True if the ladder first searches for the level at which a task starts.
    pub placement: bool,
    /// Share of proposals whose scenario must be contested, 0 to 1.
    pub contested_share: f64,
    /// Share of ladder proposals at the current level, 0 to 1.
    pub frontier_share: f64,
    /// Tasks of the run.
    pub tasks: Vec<StoredTaskPlan>,
}

/// Stored form of a [`TaskPlan`](super::TaskPlan), unchecked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredTaskPlan {
    /// Id of the task.
    pub task: String,
    /// Weight of the task against the others.
    pub weight: f64,
    /// Names of the level table's columns.
    pub columns: Vec<String>,
    /// Rows of the level table, easy to hard.
    pub rows: Vec<Vec<f64>>,
    /// Params that apply where the table does not set them.
    pub default_params: Vec<(String, f64)>,
    /// Physics options that differ from their defaults. Omitted from JSON if there are none, as in runs stored before
    /// options existed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub physics: BTreeMap<String, String>,
}
