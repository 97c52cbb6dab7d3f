//! Rows of audited episodes, and the comparison of a repeated report with the stored row.

use api_types::{ReceiptStatus, RefusalCode, ResultReceipt};
use store::brackets::StoredOutcome;
use store::episodes::{EpisodeRow, EpisodeState, ReportedResult};
use store::keys::EpisodeKey;
use store::to_json;

use crate::engine::error::ServiceError;
use crate::results::audit_outcome::{AuditOutcome, ReplayedEpisode};
use crate::results::receipt::refused_receipt;
use crate::results::refusal::Refusal;

/// Builds the row of an episode. Policy version and metrics are left to the caller.
pub(crate) fn episode_row(
    key: EpisodeKey,
    outcome: &AuditOutcome,
    is_late: bool,
    digest: Vec<u8>,
    at: i64,
) -> Result<EpisodeRow, ServiceError> {
    let in_time = |state| if is_late { EpisodeState::Late } else { state };
    let mut row = EpisodeRow {
        lease: key.lease,
        number: key.number,
        state: in_time(EpisodeState::Finished),
        digest,
        score: None,
        success: None,
        skill: None,
        floor: None,
        reference: None,
        planner_version: None,
        outcome: None,
        policy_version: 0,
        reason: None,
        metrics: None,
        at,
    };
    match outcome {
        AuditOutcome::Replayed(replayed) => {
            let ReplayedEpisode { outcome, skill, is_success, floor, reference, planner, .. } = replayed;
            row.score = Some(outcome.score);
            row.success = Some(*is_success);
            row.skill = *skill;
            row.floor = Some(*floor);
            row.reference = Some(*reference);
            row.planner_version = Some(i64::from(*planner));
            row.outcome = Some(to_json(&StoredOutcome::from(*outcome))?);
        }
        AuditOutcome::Failed(reason) => {
            row.state = in_time(EpisodeState::Failed);
            row.reason = Some(reason.clone());
        }
        AuditOutcome::Refused(_) | AuditOutcome::Known { .. } => {}
    }
    Ok(row)
}

/// Receipt of an episode that was reported before: a duplicate if the result is the same, else a conflict.
pub(crate) fn duplicate_receipt(episode: String, earlier: &ReportedResult, digest: &[u8]) -> ResultReceipt {
    if earlier.digest == digest {
        ResultReceipt {
            episode,
            status: ReceiptStatus::Duplicate,
            code: None,
            detail: None,
            score: earlier.score,
            skill: earlier.skill,
            success: earlier.success,
        }
    } else {
        let detail = "the episode already has a different result, which was kept";
        refused_receipt(episode, Refusal::new(RefusalCode::Conflict, detail))
    }
}

/// Digest of a result: of the action log, or of the reason of a failure.
pub(crate) fn result_digest(outcome: &AuditOutcome) -> Vec<u8> {
    let digest = match outcome {
        AuditOutcome::Replayed(replayed) => replayed.log.digest,
        AuditOutcome::Failed(reason) => store::digest(reason.as_bytes()),
        AuditOutcome::Refused(refusal) => store::digest(refusal.detail.as_bytes()),
        AuditOutcome::Known { .. } => store::digest(&[]),
    };
    digest.to_vec()
}
