//! Pulling groups from a run's feed, and acknowledging them: each is delivered until it is acknowledged.

use crate::ids::RunId;
use crate::store::trajectories::{self, AckedLimit, FeedGroup};
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Bytes of groups as JSON in one answer; one group there always is.
pub const MOST_ANSWERED: i64 = 32 << 20;
/// Bytes that the groups of a run may take unacknowledged, as stored.
pub const MOST_WAITING: i64 = 256 << 20;
/// Acknowledged groups of a run that are kept, and their bytes as stored.
const KEPT: AckedLimit = AckedLimit { groups: 256, bytes: 256 << 20 };

/// As many of these groups as one answer may have.
#[must_use]
pub fn fitting(heads: Vec<FeedGroup>) -> Vec<FeedGroup> {
    let mut total = 0;
    let fits = |(at, head): &(usize, FeedGroup)| {
        total += head.bytes;
        *at == 0 || total <= MOST_ANSWERED
    };
    heads.into_iter().enumerate().take_while(fits).map(|(_, head)| head).collect()
}

/// Claims groups for a time.
#[derive(Debug)]
pub struct DeliverGroups {
    /// Of which run.
    pub run: RunId,
    /// How many at most.
    pub limit: i64,
    /// For how long they are not delivered to others, milliseconds.
    pub ttl_ms: i64,
}

impl Change for DeliverGroups {
    /// What was claimed, in order.
    type Output = Vec<FeedGroup>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Vec<FeedGroup>, ServiceError> {
        let (now, conn) = (tx.now, &mut tx.conn);
        let mut heads = fitting(trajectories::deliverable(conn, self.run.as_str(), now, self.limit).await?);
        for head in &mut heads {
            trajectories::set_delivered(conn, head.id, now + self.ttl_ms).await?;
            head.deliveries += 1;
        }
        Ok(heads)
    }
}

/// Acknowledges groups: they are not delivered again. Doing so twice is the same as once.
#[derive(Debug)]
pub struct AcknowledgeGroups {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub ids: Vec<i64>,
}

impl Change for AcknowledgeGroups {
    /// Those that are acknowledged, and those that the run does not have (any more).
    type Output = (Vec<i64>, Vec<i64>);

    async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
        let (mut acked, mut unknown) = (Vec::new(), Vec::new());
        for id in self.ids {
            let known = trajectories::ack(&mut tx.conn, self.run.as_str(), id).await?;
            if known { &mut acked } else { &mut unknown }.push(id);
        }
        trajectories::trim_acked(&mut tx.conn, self.run.as_str(), KEPT).await?;
        tx.outbox.signal(Signal::Rollout);
        Ok((acked, unknown))
    }
}
