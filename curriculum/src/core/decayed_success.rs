//! Numbers of successes and failures that fade, because the agent changes.

use serde::{Deserialize, Serialize};

/// Latest results of a rung, in episodes. Older ones have a smaller weight.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DecayedSuccess {
    /// Sum of the weights of the successes.
    pub(crate) successes: f64,
    /// Sum of the weights of the failures.
    pub(crate) failures: f64,
}

impl DecayedSuccess {
    /// Adds results. Each of their episodes discounts all earlier results by the share `forget`, 0 to 1.
    pub(crate) fn add(&mut self, successes: u32, failures: u32, forget: f64) {
        let kept = libm::pow(1.0 - forget, f64::from(successes) + f64::from(failures));
        self.successes = self.successes * kept + f64::from(successes);
        self.failures = self.failures * kept + f64::from(failures);
    }

    /// Sum of the weights of all results.
    pub(crate) fn attempts(&self) -> f64 {
        self.successes + self.failures
    }
}
