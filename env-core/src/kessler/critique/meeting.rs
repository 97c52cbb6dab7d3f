//! The geometry of a contact: from where, how fast, seen since when, and whether it could have been avoided.

use super::Case;
use super::remedy::{Danger, search};
use super::trace::{End, Met};
use crate::critique::{BEARING_STEPS, Encounter, angle_deg};
use crate::kessler::kernel::Body;

/// How a satellite and debris met.
pub(super) fn encounter(case: &Case<'_>, satellite: usize, end: End, met: Met) -> Encounter {
    let first_visible_step = case.sky.first_seen(met.who, end.step);
    let remedy = first_visible_step.map(|seen| {
        let danger = Danger { satellite, from: seen + 1, step: end.step, who: Some(met.who), fuel: None };
        search(case.plans, case.sky, case.trace, danger)
    });
    // Not before there was anything to be seen; and not at contact, unless that is all there was.
    let early = end.step - BEARING_STEPS.min(end.step);
    let step = early.max(case.sky.arrival(met.who)).max(first_visible_step.unwrap_or(0)).min(end.step);
    let of = case.trace.satellite(satellite, step).body;
    let at = case.sky.place(met.who, step).unwrap_or((met.body.x, met.body.y));
    let own = case.trace.satellite(satellite, end.step).body;
    let (dvx, dvy) = (met.body.vx - own.vx, met.body.vy - own.vy);
    Encounter {
        body: met.id,
        bearing_deg: bearing(&of, at),
        bearing_inertial_deg: Some(angle_deg(at.0 - of.x, at.1 - of.y)),
        relative_speed: (dvx * dvx + dvy * dvy).sqrt(),
        first_visible_step,
        steps_left: first_visible_step.map_or(0, |seen| end.step - seen),
        avoidable: remedy.as_ref().map(Option::is_some),
        cheapest: remedy.flatten(),
    }
}

/// From radial out towards in-track, degrees in [0, 360).
fn bearing(of: &Body, at: (f64, f64)) -> f64 {
    let ((rx, ry), (tx, ty)) = of.frame();
    let (dx, dy) = (at.0 - of.x, at.1 - of.y);
    angle_deg(dx * rx + dy * ry, dx * tx + dy * ty)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bearings_run_from_radial_out_to_in_track() {
        let of = Body { x: 0.0, y: 50.0, vx: -4.0, vy: 0.0 };
        // Above it, ahead of it (prograde is −x up there), below it, behind it.
        let around = [(0.0, 60.0), (-10.0, 50.0), (0.0, 40.0), (10.0, 50.0)].map(|at| bearing(&of, at));
        for (found, wanted) in around.into_iter().zip([0.0, 90.0, 180.0, 270.0]) {
            // One rounding of atan2 and one of the scale.
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
        assert!(angle_deg(1.0, -1e-300) < 360.0);
    }
}
