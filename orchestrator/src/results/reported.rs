//! Episodes as clients report them.

use env_core::log::Precision;
use env_core::{ActionLog, StopReason};
use serde_json::Value;

use crate::results::refusal::Refusal;

/// An episode as a client reports it.
#[derive(Debug, Clone)]
pub struct ReportedEpisode {
    /// Episode id, as it was sent.
    pub episode: String,
    /// Outcome of the episode.
    pub outcome: ReportedOutcome,
    /// Version of the policy that acted; `None` for the version of the lease.
    pub policy_version: Option<u32>,
    /// Metrics that the trainer attached, as JSON.
    pub metrics: Option<String>,
}

/// Outcome of an episode as a client reports it.
#[derive(Debug, Clone)]
pub enum ReportedOutcome {
    /// The episode was run.
    Finished {
        /// Actions of each step, in the task's wire format.
        steps: Vec<Value>,
        /// Precision in which the actions were taken.
        precision: Precision,
        /// Reason if the episode was stopped early.
        stopped: Option<StopReason>,
    },
    /// The server ran the episode itself and has its log.
    Logged(ActionLog),
    /// The infrastructure lost the episode.
    Failed {
        /// Reason that the trainer gives.
        reason: String,
    },
    /// The report contradicts itself.
    Refused(Refusal),
}
