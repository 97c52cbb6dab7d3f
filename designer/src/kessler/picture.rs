//! A layout as a picture: the sky with who holds, who flies the witness and what comes; what it is, in words; and each
//! encounter as its satellite sees it.

mod inset;
mod key;
mod labels;
mod scene;
mod sky;
#[cfg(test)]
mod tests;

use self::scene::Scene;
use crate::picture::{Canvas, DIM, Pen, Subject};

/// Colours of the satellites, by number.
const SATELLITE_COLOURS: [&str; 3] = ["#6cb6ff", "#7ee0a1", "#d2a8ff"];
const THREAT: &str = "#ff7b72";
const DECOY: &str = "#f2cc60";
const SCREEN: &str = "#9fb0c3";
const AIM: &str = "#ffa657";
const BURN: &str = "#ffffff";
const EARTH: &str = "#16304f";
const EARTH_RIM: &str = "#5b8fd0";

/// The page: its width, the room around things, and where the sky begins.
const WIDTH: f64 = 900.0;
const MARGIN: f64 = 16.0;
const TOP: f64 = 84.0;
/// The sides of the sky and of an inset.
const SKY: f64 = 590.0;
const INSET: f64 = 205.0;
/// Insets in a row, and in all: those that come first in time.
const IN_A_ROW: usize = 4;
const INSETS: usize = 8;
/// What a row of insets takes with its words.
const ROW: f64 = INSET + 48.0;

/// The picture of a layout; words alone where it cannot be flown.
pub(super) fn picture(subject: Subject<'_>) -> String {
    let mut canvas = Canvas::new();
    let Some(scene) = Scene::of(subject) else {
        canvas.text((MARGIN, 36.0), Pen::new(16.0), "This layout cannot be flown: there is nothing to draw.");
        return canvas.finish((WIDTH, 60.0), subject.name);
    };
    key::title(&mut canvas, subject, &scene);
    sky::draw(&mut canvas, &scene, (MARGIN, TOP), (SKY, SKY));
    let beside = 2.0 * MARGIN + SKY;
    let end = key::legend(&mut canvas, &scene, (beside, TOP));
    let end = key::table(&mut canvas, &scene, (beside, end + 14.0), WIDTH - beside - MARGIN);
    let end = insets(&mut canvas, &scene, end.max(TOP + SKY) + MARGIN);
    canvas.finish((WIDTH, end), subject.name)
}

/// The encounters that come first, each as its satellite sees it; answers with where they end.
fn insets(canvas: &mut Canvas, scene: &Scene, top: f64) -> f64 {
    let mut shown: Vec<usize> = (0..scene.passes.len()).collect();
    if shown.is_empty() {
        return top;
    }
    shown.sort_by_key(|index| scene.passes[*index].encounter.step);
    shown.truncate(INSETS);
    shown.sort_unstable();
    let words = "As the satellite sees it coming, over the last six steps (it stands still in the middle):";
    canvas.text((MARGIN, top + 12.0), Pen::new(12.0).colour(DIM), words);
    let across = (WIDTH - 2.0 * MARGIN - INSET) / (IN_A_ROW - 1) as f64;
    for (place, index) in shown.iter().enumerate() {
        let (column, row) = (place % IN_A_ROW, place / IN_A_ROW);
        let corner = (MARGIN + across * column as f64, top + 24.0 + ROW * row as f64);
        inset::draw(canvas, scene, *index, corner, INSET);
    }
    top + 28.0 + ROW * shown.len().div_ceil(IN_A_ROW) as f64
}
