//! Designs with one thing changed: what evolution works by.

use env_core::{Draws, Scenario};

use super::language::{Design, Encounter, MAX_ENCOUNTERS, SATELLITE, SPEED, STEP};
use super::sample::turned;
use super::sky::Sky;
use super::speak::rogues;
use crate::brief::Brief;

/// Tries at a change that can be.
const TRIES: u32 = 12;

/// What may be changed.
const CHANGES: [fn(&mut Design, &Brief, &mut Draws) -> bool; 9] =
    [turn, retime, rephase, speed_up, nearer, add, remove, other_satellite, other_param];

/// A design with a few things changed, as it can be under this sky.
pub(super) fn edit(design: &Design, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Design> {
    let sky = Sky::of(sky)?;
    for _ in 0..TRIES {
        let mut child = design.clone();
        child.name.clear();
        let changes = draws.between(2, 4);
        let changed = (0..changes).filter(|_| {
            let change = CHANGES[draws.between(0, CHANGES.len() as u32 - 1) as usize];
            change(&mut child, brief, draws)
        });
        if changed.count() == 0 || child.encounters == design.encounters && child.params == design.params {
            continue;
        }
        let distinct = child.encounters.iter().enumerate().all(|(at, e)| !child.encounters[..at].contains(e));
        if distinct && child.encounters.iter().all(|e| sky.takes(e, child.frame)) {
            return Some(child);
        }
    }
    None
}

pub(super) fn pick<'a>(design: &'a mut Design, draws: &mut Draws) -> Option<&'a mut Encounter> {
    let last = u32::try_from(design.encounters.len()).ok()?.checked_sub(1)?;
    design.encounters.get_mut(draws.between(0, last) as usize)
}

/// A whole number, some steps off, within bounds.
fn jittered(number: u32, by: u32, min: u32, max: u32, draws: &mut Draws) -> u32 {
    (number + draws.between(0, 2 * by)).saturating_sub(by).clamp(min, max)
}

/// The whole design comes from some degrees on, its aim with it.
fn turn(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    let by = f64::from(draws.between(0, 24)) - 12.0;
    let on = |bearing: u32| turned(f64::from(bearing), by);
    design.aim.bearing_deg = design.aim.bearing_deg.map(on);
    design.encounters.iter_mut().for_each(|e| e.bearing_deg = on(e.bearing_deg));
    true
}

pub(super) fn retime(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    pick(design, draws).map(|e| e.step = jittered(e.step, 4, STEP.min, STEP.max, draws)).is_some()
}

/// Everything happens some steps earlier or later.
pub(super) fn rephase(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    let by = draws.between(0, 12);
    for encounter in &mut design.encounters {
        encounter.step = (encounter.step + by).saturating_sub(6).clamp(STEP.min, STEP.max);
    }
    true
}

pub(super) fn speed_up(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    pick(design, draws)
        .map(|e| e.relative_speed = jittered(e.relative_speed, 10, SPEED.min, SPEED.max, draws))
        .is_some()
}

/// One passes nearer or wider, within what its kind may.
pub(super) fn nearer(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    let Some(encounter) = pick(design, draws) else { return false };
    let (_, _, min, max, _) = *encounter.kind.row();
    encounter.miss_distance = jittered(encounter.miss_distance, (max - min) / 3, min, max, draws);
    true
}

/// One more like one that is there, at another step.
fn add(design: &mut Design, brief: &Brief, draws: &mut Draws) -> bool {
    one_more(design, MAX_ENCOUNTERS.min(brief.param("debris") as usize), draws)
}

/// One more, where there is room for so many in all.
pub(super) fn one_more(design: &mut Design, room: usize, draws: &mut Draws) -> bool {
    let Some(mut more) = pick(design, draws).map(|e| *e).filter(|_| design.encounters.len() < room) else {
        return false;
    };
    more.step = jittered(more.step, 12, STEP.min, STEP.max, draws);
    more.satellite = draws.between(SATELLITE.min, SATELLITE.max);
    design.encounters.push(more);
    true
}

pub(super) fn remove(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    let count = design.encounters.len() as u32;
    let spare = count > 1;
    if spare {
        design.encounters.remove(draws.between(0, count - 1) as usize);
    }
    spare
}

pub(super) fn other_satellite(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    pick(design, draws).map(|e| e.satellite = draws.between(SATELLITE.min, SATELLITE.max)).is_some()
}

/// One param takes another of its values; the number of debris makes room for the encounters all the same.
fn other_param(design: &mut Design, brief: &Brief, draws: &mut Draws) -> bool {
    let free: Vec<_> = brief
        .limits
        .iter()
        .filter(|limit| limit.param != "debris" && (limit.param != "rogue_probability" || rogues(brief)))
        .collect();
    let Some(last) = u32::try_from(free.len()).ok().and_then(|count| count.checked_sub(1)) else {
        return false;
    };
    let limit = free[draws.between(0, last) as usize];
    let value = limit.values[draws.between(0, limit.values.len() as u32 - 1) as usize];
    design.params.insert(limit.param.clone(), value);
    true
}
