//! Validation of resets: a scratch environment begins the requested scenarios before any live environment changes.

use std::sync::Arc;

use env_core::batch::{Batch, BatchConfig, BatchError};
use env_core::{Recipe, Seed, TaskSpec};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

use super::NativeBatch;
use super::inputs::read_seed;
use crate::errors::{invalid, rejected, scenario_error};
use crate::scenario::NativeScenario;
use crate::scenario_sequence::{ResetRequest, ScenarioSequence, ScenarioSequences, SequenceFeed};

/// New scenario sequence of one environment.
pub(super) struct SequenceUpdate {
    pub(super) slot: usize,
    pub(super) sequence: ScenarioSequence,
}

impl NativeBatch {
    /// Reads the arguments of a reset as one request per environment.
    ///
    /// # Errors
    /// `ValueError` about the field that has a wrong length, seed or task.
    pub(super) fn read_reset_requests(
        &self,
        seeds: &[Option<Bound<'_, PyAny>>],
        recipes: Option<Vec<Option<NativeScenario>>>,
        scenarios: Option<Vec<Option<NativeScenario>>>,
    ) -> PyResult<Vec<ResetRequest>> {
        let envs = self.shape.envs;
        let (recipes, scenarios) = (recipes.unwrap_or_default(), scenarios.unwrap_or_default());
        let mut requests = vec![ResetRequest::default(); envs];
        for (field, len) in
            [("seed", seeds.len()), ("options", recipes.len()), ("options.scenario", scenarios.len())]
        {
            if len != 0 && len != envs {
                return Err(invalid(
                    field,
                    format!("a list of one item per environment ({envs})"),
                    format!("{len} items"),
                ));
            }
        }
        for (request, seed) in requests.iter_mut().zip(seeds) {
            request.seed = seed.as_ref().map(read_seed).transpose()?;
        }
        for (request, recipe) in requests.iter_mut().zip(recipes) {
            recipe.iter().try_for_each(|recipe| self.check_task(recipe))?;
            request.recipe = recipe.map(|NativeScenario(recipe)| Arc::clone(recipe.recipe()));
        }
        for (request, scenario) in requests.iter_mut().zip(scenarios) {
            scenario.iter().try_for_each(|scenario| self.check_task(scenario))?;
            request.once = scenario.map(|NativeScenario(scenario)| scenario);
            if let Some(once) = &request.once {
                Seed::user(once.seed().get()).map_err(|error| scenario_error(&error))?;
            }
        }
        Ok(requests)
    }

    /// Returns the sequences after these requests, once a scratch environment has begun every new scenario.
    ///
    /// # Errors
    /// `ValueError` if a scenario has no fair start or more agents than the environments have room for.
    pub(super) fn validate_reset(
        &self,
        requests: Vec<ResetRequest>,
        mask: Option<&[bool]>,
    ) -> PyResult<Vec<SequenceUpdate>> {
        let mut scratch = None;
        let mut updates = Vec::new();
        for (slot, request) in requests.into_iter().enumerate() {
            if request.is_empty() || mask.is_some_and(|mask| !mask[slot]) {
                continue;
            }
            let sequence = request.apply(&self.sequences.get(slot));
            if request.recipe.is_some() || request.once.is_some() {
                let scratch = match &mut scratch {
                    Some(scratch) => scratch,
                    empty => empty.insert(ScratchEnv::new(self.task, &self.recipe, self.config)?),
                };
                scratch.begin(slot, sequence.clone(), &request)?;
            }
            updates.push(SequenceUpdate { slot, sequence });
        }
        Ok(updates)
    }

    /// Checks that a caller may choose this scenario: it is of the batch's task, and no curriculum chooses scenarios.
    fn check_task(&self, NativeScenario(scenario): &NativeScenario) -> PyResult<()> {
        if self.curriculum.is_some() {
            return Err(PyValueError::new_err(
                "`options` must be omitted with a curriculum, which chooses the scenarios",
            ));
        }
        let (task, expected) = (scenario.task().id(), self.task.id());
        if task == expected {
            Ok(())
        } else {
            Err(invalid("scenario", format!("of the task {expected}"), task))
        }
    }
}

/// One environment that begins scenarios on behalf of the live ones.
struct ScratchEnv {
    sequences: Arc<ScenarioSequences>,
    batch: Box<dyn Batch>,
    observation: Vec<f32>,
}

impl ScratchEnv {
    fn new(task: &'static dyn TaskSpec, recipe: &Arc<Recipe>, config: BatchConfig) -> PyResult<Self> {
        let sequences = ScenarioSequences::new(1, Arc::clone(recipe), 0);
        let feed = Box::new(SequenceFeed(Arc::clone(&sequences)));
        let batch = task.batch(feed, BatchConfig { envs: 1, ..config });
        let batch = batch.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let observation = vec![0.0; batch.shape().observation];
        Ok(Self { sequences, batch, observation })
    }

    /// Begins the next scenario of a sequence on behalf of environment `slot`.
    fn begin(&mut self, slot: usize, sequence: ScenarioSequence, request: &ResetRequest) -> PyResult<()> {
        self.sequences.set(0, sequence);
        self.batch.reset(None, &mut self.observation).map_err(|error| match error {
            BatchError::Scenario { source, .. } => {
                let limits =
                    "choose a fair start with at most the agents that the environments were made with";
                rejected("options", format!("{source}; {limits} (environment {slot})"))
            }
            other => PyValueError::new_err(other.to_string()),
        })?;
        let begun = self.batch.running_episode(0).map(|episode| episode.scenario);
        if request.once.as_ref().is_some_and(|once| begun.as_ref() != Some(once)) {
            return Err(rejected(
                "options.scenario",
                "it has no fair start; choose another seed or other params",
            ));
        }
        Ok(())
    }

    /// Bytes of one such environment, with its observation and its final observation.
    fn bytes(&mut self) -> usize {
        // The first reset reports an unfair start.
        let _ = self.batch.reset(None, &mut self.observation);
        self.batch.bytes_per_env() + 2 * size_of_val(self.observation.as_slice())
    }
}

/// Number of environments from which on memory is checked.
const MIN_CHECKED_ENVS: usize = 4096;

/// Checks that there is memory for the environments, so that the process gets an exception and is not killed.
///
/// # Errors
/// `MemoryError` with the memory that the environments need.
pub(super) fn check_memory(
    task: &'static dyn TaskSpec,
    recipe: &Arc<Recipe>,
    config: BatchConfig,
) -> PyResult<()> {
    if config.envs < MIN_CHECKED_ENVS {
        return Ok(());
    }
    let bytes = config.envs.saturating_mul(ScratchEnv::new(task, recipe, config)?.bytes());
    let mut memory = Vec::<u8>::new();
    let reserved = memory.try_reserve_exact(bytes);
    std::hint::black_box(&memory); // an unused reservation could be optimised away
    reserved.map_err(|_| {
        let (envs, gib) = (config.envs, bytes as f64 / f64::from(1 << 30));
        PyMemoryError::new_err(format!(
            "`num_envs` must fit into memory: {envs} environments take {gib:.1} GiB, more than is available"
        ))
    })
}
