//! Reads and checks the tables of a layout.

use super::{
    DAY_S, EpochDay, LAYOUT_YEARS, MAX_LAYOUT_DAY, MAX_LAYOUT_WHEEL_RPM, MIN_LAYOUT_CHARGE, SatelliteStart,
    TargetPlace, TaskingLayout,
};
use crate::error::ScenarioError;
use crate::task::{Layout, LayoutMode, MAX_LAYOUT_ROWS, Recipe};
use crate::tasking::setup::environment::DEFAULT_STATIONS;
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// Name of the table with the start of the episode: one row of year, day of the year and second of the day.
pub(super) const EPOCH: &str = "epoch";
/// Name of the table with the starts of the satellites.
pub(super) const SATELLITES: &str = "satellites";
/// Name of the table with the ground stations that are out of service.
pub(super) const OUTAGES: &str = "outages";
/// Name of the table with targets.
pub(super) const TARGETS: &str = "targets";

/// Smallest and largest value of a cell, and whether it is a whole number.
#[derive(Debug, Clone, Copy)]
struct Cell {
    min: f64,
    max: f64,
    is_whole: bool,
}

const fn number(min: f64, max: f64) -> Cell {
    Cell { min, max, is_whole: false }
}

const fn whole(min: u32, max: u32) -> Cell {
    Cell { min: min as f64, max: max as f64, is_whole: true }
}

/// Columns of an epoch. The day ends before its last second does.
const EPOCH_CELLS: [Cell; 3] =
    [whole(LAYOUT_YEARS[0], LAYOUT_YEARS[1]), whole(1, MAX_LAYOUT_DAY), number(0.0, DAY_S - 1e-6)];
const ANGLE: Cell = number(-360.0, 360.0);
const WHEEL: Cell = number(-MAX_LAYOUT_WHEEL_RPM, MAX_LAYOUT_WHEEL_RPM);
/// Columns of a satellite's start: node, anomaly, charge, wheels and storage.
const SATELLITE_CELLS: [Cell; 7] =
    [ANGLE, ANGLE, number(MIN_LAYOUT_CHARGE, 1.0), WHEEL, WHEEL, WHEEL, number(0.0, 1.0)];
/// Columns of a target: latitude, longitude and priority.
const TARGET_CELLS: [Cell; 3] = [number(-90.0, 90.0), number(-180.0, 180.0), number(0.0, 1.0)];

/// Reads the layout of a recipe.
///
/// # Errors
/// Returns the first table or cell that is unknown or out of bounds.
pub(super) fn read(layout: &Layout, recipe: &Recipe) -> Result<TaskingLayout, ScenarioError> {
    let has_targets = recipe.param("targets").is_some();
    let known: &[&str] =
        if has_targets { &[EPOCH, SATELLITES, OUTAGES, TARGETS] } else { &[EPOCH, SATELLITES, OUTAGES] };
    if let Some(table) = layout.bodies.keys().find(|table| !known.contains(&table.as_str())) {
        return Err(ScenarioError::UnknownField { field: field(table), known: known.join(", ") });
    }
    let rows: usize = layout.bodies.values().map(Vec::len).sum();
    if let Some(longest) = layout.bodies.keys().max_by_key(|table| layout.bodies[*table].len())
        && rows > MAX_LAYOUT_ROWS
    {
        let reason = format!("must leave at most {MAX_LAYOUT_ROWS} rows in all tables, got {rows}");
        return Err(ScenarioError::layout(field(longest), reason));
    }
    Ok(TaskingLayout {
        epoch: table(layout, EPOCH, EPOCH_CELLS)?.map(|rows| read_epoch(&rows)).transpose()?,
        satellites: table(layout, SATELLITES, SATELLITE_CELLS)?
            .map(|rows| read_satellites(&rows, recipe))
            .transpose()?,
        outages: read_outages(layout, recipe)?,
        targets: table(layout, TARGETS, TARGET_CELLS)?.map(|rows| read_targets(&rows)).transpose()?,
        keeps_drawn_targets: layout.mode == LayoutMode::Extend,
    })
}

fn read_epoch(rows: &[[f64; 3]]) -> Result<EpochDay, ScenarioError> {
    match rows {
        [[year, day, second]] => Ok(EpochDay { year: *year as u32, day: *day as u32, second: *second }),
        _ => Err(ScenarioError::layout(field(EPOCH), format!("must have one row, got {}", rows.len()))),
    }
}

fn read_satellites(rows: &[[f64; 7]], recipe: &Recipe) -> Result<Vec<SatelliteStart>, ScenarioError> {
    let wanted = recipe.task().agents(recipe) as usize;
    if rows.len() != wanted {
        let reason = format!("must have {wanted} rows, one for each satellite, got {}", rows.len());
        return Err(ScenarioError::layout(field(SATELLITES), reason));
    }
    let start = |[node_deg, anomaly_deg, charge, x, y, z, fill]: &[f64; 7]| SatelliteStart {
        node_deg: *node_deg,
        anomaly_deg: *anomaly_deg,
        charge: *charge,
        wheels_rpm: [*x, *y, *z],
        fill: *fill,
    };
    Ok(rows.iter().map(start).collect())
}

/// Reads the stations that are out of service, at least one fewer than the task has.
fn read_outages(layout: &Layout, recipe: &Recipe) -> Result<Vec<usize>, ScenarioError> {
    let stations = recipe.param("stations").map_or(DEFAULT_STATIONS.len(), |stations| stations as usize);
    let last = u32::try_from(stations.saturating_sub(1)).unwrap_or(u32::MAX);
    let rows = table(layout, OUTAGES, [whole(0, last)])?.unwrap_or_default();
    let mut outages = Vec::with_capacity(rows.len());
    for (index, [station]) in rows.iter().enumerate() {
        let station = *station as usize;
        if outages.contains(&station) {
            let path = format!("{}.{index}.0", field(OUTAGES));
            return Err(ScenarioError::layout(path, format!("repeats station {station}")));
        }
        outages.push(station);
    }
    if outages.len() >= stations {
        let reason = format!("must leave one of the {stations} stations in service");
        return Err(ScenarioError::layout(field(OUTAGES), reason));
    }
    Ok(outages)
}

fn read_targets(rows: &[[f64; 3]]) -> Result<Vec<TargetPlace>, ScenarioError> {
    if rows.is_empty() {
        return Err(ScenarioError::layout(field(TARGETS), "must have at least one row"));
    }
    let place = |[latitude, longitude, priority]: &[f64; 3]| TargetPlace {
        latitude_deg: *latitude,
        longitude_deg: *longitude,
        priority: *priority,
    };
    Ok(rows.iter().map(place).collect())
}

/// Reads a table whose rows have these cells; `None` if the layout does not have it.
fn table<const CELLS: usize>(
    layout: &Layout,
    name: &str,
    cells: [Cell; CELLS],
) -> Result<Option<Vec<[f64; CELLS]>>, ScenarioError> {
    let Some(rows) = layout.bodies.get(name) else { return Ok(None) };
    let mut checked = Vec::with_capacity(rows.len());
    for (index, row) in rows.iter().enumerate() {
        let path = format!("{}.{index}", field(name));
        let Ok(row) = <[f64; CELLS]>::try_from(row.as_slice()) else {
            let reason = format!("must be a list of {CELLS} numbers, got {}", row.len());
            return Err(ScenarioError::layout(path, reason));
        };
        for (column, (value, cell)) in row.iter().zip(&cells).enumerate() {
            ScenarioError::check_range(format_args!("{path}.{column}"), *value, cell.min, cell.max)?;
            if cell.is_whole && libm::floor(*value) != *value {
                let reason = format!("must be a whole number, got {value}");
                return Err(ScenarioError::layout(format!("{path}.{column}"), reason));
            }
        }
        checked.push(row);
    }
    Ok(Some(checked))
}

fn field(table: &str) -> String {
    format!("layout.bodies.{}", shorten(table, MAX_QUOTED_CHARS))
}
