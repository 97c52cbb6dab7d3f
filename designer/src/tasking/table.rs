//! Designs as tables for people.

use env_core::tasking::setup::environment::DEFAULT_STATIONS;

use super::design::{TargetField, TaskingDesign};
use super::vocabulary::{PRIORITY_HIGH, PRIORITY_LOW};
use crate::design_language::DesignTable;

/// Columns of the fields. Fields are counted from 0, as in refusals (`fields.0`).
const FIELD_HEADER: [&str; 7] =
    ["#", "satellite", "minute", "offset, km", "spread, km", "targets", "priorities"];
/// Columns of a start, for designs without fields.
const START_HEADER: [&str; 8] =
    ["day", "node, h", "start angle", "battery, %", "wheels, %", "storage, %", "UTC", "out of service"];

/// Returns the aim of a design with its fields, or with its start if it has none.
pub(super) fn design_table(design: &TaskingDesign) -> DesignTable {
    if design.fields.is_empty() {
        return DesignTable {
            aim: aim_text(design),
            header: START_HEADER.to_vec(),
            rows: vec![start_row(design)],
        };
    }
    let rows = design.fields.iter().enumerate().map(|(index, field)| field_row(index, field)).collect();
    let aim = format!("{}; {}", aim_text(design), start_text(design));
    DesignTable { aim, header: FIELD_HEADER.to_vec(), rows }
}

/// Returns the aim in a few words.
pub(super) fn aim_text(design: &TaskingDesign) -> String {
    match design.aim_angle_deg {
        Some(angle) => format!("{} at {angle}° from noon", design.mode),
        None => design.mode.clone(),
    }
}

/// Returns the start in one line.
pub(super) fn start_text(design: &TaskingDesign) -> String {
    let start = &design.start;
    format!(
        "day {}, {}; node at {} h, start at {}°; battery {} %, wheels {} %, storage {} %; out of service: {}",
        start.day,
        utc_text(design),
        start.node_hour,
        start.start_angle_deg,
        start.battery_percent,
        start.wheels_percent,
        start.storage_percent,
        outages_text(design)
    )
}

fn start_row(design: &TaskingDesign) -> Vec<String> {
    let start = &design.start;
    vec![
        start.day.to_string(),
        start.node_hour.to_string(),
        format!("{}°", start.start_angle_deg),
        start.battery_percent.to_string(),
        start.wheels_percent.to_string(),
        start.storage_percent.to_string(),
        utc_text(design),
        outages_text(design),
    ]
}

/// Returns the row of a field, with a cell for each column of the table.
pub(super) fn field_row(index: usize, field: &TargetField) -> Vec<String> {
    vec![
        index.to_string(),
        field.satellite.to_string(),
        field.minute.to_string(),
        field.offset_km.to_string(),
        field.spread_km.to_string(),
        field.targets.to_string(),
        format!(
            "{:.2} – {:.2}",
            PRIORITY_LOW.value(field.priority_low),
            PRIORITY_HIGH.value(field.priority_high)
        ),
    ]
}

/// Returns the names of the stations that are out of service.
pub(super) fn outages_text(design: &TaskingDesign) -> String {
    let name = |station: &i32| Some(DEFAULT_STATIONS.get(usize::try_from(*station).ok()?)?.name);
    let names: Vec<_> = design.outages.iter().filter_map(name).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn utc_text(design: &TaskingDesign) -> String {
    let minute = design.start.utc_minute;
    format!("{:02}:{:02} UTC", minute / 60, minute % 60)
}
