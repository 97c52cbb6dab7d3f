//! Pictures of layouts: the starts and the reference plan in Hill's frame in two planes, and speeds against distances.
//!
//! `scene` computes what to draw, `plane_map`, `speed_chart` and `captions` draw the parts. Start reading at [`draw`].

mod captions;
mod plane_map;
mod scene;
mod speed_chart;
#[cfg(test)]
mod tests;

use self::plane_map::PLANES;
use self::scene::DockingScene;
use crate::design_language::LayoutView;
use crate::svg::{SvgCanvas, TextStyle};

/// Width of the page.
const WIDTH: f64 = 900.0;
/// Margin around the parts of the page.
const MARGIN: f64 = 16.0;
/// Top of the maps, below the title.
const MAP_TOP: f64 = 84.0;
/// Side of a map.
const MAP_SIDE: f64 = 426.0;
/// Height of the chart of speeds.
const CHART_HEIGHT: f64 = 300.0;

/// Draws a layout as an SVG document; only a message if its episode cannot start.
pub(super) fn draw(layout: LayoutView<'_>) -> String {
    let mut canvas = SvgCanvas::new();
    let Some(scene) = DockingScene::new(layout) else {
        let message = "The episode of this layout cannot start, so there is no picture.";
        canvas.text((MARGIN, 36.0), TextStyle::new(16.0), message);
        return canvas.finish((WIDTH, 60.0), layout.name);
    };
    captions::draw_title(&mut canvas, layout, &scene);
    let right = 2.0 * MARGIN + MAP_SIDE;
    plane_map::draw(&mut canvas, &scene, PLANES[0], (MARGIN, MAP_TOP));
    plane_map::draw(&mut canvas, &scene, PLANES[1], (right, MAP_TOP));
    let top = MAP_TOP + MAP_SIDE + MARGIN;
    speed_chart::draw(&mut canvas, &scene, (MARGIN, top));
    let legend_bottom = captions::draw_legend(&mut canvas, &scene, (right, top));
    let bottom = (top + CHART_HEIGHT).max(legend_bottom) + MARGIN;
    let bottom = captions::draw_table(&mut canvas, &scene, (MARGIN, bottom));
    canvas.finish((WIDTH, bottom + MARGIN), layout.name)
}
