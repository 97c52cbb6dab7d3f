//! Divides the buffers of a step among threads and environments.

use super::{BatchOutput, BatchShape, LaneOutput};

/// The part of the buffers that one environment writes.
pub(super) struct Row<'a> {
    pub(super) observation: &'a mut [f32],
    pub(super) final_observation: &'a mut [f32],
    pub(super) rewards: &'a mut [f32],
    pub(super) team_reward: &'a mut f32,
    pub(super) terminated: &'a mut [bool],
    pub(super) truncated: &'a mut [bool],
    pub(super) done: &'a mut bool,
    pub(super) elapsed: &'a mut [f32],
    pub(super) needs_action: &'a mut [bool],
    pub(super) executed_actions: &'a mut [f32],
}

/// The part of a row that the lane does not write.
pub(super) struct StepRow<'a> {
    pub(super) observation: &'a mut [f32],
    pub(super) final_observation: &'a mut [f32],
    pub(super) done: &'a mut bool,
    pub(super) needs_action: &'a mut [bool],
}

impl<'a> Row<'a> {
    /// Divides the row into the buffers that a lane writes in a step and the rest.
    pub(super) fn split(self) -> (LaneOutput<'a>, StepRow<'a>) {
        let Self { observation, final_observation, done, needs_action, .. } = self;
        let out = LaneOutput {
            rewards: self.rewards,
            team_reward: self.team_reward,
            terminated: self.terminated,
            truncated: self.truncated,
            elapsed: self.elapsed,
            executed_actions: self.executed_actions,
        };
        (out, StepRow { observation, final_observation, done, needs_action })
    }
}

/// The part of the buffers that one chunk of environments writes.
pub(super) struct Rows<'a> {
    observations: &'a mut [f32],
    final_observations: &'a mut [f32],
    rewards: &'a mut [f32],
    team_rewards: &'a mut [f32],
    terminated: &'a mut [bool],
    truncated: &'a mut [bool],
    done: &'a mut [bool],
    elapsed: &'a mut [f32],
    needs_action: &'a mut [bool],
    executed_actions: &'a mut [f32],
}

impl<'a> From<BatchOutput<'a>> for Rows<'a> {
    fn from(out: BatchOutput<'a>) -> Self {
        Self {
            observations: out.observations,
            final_observations: out.final_observations,
            rewards: out.rewards,
            team_rewards: out.team_rewards,
            terminated: out.terminated,
            truncated: out.truncated,
            done: out.done,
            elapsed: out.elapsed,
            needs_action: out.needs_action,
            executed_actions: out.executed_actions,
        }
    }
}

impl<'a> Rows<'a> {
    /// Takes the rows of the first `envs` environments.
    pub(super) fn take_envs(&mut self, envs: usize, shape: BatchShape) -> Self {
        Rows {
            observations: take_prefix(&mut self.observations, envs * shape.observation),
            final_observations: take_prefix(&mut self.final_observations, envs * shape.observation),
            rewards: take_prefix(&mut self.rewards, envs * shape.agents),
            team_rewards: take_prefix(&mut self.team_rewards, envs),
            terminated: take_prefix(&mut self.terminated, envs * shape.agents),
            truncated: take_prefix(&mut self.truncated, envs * shape.agents),
            done: take_prefix(&mut self.done, envs),
            elapsed: take_prefix(&mut self.elapsed, envs),
            needs_action: take_prefix(&mut self.needs_action, envs * shape.agents),
            executed_actions: take_prefix(&mut self.executed_actions, envs * shape.agents * shape.action),
        }
    }

    /// The rows one by one. Buffers that the caller does not need are empty in each row.
    pub(super) fn rows(self, shape: BatchShape) -> impl Iterator<Item = Row<'a>> {
        let BatchShape { agents, action, observation, .. } = shape;
        let mut final_observations = self.final_observations.chunks_exact_mut(observation.max(1));
        let mut elapsed = self.elapsed.chunks_exact_mut(1);
        let mut needs_action = self.needs_action.chunks_exact_mut(agents);
        let mut executed_actions = self.executed_actions.chunks_exact_mut((agents * action).max(1));
        self.observations
            .chunks_exact_mut(observation.max(1))
            .zip(self.rewards.chunks_exact_mut(agents))
            .zip(self.terminated.chunks_exact_mut(agents))
            .zip(self.truncated.chunks_exact_mut(agents))
            .zip(self.team_rewards)
            .zip(self.done)
            .map(move |(((((observation, rewards), terminated), truncated), team_reward), done)| Row {
                observation,
                final_observation: final_observations.next().unwrap_or_default(),
                rewards,
                team_reward,
                terminated,
                truncated,
                done,
                elapsed: elapsed.next().unwrap_or_default(),
                needs_action: needs_action.next().unwrap_or_default(),
                executed_actions: executed_actions.next().unwrap_or_default(),
            })
    }
}

/// Takes the first `n` elements of a slice; the rest stays in it.
fn take_prefix<'a, T>(slice: &mut &'a mut [T], n: usize) -> &'a mut [T] {
    let whole = std::mem::take(slice);
    let (head, tail) = whole.split_at_mut(n.min(whole.len()));
    *slice = tail;
    head
}
