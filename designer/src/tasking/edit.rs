//! Edits of designs: small random changes, which evolution of layouts is made of.

use env_core::{KeyedRng, Scenario};

use super::build::build_design;
use super::design::{TargetField, TaskingDesign};
use super::params::{choices, station_count};
use super::vocabulary::{
    BATTERY, DAY, MAX_FIELDS, MAX_OUTAGES, MINUTE, NODE_HOUR, OFFSET, PRIORITY_HIGH, PRIORITY_LOW, SPREAD,
    START_ANGLE, STORAGE, TARGETS, UTC_MINUTE, WHEELS,
};
use crate::brief::DesignBrief;
use crate::mutation::set_random_param;

/// Maximum number of attempts to edit a design.
const MAX_ATTEMPTS: u32 = 12;

/// Edit of a design. It changes nothing if it does not apply.
type TaskingEdit = fn(&mut TaskingDesign, &DesignBrief, &mut KeyedRng);

/// Edits of a design, each as likely as the others.
const EDITS: [TaskingEdit; 12] = [
    shift_epoch,
    turn_node,
    move_start,
    change_battery,
    change_wheels,
    change_storage,
    toggle_outage,
    shift_field,
    change_field,
    duplicate_field,
    remove_field,
    change_param,
];

/// Returns a design after two to four edits; `None` if no attempt leads to a design that matches its aim in the base scenario.
pub(super) fn edit_design(
    design: &TaskingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<TaskingDesign> {
    retry_edits(design, base, rng, |child, rng| {
        for _ in 0..rng.range_inclusive(2, 4) {
            EDITS[rng.below(EDITS.len() as u32) as usize](child, brief, rng);
        }
    })
}

/// Returns a copy of a design that `edit` changed, if it still matches its aim in the base scenario; `None` if no attempt succeeds.
pub(super) fn retry_edits(
    design: &TaskingDesign,
    base: &Scenario,
    rng: &mut KeyedRng,
    edit: impl Fn(&mut TaskingDesign, &mut KeyedRng),
) -> Option<TaskingDesign> {
    (0..MAX_ATTEMPTS).find_map(|_| {
        let mut child = design.clone();
        edit(&mut child, rng);
        let is_changed = child != *design;
        child.name.clear();
        (is_changed && build_design(&child, base).is_ok()).then_some(child)
    })
}

/// Moves the epoch by up to 25 days and 90 minutes.
pub(super) fn shift_epoch(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.day = DAY.turn(design.start.day, 25, rng);
    design.start.utc_minute = UTC_MINUTE.turn(design.start.utc_minute, 90, rng);
}

/// Turns the ascending node by up to two hours of local time.
pub(super) fn turn_node(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.node_hour = NODE_HOUR.turn(design.start.node_hour, 2, rng);
}

/// Moves the start along the orbit by up to 30 degrees.
fn move_start(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.start_angle_deg = START_ANGLE.turn(design.start.start_angle_deg, 30, rng);
}

/// Changes the charge by up to 8 percent of the battery.
fn change_battery(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.battery_percent = BATTERY.jitter(design.start.battery_percent, 8, rng);
}

/// Changes the speed of the wheels by up to 8 percent of the limit.
fn change_wheels(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.wheels_percent = WHEELS.jitter(design.start.wheels_percent, 8, rng);
}

/// Changes the data by up to 6 percent of the storage.
fn change_storage(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    design.start.storage_percent = STORAGE.jitter(design.start.storage_percent, 6, rng);
}

/// Puts a station of the level out of service, or back into it.
fn toggle_outage(design: &mut TaskingDesign, brief: &DesignBrief, rng: &mut KeyedRng) {
    let stations = station_count(&brief.recipe);
    let station = rng.below(stations as u32).cast_signed();
    if design.outages.contains(&station) {
        design.outages.retain(|other| *other != station);
    } else if design.outages.len() < MAX_OUTAGES.min(stations - 1) {
        design.outages.push(station);
        design.outages.sort_unstable();
    }
}

/// Returns a random field; `None` if there is none.
pub(super) fn pick<'a>(design: &'a mut TaskingDesign, rng: &mut KeyedRng) -> Option<&'a mut TargetField> {
    let count = u32::try_from(design.fields.len()).ok().filter(|count| *count > 0)?;
    design.fields.get_mut(rng.below(count) as usize)
}

/// Moves a field by up to 8 minutes along the track and 100 km across it.
fn shift_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(field) = pick(design, rng) {
        field.minute = MINUTE.jitter(field.minute, 8, rng);
        field.offset_km = OFFSET.jitter(field.offset_km, 100, rng);
    }
}

/// Changes radius, number and priorities of a field.
fn change_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if let Some(field) = pick(design, rng) {
        field.spread_km = SPREAD.jitter(field.spread_km, 80, rng);
        field.targets = TARGETS.jitter(field.targets, 10, rng);
        field.priority_low = PRIORITY_LOW.jitter(field.priority_low, 15, rng);
        field.priority_high = PRIORITY_HIGH.jitter(field.priority_high, 15, rng).max(field.priority_low);
    }
}

/// Adds a copy of a field at another minute.
fn duplicate_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    let picked = pick(design, rng).map(|field| *field);
    if let Some(mut copy) = picked.filter(|_| design.fields.len() < MAX_FIELDS) {
        copy.minute = MINUTE.jitter(copy.minute, 40, rng);
        let is_new = !design.fields.contains(&copy);
        design.fields.extend(is_new.then_some(copy));
    }
}

/// Removes a field, unless it is the last one.
fn remove_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) {
    if design.fields.len() > 1 {
        design.fields.remove(rng.below(design.fields.len() as u32) as usize);
    }
}

/// Sets a param to one of its choices.
fn change_param(design: &mut TaskingDesign, brief: &DesignBrief, rng: &mut KeyedRng) {
    set_random_param(&mut design.params, &choices(brief), rng);
}
