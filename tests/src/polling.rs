//! Waiting for a condition.

use std::time::{Duration, Instant};

/// Time after which [`wait_for`] fails: generous, because machines that run tests are often busy.
const TIMEOUT: Duration = Duration::from_secs(120);
/// Pause between two polls.
const INTERVAL: Duration = Duration::from_millis(25);

/// Calls `poll` until it returns a value, and returns that value.
///
/// # Panics
/// Panics after two minutes without a value; `condition` says what was awaited.
pub async fn wait_for<T>(condition: &str, mut poll: impl AsyncFnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = poll().await {
            return value;
        }
        assert!(start.elapsed() < TIMEOUT, "timeout after {TIMEOUT:?}: {condition}");
        tokio::time::sleep(INTERVAL).await;
    }
}

/// Calls `is_met` until it returns true.
///
/// # Panics
/// Panics if the condition is still false after two minutes; `condition` says what was awaited.
pub async fn wait_until(condition: &str, mut is_met: impl AsyncFnMut() -> bool) {
    wait_for(condition, async || is_met().await.then_some(())).await;
}
