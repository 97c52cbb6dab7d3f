//! Causal look-ahead policy. It forecasts visible debris by the default physics, since telemetry does not
//! show the physics options. If hold would be hit within the look-ahead, it tries burns now in 16 directions
//! and takes the gentlest that avoids the contact.

use super::common::{keep_formation, log_burn};
use crate::kessler::kernel::Body;
use crate::kessler::planner::ephemeris::DebrisEphemeris;
use crate::kessler::planner::formation::FormationGains;
use crate::kessler::planner::look_ahead::LookAhead;
use crate::kessler::planner::transfer::{affordable_burn, radius_feedback};
use crate::kessler::setup::Physics;
use crate::kessler::telemetry::KesslerTelemetry;
use crate::log::ActionLog;
use crate::policy::TypedPolicy;

/// Policy `heuristic`, which keeps no state.
pub(super) struct HeuristicPolicy;

impl TypedPolicy<KesslerTelemetry> for HeuristicPolicy {
    fn append_actions(&mut self, telemetry: &KesslerTelemetry, log: &mut ActionLog) {
        let look_ahead = LookAhead::DEFAULT;
        let debris: Vec<Body> = telemetry.radar_debris.iter().map(|d| d.body()).collect();
        let ephemeris = DebrisEphemeris::propagate(&debris, &[], look_ahead.steps, Physics::DEFAULT);
        let formation = keep_formation(telemetry, &FormationGains::DEFAULT);
        for s in telemetry.satellites.iter().filter(|s| s.is_active()) {
            let has_target = s.id == 0 && telemetry.target_radius > 0.0;
            let planned =
                if has_target { transfer_burn(&s.body()) } else { formation.get(s.id as usize).copied() };
            let planned = planned.and_then(|(x, y)| affordable_burn(x, y, s.fuel));
            log_burn(s, look_ahead.dodge(s.body(), s.fuel, planned, &ephemeris, 0), log);
        }
    }
}

/// Burn (dvx, dvy) of a transfer that reaches radius 100 LU in about twenty steps and stays, with any fuel
/// that allows it.
fn transfer_burn(body: &Body) -> Option<(f64, f64)> {
    let ((rx, ry), (tx, ty)) = body.local_axes();
    let (dr, dt) = radius_feedback(body, body.radius(), 0.3, 0.5, 2.5);
    ((dr * dr + dt * dt).sqrt() >= 0.05).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
}
