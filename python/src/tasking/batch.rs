//! Episodes that Python composes, stepped side by side.

use env_core::tasking::simulation::{AgentAction, StepResult, TaskingSim, step_all};
use env_core::tasking::tick::dispatch::InstructionSet;
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

use super::episode::read_setup_text;
use crate::arrays::{read_i64, read_mask};
use crate::errors::{invalid, rejected};
use crate::step_threads::StepThreads;

/// Action that lets a satellite go on.
const GO_ON: i64 = -1;
/// Episodes that a thread steps side by side: enough to keep the lanes of a block busy although steps differ in duration.
const CHUNK: usize = 64;

/// An episode and the result of its last step.
#[derive(Debug)]
struct Slot {
    sim: TaskingSim,
    result: StepResult,
}

/// Results of a step: rewards, terminations, truncations and durations (s), one of each episode.
type StepColumns<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
);

/// Episodes of satellite tasking as BSK-RL simulates them, each with as many satellites.
#[pyclass(module = "sparring._native")]
pub(crate) struct NativeTaskingBatch {
    slots: Vec<Option<Slot>>,
    satellites: usize,
    threads: StepThreads,
    set: InstructionSet,
}

#[pymethods]
impl NativeTaskingBatch {
    /// Creates a batch without episodes. It steps them on a number of threads, by default one per core.
    #[new]
    #[pyo3(signature = (num_envs, satellites, threads=None))]
    fn new(num_envs: usize, satellites: usize, threads: Option<usize>) -> PyResult<Self> {
        let threads = StepThreads::new(threads, num_envs)?;
        let slots = (0..num_envs).map(|_| None).collect();
        Ok(Self { slots, satellites, threads, set: InstructionSet::detect() })
    }

    /// Number of threads that step the episodes.
    #[getter]
    fn threads(&self) -> usize {
        self.threads.count()
    }

    /// Starts the episode of an environment for each set-up, JSON in the format of the recordings of BSK-RL.
    fn start(&mut self, py: Python<'_>, envs: Vec<usize>, setups: Vec<String>) -> PyResult<()> {
        let count = self.slots.len();
        if let Some(env) = envs.iter().find(|env| **env >= count) {
            return Err(invalid("envs", format!("less than {count}"), env));
        }
        let (threads, satellites) = (&self.threads, self.satellites);
        let start =
            |setup: String| TaskingSim::new(read_setup_text(&setup)?).map_err(|error| error.to_string());
        let started: Result<Vec<_>, String> =
            py.detach(|| threads.run(|| setups.into_par_iter().map(start).collect()));
        let started = started.map_err(PyValueError::new_err)?;
        if let Some(sim) = started.iter().find(|sim| sim.len() != satellites) {
            return Err(invalid("setups", format!("of {satellites} satellites"), sim.len()));
        }
        for (env, sim) in envs.into_iter().zip(started) {
            self.slots[env] = Some(Slot { sim, result: StepResult::default() });
        }
        Ok(())
    }

    /// Runs a step of the environments in a mask. `actions` are envs × satellites; -1 lets a satellite go on.
    ///
    /// Returns rewards with penalties, terminations, truncations and durations (s). They are zero for other environments.
    #[pyo3(signature = (actions: "numpy.typing.NDArray[numpy.integer]", active: "numpy.typing.NDArray[numpy.bool_]") -> "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64]]")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        active: &Bound<'py, PyAny>,
    ) -> PyResult<StepColumns<'py>> {
        let actions = self.read_actions(actions)?;
        let active = read_mask("active", active, self.slots.len())?;
        let mut running = Vec::with_capacity(self.slots.len());
        for ((slot, is_active), actions) in self.slots.iter_mut().zip(&active).zip(actions) {
            match slot {
                Some(slot) if *is_active => running.push((slot, actions)),
                None if *is_active => {
                    return Err(PyValueError::new_err("an environment has no episode; reset it"));
                }
                _ => {}
            }
        }
        let (threads, set) = (&self.threads, self.set);
        py.detach(|| {
            let step = |chunk: &mut [(&mut Slot, Vec<Option<AgentAction>>)]| step_chunk(chunk, set);
            if threads.is_inline() {
                running.chunks_mut(CHUNK).try_for_each(step)
            } else {
                threads.run(|| running.par_chunks_mut(CHUNK.min(8)).try_for_each(step))
            }
        })
        .map_err(PyValueError::new_err)?;
        Ok(self.columns(py, &active))
    }

    /// Returns which satellites need an action, envs × satellites.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.bool_]")]
    fn needs_action<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let needs = |slot: &Option<Slot>| -> Vec<bool> {
            let sim = slot.as_ref().map(|slot| &slot.sim);
            (0..self.satellites).map(|index| sim.is_some_and(|sim| sim.needs_action(index))).collect()
        };
        let rows: Vec<Vec<bool>> = self.slots.iter().map(needs).collect();
        PyArray2::from_vec2(py, &rows).map_err(|error| rejected("environments", error))
    }

    /// Returns the observations of a satellite in some environments, envs × values.
    #[pyo3(signature = (satellite, envs) -> "numpy.typing.NDArray[numpy.float64]")]
    fn observe<'py>(
        &mut self,
        py: Python<'py>,
        satellite: usize,
        envs: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        if satellite >= self.satellites {
            return Err(invalid("satellite", format!("less than {}", self.satellites), satellite));
        }
        let mut rows = Vec::with_capacity(envs.len());
        for env in envs {
            let Some(Some(slot)) = self.slots.get_mut(env) else {
                return Err(PyValueError::new_err("an environment has no episode; reset it"));
            };
            let mut values = Vec::new();
            slot.sim
                .observe(satellite, &mut values)
                .map_err(|error| PyValueError::new_err(error.to_string()))?;
            rows.push(values);
        }
        PyArray2::from_vec2(py, &rows).map_err(|error| rejected("environments", error))
    }
}

impl NativeTaskingBatch {
    /// Reads the actions of all environments.
    ///
    /// # Errors
    /// `ValueError` if they are not integers of this shape, or one is neither -1 nor the index of an action.
    fn read_actions(&self, actions: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<Option<AgentAction>>>> {
        let values = read_i64("actions", actions, &[self.slots.len(), self.satellites])?;
        let rows = self.slots.iter().zip(values.chunks(self.satellites.max(1)));
        rows.map(|(slot, row)| {
            row.iter().enumerate().map(|(index, value)| read_action(slot, index, *value)).collect()
        })
        .collect()
    }

    /// Collects the results of the last step.
    fn columns<'py>(&self, py: Python<'py>, active: &[bool]) -> StepColumns<'py> {
        let envs = self.slots.len();
        let (mut rewards, mut durations) = (vec![0.0; envs], vec![0.0; envs]);
        let (mut terminations, mut truncations) = (vec![false; envs], vec![false; envs]);
        for (env, slot) in self.slots.iter().enumerate() {
            let Some(Slot { result, .. }) = slot.as_ref().filter(|_| active[env]) else { continue };
            rewards[env] = result.rewards.iter().sum::<f64>() + result.penalties.iter().sum::<f64>();
            durations[env] = result.elapsed_s;
            terminations[env] = result.terminated.contains(&true);
            truncations[env] = result.truncated;
        }
        (
            rewards.to_pyarray(py),
            terminations.to_pyarray(py),
            truncations.to_pyarray(py),
            durations.to_pyarray(py),
        )
    }
}

/// Reads the action of a satellite in an environment.
///
/// # Errors
/// `ValueError` if it is neither -1 nor the index of an action.
fn read_action(slot: &Option<Slot>, satellite: usize, value: i64) -> PyResult<Option<AgentAction>> {
    if value == GO_ON {
        return Ok(None);
    }
    let actions = slot.as_ref().map_or(usize::MAX, |slot| slot.sim.action_count(satellite));
    match usize::try_from(value) {
        Ok(index) if index < actions => Ok(Some(AgentAction::Index(index))),
        _ => Err(invalid("actions", format!("from -1 to {}", actions - 1), value)),
    }
}

/// Steps some episodes side by side.
fn step_chunk(
    chunk: &mut [(&mut Slot, Vec<Option<AgentAction>>)],
    set: InstructionSet,
) -> Result<(), String> {
    let mut actions = Vec::with_capacity(chunk.len());
    let (mut sims, mut results) = (Vec::with_capacity(chunk.len()), Vec::with_capacity(chunk.len()));
    for (slot, given) in chunk {
        actions.push(std::mem::take(given));
        sims.push(&mut slot.sim);
        results.push(&mut slot.result);
    }
    for (result, stepped) in results.into_iter().zip(step_all(&mut sims, &actions, set)) {
        *result = stepped.map_err(|error| error.to_string())?;
    }
    Ok(())
}
