//! A group that was rolled out, and its form as a message.

use jobs::envelope::MAX_ENVELOPE_BYTES;
use serde::{Deserialize, Serialize};

use crate::job::{RolloutJob, RolloutPolicy};
use crate::run_episode::RolloutOutcome;
use crate::wire_error::RolloutWireError;

/// Largest group as a compressed message, in bytes: an envelope adds some names.
const MAX_MESSAGE_BYTES: usize = MAX_ENVELOPE_BYTES - (64 << 10);
/// Largest group as JSON, in bytes: observations and conversations with 16 MiB each, and the rest of the largest group of a feed.
const MAX_JSON_BYTES: usize = 96 << 20;
/// Compression level of zstd: its own default.
const COMPRESSION_LEVEL: i32 = 3;

/// Group that was rolled out.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RolledOutGroup {
    /// Outcomes of the episodes, in the order of their seeds.
    pub outcomes: Vec<RolloutOutcome>,
    /// True if observations were left out because there were too many.
    pub lacks_observations: bool,
    /// True if conversations were left out because they were too long.
    pub lacks_messages: bool,
    /// Cost of the calls of a language model, by the prices of its endpoint.
    pub cost: f64,
}

impl RolledOutGroup {
    /// Writes the group. A group that is too large for a message loses its observations, then its conversations.
    ///
    /// # Errors
    /// Returns [`RolloutWireError::TooLarge`] if the group is too large even then.
    pub fn encode(mut self) -> Result<Vec<u8>, RolloutWireError> {
        let mut message = self.compress()?;
        if message.len() > MAX_MESSAGE_BYTES {
            self.drop_observations();
            message = self.compress()?;
        }
        if message.len() > MAX_MESSAGE_BYTES {
            self.drop_messages();
            message = self.compress()?;
        }
        if message.len() > MAX_MESSAGE_BYTES {
            return Err(RolloutWireError::TooLarge(message.len()));
        }
        Ok(message)
    }

    /// Reads the group of a job.
    ///
    /// # Errors
    /// Returns [`RolloutWireError`] if the bytes are no valid group, or if it does not fit the job.
    pub fn decode(job: &RolloutJob, bytes: &[u8]) -> Result<Self, RolloutWireError> {
        let json = zstd::bulk::decompress(bytes, MAX_JSON_BYTES)?;
        let group: Self = serde_json::from_slice(&json)?;
        group.check(job)?;
        Ok(group)
    }

    /// Checks what the service relies on. Logs are checked by their replay.
    fn check(&self, job: &RolloutJob) -> Result<(), RolloutWireError> {
        let is_chat = matches!(job.policy, RolloutPolicy::Chat(_));
        let mut recorded = self.outcomes.iter().filter_map(|outcome| outcome.episode.as_ref().ok());
        let fault = if self.outcomes.len() != job.seeds.len() {
            "it has other or fewer episodes"
        } else if self.outcomes.iter().any(|outcome| outcome.metrics.is_some() != is_chat) {
            "its episodes are those of another policy"
        } else if !(self.cost.is_finite() && self.cost >= 0.0) {
            "its cost is no amount"
        } else if !recorded.all(crate::RecordedEpisode::has_actions_of_log) {
            "the steps of an episode have other actions than its log"
        } else {
            return Ok(());
        };
        Err(RolloutWireError::Mismatch(fault))
    }

    fn compress(&self) -> Result<Vec<u8>, RolloutWireError> {
        Ok(zstd::bulk::compress(&serde_json::to_vec(self)?, COMPRESSION_LEVEL)?)
    }

    /// Removes the observations of every step.
    fn drop_observations(&mut self) {
        self.lacks_observations = true;
        for episode in self.outcomes.iter_mut().filter_map(|outcome| outcome.episode.as_mut().ok()) {
            episode.last_observation = None;
            episode.steps.iter_mut().for_each(|step| step.observation = None);
        }
    }

    /// Removes the conversations; the model's answers are kept.
    fn drop_messages(&mut self) {
        self.lacks_messages = true;
        let episodes = self.outcomes.iter_mut().filter_map(|outcome| outcome.episode.as_mut().ok());
        let steps = episodes.flat_map(|episode| &mut episode.steps);
        for completion in steps.filter_map(|step| step.completions.as_mut()).flatten() {
            completion.messages.clear();
        }
    }
}
