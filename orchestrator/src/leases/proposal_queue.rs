//! Queue of a run's proposals: it is kept filled, so that scenarios are prepared before they are leased.

use store::{from_json, proposals, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::signals::Signal;
use curriculum::Proposal;

/// Number of proposals that wait while no lease asks for more.
pub(crate) const QUEUE_TARGET: u32 = 64;

/// Proposes until `want` proposals wait. The moment of a proposal depends only on the sequence of changes, never on workers: a
/// restarted server proposes what it would have proposed.
pub(crate) async fn fill(run: &mut RunTx<'_>, want: u32) -> Result<(), ServiceError> {
    let waiting = proposals::count_waiting(run.conn, &run.state.run).await?;
    let missing = i64::from(want) - waiting;
    if missing > 0 {
        run.state.propose(run.conn, run.now, to_u64(missing)).await?;
        run.outbox.signal(Signal::Prepare);
    }
    Ok(())
}

/// Discards all waiting proposals and proposes anew under the settings in force.
pub(crate) async fn rebuild(run: &mut RunTx<'_>) -> Result<(), ServiceError> {
    let waiting = proposals::head(run.conn, &run.state.run, i64::MAX).await?;
    let waiting: Vec<i64> = waiting.into_iter().map(|queued| queued.seq).collect();
    proposals::drop_all(run.conn, &run.state.run, &waiting).await?;
    fill(run, QUEUE_TARGET).await
}

/// Discards the proposals that a level move made stale, and fills the queue again.
pub(crate) async fn drop_stale(run: &mut RunTx<'_>) -> Result<(), ServiceError> {
    let mut stale = Vec::new();
    for queued in proposals::head(run.conn, &run.state.run, i64::MAX).await? {
        let proposal: Proposal = from_json("a proposal", &queued.body)?;
        if !run.state.curriculum.is_current(to_u64(queued.seq), &proposal) {
            stale.push(queued.seq);
        }
    }
    proposals::drop_all(run.conn, &run.state.run, &stale).await?;
    fill(run, QUEUE_TARGET).await
}
