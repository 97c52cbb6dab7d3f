//! Why the server refuses a reported episode.

use api_types::RefusalCode;

/// A refusal of one reported episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Machine-readable reason of the refusal.
    pub code: RefusalCode,
    /// Reason for people, one sentence.
    pub detail: String,
}

impl Refusal {
    /// Builds a refusal from its parts.
    pub fn new(code: RefusalCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }
}
