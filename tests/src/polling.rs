//! Waiting for a condition.

use std::time::{Duration, Instant};

/// Time after which [`wait_for`] fails: generous, because machines that run tests are often busy.
const TIMEOUT: Duration = Duration::from_secs(300);
/// Pause between two polls.
const INTERVAL: Duration = Duration::from_millis(25);

/// Calls `poll` until it returns a value, and returns that value.
///
/// # Panics
/// Panics after five minutes without a value; `condition` says what was awaited.
pub async fn wait_for<T>(condition: &str, poll: impl AsyncFnMut() -> Option<T>) -> T {
    match try_wait_for(condition, poll).await {
        Ok(value) => value,
        Err(error) => panic!("{error}"),
    }
}

/// Calls `poll` until it returns a value, and returns that value.
///
/// # Errors
/// Returns an error that has `condition` after five minutes without a value.
pub async fn try_wait_for<T>(condition: &str, mut poll: impl AsyncFnMut() -> Option<T>) -> anyhow::Result<T> {
    let polling = Polling::start(condition);
    loop {
        if let Some(value) = poll().await {
            return Ok(value);
        }
        polling.pause().await?;
    }
}

/// Calls `is_met` until it returns true.
///
/// # Panics
/// Panics if the condition is still false after five minutes; `condition` says what was awaited.
pub async fn wait_until(condition: &str, mut is_met: impl AsyncFnMut() -> bool) {
    wait_for(condition, async || is_met().await.then_some(())).await;
}

/// A series of polls of one condition, with pauses between them.
#[derive(Debug)]
pub(crate) struct Polling<'a> {
    condition: &'a str,
    start: Instant,
}

impl<'a> Polling<'a> {
    pub(crate) fn start(condition: &'a str) -> Self {
        Self { condition, start: Instant::now() }
    }

    /// Waits until the next poll.
    ///
    /// # Errors
    /// Returns an error five minutes after the start.
    pub(crate) async fn pause(&self) -> anyhow::Result<()> {
        let Self { condition, start } = self;
        anyhow::ensure!(start.elapsed() < TIMEOUT, "timeout after {TIMEOUT:?}: {condition}");
        tokio::time::sleep(INTERVAL).await;
        Ok(())
    }
}
