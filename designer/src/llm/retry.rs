//! When to ask again.

use std::time::{Duration, SystemTime};

use super::{LlmConfig, LlmError};

/// The longest pause before another try. Who is told to wait longer gives up: the next brief comes anyway.
pub(super) const LONGEST: Duration = Duration::from_secs(60);

/// How long to wait before try number `number` (1 for the first further one); none where it is not worth trying.
/// `chance` in [0, 1) spreads those who failed together.
pub(super) fn pause(config: &LlmConfig, error: &LlmError, number: u32, chance: f64) -> Option<Duration> {
    if number > config.retries || !error.passes() {
        return None;
    }
    let doubled = config.backoff.saturating_mul(1 << (number - 1).min(16)).min(LONGEST);
    let jittered = doubled.mul_f64(0.5 + 0.5 * chance);
    match error {
        LlmError::RateLimited { retry_after: Some(after) } if *after > LONGEST => None,
        LlmError::RateLimited { retry_after: Some(after) } => Some((*after).max(jittered)),
        _ => Some(jittered),
    }
}

/// Reads `Retry-After`: seconds, or a date (RFC 9110, 10.2.3).
pub(super) fn retry_after(value: &str, now_ms: i64) -> Option<Duration> {
    let value = value.trim();
    if let Ok(seconds) = value.parse::<f64>() {
        return Duration::try_from_secs_f64(seconds).ok();
    }
    let date = httpdate::parse_http_date(value).ok()?;
    let since = date.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    let now = Duration::from_millis(u64::try_from(now_ms).ok()?);
    Some(since.saturating_sub(now))
}

#[cfg(test)]
mod tests {
    use super::super::WallClock;
    use super::*;

    #[test]
    fn pauses_double_and_heed_what_is_asked() {
        let config = LlmConfig::new("http://x/v1", "m", WallClock::new(|| 0));
        let down = LlmError::Refused { status: 503, body: String::new() };
        let of = |error: &LlmError, number| pause(&config, error, number, 0.0).map(|p| p.as_millis());
        assert_eq!([1, 2, 3, 4].map(|n| of(&down, n)), [Some(250), Some(500), Some(1000), None]);
        let limited = |s| LlmError::RateLimited { retry_after: Some(Duration::from_secs(s)) };
        assert_eq!(
            [of(&limited(7), 1), of(&limited(61), 1), of(&limited(0), 1)],
            [Some(7000), None, Some(250)]
        );
        assert_eq!(of(&LlmError::Refused { status: 400, body: String::new() }, 1), None);
        assert_eq!(of(&LlmError::Timeout { after: Duration::ZERO }, 1), None);
    }

    #[test]
    fn retry_after_is_seconds_or_a_date() {
        // 1994-11-15 12:45:26 UTC, as in RFC 9110.
        let now = 784_903_526_000;
        let of = |value| retry_after(value, now).map(|d| d.as_secs());
        assert_eq!(of("120"), Some(120));
        assert_eq!(of("Tue, 15 Nov 1994 12:45:36 GMT"), Some(10));
        assert_eq!(of("Tue, 15 Nov 1994 12:40:00 GMT"), Some(0));
        assert_eq!([of("soon"), of("-1"), of("NaN"), of("1e400")], [None; 4]);
    }
}
