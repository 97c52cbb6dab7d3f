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

    /// Converts the error of a scenario, whose message begins with its field.
    pub(crate) fn from_scenario_error(error: &ScenarioError) -> Self {
        let (field, message) = (error.field(), error.to_string());
        let reason = message.strip_prefix(field).unwrap_or(&message).trim_start_matches([':', ' ']);
        Self::new(field, reason)
    }

    pub(crate) fn unknown_task(field: &str, task: &str) -> Self {
        let known = env_core::tasks().map(|spec| spec.id()).collect::<Vec<_>>().join(", ");
        Self::new(field, format!("{task:?} is not a task; known are {known}"))
    }
}
