//! The buffers that a batch writes.

use super::{Autoreset, BatchShape};

/// The caller's buffers for one step. A step writes all of them completely, except for the final observations of episodes
/// that continue. After an error their contents are undefined.
#[derive(Debug)]
pub struct BatchOutput<'a> {
    /// Current observations, `envs × observation`.
    pub observations: &'a mut [f32],
    /// Last observations of episodes that ended in this step, `envs × observation` under [`Autoreset::SameStep`], else
    /// empty. Rows of the other environments are unchanged.
    pub final_observations: &'a mut [f32],
    /// Reward of each agent, `envs × agents`; zero once it has left.
    pub rewards: &'a mut [f32],
    /// Reward of each team, `envs`; the score sums it.
    pub team_rewards: &'a mut [f32],
    /// True if an agent has left by the rules of the task in this or an earlier step of the episode, or is absent from it,
    /// `envs × agents`.
    pub terminated: &'a mut [bool],
    /// True if the horizon cut an agent off in this step, `envs × agents`.
    pub truncated: &'a mut [bool],
    /// True if the episode ended in this step, `envs`.
    pub done: &'a mut [bool],
    /// Duration of the step in the world's unit, `envs`; zero if the step was a reset. Empty if the caller does not need it.
    pub elapsed: &'a mut [f32],
    /// True if an agent needs a new action, `envs × agents`; empty if the caller does not need it. Where actions last several steps,
    /// it is false until one is over. If the step began another episode, it belongs to that one.
    pub needs_action: &'a mut [bool],
    /// Actions along the world's axes before clamping, as a log contains them, `envs × agents × action`; empty if the
    /// caller does not need them. They are hold if the step was a reset.
    pub executed_actions: &'a mut [f32],
}

/// The buffers that a lane writes in a step.
#[derive(Debug)]
pub struct LaneOutput<'a> {
    /// Reward of each agent.
    pub rewards: &'a mut [f32],
    /// Reward of the team.
    pub team_reward: &'a mut f32,
    /// True if an agent has left in this or an earlier step.
    pub terminated: &'a mut [bool],
    /// True if the horizon cut an agent off in this step.
    pub truncated: &'a mut [bool],
    /// Duration of the step in the world's unit; empty if the caller does not need it.
    pub elapsed: &'a mut [f32],
    /// Actions along the world's axes; empty if the caller does not need them.
    pub executed_actions: &'a mut [f32],
}

/// Buffers of one batch for callers without buffers of their own; [`BatchOutput`] describes the fields.
#[derive(Debug, Clone)]
pub struct BatchBuffers {
    /// Current observations, `envs × observation`.
    pub observations: Vec<f32>,
    /// Last observations, `envs × observation` under [`Autoreset::SameStep`], else empty.
    pub final_observations: Vec<f32>,
    /// Reward of each agent, `envs × agents`.
    pub rewards: Vec<f32>,
    /// Reward of each team, `envs`.
    pub team_rewards: Vec<f32>,
    /// True if an agent has left, `envs × agents`.
    pub terminated: Vec<bool>,
    /// True if the horizon cut an agent off, `envs × agents`.
    pub truncated: Vec<bool>,
    /// True if the episode ended in this step, `envs`.
    pub done: Vec<bool>,
    /// Duration of the step, `envs`.
    pub elapsed: Vec<f32>,
    /// True if an agent needs a new action, `envs × agents`; all do before the first step.
    pub needs_action: Vec<bool>,
}

impl BatchBuffers {
    /// Creates zeroed buffers for a batch of this shape.
    #[must_use]
    pub fn new(shape: BatchShape, autoreset: Autoreset) -> Self {
        let BatchShape { envs, agents, observation, .. } = shape;
        let finals = if autoreset == Autoreset::SameStep { envs * observation } else { 0 };
        Self {
            observations: vec![0.0; envs * observation],
            final_observations: vec![0.0; finals],
            rewards: vec![0.0; envs * agents],
            team_rewards: vec![0.0; envs],
            terminated: vec![false; envs * agents],
            truncated: vec![false; envs * agents],
            done: vec![false; envs],
            elapsed: vec![0.0; envs],
            needs_action: vec![true; envs * agents],
        }
    }

    /// Borrows the buffers for one step, without executed actions.
    pub fn output(&mut self) -> BatchOutput<'_> {
        BatchOutput {
            observations: &mut self.observations,
            final_observations: &mut self.final_observations,
            rewards: &mut self.rewards,
            team_rewards: &mut self.team_rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            done: &mut self.done,
            elapsed: &mut self.elapsed,
            needs_action: &mut self.needs_action,
            executed_actions: &mut [],
        }
    }
}
