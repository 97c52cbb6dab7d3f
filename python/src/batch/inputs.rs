//! Checks of the process, and checks and conversions of arguments of a batch's methods.

use env_core::Seed;
use env_core::seed::MAX_USER_SEED;
use env_core::space::ActionSpace;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use super::NativeBatch;
use crate::arrays::{copy_f32, read_i64};
use crate::errors::invalid;

/// Discrete action by which an agent goes on with the action before, if none of the choices is hold.
const GO_ON: i64 = -1;

impl NativeBatch {
    /// True if this process made the batch, false in a fork of it.
    pub(super) fn is_owner_process(&self) -> bool {
        std::process::id() == self.process
    }

    /// Checks that this process can step the batch: a fork copies neither its threads nor those of a curriculum.
    ///
    /// # Errors
    /// `RuntimeError` in a fork, where a step would never return.
    pub(super) fn check_process(&self) -> PyResult<()> {
        if self.is_owner_process() || (self.step_threads.is_inline() && self.curriculum.is_none()) {
            return Ok(());
        }
        Err(PyRuntimeError::new_err(
            "the environments belong to another process, and a fork does not copy its threads: make them in the process that steps them",
        ))
    }

    /// Checks the index of an environment.
    ///
    /// # Errors
    /// `ValueError` if the index is out of range.
    pub(super) fn check_env(&self, env: usize) -> PyResult<()> {
        let envs = self.shape.envs;
        if env < envs { Ok(()) } else { Err(invalid("env", format!("from 0 to {}", envs - 1), env)) }
    }

    /// Reads actions into `target`; discrete actions become the values that they choose.
    ///
    /// # Errors
    /// `ValueError` if dtype or shape is wrong, or a discrete action is out of range.
    pub(super) fn read_actions(&self, actions: &Bound<'_, PyAny>, target: &mut Vec<f32>) -> PyResult<()> {
        let Some(choices) = &self.choices else {
            return copy_f32("actions", actions, &self.action_shape, target);
        };
        target.clear();
        for choice in read_i64("actions", actions, &self.action_shape)? {
            let row = usize::try_from(choice).ok().and_then(|choice| choices.rows.get(choice));
            match row {
                Some(row) => target.extend_from_slice(row),
                // No choice is hold.
                None if choice == GO_ON && choices.hold.is_none() => target.push(ActionSpace::GO_ON),
                None => {
                    let low = if choices.hold.is_none() { "-1 (go on)" } else { "0" };
                    return Err(invalid(
                        "actions",
                        format!("from {low} to {}", choices.rows.len() - 1),
                        choice,
                    ));
                }
            }
        }
        Ok(())
    }
}

/// Reads a seed of the space that users may choose from.
///
/// # Errors
/// `ValueError` if `seed` is not an integer of that space.
pub(super) fn read_seed(seed: &Bound<'_, PyAny>) -> PyResult<Seed> {
    let error = || invalid("seed", env_core::SEED_REQUIREMENT, seed);
    let value: u64 = seed.extract().map_err(|_| error())?;
    if value > MAX_USER_SEED { Err(error()) } else { Seed::user(value).map_err(|_| error()) }
}
