//! One round for one feed: acknowledges, removes, publishes.

use std::collections::BTreeSet;

use job_queue::nats::NatsError;
use job_queue::nats::feed::{FeedError, FeedMessage, FeedStream};
use sqlx::SqlitePool;
use store::StoreError;
use store::ids::{InvalidId, RunId};
use store::trajectories::{self, FeedGroup};

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::rollouts::feed::AcknowledgeGroups;
use crate::rollouts::packed_group::feed_group_json;

/// Largest number of groups of a run that are published before those of other runs.
const MAX_PUBLISHED: usize = 16;

/// Parts that a round needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct FeedRound<'a> {
    /// Pool of connections that read.
    pub(super) readers: &'a SqlitePool,
    /// Writer that acknowledges groups.
    pub(super) writer: &'a Writer,
    /// Id of the run.
    pub(super) run: &'a str,
}

/// Error of a round.
pub(super) enum RoundError {
    /// NATS failed, or the stream is not usable.
    Feed(FeedError),
    /// The database cannot be used.
    Service(ServiceError),
}

impl From<FeedError> for RoundError {
    fn from(error: FeedError) -> Self {
        Self::Feed(error)
    }
}

impl From<NatsError> for RoundError {
    fn from(error: NatsError) -> Self {
        Self::Feed(error.into())
    }
}

impl From<ServiceError> for RoundError {
    fn from(error: ServiceError) -> Self {
        Self::Service(error)
    }
}

impl From<StoreError> for RoundError {
    fn from(error: StoreError) -> Self {
        Self::Service(error.into())
    }
}

impl FeedRound<'_> {
    /// Brings a stream up to date. With `is_poll` it reads acknowledgements first. Returns the number of groups that it did not publish.
    pub(super) async fn run(self, feed: &mut FeedStream, is_poll: bool) -> Result<usize, RoundError> {
        let mut waiting = {
            let mut conn = self.readers.acquire().await.map_err(StoreError::from)?;
            trajectories::unacknowledged(&mut conn, self.run).await?
        };
        if is_poll && !feed.is_empty() {
            self.acknowledge(feed, &mut waiting).await?;
        }
        feed.retain(&waiting.iter().map(|group| group.id).collect()).await?;
        self.publish(feed, waiting).await
    }

    /// Acknowledges in the database what all consumers have acknowledged, and removes it from `waiting`.
    async fn acknowledge(self, feed: &FeedStream, waiting: &mut Vec<FeedGroup>) -> Result<(), RoundError> {
        let acknowledged: BTreeSet<i64> = feed.acknowledged().await?.into_iter().collect();
        let ids: Vec<i64> =
            waiting.iter().map(|group| group.id).filter(|id| acknowledged.contains(id)).collect();
        if ids.is_empty() {
            return Ok(());
        }
        let run: Result<RunId, InvalidId> = self.run.parse();
        let run = run.map_err(|error| ServiceError::invalid("run", error.to_string()))?;
        self.writer.change(AcknowledgeGroups { run, ids }).await?;
        waiting.retain(|group| !acknowledged.contains(&group.id));
        Ok(())
    }

    /// Publishes the first groups that the stream lacks. Returns the number of those that are left.
    async fn publish(self, feed: &mut FeedStream, waiting: Vec<FeedGroup>) -> Result<usize, RoundError> {
        let published = feed.ids();
        let missing: Vec<FeedGroup> =
            waiting.into_iter().filter(|group| !published.contains(&group.id)).collect();
        for group in missing.iter().take(MAX_PUBLISHED) {
            let body = {
                let mut conn = self.readers.acquire().await.map_err(StoreError::from)?;
                trajectories::body(&mut conn, group.id).await?
            };
            let Some(body) = body else { continue }; // it was acknowledged and deleted meanwhile
            let head = *group;
            let unreadable = |reason: String| FeedError::Unreadable { id: head.id, reason };
            let json = tokio::task::spawn_blocking(move || feed_group_json(head, &body)).await;
            let json = json.map_err(|error| unreadable(error.to_string()))?;
            let json = json.map_err(|error| unreadable(error.to_string()))?;
            feed.publish(FeedMessage { id: head.id, json }).await?;
        }
        Ok(missing.len().saturating_sub(MAX_PUBLISHED))
    }
}
