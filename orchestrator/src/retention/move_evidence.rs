//! Proposals whose outcomes are evidence of level moves.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use ::curriculum::MoveEvidence;
use store::groups::{GroupRole, GroupRow};
use store::retention::{self, ProposalSpan};
use store::{curriculum, from_json, to_u64};

/// Spans of proposals whose outcomes are evidence of level moves, including moves that are yet to come. For each task they go up to
/// the first move after the last proposal in question: an outcome is evidence for the next move of its task, or for none.
pub(super) struct MoveEvidenceSpans {
    /// Ranges of sequence numbers, by task.
    spans: BTreeMap<String, Vec<Range<u64>>>,
}

impl MoveEvidenceSpans {
    /// Loads the spans that the proposals of these leases may be in.
    pub(super) async fn load(tx: &mut WriteTx, run: &str, leases: &[i64]) -> Result<Self, ServiceError> {
        let mut spans = BTreeMap::<String, Vec<Range<u64>>>::new();
        for ProposalSpan { task, first, last } in retention::proposal_spans(&mut tx.conn, leases).await? {
            let mut previous = 0;
            for level_move in curriculum::moves_around(&mut tx.conn, run, &task, first, last).await? {
                let evidence: MoveEvidence = from_json("a move's evidence", &level_move.evidence)?;
                let (start, end) = (evidence.earliest_proposal().unwrap_or(previous), to_u64(level_move.seq));
                spans.entry(task.clone()).or_default().push(start..end);
                previous = end;
            }
        }
        for status in tx.run(run).await?.state.curriculum.status() {
            if let Some(start) = status.earliest_proposal {
                spans.entry(status.task).or_default().push(start..u64::MAX);
            }
        }
        Ok(Self { spans })
    }

    /// Returns true if a group may be evidence of a level move.
    pub(super) fn contain(&self, group: &GroupRow) -> bool {
        let Some(seq) = group.proposal.map(to_u64) else { return false };
        group.is_evidence
            && group.is_contested
            && matches!(group.role, GroupRole::Placement | GroupRole::Frontier)
            && self.spans.get(&group.task).is_some_and(|spans| spans.iter().any(|span| span.contains(&seq)))
    }
}
