//! A batch with the buffers it writes, flown by actions drawn beforehand.

use std::hint::black_box;

use anyhow::Context;
use env_core::Recipe;
use env_core::batch::{Autoreset, Batch, BatchConfig, BatchBuffers, ObservationMode, SeedSequence, BatchShape};
use env_core::episode_rng::{EpisodeRng, SeededRng, RngStream};
use env_core::{Seed, SeedSpace};

/// Joint actions drawn beforehand, flown in turn: prime, and no divisor of a horizon, so that episodes differ.
const ACTIONS: u64 = 13;

/// A batch in flight: a fresh seed for every episode, reset in the step that ends it.
pub struct Flying {
    batch: Box<dyn Batch>,
    shape: BatchShape,
    actions: Vec<Vec<f32>>,
    next: usize,
    buffers: BatchBuffers,
}

impl Flying {
    /// So many environments of a task at these params, flown by actions uniform within plus and minus `size` by about
    /// half of the agents in every step.
    ///
    /// # Errors
    /// No such task, or params out of range.
    pub fn new(task: &str, params: &[(&str, f64)], envs: usize, size: f64) -> anyhow::Result<Self> {
        let spec = env_core::task(task).with_context(|| format!("{task} is gone"))?;
        let recipe = Recipe::with_params(spec, params.iter().copied())?;
        Self::of(recipe, envs, size, ObservationMode::All { bodies: None })
    }

    /// The same of a recipe, observed as told.
    ///
    /// # Errors
    /// More environments than a batch takes, or observations that the world does not have.
    pub fn of(recipe: Recipe, envs: usize, size: f64, observe: ObservationMode) -> anyhow::Result<Self> {
        let spec = recipe.task();
        let config = BatchConfig::new(envs, Autoreset::SameStep, observe);
        let mut batch = spec.batch(Box::new(SeedSequence::new(recipe, 1)), config)?;
        let shape = batch.shape();
        let mut buffers = BatchBuffers::new(shape, config.autoreset);
        batch.reset(None, &mut buffers.observations)?;
        Ok(Self {
            batch,
            shape,
            actions: (0..ACTIONS).map(|turn| draw(turn, shape, size)).collect(),
            next: 0,
            buffers,
        })
    }

    /// One step of every environment.
    ///
    /// # Errors
    /// Never in practice: actions are finite, and episodes that end begin again.
    pub fn step(&mut self) -> anyhow::Result<()> {
        self.next = (self.next + 1) % self.actions.len();
        self.batch.step(black_box(&self.actions[self.next]), self.buffers.output())?;
        black_box(&self.buffers.observations);
        Ok(())
    }

    /// Sizes of the buffers.
    #[must_use]
    pub const fn shape(&self) -> BatchShape {
        self.shape
    }

    /// Episodes that ended in the last step.
    #[must_use]
    pub fn ended(&self) -> usize {
        self.buffers.done.iter().filter(|&&done| done).count()
    }

    /// Agents that flew to the end of the last step.
    #[must_use]
    pub fn agents(&self) -> usize {
        self.buffers.terminated.iter().filter(|&&left| !left).count()
    }

    /// Bytes that one environment takes.
    #[must_use]
    pub fn bytes_per_env(&self) -> usize {
        self.batch.bytes_per_env()
    }
}

/// Actions of all environments for one step, drawn beforehand so that drawing is not measured.
#[expect(clippy::cast_possible_truncation, reason = "actions are single precision")]
fn draw(turn: u64, shape: BatchShape, size: f64) -> Vec<f32> {
    let mut chance = SeededRng::new(Seed::in_space(SeedSpace::User, turn));
    let mut actions = Vec::with_capacity(shape.envs * shape.agents * shape.action);
    for _ in 0..shape.envs * shape.agents {
        let acts = chance.uniform(RngStream::Policy) < 0.5;
        for _ in 0..shape.action {
            let value = chance.uniform_in(RngStream::Policy, -size, size) as f32;
            actions.push(if acts { value } else { 0.0 });
        }
    }
    actions
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn about_half_of_the_agents_act_in_every_step() {
        let flying = Flying::new("kessler/survival", &[("debris", 5.0)], 300, 0.05).unwrap();
        let mut acting = 0;
        for values in flying.actions.iter().flat_map(|turn| turn.chunks(2)) {
            assert!(values.iter().all(|v| v.abs() <= 0.05));
            acting += usize::from(values != [0.0, 0.0]);
        }
        // 13 · 900 coins: 5 850 ± 54 (one standard deviation).
        assert!((5580..6120).contains(&acting), "{acting}");
    }
}
