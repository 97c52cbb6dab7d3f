//! Long polls: a request waits until its source has groups, or its time is over.

use std::ops::RangeInclusive;
use std::time::Duration;

use store::trajectories::FeedGroup;
use tokio::time::Instant;

use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Longest time that the server waits for a group. Proxies end requests without a response after 60 s by default.
const MAX_WAIT: Duration = Duration::from_secs(55);

/// Source of the groups that a request can get.
pub(super) trait FeedSource {
    /// Groups that are available now.
    async fn available(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem>;

    /// Time until a group becomes available without a new one; `None` if this cannot happen.
    async fn next_at(&self, _app: &AppState) -> Result<Option<Duration>, Problem> {
        Ok(None)
    }
}

/// Number of groups and duration of the wait, checked.
pub(super) struct WaitParams {
    /// Largest number of groups.
    pub(super) limit: i64,
    /// Longest wait for the first group.
    pub(super) wait: Duration,
}

impl WaitParams {
    /// Checks the values of a request.
    ///
    /// # Errors
    /// Returns a problem that names the field that is out of range.
    pub(super) fn from_request(limit: Option<u32>, wait_s: Option<u32>) -> Result<Self, Problem> {
        let limit = check_range("limit", limit, 8, 1..=256)?;
        let wait = check_range("wait_s", wait_s, 0, 0..=60)?;
        Ok(Self { limit, wait: MAX_WAIT.min(Duration::from_secs(wait.unsigned_abs())) })
    }
}

/// Returns a value of a request, or its default.
///
/// # Errors
/// Returns a problem that names the field if the value is out of range.
pub(super) fn check_range(
    field: &str,
    value: Option<u32>,
    default: u32,
    range: RangeInclusive<u32>,
) -> Result<i64, Problem> {
    let value = value.unwrap_or(default);
    if range.contains(&value) {
        return Ok(i64::from(value));
    }
    let (min, max) = (range.start(), range.end());
    Err(Problem::invalid(field, format!("must be from {min} to {max}, got {value}")))
}

/// Waits until a source has groups, or the time is over.
pub(super) async fn wait_for_groups(
    app: &AppState,
    source: &impl FeedSource,
    wait: Duration,
) -> Result<Vec<FeedGroup>, Problem> {
    let _permit = if wait.is_zero() { None } else { Some(app.long_polls.acquire()?) };
    let until = Instant::now() + wait;
    let mut watch = app.long_polls.watch();
    loop {
        watch.mark_seen();
        let heads = source.available(app).await?;
        if !heads.is_empty() || Instant::now() >= until {
            return Ok(heads);
        }
        let again = source.next_at(app).await?.map_or(until, |again| until.min(Instant::now() + again));
        if !watch.wait(again).await {
            return Ok(Vec::new());
        }
    }
}
