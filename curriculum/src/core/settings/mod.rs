//! Settings of a run's curriculum: tasks, strategy, hyperparameters and shares.
//!
//! [`Settings`] is the checked form that strategies read, [`StoredSettings`] the form that is stored and sent. The
//! hyperparameters of each strategy are declared in [`hyperparameters`].

mod error;
pub(crate) mod hyperparameters;
mod stored;
mod strategy_kind;
mod target;
mod task_plan;

use env_core::format_shortest;
use serde::{Deserialize, Serialize};

pub use self::error::SettingsError;
pub use self::hyperparameters::{Hyperparameter, Hyperparameters, ValueRange};
pub use self::stored::{StoredSettings, StoredTaskPlan};
pub use self::strategy_kind::StrategyKind;
pub use self::target::Target;
pub use self::task_plan::TaskPlan;

use self::hyperparameters::learnability::{RANK, RankingMethod};

/// Settings of a run's curriculum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "StoredSettings", try_from = "StoredSettings")]
pub struct Settings {
    /// Strategy that makes the proposals.
    pub strategy: StrategyKind,
    /// Hyperparameters of the strategy.
    pub hyperparameters: Hyperparameters,
    /// Rule by which the ladder moves.
    pub target: Target,
    /// True if the ladder first searches for the level at which a task starts. A later change affects only tasks that
    /// start after it.
    pub placement: bool,
    /// Share of proposals whose scenario must be contested, 0 to 1, under strategies that draw both kinds. The other
    /// scenarios are used as they are drawn.
    pub contested_share: f64,
    /// Share of ladder proposals at the current level, 0 to 1; the others rehearse the four levels below it.
    pub frontier_share: f64,
    /// Tasks of the run.
    pub tasks: Vec<TaskPlan>,
}

impl Settings {
    /// A ladder over these tasks, with all other settings at their defaults.
    #[must_use]
    pub fn ladder(tasks: Vec<TaskPlan>) -> Self {
        Self {
            strategy: StrategyKind::Ladder,
            hyperparameters: Hyperparameters::defaults(StrategyKind::Ladder),
            target: Target::Mastery,
            placement: true,
            contested_share: 0.5,
            frontier_share: 0.7,
            tasks,
        }
    }

    /// The same settings with another strategy and its default hyperparameters.
    #[must_use]
    pub fn with_strategy(self, strategy: StrategyKind) -> Self {
        Self { strategy, hyperparameters: Hyperparameters::defaults(strategy), ..self }
    }

    /// True if the strategy needs the share of blind plans that succeed on each scenario.
    #[must_use]
    pub fn uses_panel(&self) -> bool {
        self.strategy == StrategyKind::Learnability
            && RankingMethod::from_name(self.hyperparameters.choice(&RANK)) == RankingMethod::Model
    }

    /// Plan of a task; `None` if the run does not have it.
    #[must_use]
    pub fn task(&self, task: &str) -> Option<&TaskPlan> {
        self.tasks.iter().find(|plan| plan.task == task)
    }

    /// Checks the constraints that the types do not express.
    ///
    /// # Errors
    /// Returns an error at `contested_share` or `frontier_share` if it is outside 0 to 1, at `tasks` if there are
    /// none, and below `tasks.N` if a task is listed twice or its plan is invalid.
    pub fn validate(&self) -> Result<(), SettingsError> {
        for (field, share) in
            [("contested_share", self.contested_share), ("frontier_share", self.frontier_share)]
        {
            if !(0.0..=1.0).contains(&share) {
                return Err(SettingsError::new(
                    field,
                    format!("must be from 0 to 1, got {}", format_shortest(share)),
                ));
            }
        }
        if self.tasks.is_empty() {
            return Err(SettingsError::new("tasks", "must have at least one task"));
        }
        for (at, plan) in self.tasks.iter().enumerate() {
            if self.tasks[..at].iter().any(|earlier| earlier.task == plan.task) {
                return Err(SettingsError::new(
                    format!("tasks.{at}.task"),
                    format!("repeats {}; list it once", plan.task),
                ));
            }
            plan.validate(&format!("tasks.{at}"))?;
        }
        Ok(())
    }
}

impl From<Settings> for StoredSettings {
    fn from(settings: Settings) -> Self {
        Self {
            strategy: settings.strategy,
            strategy_settings: settings.hyperparameters.to_json(),
            target: settings.target,
            placement: settings.placement,
            contested_share: settings.contested_share,
            frontier_share: settings.frontier_share,
            tasks: settings.tasks.into_iter().map(StoredTaskPlan::from).collect(),
        }
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
            hyperparameters: Hyperparameters::parse(stored.strategy, &stored.strategy_settings)?,
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
