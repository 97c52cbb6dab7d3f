//! One task of a run: its weight, level table, default params and physics options.

use std::collections::BTreeMap;

use env_core::space::Levels;
use env_core::task::PHYSICS;
use env_core::{Recipe, format_shortest};
use serde::{Deserialize, Serialize};

use super::error::SettingsError;
use super::stored::StoredTaskPlan;

/// Plan of one task of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "StoredTaskPlan", try_from = "StoredTaskPlan")]
pub struct TaskPlan {
    /// Id of the task.
    pub task: String,
    /// Weight of the task against the others; each task gets at least 5 % of the proposals.
    pub weight: f64,
    /// Level table, easy to hard.
    pub levels: Levels,
    /// Params that apply where the table does not set them.
    pub default_params: Vec<(String, f64)>,
    /// Physics options that differ from their defaults, at every level.
    pub physics: BTreeMap<String, String>,
}

impl TaskPlan {
    /// A task with its own level table and default params, at weight 1.
    ///
    /// # Errors
    /// Returns an error at the field `task` if the task is unknown.
    pub fn standard(task: &str) -> Result<Self, SettingsError> {
        let spec = env_core::task(task).ok_or_else(|| SettingsError::unknown_task("task", task))?;
        Ok(Self {
            task: task.to_owned(),
            weight: 1.0,
            levels: spec.levels().clone(),
            default_params: spec.params().iter().map(|p| (p.name.to_owned(), p.default)).collect(),
            physics: BTreeMap::new(),
        })
    }

    /// The same plan under these physics options. Options at their defaults are dropped, so that equal physics have
    /// one form.
    ///
    /// # Errors
    /// Returns an error below `field`, at the option at fault: an option that the task does not have, an unknown
    /// choice, options that contradict each other, or an option that only a hand-made scenario may have.
    pub fn with_physics(
        mut self,
        field: &str,
        options: &BTreeMap<String, String>,
    ) -> Result<Self, SettingsError> {
        self.physics = parse_physics(&self.task, field, options)?;
        Ok(self)
    }

    /// Number of the hardest level, the last row of the table.
    #[must_use]
    pub fn hardest_level(&self) -> u32 {
        u32::try_from(self.levels.len() - 1).unwrap_or(u32::MAX)
    }

    /// Params at a level: its row of the table over the default params. Without a level, the default params.
    #[must_use]
    pub fn params(&self, level: Option<u32>) -> Vec<(String, f64)> {
        let mut params = self.default_params.clone();
        let Some(level) = level else { return params };
        for (name, value) in self.levels.params(level as usize) {
            match params.iter_mut().find(|(known, _)| known == name) {
                Some((_, held)) => *held = value,
                None => params.push((name.to_owned(), value)),
            }
        }
        params
    }

    /// True if each level means the same under both plans. Otherwise outcomes under one plan say nothing about the
    /// other.
    pub(crate) fn has_same_levels(&self, other: &Self) -> bool {
        self.task == other.task
            && self.levels == other.levels
            && self.default_params == other.default_params
            && self.physics == other.physics
    }

    /// Checks the constraints that the types do not express. Errors name their field below `field`.
    pub(super) fn validate(&self, field: &str) -> Result<(), SettingsError> {
        let Some(spec) = env_core::task(&self.task) else {
            return Err(SettingsError::unknown_task(&format!("{field}.task"), &self.task));
        };
        if !(self.weight.is_finite() && self.weight > 0.0) {
            let reason = format!("must be a number above 0, got {}", format_shortest(self.weight));
            return Err(SettingsError::new(format!("{field}.weight"), reason));
        }
        let columns = self.levels.columns();
        if let Some(twice) = (1..columns.len()).find(|&at| columns[..at].contains(&columns[at])) {
            let reason = format!("has the column {} twice; list it once", columns[twice]);
            return Err(SettingsError::new(format!("{field}.levels"), reason));
        }
        Levels::new(spec.params(), columns.to_vec(), self.rows())
            .map_err(|error| SettingsError::new(format!("{field}.{}", error.field()), error.reason()))?;
        for (at, (name, value)) in self.default_params.iter().enumerate() {
            let param_field = || format!("{field}.default_params.{name}");
            let Some(param) = spec.params().iter().find(|param| param.name == name) else {
                let known = env_core::space::param_names(spec.params());
                let reason = format!("is not a param of the task; the params are {known}");
                return Err(SettingsError::new(param_field(), reason));
            };
            param.check(*value).map_err(|error| SettingsError::new(param_field(), error.reason()))?;
            if self.default_params[..at].iter().any(|(earlier, _)| earlier == name) {
                return Err(SettingsError::new(param_field(), "is given twice; list it once"));
            }
        }
        parse_physics(&self.task, &format!("{field}.physics"), &self.physics).map(|_| ())
    }

    fn rows(&self) -> Vec<Vec<f64>> {
        (0..self.levels.len())
            .map(|level| self.levels.params(level).map(|(_, value)| value).collect())
            .collect()
    }
}

/// Checks physics options against the task and returns those that differ from their defaults.
fn parse_physics(
    task: &str,
    field: &str,
    options: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, SettingsError> {
    let spec = env_core::task(task).ok_or_else(|| SettingsError::unknown_task("task", task))?;
    let given = options.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
    let recipe = Recipe::new(spec).and_then(|recipe| recipe.with_options(given)).and_then(|recipe| {
        recipe.check_for_series()?;
        Ok(recipe)
    });
    let recipe =
        recipe.map_err(|error| SettingsError::from_scenario_error(&error.relocate(PHYSICS, field)))?;
    let chosen = recipe.chosen_options().into_iter();
    Ok(chosen.map(|(name, choice)| (name.to_owned(), choice.to_owned())).collect())
}

impl From<TaskPlan> for StoredTaskPlan {
    fn from(plan: TaskPlan) -> Self {
        let (columns, rows) = (plan.levels.columns().to_vec(), plan.rows());
        let TaskPlan { task, weight, default_params, physics, .. } = plan;
        Self { task, weight, columns, rows, default_params, physics }
    }
}

impl TryFrom<StoredTaskPlan> for TaskPlan {
    type Error = SettingsError;

    fn try_from(stored: StoredTaskPlan) -> Result<Self, SettingsError> {
        let spec =
            env_core::task(&stored.task).ok_or_else(|| SettingsError::unknown_task("task", &stored.task))?;
        let levels = Levels::new(spec.params(), stored.columns, stored.rows)
            .map_err(|error| SettingsError::new(error.field(), error.reason()))?;
        let StoredTaskPlan { task, weight, default_params, physics, .. } = stored;
        Ok(Self { task, weight, levels, default_params, physics })
    }
}
