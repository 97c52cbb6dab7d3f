//! Rate limit of each key, as a token bucket.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use governor::clock::{Clock, DefaultClock};
use governor::{DefaultKeyedRateLimiter, RateLimiter};

/// Number of checks between two removals of idle keys.
const CHECKS_PER_CLEANUP: u32 = 10_000;

/// Rate limit with a bucket for each key.
#[derive(Debug)]
pub struct RateLimit {
    limiter: DefaultKeyedRateLimiter<Arc<str>>,
    checks: AtomicU32,
}

/// Error of a key that exceeded its rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("rate limit exceeded; retry in {retry_after_s} s")]
pub struct RateLimited {
    /// Time until the next request is accepted, in seconds.
    pub retry_after_s: u32,
}

impl RateLimit {
    /// Creates a limit of `per_second` requests per second and key. A burst may have twice as many.
    #[must_use]
    pub fn new(per_second: NonZeroU32) -> Self {
        let burst = per_second.saturating_mul(NonZeroU32::MIN.saturating_add(1));
        let quota = governor::Quota::per_second(per_second).allow_burst(burst);
        Self { limiter: RateLimiter::keyed(quota), checks: AtomicU32::new(0) }
    }

    /// Counts one request of the key.
    ///
    /// # Errors
    /// Returns [`RateLimited`] if the key has no request left.
    pub fn check(&self, key: &Arc<str>) -> Result<(), RateLimited> {
        if self.checks.fetch_add(1, Ordering::Relaxed).is_multiple_of(CHECKS_PER_CLEANUP) {
            self.limiter.retain_recent();
        }
        self.limiter.check_key(key).map_err(|not_until| {
            let wait = not_until.wait_time_from(DefaultClock::default().now());
            let retry_after_s = u32::try_from(wait.as_secs()).unwrap_or(u32::MAX).saturating_add(1);
            RateLimited { retry_after_s }
        })
    }
}
