//! Policies without a model.

mod pilot;

use std::any::Any;

use serde::Serialize;

pub(crate) use self::pilot::{Hold, Pilot, Witness, seated};
use crate::error::ScenarioError;
use crate::log::ActionLog;

/// Something that acts on observations.
pub trait Policy: Send {
    /// Appends this step's actions to `log`, closing the step.
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog);
}

/// A built-in policy, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PolicySpec {
    /// Its name.
    pub name: &'static str,
    /// What it does, in one sentence.
    pub about: &'static str,
    /// Its actions are drawn: another seed flies otherwise.
    pub chance: bool,
}

/// A policy that cannot be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// No policy of this name.
    #[error("policy {name:?} is unknown; choose one of {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The scenario cannot be flown.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

impl PolicyError {
    /// No policy of this name among these.
    pub(crate) fn unknown(name: &str, specs: &[PolicySpec]) -> Self {
        let known: Vec<&str> = specs.iter().map(|spec| spec.name).collect();
        Self::Unknown { name: name.to_owned(), known: known.join(", ") }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use crate::log::{ActionLog, Precision};
    use crate::task::StepReport;
    use crate::testing::at_level;

    /// A policy that sees observations as another process tells them does what it does here, to the bit.
    #[test]
    fn observations_read_back_from_the_wire() {
        for task in crate::tasks() {
            let scenario = at_level(task.id(), 3, 5);
            let [mut here, mut there] = [(); 2].map(|()| task.policy("heuristic", &scenario, 1).unwrap());
            let log = || ActionLog::new(task.action_space().columns.len(), Precision::F64);
            let (mut done, mut told) = (log(), log());
            let mut episode = task.start(&scenario).unwrap();
            let mut report = StepReport::default();
            while !episode.done() && episode.steps() < 100 {
                here.act(episode.observation(), &mut done);
                let wire: Value = serde_json::from_str(&episode.telemetry().to_string()).unwrap();
                there.act(&*task.read_observation(&wire).unwrap(), &mut told);
                episode.step(done.step(done.len() - 1), &mut report).unwrap();
            }
            assert!(done == told && done.len() > 30, "{}", task.id());
            assert!(done.encode() == told.encode(), "{}", task.id());
            assert!(task.read_observation(&serde_json::json!({"satellites": 3})).is_err());
        }
    }
}
