//! Batch of environments with its buffers, stepped with actions that are drawn beforehand.

use std::hint::black_box;

use anyhow::Context;
use env_core::Recipe;
use env_core::batch::{
    Autoreset, Batch, BatchBuffers, BatchConfig, BatchShape, ObservationMode, SeedSequence,
};
use env_core::episode_rng::{EpisodeRng, RngStream, SeededRng};
use env_core::space::{ActionKind, ActionSpace};
use env_core::{Seed, SeedSpace};

/// Number of joint actions that are used in turn. It is prime and divides no horizon, so that episodes differ.
const ACTION_COUNT: u64 = 13;

/// Running batch. Every episode has a fresh seed and is reset in the step that ends it.
pub struct SteppedBatch {
    batch: Box<dyn Batch>,
    shape: BatchShape,
    actions: Vec<Vec<f32>>,
    next: usize,
    buffers: BatchBuffers,
}

impl SteppedBatch {
    /// Creates `envs` environments of a task. In every step about half of the agents act, uniformly within ±`size`; where actions have
    /// names, all agents choose one.
    ///
    /// # Errors
    /// Returns an error if the task does not exist or a param is out of range.
    pub fn new(task: &str, params: &[(&str, f64)], envs: usize, size: f64) -> anyhow::Result<Self> {
        let spec = env_core::task(task).with_context(|| format!("task {task} does not exist"))?;
        let recipe = Recipe::with_params(spec, params.iter().copied())?;
        Self::from_recipe(recipe, envs, size, ObservationMode::All { bodies: None })
    }

    /// Creates a batch from a recipe and an observation mode.
    ///
    /// # Errors
    /// Returns an error if `envs` exceeds the batch limit or the world lacks the observation mode.
    pub fn from_recipe(
        recipe: Recipe,
        envs: usize,
        size: f64,
        observe: ObservationMode,
    ) -> anyhow::Result<Self> {
        let spec = recipe.task();
        let config = BatchConfig::new(envs, Autoreset::SameStep, observe);
        let mut batch = spec.batch(Box::new(SeedSequence::new(recipe, 1)), config)?;
        let shape = batch.shape();
        let mut buffers = BatchBuffers::new(shape, config.autoreset);
        batch.reset(None, &mut buffers.observations)?;
        Ok(Self {
            batch,
            shape,
            actions: (0..ACTION_COUNT).map(|turn| draw(turn, shape, &spec.action_space(), size)).collect(),
            next: 0,
            buffers,
        })
    }

    /// Steps every environment once.
    ///
    /// # Errors
    /// Returns an error if an action is not finite or an episode has ended; neither happens here.
    pub fn step(&mut self) -> anyhow::Result<()> {
        self.next = (self.next + 1) % self.actions.len();
        self.batch.step(black_box(&self.actions[self.next]), self.buffers.output())?;
        black_box(&self.buffers.observations);
        Ok(())
    }

    /// Returns the sizes of the buffers.
    #[must_use]
    pub const fn shape(&self) -> BatchShape {
        self.shape
    }

    /// Returns the number of episodes that ended in the last step.
    #[must_use]
    pub fn ended(&self) -> usize {
        self.buffers.done.iter().filter(|&&done| done).count()
    }

    /// Returns the number of agents that were active to the end of the last step.
    #[must_use]
    pub fn agents(&self) -> usize {
        self.buffers.terminated.iter().filter(|&&left| !left).count()
    }

    /// Returns the memory of one environment in bytes.
    #[must_use]
    pub fn bytes_per_env(&self) -> usize {
        self.batch.bytes_per_env()
    }
}

/// Draws the actions of all environments for one step. They are drawn beforehand, so that drawing is not measured.
#[expect(clippy::cast_possible_truncation, reason = "actions are single precision")]
fn draw(turn: u64, shape: BatchShape, space: &ActionSpace, size: f64) -> Vec<f32> {
    let mut rng = SeededRng::new(Seed::in_space(SeedSpace::User, turn));
    let mut actions = Vec::with_capacity(shape.envs * shape.agents * shape.action);
    let names = space.names().len() as f64;
    if space.kind != ActionKind::Box {
        let choose = |_| (rng.uniform(RngStream::Policy) * names).floor().min(names - 1.0) as f32;
        return (0..shape.envs * shape.agents).map(choose).collect();
    }
    for _ in 0..shape.envs * shape.agents {
        let acts = rng.uniform(RngStream::Policy) < 0.5;
        for _ in 0..shape.action {
            let value = rng.uniform_in(RngStream::Policy, -size, size) as f32;
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
        let stepped_batch = SteppedBatch::new("kessler/survival", &[("debris", 5.0)], 300, 0.05).unwrap();
        let mut acting = 0;
        for values in stepped_batch.actions.iter().flat_map(|turn| turn.chunks(2)) {
            assert!(values.iter().all(|v| v.abs() <= 0.05));
            acting += usize::from(values != [0.0, 0.0]);
        }
        // 13 · 900 coins: 5 850 ± 54 (one standard deviation).
        assert!((5580..6120).contains(&acting), "{acting}");
    }
}
