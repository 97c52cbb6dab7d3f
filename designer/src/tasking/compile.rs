//! Compiles a design into a scenario. The seed of the base scenario draws the parts that a design leaves open, such as attitudes
//! and the directions of the wheels; they become part of the layout.

use env_core::space::START_SCALE;
use env_core::tasking::task::forecast::TaskingForecast;
use env_core::tasking::task::layout::{EpochDay, SatelliteStart, SunOrbit, TargetPlace, TaskingLayout};
use env_core::{Layout, Recipe, Scenario, ScenarioError};

use super::design::{TargetField, TaskingDesign};
use super::field::place_targets;
use super::params::{has_targets, station_count};
use super::units::S_PER_MINUTE;
use super::vocabulary::{MINUTE, SATELLITE, STATION};
use crate::field_error::FieldError;

/// Speed of a wheel that ends an episode, rpm.
const WHEEL_LIMIT_RPM: f64 = 6000.0;
/// Hundredths in a whole.
const PERCENT: f64 = 100.0;

/// Design that was compiled.
#[derive(Debug, Clone, PartialEq)]
pub struct CompiledStart {
    /// Scenario with task, options and seed of the base scenario, params of the design, and its start as the layout.
    pub scenario: Scenario,
    /// Sky of the scenario in which only the targets of the fields exist.
    pub forecast: TaskingForecast,
}

/// Compiles a design in a base scenario. The base scenario gives task, options, the remaining params, and the seed; its layout is
/// ignored.
///
/// # Errors
/// Returns an error with the first field that the task does not allow, and a way to fix it.
pub fn compile(design: &TaskingDesign, base: &Scenario) -> Result<CompiledStart, FieldError> {
    let recipe = recipe_of(design, base)?;
    check_fields(design, &recipe)?;
    check_outages(design, &recipe)?;
    let bare = Scenario::new(recipe.clone(), base.seed());
    let mut start = designed_start(design, &bare).map_err(field_error)?;
    let has_targets = has_targets(&recipe);
    start.targets = has_targets.then(Vec::new);
    let mut forecast = TaskingForecast::with_layout(&bare, start.clone()).map_err(field_error)?;
    let targets = place_fields(&design.fields, &forecast)?;
    if !targets.is_empty() {
        start.targets = Some(targets);
        forecast = TaskingForecast::with_layout(&bare, start.clone()).map_err(field_error)?;
    }
    start.keeps_drawn_targets = design.keeps_background && has_targets;
    start.targets = start.targets.filter(|targets| !targets.is_empty());
    let layout = Layout { provenance: Some(design.to_json()), ..start.to_layout() };
    let recipe = recipe.with_layout(Some(layout)).map_err(field_error)?;
    Ok(CompiledStart { scenario: Scenario::new(recipe, base.seed()), forecast })
}

/// Returns the recipe of the base scenario with the params of the design and without a layout.
fn recipe_of(design: &TaskingDesign, base: &Scenario) -> Result<Recipe, FieldError> {
    let mut recipe = base.recipe().as_ref().clone().with_layout(None).map_err(field_error)?;
    for (name, value) in &design.params {
        recipe = recipe.with_param(name, *value).map_err(field_error)?;
    }
    // A design is a full start: it would mean less in a shorter episode.
    recipe = recipe.with_param(START_SCALE.name, START_SCALE.default).map_err(field_error)?;
    Ok(recipe)
}

/// Returns the drawn start with everything that the design decides, except for the targets.
fn designed_start(design: &TaskingDesign, bare: &Scenario) -> Result<TaskingLayout, ScenarioError> {
    let mut layout = TaskingLayout::of_scenario(bare)?;
    let start = &design.start;
    let year = layout.epoch.map_or(0, |epoch| epoch.year);
    let second = f64::from(start.utc_minute) * S_PER_MINUTE;
    layout.epoch = Some(EpochDay { year, day: start.day.unsigned_abs(), second });
    let orbit =
        SunOrbit { node_hour: f64::from(start.node_hour), start_angle_deg: f64::from(start.start_angle_deg) };
    layout.move_orbits(orbit, bare.task());
    for satellite in layout.satellites.iter_mut().flatten() {
        satellite.charge = f64::from(start.battery_percent) / PERCENT;
        satellite.fill = f64::from(start.storage_percent) / PERCENT;
        set_fastest_wheel(satellite, f64::from(start.wheels_percent) / PERCENT * WHEEL_LIMIT_RPM);
    }
    layout.outages = design.outages.iter().filter_map(|station| usize::try_from(*station).ok()).collect();
    Ok(layout)
}

/// Scales the speeds of the wheels so that the fastest has this speed, rpm. Their directions and ratios are the drawn ones.
pub(super) fn set_fastest_wheel(satellite: &mut SatelliteStart, speed_rpm: f64) {
    let fastest = satellite.wheels_rpm.iter().fold(0.0, |most: f64, speed| most.max(speed.abs()));
    satellite.wheels_rpm = if fastest > 0.0 {
        satellite.wheels_rpm.map(|speed| (speed / fastest * speed_rpm).clamp(-speed_rpm, speed_rpm))
    } else {
        [speed_rpm, 0.0, 0.0]
    };
}

/// Checks that the task has what the fields need.
fn check_fields(design: &TaskingDesign, recipe: &Recipe) -> Result<(), FieldError> {
    if !has_targets(recipe) {
        return match design.fields.len() {
            0 => Ok(()),
            count => {
                Err(FieldError::new("fields", format!("must be empty: the task has no targets, got {count}")))
            }
        };
    }
    if design.fields.is_empty() && !design.keeps_background {
        return Err(FieldError::new(
            "fields",
            "must have an entry, or background must be true: a layout needs targets",
        ));
    }
    let satellites = recipe.task().agents(recipe);
    let minutes = recipe.param("time_limit_s").map_or(0, |limit_s| (limit_s / S_PER_MINUTE) as i32 - 1);
    for (index, field) in design.fields.iter().enumerate() {
        if field.satellite.unsigned_abs() >= satellites {
            let message =
                format!("must be from 0 to {}, got {}", satellites.saturating_sub(1), field.satellite);
            return Err(FieldError::new(format!("fields.{index}.{}", SATELLITE.name), message));
        }
        if field.minute > minutes {
            let message = format!("must be at most {minutes}, when the episode ends, got {}", field.minute);
            return Err(FieldError::new(format!("fields.{index}.{}", MINUTE.name), message));
        }
        if let Some(twin) = design.fields[..index].iter().position(|other| other == field) {
            let message = format!("repeats fields.{twin}; change it or leave it out");
            return Err(FieldError::new(format!("fields.{index}"), message));
        }
    }
    Ok(())
}

/// Checks that the task has the stations that are out of service, and one more.
fn check_outages(design: &TaskingDesign, recipe: &Recipe) -> Result<(), FieldError> {
    let stations = station_count(recipe);
    let is_missing = |station: &&i32| usize::try_from(**station).is_ok_and(|station| station >= stations);
    if let Some(station) = design.outages.iter().find(is_missing) {
        let message =
            format!("must be from 0 to {}: the level has {stations} stations, got {station}", stations - 1);
        return Err(FieldError::new(STATION.name, message));
    }
    if design.outages.len() >= stations {
        let message = format!("must leave one of the {stations} stations of the level in service");
        return Err(FieldError::new(STATION.name, message));
    }
    Ok(())
}

/// Places the targets of all fields.
fn place_fields(fields: &[TargetField], sky: &TaskingForecast) -> Result<Vec<TargetPlace>, FieldError> {
    let mut targets = Vec::new();
    for (index, field) in fields.iter().enumerate() {
        let satellite = usize::try_from(field.satellite).ok().and_then(|number| sky.satellites.get(number));
        let placed = satellite.and_then(|path| place_targets(field, path));
        targets.extend(placed.ok_or_else(|| {
            FieldError::new(format!("fields.{index}"), "must be on the path of a satellite of the task")
        })?);
    }
    Ok(targets)
}

#[expect(clippy::needless_pass_by_value, reason = "the signature that map_err takes")]
fn field_error(error: ScenarioError) -> FieldError {
    FieldError::new(error.field().to_owned(), error.reason())
}
