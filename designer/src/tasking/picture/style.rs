//! Colours that the parts of a picture share.

/// Colours of the satellites, by index.
const SATELLITE_COLOURS: [&str; 8] =
    ["#6cb6ff", "#7ee0a1", "#d2a8ff", "#ff9bce", "#9ad7e8", "#b9e06c", "#e8c9a0", "#a7b4ff"];
/// Colour of the coastline.
pub(super) const COAST_COLOUR: &str = "#46566b";
/// Colour of the night side at the start.
pub(super) const NIGHT_COLOUR: &str = "#000000";
/// Colour of stations in service, of passes and of downlinks.
pub(super) const STATION_COLOUR: &str = "#56d4bc";
/// Colour of stations out of service, and of wheels.
pub(super) const OUTAGE_COLOUR: &str = "#ff7b72";
/// Colour of targets of fields and of their windows.
pub(super) const TARGET_COLOUR: &str = "#ffa657";
/// Colour of drawn targets.
pub(super) const BACKGROUND_TARGET_COLOUR: &str = "#8594a7";
/// Colour of sunlight and of charging.
pub(super) const SUN_COLOUR: &str = "#f2cc60";
/// Colour of scans and images.
pub(super) const WORK_COLOUR: &str = "#6cb6ff";
/// Colour of the charge.
pub(super) const BATTERY_COLOUR: &str = "#7ee0a1";
/// Colour of the data in the storage.
pub(super) const STORAGE_COLOUR: &str = "#d2a8ff";
/// Colour of images by the reference plan.
pub(super) const IMAGED_COLOUR: &str = "#ffffff";

/// Returns the colour of a satellite.
pub(super) const fn satellite_colour(index: usize) -> &'static str {
    SATELLITE_COLOURS[index % SATELLITE_COLOURS.len()]
}
