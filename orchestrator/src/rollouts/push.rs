//! Counts a group that was rolled out and pushes it to the feed, in one transaction.

use api_types::ReceiptStatus;
use store::ids::LeaseId;
use store::run_policies::{self, RolloutCounts, TokenCounts};
use store::to_i64;
use store::trajectories::{self, NewTrajectoryGroup};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use crate::results::report::StoreResults;
use crate::rollouts::packed_group::PackedGroup;
use crate::rollouts::rollout_lease::ReturnRolloutLease;

/// Length of a day in milliseconds.
const DAY_MS: i64 = 86_400_000;

/// Tokens and cost of a language model.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ModelUsage {
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Cost of the tokens, in the currency of the configured prices.
    pub cost: f64,
}

/// Pushes a group that was rolled out.
#[derive(Debug)]
pub struct PushGroup {
    /// Id of the group's lease.
    pub lease: LeaseId,
    /// The policy version that the lease was taken for.
    pub policy_version: i64,
    /// Results of the episodes, replayed.
    pub report: StoreResults,
    /// The group for the feed; `None` if it is not delivered.
    pub packed: Option<PackedGroup>,
    /// Number of episodes that finished.
    pub finished: usize,
    /// Number of episodes that the infrastructure lost.
    pub lost: usize,
    /// Why an episode was lost, if one was.
    pub error: Option<String>,
    /// Tokens and cost of the episodes.
    pub usage: ModelUsage,
}

impl Change for PushGroup {
    /// Id of the group in the feed; `None` if it is not delivered or its lease was over.
    type Output = Option<i64>;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<i64>, ServiceError> {
        let Self { lease, policy_version, report, packed, finished, lost, error, usage } = self;
        let run = report.run.to_string();
        let receipts = report.apply(tx).await?.receipts;
        let refused = receipts.iter().find(|receipt| receipt.status == ReceiptStatus::Refused);
        if let Some(receipt) = refused {
            let detail = receipt.detail.clone().unwrap_or_default();
            return Err(ServiceError::invalid("rollout", format!("{}: {detail}", receipt.episode)));
        }
        // Results after the end of the lease do not count; the scenario is offered again.
        let is_late = receipts.iter().any(|receipt| receipt.status == ReceiptStatus::Late);
        let (finished, lost) = (count(finished), count(lost));
        let (now, conn) = (tx.now, &mut tx.conn);
        let id = match packed.filter(|_| !is_late) {
            None => None,
            Some(PackedGroup { bytes, body }) => {
                let (run, bytes) = (run.as_str(), count(bytes));
                let group = NewTrajectoryGroup {
                    run,
                    lease: lease.number,
                    number: 0,
                    policy_version,
                    bytes,
                    body: &body,
                };
                Some(trajectories::push(conn, &group, now).await?)
            }
        };
        let pushed = match id {
            Some(_) => RolloutCounts { groups: 1, episodes: finished, failed: lost },
            None => RolloutCounts { groups: 0, episodes: 0, failed: lost },
        };
        run_policies::add_rollouts(conn, &run, pushed).await?;
        if usage != ModelUsage::default() {
            let tokens =
                TokenCounts { tokens_in: to_i64(usage.tokens_in), tokens_out: to_i64(usage.tokens_out) };
            run_policies::add_spend(conn, &run, now.div_euclid(DAY_MS), tokens, usage.cost).await?;
        }
        let late = is_late.then(|| "a lease ended before its group was rolled out".to_owned());
        if let Some(error) = error.or(late) {
            run_policies::set_error(conn, &run, &error, now).await?;
            tx.emit(&run, &RunEvent::Warning { task: None, message: &error })?;
        }
        ReturnRolloutLease(lease).apply(tx).await?;
        if id.is_some() {
            metrics::record_rollout_group();
            tx.outbox.signal(Signal::Feed);
        }
        Ok(id)
    }
}

fn count(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}
