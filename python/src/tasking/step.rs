//! The data of a step.

use env_core::tasking::simulation::StepResult;
use pyo3::prelude::*;

/// Data that the satellites of an episode gained in a step. The lists have one item for each satellite.
#[pyclass(frozen, module = "sparring._native")]
#[derive(Debug, Clone)]
pub(crate) struct NativeTaskingStep(StepResult);

impl NativeTaskingStep {
    pub(super) const fn new(result: StepResult) -> Self {
        Self(result)
    }
}

#[pymethods]
impl NativeTaskingStep {
    /// Duration of the step, s.
    #[getter]
    const fn elapsed_s(&self) -> f64 {
        self.0.elapsed_s
    }

    /// True if the time limit is reached.
    #[getter]
    const fn is_truncated(&self) -> bool {
        self.0.truncated
    }

    /// Index of the target that each satellite imaged.
    #[getter]
    fn imaged(&self) -> Vec<Option<usize>> {
        self.0.imaged.clone()
    }

    /// Number of satellites that share the reward of each satellite's image; 0 if it pays nothing.
    #[getter]
    fn sharers(&self) -> Vec<u32> {
        self.0.sharers.clone()
    }

    /// Time of the data that each satellite scanned, s.
    #[getter]
    fn scanned_s(&self) -> Vec<f64> {
        self.0.scanned_s.clone()
    }

    /// Pairs of satellites that shared data, each from a sender to a receiver.
    #[getter]
    fn pairs(&self) -> Vec<[usize; 2]> {
        self.0.pairs.clone()
    }
}
