//! Keeping a run's queue of proposals filled, some way ahead of what is leased.

use super::TrainingError;
use super::work::Work;
use crate::store::{from_json, proposals, unsigned};
use curriculum::Proposal;

/// Proposals that wait while nobody asks for more.
pub(super) const AHEAD: u32 = 64;

/// Proposes until `want` proposals wait. When this happens depends on the changes alone, never on workers: a restarted
/// server proposes what it would have proposed.
pub(super) async fn fill(work: &mut Work, run: &str, want: u32) -> Result<(), TrainingError> {
    let now = work.now;
    let (mind, conn) = work.mind(run).await?;
    let waiting = proposals::waiting(conn, run).await?;
    let missing = i64::from(want) - waiting;
    if missing > 0 {
        mind.propose(conn, now, unsigned(missing)).await?;
        work.wake_prepare();
    }
    Ok(())
}

/// Drops all that waits, and fills up by the settings that are in force now.
pub(super) async fn renew(work: &mut Work, run: &str) -> Result<(), TrainingError> {
    let (_, conn) = work.mind(run).await?;
    let waiting: Vec<i64> =
        proposals::head(conn, run, i64::MAX).await?.into_iter().map(|queued| queued.seq).collect();
    proposals::discard(conn, run, &waiting).await?;
    fill(work, run, AHEAD).await
}

/// Drops what a move made stale, and fills up again.
pub(super) async fn refresh(work: &mut Work, run: &str) -> Result<(), TrainingError> {
    let (mind, conn) = work.mind(run).await?;
    let mut stale = Vec::new();
    for queued in proposals::head(conn, run, i64::MAX).await? {
        let proposal: Proposal = from_json("a proposal", &queued.body)?;
        if !mind.curriculum.is_current(unsigned(queued.seq), &proposal) {
            stale.push(queued.seq);
        }
    }
    proposals::discard(conn, run, &stale).await?;
    fill(work, run, AHEAD).await
}
