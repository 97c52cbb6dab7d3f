//! Quotas: a limit on permits in total, and a limit for each owner.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Error of a quota without a free permit, in total or for the owner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("Server at capacity: {active}/{limit} sessions active. Cannot accept new connections.")]
pub struct QuotaExceeded {
    /// Number of permits in use, in total or by the owner.
    pub active: usize,
    /// Limit that was reached.
    pub limit: usize,
}

/// Permits, limited in total and for each owner.
#[derive(Debug)]
pub struct Quota {
    total: Arc<Semaphore>,
    by_owner: OwnerCounts,
    limit: usize,
    limit_per_owner: usize,
}

/// Number of permits that each owner has.
#[derive(Debug, Clone, Default)]
struct OwnerCounts(Arc<Mutex<HashMap<Arc<str>, usize>>>);

/// Permit of a quota, returned when it is dropped.
#[derive(Debug)]
pub struct QuotaPermit {
    _total: OwnedSemaphorePermit,
    owner: Option<OwnedCount>,
}

/// Share of one permit in the count of its owner.
#[derive(Debug)]
struct OwnedCount {
    counts: OwnerCounts,
    owner: Arc<str>,
}

impl Quota {
    /// Creates a quota of `limit` permits in total and `limit_per_owner` for each owner.
    #[must_use]
    pub fn new(limit: usize, limit_per_owner: usize) -> Self {
        let limit = limit.min(u32::MAX as usize).min(Semaphore::MAX_PERMITS);
        Self {
            total: Arc::new(Semaphore::new(limit)),
            by_owner: OwnerCounts::default(),
            limit,
            limit_per_owner,
        }
    }

    /// Returns the number of permits in use.
    #[must_use]
    pub fn in_use(&self) -> usize {
        self.limit.saturating_sub(self.total.available_permits())
    }

    /// Takes a permit. Without an owner only the total limit applies.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] with the limit that was reached, in total or of the owner.
    pub fn acquire(&self, owner: Option<&Arc<str>>) -> Result<QuotaPermit, QuotaExceeded> {
        let total = Arc::clone(&self.total).try_acquire_owned();
        let total = total.map_err(|_| QuotaExceeded { active: self.in_use(), limit: self.limit })?;
        let owner = match owner {
            Some(owner) => Some(self.by_owner.increment(owner, self.limit_per_owner)?),
            None => None,
        };
        Ok(QuotaPermit { _total: total, owner })
    }

    /// Waits until no permit is in use.
    pub async fn wait_until_unused(&self) {
        let all = u32::try_from(self.limit).unwrap_or(u32::MAX);
        drop(self.total.acquire_many(all).await); // the semaphore is never closed
    }
}

impl OwnerCounts {
    fn increment(&self, owner: &Arc<str>, limit: usize) -> Result<OwnedCount, QuotaExceeded> {
        let mut counts = self.0.lock();
        let count = counts.entry(Arc::clone(owner)).or_default();
        if *count >= limit {
            return Err(QuotaExceeded { active: *count, limit });
        }
        *count += 1;
        Ok(OwnedCount { counts: self.clone(), owner: Arc::clone(owner) })
    }
}

impl Drop for QuotaPermit {
    fn drop(&mut self) {
        let Some(OwnedCount { counts, owner }) = &self.owner else { return };
        let mut counts = counts.0.lock();
        if let Some(count) = counts.get_mut(owner) {
            *count -= 1;
            if *count == 0 {
                counts.remove(owner);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owners_are_limited_and_return_their_permits() {
        let quota = Quota::new(10, 2);
        let acquire = |owner: &str| quota.acquire(Some(&owner.into()));
        let first = acquire("a").expect("first permit of a");
        let _second = acquire("a").expect("second permit of a");
        assert_eq!(acquire("a").err(), Some(QuotaExceeded { active: 2, limit: 2 }));
        assert!(acquire("b").is_ok());
        for _ in 0..3 {
            assert!(quota.acquire(None).is_ok());
        }
        drop(first);
        assert_eq!(quota.in_use(), 1, "a rejected request holds no permit");
        assert!(acquire("a").is_ok());
        let all: Vec<QuotaPermit> = (0..9).map(|_| quota.acquire(None).expect("a free permit")).collect();
        assert_eq!(acquire("c").err(), Some(QuotaExceeded { active: 10, limit: 10 }));
        drop(all);
    }
}
