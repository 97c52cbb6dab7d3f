//! What an episode of docking shows: why each deputy that did not dock was lost, what its thrusts were worth, and the
//! judge's word.

mod arcs;
mod collision;
mod failures;
mod flown;
mod judge;

use self::flown::Course;
use crate::critique::{Critique, ModeSpec, SpeedBands};
use crate::log::ActionLog;
use crate::rollout::ReplayError;
use crate::scenario::Scenario;

/// Why an episode of docking can lose score.
pub(super) static MODES: [ModeSpec; 5] = [
    ModeSpec { name: "crash", about: "a deputy came within the docking radius faster than the speed limit" },
    ModeSpec { name: "saturation", about: "a deputy violated the speed limit until it was stopped" },
    ModeSpec { name: "out_of_bounds", about: "a deputy flew farther than 10 km from the chief" },
    ModeSpec { name: "collision", about: "two deputies came closer than 0.5 m to each other" },
    ModeSpec { name: "timeout", about: "a deputy had not docked when time ran out" },
];

/// How relative speeds are sorted: docking is allowed up to 0.2 m/s.
pub(super) const SPEED_BANDS: SpeedBands = SpeedBands { edges: &[0.1, 0.2, 0.4, 0.8], unit: "m/s" };

/// What an episode shows.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
    let course = Course::fly(scenario, log)?;
    Ok(Critique { failures: failures::of(&course), actions: arcs::of(&course), judged: judge::of(&course) })
}
