//! How often each may ask.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use governor::clock::{Clock, DefaultClock};
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};

/// Keys that come and go are forgotten each time so many requests were looked at.
const SWEEP: u32 = 10_000;

/// Requests a second, of each by a key.
#[derive(Debug)]
pub(super) struct Rate {
    limiter: DefaultKeyedRateLimiter<Arc<str>>,
    seen: AtomicU32,
}

impl Rate {
    /// So many a second, and two seconds' worth at once.
    pub(super) fn new(a_second: NonZeroU32) -> Self {
        let quota = Quota::per_second(a_second)
            .allow_burst(a_second.saturating_mul(NonZeroU32::MIN.saturating_add(1)));
        Self { limiter: RateLimiter::keyed(quota), seen: AtomicU32::new(0) }
    }

    /// Whether one more is fine; else in how many seconds it is.
    pub(super) fn take(&self, key: &Arc<str>) -> Result<(), u32> {
        if self.seen.fetch_add(1, Ordering::Relaxed).is_multiple_of(SWEEP) {
            self.limiter.retain_recent();
        }
        self.limiter.check_key(key).map_err(|not_until| {
            let wait = not_until.wait_time_from(DefaultClock::default().now());
            u32::try_from(wait.as_secs()).unwrap_or(u32::MAX).saturating_add(1)
        })
    }
}
