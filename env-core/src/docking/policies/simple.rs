//! Policies that hardly look.

use crate::chance::{Chance, Seeded, Stream};
use crate::docking::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::Pilot;
use crate::seed::Seed;

/// Thrusts at random on every axis, every step.
pub(super) struct Random(Seeded);

impl Random {
    pub(super) fn new(seed: Seed) -> Self {
        Self(Seeded::new(seed))
    }
}

impl Pilot<Telemetry> for Random {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        let bound = seen.thrust_bound;
        for deputy in &seen.deputies {
            let thrust = [(); 3].map(|()| self.0.between(Stream::Policy, -bound, bound));
            if deputy.active() {
                log.act(deputy.id, &thrust);
            }
        }
    }
}

/// The same thrust for everybody at the start, whatever there is.
pub(super) struct Blind;

/// How long, s, and how hard, N on x.
const BLIND: (f64, f64) = (10.0, -1.0);

impl Pilot<Telemetry> for Blind {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        if seen.time_s < BLIND.0 {
            for deputy in seen.deputies.iter().filter(|d| d.active()) {
                log.act(deputy.id, &[BLIND.1, 0.0, 0.0]);
            }
        }
    }
}
