//! Time as a parameter: the service asks its clock, tests bring their own.

use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Milliseconds since 1970 UTC.
pub type Millis = i64;

/// A clock of the day that moves more than this between two looks otherwise than the processor's has jumped: somebody set it, or the
/// machine slept.
const JUMP_MS: Millis = 2_000;

/// Where the service reads the time.
#[derive(Clone)]
pub struct Clock {
    day: Arc<dyn Fn() -> Millis + Send + Sync>,
    /// What is told does not jump before [`Clock::adopt`] is asked to; none of a clock that tests move.
    steady: Option<Arc<Mutex<Steady>>>,
}

/// Time that goes on as the processor's clock does.
#[derive(Debug, Clone, Copy)]
struct Steady {
    told: Millis,
    at: Instant,
}

impl Steady {
    /// The time by a clock of the day that says `day`, `passed` after the last look; and how far that has jumped, if it has.
    fn look(self, day: Millis, passed: Duration) -> (Millis, Option<Millis>) {
        let expected = self.told.saturating_add(i64::try_from(passed.as_millis()).unwrap_or(i64::MAX));
        let apart = day.saturating_sub(expected);
        if apart.abs() <= JUMP_MS { (day, None) } else { (expected, Some(apart)) }
    }
}

impl Clock {
    /// The system's clock. It does not jump by itself: while the clock of the day has, it goes on as before.
    #[must_use]
    pub fn system() -> Self {
        #[expect(clippy::disallowed_methods, reason = "the one place where the clock is read")]
        let day = || jiff::Timestamp::now().as_millisecond();
        let steady = Steady { told: day(), at: Instant::now() };
        Self { day: Arc::new(day), steady: Some(Arc::new(Mutex::new(steady))) }
    }

    /// A clock that stands still until it is moved.
    #[must_use]
    pub fn manual(start: Millis) -> (Self, Arc<AtomicI64>) {
        let hand = Arc::new(AtomicI64::new(start));
        let read = Arc::clone(&hand);
        (Self { day: Arc::new(move || read.load(Ordering::SeqCst)), steady: None }, hand)
    }

    /// Now.
    #[must_use]
    pub fn now(&self) -> Millis {
        self.look().0
    }

    /// How far the clock of the day has jumped, if it has.
    #[must_use]
    pub fn jumped(&self) -> Option<Millis> {
        self.look().1
    }

    /// Goes by the clock of the day again, which has jumped so far. Whoever calls this has moved what waits for a time.
    pub fn adopt(&self, jumped: Millis) {
        if let Some(steady) = &self.steady {
            let mut steady = steady.lock().unwrap_or_else(PoisonError::into_inner);
            steady.told = steady.told.saturating_add(jumped);
        }
    }

    fn look(&self) -> (Millis, Option<Millis>) {
        let day = (self.day)();
        let Some(steady) = &self.steady else { return (day, None) };
        let mut steady = steady.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let passed = now.saturating_duration_since(steady.at);
        let (told, jumped) = steady.look(day, passed);
        // Whole milliseconds are told: what is left of one is not lost.
        let at = if jumped.is_none() {
            now
        } else {
            now - Duration::from_nanos(u64::from(passed.subsec_nanos() % 1_000_000))
        };
        *steady = Steady { told, at };
        (told, jumped)
    }
}

impl std::fmt::Debug for Clock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Clock")
    }
}

/// A time as people and programs read it: RFC 3339, UTC, always with milliseconds.
#[must_use]
pub fn rfc3339(at: Millis) -> String {
    jiff::Timestamp::from_millisecond(at).map_or_else(|_| at.to_string(), |t| format!("{t:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_does_not_jump_and_one_that_drifts_is_followed() {
        let steady = Steady { told: 1_000_000, at: Instant::now() };
        let look = |day, ms| steady.look(day, Duration::from_millis(ms));
        assert_eq!(look(1_000_500, 500), (1_000_500, None));
        assert_eq!(look(1_002_400, 500), (1_002_400, None), "a second or two of drift");
        assert_eq!(look(1_000_100, 500), (1_000_100, None));
        assert_eq!(look(90_000_000, 500), (1_000_500, Some(88_999_500)));
        assert_eq!(look(0, 500), (1_000_500, Some(-1_000_500)));
        assert_eq!(look(i64::MAX, u64::MAX).0, i64::MAX, "whatever it says");
    }

    #[test]
    fn times_have_one_length() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(rfc3339(1_490), "1970-01-01T00:00:01.490Z");
    }
}
