//! Vector environments: many environments stepped together, into the caller's buffers.
//!
//! Each world implements a [`BatchLane`]: one environment that can start new episodes in its own memory. [`BatchEngine`]
//! steps lanes side by side, in chunks on rayon's current pool, with Gymnasium's autoreset modes. A lane is independent of
//! the others, so its results are the same for any batch size and thread count. The j-th scenario of slot k depends on
//! (k, j) alone, never on which slot finishes first. Once every kind of event and draw has occurred in a lane, it allocates
//! no more memory.
//!
//! [`episode_assigner`] decides which slot runs which episode of a pool; the engine does not know pools. Start reading at
//! [`Batch`].

mod buffers;
mod engine;
pub mod episode_assigner;
mod lane;
mod rows;
mod step;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use serde_json::Value;

pub use self::buffers::{BatchBuffers, BatchOutput, LaneOutput};
pub use self::engine::BatchEngine;
pub use self::lane::{BatchLane, LaneStep};
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::seed::{Seed, SeedSpace};
use crate::space::Axes;
use crate::task::{Recipe, Scenario};

/// Largest number of environments of a batch.
pub const MAX_ENVS: usize = 1 << 20;
/// Largest number of consecutive scenarios without a fair start that a slot skips.
pub const MAX_UNFAIR_STARTS: u64 = 64;

/// Many environments that are stepped together.
pub trait Batch: Send {
    /// Sizes of the buffers.
    fn shape(&self) -> BatchShape;

    /// Starts the next episode of each environment, or of those in `mask`, and writes their observations.
    ///
    /// # Errors
    /// Returns [`BatchError::Size`] if a buffer has the wrong size, and [`BatchError::Scenario`] if a scenario cannot
    /// start.
    fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<(), BatchError>;

    /// Writes the current observations; rows of idle environments are zeros.
    ///
    /// # Errors
    /// Returns [`BatchError::Size`] if the buffer has the wrong size.
    fn observe(&mut self, observations: &mut [f32]) -> Result<(), BatchError>;

    /// Advances each environment by one step. `actions` is `envs × agents × action`. Values of a box are clamped to it; agents whose
    /// values equal the space's hold have no entry in a log. Values for agents that have left are ignored.
    ///
    /// # Errors
    /// Returns an error if a buffer has the wrong size, an action is not finite or not in a discrete space, or an episode is over
    /// and the batch does not reset it; nothing changes then. Returns [`BatchError::Scenario`] if the next scenario of a slot cannot start.
    fn step(&mut self, actions: &[f32], out: BatchOutput<'_>) -> Result<(), BatchError> {
        self.step_some(actions, None, out)
    }

    /// Advances the environments in `mask`, or all, as [`Batch::step`] does. The others do not change, nor do their rows.
    ///
    /// # Errors
    /// As [`Batch::step`], and [`BatchError::Size`] if the mask has the wrong size.
    fn step_some(
        &mut self,
        actions: &[f32],
        mask: Option<&[bool]>,
        out: BatchOutput<'_>,
    ) -> Result<(), BatchError>;

    /// The episode of an environment, or `None` if it has none.
    fn running_episode(&self, env: usize) -> Option<RunningEpisode>;

    /// A digest of every bit of an environment's state.
    fn state_hash(&self, env: usize) -> Option<[u8; 32]>;

    /// Scene of an environment, or `None` if it has no episode. `actions` are the actions of its agents in the last step,
    /// along the world's axes.
    fn scene(&self, env: usize, actions: &[f32]) -> Option<Scene>;

    /// Texts of the events in the last step of an environment.
    fn alerts(&self, env: usize) -> Vec<String>;

    /// Observation of an environment's agents as JSON ([`crate::Episode::telemetry`]), or `None` if it has no episode.
    fn telemetry(&self, env: usize) -> Option<Value>;

    /// Marks the agents that are absent from an environment's new episode as terminated; all of them if it is idle.
    fn mark_absent_agents(&self, env: usize, terminated: &mut [bool]);

    /// Writes which agents of an environment need an action: in a new episode all of them.
    fn write_needs_action(&self, env: usize, needs_action: &mut [bool]);

    /// True if an environment is idle, since its source has no scenario for it.
    fn is_idle(&self, env: usize) -> bool;

    /// Names of the values of an environment's observation, in order.
    fn columns(&self) -> Vec<String>;

    /// Arrays that an environment's observation consists of, in order.
    fn parts(&self) -> Vec<ObservationPart>;

    /// Memory of one environment without what environments share, in bytes.
    fn bytes_per_env(&self) -> usize;
}

/// An array within an environment's observation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ObservationPart {
    /// Name of the array.
    pub name: &'static str,
    /// Dimensions of the array.
    pub shape: Vec<usize>,
}

/// The episode that an environment of a batch runs.
#[derive(Debug, Clone, PartialEq)]
pub struct RunningEpisode {
    /// Scenario of the episode.
    pub scenario: Scenario,
    /// Score of the episode so far.
    pub score: f64,
}

/// Sizes of a batch's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchShape {
    /// Number of environments in the batch.
    pub envs: usize,
    /// Number of agents in each environment.
    pub agents: usize,
    /// Number of values of one agent's action.
    pub action: usize,
    /// Number of values of one environment's observation.
    pub observation: usize,
}

/// Settings of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchConfig {
    /// Number of environments, from 1 to [`MAX_ENVS`].
    pub envs: usize,
    /// Behaviour at the end of an episode.
    pub autoreset: Autoreset,
    /// Content of the observations.
    pub observe: ObservationMode,
    /// Axes of the actions.
    pub axes: Axes,
    /// True if scenarios of all tasks of the world are allowed, which requires that its tasks have the same agents.
    pub mixed_tasks: bool,
    /// True if the calling thread steps all environments. Otherwise large batches are divided into chunks for rayon's
    /// current pool.
    pub single_threaded: bool,
}

impl BatchConfig {
    /// Creates settings with actions along the world's axes, stepped on rayon's current pool.
    #[must_use]
    pub const fn new(envs: usize, autoreset: Autoreset, observe: ObservationMode) -> Self {
        Self { envs, autoreset, observe, axes: Axes::World, mixed_tasks: false, single_threaded: false }
    }
}

/// Errors of a world whose agents have no tracks and no axes of their own, and whose tasks have different agents or actions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlainWorldErrors {
    /// Error of an observation mode other than `all`, or of room for bodies.
    pub(crate) observe: &'static str,
    /// Error of the agents' own axes.
    pub(crate) axes: &'static str,
    /// Error of a batch that mixes tasks.
    pub(crate) mixed_tasks: &'static str,
}

impl BatchConfig {
    /// Checks the settings for a world that has neither tracks nor axes of the agents, nor batches of several tasks.
    ///
    /// # Errors
    /// Returns [`BatchError::Unsupported`] with the error of the first setting that the world does not have.
    pub(crate) fn check_plain(&self, errors: &PlainWorldErrors) -> Result<(), BatchError> {
        let refused = [
            (self.observe != ObservationMode::All { bodies: None }, errors.observe),
            (self.axes != Axes::World, errors.axes),
            (self.mixed_tasks, errors.mixed_tasks),
        ];
        match refused.into_iter().find(|(is_refused, _)| *is_refused) {
            Some((_, error)) => Err(BatchError::Unsupported(error)),
            None => Ok(()),
        }
    }
}

/// Behaviour of an environment at the end of an episode: the modes of Gymnasium's vector environments
/// (`gymnasium.vector.AutoresetMode`, Gymnasium 1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The next step resets the environment. That step ignores its action, gives zero rewards and returns the first
    /// observation of the next episode.
    #[default]
    NextStep,
    /// The same step resets the environment. It returns the first observation of the next episode, and writes the last
    /// one to the final observations.
    SameStep,
    /// The caller resets the environment; a step before that is an error.
    Disabled,
}

/// Content of the observations of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationMode {
    /// Everything that the agents see, as columns.
    All {
        /// Room for bodies that are not agents; `None` means as many as the first scenario of slot 0 can have.
        bodies: Option<u32>,
    },
    /// As `All`, with further values of each agent, in worlds that have them.
    Extended,
    /// Each agent's own state and its greatest threats in its own frame, in worlds with such tracks.
    Tracks {
        /// Number of threats that each agent sees.
        threats: u32,
        /// Number of steps over which threats are predicted.
        look_ahead: u32,
    },
}

/// Source of a batch's scenarios: the j-th scenario of slot k is a function of (k, j).
pub trait ScenarioSource: Send + Sync {
    /// The scenario with index `number` of a slot.
    fn scenario(&self, slot: usize, number: u64) -> Scenario;

    /// The recipe of all scenarios, if it is the same. A world whose recipes differ in the number of agents then allocates
    /// no more than this recipe needs; otherwise it allocates what the task's params allow.
    fn single_recipe(&self) -> Option<&Arc<Recipe>> {
        None
    }

    /// True if there is a scenario for a slot now. Otherwise the slot is idle: its rows are zero, its agents are terminated,
    /// and every step asks again unless autoreset is [`Autoreset::Disabled`].
    fn has_scenario(&self, _slot: usize) -> bool {
        true
    }
}

/// Source with one recipe and a different seed for each (slot, number), derived from a batch seed.
#[derive(Debug, Clone)]
pub struct SeedSequence {
    recipe: Arc<Recipe>,
    seed: u64,
}

impl SeedSequence {
    /// Creates the sequence of a recipe under a batch seed.
    #[must_use]
    pub fn new(recipe: impl Into<Arc<Recipe>>, seed: u64) -> Self {
        Self { recipe: recipe.into(), seed }
    }
}

impl ScenarioSource for SeedSequence {
    fn scenario(&self, slot: usize, number: u64) -> Scenario {
        Scenario::new(Arc::clone(&self.recipe), nth_seed(self.seed, slot as u64, number))
    }

    fn single_recipe(&self) -> Option<&Arc<Recipe>> {
        Some(&self.recipe)
    }
}

/// The user seed with index `number` of a slot under a batch seed.
#[must_use]
pub const fn nth_seed(seed: u64, slot: u64, number: u64) -> Seed {
    Seed::in_space(SeedSpace::User, mix(mix(mix(seed).wrapping_add(slot)).wrapping_add(number)))
}

/// Scatters neighbouring values by a bijection of 64 bits: the finaliser of SplitMix64 (Steele, Lea and Flood 2014).
const fn mix(bits: u64) -> u64 {
    let z = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Checks that a recipe is one of the batch's task.
pub(crate) fn check_task(task: &str, recipe: &Recipe) -> Result<(), ScenarioError> {
    if recipe.task().id() == task {
        return Ok(());
    }
    Err(ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: recipe.task().id().to_owned(),
        choices: task.to_owned(),
    })
}

/// Error of creating, resetting or stepping a batch. Nothing has changed, except for [`BatchError::Scenario`]: then all
/// other environments have advanced.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BatchError {
    /// A buffer has the wrong size.
    #[error("{buffer} must have {wanted} values, got {found}")]
    Size {
        /// Name of the buffer.
        buffer: &'static str,
        /// Number of values that it holds.
        found: usize,
        /// Number of values that it must hold.
        wanted: usize,
    },
    /// A setting is out of range.
    #[error("{field} must be from {min} to {max}, got {value}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// Value of the setting.
        value: usize,
        /// Smallest value that is valid.
        min: usize,
        /// Largest value that is valid.
        max: usize,
    },
    /// The world does not support a setting; the text says which and why.
    #[error("{0}")]
    Unsupported(&'static str),
    /// An action is NaN or infinite.
    #[error("the action of agent {agent} in environment {env} must be finite")]
    NotFinite {
        /// Index of the environment.
        env: usize,
        /// Number of the agent.
        agent: usize,
    },
    /// An action is not one of a discrete space.
    #[error(
        "the action of agent {agent} in environment {env} must be a whole number from 0 to {last}, or -1 to go on, got {value}"
    )]
    UnknownAction {
        /// Index of the environment.
        env: usize,
        /// Number of the agent.
        agent: usize,
        /// Value of the action.
        value: f32,
        /// Largest action of the space.
        last: usize,
    },
    /// An episode is over and the batch does not reset it.
    #[error("the episode of environment {env} is over; reset it")]
    Ended {
        /// Index of the environment.
        env: usize,
    },
    /// The scenario of a slot cannot start; its episode is over. If there are several, this is the lowest slot.
    #[error("environment {env}: {source}")]
    Scenario {
        /// Index of the environment.
        env: usize,
        /// Reason why the scenario cannot start.
        source: ScenarioError,
    },
}
