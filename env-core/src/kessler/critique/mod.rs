//! What an episode of kessler shows.

use crate::critique::{Critique, Judged, ModeSpec, SpeedBands};
use crate::log::ActionLog;
use crate::rollout::ReplayError;
use crate::scenario::Scenario;

/// Why an episode of kessler can lose score.
pub static MODES: [ModeSpec; 1] = [ModeSpec { name: "collision", about: "debris hit a satellite" }];

/// How relative speeds are sorted.
pub const SPEED_BANDS: SpeedBands = SpeedBands { edges: &[1.0, 2.0, 4.0, 8.0], unit: "LU/TU" };

/// What an episode shows.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
    crate::rollout::replay(scenario, log)?;
    Ok(Critique {
        failures: Vec::new(),
        actions: Vec::new(),
        judged: Judged { value: 0.0, case: "no_action_needed", words: String::new() },
    })
}
