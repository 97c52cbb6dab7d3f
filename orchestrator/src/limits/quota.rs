//! Quotas: a limit on permits in total, and a limit for each key.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Error of a quota without a free permit, in total or for the key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("Server at capacity: {active}/{limit} sessions active. Cannot accept new connections.")]
pub struct QuotaExceeded {
    /// Number of permits in use, in total or by the key.
    pub active: usize,
    /// Limit that was reached.
    pub limit: usize,
}

/// Permits, limited in total and for each key: a client's name by default.
#[derive(Debug)]
pub struct Quota<K: Eq + Hash = Arc<str>> {
    total: Arc<Semaphore>,
    by_key: Arc<KeyCounts<K>>,
    limit: usize,
    limit_per_key: usize,
}

/// Number of permits that each key has. A key without permits has no entry.
type KeyCounts<K> = Mutex<HashMap<K, usize>>;

/// Permit of a quota, returned when it is dropped.
#[derive(Debug)]
pub struct QuotaPermit<K: Eq + Hash = Arc<str>> {
    _total: TotalPermit,
    _of_key: Option<KeyPermit<K>>,
}

/// Permit that counts against the total limit and not yet against a key.
#[derive(Debug)]
pub struct TotalPermit(#[expect(dead_code, reason = "its drop returns the permit")] OwnedSemaphorePermit);

/// Share of one permit in the count of its key.
#[derive(Debug)]
struct KeyPermit<K: Eq + Hash> {
    counts: Arc<KeyCounts<K>>,
    key: K,
}

impl<K: Eq + Hash + Clone> Quota<K> {
    /// Creates a quota of `limit` permits in total and `limit_per_key` for each key.
    #[must_use]
    pub fn new(limit: usize, limit_per_key: usize) -> Self {
        let limit = limit.min(u32::MAX as usize).min(Semaphore::MAX_PERMITS);
        Self { total: Arc::new(Semaphore::new(limit)), by_key: Arc::default(), limit, limit_per_key }
    }

    /// Returns the number of permits in use.
    #[must_use]
    pub fn in_use(&self) -> usize {
        self.limit.saturating_sub(self.total.available_permits())
    }

    /// Takes a permit. Without a key only the total limit applies.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] with the limit that was reached, in total or of the key.
    pub fn acquire(&self, key: Option<&K>) -> Result<QuotaPermit<K>, QuotaExceeded> {
        let total = Arc::clone(&self.total).try_acquire_owned();
        let total = total.map_err(|_| QuotaExceeded { active: self.in_use(), limit: self.limit })?;
        match key {
            Some(key) => self.assign(TotalPermit(total), key),
            None => Ok(QuotaPermit { _total: TotalPermit(total), _of_key: None }),
        }
    }

    /// Waits for a permit of the total limit, for a caller that learns the key later.
    pub async fn wait_for_total(&self) -> TotalPermit {
        match Arc::clone(&self.total).acquire_owned().await {
            Ok(permit) => TotalPermit(permit),
            // The semaphore is never closed.
            Err(_) => std::future::pending().await,
        }
    }

    /// Counts a permit of the total limit against a key.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] if the key has reached its limit; the permit is returned.
    pub fn assign(&self, total: TotalPermit, key: &K) -> Result<QuotaPermit<K>, QuotaExceeded> {
        let mut counts = self.by_key.lock();
        let active = counts.get(key).copied().unwrap_or(0);
        if active >= self.limit_per_key {
            return Err(QuotaExceeded { active, limit: self.limit_per_key });
        }
        counts.insert(key.clone(), active + 1);
        let of_key = KeyPermit { counts: Arc::clone(&self.by_key), key: key.clone() };
        Ok(QuotaPermit { _total: total, _of_key: Some(of_key) })
    }

    /// Waits until no permit is in use.
    pub async fn wait_until_unused(&self) {
        let all = u32::try_from(self.limit).unwrap_or(u32::MAX);
        drop(self.total.acquire_many(all).await); // the semaphore is never closed
    }
}

impl<K: Eq + Hash> Drop for KeyPermit<K> {
    fn drop(&mut self) {
        let mut counts = self.counts.lock();
        if let Some(count) = counts.get_mut(&self.key) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.key);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;

    use super::*;

    #[test]
    fn owners_are_limited_and_return_their_permits() {
        let quota = Quota::<Arc<str>>::new(10, 2);
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

    #[tokio::test]
    async fn one_address_cannot_take_all_permits() {
        let quota = Quota::new(4, 3);
        let (one, other) = (IpAddr::from([10, 0, 0, 1]), IpAddr::from([10, 0, 0, 2]));
        let mut permits = Vec::new();
        for _ in 0..3 {
            permits.push(quota.assign(quota.wait_for_total().await, &one).expect("a permit of the address"));
        }
        assert!(quota.assign(quota.wait_for_total().await, &one).is_err());
        assert!(
            quota.assign(quota.wait_for_total().await, &other).is_ok(),
            "the rejected permit was returned"
        );
        permits.pop();
        assert!(quota.assign(quota.wait_for_total().await, &one).is_ok());
    }
}
