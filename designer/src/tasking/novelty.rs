//! Distance of two designs, by their starts and their fields. Names and the order of fields do not matter.

use super::design::{DesignedStart, TargetField, TaskingDesign};
use super::vocabulary::{
    BATTERY, DAY, MINUTE, NODE_HOUR, OFFSET, PRIORITY_HIGH, PRIORITY_LOW, SPREAD, START_ANGLE, STATION,
    STORAGE, TARGETS, UTC_MINUTE, WHEELS,
};
use crate::bound::Bound;
use crate::distance_parts::{mean_nearest, param_distance, root_mean_square};

/// Difference of two fields in the satellite.
const SATELLITE_DIFFERENCE: f64 = 0.5;
/// Minutes of an episode on whose scale the passes over two fields differ: an orbit.
const ORBIT_MINUTES: f64 = 95.0;

/// Returns the distance of two designs: the mean of the distance of their starts and, if either has fields, of the distance of their
/// fields. It is 0 for equal designs, and at most 1.
pub(super) fn distance(a: &TaskingDesign, b: &TaskingDesign) -> f64 {
    let starts = start_distance(a, b);
    let parts = if a.fields.is_empty() && b.fields.is_empty() {
        starts
    } else {
        0.5 * (starts + mean_nearest(&a.fields, &b.fields, field_distance))
    };
    (parts + param_distance(&a.params, &b.params)).min(1.0)
}

/// Returns the root mean square of the differences of two starts, each on the scale of its bounds.
fn start_distance(a: &TaskingDesign, b: &TaskingDesign) -> f64 {
    let number = |of: fn(&DesignedStart) -> i32| [of(&a.start), of(&b.start)];
    let differs = |of: fn(&TaskingDesign) -> bool| if of(a) == of(b) { 0.0 } else { 1.0 };
    let out_of_one = (STATION.min..=STATION.max)
        .filter(|station| a.outages.contains(station) != b.outages.contains(station))
        .count();
    root_mean_square(&[
        on_circle(DAY, number(|start| start.day)),
        on_circle(UTC_MINUTE, number(|start| start.utc_minute)),
        on_circle(NODE_HOUR, number(|start| start.node_hour)),
        on_circle(START_ANGLE, number(|start| start.start_angle_deg)),
        on_scale(BATTERY, number(|start| start.battery_percent)),
        on_scale(WHEELS, number(|start| start.wheels_percent)),
        on_scale(STORAGE, number(|start| start.storage_percent)),
        out_of_one as f64 / f64::from(STATION.max - STATION.min + 1),
        differs(|design| design.keeps_background),
    ])
}

fn field_distance(a: &TargetField, b: &TargetField) -> f64 {
    let number = |of: fn(&TargetField) -> i32| [of(a), of(b)];
    let minutes = f64::from((a.minute - b.minute).abs().min(MINUTE.max));
    root_mean_square(&[
        if a.satellite == b.satellite { 0.0 } else { SATELLITE_DIFFERENCE },
        (minutes / ORBIT_MINUTES).min(1.0),
        on_scale(OFFSET, number(|field| field.offset_km)),
        on_scale(SPREAD, number(|field| field.spread_km)),
        on_scale(TARGETS, number(|field| field.targets)),
        on_scale(PRIORITY_LOW, number(|field| field.priority_low)),
        on_scale(PRIORITY_HIGH, number(|field| field.priority_high)),
    ])
}

fn on_scale(bound: Bound<i32>, [a, b]: [i32; 2]) -> f64 {
    f64::from((a - b).abs()) / f64::from(bound.max - bound.min)
}

/// Difference of two numbers whose largest value is next to the smallest, as a share of half of the circle.
fn on_circle(bound: Bound<i32>, [a, b]: [i32; 2]) -> f64 {
    let whole = bound.max - bound.min + 1;
    let turn = (a - b).abs() % whole;
    2.0 * f64::from(turn.min(whole - turn)) / f64::from(whole)
}
