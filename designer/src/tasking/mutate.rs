//! Mutates scenarios without a design: the start that they draw becomes a layout, and one to three parts of it change a little.

use env_core::tasking::task::forecast::TaskingForecast;
use env_core::tasking::task::layout::{
    MAX_LAYOUT_DAY, MAX_LAYOUT_WHEEL_RPM, MIN_LAYOUT_CHARGE, SatelliteStart, TaskingLayout,
};
use env_core::{KeyedRng, Recipe, Scenario};

use super::design::TargetField;
use super::field::place_targets;
use super::params::{choices, has_targets, station_count};
use super::sample_parts::whole;
use super::units::{S_PER_DAY, S_PER_MINUTE};
use crate::brief::DesignBrief;
use crate::mutation::{Mutation, adjacent_value, pick_choice};

/// Maximum number of attempts to mutate a scenario.
const MAX_ATTEMPTS: u32 = 12;
/// Maximum number of targets of a layout after a mutation. The tables of a layout have 512 rows in all.
const MAX_TARGETS: usize = 480;

/// A scenario whose start is edited.
struct Child<'a> {
    recipe: Recipe,
    layout: TaskingLayout,
    parent: &'a Scenario,
}

/// Edit of a start. Returns `None` if it does not apply.
type ChildEdit = fn(&mut Child<'_>, &DesignBrief, &mut KeyedRng) -> Option<()>;

/// Edits of a scenario. The names are stored with it.
const EDITS: [(&str, ChildEdit); 10] = [
    ("the time of the day", shift_time),
    ("the season", shift_day),
    ("the orbit's plane", turn_nodes),
    ("the place on the orbit", move_along_orbits),
    ("a battery's charge", change_charge),
    ("a satellite's wheels", change_wheels),
    ("a storage's data", change_data),
    ("a station in or out of service", toggle_outage),
    ("a field of targets more", add_field),
    ("a param", change_param),
];

/// Returns a scenario after one to three edits; `None` if no attempt succeeds.
pub(crate) fn mutate(parent: &Scenario, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<Mutation> {
    let recipe = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    let layout = TaskingLayout::of_scenario(parent).ok()?;
    for _ in 0..MAX_ATTEMPTS {
        let mut child = Child { recipe: recipe.clone(), layout: layout.clone(), parent };
        // Without targets of its own, a layout keeps the drawn ones.
        child.layout.keeps_drawn_targets |= child.layout.targets.is_none() && has_targets(&recipe);
        let mut changes = Vec::new();
        for _ in 0..rng.range_inclusive(1, 3) {
            let (name, edit) = EDITS[rng.below(EDITS.len() as u32) as usize];
            if edit(&mut child, brief, rng).is_some() && !changes.contains(&name) {
                changes.push(name);
            }
        }
        if changes.is_empty() {
            continue;
        }
        if let Ok(recipe) = child.recipe.with_layout(Some(child.layout.to_layout())) {
            return Some(Mutation { scenario: Scenario::new(recipe, parent.seed()), changes });
        }
    }
    None
}

/// Returns a number from −`most` to `most`.
fn either_way(most: f64, rng: &mut KeyedRng) -> f64 {
    most * (2.0 * rng.uniform() - 1.0)
}

/// Returns a random satellite.
fn pick<'a>(child: &'a mut Child<'_>, rng: &mut KeyedRng) -> Option<&'a mut SatelliteStart> {
    let satellites = child.layout.satellites.as_mut()?;
    let count = u32::try_from(satellites.len()).ok()?;
    satellites.get_mut(rng.below(count) as usize)
}

/// Shifts the epoch by up to three hours. The orbit stays in the inertial frame, so that the ground below it changes.
fn shift_time(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let epoch = child.layout.epoch.as_mut()?;
    let shifted = epoch.second + either_way(10_800.0, rng);
    epoch.second = libm::floor(shifted.rem_euclid(S_PER_DAY));
    Some(())
}

/// Shifts the epoch by up to 20 days, within the year.
fn shift_day(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let epoch = child.layout.epoch.as_mut()?;
    let day = i64::from(epoch.day) + i64::from(whole(rng, [-20, 20]));
    epoch.day = u32::try_from(day.clamp(1, i64::from(MAX_LAYOUT_DAY))).ok()?;
    Some(())
}

/// Turns the planes of all orbits by the same angle, up to 15 degrees.
fn turn_nodes(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let turn_deg = either_way(15.0, rng);
    for satellite in child.layout.satellites.as_mut()? {
        satellite.node_deg = (satellite.node_deg + turn_deg).rem_euclid(360.0);
    }
    Some(())
}

/// Moves all satellites along their orbits by the same angle, up to 25 degrees.
fn move_along_orbits(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let turn_deg = either_way(25.0, rng);
    for satellite in child.layout.satellites.as_mut()? {
        satellite.anomaly_deg = (satellite.anomaly_deg + turn_deg).rem_euclid(360.0);
    }
    Some(())
}

/// Changes the charge of a satellite by up to 15 % of its battery.
fn change_charge(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let satellite = pick(child, rng)?;
    satellite.charge = (satellite.charge + either_way(0.15, rng)).clamp(MIN_LAYOUT_CHARGE, 1.0);
    Some(())
}

/// Makes the wheels of a satellite up to a third faster or slower.
fn change_wheels(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let satellite = pick(child, rng)?;
    let factor = 1.0 + either_way(1.0 / 3.0, rng);
    let limit = MAX_LAYOUT_WHEEL_RPM;
    satellite.wheels_rpm = satellite.wheels_rpm.map(|speed| (speed * factor).clamp(-limit, limit));
    Some(())
}

/// Changes the data of a satellite by up to 15 % of its storage.
fn change_data(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let satellite = pick(child, rng)?;
    satellite.fill = (satellite.fill + either_way(0.15, rng)).clamp(0.0, 1.0);
    Some(())
}

/// Puts a station out of service, or back into it; one stays.
fn toggle_outage(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    let stations = station_count(&child.recipe);
    let station = rng.below(u32::try_from(stations).ok()?) as usize;
    let outages = &mut child.layout.outages;
    if outages.contains(&station) {
        outages.retain(|other| *other != station);
        return Some(());
    }
    (outages.len() + 1 < stations).then(|| outages.push(station))
}

/// Adds a field of targets beside the path of a satellite.
fn add_field(child: &mut Child<'_>, _: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    if !has_targets(&child.recipe) {
        return None;
    }
    let sky = TaskingLayout { targets: Some(Vec::new()), keeps_drawn_targets: false, ..child.layout.clone() };
    let sky =
        TaskingForecast::with_layout(&Scenario::new(child.recipe.clone(), child.parent.seed()), sky).ok()?;
    let minutes = (sky.time_limit_s / S_PER_MINUTE) as i32;
    let satellites = i32::try_from(sky.satellites.len()).ok()?;
    let field = TargetField {
        satellite: whole(rng, [0, satellites - 1]),
        minute: whole(rng, [2, minutes - 3]),
        offset_km: whole(rng, [-300, 300]),
        spread_km: whole(rng, [60, 300]),
        targets: whole(rng, [8, 30]),
        priority_low: whole(rng, [5, 40]),
        priority_high: whole(rng, [50, 100]),
    };
    let placed = place_targets(&field, sky.satellites.get(usize::try_from(field.satellite).ok()?)?)?;
    let targets = child.layout.targets.get_or_insert_default();
    if targets.len() + placed.len() > MAX_TARGETS {
        return None;
    }
    targets.extend(placed);
    Some(())
}

/// Sets a param that acts on the given start to an adjacent value.
fn change_param(child: &mut Child<'_>, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<()> {
    // The layout has a row for every satellite, and numbers of stations; the other params of a start are replaced by it.
    let is_fixed = |param: &str| matches!(param, "satellites" | "spacing_deg" | "stations");
    let choices: Vec<_> = choices(brief).into_iter().filter(|choice| !is_fixed(&choice.param)).collect();
    let choice = pick_choice(&choices, rng)?;
    let value = adjacent_value(&child.recipe, choice, rng)?;
    child.recipe = child.recipe.clone().with_param(&choice.param, value).ok()?;
    Some(())
}
