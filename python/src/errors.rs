//! Conversion of errors into the Python exceptions that users of Gymnasium expect.

use env_core::ScenarioError;
use env_core::batch::BatchError;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// Builds a `ValueError` about one field: "`field`: `reason`".
pub(crate) fn invalid(field: &str, reason: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{field}: {reason}"))
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
        BatchError::NotFinite { .. } => invalid("actions", error),
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
