//! Built-in policies: the interface, their description as data, and helpers for worlds that implement them.
//!
//! The policies themselves are in each world's `policies` module. [`crate::policy_factory`] creates
//! the policies of many episodes; policies from files are in the `policy-files` crate.

mod typed_policy;

use std::any::Any;

use serde::Serialize;

pub(crate) use self::typed_policy::{HoldPolicy, PlanPolicy, TypedPolicy, erase_type};
pub use crate::error::PolicyError;
use crate::log::ActionLog;

/// A policy: chooses actions by observations.
pub trait Policy: Send {
    /// Appends the actions of one step to `log` and closes the step.
    ///
    /// # Errors
    /// Returns [`PolicyError::Act`] if the policy has no action. Built-in policies always have one.
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError>;
}

/// Name of the policy of each task that follows the plan of the task's planner.
pub const PLANNER_POLICY: &str = "reference";

/// A built-in policy, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PolicySpec {
    /// Name of the policy.
    pub name: &'static str,
    /// Description in one sentence, without a subject.
    pub description: &'static str,
    /// True if the policy is stochastic, so that its actions depend on the seed.
    pub stochastic: bool,
}

/// Creates a [`PolicyError::Unknown`] that lists these policies.
pub(crate) fn unknown_policy(name: &str, specs: &[PolicySpec]) -> PolicyError {
    let known: Vec<&str> = specs.iter().map(|spec| spec.name).collect();
    PolicyError::Unknown { name: name.to_owned(), known: known.join(", ") }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use crate::log::{ActionLog, Precision};
    use crate::task::StepReport;
    use crate::testing::at_level;

    /// A policy that reads observations from JSON acts as one that observes the episode itself, to the bit.
    #[test]
    fn policies_act_equally_on_parsed_observations() {
        for task in crate::tasks() {
            let scenario = at_level(task.id(), 3, 5);
            let [mut local, mut remote] = [(); 2].map(|()| task.policy("heuristic", &scenario, 1).unwrap());
            let log = || ActionLog::new(task.action_space().dim(), Precision::F64);
            let (mut local_log, mut remote_log) = (log(), log());
            let mut episode = task.start(&scenario).unwrap();
            let mut report = StepReport::default();
            while !episode.done() && episode.steps() < 100 {
                local.act(episode.observation(), &mut local_log).unwrap();
                let json: Value = serde_json::from_str(&episode.telemetry().to_string()).unwrap();
                remote.act(&*task.read_observation(&json).unwrap(), &mut remote_log).unwrap();
                episode.step(local_log.step(local_log.len() - 1), &mut report).unwrap();
            }
            assert!(local_log == remote_log && local_log.len() > 30, "{}", task.id());
            assert!(local_log.encode() == remote_log.encode(), "{}", task.id());
            assert!(task.read_observation(&serde_json::json!({"satellites": 3})).is_err());
        }
    }
}
