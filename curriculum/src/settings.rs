//! What a run's curriculum is told to do.

use std::collections::BTreeMap;

use env_core::Recipe;
use env_core::scenario::PHYSICS;
use env_core::space::Levels;
use serde::{Deserialize, Serialize};

use super::kind::StrategyKind;
use super::learnability;
use super::stored::{StoredSettings, StoredTaskPlan};
use super::tuning::Tuning;

/// What the ladder climbs by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// A level is left when it is mastered.
    Mastery,
    /// Success is kept near one half, where a group's rewards vary most. Claims no mastery.
    Half,
}

impl Target {
    /// What a run of this group size climbs by unless told: groups learn from differences between siblings, which
    /// are greatest at one half.
    #[must_use]
    pub const fn default_for(group_size: u32) -> Self {
        if group_size > 1 { Self::Half } else { Self::Mastery }
    }
}

/// One task of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "StoredTaskPlan", try_from = "StoredTaskPlan")]
pub struct TaskPlan {
    /// The task's id.
    pub task: String,
    /// Its share of proposals against the others'; each gets at least 5 %.
    pub weight: f64,
    /// Its table.
    pub levels: Levels,
    /// Params that hold where the table does not say otherwise.
    pub default_params: Vec<(String, f64)>,
    /// The physics options that are not at their defaults, whatever the level.
    pub physics: BTreeMap<String, String>,
}

impl TaskPlan {
    /// A task by its own table and defaults, weight 1.
    ///
    /// # Errors
    /// A task nobody knows.
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

    /// The same under these physics options; those that stand at their defaults are left out, so that one physics is
    /// said in one way.
    ///
    /// # Errors
    /// `field` and the option at fault: one the task does not have, a word it does not know, options that contradict
    /// each other, and what only a scenario by hand may have.
    pub fn with_options(
        mut self,
        field: &str,
        options: &BTreeMap<String, String>,
    ) -> Result<Self, SettingsError> {
        self.physics = read_options(&self.task, field, options)?;
        Ok(self)
    }

    /// The hardest level.
    #[must_use]
    pub fn top(&self) -> u32 {
        u32::try_from(self.levels.len() - 1).unwrap_or(u32::MAX)
    }

    /// The params at a level: its row over the defaults. Without a level the defaults.
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

    /// Whether the same level means the same params under both: else what is known of one says nothing of the other.
    pub(super) fn same_course(&self, other: &Self) -> bool {
        self.task == other.task
            && self.levels == other.levels
            && self.default_params == other.default_params
            && self.physics == other.physics
    }

    fn validate(&self, field: &str) -> Result<(), SettingsError> {
        let Some(spec) = env_core::task(&self.task) else {
            return Err(SettingsError::unknown_task(&format!("{field}.task"), &self.task));
        };
        if !(self.weight.is_finite() && self.weight > 0.0) {
            let reason = format!("is {}, but must be a number above 0", self.weight);
            return Err(SettingsError::new(format!("{field}.weight"), reason));
        }
        let columns = self.levels.columns();
        if let Some(twice) = (1..columns.len()).find(|&at| columns[..at].contains(&columns[at])) {
            let reason = format!("names the column {} twice", columns[twice]);
            return Err(SettingsError::new(format!("{field}.levels"), reason));
        }
        Levels::new(spec.params(), columns.to_vec(), self.rows())
            .map_err(|error| SettingsError::new(format!("{field}.levels"), error.to_string()))?;
        for (at, (name, value)) in self.default_params.iter().enumerate() {
            let here = || format!("{field}.default_params.{name}");
            let Some(param) = spec.params().iter().find(|param| param.name == name) else {
                let known = env_core::space::names(spec.params());
                return Err(SettingsError::new(
                    here(),
                    format!("is not a param of the task; known are {known}"),
                ));
            };
            param.check(*value).map_err(|error| SettingsError::new(here(), error.to_string()))?;
            if self.default_params[..at].iter().any(|(earlier, _)| earlier == name) {
                return Err(SettingsError::new(here(), "is given twice"));
            }
        }
        read_options(&self.task, &format!("{field}.physics"), &self.physics).map(|_| ())
    }

    pub(super) fn rows(&self) -> Vec<Vec<f64>> {
        (0..self.levels.len())
            .map(|level| self.levels.params(level).map(|(_, value)| value).collect())
            .collect()
    }
}

/// Options as a task takes them, without those at their defaults.
fn read_options(
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
    let recipe = recipe.map_err(|error| SettingsError::told(&error.moved(PHYSICS, field)))?;
    let chosen = recipe.chosen_options().into_iter();
    Ok(chosen.map(|(name, choice)| (name.to_owned(), choice.to_owned())).collect())
}

/// What a run's curriculum is told to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "StoredSettings", try_from = "StoredSettings")]
pub struct Settings {
    /// How proposals are chosen.
    pub strategy: StrategyKind,
    /// The strategy's own settings.
    pub tuning: Tuning,
    /// What the ladder climbs by.
    pub target: Target,
    /// Whether the ladder first finds where a task should start. Changed later, it holds for tasks that start then.
    pub placement: bool,
    /// The share of proposals whose scenario must be contested, where the strategy draws both kinds; the others come as they come.
    pub contested_share: f64,
    /// The share of ladder proposals at the current level; the others rehearse the four levels below it.
    pub frontier_share: f64,
    /// The tasks.
    pub tasks: Vec<TaskPlan>,
}

impl Settings {
    /// A ladder over these tasks with everything else at its default.
    #[must_use]
    pub fn ladder(tasks: Vec<TaskPlan>) -> Self {
        Self {
            strategy: StrategyKind::Ladder,
            tuning: Tuning::standard(StrategyKind::Ladder),
            target: Target::Mastery,
            placement: true,
            contested_share: 0.5,
            frontier_share: 0.7,
            tasks,
        }
    }

    /// The same by another strategy, as that is unless told.
    #[must_use]
    pub fn by(self, strategy: StrategyKind) -> Self {
        Self { strategy, tuning: Tuning::standard(strategy), ..self }
    }

    /// Whether the strategy goes by the share of blind plans that succeed on a scenario.
    #[must_use]
    pub fn wants_panel(&self) -> bool {
        self.strategy == StrategyKind::Learnability && learnability::by_model(self)
    }

    /// The plan of a task.
    #[must_use]
    pub fn task(&self, task: &str) -> Option<&TaskPlan> {
        self.tasks.iter().find(|plan| plan.task == task)
    }

    /// Checks what the types cannot.
    ///
    /// # Errors
    /// The field at fault and what is wrong with it.
    pub fn validate(&self) -> Result<(), SettingsError> {
        for (field, share) in
            [("contested_share", self.contested_share), ("frontier_share", self.frontier_share)]
        {
            if !(0.0..=1.0).contains(&share) {
                return Err(SettingsError::new(field, format!("is {share}, outside 0 to 1")));
            }
        }
        if self.tasks.is_empty() {
            return Err(SettingsError::new("tasks", "is empty; a run needs at least one task"));
        }
        for (at, plan) in self.tasks.iter().enumerate() {
            if self.tasks[..at].iter().any(|earlier| earlier.task == plan.task) {
                return Err(SettingsError::new(
                    format!("tasks.{at}.task"),
                    format!("{} is listed twice", plan.task),
                ));
            }
            plan.validate(&format!("tasks.{at}"))?;
        }
        Ok(())
    }
}

/// Settings that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} {reason}")]
pub struct SettingsError {
    /// The field at fault, as a dotted path.
    pub field: String,
    /// What is wrong with it.
    pub reason: String,
}

impl SettingsError {
    pub(super) fn new(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { field: field.into(), reason: reason.into() }
    }

    /// A scenario's error, whose sentence begins with its field.
    fn told(error: &env_core::ScenarioError) -> Self {
        let (field, sentence) = (error.field(), error.to_string());
        let reason = sentence.strip_prefix(field).unwrap_or(&sentence).trim_start_matches([':', ' ']);
        Self::new(field, reason)
    }

    pub(super) fn unknown_task(field: &str, task: &str) -> Self {
        let known = env_core::tasks().map(|spec| spec.id()).collect::<Vec<_>>().join(", ");
        Self::new(field, format!("{task:?} is not a task; known are {known}"))
    }
}
