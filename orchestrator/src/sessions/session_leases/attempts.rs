//! Attempts at the episodes of a lease: groups are begun as sessions run them, and an episode that a session leaves is counted.

use std::sync::Arc;

use super::{SessionLeases, SharedPool};
use crate::engine::error::ServiceError;
use crate::leases::begin::BeginGroups;
use crate::ownership::Actor;
use crate::sessions::abandon::AbandonEpisodes;

impl SessionLeases {
    /// Begins groups of a task until `wanted` of its episodes can be taken, or no group is left.
    ///
    /// # Errors
    /// Returns the error of [`BeginGroups`].
    pub(in crate::sessions) async fn begin_for_task(
        &self,
        pool: &SharedPool,
        task: &str,
        wanted: usize,
    ) -> Result<(), ServiceError> {
        let numbers = pool.lock().unbegun_groups(task, wanted);
        self.begin(pool, numbers).await
    }

    /// Begins groups of a lease.
    pub(super) async fn begin(&self, pool: &SharedPool, numbers: Vec<i64>) -> Result<(), ServiceError> {
        if numbers.is_empty() {
            return Ok(());
        }
        let (run, lease) = {
            let pool = pool.lock();
            (pool.run.clone(), pool.lease.clone())
        };
        let change = BeginGroups { run, lease, groups: numbers.clone(), actor: Actor::Server };
        self.lease_service.writer.change(change).await?;
        pool.lock().set_begun(&numbers);
        Ok(())
    }

    /// Stores that sessions left episodes of a pool. Reports of later attempts must come after this.
    ///
    /// # Errors
    /// Returns the error of the store; the next call tries again.
    pub(super) async fn store_abandoned(&self, pool: &SharedPool) -> Result<(), ServiceError> {
        let (lease, groups) = {
            let mut pool = pool.lock();
            (pool.lease.number, std::mem::take(&mut pool.abandoned))
        };
        if groups.is_empty() {
            return Ok(());
        }
        let change = AbandonEpisodes { lease, groups: groups.clone() };
        let stored = self.lease_service.writer.change(change).await;
        if stored.is_err() {
            pool.lock().abandoned.extend(groups);
        }
        stored
    }

    /// Stores in the background that sessions left episodes of a pool.
    pub(in crate::sessions) fn spawn_store_abandoned(self: &Arc<Self>, pool: &SharedPool) {
        if pool.lock().abandoned.is_empty() {
            return;
        }
        let (leases, pool) = (Arc::clone(self), Arc::clone(pool));
        self.spawn_tracked(async move {
            if let Err(error) = leases.store_abandoned(&pool).await {
                tracing::warn!(%error, "The end of a session could not be stored; the next report tries again.");
            }
        });
    }
}
