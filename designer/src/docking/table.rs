//! Designs as tables for people. Quantities are in m and m/s.

use env_core::docking::relative_motion::speed_limit;

use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::{CLOSING, CROSS, DISTANCE};
use crate::design_language::DesignTable;

/// Columns of the deputies. Deputies are counted from 0, as in refusals (`deputies.0`).
pub(super) const HEADER: [&str; 8] =
    ["#", "distance, m", "azimuth", "elevation", "closing, %", "cross, %", "cross to", "m/s"];

/// Returns the aim and the deputies of a design.
pub(super) fn design_table(design: &DockingDesign) -> DesignTable {
    let rows = design.deputies.iter().enumerate().map(|(index, deputy)| deputy_row(index, deputy));
    DesignTable { aim: aim_text(design), header: HEADER.to_vec(), rows: rows.collect() }
}

/// Returns the aim in a few words.
pub(super) fn aim_text(design: &DockingDesign) -> String {
    let mode = &design.aim.mode;
    design.aim.bearing_deg.map_or_else(|| mode.clone(), |bearing| format!("{mode} from {bearing}°"))
}

/// Returns the row of a deputy, with a cell for each column of the table.
pub(super) fn deputy_row(index: usize, deputy: &DeputyStart) -> Vec<String> {
    let limit = speed_limit(DISTANCE.value(deputy.distance));
    let share = |number: f64| number / 100.0 * limit;
    let (closing, cross) =
        (share(CLOSING.value(deputy.closing_speed)), share(CROSS.value(deputy.cross_speed)));
    vec![
        index.to_string(),
        format!("{:.1}", DISTANCE.value(deputy.distance)),
        format!("{}°", deputy.azimuth_deg),
        format!("{}°", deputy.elevation_deg),
        deputy.closing_speed.to_string(),
        deputy.cross_speed.to_string(),
        format!("{}°", deputy.cross_deg),
        format!("{:.2}", (closing * closing + cross * cross).sqrt()),
    ]
}
