//! What the methods of a batch are made of.

use std::sync::{Mutex, MutexGuard, PoisonError};

use env_core::Seed;
use env_core::batch::{Autoreset, BatchError, Observe, Shape};
use env_core::seed::FREE_MASK;
use numpy::{PyArray1, PyArray2, PyArrayDyn};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;

use super::NativeBatch;
use crate::arrays::{Shelf, copy_f32, read_i64};
use crate::curriculum::Stop;
use crate::errors::{self, invalid};

/// What a step gives: observations, rewards, terminations, truncations, and whether any episode ended.
pub(super) type Stepped<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f64>>,
    Bound<'py, PyArrayDyn<bool>>,
    Bound<'py, PyArrayDyn<bool>>,
    bool,
);
/// Of each environment: whether its episode ended, its return, its length, and the seconds it took.
pub(super) type Episodes<'py> = (
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);
/// Of each environment: its level, whether to learn from it, whether it rests.
pub(super) type Lessons<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);
/// Of each agent: its reward, whether it has left, whether the horizon cut it off.
pub(super) type Agents<'py> =
    (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>, Bound<'py, PyArray2<bool>>);
/// Arrays of a caller's own for these.
pub(super) type Given<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Arrays handed out.
pub(super) struct Shelves {
    pub(super) observations: Shelf<f32>,
    pub(super) rewards: Shelf<f64>,
    pub(super) flags: [Shelf<bool>; 2],
}

impl Shelves {
    pub(super) fn new(
        lead: &[usize],
        Shape { envs, agents, observation, .. }: Shape,
        observe: Observe,
    ) -> Self {
        let seen = match observe {
            Observe::Tracks { .. } => vec![agents, observation / agents],
            Observe::All { .. } => vec![observation],
        };
        Self {
            observations: Shelf::new(&[lead, &seen].concat()),
            rewards: Shelf::new(&[envs]),
            flags: [Shelf::new(&[envs]), Shelf::new(&[envs])],
        }
    }
}

/// What to do when an episode is over.
pub(super) fn autoreset(word: &str) -> PyResult<Autoreset> {
    match word {
        "next_step" => Ok(Autoreset::NextStep),
        "same_step" => Ok(Autoreset::SameStep),
        "disabled" => Ok(Autoreset::Disabled),
        _ => Err(invalid("autoreset_mode", format!("{word:?} is none of next_step, same_step, disabled"))),
    }
}

/// Why nothing was begun or stepped.
pub(crate) enum Wrong {
    Batch(BatchError),
    Curriculum(Stop),
}

impl Wrong {
    pub(super) fn error(self, py: Python<'_>) -> PyErr {
        match self {
            Self::Batch(error) => errors::batch(py, &error),
            Self::Curriculum(stop) => stop.error(),
        }
    }
}

/// By a thread that has let the interpreter go.
pub(super) fn hold<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What a panic left is no more than a batch of which a step was begun; it says itself what it refuses.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// By a thread that has the interpreter, and lets it go while it waits: whoever holds this may be waiting for that.
pub(super) fn lock<'a, T>(py: Python<'_>, mutex: &'a Mutex<T>) -> MutexGuard<'a, T> {
    mutex.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

impl Drop for NativeBatch {
    fn drop(&mut self) {
        // What nobody closed is closed now. Whoever waits for the stock needs no interpreter.
        if !self.is_here() {
            return; // it is the parent's of a process that was forked
        }
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let (Some(desk), Some(mut book)) = (&self.desk, state.book.take()) {
            desk.leave(&mut book, self.shape.envs);
        }
    }
}

/// A seed that callers may choose.
pub(super) fn read_seed(seed: &Bound<'_, PyAny>) -> PyResult<Seed> {
    let wanted = || invalid("seed", format!("{seed} is not {}", env_core::SEED_WANTED));
    let value: u64 = seed.extract().map_err(|_| wanted())?;
    if value > FREE_MASK { Err(wanted()) } else { Seed::user(value).map_err(|_| wanted()) }
}

impl NativeBatch {
    /// Whether this is the process it was made in.
    pub(super) fn is_here(&self) -> bool {
        std::process::id() == self.process
    }

    /// Threads are not forked with a process: whoever waited for them would wait for ever.
    pub(super) fn here(&self) -> PyResult<()> {
        if self.is_here() || (self.pool.alone() && self.desk.is_none()) {
            return Ok(());
        }
        Err(PyRuntimeError::new_err(
            "these environments are another process's, and a fork has none of their threads: make them in the process that steps them",
        ))
    }

    pub(super) fn known(&self, env: usize) -> PyResult<()> {
        let envs = self.shape.envs;
        if env < envs { Ok(()) } else { Err(invalid("env", format!("{env} of {envs}"))) }
    }

    pub(super) fn read_actions(&self, given: &Bound<'_, PyAny>, into: &mut Vec<f32>) -> PyResult<()> {
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
    pub(super) fn observations<'py>(
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
    pub(super) fn arrays<'py>(
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
