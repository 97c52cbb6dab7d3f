//! Pulling groups from a run's feed, and acknowledging them: each is delivered until it is acknowledged.

use crate::ids::RunId;
use crate::store::trajectories::{self, HeadRow};
use crate::training::{Change, TrainingError, Work};

/// Bytes of groups as JSON in one answer; one group there always is.
pub const MOST_ANSWERED: i64 = 32 << 20;
/// Bytes that the groups of a run may take unacknowledged, as stored.
pub const MOST_WAITING: i64 = 256 << 20;
/// Acknowledged groups of a run that are kept, and their bytes as stored.
const KEPT: (i64, i64) = (256, 256 << 20);

/// As many of these groups as one answer may have.
#[must_use]
pub fn fitting(heads: Vec<HeadRow>) -> Vec<HeadRow> {
    let mut total = 0;
    let fits = |(at, head): &(usize, HeadRow)| {
        total += head.bytes;
        *at == 0 || total <= MOST_ANSWERED
    };
    heads.into_iter().enumerate().take_while(fits).map(|(_, head)| head).collect()
}

/// Claims groups for a time.
#[derive(Debug)]
pub struct Deliver {
    /// Of which run.
    pub run: RunId,
    /// How many at most.
    pub limit: i64,
    /// For how long they are not delivered to others, milliseconds.
    pub ttl_ms: i64,
}

impl Change for Deliver {
    /// What was claimed, in order.
    type Answer = Vec<HeadRow>;

    async fn apply(self, work: &mut Work) -> Result<Vec<HeadRow>, TrainingError> {
        let (now, conn) = (work.now, &mut work.conn);
        let mut heads = fitting(trajectories::visible(conn, self.run.as_str(), now, self.limit).await?);
        for head in &mut heads {
            trajectories::deliver(conn, head.id, now + self.ttl_ms).await?;
            head.deliveries += 1;
        }
        Ok(heads)
    }
}

/// Acknowledges groups: they are not delivered again. Doing so twice is the same as once.
#[derive(Debug)]
pub struct Ack {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub ids: Vec<i64>,
}

impl Change for Ack {
    /// Those that are acknowledged, and those that the run does not have (any more).
    type Answer = (Vec<i64>, Vec<i64>);

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        let (mut acked, mut unknown) = (Vec::new(), Vec::new());
        for id in self.ids {
            let known = trajectories::ack(&mut work.conn, self.run.as_str(), id).await?;
            if known { &mut acked } else { &mut unknown }.push(id);
        }
        trajectories::trim(&mut work.conn, self.run.as_str(), KEPT).await?;
        work.wake_rollout();
        Ok((acked, unknown))
    }
}
