//! The observation of one step, as chat policies and judges receive it.

use serde_json::Value;

/// Observation, reward and end of an episode after a reset or a step.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeStep {
    /// Observation in its wire form, with or without the fields `reward` and `done`.
    pub observation: Value,
    /// Team reward of the last step.
    pub reward: f64,
    /// True if the episode has ended.
    pub done: bool,
}

impl TimeStep {
    /// Returns the observation with the fields `reward` and `done`.
    #[must_use]
    pub fn with_reward_and_done(&self) -> Value {
        let mut observation = self.observation.clone();
        if let Some(fields) = observation.as_object_mut() {
            fields.insert("reward".to_owned(), self.reward.into());
            fields.insert("done".to_owned(), self.done.into());
        }
        observation
    }
}
