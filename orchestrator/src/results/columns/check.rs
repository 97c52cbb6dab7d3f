//! Compares audited episodes with their claimed scores.

use store::episodes::EpisodeRow;
use store::groups::GroupRow;

use crate::results::score_tolerance;

/// Outcome of comparing an audited episode with its claim.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum AuditCheck {
    /// The replay agrees with the claim.
    Agrees,
    /// The episode failed, as claimed: no log is due.
    Failed,
    /// The replay contradicts the claim, for the reason in this sentence.
    Differs(String),
}

/// Compares an audited episode with its claimed score; `None` if it is claimed to have failed.
pub(crate) fn check_episode(claimed: Option<f64>, group: &GroupRow, row: &EpisodeRow) -> AuditCheck {
    let (claimed, score) = match (claimed, row.score) {
        (Some(claimed), Some(score)) => (claimed, score),
        (None, None) => return AuditCheck::Failed,
        (Some(_), None) => {
            return AuditCheck::Differs("the report is failed, but the claim is finished".to_owned());
        }
        (None, Some(_)) => {
            return AuditCheck::Differs("the report is finished, but the claim is failed".to_owned());
        }
    };
    if (score - claimed).abs() <= score_tolerance(&group.task) {
        AuditCheck::Agrees
    } else {
        AuditCheck::Differs(format!("the log replays to the score {score:.6}, but the claim is {claimed:.6}"))
    }
}
