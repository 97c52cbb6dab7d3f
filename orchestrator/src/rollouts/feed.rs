//! Delivers groups of a run's feed, and acknowledges them. A group is delivered again until it is acknowledged.

use store::ids::RunId;
use store::trajectories::{self, AckedLimit, FeedGroup};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;

/// Maximum size of the groups in one answer, in bytes of JSON. A single group may be larger.
pub const MAX_ANSWER_BYTES: i64 = 32 << 20;
/// Size of a run's unacknowledged groups as stored, in bytes, from which no more are rolled out.
pub const MAX_UNACKED_BYTES: i64 = 256 << 20;
/// Acknowledged groups of a run that are kept, and their bytes as stored.
const ACKED_LIMIT: AckedLimit = AckedLimit { groups: 256, bytes: 256 << 20 };

/// Returns the first groups that fit in one answer, at least one.
#[must_use]
pub fn limit_bytes(groups: Vec<FeedGroup>) -> Vec<FeedGroup> {
    let mut total = 0;
    let fits = |(at, group): &(usize, FeedGroup)| {
        total += group.bytes;
        *at == 0 || total <= MAX_ANSWER_BYTES
    };
    groups.into_iter().enumerate().take_while(fits).map(|(_, group)| group).collect()
}

/// Claims groups for delivery, for a limited time.
#[derive(Debug)]
pub struct DeliverGroups {
    /// Id of the run.
    pub run: RunId,
    /// Maximum number of groups.
    pub limit: i64,
    /// How long the groups are not delivered again, in milliseconds.
    pub ttl_ms: i64,
}

impl Change for DeliverGroups {
    /// Claimed groups, in order of the feed.
    type Output = Vec<FeedGroup>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Vec<FeedGroup>, ServiceError> {
        tx.run(self.run.as_str()).await?;
        let (now, conn) = (tx.now, &mut tx.conn);
        let mut groups =
            limit_bytes(trajectories::deliverable(conn, self.run.as_str(), now, self.limit).await?);
        for group in &mut groups {
            trajectories::set_delivered(conn, group.id, now + self.ttl_ms).await?;
            group.deliveries += 1;
        }
        Ok(groups)
    }
}

/// Acknowledges groups: they are not delivered again. Repeating it has no effect.
#[derive(Debug)]
pub struct AcknowledgeGroups {
    /// Id of the run.
    pub run: RunId,
    /// Ids of the groups.
    pub ids: Vec<i64>,
}

/// Result of an acknowledgement.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AcknowledgedGroups {
    /// Ids of groups that are acknowledged now, or were before.
    pub acknowledged: Vec<i64>,
    /// Ids of groups that the run does not have, or no longer has.
    pub unknown: Vec<i64>,
}

impl Change for AcknowledgeGroups {
    type Output = AcknowledgedGroups;

    async fn apply(self, tx: &mut WriteTx) -> Result<AcknowledgedGroups, ServiceError> {
        let AcknowledgedGroups { acknowledged: mut acked, mut unknown } = AcknowledgedGroups::default();
        for id in self.ids {
            let is_known = trajectories::ack(&mut tx.conn, self.run.as_str(), id).await?;
            if is_known { &mut acked } else { &mut unknown }.push(id);
        }
        trajectories::trim_acked(&mut tx.conn, self.run.as_str(), ACKED_LIMIT).await?;
        tx.outbox.signal(Signal::Rollout);
        Ok(AcknowledgedGroups { acknowledged: acked, unknown })
    }
}
