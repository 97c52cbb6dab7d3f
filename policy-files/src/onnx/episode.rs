//! An episode that a network controls.

use std::any::Any;
use std::sync::Arc;

use env_core::batch::{Autoreset, Batch, BatchBuffers, BatchConfig, BatchError, BatchOutput, ScenarioSource};
use env_core::log::ActionLog;
use env_core::policy::{Policy, PolicyError};
use env_core::space::ActionSpace;
use env_core::{Recipe, Scenario};

use super::network::Network;
use super::settings::ModelSettings;

/// Source with one scenario.
struct OneScenario(Scenario);

impl ScenarioSource for OneScenario {
    fn scenario(&self, _: usize, _: u64) -> Scenario {
        self.0.clone()
    }

    fn single_recipe(&self) -> Option<&Arc<Recipe>> {
        Some(self.0.recipe())
    }
}

/// Creates the environment that writes the observations of a model.
pub(super) fn create_batch(
    scenario: &Scenario,
    settings: &ModelSettings,
    discrete: bool,
) -> Result<Box<dyn Batch>, BatchError> {
    let task = scenario.task();
    let config = BatchConfig {
        axes: settings.axes(task, discrete),
        single_threaded: true,
        ..BatchConfig::new(1, Autoreset::Disabled, settings.observation(task))
    };
    task.batch(Box::new(OneScenario(scenario.clone())), config)
}

/// Policy of one episode.
///
/// Models observe single-precision arrays, which only a vector environment writes. The policy therefore steps an environment of its
/// own by the same actions as its caller; equal actions lead to equal states.
pub(super) struct OnnxEpisode {
    name: String,
    network: Arc<Network>,
    batch: Box<dyn Batch>,
    space: ActionSpace,
    buffers: BatchBuffers,
    executed: Vec<f32>,
    steps: usize,
}

impl OnnxEpisode {
    /// Starts the episode of a batch's only scenario.
    pub(super) fn start(
        name: String,
        network: Arc<Network>,
        mut batch: Box<dyn Batch>,
        space: ActionSpace,
    ) -> Result<Self, PolicyError> {
        let shape = batch.shape();
        let mut buffers = BatchBuffers::new(shape, Autoreset::Disabled);
        batch.reset(None, &mut buffers.observations).map_err(|error| match error {
            BatchError::Scenario { source, .. } => PolicyError::Scenario(source),
            other => PolicyError::Act { name: name.clone(), reason: other.to_string() },
        })?;
        let executed = vec![space.hold; shape.agents * shape.action];
        Ok(Self { name, network, batch, space, buffers, executed, steps: 0 })
    }

    /// Steps the own environment by the network's actions, along the world's axes.
    fn step(&mut self) -> Result<(), String> {
        let actions = self.network.act(&self.buffers.observations)?;
        let output = BatchOutput { executed_actions: &mut self.executed, ..self.buffers.output() };
        self.batch.step(&actions, output).map_err(|error| error.to_string())
    }
}

impl Policy for OnnxEpisode {
    fn act(&mut self, _: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        self.steps += 1;
        let (name, step) = (self.name.clone(), self.steps);
        self.step().map_err(|reason| PolicyError::Act { name, reason: format!("step {step}: {reason}") })?;
        log.push_by_agent(&self.space, &self.executed);
        Ok(())
    }
}
