//! Easier and harder siblings of designs: changes of the deputies' approach, of their number and of a param, in one direction.

use env_core::{KeyedRng, Scenario};

use super::design::DockingDesign;
use super::edit::{add_deputy, remove_deputy, retry_edits, turn_all, turn_one};
use super::vocabulary::{CLOSING, CROSS, DISTANCE, effective_choices};
use crate::brief::DesignBrief;
use crate::edit_direction::{DifficultyEdit, EditDirection, apply_sibling_edits, step_param};

/// Edits in a direction, each as likely as the others.
const EDITS: [DifficultyEdit<DockingDesign>; 3] = [change_approach, change_count, change_param];

/// Edits that change the difficulty little or either way. They keep siblings from being too similar to their parent.
const NEUTRAL_EDITS: [fn(&mut DockingDesign, &DesignBrief, &mut KeyedRng); 2] = [turn_all, turn_one];

/// Returns a sibling of a design after one or two neutral edits and one to three in a direction; `None` if no attempt leads to a
/// valid design.
pub(super) fn edit_sibling(
    design: &DockingDesign,
    brief: &DesignBrief,
    base: &Scenario,
    direction: EditDirection,
    rng: &mut KeyedRng,
) -> Option<DockingDesign> {
    retry_edits(design, base, rng, |child, rng| {
        apply_sibling_edits(child, brief, direction, rng, &NEUTRAL_EDITS, &EDITS);
    })
}

/// Changes what makes the aimed failure likely, for all deputies by 5 to 25 %: the distance if time runs out, else the speeds.
fn change_approach(
    design: &mut DockingDesign,
    _: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    let ratio = 1.0 + 0.01 * direction.change(rng.range_inclusive(5, 25)) as f64;
    for deputy in &mut design.deputies {
        if design.aim.mode == "timeout" {
            deputy.distance = DISTANCE.nearest(DISTANCE.value(deputy.distance) * ratio);
        } else {
            deputy.closing_speed = CLOSING.nearest(CLOSING.value(deputy.closing_speed) * ratio);
            deputy.cross_speed = CROSS.nearest(CROSS.value(deputy.cross_speed) * ratio);
        }
    }
}

/// Removes a deputy, or adds a copy of one, if the brief allows it.
fn change_count(
    design: &mut DockingDesign,
    brief: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    match direction {
        EditDirection::Easier => remove_deputy(design, brief, rng),
        EditDirection::Harder => add_deputy(design, brief, rng),
    }
}

/// Changes time limit or thrust bound to its next easier or harder choice.
fn change_param(
    design: &mut DockingDesign,
    brief: &DesignBrief,
    direction: EditDirection,
    rng: &mut KeyedRng,
) {
    step_param(&mut design.params, brief, &effective_choices(brief), direction, rng);
}
