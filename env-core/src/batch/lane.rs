//! The interface of one environment of a batch.

use serde_json::Value;

use super::{LaneOutput, ObservationPart};
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::task::Scenario;

/// One environment of a world in a batch.
pub trait BatchLane: Send + Sized {
    /// Starts an episode of a scenario in the same memory.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start.
    fn start(&mut self, scenario: &Scenario) -> Result<(), ScenarioError>;

    /// Advances an episode that is not over by one step, and returns true if it is then over. `actions` is
    /// `agents × action`, all accepted by the action space.
    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool;

    /// Advances several lanes, and calls `finish` for each with its lane, whether its episode is over, and the value that belongs
    /// to it. The lanes of a world that computes them side by side are stepped together; the default steps one after the other.
    fn step_many<'a, T>(
        steps: impl Iterator<Item = (LaneStep<'a, Self>, T)>,
        mut finish: impl FnMut(&'a mut Self, bool, T),
    ) where
        Self: 'a,
    {
        for (LaneStep { lane, actions, out }, value) in steps {
            let done = lane.step(actions, out);
            finish(lane, done, value);
        }
    }

    /// Marks the agents of the batch that are absent from a new episode as terminated, and clears the others.
    fn mark_absent_agents(&self, terminated: &mut [bool]) {
        terminated.fill(false);
    }

    /// Writes which agents of the batch need a new action; none if the episode is over. `out` may be empty.
    fn needs_action(&self, out: &mut [bool]);

    /// Writes the current observation.
    fn observe(&mut self, out: &mut [f32]);

    /// Score of the episode so far.
    fn score(&self) -> f64;

    /// A digest of every bit of the state.
    fn state_hash(&self) -> [u8; 32];

    /// Scene after a step with these actions.
    fn scene(&self, actions: &[f32]) -> Scene;

    /// Texts of the events of the last step.
    fn alerts(&self) -> Vec<String>;

    /// Observation of the agents as JSON.
    fn telemetry(&self) -> Value;

    /// Names of the values that [`BatchLane::observe`] writes, in order.
    fn columns(&self) -> Vec<String>;

    /// Arrays that [`BatchLane::observe`] writes, in order.
    fn parts(&self) -> Vec<ObservationPart>;

    /// Memory of the lane, in bytes.
    fn bytes(&self) -> usize;
}

/// A lane that is stepped, with its actions and buffers.
#[derive(Debug)]
pub struct LaneStep<'a, L> {
    /// Lane whose episode is not over.
    pub lane: &'a mut L,
    /// Actions of its agents, `agents × action`.
    pub actions: &'a [f32],
    /// Buffers that it writes.
    pub out: LaneOutput<'a>,
}
