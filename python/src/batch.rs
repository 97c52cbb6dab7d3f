//! Many environments, or one, as arrays.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use env_core::batch::{Autoreset, Axes, BatchConfig, MAX_ENVS, Observe, Shape};
use env_core::seed::FREE_MASK;
use env_core::{Recipe, Seed, TaskSpec};
use numpy::{IxDyn, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;

use crate::arrays::{Shelf, copy_f32, read_i64, read_mask, writable};
use crate::errors::{self, invalid};
use crate::feed::{Fed, Rows};
use crate::pool::Pool;
use crate::scenario::NativeScenario;
use crate::state::{Slices, State};

/// What a step gives: observations, rewards, terminations, truncations, and whether any episode ended.
type Stepped<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f64>>,
    Bound<'py, PyArrayDyn<bool>>,
    Bound<'py, PyArrayDyn<bool>>,
    bool,
);
/// Of each environment: whether its episode ended, its return, its length.
type Episodes<'py> = (Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);
/// Of each agent: its reward, whether it has left, whether the horizon cut it off.
type Agents<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>, Bound<'py, PyArray2<bool>>);
/// Arrays of a caller's own for these.
type Given<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Arrays handed out.
struct Shelves {
    observations: Shelf<f32>,
    rewards: Shelf<f64>,
    flags: [Shelf<bool>; 2],
}

/// A batch of environments of one task.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeBatch {
    task: &'static dyn TaskSpec,
    recipe: Arc<Recipe>,
    rows: Arc<Rows>,
    pool: Pool,
    shape: Shape,
    action_shape: Vec<usize>,
    choices: Option<Vec<Vec<f32>>>,
    autoreset: Autoreset,
    state: Mutex<State>,
    shelves: Mutex<Shelves>,
}

/// By a thread that has let the interpreter go.
fn hold<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What a panic left is no more than a batch of which a step was begun; it says itself what it refuses.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// By a thread that has the interpreter, and lets it go while it waits: whoever holds this may be waiting for that.
fn lock<'a, T>(py: Python<'_>, mutex: &'a Mutex<T>) -> MutexGuard<'a, T> {
    mutex.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

fn autoreset(word: &str) -> PyResult<Autoreset> {
    match word {
        "next_step" => Ok(Autoreset::NextStep),
        "same_step" => Ok(Autoreset::SameStep),
        "disabled" => Ok(Autoreset::Disabled),
        _ => Err(invalid("autoreset_mode", format!("{word:?} is none of next_step, same_step, disabled"))),
    }
}

#[pymethods]
impl NativeBatch {
    /// `recipe` is a scenario without its seed, as JSON. `observe` is "all" or "tracks"; `axes` "world" or "agent". With
    /// `discrete` actions are numbers of the task's choices. `single` drops the first axis of all arrays but flags.
    #[new]
    #[pyo3(signature = (recipe, envs, *, observe, bodies, threats, look_ahead, axes, discrete, autoreset_mode, threads, seed, single))]
    #[expect(clippy::too_many_arguments, reason = "one call, from one place, by keywords")]
    fn new(
        recipe: &str,
        envs: usize,
        observe: &str,
        bodies: Option<u32>,
        threats: u32,
        look_ahead: u32,
        axes: &str,
        discrete: bool,
        autoreset_mode: &str,
        threads: Option<usize>,
        seed: u64,
        single: bool,
    ) -> PyResult<Self> {
        if !(1..=MAX_ENVS).contains(&envs) {
            return Err(invalid("num_envs", format!("{envs} is not from 1 to {MAX_ENVS}")));
        }
        let recipe = crate::scenario::recipe(recipe)?;
        let task = recipe.task();
        let observe = match observe {
            "all" => Observe::All { bodies },
            _ => Observe::Tracks { threats, look_ahead },
        };
        let choices = discrete.then(|| task.choices());
        let axes = match (&choices, axes) {
            (Some(choices), _) => choices.axes,
            (None, "agent") => Axes::Agent,
            (None, _) => Axes::World,
        };
        let autoreset = autoreset(autoreset_mode)?;
        let rows = Rows::new(envs, Arc::clone(&recipe), |slot| {
            Seed::in_space(env_core::seed::SeedSpace::User, seed.wrapping_add(slot as u64))
        });
        let pool = Pool::new(threads, envs)?;
        let config = BatchConfig { envs, autoreset, observe, axes, alone: pool.alone() };
        let batch = task.batch(Box::new(Fed(Arc::clone(&rows))), config);
        let batch = batch.map_err(|error| PyValueError::new_err(error.to_string()))?;
        rows.rewind();
        let shape = batch.shape();
        let Shape { agents, action, observation, .. } = shape;
        let leading = if single { vec![] } else { vec![envs] };
        let shaped = |rest: &[usize]| [&leading, rest].concat();
        let action_shape = if discrete { shaped(&[agents]) } else { shaped(&[agents, action]) };
        let observations = match observe {
            Observe::Tracks { .. } => shaped(&[agents, observation / agents]),
            Observe::All { .. } => shaped(&[observation]),
        };
        let state = State::new(batch, autoreset);
        let shelves = Shelves {
            observations: Shelf::new(&observations),
            rewards: Shelf::new(&[envs]),
            flags: [Shelf::new(&[envs]), Shelf::new(&[envs])],
        };
        Ok(Self {
            task,
            recipe,
            rows,
            pool,
            shape,
            action_shape,
            choices: choices.map(|choices| choices.rows),
            autoreset,
            state: Mutex::new(state),
            shelves: Mutex::new(shelves),
        })
    }

    /// The scenario without its seed that was asked for, complete, as JSON.
    #[getter]
    fn recipe(&self) -> String {
        self.recipe.to_json().to_string()
    }

    /// Agents, values of an action, values of an observation.
    #[getter]
    fn sizes(&self) -> (usize, usize, usize) {
        (self.shape.agents, self.shape.action, self.shape.observation)
    }

    /// Threads that step it.
    #[getter]
    fn threads(&self) -> usize {
        self.pool.threads()
    }

    /// What the values of an observation are called.
    fn columns(&self, py: Python<'_>) -> Vec<String> {
        lock(py, &self.state).batch.columns()
    }

    /// Begins the next episode of every environment, or of those in `mask`; `seeds` has a seed or none for each. All observations.
    #[pyo3(signature = (seeds=None, mask=None, out=None) -> "numpy.typing.NDArray[numpy.float32]")]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<Vec<Option<Bound<'py, PyAny>>>>,
        mask: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let envs = self.shape.envs;
        let mask = mask.map(|mask| read_mask("reset_mask", mask, envs)).transpose()?;
        let seeds = seeds.unwrap_or_default();
        if !seeds.is_empty() && seeds.len() != envs {
            return Err(invalid("seed", format!("{} seeds for {envs} environments", seeds.len())));
        }
        let seeds = seeds.iter().map(|seed| seed.as_ref().map(read_seed).transpose());
        let seeds = seeds.collect::<PyResult<Vec<_>>>()?;
        let observations = self.observations(py, out)?;
        let mut written =
            writable::<f32>("out", observations.as_any(), lock(py, &self.shelves).observations.shape())?;
        let slice = written.as_slice_mut().map_err(|error| invalid("out", error))?;
        for (slot, seed) in seeds.into_iter().enumerate() {
            if let Some(seed) = seed.filter(|_| mask.as_ref().is_none_or(|mask| mask[slot])) {
                self.rows.seed(slot, seed);
            }
        }
        let begun = py.detach(|| {
            let state = &mut *hold(&self.state);
            let begun = self.pool.run(|| {
                state.batch.reset(mask.as_deref(), slice)?;
                state.batch.observe(slice)
            });
            state.begin(mask.as_deref(), self.shape);
            begun
        });
        begun.map_err(|error| errors::batch(py, &error))?;
        drop(written);
        Ok(observations)
    }

    /// One step of every environment, into `out` (observations, rewards, terminations, truncations) where it is given.
    #[pyo3(signature = (actions, out=None) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], bool]")]
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        out: Option<Given<'py>>,
    ) -> PyResult<Stepped<'py>> {
        let mut taken = std::mem::take(&mut lock(py, &self.state).actions);
        self.read_actions(actions, &mut taken)?;
        let (observations, rewards, terminations, truncations) = self.arrays(py, out)?;
        let ended = {
            let envs = [self.shape.envs];
            let shape = lock(py, &self.shelves).observations.shape().to_vec();
            let mut observed = writable::<f32>("out[0]", observations.as_any(), &shape)?;
            let mut rewarded = writable::<f64>("out[1]", rewards.as_any(), &envs)?;
            let mut terminated = writable::<bool>("out[2]", terminations.as_any(), &envs)?;
            let mut truncated = writable::<bool>("out[3]", truncations.as_any(), &envs)?;
            let mut slices = Slices {
                observations: observed.as_slice_mut().map_err(|error| invalid("out[0]", error))?,
                rewards: rewarded.as_slice_mut().map_err(|error| invalid("out[1]", error))?,
                terminations: terminated.as_slice_mut().map_err(|error| invalid("out[2]", error))?,
                truncations: truncated.as_slice_mut().map_err(|error| invalid("out[3]", error))?,
            };
            let stepped = py.detach(|| {
                let state = &mut *hold(&self.state);
                let stepped = self.pool.run(|| state.step(&taken, &mut slices, self.shape, self.autoreset));
                state.actions = taken;
                stepped
            });
            stepped.map_err(|error| errors::batch(py, &error))?
        };
        Ok((observations, rewards, terminations, truncations, ended))
    }

    /// Of the last step: whose episode ended, and its return and length, which go on for the others.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64]]")]
    fn episodes<'py>(&self, py: Python<'py>) -> Episodes<'py> {
        let state = lock(py, &self.state);
        (
            PyArray1::from_slice(py, &state.ended),
            PyArray1::from_slice(py, &state.returns),
            PyArray1::from_slice(py, &state.lengths),
        )
    }

    /// Of the last step: what each agent earned, who has left and whom the horizon cut off.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]")]
    fn agents<'py>(&self, py: Python<'py>) -> PyResult<Agents<'py>> {
        let state = lock(py, &self.state);
        let shape = [self.shape.envs, self.shape.agents];
        Ok((
            PyArray1::from_slice(py, &state.buffers.rewards).reshape(shape)?,
            PyArray1::from_slice(py, &state.buffers.terminated).reshape(shape)?,
            PyArray1::from_slice(py, &state.buffers.truncated).reshape(shape)?,
        ))
    }

    /// Of the last step, where the same step resets: the last observations of the environments whose episode ended, in order.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.float32]")]
    fn final_observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let state = lock(py, &self.state);
        let width = self.shape.observation;
        let ended = state.ended.iter().enumerate().filter(|(_, ended)| **ended).map(|(env, _)| env);
        let rows: Vec<f32> = ended
            .flat_map(|env| {
                state.buffers.final_observations.get(env * width..(env + 1) * width).unwrap_or(&[])
            })
            .copied()
            .collect();
        let shape = lock(py, &self.shelves).observations.shape().to_vec();
        let count = rows.len() / width.max(1);
        PyArray1::from_vec(py, rows).reshape(IxDyn(&[&[count], shape.get(1..).unwrap_or(&[])].concat()))
    }

    /// What each agent did in the last step, along the world's axes.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.float32]")]
    fn taken<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let Shape { envs, agents, action, .. } = self.shape;
        PyArray1::from_slice(py, &lock(py, &self.state).taken).reshape([envs, agents, action])
    }

    /// The scenario an environment flies, and its score so far; none before the first reset.
    fn episode(&self, py: Python<'_>, env: usize) -> PyResult<Option<(NativeScenario, f64)>> {
        self.known(env)?;
        let episode = lock(py, &self.state).batch.episode(env);
        Ok(episode.map(|(scenario, score)| (NativeScenario(scenario), score)))
    }

    /// Has an environment fly this scenario next and its recipe from then on, or again what all fly.
    fn set_scenario(&self, env: usize, scenario: Option<&NativeScenario>) -> PyResult<()> {
        self.known(env)?;
        let Some(scenario) = scenario else {
            self.rows.set(env, None);
            return Ok(());
        };
        self.of_task(scenario)?;
        let NativeScenario(scenario) = scenario;
        Seed::user(scenario.seed().get()).map_err(|error| errors::scenario(&error))?;
        self.rows.set(env, Some(scenario.recipe()));
        self.rows.seed(env, scenario.seed());
        Ok(())
    }

    /// Has an environment fly this scenario's recipe from its next episode on, by seeds of its own.
    fn set_recipe(&self, env: usize, scenario: &NativeScenario) -> PyResult<()> {
        self.known(env)?;
        self.of_task(scenario)?;
        self.rows.set(env, Some(scenario.0.recipe()));
        Ok(())
    }

    /// What happened in the last step of an environment, in words.
    fn alerts(&self, py: Python<'_>, env: usize) -> PyResult<Vec<String>> {
        self.known(env)?;
        Ok(lock(py, &self.state).batch.alerts(env))
    }

    /// What the agents of an environment see, in the wire form, as JSON.
    fn telemetry(&self, py: Python<'_>, env: usize) -> PyResult<Option<String>> {
        self.known(env)?;
        Ok(lock(py, &self.state).batch.telemetry(env).map(|value| value.to_string()))
    }

    /// A digest of every bit of an environment's state.
    fn state_hash(&self, py: Python<'_>, env: usize) -> PyResult<Option<Vec<u8>>> {
        self.known(env)?;
        Ok(lock(py, &self.state).batch.state_hash(env).map(Vec::from))
    }

    /// A picture of an environment, height × width × 3.
    #[pyo3(signature = (env, width, height) -> "numpy.typing.NDArray[numpy.uint8]")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        env: usize,
        width: u32,
        height: u32,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.known(env)?;
        let pixels = py.detach(|| hold(&self.state).draw(env, self.shape, (width, height)));
        let pixels = pixels.ok_or_else(|| invalid("render", "nothing flies yet: reset first"))?;
        PyArray1::from_vec(py, pixels).reshape([height as usize, width as usize, 3])
    }
}

/// A seed that callers may choose.
fn read_seed(seed: &Bound<'_, PyAny>) -> PyResult<Seed> {
    let wanted = || invalid("seed", format!("{seed} is not {}", env_core::SEED_WANTED));
    let value: u64 = seed.extract().map_err(|_| wanted())?;
    if value > FREE_MASK { Err(wanted()) } else { Seed::user(value).map_err(|_| wanted()) }
}

impl NativeBatch {
    fn known(&self, env: usize) -> PyResult<()> {
        let envs = self.shape.envs;
        if env < envs { Ok(()) } else { Err(invalid("env", format!("{env} of {envs}"))) }
    }

    fn of_task(&self, NativeScenario(scenario): &NativeScenario) -> PyResult<()> {
        let (task, mine) = (scenario.task().id(), self.task.id());
        if task == mine { Ok(()) } else { Err(invalid("scenario", format!("one of {task}, not of {mine}"))) }
    }

    fn read_actions(&self, given: &Bound<'_, PyAny>, into: &mut Vec<f32>) -> PyResult<()> {
        let Some(choices) = &self.choices else {
            return copy_f32("actions", given, &self.action_shape, into);
        };
        into.clear();
        for choice in read_i64("actions", given, &self.action_shape)? {
            let row = usize::try_from(choice).ok().and_then(|choice| choices.get(choice));
            let wrong = || invalid("actions", format!("{choice} is not from 0 to {}", choices.len() - 1));
            into.extend_from_slice(row.ok_or_else(wrong)?);
        }
        Ok(())
    }

    /// The caller's array for observations, or one of ours.
    fn observations<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        match out {
            Some(out) => Ok(out.cast::<PyArrayDyn<f32>>().map_err(|_| not_of("out", "float32"))?.clone()),
            None => Ok(lock(py, &self.shelves).observations.take(py)),
        }
    }

    #[expect(clippy::type_complexity, reason = "the four arrays of a step")]
    fn arrays<'py>(
        &self,
        py: Python<'py>,
        out: Option<Given<'py>>,
    ) -> PyResult<(
        Bound<'py, PyArrayDyn<f32>>,
        Bound<'py, PyArrayDyn<f64>>,
        Bound<'py, PyArrayDyn<bool>>,
        Bound<'py, PyArrayDyn<bool>>,
    )> {
        let Some((observations, rewards, terminations, truncations)) = out else {
            let shelves = &mut *lock(py, &self.shelves);
            let [terminations, truncations] = &mut shelves.flags;
            return Ok((
                shelves.observations.take(py),
                shelves.rewards.take(py),
                terminations.take(py),
                truncations.take(py),
            ));
        };
        Ok((
            observations.cast_into().map_err(|_| not_of("out[0]", "float32"))?,
            rewards.cast_into().map_err(|_| not_of("out[1]", "float64"))?,
            terminations.cast_into().map_err(|_| not_of("out[2]", "bool"))?,
            truncations.cast_into().map_err(|_| not_of("out[3]", "bool"))?,
        ))
    }
}

fn not_of(field: &str, dtype: &str) -> PyErr {
    invalid(field, format!("not a numpy array of dtype {dtype}"))
}
