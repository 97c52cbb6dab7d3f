//! Many environments, or one, as arrays.

mod parts;
mod wishes;

use std::sync::{Arc, Mutex};

use env_core::batch::book::{Assigned, Book};
use env_core::batch::{Autoreset, Axes, BatchConfig, Feed, MAX_ENVS, Observe, Shape};
use env_core::{Recipe, Seed, TaskSpec};
use numpy::{IxDyn, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub(crate) use self::parts::Wrong;
use self::parts::{Agents, Episodes, Given, Lessons, Shelves, Stepped, autoreset, hold, lock};
use self::wishes::fits;
use crate::arrays::{read_mask, writable};
use crate::curriculum::{Desk, Episode, NativeCurriculum, Stop};
use crate::errors::invalid;
use crate::feed::{Fed, Rows};
use crate::pool::Pool;
use crate::scenario::NativeScenario;
use crate::state::{Ended, Slices, State};

/// A batch of environments of one task.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeBatch {
    task: &'static dyn TaskSpec,
    recipe: Arc<Recipe>,
    rows: Arc<Rows>,
    config: BatchConfig,
    pool: Pool,
    /// The process it was made in.
    process: u32,
    shape: Shape,
    action_shape: Vec<usize>,
    choices: Option<Vec<Vec<f32>>>,
    autoreset: Autoreset,
    /// Who says what is flown, where it is a curriculum.
    desk: Option<Arc<Desk>>,
    state: Mutex<State>,
    shelves: Mutex<Shelves>,
}

#[pymethods]
impl NativeBatch {
    /// `recipe` is a scenario without its seed, as JSON. `observe` is "all" or "tracks"; `axes` "world" or "agent". With
    /// `discrete` actions are numbers of the task's choices. `single` drops the first axis of all arrays but flags.
    #[new]
    #[pyo3(signature = (recipe, envs, *, observe, bodies, threats, look_ahead, axes, discrete, autoreset_mode, threads, seed, single, curriculum=None))]
    #[expect(clippy::too_many_arguments, reason = "one call, from one place, by keywords")]
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
        autoreset_mode: &str,
        threads: Option<usize>,
        seed: u64,
        single: bool,
        curriculum: Option<&NativeCurriculum>,
    ) -> PyResult<Self> {
        if !(1..=MAX_ENVS).contains(&envs) {
            return Err(invalid("num_envs", format!("{envs} is not from 1 to {MAX_ENVS}")));
        }
        let first = curriculum.map(|of| py.detach(|| of.desk.join(envs)).map_err(Stop::error)).transpose()?;
        let assigned = first.as_ref().map(|first| Assigned::new(envs, first));
        let recipe = match &first {
            Some(first) => Arc::clone(first.recipe()),
            None => crate::scenario::recipe(recipe)?,
        };
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
        let mixed = curriculum.is_some() && task.agent_axes().is_some();
        let config = BatchConfig { envs, autoreset, observe, axes, mixed, alone: pool.alone() };
        fits(task, &recipe, config)?;
        let feed: Box<dyn Feed> = match &assigned {
            Some(assigned) => Box::new(assigned.clone()),
            None => Box::new(Fed(Arc::clone(&rows))),
        };
        let batch = task.batch(feed, config);
        let batch = batch.map_err(|error| PyValueError::new_err(error.to_string()))?;
        rows.rewind();
        let shape = batch.shape();
        let Shape { agents, action, .. } = shape;
        let lead = if single { &[][..] } else { &[envs][..] };
        let action_shape = if discrete { vec![agents] } else { vec![agents, action] };
        let book = assigned.map(|assigned| Book::new(assigned, shape, autoreset));
        let state = State::new(batch, autoreset, book);
        Ok(Self {
            task,
            recipe,
            rows,
            config,
            pool,
            process: std::process::id(),
            shape,
            action_shape: [lead, &action_shape].concat(),
            choices: choices.map(|choices| choices.rows),
            autoreset,
            desk: curriculum.map(|curriculum| Arc::clone(&curriculum.desk)),
            state: Mutex::new(state),
            shelves: Mutex::new(Shelves::new(lead, shape, observe)),
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

    /// Begins the next episode of every environment, or of those in `mask`; `seeds` has a seed or none for each, `recipes` what it
    /// flies from here on, by seeds of its own, and `scenarios` what it flies first. All observations. What is refused moves nothing.
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
        self.here()?;
        let envs = self.shape.envs;
        let mask = mask.map(|mask| read_mask("reset_mask", mask, envs)).transpose()?;
        let wishes = self.wishes(&seeds.unwrap_or_default(), recipes, scenarios)?;
        let rows = self.wished(wishes, mask.as_deref())?;
        let observations = self.observations(py, out)?;
        let mut written =
            writable::<f32>("out", observations.as_any(), lock(py, &self.shelves).observations.shape())?;
        let slice = written.as_slice_mut().map_err(|error| invalid("out", error))?;
        rows.into_iter().for_each(|(slot, row)| self.rows.put(slot, row));
        let begun = py.detach(|| {
            let state = &mut *hold(&self.state);
            if let Some(desk) = &self.desk {
                // Where nothing can be assigned nothing has moved: what is being flown goes on.
                desk.assign(state.book()?, Some(mask.as_deref())).map_err(Wrong::Curriculum)?;
                desk.give_up(state.book()?, mask.as_deref());
            }
            let begun = self.pool.run(|| {
                state.batch.reset(mask.as_deref(), slice)?;
                state.batch.observe(slice)
            });
            if let Some(book) = &mut state.book {
                book.began(mask.as_deref());
            }
            state.begin(mask.as_deref(), self.shape);
            begun.map_err(Wrong::Batch)
        });
        begun.map_err(|wrong| wrong.error(py))?;
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
        self.here()?;
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
                if let Some(desk) = &self.desk {
                    desk.assign(state.book()?, None).map_err(Wrong::Curriculum)?;
                }
                let stepped = self.pool.run(|| state.step(&taken, &mut slices, self.shape, self.autoreset));
                state.actions = taken;
                if let (Ok(_), Some(desk), Some(book)) = (&stepped, &self.desk, &mut state.book) {
                    book.stepped(&state.taken, &state.buffers.team_rewards, &state.buffers.done);
                    desk.finish(book);
                }
                stepped.map_err(Wrong::Batch)
            });
            stepped.map_err(|wrong| wrong.error(py))?
        };
        Ok((observations, rewards, terminations, truncations, ended))
    }

    /// Of the last step: whose episode ended, and its return, its length and how many seconds it took; zeros for the others.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64]]")]
    fn episodes<'py>(&self, py: Python<'py>) -> Episodes<'py> {
        let state = lock(py, &self.state);
        let Ended { returns, lengths, seconds } = state.of_ended();
        (
            PyArray1::from_slice(py, &state.ended),
            PyArray1::from_vec(py, returns),
            PyArray1::from_vec(py, lengths),
            PyArray1::from_vec(py, seconds),
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

    /// Who takes no part in what is flown now.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.bool_]")]
    fn absent<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let state = lock(py, &self.state);
        let mut absent = state.buffers.terminated.clone();
        for (env, agents) in absent.chunks_exact_mut(self.shape.agents).enumerate() {
            if state.ended[env] {
                state.batch.absent(env, agents);
            }
        }
        PyArray1::from_vec(py, absent).reshape([self.shape.envs, self.shape.agents])
    }

    /// Of the last step, where the same step resets: the last observations of the environments whose episode ended, in order.
    #[pyo3(signature = () -> "numpy.typing.NDArray[numpy.float32]")]
    fn final_observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let state = lock(py, &self.state);
        let width = self.shape.observation;
        let last = state.buffers.final_observations.chunks_exact(width.max(1));
        let ended = state.ended.iter().zip(last).filter(|(ended, _)| **ended);
        let mut rows = Vec::new();
        ended.for_each(|(_, last)| rows.extend_from_slice(last));
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

    /// Of each environment: the level of what it flies (-1: none), whether to learn from it, and whether it rests, since a
    /// curriculum has nothing left for it.
    #[pyo3(signature = () -> "tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]")]
    fn lessons<'py>(&self, py: Python<'py>) -> Lessons<'py> {
        let state = lock(py, &self.state);
        let flying = || state.book.iter().flat_map(Book::flying);
        let of = |episode: &Episode| episode.level.unwrap_or(-1);
        let levels: Vec<i64> = flying().map(|flown| flown.map_or(-1, |flown| of(&flown.name))).collect();
        let train: Vec<bool> = flying().map(|flown| flown.is_some_and(|flown| flown.name.train)).collect();
        let rests: Vec<bool> = (0..self.shape.envs).map(|env| state.batch.rests(env)).collect();
        (PyArray1::from_vec(py, levels), PyArray1::from_vec(py, train), PyArray1::from_vec(py, rests))
    }

    /// Gives back to the curriculum what is being flown.
    fn leave(&self, py: Python<'_>) {
        py.detach(|| {
            if let Some(desk) = self.desk.as_ref().filter(|_| self.is_here())
                && let Some(mut book) = hold(&self.state).book.take()
            {
                desk.leave(&mut book, self.shape.envs);
            }
        });
    }

    /// Gives up for good what is being flown: the curriculum has nobody else fly it to its end.
    fn abandon(&self, py: Python<'_>) {
        py.detach(|| {
            if let (Some(desk), Some(book)) = (&self.desk, &mut hold(&self.state).book) {
                desk.abandon(book);
            }
        });
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
