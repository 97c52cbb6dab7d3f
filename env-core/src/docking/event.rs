//! Events of a step, and their texts.

/// Event of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DockingEvent {
    /// A deputy docked with the chief.
    Docked {
        /// Number of the deputy.
        deputy: u32,
        /// Speed relative to the chief, m/s.
        speed: f64,
    },
    /// A deputy came within the docking radius above the speed limit.
    Crashed {
        /// Number of the deputy.
        deputy: u32,
        /// Speed relative to the chief, m/s.
        speed: f64,
        /// Speed limit at its distance, m/s.
        limit: f64,
    },
    /// A deputy flew out of bounds.
    OutOfBounds {
        /// Number of the deputy.
        deputy: u32,
        /// Distance from the chief, m.
        distance: f64,
    },
    /// The sum of a deputy's velocity rewards reached its minimum.
    Saturated {
        /// Number of the deputy.
        deputy: u32,
        /// Sum of its velocity rewards.
        sum: f64,
    },
    /// Two deputies collided, which ends the episode for all.
    Collided {
        /// The deputy with the smaller number.
        first: u32,
        /// The deputy with the larger number.
        second: u32,
        /// Distance between them, m.
        separation: f64,
    },
    /// The time limit was reached before a deputy docked.
    TimedOut {
        /// Number of the deputy.
        deputy: u32,
        /// Distance from the chief, m.
        distance: f64,
    },
}

impl DockingEvent {
    /// Text of the event.
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
