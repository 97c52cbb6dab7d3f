//! The error of invalid settings.

use env_core::ScenarioError;

/// Invalid settings: the field at fault and the problem.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} {reason}")]
pub struct SettingsError {
    /// Dotted path of the field at fault.
    pub field: String,
    /// Problem with the field; continues a sentence that begins with its name.
    pub reason: String,
}

impl SettingsError {
    pub(crate) fn new(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { field: field.into(), reason: reason.into() }
    }

    /// Converts the error of a scenario.
    pub(crate) fn from_scenario_error(error: &ScenarioError) -> Self {
        Self::new(error.field(), error.reason())
    }

    pub(crate) fn unknown_task(field: &str, task: &str) -> Self {
        let known = env_core::tasks().map(|spec| spec.id()).collect::<Vec<_>>().join(", ");
        Self::new(field, format!("must be one of {known}, got {task:?}"))
    }
}
