//! A causal look-ahead pilot: predicts visible debris by the plain dynamics, whatever options the scenario has, since what
//! it sees does not tell them; and where hold would be hit within the look-ahead, tries burns now in 16 directions and takes the gentlest that clears.

use super::learner::{burn, keeping};
use crate::kessler::kernel::Body;
use crate::kessler::planner::ahead::LookAhead;
use crate::kessler::planner::formation::Keeping;
use crate::kessler::planner::table::Table;
use crate::kessler::planner::transfer::{affordable, feedback};
use crate::kessler::setup::Physics;
use crate::kessler::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::Pilot;

pub(super) struct Heuristic;

impl Pilot<Telemetry> for Heuristic {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        let debris: Vec<Body> = seen.radar_debris.iter().map(|d| d.body()).collect();
        let ahead = Table::propagate(&debris, &[], LookAhead::STEADY.steps, Physics::PLAIN);
        let kept = keeping(seen, &Keeping::STEADY);
        for s in seen.satellites.iter().filter(|s| s.active()) {
            let transferring = s.id == 0 && seen.target_radius > 0.0;
            let planned = if transferring { transfer(&s.body()) } else { kept.get(s.id as usize).copied() };
            let planned = planned.and_then(|(x, y)| affordable(x, y, s.fuel));
            burn(s, LookAhead::STEADY.dodge(s.body(), s.fuel, planned, &ahead, 0), log);
        }
    }
}

/// Gains that reach radius 100 LU in about twenty steps and stay, at any fuel that allows it.
fn transfer(body: &Body) -> Option<(f64, f64)> {
    let ((rx, ry), (tx, ty)) = body.frame();
    let (dr, dt) = feedback(body, body.radius(), 0.3, 0.5, 2.5);
    ((dr * dr + dt * dt).sqrt() >= 0.05).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
}
