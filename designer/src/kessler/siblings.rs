//! Easier and harder siblings of designs: changes of all encounters, of their number and of a param, in one direction.

use env_core::{KeyedRng, Scenario};

use super::design::Design;
use super::edit::{
    change_satellite, duplicate_encounter, editable_params, remove_encounter, retry_edits, rotate_all,
};
use super::vocabulary::{KindSpec, SPEED, STEP};
use crate::brief::DesignBrief;
use crate::edit_direction::{DifficultyEdit, EditDirection, apply_sibling_edits, step_param};

/// Edits in a direction, each as likely as the others.
const EDITS: [DifficultyEdit<Design>; 5] =
    [change_warning, change_speeds, change_miss_distances, change_count, change_param];

/// Edits that change the difficulty little or either way. They keep siblings from being too similar to their parent.
const NEUTRAL_EDITS: [fn(&mut Design, &DesignBrief, &mut KeyedRng) -> bool; 2] =
    [rotate_all, change_satellite];

/// Returns a sibling of a design after one or two neutral edits and one to three in a direction; `None` if no attempt leads to a
/// valid design.
pub(super) fn edit_sibling(
    design: &Design,
    brief: &DesignBrief,
    base: &Scenario,
    direction: EditDirection,
    rng: &mut KeyedRng,
) -> Option<Design> {
    retry_edits(design, base, rng, |child, rng| {
        apply_sibling_edits(child, brief, direction, rng, &NEUTRAL_EDITS, &EDITS);
        true
    })
}

/// Shifts all encounters by one to four steps. Later ones leave more steps to act.
fn change_warning(design: &mut Design, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(1, 4));
    for encounter in &mut design.encounters {
        encounter.step = STEP.clamp(i64::from(encounter.step) - change);
    }
}

/// Changes the speeds of all encounters by 0.5 to 1.5 LU/TU. Slower debris is visible for longer.
fn change_speeds(design: &mut Design, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let change = direction.change(rng.range_inclusive(5, 15));
    for encounter in &mut design.encounters {
        encounter.relative_speed = SPEED.clamp(i64::from(encounter.relative_speed) + change);
    }
}

/// Changes the miss distances of all encounters by up to a third of the range of their kind. A grazing hit takes a smaller burn to
/// avoid than a central one, and a wide miss tempts less than a near one.
fn change_miss_distances(design: &mut Design, _: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    let share = 0.1 + 0.2 * rng.uniform();
    for encounter in &mut design.encounters {
        let KindSpec { min_miss, max_miss, .. } = *encounter.kind.spec();
        let size = libm::round(share * f64::from(max_miss - min_miss)) as u32;
        let changed = i64::from(encounter.miss_distance) - direction.change(size);
        encounter.miss_distance = changed.clamp(min_miss.into(), max_miss.into()) as u32;
    }
}

/// Removes an encounter, or adds a copy of one.
fn change_count(design: &mut Design, brief: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    match direction {
        EditDirection::Easier => remove_encounter(design, brief, rng),
        EditDirection::Harder => duplicate_encounter(design, brief, rng),
    };
}

/// Changes a param to its next easier or harder choice.
fn change_param(design: &mut Design, brief: &DesignBrief, direction: EditDirection, rng: &mut KeyedRng) {
    step_param(&mut design.params, brief, &editable_params(brief), direction, rng);
}
