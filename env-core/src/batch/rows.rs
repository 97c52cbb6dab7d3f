//! The buffers of a step, cut into what each thread and each environment writes.

use super::{Output, Shape};

/// One environment's part of the buffers.
pub(super) struct Row<'a> {
    pub(super) observation: &'a mut [f32],
    pub(super) last: &'a mut [f32],
    pub(super) rewards: &'a mut [f32],
    pub(super) team_reward: &'a mut f32,
    pub(super) terminated: &'a mut [bool],
    pub(super) truncated: &'a mut [bool],
    pub(super) done: &'a mut bool,
    pub(super) taken: &'a mut [f32],
}

/// A chunk's part of the buffers.
pub(super) struct Rows<'a> {
    observations: &'a mut [f32],
    last: &'a mut [f32],
    rewards: &'a mut [f32],
    team_rewards: &'a mut [f32],
    terminated: &'a mut [bool],
    truncated: &'a mut [bool],
    done: &'a mut [bool],
    taken: &'a mut [f32],
}

/// The first `n` of a slice that is passed on: what is left stays in it.
fn take<'a, T>(slice: &mut &'a mut [T], n: usize) -> &'a mut [T] {
    let whole = std::mem::take(slice);
    let (head, tail) = whole.split_at_mut(n.min(whole.len()));
    *slice = tail;
    head
}

impl<'a> From<Output<'a>> for Rows<'a> {
    fn from(out: Output<'a>) -> Self {
        Self {
            observations: out.observations,
            last: out.final_observations,
            rewards: out.rewards,
            team_rewards: out.team_rewards,
            terminated: out.terminated,
            truncated: out.truncated,
            done: out.done,
            taken: out.taken,
        }
    }
}

impl<'a> Rows<'a> {
    /// The next `envs` environments' rows.
    pub(super) fn split(&mut self, envs: usize, shape: Shape) -> Self {
        Rows {
            observations: take(&mut self.observations, envs * shape.observation),
            last: take(&mut self.last, envs * shape.observation),
            rewards: take(&mut self.rewards, envs * shape.agents),
            team_rewards: take(&mut self.team_rewards, envs),
            terminated: take(&mut self.terminated, envs * shape.agents),
            truncated: take(&mut self.truncated, envs * shape.agents),
            done: take(&mut self.done, envs),
            taken: take(&mut self.taken, envs * shape.agents * shape.action),
        }
    }

    /// Row by row. Where there are no final observations every row has an empty one.
    pub(super) fn rows(self, shape: Shape) -> impl Iterator<Item = Row<'a>> {
        let Shape { agents, action, observation, .. } = shape;
        let mut last = self.last.chunks_exact_mut(observation.max(1));
        let mut taken = self.taken.chunks_exact_mut((agents * action).max(1));
        self.observations
            .chunks_exact_mut(observation.max(1))
            .zip(self.rewards.chunks_exact_mut(agents))
            .zip(self.terminated.chunks_exact_mut(agents))
            .zip(self.truncated.chunks_exact_mut(agents))
            .zip(self.team_rewards)
            .zip(self.done)
            .map(move |(((((observation, rewards), terminated), truncated), team_reward), done)| Row {
                observation,
                last: last.next().unwrap_or_default(),
                rewards,
                team_reward,
                terminated,
                truncated,
                done,
                taken: taken.next().unwrap_or_default(),
            })
    }
}
