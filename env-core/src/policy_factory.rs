//! Factories of policies: one source of the policies of many episodes.

use crate::policy::{Policy, PolicyError, unknown_policy};
use crate::task::{Scenario, TaskSpec};

/// Creates the policies of episodes: a built-in policy by its name, or the contents of a file.
pub trait PolicyFactory: Send + Sync {
    /// Name of the policy.
    fn name(&self) -> &str;

    /// Checks that the policy can act in a task.
    ///
    /// # Errors
    /// Returns [`PolicyError`] if the task does not have the policy.
    fn check(&self, task: &'static dyn TaskSpec) -> Result<(), PolicyError>;

    /// True if the policy's actions in a task depend on its seed.
    fn is_stochastic(&self, task: &dyn TaskSpec) -> bool;

    /// Creates the policy of one episode; `seed` seeds a stochastic one.
    ///
    /// # Errors
    /// Returns [`PolicyError`] if the task does not have the policy or the scenario cannot start.
    fn create(&self, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError>;
}

/// Factory of a built-in policy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BuiltInPolicy(pub String);

impl PolicyFactory for BuiltInPolicy {
    fn name(&self) -> &str {
        &self.0
    }

    fn check(&self, task: &'static dyn TaskSpec) -> Result<(), PolicyError> {
        if task.policies().iter().any(|spec| spec.name == self.0) {
            return Ok(());
        }
        Err(unknown_policy(&self.0, task.policies()))
    }

    fn is_stochastic(&self, task: &dyn TaskSpec) -> bool {
        task.policies().iter().any(|spec| spec.name == self.0 && spec.stochastic)
    }

    fn create(&self, scenario: &Scenario, seed: u64) -> Result<Box<dyn Policy>, PolicyError> {
        scenario.task().policy(&self.0, scenario, seed)
    }
}
