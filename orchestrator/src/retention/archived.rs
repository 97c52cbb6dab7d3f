//! How long archived runs are kept.

use std::time::Duration;

use clock::Millis;

/// Time for which an archived run must be found due before the server deletes it.
const CONFIRMATION: Duration = Duration::from_hours(1);
/// Interval between two searches for runs that are due.
const POLL_INTERVAL: Duration = Duration::from_mins(10);

/// How long archived runs are kept before the server deletes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArchivedRetention {
    keep: Duration,
    confirmation: Duration,
}

impl ArchivedRetention {
    /// Keeps archived runs for some days.
    #[must_use]
    pub fn of_days(days: u32) -> Self {
        Self { keep: Duration::from_hours(24) * days, confirmation: CONFIRMATION }
    }

    /// Returns the retention with another confirmation time, for tests.
    #[must_use]
    pub const fn with_confirmation(self, confirmation: Duration) -> Self {
        Self { confirmation, ..self }
    }

    /// How long an archived run is kept.
    #[must_use]
    pub const fn keep(self) -> Duration {
        self.keep
    }

    /// How long an archived run is kept, milliseconds.
    pub(crate) fn keep_ms(self) -> Millis {
        Millis::try_from(self.keep.as_millis()).unwrap_or(Millis::MAX)
    }

    /// How long a run must be due, by the processor's clock, before it is deleted: a system clock that is set wrong for a shorter time
    /// deletes nothing.
    pub(crate) const fn confirmation(self) -> Duration {
        self.confirmation
    }

    /// Interval between two searches.
    pub(crate) fn poll_interval(self) -> Duration {
        POLL_INTERVAL.min(self.confirmation)
    }
}
