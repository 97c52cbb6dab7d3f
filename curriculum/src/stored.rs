//! Settings as they are stored and sent.

use std::collections::BTreeMap;

use env_core::space::Levels;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::kind::StrategyKind;
use super::settings::{Settings, SettingsError, Target, TaskPlan};
use super::tuning::Tuning;

/// [`Settings`] as they are stored and sent: plain columns and rows, which become a table only when the task's
/// parameter space accepts them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredSettings {
    /// See [`Settings`].
    pub strategy: StrategyKind,
    /// See [`Settings`]; left out where the strategy has none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub strategy_settings: BTreeMap<String, Value>,
    /// See [`Settings`].
    pub target: Target,
    /// See [`Settings`].
    pub placement: bool,
    /// See [`Settings`].
    pub contested_share: f64,
    /// See [`Settings`].
    pub frontier_share: f64,
    /// See [`Settings`].
    pub tasks: Vec<StoredTaskPlan>,
}

/// [`TaskPlan`] as it is stored and sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredTaskPlan {
    /// The task's id.
    pub task: String,
    /// See [`TaskPlan`].
    pub weight: f64,
    /// The names of the table's columns.
    pub columns: Vec<String>,
    /// The table, easy to hard.
    pub rows: Vec<Vec<f64>>,
    /// See [`TaskPlan`].
    pub default_params: Vec<(String, f64)>,
    /// See [`TaskPlan`]. Left out where there are none, as in runs stored before there were options.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub physics: BTreeMap<String, String>,
}

impl From<Settings> for StoredSettings {
    fn from(settings: Settings) -> Self {
        Self {
            strategy: settings.strategy,
            strategy_settings: settings.tuning.told(),
            target: settings.target,
            placement: settings.placement,
            contested_share: settings.contested_share,
            frontier_share: settings.frontier_share,
            tasks: settings.tasks.into_iter().map(StoredTaskPlan::from).collect(),
        }
    }
}

impl From<TaskPlan> for StoredTaskPlan {
    fn from(plan: TaskPlan) -> Self {
        let (columns, rows) = (plan.levels.columns().to_vec(), plan.rows());
        let TaskPlan { task, weight, default_params, physics, .. } = plan;
        Self { task, weight, columns, rows, default_params, physics }
    }
}

impl TryFrom<StoredSettings> for Settings {
    type Error = SettingsError;

    fn try_from(stored: StoredSettings) -> Result<Self, SettingsError> {
        let tasks = stored
            .tasks
            .into_iter()
            .enumerate()
            .map(|(at, plan)| {
                TaskPlan::try_from(plan).map_err(|error| SettingsError {
                    field: format!("tasks.{at}.{}", error.field),
                    reason: error.reason,
                })
            })
            .collect::<Result<_, _>>()?;
        let settings = Self {
            strategy: stored.strategy,
            tuning: Tuning::read(stored.strategy, &stored.strategy_settings)?,
            target: stored.target,
            placement: stored.placement,
            contested_share: stored.contested_share,
            frontier_share: stored.frontier_share,
            tasks,
        };
        settings.validate()?;
        Ok(settings)
    }
}

impl TryFrom<StoredTaskPlan> for TaskPlan {
    type Error = SettingsError;

    fn try_from(stored: StoredTaskPlan) -> Result<Self, SettingsError> {
        let spec =
            env_core::task(&stored.task).ok_or_else(|| SettingsError::unknown_task("task", &stored.task))?;
        let levels = Levels::new(spec.params(), stored.columns, stored.rows)
            .map_err(|error| SettingsError::new("levels", error.to_string()))?;
        let StoredTaskPlan { task, weight, default_params, physics, .. } = stored;
        Ok(Self { task, weight, levels, default_params, physics })
    }
}
