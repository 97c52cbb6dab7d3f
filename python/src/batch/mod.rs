//! `NativeBatch`: a batch of environments of one task, with arrays as actions and observations.
//!
//! [`config`] reads the constructor's arguments, [`inputs`] and [`outputs`] convert arrays, and [`reset_request`] validates
//! a reset on a scratch environment before any live environment changes. [`stepping`] resets and steps the state, which
//! `batch_state` defines.

mod config;
mod inputs;
mod lock;
mod outputs;
mod reset_request;
mod step_error;
mod stepping;

use std::sync::{Arc, Mutex, PoisonError};

use env_core::batch::episode_assigner::{AssignedScenarios, EpisodeAssigner};
use env_core::batch::{BatchConfig, BatchShape, MAX_ENVS};
use env_core::space::ActionGrid;
use env_core::{Recipe, TaskSpec};
use numpy::{IxDyn, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use self::lock::{lock_attached, lock_detached};
use self::outputs::{
    AgentArrays, CurriculumArrays, EpisodeArrays, OutArrays, OutputArrays, StepArrays, StepResult, TimeArrays,
};
use self::reset_request::check_memory;
use crate::arrays::{read_mask, writable};
use crate::batch_state::{BatchState, EpisodeStats, StepBuffers};
use crate::curriculum::{CurriculumClient, LeasedEpisode, NativeCurriculum, WaitError};
use crate::errors::{invalid, rejected};
use crate::renderer::ImageSize;
use crate::scenario::{NativeScenario, parse_recipe};
use crate::scenario_sequence::ScenarioSequences;
use crate::step_threads::StepThreads;

/// A batch of environments of one task.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeBatch {
    task: &'static dyn TaskSpec,
    recipe: Arc<Recipe>,
    sequences: Arc<ScenarioSequences>,
    config: BatchConfig,
    step_threads: StepThreads,
    /// Id of the process that made the batch.
    process: u32,
    shape: BatchShape,
    action_shape: Vec<usize>,
    /// Actions that discrete actions choose from; `None` with continuous actions.
    choices: Option<ActionGrid>,
    /// Source of the scenarios, if a curriculum chooses them.
    curriculum: Option<Arc<CurriculumClient>>,
    state: Mutex<BatchState>,
    outputs: Mutex<OutputArrays>,
}

#[pymethods]
impl NativeBatch {
    /// Creates environments.
    ///
    /// `recipe` is a scenario without its seed, as JSON. `observe` is "all", "extended" or "tracks", `axes` is "world" or "agent".
    /// With `discrete`, actions are indices of the task's choices; with `few`, of its few actions. `single` drops the first axis of all arrays except flags.
    #[new]
    #[pyo3(signature = (recipe, envs, *, observe, bodies, threats, look_ahead, axes, discrete, few, autoreset_mode, threads, seed, single, curriculum=None))]
    #[expect(clippy::too_many_arguments, reason = "called in one place, by keywords")]
    fn new(
        py: Python<'_>,
        recipe: &str,
        envs: usize,
        observe: &str,
        bodies: Option<u32>,
        threats: u32,
        look_ahead: u32,
        axes: &str,
        discrete: bool,
        few: bool,
        autoreset_mode: &str,
        threads: Option<usize>,
        seed: u64,
        single: bool,
        curriculum: Option<&NativeCurriculum>,
    ) -> PyResult<Self> {
        if !(1..=MAX_ENVS).contains(&envs) {
            return Err(invalid("num_envs", format!("from 1 to {MAX_ENVS}"), envs));
        }
        let client = curriculum.map(|curriculum| Arc::clone(&curriculum.client));
        let first_scenario = client.as_ref().map(|client| py.detach(|| client.register_envs(envs)));
        let first_scenario = first_scenario.transpose().map_err(WaitError::into_py)?;
        let recipe = match &first_scenario {
            Some(scenario) => Arc::clone(scenario.recipe()),
            None => parse_recipe(recipe)?,
        };
        let task = recipe.task();
        let choices = discrete.then(|| if few { task.few_actions() } else { task.action_grid() });
        let step_threads = StepThreads::new(threads, envs)?;
        let config = BatchConfig {
            envs,
            autoreset: config::parse_autoreset(autoreset_mode)?,
            observe: config::parse_observe(observe, bodies, threats, look_ahead),
            axes: choices.as_ref().map_or_else(|| config::parse_axes(axes), |choices| choices.axes),
            mixed_tasks: client.is_some() && task.agent_axes().is_some(),
            single_threaded: step_threads.is_inline(),
        };
        check_memory(task, &recipe, config)?;
        let sequences = ScenarioSequences::new(envs, Arc::clone(&recipe), seed);
        let assigned = first_scenario.map(|scenario| AssignedScenarios::new(envs, &scenario));
        let batch = config::make_batch(task, config, assigned.as_ref(), &sequences)?;
        let shape = batch.shape();
        let leading_axes = if single { &[][..] } else { &[envs][..] };
        let action_shape = if discrete { vec![shape.agents] } else { vec![shape.agents, shape.action] };
        let hold = task.action_space().hold;
        let assigner = assigned.map(|assigned| EpisodeAssigner::new(assigned, shape, config.autoreset));
        Ok(Self {
            task,
            recipe,
            sequences,
            config,
            step_threads,
            process: std::process::id(),
            shape,
            action_shape: [leading_axes, &action_shape].concat(),
            choices,
            curriculum: client,
            state: Mutex::new(BatchState::new(batch, config.autoreset, hold, assigner)),
            outputs: Mutex::new(OutputArrays::new(leading_axes, shape, config.observe)),
        })
    }

    /// Complete recipe that the environments were made with, as JSON.
    #[getter]
    fn recipe(&self) -> String {
        self.recipe.to_json().to_string()
    }

    /// Number of agents of an environment.
    #[getter]
    const fn num_agents(&self) -> usize {
        self.shape.agents
    }

    /// Number of values of an agent's action.
    #[getter]
    const fn action_size(&self) -> usize {
        self.shape.action
    }

    /// Number of values of an environment's observation.
    #[getter]
    const fn observation_size(&self) -> usize {
        self.shape.observation
    }

    /// Number of threads that step the batch.
    #[getter]
    fn threads(&self) -> usize {
        self.step_threads.count()
    }

    /// Number of steps of all environments so far; those that only began an episode do not count.
    #[getter]
    fn total_steps(&self, py: Python<'_>) -> u64 {
        lock_attached(py, &self.state).total_steps
    }

    /// Returns the names of the values of an observation.
    fn columns(&self, py: Python<'_>) -> Vec<String> {
        lock_attached(py, &self.state).batch.columns()
    }

    /// Begins the next episode of every environment, or of those in `mask`; returns all observations.
    ///
    /// The lists have one item or None per environment: `seeds` restart its scenario sequence, `recipes` replace its
    /// recipe, and `scenarios` are run once before the sequence continues. A rejected reset changes nothing.
    #[pyo3(signature = (seeds=None, mask=None, out=None, recipes=None, scenarios=None) -> "numpy.typing.NDArray[numpy.float32]")]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<Vec<Option<Bound<'py, PyAny>>>>,
        mask: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        recipes: Option<Vec<Option<NativeScenario>>>,
        scenarios: Option<Vec<Option<NativeScenario>>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.check_process()?;
        let mask = mask.map(|mask| read_mask("reset_mask", mask, self.shape.envs)).transpose()?;
        let requests = self.read_reset_requests(&seeds.unwrap_or_default(), recipes, scenarios)?;
        let updates = self.validate_reset(requests, mask.as_deref())?;
        let observations = self.observation_array(py, out)?;
        let shape = lock_attached(py, &self.outputs).observations.shape().to_vec();
        let mut writer = writable::<f32>("out", observations.as_any(), &shape)?;
        let slice = writer.as_slice_mut().map_err(|error| rejected("out", error))?;
        updates.into_iter().for_each(|update| self.sequences.set(update.slot, update.sequence));
        let reset = py.detach(|| self.reset_detached(mask.as_deref(), slice));
        reset.map_err(|error| error.into_py(py))?;
        drop(writer);
        Ok(observations)
    }

    /// Steps every environment, into `out` (observations, rewards, terminations, truncations) if given.
    ///
    /// The actions are repeated for `repeat` steps, or until an environment's episode ends; rewards add up. Returns these four arrays and whether any episode ended.
    #[pyo3(signature = (actions, out=None, repeat=1) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], bool]")]
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        out: Option<OutArrays<'py>>,
        repeat: u32,
    ) -> PyResult<StepResult<'py>> {
        self.check_process()?;
        let mut values = std::mem::take(&mut lock_attached(py, &self.state).actions);
        self.read_actions(actions, &mut values)?;
        let StepArrays { observations, rewards, terminations, truncations } = self.step_arrays(py, out)?;
        let any_ended = {
            let envs = [self.shape.envs];
            let shape = lock_attached(py, &self.outputs).observations.shape().to_vec();
            let mut observation_writer = writable::<f32>("out[0]", observations.as_any(), &shape)?;
            let mut reward_writer = writable::<f64>("out[1]", rewards.as_any(), &envs)?;
            let mut termination_writer = writable::<bool>("out[2]", terminations.as_any(), &envs)?;
            let mut truncation_writer = writable::<bool>("out[3]", truncations.as_any(), &envs)?;
            let mut buffers = StepBuffers {
                observations: observation_writer.as_slice_mut().map_err(|error| rejected("out[0]", error))?,
                rewards: reward_writer.as_slice_mut().map_err(|error| rejected("out[1]", error))?,
                terminations: termination_writer.as_slice_mut().map_err(|error| rejected("out[2]", error))?,
                truncations: truncation_writer.as_slice_mut().map_err(|error| rejected("out[3]", error))?,
            };
            let stepped = py.detach(|| self.step_detached(values, repeat, &mut buffers));
            stepped.map_err(|error| error.into_py(py))?
        };
        Ok((observations, rewards, terminations, truncations, any_ended))
    }

    /// Returns, for the last step: which episodes ended, and their returns, lengths and durations in seconds.
    ///
    /// Environments whose episode did not end have zeros.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64]]")]
    fn finished_episodes<'py>(&self, py: Python<'py>) -> EpisodeArrays<'py> {
        let state = lock_attached(py, &self.state);
        let EpisodeStats { returns, lengths, seconds } = state.finished_episodes();
        (
            PyArray1::from_slice(py, &state.ended),
            PyArray1::from_vec(py, returns),
            PyArray1::from_vec(py, lengths),
            PyArray1::from_vec(py, seconds),
        )
    }

    /// Returns, for the last step: each agent's reward, which agents terminated and which were truncated.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]")]
    fn agent_results<'py>(&self, py: Python<'py>) -> PyResult<AgentArrays<'py>> {
        let state = lock_attached(py, &self.state);
        let shape = [self.shape.envs, self.shape.agents];
        Ok((
            PyArray1::from_slice(py, &state.buffers.rewards).reshape(shape)?,
            PyArray1::from_slice(py, &state.buffers.terminated).reshape(shape)?,
            PyArray1::from_slice(py, &state.buffers.truncated).reshape(shape)?,
        ))
    }

    /// Returns the duration of the last step of each environment, s, and which agents need an action in the next one.
    ///
    /// Durations are 0 after a reset.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_]]")]
    fn step_times<'py>(&self, py: Python<'py>) -> PyResult<TimeArrays<'py>> {
        let state = lock_attached(py, &self.state);
        let durations = state.buffers.elapsed.iter().copied().map(f64::from).collect();
        let shape = [self.shape.envs, self.shape.agents];
        let needs_action = PyArray1::from_slice(py, &state.buffers.needs_action).reshape(shape)?;
        Ok((PyArray1::from_vec(py, durations), needs_action))
    }

    /// Returns which agents take no part in the current episodes.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.bool_]")]
    fn absent_agents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let state = lock_attached(py, &self.state);
        let mut absent = state.buffers.terminated.clone();
        for (env, agents) in absent.chunks_exact_mut(self.shape.agents).enumerate() {
            if state.ended[env] {
                state.batch.mark_absent_agents(env, agents);
            }
        }
        PyArray1::from_vec(py, absent).reshape([self.shape.envs, self.shape.agents])
    }

    /// Returns the last observations of the episodes that ended in the last step, in order of environments.
    ///
    /// They exist only in the autoreset mode "same_step".
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.float32]")]
    fn final_observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let state = lock_attached(py, &self.state);
        let width = self.shape.observation;
        let last = state.buffers.final_observations.chunks_exact(width.max(1));
        let ended = state.ended.iter().zip(last).filter(|(ended, _)| **ended);
        let mut rows = Vec::new();
        ended.for_each(|(_, last)| rows.extend_from_slice(last));
        let shape = lock_attached(py, &self.outputs).observations.shape().to_vec();
        let count = rows.len() / width.max(1);
        PyArray1::from_vec(py, rows).reshape(IxDyn(&[&[count], shape.get(1..).unwrap_or(&[])].concat()))
    }

    /// Returns each agent's action in the last step, along the world's axes.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.float32]")]
    fn last_actions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let BatchShape { envs, agents, action, .. } = self.shape;
        PyArray1::from_slice(py, &lock_attached(py, &self.state).last_actions).reshape([envs, agents, action])
    }

    /// Returns an environment's scenario and its score so far; None before the first reset.
    fn episode(&self, py: Python<'_>, env: usize) -> PyResult<Option<(NativeScenario, f64)>> {
        self.check_env(env)?;
        let episode = lock_attached(py, &self.state).batch.running_episode(env);
        Ok(episode.map(|episode| (NativeScenario(episode.scenario), episode.score)))
    }

    /// Returns, for the current episodes: the level (-1: none), whether to train on the episode, and whether the environment
    /// is idle because no episode is left for it.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]")]
    fn curriculum_info<'py>(&self, py: Python<'py>) -> CurriculumArrays<'py> {
        let state = lock_attached(py, &self.state);
        let running = || state.assigner.iter().flat_map(EpisodeAssigner::running);
        let level = |episode: &LeasedEpisode| episode.level.unwrap_or(-1);
        let levels: Vec<i64> = running().map(|slot| slot.map_or(-1, |slot| level(&slot.id))).collect();
        let train: Vec<bool> = running().map(|slot| slot.is_some_and(|slot| slot.id.train)).collect();
        let idle: Vec<bool> = (0..self.shape.envs).map(|env| state.batch.is_idle(env)).collect();
        (PyArray1::from_vec(py, levels), PyArray1::from_vec(py, train), PyArray1::from_vec(py, idle))
    }

    /// Returns the current episodes to the curriculum and closes the environments.
    fn release(&self, py: Python<'_>) {
        py.detach(|| {
            if let Some(curriculum) = self.curriculum.as_ref().filter(|_| self.is_owner_process())
                && let Some(mut assigner) = lock_detached(&self.state).assigner.take()
            {
                curriculum.unregister_envs(&mut assigner, self.shape.envs);
            }
        });
    }

    /// Abandons the current episodes: the curriculum does not offer them again.
    fn abandon(&self, py: Python<'_>) {
        py.detach(|| {
            if let (Some(curriculum), Some(assigner)) =
                (&self.curriculum, &mut lock_detached(&self.state).assigner)
            {
                curriculum.abandon(assigner);
            }
        });
    }

    /// Returns messages about the last step of an environment.
    fn alerts(&self, py: Python<'_>, env: usize) -> PyResult<Vec<String>> {
        self.check_env(env)?;
        Ok(lock_attached(py, &self.state).batch.alerts(env))
    }

    /// Returns the observation of an environment's agents in the wire form (JSON).
    fn telemetry(&self, py: Python<'_>, env: usize) -> PyResult<Option<String>> {
        self.check_env(env)?;
        Ok(lock_attached(py, &self.state).batch.telemetry(env).map(|value| value.to_string()))
    }

    /// Returns a hash of every bit of an environment's state.
    fn state_hash(&self, py: Python<'_>, env: usize) -> PyResult<Option<Vec<u8>>> {
        self.check_env(env)?;
        Ok(lock_attached(py, &self.state).batch.state_hash(env).map(Vec::from))
    }

    /// Renders an environment as an array of height × width × 3.
    #[pyo3(signature = (env, width, height) -> "numpy.typing.NDArray[numpy.uint8]")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        env: usize,
        width: u32,
        height: u32,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.check_env(env)?;
        let size = ImageSize { width, height };
        let pixels = py.detach(|| lock_detached(&self.state).render(env, self.shape, size));
        let pixels = pixels.ok_or_else(|| rejected("render", "no episode is running: call reset() first"))?;
        PyArray1::from_vec(py, pixels).reshape([height as usize, width as usize, 3])
    }
}

impl Drop for NativeBatch {
    /// Returns the current episodes to the curriculum if the batch was not closed.
    fn drop(&mut self) {
        if !self.is_owner_process() {
            return; // the episodes belong to the parent process
        }
        // No thread that holds the queue waits for the interpreter lock, so this cannot deadlock.
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let (Some(curriculum), Some(mut assigner)) = (&self.curriculum, state.assigner.take()) {
            curriculum.unregister_envs(&mut assigner, self.shape.envs);
        }
    }
}
