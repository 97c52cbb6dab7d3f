//! One encounter as its satellite sees it coming: radial out is up, in-track is to the right, and a bearing is read as on
//! a compass.

use env_core::kessler::kernel::Body;

use super::super::claim::AIM_WIDTH;
use super::super::language::{MISS, SPEED};
use super::scene::{CONTACT, Pass, Scene};
use super::sky::{colour, turned};
use super::{AIM, SATELLITE_COLOURS};
use crate::picture::{Canvas, DIM, FAINT, Pen, Stroke, TEXT, number};

/// Steps before the encounter that are shown.
const SHOWN: u32 = 6;
/// How far from the middle the path may go, and the aim's sector goes, as shares of the side: words stand outside.
const REACH: f64 = 0.32;
/// Lengths of the scale bar, LU.
const SCALES: [f64; 5] = [20.0, 10.0, 5.0, 2.0, 1.0];

/// Where debris is as seen from a satellite: in-track and radial out, LU.
fn seen(of: &Body, at: &Body) -> (f64, f64) {
    let ((rx, ry), (tx, ty)) = of.frame();
    let (dx, dy) = (at.x - of.x, at.y - of.y);
    (dx * tx + dy * ty, dx * rx + dy * ry)
}

/// Draws encounter `index` into a square of this size, its words below.
pub(super) fn draw(canvas: &mut Canvas, scene: &Scene, index: usize, corner: (f64, f64), side: f64) {
    let Some(pass) = scene.passes.get(index) else { return };
    let satellite = pass.encounter.satellite as usize;
    let from = pass.encounter.step.saturating_sub(SHOWN);
    let path: Vec<(u32, (f64, f64))> = pass
        .steps()
        .filter(|(step, _)| *step >= from)
        .map(|(step, body)| (step, seen(scene.hold.at(satellite, step), body)))
        .collect();
    let reach = |(x, y): (f64, f64)| (x * x + y * y).sqrt();
    let before = path.iter().filter(|(step, _)| *step <= pass.encounter.step);
    let most = before.map(|(_, at)| reach(*at)).fold(4.0 * CONTACT, f64::max);
    let scale = REACH * side / most;
    let middle = (corner.0 + 0.5 * side, corner.1 + 0.5 * side);
    let map = |(x, y): (f64, f64)| (middle.0 + scale * x, middle.1 - scale * y);

    canvas.panel(corner, (side, side), "#0b0f15");
    canvas.window(&format!("inset{index}"), corner, (side, side));
    compass(canvas, corner, side);
    aim(canvas, scene, pass, middle, REACH * side);
    let colour = colour(pass.encounter.kind);
    canvas.circle(middle, scale * CONTACT, "#2a3442", Some(Stroke::new(TEXT, 0.8).opacity(0.7)));
    let line: Vec<_> = path.iter().map(|(_, at)| map(*at)).collect();
    let dashes = if pass.encounter.rogue { "5 3" } else { "" };
    canvas.line(&line, Stroke::new(colour, 1.8).dashes(dashes));
    canvas.dots(&line, Stroke::new(colour, 4.4));
    if let Some((_, nearest)) = path.iter().find(|(step, _)| *step == pass.encounter.step) {
        canvas.line(&[middle, map(*nearest)], Stroke::new(TEXT, 1.2));
    }
    bearing(canvas, pass, &path, middle, &map);
    canvas.circle(middle, 2.6, SATELLITE_COLOURS[satellite % SATELLITE_COLOURS.len()], None);
    bar(canvas, corner, side, scale);
    canvas.end_window();
    words(canvas, pass, index, (corner.0, corner.1 + side));
}

/// Directions at the edges.
fn compass(canvas: &mut Canvas, corner: (f64, f64), side: f64) {
    let middle = (corner.0 + 0.5 * side, corner.1 + 0.5 * side);
    let thin = Stroke::new(FAINT, 1.0);
    let reach = REACH * side;
    canvas.line(&[(middle.0, middle.1 - reach), (middle.0, middle.1 + reach)], thin);
    canvas.line(&[(middle.0 - reach, middle.1), (middle.0 + reach, middle.1)], thin);
    canvas.circle(middle, reach, "none", Some(thin));
    let pen = Pen::new(9.0).colour(DIM).anchor("middle");
    canvas.text((middle.0, corner.1 + 20.0), pen, "out, 0°");
    canvas.text((middle.0, corner.1 + side - 14.0), pen, "Earth, 180°");
    for (x, words) in [(side - 18.0, ["ahead", "90°"]), (18.0, ["behind", "270°"])] {
        canvas.text((corner.0 + x, middle.1 - 2.0), pen, words[0]);
        canvas.text((corner.0 + x, middle.1 + 10.0), pen, words[1]);
    }
}

/// A place so far from the middle, this many degrees clockwise from up.
fn around(middle: (f64, f64), turn_deg: f64, length: f64) -> (f64, f64) {
    let (sin, cos) = libm::sincos(turn_deg.to_radians());
    (middle.0 + length * sin, middle.1 - length * cos)
}

/// Where the aim says that it comes from.
fn aim(canvas: &mut Canvas, scene: &Scene, pass: &Pass, middle: (f64, f64), length: f64) {
    let Some(design) = &scene.design else { return };
    let Some(bearing_deg) = design.aim.bearing_deg else { return };
    let of = scene.hold.at(pass.encounter.satellite as usize, pass.seen);
    let turn = turned(design.frame, of, f64::from(bearing_deg));
    let mut outline = vec![middle];
    outline.extend(
        (0..=10).map(|part| around(middle, turn + AIM_WIDTH * (f64::from(part) / 5.0 - 1.0), length)),
    );
    canvas.area(&outline, AIM, 0.14, None);
}

/// From the satellite to where the debris is when its bearing is taken.
fn bearing(
    canvas: &mut Canvas,
    pass: &Pass,
    path: &[(u32, (f64, f64))],
    middle: (f64, f64),
    map: &impl Fn((f64, f64)) -> (f64, f64),
) {
    if let Some((_, at)) = path.iter().find(|(step, _)| *step == pass.seen) {
        let at = map(*at);
        canvas.line(&[middle, at], Stroke::new(TEXT, 1.0).opacity(0.8).dashes("2 3"));
        canvas.circle(at, 4.2, "none", Some(Stroke::new(TEXT, 1.4)));
    }
}

fn bar(canvas: &mut Canvas, corner: (f64, f64), side: f64, scale: f64) {
    let length = SCALES.into_iter().find(|length| length * scale < 0.3 * side).unwrap_or(1.0);
    let (x, y) = (corner.0 + 8.0, corner.1 + side - 8.0);
    canvas.line(&[(x, y), (x + length * scale, y)], Stroke::new(TEXT, 1.2));
    canvas.text((x, y - 4.0), Pen::new(9.5), &format!("{} LU", number(length)));
}

fn words(canvas: &mut Canvas, pass: &Pass, index: usize, (x, y): (f64, f64)) {
    let encounter = &pass.encounter;
    let kind = super::super::listing::kind(encounter);
    let first = format!(
        "{index}: satellite {}, step {}, {}°",
        encounter.satellite, encounter.step, encounter.bearing_deg
    );
    canvas.text((x, y + 15.0), Pen::new(12.0).bold(), &first);
    let second = format!(
        "{kind}, {:.1} LU/TU, miss {:.1} LU",
        SPEED.value(encounter.relative_speed),
        MISS.value(encounter.miss_distance)
    );
    canvas.text((x, y + 30.0), Pen::new(10.0).colour(colour(encounter.kind)), &second);
}
