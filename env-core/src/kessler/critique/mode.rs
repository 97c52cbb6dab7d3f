//! The failure modes, typed inside and named outside.

use std::sync::LazyLock;

use crate::critique::{ModeSpec, SpeedBands};
use crate::kessler::reward::Objective;

/// Why an episode of kessler loses score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Collision,
    Rogue,
    Fragment,
    Risk,
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
            Self::Risk => "risk",
            Self::Decay => "decay",
            Self::FuelStarvation => "fuel_starvation",
            Self::Overshoot => "overshoot",
            Self::Short => "short",
            Self::BreakUp => "break_up",
            Self::WastedFuel => "wasted_fuel",
        }
    }

    fn spec(self) -> ModeSpec {
        let about = match self {
            Self::Collision => "debris that was there from the start hit a satellite",
            Self::Rogue => "rogue debris hit a satellite",
            Self::Fragment => "a fragment of another satellite hit a satellite",
            Self::Risk => {
                "under risk: pc, encounters left a satellite less than 0.9 probability of survival, or less than the goal takes"
            }
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

/// Why an episode of this objective can lose score.
pub(in crate::kessler) fn modes(objective: Objective) -> &'static [ModeSpec] {
    static LISTS: LazyLock<[Vec<ModeSpec>; 4]> = LazyLock::new(|| {
        [list(&[]), list(&[Mode::WastedFuel]), list(&[Mode::Overshoot, Mode::Short]), list(&[Mode::BreakUp])]
    });
    let [survival, eco_station, rendezvous, formation] = &*LISTS;
    match objective {
        Objective::Survival => survival,
        Objective::EcoStation => eco_station,
        Objective::Rendezvous => rendezvous,
        Objective::Formation => formation,
    }
}

/// What can happen in every task, and more.
fn list(more: &[Mode]) -> Vec<ModeSpec> {
    let common =
        [Mode::Collision, Mode::Rogue, Mode::Fragment, Mode::Risk, Mode::Decay, Mode::FuelStarvation];
    common.iter().chain(more).map(|mode| mode.spec()).collect()
}

/// How relative speeds are sorted.
pub(in crate::kessler) const SPEED_BANDS: SpeedBands =
    SpeedBands { edges: &[1.0, 2.0, 4.0, 8.0], unit: "LU/TU" };
