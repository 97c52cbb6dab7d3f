//! Errors of a curriculum, and deadlines given in seconds.

use std::time::{Duration, Instant};

use pyo3::create_exception;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::errors::invalid;

create_exception!(
    sparring,
    CurriculumError,
    PyRuntimeError,
    "The curriculum has no more episodes, or its server does not answer, fails or rejects a request."
);

/// Deadline for an infinite timeout: a century, in seconds.
const INFINITE_TIMEOUT_S: f64 = 3.2e9;

/// Reason why a wait for the curriculum ended without an episode.
pub(crate) enum WaitError {
    /// The curriculum failed, with a message.
    Failed(String),
    /// A Python signal handler raised an exception, as on Ctrl-C.
    Interrupted(PyErr),
}

impl From<String> for WaitError {
    fn from(message: String) -> Self {
        Self::Failed(message)
    }
}

impl WaitError {
    /// Converts the error to a Python exception.
    pub(crate) fn into_py(self) -> PyErr {
        match self {
            Self::Failed(message) => curriculum_error(message),
            Self::Interrupted(error) => error,
        }
    }
}

/// Builds a `CurriculumError` with this message.
pub(super) fn curriculum_error(message: String) -> PyErr {
    CurriculumError::new_err(message)
}

/// Returns the instant `seconds` from now; infinity is allowed.
///
/// # Errors
/// `ValueError` about `field` if the number is negative, NaN or too large for a clock.
pub(super) fn deadline(field: &str, seconds: f64) -> PyResult<Instant> {
    let seconds = if seconds == f64::INFINITY { INFINITE_TIMEOUT_S } else { seconds };
    let error = || invalid(field, "a number of seconds >= 0, or infinity", seconds);
    let timeout = Duration::try_from_secs_f64(seconds).map_err(|_| error())?;
    Instant::now().checked_add(timeout).ok_or_else(error)
}
