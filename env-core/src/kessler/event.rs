//! Typed events of a step, and their text for the telemetry.

/// One event of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KesslerEvent {
    /// A burn was rejected for lack of fuel.
    BurnRejected {
        /// Number of the satellite, 0 to 2.
        satellite: u32,
        /// Fuel that the burn would have taken.
        cost: f64,
    },
    /// Rogue debris arrived at its radius.
    RogueArrived {
        /// Id of the debris.
        debris: u32,
    },
    /// A satellite fell into the Earth and is lost.
    Decayed {
        /// Number of the satellite, 0 to 2.
        satellite: u32,
    },
    /// Debris fell into the Earth and was removed.
    DebrisDecayed {
        /// Id of the debris.
        debris: u32,
    },
    /// Debris destroyed a satellite.
    Collision {
        /// Number of the satellite, 0 to 2.
        satellite: u32,
        /// Id of the debris that hit it.
        debris: u32,
    },
    /// Debris passed a satellite under `risk: pc`.
    CloseApproach {
        /// Number of the satellite, 0 to 2.
        satellite: u32,
        /// Id of the debris that passed.
        debris: u32,
        /// Miss distance of the approach, LU.
        miss: f64,
        /// Probability of collision that the satellite's survival loses.
        probability: f64,
    },
}

/// Probability of collision from which a close approach is an alert.
const MIN_ALERT_PROBABILITY: f64 = 1e-4;

impl KesslerEvent {
    /// Text of the event in the words of the public kessler-env. `None` for events that are not
    /// alerts.
    #[must_use]
    pub fn alert(&self) -> Option<String> {
        match self {
            Self::BurnRejected { satellite, .. } => {
                Some(format!("Sat {satellite} failed burn: Insufficient fuel."))
            }
            Self::RogueArrived { .. } => {
                Some("WARNING: High-velocity rogue debris entered radar!".to_owned())
            }
            Self::Decayed { satellite } => {
                Some(format!("Sat {satellite} orbit decayed! Crashed into Earth."))
            }
            Self::DebrisDecayed { .. } => None,
            Self::CloseApproach { probability, .. } if *probability < MIN_ALERT_PROBABILITY => None,
            Self::CloseApproach { satellite, debris, miss, probability } => Some(format!(
                "CONJUNCTION: Debris {debris} passed Sat {satellite} at {miss:.2}, probability of collision {probability:.1e}."
            )),
            Self::Collision { satellite, debris } => {
                Some(format!("CRITICAL: Sat {satellite} collided with Debris {debris}!"))
            }
        }
    }
}
