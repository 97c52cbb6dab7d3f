//! Conversion of errors into the Python exceptions that users of Gymnasium expect.

use std::fmt::Display;

use env_core::ScenarioError;
use env_core::batch::BatchError;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// Builds a `ValueError` about an argument: "`field` must be `requirement`, got `value`".
pub(crate) fn invalid(field: &str, requirement: impl Display, value: impl Display) -> PyErr {
    PyValueError::new_err(format!("`{field}` must be {requirement}, got {value}"))
}

/// Builds a `ValueError` about an argument from the error of another library: "`field`: `error`".
pub(crate) fn rejected(field: &str, error: impl Display) -> PyErr {
    PyValueError::new_err(format!("`{field}`: {error}"))
}

/// Builds a `ValueError` for an invalid scenario or recipe.
pub(crate) fn scenario_error(error: &ScenarioError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Builds the exception for an error of a batch.
///
/// An episode that is over becomes `gymnasium.error.ResetNeeded`, every other error a `ValueError`.
pub(crate) fn batch_error(py: Python<'_>, error: &BatchError) -> PyErr {
    match error {
        BatchError::Ended { .. } => reset_needed(py, &error.to_string()),
        BatchError::NotFinite { .. } => rejected("actions", error),
        _ => PyValueError::new_err(error.to_string()),
    }
}

fn reset_needed(py: Python<'_>, message: &str) -> PyErr {
    let build = || -> PyResult<PyErr> {
        let class = py.import("gymnasium.error")?.getattr("ResetNeeded")?;
        Ok(PyErr::from_value(class.call1((message,))?))
    };
    build().unwrap_or_else(|_| PyRuntimeError::new_err(message.to_owned()))
}
