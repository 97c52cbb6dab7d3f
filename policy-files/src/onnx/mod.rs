//! Neural networks in the ONNX format, evaluated by tract.
//!
//! A model maps the observations of a vector environment to actions. `settings` reads which observations and actions a file
//! declares, `network` prepares and runs it, and `episode` steps the environment that writes its observations. Start reading at
//! [`OnnxPolicy`].

mod episode;
mod network;
mod settings;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::panic::AssertUnwindSafe;
use std::sync::{Arc, Mutex, PoisonError};

use env_core::policy::{Policy, PolicyError};
use env_core::policy_factory::PolicyFactory;
use env_core::{Recipe, Scenario, Seed, TaskSpec};
use tract_onnx::prelude::*;

use self::episode::OnnxEpisode;
use self::network::Network;
use self::settings::ModelSettings;

/// Factory of the policies of an ONNX model.
///
/// docs/guides/export-onnx.md describes the inputs, outputs and metadata of the file.
pub struct OnnxPolicy {
    name: String,
    settings: ModelSettings,
    model: InferenceModel,
    /// Networks by the sizes of their observations, which depend on task and scenario.
    networks: Mutex<HashMap<NetworkKey, Arc<Network>>>,
}

/// Sizes and actions of the environment that a network is prepared for.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct NetworkKey {
    task: &'static str,
    parts: Vec<(&'static str, Vec<usize>)>,
    agents: usize,
}

impl std::fmt::Debug for OnnxPolicy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxPolicy").field("name", &self.name).field("settings", &self.settings).finish()
    }
}

impl OnnxPolicy {
    /// Parses a model.
    ///
    /// # Errors
    /// Returns a reason if the bytes are not an ONNX model or its metadata are invalid.
    pub fn parse(name: String, bytes: &[u8]) -> Result<Self, String> {
        let model = catch(|| tract_onnx::onnx().model_for_read(&mut &*bytes))?;
        let settings = ModelSettings::read(&model)?;
        Ok(Self { name, settings, model, networks: Mutex::default() })
    }

    /// Starts the episode of a scenario.
    fn start(&self, scenario: &Scenario) -> Result<OnnxEpisode, PolicyError> {
        let task = scenario.task();
        self.settings.check_task(task).map_err(|reason| self.unfit(task, reason))?;
        let create = |discrete| episode::create_batch(scenario, &self.settings, discrete);
        let unfit = |error: env_core::batch::BatchError| self.unfit(task, error.to_string());
        // The network decides whether its actions are discrete, which decides the axes of the environment's actions.
        let batch = create(false).map_err(unfit)?;
        let parts = batch.parts();
        let key = NetworkKey {
            task: task.id(),
            parts: parts.iter().map(|part| (part.name, part.shape.clone())).collect(),
            agents: batch.shape().agents,
        };
        let known = self.lock().get(&key).cloned();
        let network = match known {
            Some(network) => network,
            None => {
                let network = catch(|| {
                    Ok(Network::prepare(&self.model, &self.settings.grid(task), &parts, batch.shape()))
                });
                let network = Arc::new(network.flatten().map_err(|reason| self.unfit(task, reason))?);
                self.lock().insert(key, Arc::clone(&network));
                network
            }
        };
        let batch = if network.is_discrete() { create(true).map_err(unfit)? } else { batch };
        OnnxEpisode::start(self.name.clone(), network, batch, task.action_space())
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<NetworkKey, Arc<Network>>> {
        self.networks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn unfit(&self, task: &'static dyn TaskSpec, reason: String) -> PolicyError {
        PolicyError::Task { name: self.name.clone(), task: task.id(), reason }
    }
}

impl PolicyFactory for OnnxPolicy {
    fn name(&self) -> &str {
        &self.name
    }

    fn check(&self, task: &'static dyn TaskSpec) -> Result<(), PolicyError> {
        let scenario = Scenario::new(Recipe::new(task)?, Seed::user(0)?);
        self.start(&scenario).map(|_| ())
    }

    fn is_stochastic(&self, _: &dyn TaskSpec) -> bool {
        false
    }

    fn create(&self, scenario: &Scenario, _: u64) -> Result<Box<dyn Policy>, PolicyError> {
        Ok(Box::new(self.start(scenario)?))
    }
}

/// Calls tract, which panics on some malformed models.
fn catch<T>(call: impl FnOnce() -> TractResult<T>) -> Result<T, String> {
    match std::panic::catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(format!("{error:#}")),
        Err(_) => Err("the model is malformed".to_owned()),
    }
}
