//! What the server did with a reported episode, in one word.

/// What the server did with one reported episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReceiptStatus {
    /// The episode counts, and its group can move the curriculum.
    Counted,
    /// The episode is kept as a statistic only.
    Stored,
    /// The replay agrees with the columns of its lease.
    Audited,
    /// The infrastructure lost the episode.
    Failed,
    /// The lease had ended.
    Late,
    /// The same result was reported before.
    Duplicate,
    /// The result was refused.
    Refused,
}

impl ReceiptStatus {
    /// All values, in the order of their declaration.
    pub const ALL: [Self; 7] = [
        Self::Counted,
        Self::Stored,
        Self::Audited,
        Self::Failed,
        Self::Late,
        Self::Duplicate,
        Self::Refused,
    ];

    /// The word that is sent to clients and used as the label of metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Counted => "counted",
            Self::Stored => "stored",
            Self::Audited => "audited",
            Self::Failed => "failed",
            Self::Late => "late",
            Self::Duplicate => "duplicate",
            Self::Refused => "refused",
        }
    }
}
