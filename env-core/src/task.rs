//! What every task of every world answers to.

use std::any::Any;
use std::sync::LazyLock;

use serde_json::Value;

use crate::batch::{Batch, BatchConfig, BatchError, Feed};
use crate::bracket::{Bracket, Flown};
use crate::critique::{Critique, Judged, ModeSpec, SpeedBands};
use crate::error::{LogError, ScenarioError, StepError};
use crate::log::{ActionLog, JointAction};
use crate::policy::{Policy, PolicyError, PolicySpec};
use crate::reflex::Reflex;
use crate::rollout::ReplayError;
use crate::scenario::{Recipe, Scenario};
use crate::space::{ActionSpace, Choices, Levels, OptionSpec, ParamSpec, ScoreRange};
use crate::wire::Wire;

/// What a task is, as data.
#[derive(Debug)]
pub struct TaskCard {
    /// `world/task`.
    pub id: &'static str,
    /// The world and its version, as `kessler@1`.
    pub world: &'static str,
    /// One sentence for people.
    pub about: &'static str,
    /// The parameter space.
    pub params: &'static [ParamSpec],
    /// The physics options.
    pub options: &'static [OptionSpec],
    /// The default table of levels.
    pub levels: &'static LazyLock<Levels>,
}

/// One task: its spaces as data, its episodes, its panel, reference, success rule and action codec. Object-safe: the
/// service knows tasks only through it.
pub trait TaskSpec: Send + Sync {
    /// What it is.
    fn card(&self) -> &TaskCard;
    /// `world/task`.
    fn id(&self) -> &'static str {
        self.card().id
    }
    /// The world and its version, as `kessler@1`.
    fn world(&self) -> &'static str {
        self.card().world
    }
    /// One sentence for people.
    fn about(&self) -> &'static str {
        self.card().about
    }
    /// The parameter space.
    fn params(&self) -> &'static [ParamSpec] {
        self.card().params
    }
    /// The physics options.
    fn options(&self) -> &'static [OptionSpec] {
        self.card().options
    }
    /// The default table of levels.
    fn levels(&self) -> &'static Levels {
        self.card().levels
    }
    /// Steps after which an episode is truncated.
    fn horizon(&self, recipe: &Recipe) -> u32;
    /// Agents at the start.
    fn agents(&self, recipe: &Recipe) -> u32;
    /// What an agent does in a step.
    fn action_space(&self) -> ActionSpace;
    /// What an action's values are called along each agent's own axes ([`crate::batch::Axes::Agent`]); `None` in a world
    /// where agents have no axes of their own.
    fn agent_axes(&self) -> Option<&'static [&'static str]> {
        None
    }
    /// A grid of actions to choose from.
    fn choices(&self) -> Choices;
    /// The range of the score.
    fn score_range(&self) -> ScoreRange;
    /// Checks what parameter bounds cannot: contradictions and layouts.
    ///
    /// # Errors
    /// The field at fault.
    fn check(&self, recipe: &Recipe) -> Result<(), ScenarioError>;
    /// The episode at its start.
    ///
    /// # Errors
    /// A scenario whose start is not fair.
    fn start(&self, scenario: &Scenario) -> Result<Box<dyn Episode>, ScenarioError>;
    /// Panel, floor, reference and witness.
    ///
    /// # Errors
    /// A scenario whose start is not fair.
    fn bracket(&self, scenario: &Scenario) -> Result<Bracket, ScenarioError>;
    /// The same for as long as it is `wanted`, which is asked now and then and never takes back a no; `None` where it was
    /// given up. How a service drops what nobody waits for any more, without a clock in here. A task whose bracket takes
    /// milliseconds need not ask.
    ///
    /// # Errors
    /// A scenario whose start is not fair.
    fn bracket_while(
        &self,
        scenario: &Scenario,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Bracket>, ScenarioError> {
        if wanted() { self.bracket(scenario).map(Some) } else { Ok(None) }
    }
    /// The same scenario with threats planted until it is contested, or `None` where that does not work out.
    fn plant_contested(&self, scenario: &Scenario) -> Option<(Scenario, Bracket)>;
    /// The task's own success rule.
    fn success(&self, flown: &Flown, skill: Option<f64>) -> bool;
    /// Whether a blind plan can succeed at all, so that a contested scenario must show that most do not.
    fn blind_can_succeed(&self) -> bool;
    /// Reads one step of an action log in the world's wire form into `log`.
    ///
    /// # Errors
    /// Something that is not an action of this task.
    fn read_step(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError>;
    /// How it speaks OpenEnv.
    fn wire(&self) -> &'static dyn Wire;
    /// What the policies of this world observe ([`Episode::observation`]), out of its wire form ([`Episode::telemetry`]):
    /// a built-in policy then flies an episode that another process holds.
    ///
    /// # Errors
    /// Something that is no observation of this world.
    fn read_observation(&self, wire: &Value) -> serde_json::Result<Box<dyn Any + Send>>;
    /// Many environments of this task, stepped together; `feed` says which scenarios they fly.
    ///
    /// # Errors
    /// A configuration out of range, or what the world does not have.
    fn batch(&self, feed: Box<dyn Feed>, config: BatchConfig) -> Result<Box<dyn Batch>, BatchError>;
    /// The built-in policies, in the order people should read them. Every task has `hold`, `random`, `blind`, `frozen`,
    /// `heuristic` and `reference`.
    fn policies(&self) -> &'static [PolicySpec];
    /// The trainable reflex: what a built-in learner learns.
    fn reflex(&self) -> Reflex;
    /// Why an episode of this task can lose score.
    fn failure_modes(&self) -> &'static [ModeSpec];
    /// How relative speeds are sorted for people.
    fn speed_bands(&self) -> SpeedBands;
    /// What an episode shows: why score was lost, what each action was worth, and the judge's word.
    ///
    /// # Errors
    /// A log that is not one of this scenario.
    fn critique(&self, scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError>;
    /// The deterministic judge's word on the last step of a log that may stop anywhere, as if nobody acted after it. In a
    /// world where a single step counts for nothing it is the word on the episode, once that is over.
    ///
    /// # Errors
    /// A log that is not one of this scenario.
    fn judge_step(&self, scenario: &Scenario, log: &ActionLog) -> Result<Option<Judged>, ReplayError> {
        match self.critique(scenario, log) {
            Ok(critique) => Ok(Some(critique.judged)),
            Err(ReplayError::Log(LogError::TooShort { .. })) => Ok(None),
            Err(error) => Err(error),
        }
    }
    /// A built-in policy by name for this scenario; `seed` feeds those with chance in them.
    ///
    /// # Errors
    /// An unknown name, or a scenario that cannot be planned on.
    fn policy(&self, name: &str, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError>;
}

/// What one agent is told after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgentReport {
    /// Who.
    pub agent: u32,
    /// Its reward.
    pub reward: f64,
    /// It has left the episode by the rules of the task.
    pub terminated: bool,
    /// The episode was cut off by its horizon.
    pub truncated: bool,
    /// It waits for a new action. A world whose actions last many steps says no until one is over.
    pub needs_action: bool,
}

/// What a step did, for every agent that was alive before it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// One entry per agent alive before the step.
    pub agents: Vec<AgentReport>,
    /// The team's reward: what the score sums.
    pub reward: f64,
    /// Time that passed, in the world's unit.
    pub elapsed: f64,
    /// The episode is over.
    pub done: bool,
}

/// One attempt at a scenario.
pub trait Episode: Send {
    /// One step of the world.
    ///
    /// # Errors
    /// An action the environment does not take; the environment is then unchanged.
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError>;
    /// Steps taken.
    fn steps(&self) -> u32;
    /// Whether it is over.
    fn done(&self) -> bool;
    /// What the agents see now; the world's own type, for its own policies.
    fn observation(&self) -> &dyn Any;
    /// What the agents see now, in the wire form.
    fn telemetry(&self) -> Value;
    /// Closest approaches to come of what the agents see, as far as the world foresees them, whether or not an option puts
    /// them into the observation; none in a world without such a forecast.
    fn conjunctions(&self) -> Option<Value> {
        None
    }
    /// Appends what the agents see now as JSON, without `reward` and `done`: what [`Episode::telemetry`] says, sooner.
    fn write_observation(&self, out: &mut Vec<u8>);
    /// The team's reward of the last step; 0 before the first.
    fn last_reward(&self) -> f64;
    /// The whole truth now, hidden bodies included, in the wire form: for people looking at a replay.
    fn truth(&self) -> Value;
    /// How it went so far.
    fn flown(&self) -> Flown;
    /// A digest of every bit of the state: for tests that a change moved nothing.
    fn state_hash(&self) -> [u8; 32];
}
