//! What happens in a step, typed. Text is rendered here, at the edge.

/// One thing that happened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// A burn was refused for lack of fuel.
    BurnRefused {
        /// Whose.
        satellite: u32,
        /// What it would have cost.
        cost: f64,
    },
    /// Rogue debris arrived.
    RogueArrived {
        /// Its id.
        debris: u32,
    },
    /// A satellite was inside the Earth radius.
    Decayed {
        /// Which.
        satellite: u32,
    },
    /// Debris inside the Earth radius was removed.
    DebrisDecayed {
        /// Which.
        debris: u32,
    },
    /// Debris destroyed a satellite.
    Collision {
        /// Which.
        satellite: u32,
        /// By what.
        debris: u32,
    },
    /// Under `risk: pc`: debris passed a satellite.
    Passed {
        /// Which.
        satellite: u32,
        /// What.
        debris: u32,
        /// How near, LU.
        miss: f64,
        /// What it cost.
        probability: f64,
    },
}

/// Probabilities of collision below this are no alert.
const ALERT: f64 = 1e-4;

impl Event {
    /// The public kessler-env's words, where it has any.
    #[must_use]
    pub fn alert(&self) -> Option<String> {
        match self {
            Self::BurnRefused { satellite, .. } => {
                Some(format!("Sat {satellite} failed burn: Insufficient fuel."))
            }
            Self::RogueArrived { .. } => {
                Some("WARNING: High-velocity rogue debris entered radar!".to_owned())
            }
            Self::Decayed { satellite } => {
                Some(format!("Sat {satellite} orbit decayed! Crashed into Earth."))
            }
            Self::DebrisDecayed { .. } => None,
            Self::Passed { probability, .. } if *probability < ALERT => None,
            Self::Passed { satellite, debris, miss, probability } => Some(format!(
                "CONJUNCTION: Debris {debris} passed Sat {satellite} at {miss:.2}, probability of collision {probability:.1e}."
            )),
            Self::Collision { satellite, debris } => {
                Some(format!("CRITICAL: Sat {satellite} collided with Debris {debris}!"))
            }
        }
    }
}
