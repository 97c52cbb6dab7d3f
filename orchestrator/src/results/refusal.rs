//! Why the server refuses a reported episode.

/// Reason of a refusal, as a word for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalCode {
    /// The episode id is malformed.
    BadId,
    /// The lease has no such episode, or it is not audited.
    UnknownEpisode,
    /// The lease belongs to another run.
    ForeignEpisode,
    /// The fields of the result contradict each other.
    InvalidResult,
    /// The action log does not replay.
    InvalidLog,
    /// Another result was reported for the episode before.
    Conflict,
    /// The result names another policy version than its evaluation.
    OtherVersion,
    /// The run no longer keeps the episode's scenario, and no result was reported for it.
    Expired,
    /// The replay contradicts the columns of the lease.
    NotAsClaimed,
}

impl RefusalCode {
    /// The word that is sent to clients and used as the label of metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::BadId => "bad_id",
            Self::UnknownEpisode => "unknown_episode",
            Self::ForeignEpisode => "foreign_episode",
            Self::InvalidResult => "invalid_result",
            Self::InvalidLog => "invalid_log",
            Self::Conflict => "conflict",
            Self::OtherVersion => "other_version",
            Self::Expired => "expired",
            Self::NotAsClaimed => "not_as_claimed",
        }
    }
}

/// A refusal of one reported episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Reason for programs.
    pub code: RefusalCode,
    /// Reason for people, one sentence.
    pub detail: String,
}

impl Refusal {
    /// Builds a refusal.
    pub fn new(code: RefusalCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }
}
