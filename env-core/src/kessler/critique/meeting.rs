//! The geometry of a contact: from where, how fast, seen since when, and whether it could have been avoided.

use super::Case;
use super::remedy::{Danger, search};
use super::trace::{End, Met};
use crate::critique::{BEARING_STEPS, Encounter};
use crate::kessler::bearing::Frame;

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
        bearing_deg: Frame::RadialInTrack.bearing_deg(&of, at),
        bearing_inertial_deg: Some(Frame::Inertial.bearing_deg(&of, at)),
        relative_speed: (dvx * dvx + dvy * dvy).sqrt(),
        first_visible_step,
        steps_left: first_visible_step.map_or(0, |seen| end.step - seen),
        avoidable: remedy.as_ref().map(Option::is_some),
        cheapest: remedy.flatten(),
    }
}
