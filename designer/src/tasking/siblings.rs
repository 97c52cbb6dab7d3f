//! Easier and harder siblings of designs: changes of the resources, the stations, the targets and a param, in one direction.

use env_core::{KeyedRng, Scenario};

use super::design::TaskingDesign;
use super::edit::{pick, retry_edits, shift_epoch, turn_node};
use super::params::{choices, station_count};
use super::vocabulary::{BATTERY, MAX_OUTAGES, STORAGE, TARGETS, WHEELS};
use crate::brief::DesignBrief;
use crate::edit_direction::{DifficultyEdit, EditDirection, apply_sibling_edits, step_param};

/// Edits in a direction, each as likely as the others.
const EDITS: [DifficultyEdit<TaskingDesign>; 6] =
    [change_charge, change_wheels, change_data, change_stations, change_targets, change_param];

/// Edits that change the difficulty little or either way. They keep siblings from being too similar to their parent.
const NEUTRAL_EDITS: [fn(&mut TaskingDesign, &DesignBrief, &mut KeyedRng); 2] = [shift_epoch, turn_node];

/// Returns a sibling of a design after one or two neutral edits and one to three in a direction; `None` if no attempt leads to a
/// valid design.
pub(super) fn edit_sibling(
    design: &TaskingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    direction: EditDirection,
    rng: &mut KeyedRng,
) -> Option<TaskingDesign> {
    retry_edits(design, base, rng, |child, rng| {
        apply_sibling_edits(child, brief, direction, rng, &NEUTRAL_EDITS, &EDITS);
    })
}

/// Changes the charge by 2 to 10 percent of the battery. Less is harder.
fn change_charge(design: &mut TaskingDesign, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(2, 10));
    design.start.battery_percent = BATTERY.clamp(i64::from(design.start.battery_percent) - change);
}

/// Changes the speed of the wheels by 2 to 10 percent of the limit. Faster is harder.
fn change_wheels(design: &mut TaskingDesign, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(2, 10));
    design.start.wheels_percent = WHEELS.clamp(i64::from(design.start.wheels_percent) + change);
}

/// Changes the data by 1 to 6 percent of the storage. More is harder.
fn change_data(design: &mut TaskingDesign, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(1, 6));
    design.start.storage_percent = STORAGE.clamp(i64::from(design.start.storage_percent) + change);
}

/// Puts a station of the level out of service, or back into it.
fn change_stations(
    design: &mut TaskingDesign,
    brief: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    let stations = station_count(&brief.recipe);
    let outages = &mut design.outages;
    match direction {
        EditDirection::Easier if !outages.is_empty() => {
            outages.remove(rng.below(outages.len() as u32) as usize);
        }
        EditDirection::Harder if outages.len() < MAX_OUTAGES.min(stations - 1) => {
            let in_service = (0..stations as i32).filter(|station| !outages.contains(station));
            let station = in_service.clone().nth(rng.below(in_service.count() as u32) as usize);
            outages.extend(station);
            outages.sort_unstable();
        }
        EditDirection::Easier | EditDirection::Harder => {}
    }
}

/// Changes the number of targets of a field by 2 to 10. More are harder to choose from.
fn change_targets(design: &mut TaskingDesign, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(2, 10));
    if let Some(field) = pick(design, rng) {
        field.targets = TARGETS.clamp(i64::from(field.targets) + change);
    }
}

/// Changes a param to its next easier or harder choice.
fn change_param(
    design: &mut TaskingDesign,
    brief: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    step_param(&mut design.params, brief, &choices(brief), direction, rng);
}
