//! The policy that steers each deputy by the approach law, as if it were alone.

use crate::docking::approach_law::ApproachLaw;
use crate::docking::constants::MAX_THRUST_N;
use crate::docking::telemetry::DockingTelemetry;
use crate::log::ActionLog;
use crate::policy::TypedPolicy;

/// Steers each deputy by the same approach law.
pub(super) struct ApproachPolicy(pub(super) ApproachLaw);

impl TypedPolicy<DockingTelemetry> for ApproachPolicy {
    fn append_actions(&mut self, observation: &DockingTelemetry, log: &mut ActionLog) {
        for deputy in observation.deputies.iter().filter(|d| d.is_active()) {
            log.push_entry(deputy.id, &self.0.thrust(&deputy.state(), MAX_THRUST_N));
        }
    }
}
