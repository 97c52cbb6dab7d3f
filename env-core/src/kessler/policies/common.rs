//! Helpers that several policies share.

use crate::kessler::kernel::Gravity;
use crate::kessler::planner::formation::{FormationGains, formation_burns};
use crate::kessler::planner::transfer::affordable_burn;
use crate::kessler::telemetry::{KesslerTelemetry, SatelliteTelemetry};
use crate::log::ActionLog;

/// Formation burns (dvx, dvy) by satellite. Empty if the task has no formation or a satellite is lost.
pub(super) fn keep_formation(telemetry: &KesslerTelemetry, gains: &FormationGains) -> Vec<(f64, f64)> {
    let [a, b, c] = telemetry.satellites.as_slice() else { return Vec::new() };
    if telemetry.target_separation <= 0.0 || ![a, b, c].iter().all(|s| s.is_active()) {
        return Vec::new();
    }
    formation_burns(&[a.body(), b.body(), c.body()], gains, Gravity::Point).to_vec()
}

/// Appends a burn (dvx, dvy) to the log, scaled to what one step and the fuel allow.
pub(super) fn log_burn(satellite: &SatelliteTelemetry, burn: Option<(f64, f64)>, log: &mut ActionLog) {
    if let Some((dvx, dvy)) = burn.and_then(|(x, y)| affordable_burn(x, y, satellite.fuel)) {
        log.push_entry(satellite.id, &[dvx, dvy]);
    }
}
