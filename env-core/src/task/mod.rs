//! The interface between worlds and everything above them: a task, its scenarios and its episodes.
//!
//! [`TaskSpec`] and [`Recipe`] refer to each other: a recipe knows its task, and a task checks and starts recipes. Worlds
//! implement the traits; how episodes are run is in [`crate::rollout`] and [`crate::batch`], and how scenarios are parsed
//! in `scenario_parser`. Start reading at [`TaskSpec`].

mod entry_format;
mod episode;
mod layout;
mod options;
mod recipe;
mod scenario;

use std::any::Any;
use std::sync::LazyLock;

use serde_json::Value;

pub(crate) use self::entry_format::EntryFormat;
pub use self::episode::{AgentReport, Episode, StepReport};
pub use self::layout::{Layout, LayoutMode, MAX_LAYOUT_ROWS};
pub use self::options::PHYSICS;
pub use self::recipe::{Recipe, RecipeId};
pub use self::scenario::{Scenario, ScenarioId};
use crate::batch::{Batch, BatchConfig, BatchError, ScenarioSource};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::critique::{Critique, FailureModeSpec, Judgement, SectorQuantity, SpeedBands};
use crate::error::{LogError, ReplayError, ScenarioError};
use crate::log::ActionLog;
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::rollout::{ReplayItem, replay};
use crate::space::{ActionGrid, ActionSpace, Levels, OptionSpec, ParamSpec, ScoreRange};

/// A task as data.
#[derive(Debug)]
pub struct TaskMetadata {
    /// Id of the task, as `world/task`.
    pub id: &'static str,
    /// Id of the world with its version, such as `kessler@1`.
    pub world: &'static str,
    /// Description in one sentence.
    pub description: &'static str,
    /// Parameter space of the task.
    pub params: &'static [ParamSpec],
    /// Physics options of the task.
    pub options: &'static [OptionSpec],
    /// Default table of levels.
    pub levels: &'static LazyLock<Levels>,
    /// Start rungs: values of the param `start_scale`, from the easiest start to 1. Empty if the task has none.
    pub start_rungs: &'static [f64],
}

/// A task of a world: its spaces as data, its episodes, its bracket, its success rule and its action codec.
///
/// The trait is object-safe: the service uses tasks through `dyn TaskSpec` only.
pub trait TaskSpec: Send + Sync {
    /// The task as data.
    fn metadata(&self) -> &TaskMetadata;

    /// Id of the task, as `world/task`.
    fn id(&self) -> &'static str {
        self.metadata().id
    }

    /// Id of the world with its version, such as `kessler@1`.
    fn world(&self) -> &'static str {
        self.metadata().world
    }

    /// Description in one sentence.
    fn description(&self) -> &'static str {
        self.metadata().description
    }

    /// Parameter space of the task.
    fn params(&self) -> &'static [ParamSpec] {
        self.metadata().params
    }

    /// Physics options of the task.
    fn options(&self) -> &'static [OptionSpec] {
        self.metadata().options
    }

    /// Default table of levels.
    fn levels(&self) -> &'static Levels {
        self.metadata().levels
    }

    /// Start rungs: values of the param `start_scale`, from the easiest start to 1, at any level. Empty if the task has none.
    fn start_rungs(&self) -> &'static [f64] {
        self.metadata().start_rungs
    }

    /// Largest number of steps of an episode, which is truncated after it.
    fn horizon(&self, recipe: &Recipe) -> u32;

    /// Time after which an episode is truncated, s; `None` in a world that counts steps.
    fn time_limit_s(&self, _: &Recipe) -> Option<f64> {
        None
    }

    /// Number of agents at the start of an episode.
    fn agents(&self, recipe: &Recipe) -> u32;

    /// Shape and bounds of one agent's action.
    fn action_space(&self) -> ActionSpace;

    /// Names of an action's values along each agent's own axes ([`Axes::Agent`](crate::space::Axes::Agent)), or `None` in
    /// a world where agents have no axes of their own.
    fn agent_axes(&self) -> Option<&'static [&'static str]> {
        None
    }

    /// A grid of actions for policies with a discrete action space.
    fn action_grid(&self) -> ActionGrid;

    /// A few actions that suffice to do the task, hold first. A policy explores them faster than the grid, which it replaces.
    fn few_actions(&self) -> ActionGrid {
        self.action_grid()
    }

    /// Range of the score.
    fn score_range(&self) -> ScoreRange;

    /// Checks what the bounds of single params cannot express: contradictions and layouts.
    ///
    /// # Errors
    /// Returns an error that names the field at fault.
    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError>;

    /// Creates an episode at its start.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the start is not fair.
    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError>;

    /// Replays logs of this task, each by itself, with the outcomes of [`replay`](crate::rollout::replay).
    fn replay_all(&self, items: &[ReplayItem<'_>]) -> Vec<Result<EpisodeOutcome, ReplayError>> {
        items.iter().map(|item| replay(item.scenario, item.log)).collect()
    }

    /// Computes the bracket: blind panel, floor and reference.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the start is not fair.
    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError>;

    /// Computes the bracket, or returns `None` once `wanted` returns false.
    ///
    /// The planner polls `wanted` now and then; once false, it must stay false. A service cancels work this way without a
    /// clock in this crate. A task whose bracket takes milliseconds need not poll.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the start is not fair.
    fn bracket_while(
        &self,
        scenario: &Scenario,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Bracket>, ScenarioError> {
        if wanted() { self.bracket(scenario).map(Some) } else { Ok(None) }
    }

    /// Adds threats to the scenario until it is contested, or returns `None` if that fails.
    fn make_contested(&self, scenario: &Scenario) -> Option<(Scenario, Bracket)>;

    /// The task's success rule. True if an episode with this outcome and skill is a success.
    fn is_success(&self, outcome: &EpisodeOutcome, skill: Option<f64>) -> bool;

    /// True if a blind plan can succeed at all, so that a contested scenario must prove that most do not.
    fn blind_can_succeed(&self) -> bool;

    /// Appends one step of a log, in the world's JSON form, to `log`.
    ///
    /// # Errors
    /// Returns [`LogError::Malformed`] if the value is not an action of this task.
    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError>;

    /// Parses what the policies of this world observe ([`Episode::observation`]) from its JSON form
    /// ([`Episode::telemetry`]). A built-in policy can then act in an episode of another process.
    ///
    /// # Errors
    /// Returns the parser's error if the value is not an observation of this world.
    fn read_observation(&self, value: &Value) -> serde_json::Result<Box<dyn Any + Send>>;

    /// Creates many environments of this task that are stepped together; `source` supplies their scenarios.
    ///
    /// # Errors
    /// Returns an error if the configuration is out of range, or requires a feature that the world does not have.
    fn batch(
        &self,
        source: Box<dyn ScenarioSource>,
        config: BatchConfig,
    ) -> Result<Box<dyn Batch>, BatchError>;

    /// The built-in policies in the order of presentation. Every task has `hold`, `random`, `blind`, `frozen`, `heuristic`
    /// and `reference`.
    fn policies(&self) -> &'static [PolicySpec];

    /// The trainable reflex: the policy that the built-in learner trains.
    fn reflex(&self) -> Reflex;

    /// The ways in which an episode of this task can lose score.
    fn failure_modes(&self) -> &'static [FailureModeSpec];

    /// Bands of relative speed for reports.
    fn speed_bands(&self) -> SpeedBands;

    /// The angle by whose sectors failure profiles are divided: that of [`Failure::sector_deg`](crate::critique::Failure::sector_deg).
    fn sector_quantity(&self) -> SectorQuantity;

    /// Analyses an episode: why score was lost, what each action was worth, and the judge's verdict.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start or the log is not one of this scenario.
    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError>;

    /// Judges the last step of a log, which may end anywhere, as if no agent acted after it. In a world that judges whole
    /// episodes only, it returns the episode's verdict once the log is complete, and `None` before.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start or the log is not one of this scenario.
    fn judge_step(&self, scenario: &Scenario, log: &ActionLog) -> Result<Option<Judgement>, ReplayError> {
        match self.critique(scenario, log) {
            Ok(critique) => Ok(Some(critique.assessment)),
            Err(ReplayError::Log(LogError::TooShort { .. })) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Creates a built-in policy for a scenario; `seed` seeds stochastic ones.
    ///
    /// # Errors
    /// Returns an error if the name is unknown, or if the policy needs a plan and the scenario cannot start.
    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError>;
}
