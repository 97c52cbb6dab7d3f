//! Edits of designs: small random changes, which evolution of layouts is made of.

use env_core::{KeyedRng, Scenario};

use super::aim::DeputyCounts;
use super::checks::is_playable;
use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::{AZIMUTH, CLOSING, CROSS, CROSS_DIRECTION, DISTANCE, ELEVATION, effective_choices};
use crate::angles::whole_degrees;
use crate::bound::draw_change;
use crate::brief::DesignBrief;
use crate::mutation::set_random_param;

/// Maximum number of attempts to edit a design.
const MAX_ATTEMPTS: u32 = 12;

/// Edit of a design. It changes nothing if it does not apply.
type StartEdit = fn(&mut DockingDesign, &DesignBrief, &mut KeyedRng);

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

/// Returns a design after two to four edits; `None` if no attempt leads to a design that passes all checks before the planner in
/// the base scenario.
pub(super) fn edit_design(
    design: &DockingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<DockingDesign> {
    retry_edits(design, base, rng, |child, rng| {
        for _ in 0..rng.range_inclusive(2, 4) {
            EDITS[rng.below(EDITS.len() as u32) as usize](child, brief, rng);
        }
    })
}

/// Returns a copy of a design that `edit` changed, if it passes all checks before the planner in the base scenario; `None` if no
/// attempt succeeds.
pub(super) fn retry_edits(
    design: &DockingDesign,
    base: &Scenario,
    rng: &mut KeyedRng,
    edit: impl Fn(&mut DockingDesign, &mut KeyedRng),
) -> Option<DockingDesign> {
    (0..MAX_ATTEMPTS).find_map(|_| {
        let mut child = design.clone();
        child.name.clear();
        edit(&mut child, rng);
        let is_changed = child.deputies != design.deputies || child.params != design.params;
        (is_changed && is_playable(&child, base)).then_some(child)
    })
}

/// Returns a random deputy; `None` if there is none.
fn pick<'a>(design: &'a mut DockingDesign, rng: &mut KeyedRng) -> Option<&'a mut DeputyStart> {
    let count = u32::try_from(design.deputies.len()).ok().filter(|count| *count > 0)?;
    design.deputies.get_mut(rng.below(count) as usize)
}

/// Turns all deputies and the aim around the chief by up to 20 degrees.
pub(super) fn turn_all(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    let angle = draw_change(20, rng) as f64;
    let turn = |azimuth_deg: i32| i32::from(whole_degrees(f64::from(azimuth_deg) + angle));
    design.aim.bearing_deg = design.aim.bearing_deg.map(turn);
    design.deputies.iter_mut().for_each(|deputy| deputy.azimuth_deg = turn(deputy.azimuth_deg));
}

/// Turns one deputy by up to 15 degrees.
pub(super) fn turn_one(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(deputy) = pick(design, rng) {
        deputy.azimuth_deg = AZIMUTH.turn(deputy.azimuth_deg, 15, rng);
        deputy.elevation_deg = ELEVATION.jitter(deputy.elevation_deg, 15, rng);
    }
}

/// Moves one deputy nearer or farther by up to a fifth.
fn change_distance(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(deputy) = pick(design, rng) {
        let ratio = 1.0 + 0.01 * draw_change(20, rng) as f64;
        deputy.distance = DISTANCE.nearest(DISTANCE.value(deputy.distance) * ratio);
    }
}

/// Makes one deputy faster or slower towards the chief.
fn change_closing_speed(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(deputy) = pick(design, rng) {
        deputy.closing_speed = CLOSING.jitter(deputy.closing_speed, 30, rng);
    }
}

/// Changes the speed of one deputy across its line to the chief.
fn change_cross_speed(design: &mut DockingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(deputy) = pick(design, rng) {
        deputy.cross_speed = CROSS.jitter(deputy.cross_speed, 30, rng);
        deputy.cross_deg = CROSS_DIRECTION.turn(deputy.cross_deg, 40, rng);
    }
}

/// Adds a copy of a deputy beside it, if the brief allows one more.
pub(super) fn add_deputy(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) {
    if !DeputyCounts::of(brief).contains(design.deputies.len() + 1) {
        return;
    }
    if let Some(mut copy) = pick(design, rng).map(|deputy| *deputy) {
        let angle = 20 + rng.below(320).cast_signed();
        copy.azimuth_deg = whole_degrees(f64::from(copy.azimuth_deg + angle)).into();
        copy.distance = DISTANCE.jitter(copy.distance, 50, rng);
        design.deputies.push(copy);
    }
}

/// Removes a deputy, if the brief allows one fewer.
pub(super) fn remove_deputy(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) {
    let count = design.deputies.len();
    if count > 1 && DeputyCounts::of(brief).contains(count - 1) {
        design.deputies.remove(rng.below(count as u32) as usize);
    }
}

/// Sets time limit or thrust bound to one of its choices.
fn change_param(design: &mut DockingDesign, brief: &DesignBrief, rng: &mut KeyedRng) {
    set_random_param(&mut design.params, &effective_choices(brief), rng);
}
