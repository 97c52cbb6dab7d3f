//! Receipts: what the server did with each reported episode.

use crate::results::audit_outcome::AuditOutcome;
use crate::results::receipt_status::ReceiptStatus;
use crate::results::refusal::{Refusal, RefusalCode};

/// Receipt of one reported episode.
#[derive(Debug, Clone, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct Receipt {
    /// Episode id, as it was sent.
    pub episode: String,
    /// `counted` (the group can move the curriculum: mastery, or the state of the strategy), `stored` (kept as a statistic: an
    /// evaluation, a designed layout, or a policy that is too old), `audited` (the replay agrees with the columns; the episode counts
    /// once all audited ones are in), `failed`, `late` (the lease was over), `duplicate` (the same result was reported before), `refused`.
    #[schema(value_type = String)]
    pub status: ReceiptStatus,
    /// Reason of a refusal: `bad_id`, `unknown_episode`, `foreign_episode`, `invalid_result` (its fields), `invalid_log`,
    /// `conflict`, `other_version` (an evaluation has one policy version), `expired` (never reported, and the run no longer keeps its
    /// scenario), `not_as_claimed` (the columns of the lease said otherwise and are refused).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub code: Option<RefusalCode>,
    /// Reason of a refusal for people, one sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// Score of the replay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Skill between floor (0) and reference (1), if the scenario defines one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skill: Option<f64>,
    /// True if the episode was a success by the run's rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<bool>,
}

impl Receipt {
    /// Receipt of a refused episode.
    pub(crate) fn refused(episode: String, refusal: Refusal) -> Self {
        Self {
            episode,
            status: ReceiptStatus::Refused,
            code: Some(refusal.code),
            detail: Some(refusal.detail),
            score: None,
            skill: None,
            success: None,
        }
    }

    /// Receipt of an episode that is not stored.
    pub(crate) fn unstored(episode: String, outcome: AuditOutcome) -> Self {
        match outcome {
            AuditOutcome::Refused(refusal) => Self::refused(episode, refusal),
            AuditOutcome::Known { score, skill, success } => Self {
                episode,
                status: ReceiptStatus::Duplicate,
                code: None,
                detail: None,
                score,
                skill,
                success,
            },
            AuditOutcome::Replayed(_) | AuditOutcome::Failed(_) => {
                Self::refused(episode, Refusal::new(RefusalCode::UnknownEpisode, "it has no place"))
            }
        }
    }
}
