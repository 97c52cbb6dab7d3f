//! Pictures of layouts: a map with tracks, shadow, stations and targets; a timeline of each satellite with the reference plan; and the
//! design as a table.
//!
//! `sky` computes what to draw, `world_map`, `timeline` and `captions` draw the parts. Start reading at [`draw`].

mod captions;
mod sky;
mod style;
#[cfg(test)]
mod tests;
mod timeline;
mod world_map;

use self::sky::LayoutSky;
use crate::design_language::LayoutView;
use crate::svg::{SvgCanvas, TextStyle};

/// Width of the page.
const WIDTH: f64 = 900.0;
/// Margin around the parts of the page.
const MARGIN: f64 = 16.0;
/// Top of the map, below the title.
const MAP_TOP: f64 = 102.0;
/// Maximum number of satellites with a timeline.
const MAX_TIMELINES: usize = 4;

/// Draws a layout as an SVG document; only a message if its episode cannot start.
pub(super) fn draw(layout: LayoutView<'_>) -> String {
    let mut canvas = SvgCanvas::new();
    let Some(sky) = LayoutSky::new(layout) else {
        let message = "The episode of this layout cannot start, so there is no picture.";
        canvas.text((MARGIN, 36.0), TextStyle::new(16.0), message);
        return canvas.finish((WIDTH, 60.0), layout.name);
    };
    captions::draw_title(&mut canvas, layout, &sky);
    let mut bottom = world_map::draw(&mut canvas, &sky, (MARGIN, MAP_TOP), WIDTH - 2.0 * MARGIN);
    bottom = captions::draw_map_legend(&mut canvas, &sky, bottom + 18.0);
    for satellite in 0..sky.plans.len().min(MAX_TIMELINES) {
        bottom = timeline::draw(&mut canvas, &sky, satellite, bottom + 12.0);
    }
    bottom = captions::draw_time_legend(&mut canvas, &sky, bottom + 18.0);
    bottom = captions::draw_table(&mut canvas, &sky, bottom + 20.0);
    canvas.finish((WIDTH, bottom + MARGIN), layout.name)
}
