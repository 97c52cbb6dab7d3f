//! Results of critique jobs.

use store::critiques::CritiqueJob;

use crate::critiques::profile::EpisodeFindings;

/// Result of a critique job.
#[derive(Debug)]
pub struct CritiqueResult {
    /// Job that was criticised.
    pub job: CritiqueJob,
    /// Findings, one for each criticised episode.
    pub findings: Vec<EpisodeFindings>,
    /// Number of episodes that sampling left out.
    pub skipped: i64,
    /// Number of episodes that could not be criticised.
    pub failed: i64,
    /// Reason of the first failure.
    pub reason: Option<String>,
}
