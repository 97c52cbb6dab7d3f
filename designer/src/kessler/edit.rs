//! Edits of designs: small random changes, which evolution of layouts is made of.

use env_core::{KeyedRng, Scenario};

use super::aim::allows_rogues;
use super::coast::CoastPaths;
use super::design::{Design, Encounter};
use super::placement::can_place;
use super::vocabulary::{KindSpec, MAX_ENCOUNTERS, SATELLITE, SPEED, STEP};
use crate::angles::whole_degrees;
use crate::bound::draw_change;
use crate::brief::{DesignBrief, ParamChoice};
use crate::mutation::set_random_param;

/// Maximum number of attempts to edit a design.
const MAX_ATTEMPTS: u32 = 12;

/// Edit of a design. Returns false if it does not apply.
type DesignEdit = fn(&mut Design, &DesignBrief, &mut KeyedRng) -> bool;

/// Edits of a design, each as likely as the others.
const EDITS: [DesignEdit; 9] = [
    rotate_all,
    shift_one,
    shift_all,
    change_speed,
    change_miss_distance,
    duplicate_encounter,
    remove_encounter,
    change_satellite,
    change_param,
];

/// Returns a design after two to four edits; `None` if no attempt leads to a design that is possible in the base scenario.
pub(super) fn edit_design(
    design: &Design,
    brief: &DesignBrief,
    base: &Scenario,
    rng: &mut KeyedRng,
) -> Option<Design> {
    retry_edits(design, base, rng, |child, rng| {
        let count = rng.range_inclusive(2, 4);
        let edits = (0..count).filter(|_| EDITS[rng.below(EDITS.len() as u32) as usize](child, brief, rng));
        edits.count() > 0
    })
}

/// Returns a copy of a design that `edit` changed, if all its encounters are possible in the base scenario; `None` if no attempt
/// succeeds. `edit` returns false if it does not apply.
pub(super) fn retry_edits(
    design: &Design,
    base: &Scenario,
    rng: &mut KeyedRng,
    edit: impl Fn(&mut Design, &mut KeyedRng) -> bool,
) -> Option<Design> {
    let coast = CoastPaths::of_scenario(base)?;
    (0..MAX_ATTEMPTS).find_map(|_| {
        let mut child = design.clone();
        child.name.clear();
        let is_edited = edit(&mut child, rng);
        let is_changed = child.encounters != design.encounters || child.params != design.params;
        let is_possible = |child: &Design| {
            let frame = child.frame;
            all_distinct(&child.encounters) && child.encounters.iter().all(|e| can_place(e, frame, &coast))
        };
        (is_edited && is_changed && is_possible(&child)).then_some(child)
    })
}

/// Returns true if no encounter occurs twice.
pub(super) fn all_distinct(encounters: &[Encounter]) -> bool {
    encounters.iter().enumerate().all(|(index, encounter)| !encounters[..index].contains(encounter))
}

/// Returns a random encounter; `None` if there is none.
pub(super) fn pick<'a>(design: &'a mut Design, rng: &mut KeyedRng) -> Option<&'a mut Encounter> {
    let last = u32::try_from(design.encounters.len()).ok()?.checked_sub(1)?;
    design.encounters.get_mut(rng.range_inclusive(0, last) as usize)
}

/// Rotates the bearings of all encounters and of the aim by up to 12 degrees.
pub(super) fn rotate_all(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let rotation_deg = draw_change(12, rng) as f64;
    let rotate = |bearing: u32| u32::from(whole_degrees(f64::from(bearing) + rotation_deg));
    design.aim.bearing_deg = design.aim.bearing_deg.map(rotate);
    design.encounters.iter_mut().for_each(|e| e.bearing_deg = rotate(e.bearing_deg));
    true
}

/// Shifts one encounter by up to 4 steps.
pub(super) fn shift_one(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    pick(design, rng).map(|e| e.step = STEP.jitter(e.step, 4, rng)).is_some()
}

/// Shifts all encounters by the same number of steps, up to 6.
pub(super) fn shift_all(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let change = draw_change(6, rng);
    for encounter in &mut design.encounters {
        encounter.step = STEP.clamp(i64::from(encounter.step) + change);
    }
    true
}

/// Changes the relative speed of one encounter by up to 1 LU/TU.
pub(super) fn change_speed(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    pick(design, rng).map(|e| e.relative_speed = SPEED.jitter(e.relative_speed, 10, rng)).is_some()
}

/// Changes the miss distance of one encounter, within the bounds of its kind.
pub(super) fn change_miss_distance(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(encounter) = pick(design, rng) else { return false };
    let KindSpec { min_miss: min, max_miss: max, .. } = *encounter.kind.spec();
    let raised = encounter.miss_distance + rng.range_inclusive(0, 2 * ((max - min) / 3));
    encounter.miss_distance = raised.saturating_sub((max - min) / 3).clamp(min, max);
    true
}

/// Adds a copy of an encounter at another step, if the debris param leaves room.
pub(super) fn duplicate_encounter(design: &mut Design, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    duplicate_within(design, MAX_ENCOUNTERS.min(brief.param("debris") as usize), rng)
}

/// Adds a copy of an encounter at another step and satellite, if there are fewer than `max_encounters`.
pub(super) fn duplicate_within(design: &mut Design, max_encounters: usize, rng: &mut KeyedRng) -> bool {
    let picked = pick(design, rng).map(|encounter| *encounter);
    let Some(mut copy) = picked.filter(|_| design.encounters.len() < max_encounters) else {
        return false;
    };
    copy.step = STEP.jitter(copy.step, 12, rng);
    copy.satellite = rng.range_inclusive(SATELLITE.min, SATELLITE.max);
    design.encounters.push(copy);
    true
}

/// Removes an encounter, unless it is the last one.
pub(super) fn remove_encounter(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let count = design.encounters.len() as u32;
    let can_remove = count > 1;
    if can_remove {
        design.encounters.remove(rng.range_inclusive(0, count - 1) as usize);
    }
    can_remove
}

/// Moves one encounter to a random satellite.
pub(super) fn change_satellite(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    pick(design, rng).map(|e| e.satellite = rng.range_inclusive(SATELLITE.min, SATELLITE.max)).is_some()
}

/// Returns the params that an edit may set. The debris param is left out: it makes room for the encounters anyway.
pub(super) fn editable_params(brief: &DesignBrief) -> Vec<&ParamChoice> {
    brief
        .param_choices
        .iter()
        .filter(|choice| choice.param != "debris")
        .filter(|choice| choice.param != "rogue_probability" || allows_rogues(brief))
        .collect()
}

/// Sets a param to one of its choices.
fn change_param(design: &mut Design, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let choices = editable_params(brief);
    set_random_param(&mut design.params, &choices, rng);
    !choices.is_empty()
}
