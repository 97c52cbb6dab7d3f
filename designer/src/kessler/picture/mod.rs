//! Pictures of layouts: a map with orbits, the reference plan and debris; captions; and each encounter as its satellite sees
//! it.
//!
//! `scene` computes what to draw, `orbit_map`, `captions` and `inset` draw the parts. Start reading at [`draw`].

mod captions;
mod inset;
mod orbit_map;
mod scene;
mod style;
#[cfg(test)]
mod tests;

use self::scene::Scene;
use crate::design_language::LayoutView;
use crate::svg::{DIM, SvgCanvas, TextStyle};

/// Width of the page.
const WIDTH: f64 = 900.0;
/// Margin around the parts of the page.
const MARGIN: f64 = 16.0;
/// Top of the map, below the title.
const MAP_TOP: f64 = 84.0;
/// Side of the map.
const MAP_SIDE: f64 = 590.0;
/// Side of an inset.
const INSET_SIDE: f64 = 205.0;
/// Height of a row of insets with its captions.
const INSET_ROW_HEIGHT: f64 = INSET_SIDE + 48.0;
/// Number of insets in a row.
const INSETS_PER_ROW: usize = 4;
/// Maximum number of insets. Earlier encounters are preferred.
const MAX_INSETS: usize = 8;

/// Draws a layout as an SVG document; only a message if its episode cannot start.
pub(super) fn draw(layout: LayoutView<'_>) -> String {
    let mut canvas = SvgCanvas::new();
    let Some(scene) = Scene::new(layout) else {
        let message = "The episode of this layout cannot start, so there is no picture.";
        canvas.text((MARGIN, 36.0), TextStyle::new(16.0), message);
        return canvas.finish((WIDTH, 60.0), layout.name);
    };
    captions::draw_title(&mut canvas, layout, &scene);
    orbit_map::draw(&mut canvas, &scene, (MARGIN, MAP_TOP), (MAP_SIDE, MAP_SIDE));
    let left = 2.0 * MARGIN + MAP_SIDE;
    let bottom = captions::draw_legend(&mut canvas, &scene, (left, MAP_TOP));
    let bottom = captions::draw_table(&mut canvas, &scene, (left, bottom + 14.0), WIDTH - left - MARGIN);
    let bottom = draw_insets(&mut canvas, &scene, bottom.max(MAP_TOP + MAP_SIDE) + MARGIN);
    canvas.finish((WIDTH, bottom), layout.name)
}

/// Draws the first encounters as insets. Returns the bottom of the last row.
fn draw_insets(canvas: &mut SvgCanvas, scene: &Scene, top: f64) -> f64 {
    let mut shown: Vec<usize> = (0..scene.passes.len()).collect();
    if shown.is_empty() {
        return top;
    }
    shown.sort_by_key(|index| scene.passes[*index].encounter.step);
    shown.truncate(MAX_INSETS);
    shown.sort_unstable();
    let caption = "Approach of the debris in the last six steps, relative to the satellite in the middle:";
    canvas.text((MARGIN, top + 12.0), TextStyle::new(12.0).colour(DIM), caption);
    let spacing = (WIDTH - 2.0 * MARGIN - INSET_SIDE) / (INSETS_PER_ROW - 1) as f64;
    for (position, index) in shown.iter().enumerate() {
        let (column, row) = (position % INSETS_PER_ROW, position / INSETS_PER_ROW);
        let corner = (MARGIN + spacing * column as f64, top + 24.0 + INSET_ROW_HEIGHT * row as f64);
        inset::draw(canvas, scene, *index, corner, INSET_SIDE);
    }
    top + 28.0 + INSET_ROW_HEIGHT * shown.len().div_ceil(INSETS_PER_ROW) as f64
}
