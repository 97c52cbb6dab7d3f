//! Time in ticks of the simulation.

use super::error::TaskingError;

/// Length of a tick. Basilisk counts time in nanoseconds, so ticks have a whole number of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TickLength {
    nanoseconds: u64,
}

impl TickLength {
    /// One second: the default of BSK-RL.
    pub const ONE_SECOND: Self = Self { nanoseconds: 1_000_000_000 };
    /// Thirty seconds: the step of the trajectory that BSK-RL searches for windows and eclipses.
    pub const THIRTY_SECONDS: Self = Self { nanoseconds: 30_000_000_000 };

    /// Creates a length from seconds (`sim_rate` of BSK-RL).
    ///
    /// # Errors
    /// Returns [`TaskingError::InvalidArgument`] if it is not from 0.01 to 60 s.
    pub fn from_seconds(seconds: f64) -> Result<Self, TaskingError> {
        if !(0.01..=60.0).contains(&seconds) {
            return Err(TaskingError::invalid("sim_rate", "must be from 0.01 to 60 s", seconds));
        }
        Ok(Self { nanoseconds: (seconds * 1e9).round() as u64 })
    }

    /// Length of a tick, s.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.time_s(1)
    }

    /// Time of a tick, s since the episode's start.
    #[must_use]
    pub fn time_s(self, tick: u64) -> f64 {
        (tick * self.nanoseconds) as f64 * 1e-9
    }

    /// Time of the last tick that does not begin after a number of nanoseconds, s.
    #[must_use]
    pub fn last_time_s(self, nanoseconds: u64) -> f64 {
        self.time_s(nanoseconds / self.nanoseconds)
    }

    /// The first tick at or after a time, s; `None` if it is beyond 2³¹ s.
    #[must_use]
    pub fn first_tick_at(self, seconds: f64) -> Option<u64> {
        (seconds <= f64::from(1_u32 << 31)).then(|| ((seconds * 1e9) as u64).div_ceil(self.nanoseconds))
    }

    /// Index of the arc of `arc_s` seconds that contains a tick; a tick between two arcs belongs to the earlier one.
    #[must_use]
    pub fn arc_of(self, tick: u64, arc_s: f64) -> usize {
        ((tick * self.nanoseconds).saturating_sub(1) / (arc_s * 1e9) as u64) as usize
    }

    /// The last tick of an arc.
    #[must_use]
    pub fn last_tick_of(self, arc: usize, arc_s: f64) -> u64 {
        (arc as u64 + 1) * (arc_s * 1e9) as u64 / self.nanoseconds
    }
}
