//! A design for people, in numbers as they are meant: LU and LU/TU, not tenths of them.

use super::language::{Design, Encounter, FRAMES, MISS, SPEED, frame_word};
use crate::language::Listing;

/// The columns of encounters. They are counted from 0, as refusals name them (`encounters.0`).
pub(super) const HEADER: [&str; 7] = ["#", "satellite", "step", "bearing", "LU/TU", "miss, LU", "kind"];

/// A design's aim and encounters.
pub(super) fn listing(design: &Design) -> Listing {
    let rows = design.encounters.iter().enumerate().map(|(at, encounter)| row(at, encounter));
    Listing { aim: aim(design), header: HEADER.to_vec(), rows: rows.collect() }
}

/// What it goes for, in words.
pub(super) fn aim(design: &Design) -> String {
    let mode = &design.aim.mode;
    match design.aim.bearing_deg {
        Some(bearing) => format!("{mode} from {bearing}° ({})", frame(design)),
        None => format!("{mode} ({})", frame(design)),
    }
}

/// The frame's word, with spaces.
pub(super) fn frame(design: &Design) -> String {
    frame_word(design.frame).replace("radial_in_track", "radial/in-track")
}

/// The meaning of the frame's angles.
pub(super) fn frame_about(design: &Design) -> &'static str {
    FRAMES.iter().find(|(_, frame, _)| *frame == design.frame).map_or("", |row| row.2)
}

/// One encounter.
pub(super) fn row(at: usize, encounter: &Encounter) -> Vec<String> {
    vec![
        at.to_string(),
        encounter.satellite.to_string(),
        encounter.step.to_string(),
        format!("{}°", encounter.bearing_deg),
        format!("{:.1}", SPEED.value(encounter.relative_speed)),
        format!("{:.1}", MISS.value(encounter.miss_distance)),
        kind(encounter),
    ]
}

/// Its kind, and whether it is a rogue.
pub(super) fn kind(encounter: &Encounter) -> String {
    let word = encounter.kind.word();
    if encounter.rogue { format!("rogue {word}") } else { word.to_owned() }
}
