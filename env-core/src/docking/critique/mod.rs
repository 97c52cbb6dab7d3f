//! The critique of an episode of docking: why each deputy that did not dock was lost, what its thrusts were worth, and the
//! judge's verdict.

mod collision;
mod failures;
mod judge;
mod thrust_arcs;
mod trajectory;

use self::trajectory::DockingTrajectory;
use crate::critique::{Critique, FailureModeSpec, SpeedBands};
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::task::Scenario;

/// The failure modes of docking.
pub(super) static DOCKING_FAILURE_MODES: [FailureModeSpec; 5] = [
    FailureModeSpec {
        name: "crash",
        description: "a deputy came within the docking radius faster than the speed limit",
    },
    FailureModeSpec {
        name: "saturation",
        description: "a deputy violated the speed limit until it was stopped",
    },
    FailureModeSpec { name: "out_of_bounds", description: "a deputy flew farther than 10 km from the chief" },
    FailureModeSpec { name: "collision", description: "two deputies came closer than 0.5 m to each other" },
    FailureModeSpec { name: "timeout", description: "a deputy had not docked when time ran out" },
];

/// Bands of relative speed; docking is allowed up to 0.2 m/s.
pub(super) const DOCKING_SPEED_BANDS: SpeedBands = SpeedBands { edges: &[0.1, 0.2, 0.4, 0.8], unit: "m/s" };

/// Analyses an episode by its scenario and log.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
    let trajectory = DockingTrajectory::replay(scenario, log)?;
    Ok(Critique {
        failures: failures::find_failures(&trajectory),
        actions: thrust_arcs::judge_arcs(&trajectory),
        assessment: judge::judge(&trajectory),
    })
}
