//! Errors of a reset or a step.

use env_core::batch::BatchError;
use pyo3::prelude::*;

use crate::curriculum::WaitError;
use crate::errors::batch_error;

/// Reason why a batch was neither reset nor stepped.
pub(super) enum StepError {
    /// The batch rejected the actions or the scenario.
    Batch(BatchError),
    /// The curriculum had no episode.
    Curriculum(WaitError),
}

impl StepError {
    /// Converts the error to a Python exception.
    pub(super) fn into_py(self, py: Python<'_>) -> PyErr {
        match self {
            Self::Batch(error) => batch_error(py, &error),
            Self::Curriculum(error) => error.into_py(),
        }
    }
}
