//! Learning signals of closed groups, which decide the share of designed groups.

use store::groups::{GroupRole, GroupRow};
use store::leases::{LeaseRow, Purpose};
use store::{StoreError, learning_signals, to_u32};

use crate::designs::learning_value::{SignalGroup, add_group};
use crate::engine::run_tx::RunTx;

/// Adds closed groups of a training lease to the signals of a run with designs. Groups whose rung a sampler draws uniformly are left
/// out: no layout can replace their scenarios.
pub(crate) async fn add_closed_groups(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    closing: &[GroupRow],
) -> Result<(), StoreError> {
    let is_compared = |group: &&GroupRow| group.finished > 0 && group.role != GroupRole::Coverage;
    let compared: Vec<&GroupRow> = closing.iter().filter(is_compared).collect();
    let is_training = lease.purpose == Purpose::Train && !lease.is_columns();
    if compared.is_empty() || !is_training || !run.state.settings.design.is_enabled() {
        return Ok(());
    }
    let mut sums = learning_signals::get(run.conn, &lease.run).await?;
    for group in compared {
        let is_designed = group.layout.is_some();
        let (finished, successes) = (to_u32(group.finished), to_u32(group.successes));
        add_group(&mut sums, SignalGroup { is_designed, finished, successes });
    }
    learning_signals::set(run.conn, &lease.run, &sums).await
}
