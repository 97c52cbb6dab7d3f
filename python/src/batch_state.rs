//! Mutable state of a batch: its environments, the buffers they write, and statistics of their episodes.

use std::time::Instant;

use env_core::batch::episode_assigner::EpisodeAssigner;
use env_core::batch::{Autoreset, Batch, BatchBuffers, BatchError, BatchOutput, BatchShape};

use crate::curriculum::LeasedEpisode;
use crate::renderer::{ImageSize, Renderer};

/// Mutable state of a batch.
pub(crate) struct BatchState {
    /// Assignment of leased episodes to environments; `None` without a curriculum, or once the batch is closed.
    pub(crate) assigner: Option<EpisodeAssigner<LeasedEpisode>>,
    pub(crate) batch: Box<dyn Batch>,
    pub(crate) buffers: BatchBuffers,
    /// Actions of the next step; kept to avoid an allocation per step.
    pub(crate) actions: Vec<f32>,
    /// Actions of the last step, along the world's axes.
    pub(crate) last_actions: Vec<f32>,
    /// Value of an agent that holds.
    hold: f32,
    /// Return of each environment's episode so far.
    returns: Vec<f64>,
    /// Steps of each environment's episode so far.
    lengths: Vec<i64>,
    started: Vec<Instant>,
    /// True for environments whose episode ended in the last step.
    pub(crate) ended: Vec<bool>,
    /// True for environments that had no episode in the last step.
    was_idle: Vec<bool>,
    /// Number of steps of all environments; those that only began an episode do not count.
    pub(crate) total_steps: u64,
    renderers: Vec<Option<Renderer>>,
}

/// Statistics of the episodes that ended in the last step; zeros for all other environments.
pub(crate) struct EpisodeStats {
    pub(crate) returns: Vec<f64>,
    pub(crate) lengths: Vec<i64>,
    pub(crate) seconds: Vec<f64>,
}

/// Caller's buffers that a step writes.
pub(crate) struct StepBuffers<'a> {
    pub(crate) observations: &'a mut [f32],
    pub(crate) rewards: &'a mut [f64],
    pub(crate) terminations: &'a mut [bool],
    pub(crate) truncations: &'a mut [bool],
}

/// A step whose actions are repeated, with the sums of its parts so far.
pub(crate) struct RepeatedStep {
    autoreset: Autoreset,
    agents: usize,
    /// True for environments that take part in the next repetition: none has ended or begun an episode.
    running: Vec<bool>,
    is_first: bool,
    team_rewards: Vec<f64>,
    rewards: Vec<f32>,
    elapsed: Vec<f32>,
}

impl RepeatedStep {
    /// Creates a step before its first part.
    pub(crate) fn new(shape: BatchShape, autoreset: Autoreset) -> Self {
        let BatchShape { envs, agents, .. } = shape;
        Self {
            autoreset,
            agents,
            running: vec![true; envs],
            is_first: true,
            team_rewards: vec![0.0; envs],
            rewards: vec![0.0; envs * agents],
            elapsed: vec![0.0; envs],
        }
    }

    /// Environments of the next part; `None` if it steps all.
    pub(crate) fn mask(&self) -> Option<&[bool]> {
        (!self.is_first).then_some(&self.running)
    }

    /// Begins another part; false if no environment takes part in it.
    pub(crate) fn next(&mut self) -> bool {
        self.is_first = false;
        self.running.iter().any(|running| *running)
    }

    fn is_stopped(&self, env: usize) -> bool {
        !self.running[env]
    }

    /// Adds the rewards and the duration of a part; `stops` if the environment takes no part in the others.
    fn add(&mut self, env: usize, buffers: &BatchBuffers, stops: bool) {
        self.team_rewards[env] += f64::from(buffers.team_rewards[env]);
        self.elapsed[env] += buffers.elapsed[env];
        for agent in env * self.agents..(env + 1) * self.agents {
            self.rewards[agent] += buffers.rewards[agent];
        }
        self.running[env] = !stops;
    }
}

impl BatchState {
    /// Creates the state of a batch before its first reset.
    pub(crate) fn new(
        batch: Box<dyn Batch>,
        autoreset: Autoreset,
        hold: f32,
        assigner: Option<EpisodeAssigner<LeasedEpisode>>,
    ) -> Self {
        let shape = batch.shape();
        let BatchShape { envs, agents, action, .. } = shape;
        Self {
            buffers: BatchBuffers::new(shape, autoreset),
            actions: Vec::new(),
            last_actions: vec![hold; envs * agents * action],
            hold,
            returns: vec![0.0; envs],
            lengths: vec![0; envs],
            started: vec![Instant::now(); envs],
            ended: vec![false; envs],
            was_idle: vec![false; envs],
            total_steps: 0,
            renderers: Vec::new(),
            batch,
            assigner,
        }
    }

    /// Returns the statistics of the episodes that ended in the last step.
    pub(crate) fn finished_episodes(&self) -> EpisodeStats {
        let mut stats = EpisodeStats {
            returns: vec![0.0; self.ended.len()],
            lengths: vec![0; self.ended.len()],
            seconds: vec![0.0; self.ended.len()],
        };
        let now = Instant::now();
        for (env, _) in self.ended.iter().enumerate().filter(|(_, ended)| **ended) {
            stats.returns[env] = self.returns[env];
            stats.lengths[env] = self.lengths[env];
            // Gymnasium rounds to microseconds.
            let micros = now.duration_since(self.started[env]).as_micros();
            stats.seconds[env] = micros as f64 / 1e6;
        }
        stats
    }

    /// Clears the statistics and flags of all environments that were reset, or of those in the mask.
    pub(crate) fn start_episodes(&mut self, mask: Option<&[bool]>, shape: BatchShape) {
        let now = Instant::now();
        for env in 0..shape.envs {
            if mask.is_none_or(|mask| mask[env]) {
                (self.returns[env], self.lengths[env], self.ended[env]) = (0.0, 0, false);
                self.was_idle[env] = self.batch.is_idle(env);
                self.started[env] = now;
                let agents = env * shape.agents..(env + 1) * shape.agents;
                let absent = &mut self.buffers.terminated[agents.clone()];
                self.batch.mark_absent_agents(env, absent);
                self.batch.write_needs_action(env, &mut self.buffers.needs_action[agents.clone()]);
                self.buffers.elapsed[env] = 0.0;
                self.buffers.truncated[agents.clone()].fill(false);
                self.buffers.rewards[agents].fill(0.0);
                let width = shape.agents * shape.action;
                self.last_actions[env * width..(env + 1) * width].fill(self.hold);
                self.clear_trails(env);
            }
        }
    }

    /// Steps the environments of the next part of a step into `out`; adds their rewards to the repeated step.
    ///
    /// # Errors
    /// Returns the batch's error for invalid actions or an environment that needs a reset; nothing changes then.
    pub(crate) fn step(
        &mut self,
        actions: &[f32],
        repeated: &mut RepeatedStep,
        out: &mut StepBuffers<'_>,
        shape: BatchShape,
    ) -> Result<(), BatchError> {
        let buffers = &mut self.buffers;
        let output = BatchOutput {
            observations: &mut *out.observations,
            final_observations: &mut buffers.final_observations,
            rewards: &mut buffers.rewards,
            team_rewards: &mut buffers.team_rewards,
            terminated: &mut buffers.terminated,
            truncated: &mut buffers.truncated,
            done: &mut buffers.done,
            elapsed: &mut buffers.elapsed,
            needs_action: &mut buffers.needs_action,
            executed_actions: &mut self.last_actions,
        };
        self.batch.step_some(actions, repeated.mask(), output)?;
        let now = Instant::now();
        for env in 0..shape.envs {
            if repeated.is_stopped(env) {
                continue;
            }
            let done = self.buffers.done[env];
            let mut begins = self.was_idle[env];
            if self.ended[env] || self.was_idle[env] {
                // The last step ended an episode or ran none: statistics of a new episode start here.
                self.started[env] = now;
                // A step that only begins an episode does not count as a step of it.
                begins = repeated.autoreset == Autoreset::NextStep || self.was_idle[env];
                (self.returns[env], self.lengths[env]) = (0.0, if begins { -1 } else { 0 });
                self.clear_trails(env);
            }
            self.returns[env] += f64::from(self.buffers.team_rewards[env]);
            self.lengths[env] += 1;
            self.total_steps += u64::from(!begins);
            self.ended[env] = done;
            self.was_idle[env] = self.assigner.is_some() && self.batch.is_idle(env);
            let agents = env * shape.agents..(env + 1) * shape.agents;
            out.terminations[env] = done && self.buffers.terminated[agents.clone()].iter().all(|flag| *flag);
            out.truncations[env] = done && self.buffers.truncated[agents].iter().any(|flag| *flag);
            repeated.add(env, &self.buffers, done || begins);
        }
        Ok(())
    }

    /// Completes a step: writes the sums of its parts. Returns true if any episode ended.
    pub(crate) fn finish_step(&mut self, repeated: RepeatedStep, rewards: &mut [f64]) -> bool {
        rewards.copy_from_slice(&repeated.team_rewards);
        self.buffers.rewards = repeated.rewards;
        self.buffers.elapsed = repeated.elapsed;
        self.ended.iter().any(|ended| *ended)
    }

    /// Renders an environment as RGB bytes; `None` before the first reset or if there is no memory for the image.
    pub(crate) fn render(&mut self, env: usize, shape: BatchShape, size: ImageSize) -> Option<Vec<u8>> {
        let width = shape.agents * shape.action;
        let scene = self.batch.scene(env, &self.last_actions[env * width..(env + 1) * width])?;
        self.renderers.resize_with(shape.envs, || None);
        let renderer = &mut self.renderers[env];
        if renderer.as_ref().is_none_or(|renderer| renderer.size() != size) {
            *renderer = Renderer::new(size);
        }
        Some(renderer.as_mut()?.render(&scene))
    }

    fn clear_trails(&mut self, env: usize) {
        if let Some(Some(renderer)) = self.renderers.get_mut(env) {
            renderer.clear_trails();
        }
    }
}
