//! Colours and marks that the parts of a picture share.

use crate::kessler::vocabulary::EncounterKind;
use crate::picture_parts::AGENT_COLOURS;
use crate::svg::{Point, Stroke, SvgCanvas};

/// Colours of the satellites, by index.
pub(super) const SATELLITE_COLOURS: [&str; 3] = [AGENT_COLOURS[0], AGENT_COLOURS[1], AGENT_COLOURS[2]];
/// Colour of the burns of the reference plan.
pub(super) const BURN_COLOUR: &str = "#ffffff";

/// Returns the colour of a kind of encounter.
pub(super) const fn kind_colour(kind: EncounterKind) -> &'static str {
    match kind {
        EncounterKind::Threat => "#ff7b72",
        EncounterKind::Decoy => "#f2cc60",
        EncounterKind::Screen => "#9fb0c3",
    }
}

/// Draws the star that marks where a rogue appears.
pub(super) fn draw_star(canvas: &mut SvgCanvas, (x, y): Point, colour: &'static str) {
    for (dx, dy) in [(5.0, 0.0), (2.5, 4.3), (-2.5, 4.3)] {
        canvas.line(&[(x - dx, y - dy), (x + dx, y + dy)], Stroke::new(colour, 1.4));
    }
}
