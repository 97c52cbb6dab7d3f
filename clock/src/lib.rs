//! Time as a parameter: the service reads its [`Clock`], and tests move a manual one.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Milliseconds since 1970-01-01 UTC, or a duration in milliseconds.
pub type Millis = i64;

/// If the system time and the processor's clock drift apart by more than this between two reads, milliseconds, the system time has
/// jumped: a user set it, or the machine slept.
const JUMP_MS: Millis = 2_000;

/// Clock of the service.
#[derive(Clone)]
pub struct Clock {
    /// Reads the system time.
    system_time: Arc<dyn Fn() -> Millis + Send + Sync>,
    /// Hides jumps of the system time until [`Clock::adopt`] is called; none for a manual clock.
    steady: Option<Arc<Mutex<SteadyTime>>>,
}

/// The last time that was returned, and when by the processor's clock.
#[derive(Debug, Clone, Copy)]
struct SteadyTime {
    returned: Millis,
    at: Instant,
}

/// A reading of the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reading {
    /// The time to return.
    time: Millis,
    /// Size of a jump of the system time, if there was one.
    jump: Option<Millis>,
}

/// A clock that stands still, for tests.
#[derive(Debug, Clone)]
pub struct ManualClock {
    /// The clock, to be passed on.
    pub clock: Clock,
    /// Time that the clock returns.
    pub time: Arc<AtomicI64>,
}

impl SteadyTime {
    /// The reading for a system time, `elapsed` after the last reading.
    fn read(self, system_time: Millis, elapsed: Duration) -> Reading {
        let elapsed = i64::try_from(elapsed.as_millis()).unwrap_or(i64::MAX);
        let expected = self.returned.saturating_add(elapsed);
        let difference = system_time.saturating_sub(expected);
        if difference.abs() <= JUMP_MS {
            Reading { time: system_time, jump: None }
        } else {
            Reading { time: expected, jump: Some(difference) }
        }
    }
}

impl Clock {
    /// The system's clock. After a jump of the system time it continues as if there was none, until [`Clock::adopt`] is called.
    #[must_use]
    pub fn system() -> Self {
        #[expect(clippy::disallowed_methods, reason = "the one place where the clock is read")]
        let system_time = || jiff::Timestamp::now().as_millisecond();
        let steady = SteadyTime { returned: system_time(), at: Instant::now() };
        Self { system_time: Arc::new(system_time), steady: Some(Arc::new(Mutex::new(steady))) }
    }

    /// A clock that stands still until the caller changes its time.
    #[must_use]
    pub fn manual(start: Millis) -> ManualClock {
        let time = Arc::new(AtomicI64::new(start));
        let read = Arc::clone(&time);
        let clock = Self { system_time: Arc::new(move || read.load(Ordering::SeqCst)), steady: None };
        ManualClock { clock, time }
    }

    /// The current time of the clock.
    #[must_use]
    pub fn now(&self) -> Millis {
        self.read().time
    }

    /// Size of the jump of the system time since it was last adopted, milliseconds; `None` if it has not jumped.
    #[must_use]
    pub fn jumped(&self) -> Option<Millis> {
        self.read().jump
    }

    /// Follows the system time again after a jump of `jump` milliseconds. The caller must have shifted all deadlines.
    pub fn adopt(&self, jump: Millis) {
        if let Some(steady) = &self.steady {
            let mut steady = steady.lock();
            steady.returned = steady.returned.saturating_add(jump);
        }
    }

    fn read(&self) -> Reading {
        let system_time = (self.system_time)();
        let Some(steady) = &self.steady else { return Reading { time: system_time, jump: None } };
        let mut steady = steady.lock();
        let now = Instant::now();
        let elapsed = now.saturating_duration_since(steady.at);
        let reading = steady.read(system_time, elapsed);
        // After a jump only whole milliseconds are returned: the rest of one counts for the next reading.
        let at = if reading.jump.is_none() {
            now
        } else {
            now - Duration::from_nanos(u64::from(elapsed.subsec_nanos() % 1_000_000))
        };
        *steady = SteadyTime { returned: reading.time, at };
        reading
    }
}

impl std::fmt::Debug for Clock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Clock")
    }
}

/// Formats a time by RFC 3339, in UTC and with three digits for milliseconds.
#[must_use]
pub fn rfc3339(at: Millis) -> String {
    jiff::Timestamp::from_millisecond(at).map_or_else(|_| at.to_string(), |t| format!("{t:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jump_is_hidden_and_drift_is_followed() {
        let steady = SteadyTime { returned: 1_000_000, at: Instant::now() };
        let read = |system_time, ms| {
            let Reading { time, jump } = steady.read(system_time, Duration::from_millis(ms));
            (time, jump)
        };
        assert_eq!(read(1_000_500, 500), (1_000_500, None));
        assert_eq!(read(1_002_400, 500), (1_002_400, None), "a drift of two seconds");
        assert_eq!(read(1_000_100, 500), (1_000_100, None));
        assert_eq!(read(90_000_000, 500), (1_000_500, Some(88_999_500)));
        assert_eq!(read(0, 500), (1_000_500, Some(-1_000_500)));
        assert_eq!(read(i64::MAX, u64::MAX).0, i64::MAX, "extreme values do not overflow");
    }

    #[test]
    fn formatted_times_have_one_length() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(rfc3339(1_490), "1970-01-01T00:00:01.490Z");
    }
}
