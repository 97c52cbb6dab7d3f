//! An episode and the reports of its steps.

use std::any::Any;

use serde_json::Value;

use crate::bracket::EpisodeOutcome;
use crate::error::StepError;
use crate::log::JointAction;

/// Result of a step for one agent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgentReport {
    /// Number of the agent.
    pub agent: u32,
    /// Reward of the agent.
    pub reward: f64,
    /// True if the agent left the episode by the rules of the task.
    pub terminated: bool,
    /// True if the horizon cut the episode off.
    pub truncated: bool,
    /// True if the agent needs a new action. In a world whose actions last several steps it is false until one is over.
    pub needs_action: bool,
}

/// Result of a step for every agent that was alive before it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// One entry for each agent that was alive before the step.
    pub agents: Vec<AgentReport>,
    /// Reward of the team, which the score sums.
    pub reward: f64,
    /// Elapsed time in the world's unit.
    pub elapsed: f64,
    /// True if the episode is over.
    pub done: bool,
}

/// One attempt at a scenario.
pub trait Episode: Send {
    /// Advances the world by one step and overwrites `report`.
    ///
    /// # Errors
    /// Returns an error if the environment does not accept the action; the environment is then unchanged.
    fn step(&mut self, action: JointAction<'_>, report: &mut StepReport) -> Result<(), StepError>;

    /// Number of steps taken.
    fn steps(&self) -> u32;

    /// True if the episode is over.
    fn done(&self) -> bool;

    /// Current observation of all agents, in the type that the world's own policies observe.
    fn observation(&self) -> &dyn Any;

    /// Current observation of all agents as JSON.
    fn telemetry(&self) -> Value;

    /// Closest approaches ahead of the bodies that the agents see, whether or not an option adds them to the observation;
    /// `None` in a world without such a forecast.
    fn conjunctions(&self) -> Option<Value> {
        None
    }

    /// Appends the current observation of all agents as JSON, without `reward` and `done`. It equals [`Episode::telemetry`] and is
    /// faster.
    fn write_observation(&self, out: &mut Vec<u8>);

    /// Reward of the team in the last step; 0 before the first.
    fn last_reward(&self) -> f64;

    /// Records how the world moves within later steps, which [`truth`](Self::truth) then describes. Only worlds with long steps do.
    fn record_motion(&mut self) {}

    /// The complete state now, hidden bodies included, as JSON for replay views.
    fn truth(&self) -> Value;

    /// The outcome so far.
    fn outcome(&self) -> EpisodeOutcome;

    /// A digest of every bit of the state, for regression tests.
    fn state_hash(&self) -> [u8; 32];
}
