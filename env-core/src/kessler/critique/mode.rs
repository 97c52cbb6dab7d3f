//! The failure modes, typed inside and named outside.

use crate::critique::{ModeSpec, SpeedBands};

/// Why an episode of kessler loses score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Collision,
    Rogue,
    Fragment,
    Decay,
    FuelStarvation,
    Overshoot,
    Short,
    BreakUp,
    WastedFuel,
}

impl Mode {
    /// Its name.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Collision => "collision",
            Self::Rogue => "rogue",
            Self::Fragment => "fragment",
            Self::Decay => "decay",
            Self::FuelStarvation => "fuel_starvation",
            Self::Overshoot => "overshoot",
            Self::Short => "short",
            Self::BreakUp => "break_up",
            Self::WastedFuel => "wasted_fuel",
        }
    }

    const fn spec(self) -> ModeSpec {
        let about = match self {
            Self::Collision => "debris that was there from the start hit a satellite",
            Self::Rogue => "rogue debris hit a satellite",
            Self::Fragment => "a fragment of another satellite hit a satellite",
            Self::Decay => "a satellite fell into the Earth",
            Self::FuelStarvation => "fuel was short for what would have helped",
            Self::Overshoot => "satellite 0 reached radius 100 and did not stay",
            Self::Short => "satellite 0 did not reach radius 100, or reached it too late",
            Self::BreakUp => "the formation was lost with all satellites alive",
            Self::WastedFuel => "fuel that was worth score was spent for nothing",
        };
        ModeSpec { name: self.name(), about }
    }
}

/// Why an episode of kessler can lose score.
pub(in crate::kessler) static MODES: [ModeSpec; 9] = [
    Mode::Collision.spec(),
    Mode::Rogue.spec(),
    Mode::Fragment.spec(),
    Mode::Decay.spec(),
    Mode::FuelStarvation.spec(),
    Mode::Overshoot.spec(),
    Mode::Short.spec(),
    Mode::BreakUp.spec(),
    Mode::WastedFuel.spec(),
];

/// How relative speeds are sorted.
pub(in crate::kessler) const SPEED_BANDS: SpeedBands =
    SpeedBands { edges: &[1.0, 2.0, 4.0, 8.0], unit: "LU/TU" };
