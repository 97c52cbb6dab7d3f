//! The buffers a batch writes, for callers that have none of their own.

use super::{Autoreset, Output, Shape};

/// Buffers of one batch; what they mean is in [`Output`].
#[derive(Debug, Clone)]
pub struct Buffers {
    /// `envs × observation`.
    pub observations: Vec<f32>,
    /// `envs × observation` under `SameStep`, else empty.
    pub final_observations: Vec<f32>,
    /// `envs × agents`.
    pub rewards: Vec<f32>,
    /// `envs`.
    pub team_rewards: Vec<f32>,
    /// `envs × agents`.
    pub terminated: Vec<bool>,
    /// `envs × agents`.
    pub truncated: Vec<bool>,
    /// `envs`.
    pub done: Vec<bool>,
}

impl Buffers {
    /// Of the sizes that a batch of this shape asks for.
    #[must_use]
    pub fn new(shape: Shape, autoreset: Autoreset) -> Self {
        let Shape { envs, agents, observation, .. } = shape;
        let last = if autoreset == Autoreset::SameStep { envs * observation } else { 0 };
        Self {
            observations: vec![0.0; envs * observation],
            final_observations: vec![0.0; last],
            rewards: vec![0.0; envs * agents],
            team_rewards: vec![0.0; envs],
            terminated: vec![false; envs * agents],
            truncated: vec![false; envs * agents],
            done: vec![false; envs],
        }
    }

    /// What a step writes.
    pub fn output(&mut self) -> Output<'_> {
        Output {
            observations: &mut self.observations,
            final_observations: &mut self.final_observations,
            rewards: &mut self.rewards,
            team_rewards: &mut self.team_rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            done: &mut self.done,
            taken: &mut [],
        }
    }
}
