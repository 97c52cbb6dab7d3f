//! Receipts: what the server did with each reported episode.

use api_types::{ReceiptStatus, RefusalCode, ResultReceipt};

use crate::results::audit_outcome::AuditOutcome;
use crate::results::refusal::Refusal;

/// Builds the receipt of a refused episode.
pub(crate) fn refused_receipt(episode: String, refusal: Refusal) -> ResultReceipt {
    ResultReceipt {
        episode,
        status: ReceiptStatus::Refused,
        code: Some(refusal.code),
        detail: Some(refusal.detail),
        score: None,
        skill: None,
        success: None,
    }
}

/// Builds the receipt of an episode that is not stored.
pub(crate) fn unstored_receipt(episode: String, outcome: AuditOutcome) -> ResultReceipt {
    match outcome {
        AuditOutcome::Refused(refusal) => refused_receipt(episode, refusal),
        AuditOutcome::Known { score, skill, success } => ResultReceipt {
            episode,
            status: ReceiptStatus::Duplicate,
            code: None,
            detail: None,
            score,
            skill,
            success,
        },
        AuditOutcome::Replayed(_) | AuditOutcome::Failed(_) => {
            refused_receipt(episode, Refusal::new(RefusalCode::UnknownEpisode, "it has no place"))
        }
    }
}
