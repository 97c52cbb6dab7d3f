//! Aims of layouts: which failure modes a layout can cause, and whether its start and fields match its aim.
//!
//! The checks are in closed form: they compare the resources at the start with the shadow, the passes and the windows ahead. The failure
//! mode `other` has no aim, since orbits do not sink.

use env_core::tasking::task::forecast::SatelliteForecast;

use super::facts::DesignFacts;
use super::units::{J_PER_WH, S_PER_MINUTE};
use super::vocabulary::{AIM_ANGLE, BATTERY, START_ANGLE, STORAGE, WHEELS};
use crate::angles::angle_between;
use crate::brief::DesignBrief;
use crate::field_error::FieldError;

/// Maximum angle between the aim and the place where the failure begins, degrees: a sector of the failure profile.
pub(super) const AIM_TOLERANCE_DEG: f64 = 30.0;
/// Latest begin of the first shadow, s. Later ones leave time to charge.
pub(super) const MAX_SHADOW_START_S: f64 = 2700.0;
/// Shortest shadow that counts, s.
const MIN_SHADOW_S: f64 = 600.0;
/// Least speed of the fastest wheel, percent of the limit.
pub(super) const MIN_WHEELS: i32 = 70;
/// Largest speed of the fastest wheel of a satellite that need not desaturate, percent of the limit. `idle` begins below 10.
pub(super) const MAX_IDLE_WHEELS: i32 = 9;
/// Least charge of a satellite that need not charge, percent.
pub(super) const MIN_IDLE_BATTERY: i32 = 85;
/// Share of the battery that is left after the first shadow if charging was not necessary.
const IDLE_RESERVE: f64 = 0.25;
/// Largest data of a satellite with work to do, percent.
pub(super) const MAX_IDLE_STORAGE: i32 = 80;
/// Least difference of priorities in a field, hundredths.
pub(super) const MIN_PRIORITY_RANGE: i32 = 30;
/// Least number of targets that two satellites see.
const MIN_SHARED_TARGETS: usize = 5;

/// Failure mode that a layout can aim at.
#[derive(Debug, Clone, Copy)]
pub(super) struct AimRule {
    /// Name of the failure mode.
    pub(super) mode: &'static str,
    /// Conditions of the aim, in a few words. They are part of the prompt.
    pub(super) needs: &'static str,
    /// Returns the moment at which the failure begins, or the condition that is not met.
    check: fn(&DesignFacts<'_>) -> Result<AimMoment, FieldError>,
}

/// Satellite and time at which the failure of an aim begins.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AimMoment {
    satellite: usize,
    time_s: f64,
}

/// All aims, in prompt order.
pub(super) const AIMS: [AimRule; 8] = [
    AimRule {
        mode: "power",
        needs: "a first shadow that begins within 45 minutes, and less charge than work takes in it",
        check: check_power,
    },
    AimRule { mode: "wheels", needs: "wheels_percent of at least 70", check: check_wheels },
    AimRule {
        mode: "full",
        needs: "a storage that work without a break fills before the first pass over a station in service",
        check: check_full,
    },
    AimRule {
        mode: "pass_missed",
        needs: "a storage that work without a break fills after a pass over a station, and before the next one",
        check: check_pass_missed,
    },
    AimRule {
        mode: "idle",
        needs: "battery_percent of at least 85, wheels_percent of at most 9, storage_percent of at most 80, and a charge that work in \
                the first shadow leaves above a quarter",
        check: check_idle,
    },
    AimRule {
        mode: "window_missed",
        needs: "a field with more targets than its satellite can image in one pass",
        check: check_window_missed,
    },
    AimRule {
        mode: "low_value",
        needs: "a field with more targets than its satellite can image in one pass, and priorities that differ by at least 30",
        check: check_low_value,
    },
    AimRule {
        mode: "duplicate",
        needs: "fields with at least 5 targets that two satellites see",
        check: check_duplicate,
    },
];

/// Iterates over the aims that a layout for a brief can have.
pub(super) fn allowed_aims(brief: &DesignBrief) -> impl Iterator<Item = &'static AimRule> {
    let modes = brief.recipe.task().failure_modes();
    AIMS.iter().filter(move |aim| modes.iter().any(|mode| mode.name == aim.mode))
}

/// Checks that a design matches its aim.
///
/// # Errors
/// Returns an error of `aim.mode` if no layout can aim at the mode, of the field that keeps the failure from being likely, and of
/// `aim.orbit_angle_deg` if the failure begins elsewhere.
pub(super) fn check_aim(facts: &DesignFacts<'_>) -> Result<(), FieldError> {
    let mode = &facts.design.mode;
    let Some(rule) = AIMS.iter().find(|rule| rule.mode == mode) else {
        let modes = AIMS.map(|rule| rule.mode).join(", ");
        return Err(FieldError::new("aim.mode", format!("must be one of {modes}, got {mode:?}")));
    };
    let moment = (rule.check)(facts)?;
    let Some(aimed) = facts.design.aim_angle_deg else { return Ok(()) };
    let path = facts.forecast.satellites.get(moment.satellite);
    let Some(point) = path.and_then(|path| path.point_at(moment.time_s)) else { return Ok(()) };
    if angle_between(point.orbit_angle_deg, f64::from(aimed)) <= AIM_TOLERANCE_DEG {
        return Ok(());
    }
    let message = format!(
        "must be within {AIM_TOLERANCE_DEG} degrees of the place where the failure begins, got {aimed}; satellite {} is at {:.0} \
         degrees then, {:.0} minutes after the start",
        moment.satellite,
        point.orbit_angle_deg,
        moment.time_s / S_PER_MINUTE
    );
    Err(FieldError::new(format!("aim.{}", AIM_ANGLE.name), message))
}

/// Energy that work takes in a shadow, W·h.
pub(super) fn shadow_energy_wh(satellite: &SatelliteForecast, [from_s, to_s]: [f64; 2]) -> f64 {
    satellite.resources.work_w * (to_s - from_s) / J_PER_WH
}

/// The first shadow of a satellite, if it begins early enough.
pub(super) fn first_shadow(satellite: &SatelliteForecast) -> Option<[f64; 2]> {
    let shadows = satellite.shadows();
    shadows.into_iter().find(|[from_s, to_s]| to_s - from_s >= MIN_SHADOW_S && *from_s <= MAX_SHADOW_START_S)
}

fn check_power(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    let shadows: Vec<_> =
        facts.satellites().filter_map(|(index, path)| Some((index, path, first_shadow(path)?))).collect();
    let Some((_, path, shadow)) = shadows.first() else {
        let message = "must lead to a shadow within 45 minutes: power needs one; choose 20 to 100, and a node_hour near 0 or 12";
        return Err(FieldError::new(field("start", START_ANGLE.name), message));
    };
    let needed_wh = shadow_energy_wh(path, *shadow);
    let fatal =
        shadows.iter().find(|(_, path, shadow)| path.resources.charge_wh < shadow_energy_wh(path, *shadow));
    if let Some((index, _, [from_s, to_s])) = fatal {
        return Ok(AimMoment { satellite: *index, time_s: 0.5 * (from_s + to_s) });
    }
    let most = libm::ceil(100.0 * needed_wh / path.resources.battery_wh) as i32 - 1;
    let message = format!(
        "must be at most {most}: power needs less charge than work takes in the first shadow ({needed_wh:.1} of {:.0} W·h), got {}",
        path.resources.battery_wh, facts.design.start.battery_percent
    );
    let fix = if most < BATTERY.min { "; choose a smaller battery_wh or another aim" } else { "" };
    Err(FieldError::new(field("start", BATTERY.name), message + fix))
}

fn check_wheels(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    at_least(WHEELS.name, facts.design.start.wheels_percent, MIN_WHEELS, "wheels needs fast wheels")?;
    Ok(AimMoment { satellite: 0, time_s: 0.0 })
}

fn check_full(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    let (mut earliest_s, mut latest_s) = (f64::INFINITY, 0.0_f64);
    for (satellite, path) in facts.satellites() {
        let full_s = facts.full_at_s(path).unwrap_or(f64::INFINITY);
        let pass_s =
            DesignFacts::passes(path).first().map_or(facts.forecast.time_limit_s, |pass| pass.open_s);
        if full_s < pass_s {
            return Ok(AimMoment { satellite, time_s: full_s });
        }
        (earliest_s, latest_s) = (earliest_s.min(full_s), latest_s.max(pass_s));
    }
    let message = format!(
        "must let work fill the storage before the first pass over a station, {latest_s:.0} s after the start; it is full {}; choose more, \
         or another utc_minute or further outages so that the pass is later{}",
        full_text(earliest_s),
        fields_text(facts)
    );
    Err(FieldError::new(field("start", STORAGE.name), message))
}

fn check_pass_missed(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    let mut found = Vec::new();
    for (satellite, path) in facts.satellites() {
        let Some(full_s) = facts.full_at_s(path) else { continue };
        // The gap after the last pass ends with the episode.
        let gap = facts.gaps(path).into_iter().find(|[from_s, to_s]| full_s > *from_s && full_s < *to_s);
        if let Some([from_s, _]) = gap.filter(|[from_s, _]| *from_s > 0.0) {
            return Ok(AimMoment { satellite, time_s: from_s });
        }
        found.push(full_s);
    }
    let full_s = found.first().copied().unwrap_or(f64::INFINITY);
    let gaps = facts.satellites().next().map_or_else(Vec::new, |(_, path)| facts.gaps(path));
    let after = gaps.iter().filter(|[from_s, _]| *from_s > 0.0).take(3);
    let times: Vec<_> = after.map(|[from_s, to_s]| format!("{from_s:.0} to {to_s:.0} s")).collect();
    let message = format!(
        "must let work fill the storage after a pass over a station and before the next one ({}); it is full {}{}",
        times.join(", "),
        full_text(full_s),
        fields_text(facts)
    );
    Err(FieldError::new(field("start", STORAGE.name), message))
}

fn check_idle(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    let start = &facts.design.start;
    at_least(
        BATTERY.name,
        start.battery_percent,
        MIN_IDLE_BATTERY,
        "idle needs a battery that need not be charged",
    )?;
    at_most(WHEELS.name, start.wheels_percent, MAX_IDLE_WHEELS, "idle needs slow wheels")?;
    at_most(
        STORAGE.name,
        start.storage_percent,
        MAX_IDLE_STORAGE,
        "idle needs a storage with room for work",
    )?;
    for (_, path) in facts.satellites() {
        let resources = &path.resources;
        let shadow = path.shadows().first().map_or(0.0, |shadow| shadow_energy_wh(path, *shadow));
        let left_wh = resources.charge_wh - shadow;
        if left_wh < IDLE_RESERVE * resources.battery_wh {
            let message = format!(
                "must be another one: idle needs a charge that work in the first shadow leaves above {:.0} W·h, but {left_wh:.0} W·h are \
                 left; choose a larger battery_wh, or a node_hour near 6 or 18",
                IDLE_RESERVE * resources.battery_wh
            );
            return Err(FieldError::new("aim.mode", message));
        }
    }
    Ok(AimMoment { satellite: 0, time_s: 0.0 })
}

fn check_window_missed(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    crowded_field(facts, 0)
}

fn check_low_value(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    crowded_field(facts, MIN_PRIORITY_RANGE)
}

/// Finds a field with more targets than can be imaged, and with priorities that differ by at least `range` hundredths.
fn crowded_field(facts: &DesignFacts<'_>, range: i32) -> Result<AimMoment, FieldError> {
    let mode = &facts.design.mode;
    let mut nearest = None;
    for (index, field) in facts.design.fields.iter().enumerate() {
        if field.priority_high - field.priority_low < range {
            continue;
        }
        let pass = facts.field_pass(index);
        if pass.seen > pass.images {
            let satellite = usize::try_from(field.satellite).unwrap_or(0);
            return Ok(AimMoment { satellite, time_s: S_PER_MINUTE * f64::from(field.minute) });
        }
        if nearest.as_ref().is_none_or(|(_, held): &(usize, super::facts::FieldPass)| held.seen < pass.seen) {
            nearest = Some((index, pass));
        }
    }
    Err(match nearest {
        Some((index, pass)) => FieldError::new(
            format!("fields.{index}"),
            format!(
                "must have more targets than can be imaged in its pass: {mode} needs them; the satellite sees {} of them and has time for \
                 {} images; choose more targets, less spread, or a smaller offset",
                pass.seen, pass.images
            ),
        ),
        None if range > 0 => FieldError::new(
            "fields",
            format!("must have a field whose priorities differ by at least {range}: {mode} needs one"),
        ),
        None => FieldError::new("fields", format!("must have an entry: {mode} needs one")),
    })
}

fn check_duplicate(facts: &DesignFacts<'_>) -> Result<AimMoment, FieldError> {
    let shared = facts.shared_targets();
    match shared.get(MIN_SHARED_TARGETS - 1) {
        Some((satellite, time_s)) => Ok(AimMoment { satellite: *satellite, time_s: *time_s }),
        None => {
            let message = format!(
                "must have at least {MIN_SHARED_TARGETS} targets that two satellites see: duplicate needs them; {} are seen so; choose \
                 more targets, a smaller offset, or earlier minutes of satellite 0",
                shared.len()
            );
            Err(FieldError::new("fields", message))
        }
    }
}

fn at_least(name: &str, number: i32, least: i32, reason: &str) -> Result<(), FieldError> {
    let message = || format!("must be at least {least}: {reason}, got {number}");
    if number >= least { Ok(()) } else { Err(FieldError::new(field("start", name), message())) }
}

fn at_most(name: &str, number: i32, most: i32, reason: &str) -> Result<(), FieldError> {
    let message = || format!("must be at most {most}: {reason}, got {number}");
    if number <= most { Ok(()) } else { Err(FieldError::new(field("start", name), message())) }
}

fn field(object: &str, name: &str) -> String {
    format!("{object}.{name}")
}

fn full_text(full_s: f64) -> String {
    if full_s.is_finite() { format!("at {full_s:.0} s") } else { "never".to_owned() }
}

fn fields_text(facts: &DesignFacts<'_>) -> &'static str {
    if facts.has_targets { ", or more targets in fields before it" } else { "" }
}
