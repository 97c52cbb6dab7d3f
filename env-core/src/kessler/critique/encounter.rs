//! Geometry of an encounter: direction and speed of the debris, since when it was visible, and if it could
//! have been avoided.

use super::analysis::EpisodeAnalysis;
use super::remedy::{LossToAvoid, find_remedy};
use super::trace::{DebrisContact, LossEvent};
use crate::critique::{BEARING_STEPS, Encounter};
use crate::kessler::bearing::BearingFrame;

/// Describes the encounter in which a satellite was lost.
pub(super) fn describe(
    analysis: &EpisodeAnalysis<'_>,
    satellite: usize,
    loss: LossEvent,
    debris: DebrisContact,
) -> Encounter {
    let visibility = analysis.visibility;
    let first_visible_step = visibility.first_visible_step(debris.identity, loss.step);
    let remedy = first_visible_step.map(|visible| {
        let to_avoid = LossToAvoid {
            satellite,
            from: visible + 1,
            step: loss.step,
            debris: Some(debris.identity),
            fuel: None,
        };
        find_remedy(analysis.counterfactuals, visibility, analysis.trace, to_avoid)
    });
    // The bearing is taken some steps before contact, but not before the debris was visible.
    let early = loss.step - BEARING_STEPS.min(loss.step);
    let step =
        early.max(visibility.arrival(debris.identity)).max(first_visible_step.unwrap_or(0)).min(loss.step);
    let observer = analysis.trace.satellite(satellite, step).body;
    let (x, y) = visibility.position(debris.identity, step).unwrap_or((debris.body.x, debris.body.y));
    let own = analysis.trace.satellite(satellite, loss.step).body;
    let (dvx, dvy) = (debris.body.vx - own.vx, debris.body.vy - own.vy);
    Encounter {
        body: debris.id,
        bearing_deg: BearingFrame::RadialInTrack.bearing_deg(&observer, [x, y]),
        bearing_inertial_deg: Some(BearingFrame::Inertial.bearing_deg(&observer, [x, y])),
        relative_speed: (dvx * dvx + dvy * dvy).sqrt(),
        first_visible_step,
        steps_left: first_visible_step.map_or(0, |visible| loss.step - visible),
        avoidable: remedy.as_ref().map(Option::is_some),
        cheapest_avoidance: remedy.flatten(),
    }
}
