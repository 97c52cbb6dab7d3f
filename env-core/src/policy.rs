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
