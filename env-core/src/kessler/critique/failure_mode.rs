//! Failure modes of kessler: an enum inside the critique, names outside.

use std::sync::LazyLock;

use crate::critique::{FailureModeSpec, SpeedBands};
use crate::kessler::reward::Objective;

/// Reason why an episode of kessler loses score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KesslerFailureMode {
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

impl KesslerFailureMode {
    /// Modes that any task can have.
    const COMMON: [Self; 6] =
        [Self::Collision, Self::Rogue, Self::Fragment, Self::Risk, Self::Decay, Self::FuelStarvation];

    /// Name of the mode in critiques.
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

    fn spec(self) -> FailureModeSpec {
        let description = match self {
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
        FailureModeSpec { name: self.name(), description }
    }
}

/// Failure modes of the task with this objective.
pub(in crate::kessler) fn failure_modes(objective: Objective) -> &'static [FailureModeSpec] {
    use KesslerFailureMode::{BreakUp, Overshoot, Short, WastedFuel};
    static SPECS: LazyLock<[Vec<FailureModeSpec>; 4]> =
        LazyLock::new(|| [specs(&[]), specs(&[WastedFuel]), specs(&[Overshoot, Short]), specs(&[BreakUp])]);
    let [survival, eco_station, rendezvous, formation] = &*SPECS;
    match objective {
        Objective::Survival => survival,
        Objective::EcoStation => eco_station,
        Objective::Rendezvous => rendezvous,
        Objective::Formation => formation,
    }
}

/// Specifications of the common modes and of `more`.
fn specs(more: &[KesslerFailureMode]) -> Vec<FailureModeSpec> {
    KesslerFailureMode::COMMON.iter().chain(more).map(|mode| mode.spec()).collect()
}

/// Bands of the relative speed of encounters.
pub(in crate::kessler) const KESSLER_SPEED_BANDS: SpeedBands =
    SpeedBands { edges: &[1.0, 2.0, 4.0, 8.0], unit: "LU/TU" };
