//! Queue of a run's proposals: it is kept filled, so that scenarios are prepared before they are leased.

use store::{from_json, leases, proposals, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::signals::Signal;
use curriculum::Proposal;

/// Least and largest number of proposals that wait while no lease asks for more.
const TARGETS: (i64, i64) = (8, 64);
/// Number of waiting proposals for each group that trainers hold. A longer queue would cost preparations that no trainer may ever
/// need, and would serve proposals that know less of the latest outcomes.
const WAITING_PER_HELD_GROUP: i64 = 4;

/// Proposes until as many proposals wait as the trainers of the run need.
pub(crate) async fn fill(run: &mut RunTx<'_>) -> Result<(), ServiceError> {
    fill_at_least(run, 0).await
}

/// Proposes until as many proposals wait as the trainers of the run need, and at least `want`. The moment of a proposal depends only
/// on the sequence of changes, never on workers: a restarted server proposes what it would have proposed.
pub(crate) async fn fill_at_least(run: &mut RunTx<'_>, want: u32) -> Result<(), ServiceError> {
    let waiting = proposals::count_waiting(run.conn, &run.state.run).await?;
    let held = leases::active_groups(run.conn, &run.state.run).await?;
    let target = held.saturating_mul(WAITING_PER_HELD_GROUP).clamp(TARGETS.0, TARGETS.1);
    let missing = target.max(i64::from(want)) - waiting;
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
    fill(run).await
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
    fill(run).await
}
