//! A causal pilot: every deputy by the proportional approach, as if it were alone.

use crate::docking::approach::Approach;
use crate::docking::constants::MAX_THRUST_N;
use crate::docking::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::Pilot;

pub(super) struct Proportional(pub(super) Approach);

impl Pilot<Telemetry> for Proportional {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        for deputy in seen.deputies.iter().filter(|d| d.active()) {
            log.act(deputy.id, &self.0.thrust(&deputy.state(), MAX_THRUST_N));
        }
    }
}
