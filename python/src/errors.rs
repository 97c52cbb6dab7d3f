//! What is wrong, as the exceptions that users of Gymnasium expect.

use env_core::ScenarioError;
use env_core::batch::BatchError;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// Something wrong with a field.
pub(crate) fn invalid(field: &str, why: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{field}: {why}"))
}

/// A scenario or recipe that is none.
pub(crate) fn scenario(error: &ScenarioError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// What a batch refuses. An episode that is over wants `gymnasium.error.ResetNeeded`.
pub(crate) fn batch(py: Python<'_>, error: &BatchError) -> PyErr {
    match error {
        BatchError::Ended { .. } => reset_needed(py, &error.to_string()),
        BatchError::NotFinite { .. } => invalid("actions", error),
        _ => PyValueError::new_err(error.to_string()),
    }
}

fn reset_needed(py: Python<'_>, why: &str) -> PyErr {
    let made = || -> PyResult<PyErr> {
        let class = py.import("gymnasium.error")?.getattr("ResetNeeded")?;
        Ok(PyErr::from_value(class.call1((why,))?))
    };
    made().unwrap_or_else(|_| PyRuntimeError::new_err(why.to_owned()))
}
