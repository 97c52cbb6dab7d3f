//! A causal look-ahead pilot: predicts visible debris by the true dynamics, and where hold would be hit within the
//! look-ahead, tries burns now in 16 directions and takes the gentlest that clears.

use super::Pilot;
use super::learner::{burn, keeping};
use crate::kessler::constants::CONTACT_2;
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::planner::formation::Keeping;
use crate::kessler::planner::panel::capped;
use crate::kessler::planner::table::Table;
use crate::kessler::planner::transfer::{affordable, feedback};
use crate::kessler::setup::Physics;
use crate::kessler::telemetry::Telemetry;
use crate::log::ActionLog;

/// Steps it looks ahead.
const LOOK_AHEAD: u32 = 12;
/// Steps before a predicted contact at which it acts: later burns keep fuel and have seen more.
const ACT_WITHIN: u32 = 8;
const SIZES: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
const DIRECTIONS: u32 = 16;
/// It wants this much more than contact distance, as a factor of distance squared.
const MARGIN: f64 = 1.2;

pub(super) struct Heuristic;

impl Pilot for Heuristic {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        let debris: Vec<Body> = seen.radar_debris.iter().map(|d| d.body()).collect();
        let ahead = Table::propagate(&debris, &[], LOOK_AHEAD, Physics::PLAIN);
        let kept = keeping(seen, &Keeping::STEADY);
        for s in seen.satellites.iter().filter(|s| s.active()) {
            let transferring = s.id == 0 && seen.target_radius > 0.0;
            let planned = if transferring { transfer(&s.body()) } else { kept.get(s.id as usize).copied() };
            let planned = planned.and_then(|(x, y)| affordable(x, y, s.fuel));
            burn(s, dodge(s.body(), s.fuel, planned, &ahead), log);
        }
    }
}

/// `planned`, unless it leads into something: then the gentlest burn that does not.
fn dodge(body: Body, fuel: f64, planned: Option<(f64, f64)>, ahead: &Table) -> Option<(f64, f64)> {
    let hit = first_contact(body, planned.unwrap_or_default(), ahead, CONTACT_2);
    if hit.is_none_or(|step| step > ACT_WITHIN) {
        return planned;
    }
    let mut best = (hit, planned);
    for size in SIZES {
        let size = capped(size, fuel);
        for direction in 0..DIRECTIONS {
            let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS);
            let (sin, cos) = libm::sincos(angle);
            let dv = (size * cos, size * sin);
            match first_contact(body, dv, ahead, CONTACT_2 * MARGIN) {
                None => return Some(dv),
                later if later > best.0 => best = (later, Some(dv)),
                _ => {}
            }
        }
    }
    best.1
}

/// The step, counted from 1, at which something comes nearer than `limit` (squared) after a burn now.
fn first_contact(mut body: Body, dv: (f64, f64), ahead: &Table, limit: f64) -> Option<u32> {
    body.vx += dv.0;
    body.vy += dv.1;
    (1..=LOOK_AHEAD).find(|&step| {
        body = body.coasted(Gravity::Point);
        (0..ahead.len()).any(|column| ahead.clear_of(column, step as usize, body.x, body.y) < limit)
    })
}

/// Gains that reach radius 100 LU in about twenty steps and stay, at any fuel that allows it.
fn transfer(body: &Body) -> Option<(f64, f64)> {
    let ((rx, ry), (tx, ty)) = body.frame();
    let (dr, dt) = feedback(body, body.radius(), 0.3, 0.5, 2.5);
    ((dr * dr + dt * dt).sqrt() >= 0.05).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
}
