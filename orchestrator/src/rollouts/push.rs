//! Counting a group that was flown and pushing it to the feed: both, or neither.

use crate::results::receipt_status::ReceiptStatus;
use crate::rollouts::trajectory_group::PackedGroup;
use crate::rollouts::rollout_lease::ReturnRolloutLease;
use crate::metrics;
use crate::ids::LeaseId;
use crate::store::trajectories::{self, NewTrajectoryGroup};
use crate::store::run_policies::{self, RolloutCounts, TokenCounts};
use crate::store::to_i64;
use crate::results::report::StoreResults;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Milliseconds of a day.
const DAY: i64 = 86_400_000;

/// What a language model took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ModelUsage {
    /// Prompt tokens.
    pub tokens_in: u64,
    /// Completion tokens.
    pub tokens_out: u64,
    /// What they cost.
    pub cost: f64,
}

/// A group that was flown.
#[derive(Debug)]
pub struct PushGroup {
    /// Its lease.
    pub lease: LeaseId,
    /// The policy version it was taken for.
    pub policy_version: i64,
    /// Its episodes, replayed.
    pub report: StoreResults,
    /// What is told of it; none where too few were flown.
    pub packed: Option<PackedGroup>,
    /// Episodes flown, and lost.
    pub episodes: (usize, usize),
    /// What went wrong, where something did.
    pub trouble: Option<String>,
    /// What it took.
    pub took: ModelUsage,
}

impl Change for PushGroup {
    /// Its id in the feed; none where it is not there: too few episodes were flown, or its lease was over.
    type Output = Option<i64>;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<i64>, ServiceError> {
        let Self { lease, policy_version, report, packed, episodes, trouble, took } = self;
        let run = report.run.to_string();
        let receipts = report.apply(tx).await?.receipts;
        let refused = receipts.iter().find(|receipt| receipt.status == ReceiptStatus::Refused);
        if let Some(receipt) = refused {
            let detail = receipt.detail.clone().unwrap_or_default();
            return Err(ServiceError::invalid("rollout", format!("{}: {detail}", receipt.episode)));
        }
        // What comes when its lease is over counts for nothing, and its scenario is offered again.
        let late = receipts.iter().any(|receipt| receipt.status == ReceiptStatus::Late);
        let (flown, lost) = (count(episodes.0), count(episodes.1));
        let (now, conn) = (tx.now, &mut tx.conn);
        let id = match packed.filter(|_| !late) {
            None => None,
            Some(PackedGroup { bytes, body }) => {
                let (run, bytes) = (run.as_str(), count(bytes));
                let group =
                    NewTrajectoryGroup { run, lease: lease.number, number: 0, policy_version, bytes, body: &body };
                Some(trajectories::push(conn, &group, now).await?)
            }
        };
        let pushed = match id {
            Some(_) => RolloutCounts { groups: 1, episodes: flown, failed: lost },
            None => RolloutCounts { groups: 0, episodes: 0, failed: lost },
        };
        run_policies::add_rollouts(conn, &run, pushed).await?;
        if took != ModelUsage::default() {
            let tokens =
                TokenCounts { tokens_in: to_i64(took.tokens_in), tokens_out: to_i64(took.tokens_out) };
            run_policies::add_spend(conn, &run, now.div_euclid(DAY), tokens, took.cost).await?;
        }
        let late = late.then(|| "its lease was over before the group was flown".to_owned());
        if let Some(words) = trouble.or(late) {
            run_policies::set_trouble(conn, &run, &words, now).await?;
            tx.emit(&run, &RunEvent::Health { task: None, words: &words })?;
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
