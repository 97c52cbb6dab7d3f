//! Pauses between the attempts of a call.

use std::time::{Duration, SystemTime};

use backon::ExponentialBuilder;

use crate::{LlmConfig, LlmError};

/// Longest pause before another attempt. A call whose endpoint asks for more fails instead.
const MAX_PAUSE: Duration = Duration::from_secs(60);

/// Returns the pauses between attempts: `config.backoff` before the first retry, then twice as long each time, up to
/// [`MAX_PAUSE`]. Jitter takes off up to a half, so that calls that failed together do not retry together.
pub(crate) fn backoff(config: &LlmConfig) -> ExponentialBuilder {
    // backon's jitter adds up to the pause itself, so that it is given the lower bound of each pause.
    let max_delay = MAX_PAUSE / 2;
    ExponentialBuilder::new()
        .with_min_delay((config.backoff / 2).min(max_delay))
        .with_max_delay(max_delay)
        .with_factor(2.0)
        .with_jitter()
        .with_max_times(usize::try_from(config.retries).unwrap_or(usize::MAX))
}

/// Extends a pause to the endpoint's `Retry-After`; `None` if that exceeds [`MAX_PAUSE`].
pub(crate) fn extend_pause(error: &LlmError, pause: Duration) -> Option<Duration> {
    match error {
        LlmError::RateLimited { retry_after: Some(after) } if *after > MAX_PAUSE => None,
        LlmError::RateLimited { retry_after: Some(after) } => Some((*after).max(pause)),
        _ => Some(pause),
    }
}

/// Parses `Retry-After`: seconds or a date (RFC 9110, 10.2.3). `now_ms` is in milliseconds since 1970 UTC.
pub fn parse_retry_after(value: &str, now_ms: i64) -> Option<Duration> {
    let value = value.trim();
    if let Ok(seconds) = value.parse::<f64>() {
        return Duration::try_from_secs_f64(seconds).ok();
    }
    let date = httpdate::parse_http_date(value).ok()?;
    let since_epoch = date.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    let now = Duration::from_millis(u64::try_from(now_ms).ok()?);
    Some(since_epoch.saturating_sub(now))
}

#[cfg(test)]
mod tests {
    use backon::BackoffBuilder;

    use super::*;
    use crate::WallClock;

    fn config() -> LlmConfig {
        LlmConfig::new("http://x/v1", "m", WallClock::new(|| 0))
    }

    fn assert_pauses(config: &LlmConfig, longest_ms: &[u64]) {
        let pauses: Vec<_> = backoff(config).build().collect();
        assert_eq!(pauses.len(), longest_ms.len());
        for (pause, longest) in pauses.iter().zip(longest_ms.iter().copied().map(Duration::from_millis)) {
            assert!((longest / 2..=longest).contains(pause), "{pause:?} of {longest:?}");
        }
    }

    #[test]
    fn pauses_double_up_to_a_minute_with_jitter() {
        assert_pauses(&config(), &[500, 1_000, 2_000]);
        assert_pauses(&LlmConfig { retries: 0, ..config() }, &[]);
        let slow = LlmConfig { retries: 4, backoff: Duration::from_secs(20), ..config() };
        assert_pauses(&slow, &[20_000, 40_000, 60_000, 60_000]);
        assert_pauses(&LlmConfig { retries: 1, backoff: Duration::MAX, ..config() }, &[60_000]);
    }

    #[test]
    fn retry_after_extends_the_pause_up_to_a_minute() {
        let pause = Duration::from_millis(250);
        let extended = |seconds| {
            let retry_after = Some(Duration::from_secs(seconds));
            extend_pause(&LlmError::RateLimited { retry_after }, pause).map(|pause| pause.as_millis())
        };
        assert_eq!([extended(7), extended(61), extended(0)], [Some(7000), None, Some(250)]);
        let unavailable = LlmError::Refused { status: 503, body: String::new() };
        assert_eq!(extend_pause(&unavailable, pause), Some(pause));
    }

    #[test]
    fn only_transient_errors_are_retried() {
        let refused = |status| LlmError::Refused { status, body: String::new() };
        assert!(refused(503).is_transient() && LlmError::RateLimited { retry_after: None }.is_transient());
        assert!(!refused(400).is_transient() && !LlmError::Timeout { after: Duration::ZERO }.is_transient());
    }

    #[test]
    fn retry_after_is_seconds_or_a_date() {
        // 1994-11-15 12:45:26 UTC, as in RFC 9110.
        let now = 784_903_526_000;
        let seconds = |value| parse_retry_after(value, now).map(|after| after.as_secs());
        assert_eq!(seconds("120"), Some(120));
        assert_eq!(seconds("Tue, 15 Nov 1994 12:45:36 GMT"), Some(10));
        assert_eq!(seconds("Tue, 15 Nov 1994 12:40:00 GMT"), Some(0));
        assert_eq!([seconds("soon"), seconds("-1"), seconds("NaN"), seconds("1e400")], [None; 4]);
    }
}
