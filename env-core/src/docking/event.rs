//! What happens in a step, typed. Text is rendered here, at the edge.

/// One thing that happened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// A deputy docked.
    Docked {
        /// Which.
        deputy: u32,
        /// How fast, m/s.
        speed: f64,
    },
    /// A deputy came within the docking radius too fast.
    Crashed {
        /// Which.
        deputy: u32,
        /// How fast, m/s.
        speed: f64,
        /// The limit there, m/s.
        limit: f64,
    },
    /// A deputy flew too far away.
    OutOfBounds {
        /// Which.
        deputy: u32,
        /// How far, m.
        distance: f64,
    },
    /// A deputy's velocity reward added up to the least that is allowed.
    Saturated {
        /// Which.
        deputy: u32,
        /// Its velocity reward so far.
        sum: f64,
    },
    /// Two deputies came too close, which ends the episode for everybody.
    Collided {
        /// The one with the smaller id.
        first: u32,
        /// The other.
        second: u32,
        /// How close, m.
        separation: f64,
    },
    /// Time ran out.
    TimedOut {
        /// For whom.
        deputy: u32,
        /// How far from the chief, m.
        distance: f64,
    },
}

impl Event {
    /// The same in words.
    #[must_use]
    pub fn alert(&self) -> String {
        match self {
            Self::Docked { deputy, speed } => format!("Deputy {deputy} docked at {speed:.3} m/s."),
            Self::Crashed { deputy, speed, limit } => {
                format!("CRITICAL: Deputy {deputy} crashed at {speed:.3} m/s, limit {limit:.3} m/s!")
            }
            Self::OutOfBounds { deputy, distance } => {
                format!("CRITICAL: Deputy {deputy} left bounds at {distance:.0} m!")
            }
            Self::Saturated { deputy, sum } => {
                format!("CRITICAL: Deputy {deputy} broke the speed limit for too long (penalty {sum:.2})!")
            }
            Self::Collided { first, second, separation } => {
                format!("CRITICAL: Deputies {first} and {second} collided ({separation:.2} m apart)!")
            }
            Self::TimedOut { deputy, distance } => {
                format!("Deputy {deputy} ran out of time {distance:.1} m from the chief.")
            }
        }
    }
}
