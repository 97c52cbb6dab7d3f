//! Many environments stepped together, into the caller's buffers.
//!
//! Each world gives a [`Lane`]: one environment that can start over in its own memory. [`Engine`] steps lanes side by
//! side, in chunks over rayon's current pool, with Gymnasium's autoreset modes. A lane knows nothing of its neighbours,
//! so what it does is the same at any batch size and thread count; slot k's j-th scenario depends on (k, j) alone, never
//! on who finishes first. Once every kind of event and draw has happened in a lane, nothing is allocated for it any more.

pub mod book;
mod buffers;
mod engine;
mod rows;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use serde_json::Value;

pub use self::buffers::Buffers;
pub use self::engine::{Engine, Lane, LaneOutput};
use crate::error::ScenarioError;
use crate::scenario::{Recipe, Scenario};
use crate::scene::Scene;
use crate::seed::{Seed, SeedSpace};

/// What happens to an environment whose episode is over: the modes of Gymnasium's vector environments
/// (`gymnasium.vector.AutoresetMode`, Gymnasium 1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The next step resets it: its action is not looked at, its rewards are zero, its observation is the first of the
    /// next episode.
    #[default]
    NextStep,
    /// The same step resets it: its observation is the first of the next episode, the last one goes to the final
    /// observations.
    SameStep,
    /// Nothing: the caller resets it, and a step before that is an error.
    Disabled,
}

/// What every environment writes as its observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observe {
    /// All that the agents see, as columns.
    All {
        /// How many bodies that are no agents there is room for; as many as slot 0's first scenario can have, if none.
        bodies: Option<u32>,
    },
    /// Each agent's own state and what threatens it most, in its own frame, where the world has such tracks.
    Tracks {
        /// How many threats an agent sees.
        threats: u32,
        /// Over how many steps they are foreseen.
        look_ahead: u32,
    },
}

/// Along which axes actions are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// The world's own, as action logs have them.
    #[default]
    World,
    /// Each agent's own, where the world has such: for policies whose observations are along them too. In kessler radial
    /// out and in-track; they are turned into the world's, rounded to single precision, and then taken like any action.
    Agent,
}

/// What a batch is made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchConfig {
    /// Environments.
    pub envs: usize,
    /// What happens when an episode is over.
    pub autoreset: Autoreset,
    /// What is observed.
    pub observe: Observe,
    /// Along which axes actions are given.
    pub axes: Axes,
    /// Scenarios of any task of the world are flown, where its tasks have the same agents; else of this one alone.
    pub mixed: bool,
    /// The calling thread steps them alone. Else chunks of many are handed over to rayon's current pool.
    pub alone: bool,
}

impl BatchConfig {
    /// With actions along the world's axes, by rayon's current pool.
    #[must_use]
    pub const fn new(envs: usize, autoreset: Autoreset, observe: Observe) -> Self {
        Self { envs, autoreset, observe, axes: Axes::World, mixed: false, alone: false }
    }
}

/// Most environments of one batch.
pub const MAX_ENVS: usize = 1 << 20;
/// Scenarios without a fair start that are passed over in a row before a batch gives up.
pub const MAX_UNFAIR: u64 = 64;

/// Where a batch's scenarios come from: slot k's j-th is a function of (k, j).
pub trait Feed: Send + Sync {
    /// The recipe and seed of slot `slot`'s scenario number `number`.
    fn scenario(&self, slot: usize, number: u64) -> (Arc<Recipe>, Seed);
    /// The one recipe of all its scenarios, where there is one: a world whose recipes differ in agents makes room for no
    /// more than that one needs, and else for as many as the task's params allow.
    fn only(&self) -> Option<&Arc<Recipe>> {
        None
    }
    /// Whether there is a scenario for this slot now. Where there is none the slot rests instead of beginning: its rows are
    /// zero, its episode is over, and it asks again at each step that is not [`Autoreset::Disabled`]'s.
    fn has(&self, _slot: usize) -> bool {
        true
    }
}

/// One recipe with seeds of its own for every (slot, number), from a batch seed.
#[derive(Debug, Clone)]
pub struct Seeds {
    recipe: Arc<Recipe>,
    seed: u64,
}

impl Seeds {
    /// This recipe, under this batch seed.
    #[must_use]
    pub fn new(recipe: impl Into<Arc<Recipe>>, seed: u64) -> Self {
        Self { recipe: recipe.into(), seed }
    }
}

impl Feed for Seeds {
    fn scenario(&self, slot: usize, number: u64) -> (Arc<Recipe>, Seed) {
        (Arc::clone(&self.recipe), nth_seed(self.seed, slot as u64, number))
    }

    fn only(&self) -> Option<&Arc<Recipe>> {
        Some(&self.recipe)
    }
}

/// The user seed that stands `number`th in the row of `slot`, under a batch seed.
#[must_use]
pub const fn nth_seed(seed: u64, slot: u64, number: u64) -> Seed {
    Seed::in_space(SeedSpace::User, mix(mix(mix(seed).wrapping_add(slot)).wrapping_add(number)))
}

/// That a feed's recipe is one of the batch's task.
pub(crate) fn of_task(task: &str, recipe: &Recipe) -> Result<(), ScenarioError> {
    if recipe.task().id() == task {
        return Ok(());
    }
    Err(ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: recipe.task().id().to_owned(),
        choices: task.to_owned(),
    })
}

/// A bijection of 64 bits that scatters neighbours: the finaliser of SplitMix64 (Steele, Lea and Flood 2014).
const fn mix(bits: u64) -> u64 {
    let z = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Sizes of a batch's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Environments.
    pub envs: usize,
    /// Agents of each.
    pub agents: usize,
    /// Values of one agent's action.
    pub action: usize,
    /// Values of one environment's observation.
    pub observation: usize,
}

/// The caller's buffers. A step writes all of them whole, but for the final observations of episodes that go on; after an
/// error they are of no use.
#[derive(Debug)]
pub struct Output<'a> {
    /// `envs × observation`: what is seen now.
    pub observations: &'a mut [f32],
    /// `envs × observation` under `SameStep`, else empty: the last observation of an episode that ended in this step;
    /// rows of the others are left as they are.
    pub final_observations: &'a mut [f32],
    /// `envs × agents`: each agent's reward; zero once it has left.
    pub rewards: &'a mut [f32],
    /// `envs`: the team's reward, which the score sums.
    pub team_rewards: &'a mut [f32],
    /// `envs × agents`: the agent has left by the rules of the task, now or earlier in this episode, or is absent from it.
    pub terminated: &'a mut [bool],
    /// `envs × agents`: the horizon cut the agent off, now.
    pub truncated: &'a mut [bool],
    /// `envs`: the episode ended in this step.
    pub done: &'a mut [bool],
    /// `envs × agents × action`, or empty where nobody wants to know: the actions along the world's axes, as a log has
    /// them, before they are clamped; zeros where the step was a reset.
    pub taken: &'a mut [f32],
}

/// Why a batch cannot be made, reset or stepped. Nothing has moved then, but for `Scenario`: all others have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BatchError {
    /// A buffer of the wrong size.
    #[error("{buffer} holds {found} values, not {wanted}")]
    Size {
        /// Which.
        buffer: &'static str,
        /// What it holds.
        found: usize,
        /// What it must hold.
        wanted: usize,
    },
    /// A setting out of range.
    #[error("{field} is {value}, outside {min} to {max}")]
    Config {
        /// Which.
        field: &'static str,
        /// Its value.
        value: usize,
        /// Smallest.
        min: usize,
        /// Largest.
        max: usize,
    },
    /// What the world does not have.
    #[error("{0}")]
    Unsupported(&'static str),
    /// NaN or an infinity.
    #[error("the action of environment {env}, agent {agent} is not a finite number")]
    NotFinite {
        /// Whose.
        env: usize,
        /// Whose there.
        agent: usize,
    },
    /// The episode is over and the batch does not reset it by itself.
    #[error("the episode of environment {env} is over; reset it")]
    Ended {
        /// Which.
        env: usize,
    },
    /// The scenario of a slot, of the lowest if of several, cannot start; its episode is over.
    #[error("environment {env}: {source}")]
    Scenario {
        /// Which.
        env: usize,
        /// Why.
        source: ScenarioError,
    },
}

/// Many environments stepped together.
pub trait Batch: Send {
    /// Sizes of the buffers.
    fn shape(&self) -> Shape;
    /// Starts the next episode of every environment (of those `mask` says, where there is one), and writes their
    /// observations.
    ///
    /// # Errors
    /// A buffer of the wrong size, or a scenario that cannot start.
    fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<(), BatchError>;
    /// Writes all observations as they are now; rows of who rests are zeros.
    ///
    /// # Errors
    /// A buffer of the wrong size.
    fn observe(&mut self, observations: &mut [f32]) -> Result<(), BatchError>;
    /// One step of every environment. `actions` is `envs × agents × action`, clamped as the action space says; zeros are
    /// hold, and what is given for an agent that has left is not looked at.
    ///
    /// # Errors
    /// A buffer of the wrong size, an action that is no finite number, an episode that is over; nothing has moved then.
    fn step(&mut self, actions: &[f32], out: Output<'_>) -> Result<(), BatchError>;
    /// The scenario an environment flies, and the score so far.
    fn episode(&self, env: usize) -> Option<(Scenario, f64)>;
    /// A digest of every bit of an environment's state.
    fn state_hash(&self, env: usize) -> Option<[u8; 32]>;
    /// What an environment looks like, and what happened in its last step; `acted` is what its agents did in that, along
    /// the world's axes. `None` where it flies nothing.
    fn scene(&self, env: usize, acted: &[f32]) -> Option<Scene>;
    /// What happened in the last step of an environment's episode, in words.
    fn alerts(&self, env: usize) -> Vec<String>;
    /// What the agents of an environment see, in the wire form ([`crate::Episode::telemetry`]). `None` where it flies nothing.
    fn telemetry(&self, env: usize) -> Option<Value>;
    /// Says which agents an environment's episode, just begun, is without; all where it rests.
    fn absent(&self, env: usize, terminated: &mut [bool]);
    /// Whether an environment rests, since there is no scenario for it.
    fn rests(&self, env: usize) -> bool;
    /// What the values of an environment's observation are called, in order.
    fn columns(&self) -> Vec<String>;
    /// Bytes that one environment takes, without what environments share.
    fn bytes_per_env(&self) -> usize;
}
