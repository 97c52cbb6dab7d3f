//! Errors of reading and writing the messages of rollouts.

use env_core::{LogError, ScenarioError};

/// Reason why a job or a group cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RolloutWireError {
    /// The JSON of the message is not of the expected form.
    #[error("the message is not of the expected form: {0}")]
    Json(#[from] serde_json::Error),
    /// The message cannot be compressed, or is damaged.
    #[error("the message cannot be (de)compressed: {0}")]
    Zstd(#[from] std::io::Error),
    /// The scenario is invalid.
    #[error("the scenario of the message is invalid: {0}")]
    Scenario(#[from] ScenarioError),
    /// An action log is invalid.
    #[error("an action log of the message is invalid: {0}")]
    Log(#[from] LogError),
    /// The group contradicts itself or its job.
    #[error("the group does not fit its job: {0}")]
    Mismatch(&'static str),
    /// The group is too large for a message, even without observations and conversations.
    #[error("the group has {0} bytes without observations and conversations, which no message can carry")]
    TooLarge(usize),
}
