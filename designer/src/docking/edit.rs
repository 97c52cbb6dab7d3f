//! Edits of designs: small random changes, which evolution of layouts is made of.

use env_core::{KeyedRng, Scenario};

use super::aim::DeputyCounts;
use super::checks::is_playable;
use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::{
    AZIMUTH, CLOSING, CROSS, CROSS_DIRECTION, DISTANCE, DeputyBound, ELEVATION, effective_choices,
    wrap_degrees,
};
use crate::brief::DesignBrief;

/// Maximum number of attempts to edit a design.
const MAX_ATTEMPTS: u32 = 12;

/// Edit of a design. Returns false if it does not apply.
type StartEdit = fn(&mut DockingDesign, &DesignBrief, &mut KeyedRng) -> bool;

/// Edits of a design, each as likely as the others.
const EDITS: [StartEdit; 8] = [
    turn_all,
    turn_one,
    change_distance,
    change_closing_speed,
    change_cross_speed,
    add_deputy,
    remove_deputy,
    change_param,
];

/// Returns a design after two to four edits, if it passes all checks before the planner in the base scenario; `None` if no
/// attempt succeeds.
pub(super) fn edit_design(
    design: &DockingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<DockingDesign> {
    (0..MAX_ATTEMPTS).find_map(|_| {
        let mut child = design.clone();
        child.name.clear();
        for _ in 0..rng.range_inclusive(2, 4) {
            let edit = EDITS[rng.below(EDITS.len() as u32) as usize];
            edit(&mut child, brief, rng);
        }
        let is_changed = child.deputies != design.deputies || child.params != design.params;
        (is_changed && is_playable(&child, base)).then_some(child)
    })
}

/// Returns a random deputy; `None` if there is none.
fn pick<'a>(design: &'a mut DockingDesign, rng: &mut KeyedRng) -> Option<&'a mut DeputyStart> {
    let count = u32::try_from(design.deputies.len()).ok().filter(|count| *count > 0)?;
    design.deputies.get_mut(rng.below(count) as usize)
}

/// Returns a change of up to `max` either way.
fn change(max: u32, rng: &mut KeyedRng) -> i32 {
    rng.range_inclusive(0, 2 * max).cast_signed() - max.cast_signed()
}

/// Changes a number by up to `max` either way, within its bounds.
fn jitter(number: i32, max: u32, bound: DeputyBound, rng: &mut KeyedRng) -> i32 {
    (number + change(max, rng)).clamp(bound.min, bound.max)
}

/// Turns an azimuth by an angle in degrees.
fn turn(azimuth_deg: i32, angle_deg: i32) -> i32 {
    wrap_degrees(AZIMUTH.value(azimuth_deg + angle_deg))
}

/// Turns all deputies and the aim around the chief by up to 20 degrees.
fn turn_all(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let angle = change(20, rng);
    design.aim.bearing_deg = design.aim.bearing_deg.map(|bearing| turn(bearing, angle));
    design.deputies.iter_mut().for_each(|deputy| deputy.azimuth_deg = turn(deputy.azimuth_deg, angle));
    true
}

/// Turns one deputy by up to 15 degrees.
fn turn_one(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(deputy) = pick(design, rng) else { return false };
    deputy.azimuth_deg = turn(deputy.azimuth_deg, change(15, rng));
    deputy.elevation_deg = jitter(deputy.elevation_deg, 15, ELEVATION, rng);
    true
}

/// Moves one deputy nearer or farther by up to a fifth.
fn change_distance(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(deputy) = pick(design, rng) else { return false };
    let ratio = 1.0 + 0.01 * f64::from(change(20, rng));
    deputy.distance = DISTANCE.nearest(DISTANCE.value(deputy.distance) * ratio);
    true
}

/// Makes one deputy faster or slower towards the chief.
fn change_closing_speed(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(deputy) = pick(design, rng) else { return false };
    deputy.closing_speed = jitter(deputy.closing_speed, 30, CLOSING, rng);
    true
}

/// Changes the speed of one deputy across its line to the chief.
fn change_cross_speed(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(deputy) = pick(design, rng) else { return false };
    deputy.cross_speed = jitter(deputy.cross_speed, 30, CROSS, rng);
    deputy.cross_deg = wrap_degrees(CROSS_DIRECTION.value(deputy.cross_deg + change(40, rng)));
    true
}

/// Adds a copy of a deputy beside it, if the brief allows one more.
fn add_deputy(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    if !DeputyCounts::of(brief).contains(design.deputies.len() + 1) {
        return false;
    }
    let Some(mut copy) = pick(design, rng).map(|deputy| *deputy) else { return false };
    copy.azimuth_deg = turn(copy.azimuth_deg, 20 + rng.below(320).cast_signed());
    copy.distance = jitter(copy.distance, 50, DISTANCE, rng);
    design.deputies.push(copy);
    true
}

/// Removes a deputy, if the brief allows one fewer.
fn remove_deputy(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let count = design.deputies.len();
    let can_remove = count > 1 && DeputyCounts::of(brief).contains(count - 1);
    if can_remove {
        design.deputies.remove(rng.below(count as u32) as usize);
    }
    can_remove
}

/// Sets time limit or thrust bound to one of its choices.
fn change_param(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let choices = effective_choices(brief);
    let Some(count) = u32::try_from(choices.len()).ok().filter(|count| *count > 0) else { return false };
    let choice = choices[rng.below(count) as usize];
    let value = choice.values[rng.below(choice.values.len() as u32) as usize];
    design.params.insert(choice.param.clone(), value);
    true
}
