//! Policies that look at nothing, or follow a plan.

use super::Pilot;
use crate::chance::{Chance, Seeded, Stream};
use crate::docking::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::seed::Seed;

/// Does nothing.
pub(super) struct Hold;

impl Pilot for Hold {
    fn fly(&mut self, _: &Telemetry, _: &mut ActionLog) {}
}

/// Thrusts at random on every axis, every step.
pub(super) struct Random(Seeded);

impl Random {
    pub(super) fn new(seed: Seed) -> Self {
        Self(Seeded::new(seed))
    }
}

impl Pilot for Random {
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

impl Pilot for Blind {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        if seen.time_s < BLIND.0 {
            for deputy in seen.deputies.iter().filter(|d| d.active()) {
                log.act(deputy.id, &[BLIND.1, 0.0, 0.0]);
            }
        }
    }
}

/// Follows a plan step by step.
pub(super) struct Witness {
    plan: ActionLog,
    step: usize,
}

impl Witness {
    pub(super) const fn new(plan: ActionLog) -> Self {
        Self { plan, step: 0 }
    }
}

impl Pilot for Witness {
    fn fly(&mut self, _: &Telemetry, log: &mut ActionLog) {
        let action = self.plan.step(self.step);
        self.step += 1;
        for (&agent, thrust) in action.agents.iter().zip(action.values.chunks_exact(3)) {
            log.act(agent, thrust);
        }
    }
}
