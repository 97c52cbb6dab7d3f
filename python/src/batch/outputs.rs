//! Arrays that a batch's methods return.

use env_core::batch::{BatchShape, ObservationMode};
use numpy::{Element, PyArray1, PyArray2, PyArrayDyn};
use pyo3::prelude::*;

use super::NativeBatch;
use super::lock::lock_attached;
use crate::arrays::{ArrayRecycler, wrong_dtype};

/// Result of a step: observations, rewards, terminations, truncations, and whether any episode ended.
pub(super) type StepResult<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f64>>,
    Bound<'py, PyArrayDyn<bool>>,
    Bound<'py, PyArrayDyn<bool>>,
    bool,
);
/// For each environment: whether its episode ended, and the episode's return, length and duration in seconds.
pub(super) type EpisodeArrays<'py> = (
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);
/// For each environment: its level, whether to train on its episode, and whether it is idle.
pub(super) type CurriculumArrays<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);
/// For each agent: its reward, whether it terminated, and whether it was truncated.
pub(super) type AgentArrays<'py> =
    (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>, Bound<'py, PyArray2<bool>>);
/// For each environment: the duration of the last step, and for each of its agents whether it needs an action.
pub(super) type TimeArrays<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<bool>>);
/// Caller's arrays for observations, rewards, terminations and truncations.
pub(super) type OutArrays<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Arrays that a step writes and returns.
pub(super) struct StepArrays<'py> {
    pub(super) observations: Bound<'py, PyArrayDyn<f32>>,
    pub(super) rewards: Bound<'py, PyArrayDyn<f64>>,
    pub(super) terminations: Bound<'py, PyArrayDyn<bool>>,
    pub(super) truncations: Bound<'py, PyArrayDyn<bool>>,
}

/// Recycled result arrays of a batch.
pub(super) struct OutputArrays {
    pub(super) observations: ArrayRecycler<f32>,
    rewards: ArrayRecycler<f64>,
    terminations: ArrayRecycler<bool>,
    truncations: ArrayRecycler<bool>,
}

impl OutputArrays {
    /// Creates recyclers for a batch; `leading_axes` is the first axis of observations, empty for a single environment.
    pub(super) fn new(
        leading_axes: &[usize],
        BatchShape { envs, agents, observation, .. }: BatchShape,
        observe: ObservationMode,
    ) -> Self {
        let observation_shape = match observe {
            ObservationMode::Tracks { .. } => vec![agents, observation / agents],
            ObservationMode::All { .. } | ObservationMode::Extended => vec![observation],
        };
        Self {
            observations: ArrayRecycler::new(&[leading_axes, &observation_shape].concat()),
            rewards: ArrayRecycler::new(&[envs]),
            terminations: ArrayRecycler::new(&[envs]),
            truncations: ArrayRecycler::new(&[envs]),
        }
    }
}

impl NativeBatch {
    /// Returns the caller's array for observations, or a recycled one.
    ///
    /// # Errors
    /// `ValueError` if the caller's array has another dtype.
    pub(super) fn observation_array<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        match out {
            Some(out) => cast_out("out", out.clone()),
            None => Ok(lock_attached(py, &self.outputs).observations.acquire(py)),
        }
    }

    /// Returns the caller's arrays for a step, or recycled ones.
    ///
    /// # Errors
    /// `ValueError` if a caller's array has another dtype.
    pub(super) fn step_arrays<'py>(
        &self,
        py: Python<'py>,
        out: Option<OutArrays<'py>>,
    ) -> PyResult<StepArrays<'py>> {
        let Some((observations, rewards, terminations, truncations)) = out else {
            let outputs = &mut *lock_attached(py, &self.outputs);
            return Ok(StepArrays {
                observations: outputs.observations.acquire(py),
                rewards: outputs.rewards.acquire(py),
                terminations: outputs.terminations.acquire(py),
                truncations: outputs.truncations.acquire(py),
            });
        };
        Ok(StepArrays {
            observations: cast_out("out[0]", observations)?,
            rewards: cast_out("out[1]", rewards)?,
            terminations: cast_out("out[2]", terminations)?,
            truncations: cast_out("out[3]", truncations)?,
        })
    }
}

/// Casts an array of the caller.
///
/// # Errors
/// `ValueError` if the array has another dtype.
fn cast_out<'py, T: Element>(field: &str, array: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    array.cast_into().map_err(|error| {
        let array = error.into_inner();
        wrong_dtype(field, numpy::dtype::<T>(array.py()), &array)
    })
}
