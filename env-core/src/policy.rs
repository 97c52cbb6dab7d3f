//! Policies without a model.

use std::any::Any;

use serde::Serialize;

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
