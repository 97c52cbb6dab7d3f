//! Policies that ignore the positions of the deputies.

use crate::docking::telemetry::DockingTelemetry;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::log::ActionLog;
use crate::policy::TypedPolicy;
use crate::seed::Seed;

/// Applies a uniform random thrust on every axis in every step.
pub(super) struct RandomThrustPolicy(SeededRng);

impl RandomThrustPolicy {
    pub(super) fn new(seed: Seed) -> Self {
        Self(SeededRng::new(seed))
    }
}

impl TypedPolicy<DockingTelemetry> for RandomThrustPolicy {
    fn append_actions(&mut self, observation: &DockingTelemetry, log: &mut ActionLog) {
        let bound = observation.thrust_bound;
        for deputy in &observation.deputies {
            let thrust = [(); 3].map(|()| self.0.uniform_in(RngStream::Policy, -bound, bound));
            if deputy.is_active() {
                log.push_entry(deputy.id, &thrust);
            }
        }
    }
}

/// Applies the same thrust to every deputy for the first [`BLIND_DURATION_S`] seconds.
pub(super) struct BlindThrustPolicy;

/// Duration of the blind policy's thrust, s.
const BLIND_DURATION_S: f64 = 10.0;
/// Thrust of the blind policy along x, N.
const BLIND_THRUST_N: f64 = -1.0;

impl TypedPolicy<DockingTelemetry> for BlindThrustPolicy {
    fn append_actions(&mut self, observation: &DockingTelemetry, log: &mut ActionLog) {
        if observation.time_s < BLIND_DURATION_S {
            for deputy in observation.deputies.iter().filter(|d| d.is_active()) {
                log.push_entry(deputy.id, &[BLIND_THRUST_N, 0.0, 0.0]);
            }
        }
    }
}
