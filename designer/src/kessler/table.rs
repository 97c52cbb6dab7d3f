//! Designs as tables for people. Quantities are in LU and LU/TU, not in tenths of them.

use super::design::{Design, Encounter};
use super::vocabulary::{MISS, SPEED, frame_spec};
use crate::design_language::DesignTable;

/// Columns of the encounters. Encounters are counted from 0, as in refusals (`encounters.0`).
const HEADER: [&str; 7] = ["#", "satellite", "step", "bearing", "LU/TU", "miss, LU", "kind"];

/// Returns the aim and the encounters of a design.
pub(super) fn design_table(design: &Design) -> DesignTable {
    let rows = design.encounters.iter().enumerate().map(|(index, encounter)| encounter_row(index, encounter));
    DesignTable { aim: aim_text(design), header: HEADER.to_vec(), rows: rows.collect() }
}

/// Returns the aim in a few words.
pub(super) fn aim_text(design: &Design) -> String {
    let mode = &design.aim.mode;
    match design.aim.bearing_deg {
        Some(bearing) => format!("{mode} from {bearing}° ({})", frame_text(design)),
        None => format!("{mode} ({})", frame_text(design)),
    }
}

/// Returns the name of the frame for display.
pub(super) fn frame_text(design: &Design) -> String {
    frame_spec(design.frame).name.replace("radial_in_track", "radial/in-track")
}

/// Returns the row of an encounter, with a cell for each column of the table.
pub(super) fn encounter_row(index: usize, encounter: &Encounter) -> Vec<String> {
    vec![
        index.to_string(),
        encounter.satellite.to_string(),
        encounter.step.to_string(),
        format!("{}°", encounter.bearing_deg),
        format!("{:.1}", SPEED.value(encounter.relative_speed)),
        format!("{:.1}", MISS.value(encounter.miss_distance)),
        kind_text(encounter),
    ]
}

/// Returns the kind of an encounter, with a prefix for rogues.
pub(super) fn kind_text(encounter: &Encounter) -> String {
    let kind = encounter.kind.as_str();
    if encounter.is_rogue { format!("rogue {kind}") } else { kind.to_owned() }
}
