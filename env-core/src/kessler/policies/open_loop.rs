//! Policies that ignore debris.

use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::planner::panel::{KickDirection, affordable_size};
use crate::kessler::telemetry::KesslerTelemetry;
use crate::log::ActionLog;
use crate::policy::TypedPolicy;
use crate::seed::Seed;

/// The `random` policy: burns at random on every axis in every step.
pub(super) struct RandomBurnPolicy(SeededRng);

impl RandomBurnPolicy {
    pub(super) fn new(seed: Seed) -> Self {
        Self(SeededRng::new(seed))
    }
}

impl TypedPolicy<KesslerTelemetry> for RandomBurnPolicy {
    fn append_actions(&mut self, telemetry: &KesslerTelemetry, log: &mut ActionLog) {
        for s in &telemetry.satellites {
            let mut draw = || self.0.uniform_in(RngStream::Policy, -1.0, 1.0);
            let burn = [draw(), draw()];
            if s.is_active() {
                log.push_entry(s.id, &burn);
            }
        }
    }
}

/// The `blind` policy: one radial kick of 0.2 LU/TU in the first step.
pub(super) struct BlindKickPolicy {
    has_kicked: bool,
}

impl BlindKickPolicy {
    pub(super) const fn new() -> Self {
        Self { has_kicked: false }
    }
}

/// Size of the blind kick, LU/TU.
const BLIND_KICK: f64 = 0.2;

impl TypedPolicy<KesslerTelemetry> for BlindKickPolicy {
    fn append_actions(&mut self, telemetry: &KesslerTelemetry, log: &mut ActionLog) {
        if std::mem::replace(&mut self.has_kicked, true) {
            return;
        }
        for s in telemetry.satellites.iter().filter(|s| s.is_active()) {
            let (x, y) = KickDirection::RadialOut.unit_vector(&s.body());
            let size = affordable_size(BLIND_KICK, s.fuel);
            log.push_entry(s.id, &[size * x, size * y]);
        }
    }
}
