//! Edits of designs: small random changes, which evolution of layouts is made of.

use env_core::{KeyedRng, Scenario};

use super::build::build_design;
use super::design::{TargetField, TaskingDesign};
use super::params::choices;
use super::sample_parts::{jitter, turn, whole};
use super::vocabulary::{
    BATTERY, DAY, MAX_FIELDS, MAX_OUTAGES, MINUTE, NODE_HOUR, OFFSET, PRIORITY_HIGH, PRIORITY_LOW, SPREAD,
    START_ANGLE, STATION, STORAGE, TARGETS, UTC_MINUTE, WHEELS,
};
use crate::brief::DesignBrief;

/// Maximum number of attempts to edit a design.
const MAX_ATTEMPTS: u32 = 12;

/// Edit of a design. Returns false if it does not apply.
type TaskingEdit = fn(&mut TaskingDesign, &DesignBrief, &mut KeyedRng) -> bool;

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

/// Returns a design after two to four edits, if it still matches its aim in the base scenario; `None` if no attempt succeeds.
pub(super) fn edit_design(
    design: &TaskingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<TaskingDesign> {
    for _ in 0..MAX_ATTEMPTS {
        let mut child = design.clone();
        let count = rng.range_inclusive(2, 4);
        for _ in 0..count {
            EDITS[rng.below(EDITS.len() as u32) as usize](&mut child, brief, rng);
        }
        if child != *design && build_design(&child, base).is_ok() {
            child.name.clear();
            return Some(child);
        }
    }
    None
}

/// Moves the epoch by up to 25 days and 90 minutes.
fn shift_epoch(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.day = turn(design.start.day, 25, DAY, rng);
    design.start.utc_minute = turn(design.start.utc_minute, 90, UTC_MINUTE, rng);
    true
}

/// Turns the ascending node by up to two hours of local time.
fn turn_node(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.node_hour = turn(design.start.node_hour, 2, NODE_HOUR, rng);
    true
}

/// Moves the start along the orbit by up to 30 degrees.
fn move_start(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.start_angle_deg = turn(design.start.start_angle_deg, 30, START_ANGLE, rng);
    true
}

/// Changes the charge by up to 8 percent of the battery.
fn change_battery(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.battery_percent = jitter(design.start.battery_percent, 8, BATTERY, rng);
    true
}

/// Changes the speed of the wheels by up to 8 percent of the limit.
fn change_wheels(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.wheels_percent = jitter(design.start.wheels_percent, 8, WHEELS, rng);
    true
}

/// Changes the data by up to 6 percent of the storage.
fn change_storage(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    design.start.storage_percent = jitter(design.start.storage_percent, 6, STORAGE, rng);
    true
}

/// Puts a station of the level out of service, or back into it.
fn toggle_outage(design: &mut TaskingDesign, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let stations = brief.recipe.param("stations").map_or(STATION.max + 1, |stations| stations as i32);
    let station = whole(rng, [0, stations - 1]);
    if design.outages.contains(&station) {
        design.outages.retain(|other| *other != station);
        return true;
    }
    let has_room = design.outages.len() < MAX_OUTAGES.min(stations as usize - 1);
    if has_room {
        design.outages.push(station);
        design.outages.sort_unstable();
    }
    has_room
}

/// Returns a random field; `None` if there is none.
fn pick<'a>(design: &'a mut TaskingDesign, rng: &mut KeyedRng) -> Option<&'a mut TargetField> {
    let count = u32::try_from(design.fields.len()).ok().filter(|count| *count > 0)?;
    design.fields.get_mut(rng.below(count) as usize)
}

/// Moves a field by up to 8 minutes along the track and 100 km across it.
fn shift_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(field) = pick(design, rng) else { return false };
    field.minute = jitter(field.minute, 8, MINUTE, rng);
    field.offset_km = jitter(field.offset_km, 100, OFFSET, rng);
    true
}

/// Changes radius, number and priorities of a field.
fn change_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(field) = pick(design, rng) else { return false };
    field.spread_km = jitter(field.spread_km, 80, SPREAD, rng);
    field.targets = jitter(field.targets, 10, TARGETS, rng);
    field.priority_low = jitter(field.priority_low, 15, PRIORITY_LOW, rng);
    field.priority_high = jitter(field.priority_high, 15, PRIORITY_HIGH, rng).max(field.priority_low);
    true
}

/// Adds a copy of a field at another minute.
fn duplicate_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let picked = pick(design, rng).map(|field| *field);
    let Some(mut copy) = picked.filter(|_| design.fields.len() < MAX_FIELDS) else { return false };
    copy.minute = jitter(copy.minute, 40, MINUTE, rng);
    let is_new = !design.fields.contains(&copy);
    design.fields.extend(is_new.then_some(copy));
    is_new
}

/// Removes a field, unless it is the last one.
fn remove_field(design: &mut TaskingDesign, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let can_remove = design.fields.len() > 1;
    if can_remove {
        design.fields.remove(rng.below(design.fields.len() as u32) as usize);
    }
    can_remove
}

/// Sets a param to one of its choices.
fn change_param(design: &mut TaskingDesign, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let choices = choices(brief);
    let Some(count) = u32::try_from(choices.len()).ok().filter(|count| *count > 0) else { return false };
    let choice = choices[rng.below(count) as usize];
    let Some(count) = u32::try_from(choice.values.len()).ok().filter(|count| *count > 0) else {
        return false;
    };
    let value = choice.values[rng.below(count) as usize];
    design.params.insert(choice.param.clone(), value);
    true
}
