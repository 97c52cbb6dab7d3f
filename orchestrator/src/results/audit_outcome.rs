//! Outcomes of an audit: what the replay of a reported episode showed.

use api_types::RefusalCode;
use env_core::Scenario;
use env_core::bracket::{Bracket, EpisodeOutcome};
use store::compacted_leases::CompactedLease;
use store::episodes::StoredLog;
use store::keys::{EpisodeKey, GroupKey};

use crate::results::refusal::Refusal;

/// A reported episode after lookup and replay.
#[derive(Debug, Clone)]
pub struct AuditedEpisode {
    /// Episode id, as it was sent.
    pub episode: String,
    /// Key of the episode, if it exists in this run.
    pub key: Option<EpisodeKey>,
    /// Version of the policy that acted.
    pub policy_version: Option<u32>,
    /// Metrics that the trainer attached, as JSON.
    pub metrics: Option<String>,
    /// True if a session runs the episode while its trainer reports it by another way: the session's attempt was the first one.
    pub is_in_session: bool,
    /// Outcome of the audit.
    pub outcome: AuditOutcome,
}

/// Outcome of an audit.
#[derive(Debug, Clone)]
pub enum AuditOutcome {
    /// The action log was replayed.
    Replayed(ReplayedEpisode),
    /// The infrastructure lost the episode, for this reason.
    Failed(String),
    /// A result was reported before; the lease is compacted and keeps nothing else of the episode.
    Known {
        /// Score of the replay.
        score: Option<f64>,
        /// Skill between floor (0) and reference (1).
        skill: Option<f64>,
        /// True if the episode was a success by the run's rule.
        success: Option<bool>,
    },
    /// The result cannot be accepted.
    Refused(Refusal),
}

/// Result of a replay.
#[derive(Debug, Clone)]
pub struct ReplayedEpisode {
    /// Outcome of the episode.
    pub outcome: EpisodeOutcome,
    /// Skill between floor (0) and reference (1); `None` if the scenario defines none.
    pub skill: Option<f64>,
    /// True if the episode was a success by the run's rule.
    pub is_success: bool,
    /// Floor of the bracket.
    pub floor: f64,
    /// Reference score of the bracket.
    pub reference: f64,
    /// Version of the planner behind the reference.
    pub planner: u32,
    /// The log as it is stored.
    pub log: StoredLog,
}

impl AuditOutcome {
    /// Duration of a replayed episode, s, in worlds whose steps differ in duration.
    pub(crate) fn time_s(&self) -> Option<f64> {
        if let Self::Replayed(replayed) = self { replayed.outcome.time_s } else { None }
    }

    /// Number of environment steps of a replayed episode; 0 for others.
    pub(crate) fn steps(&self) -> i64 {
        if let Self::Replayed(replayed) = self { i64::from(replayed.outcome.steps) } else { 0 }
    }

    /// Builds the outcome of a refused episode.
    pub(crate) fn refused(code: RefusalCode, detail: impl Into<String>) -> Self {
        Self::Refused(Refusal::new(code, detail))
    }

    /// Outcome of an episode of a compacted lease, which keeps results only.
    pub(crate) fn of_compacted(lease: Option<&CompactedLease>, index: i64) -> Self {
        let Some((_, known)) = lease.and_then(|compacted| compacted.episode(index)) else {
            let detail = "the lease has ended and its scenario was deleted";
            return Self::refused(RefusalCode::Expired, detail);
        };
        Self::Known { score: known.score, skill: known.skill, success: known.success }
    }
}

/// Bracket of a group of a lease of columns, which is computed only when the group is audited.
#[derive(Debug, Clone)]
pub struct DeferredBracket {
    /// Key of the group.
    pub group: GroupKey,
    /// Scenario of the group.
    pub scenario: Scenario,
    /// Bracket of the scenario.
    pub bracket: Bracket,
    /// True if the scenario is contested.
    pub is_contested: bool,
}

/// Audited episodes of one report.
#[derive(Debug, Clone, Default)]
pub struct AuditedReport {
    /// The episodes, in the order of the report.
    pub episodes: Vec<AuditedEpisode>,
    /// Brackets that the audit computed.
    pub brackets: Vec<DeferredBracket>,
}
