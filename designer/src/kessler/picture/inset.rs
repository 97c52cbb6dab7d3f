//! Inset: one encounter as its satellite sees it. Radial out is up and in-track is to the right, so that a bearing reads as on
//! a compass.

use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::CONTACT_DISTANCE;
use env_core::kessler::kernel::Body;

use super::scene::{Pass, Scene};
use super::style::{SATELLITE_COLOURS, kind_colour};
use crate::kessler::aim::AIM_TOLERANCE_DEG;
use crate::kessler::table::kind_text;
use crate::kessler::vocabulary::{MISS, SPEED};
use crate::picture_parts::{AIM_COLOUR, SPACE_COLOUR};
use crate::svg::{DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle, format_number};

/// Number of steps before the encounter that are shown.
const SHOWN_STEPS: u32 = 6;
/// Maximum distance of the path and of the aim's sector from the middle, as a share of the side. The rest is for captions.
const REACH: f64 = 0.32;
/// Lengths of the scale bar, in LU; the longest that fits is used.
const SCALE_LENGTHS: [f64; 5] = [20.0, 10.0, 5.0, 2.0, 1.0];
const CONTACT_FILL: &str = "#2a3442";

/// Square of the page with the satellite in its middle.
struct InsetView {
    corner: Point,
    side: f64,
    middle: Point,
    /// Units of the page per LU.
    scale: f64,
    /// Steps of the debris, with its position relative to the satellite in LU: in-track and radial out.
    path: Vec<(u32, [f64; 2])>,
}

impl InsetView {
    fn new(scene: &Scene, pass: &Pass, corner: Point, side: f64) -> Self {
        let first = pass.encounter.step.saturating_sub(SHOWN_STEPS);
        let path: Vec<(u32, [f64; 2])> = pass
            .steps()
            .filter(|(step, _)| *step >= first)
            .map(|(step, body)| {
                (step, relative_position(scene.coast.satellite(pass.satellite(), step), body))
            })
            .collect();
        let distance = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
        let before = path.iter().filter(|(step, _)| *step <= pass.encounter.step);
        let farthest = before.map(|(_, position)| distance(*position)).fold(4.0 * CONTACT_DISTANCE, f64::max);
        let middle = (corner.0 + 0.5 * side, corner.1 + 0.5 * side);
        Self { corner, side, middle, scale: REACH * side / farthest, path }
    }

    /// Point of a position relative to the satellite.
    fn point(&self, [x, y]: [f64; 2]) -> Point {
        (self.middle.0 + self.scale * x, self.middle.1 - self.scale * y)
    }

    /// Point of the debris after a step; `None` if it is not shown.
    fn point_after(&self, step: u32) -> Option<Point> {
        let (_, position) = self.path.iter().find(|(shown, _)| *shown == step)?;
        Some(self.point(*position))
    }

    /// Point at a distance on the page from the middle, in a direction in degrees clockwise from up.
    fn polar(&self, direction_deg: f64, length: f64) -> Point {
        let (sin, cos) = libm::sincos(direction_deg.to_radians());
        (self.middle.0 + length * sin, self.middle.1 - length * cos)
    }
}

/// Draws the encounter with an index into a square, with its caption below.
pub(super) fn draw(canvas: &mut SvgCanvas, scene: &Scene, index: usize, corner: Point, side: f64) {
    let Some(pass) = scene.passes.get(index) else { return };
    let view = InsetView::new(scene, pass, corner, side);
    canvas.panel(corner, (side, side), SPACE_COLOUR);
    canvas.begin_clip(&format!("inset{index}"), corner, (side, side));
    draw_compass(canvas, &view);
    draw_aim_sector(canvas, scene, pass, &view);
    let colour = kind_colour(pass.encounter.kind);
    let contact = Stroke::new(TEXT, 0.8).opacity(0.7);
    canvas.circle(view.middle, view.scale * CONTACT_DISTANCE, CONTACT_FILL, Some(contact));
    let line: Vec<_> = view.path.iter().map(|(_, position)| view.point(*position)).collect();
    let dashes = if pass.encounter.is_rogue { "5 3" } else { "" };
    canvas.line(&line, Stroke::new(colour, 1.8).dashes(dashes));
    canvas.dots(&line, Stroke::new(colour, 4.4));
    if let Some(nearest) = view.point_after(pass.encounter.step) {
        canvas.line(&[view.middle, nearest], Stroke::new(TEXT, 1.2));
    }
    draw_bearing(canvas, pass, &view);
    let satellite_colour = SATELLITE_COLOURS[pass.satellite() % SATELLITE_COLOURS.len()];
    canvas.circle(view.middle, 2.6, satellite_colour, None);
    draw_scale_bar(canvas, &view);
    canvas.end_clip();
    draw_caption(canvas, pass, index, (corner.0, corner.1 + side));
}

/// Returns the position of a body relative to a satellite, in LU: in-track and radial out.
fn relative_position(satellite: &Body, body: &Body) -> [f64; 2] {
    let ((rx, ry), (tx, ty)) = satellite.local_axes();
    let (dx, dy) = (body.x - satellite.x, body.y - satellite.y);
    [dx * tx + dy * ty, dx * rx + dy * ry]
}

/// Draws axes, and the names of the directions at the edges.
fn draw_compass(canvas: &mut SvgCanvas, view: &InsetView) {
    let InsetView { corner, side, middle, .. } = *view;
    let thin = Stroke::new(GRID, 1.0);
    let reach = REACH * side;
    canvas.line(&[(middle.0, middle.1 - reach), (middle.0, middle.1 + reach)], thin);
    canvas.line(&[(middle.0 - reach, middle.1), (middle.0 + reach, middle.1)], thin);
    canvas.circle(middle, reach, "none", Some(thin));
    let style = TextStyle::new(9.0).colour(DIM).anchor(TextAnchor::Middle);
    canvas.text((middle.0, corner.1 + 20.0), style, "out, 0°");
    canvas.text((middle.0, corner.1 + side - 14.0), style, "Earth, 180°");
    for (x, name, angle) in [(side - 18.0, "ahead", "90°"), (18.0, "behind", "270°")] {
        canvas.text((corner.0 + x, middle.1 - 2.0), style, name);
        canvas.text((corner.0 + x, middle.1 + 10.0), style, angle);
    }
}

/// Draws the sector of the aimed bearing.
fn draw_aim_sector(canvas: &mut SvgCanvas, scene: &Scene, pass: &Pass, view: &InsetView) {
    let Some(design) = &scene.design else { return };
    let Some(bearing_deg) = design.aim.bearing_deg else { return };
    let satellite = scene.coast.satellite(pass.satellite(), pass.bearing_step);
    let direction = compass_direction(design.frame, satellite, f64::from(bearing_deg));
    let mut outline = vec![view.middle];
    outline.extend((0..=10).map(|part| {
        view.polar(direction + AIM_TOLERANCE_DEG * (f64::from(part) / 5.0 - 1.0), REACH * view.side)
    }));
    canvas.area(&outline, AIM_COLOUR, 0.14, None);
}

/// Returns the direction of a bearing in an inset, in degrees clockwise from up.
fn compass_direction(frame: BearingFrame, satellite: &Body, bearing_deg: f64) -> f64 {
    let (sin, cos) = libm::sincos(frame.direction_deg(satellite, bearing_deg).to_radians());
    BearingFrame::RadialInTrack.bearing_deg(satellite, [satellite.x + cos, satellite.y + sin])
}

/// Draws the line of sight at the step in which the bearing is measured.
fn draw_bearing(canvas: &mut SvgCanvas, pass: &Pass, view: &InsetView) {
    if let Some(point) = view.point_after(pass.bearing_step) {
        canvas.line(&[view.middle, point], Stroke::new(TEXT, 1.0).opacity(0.8).dashes("2 3"));
        canvas.circle(point, 4.2, "none", Some(Stroke::new(TEXT, 1.4)));
    }
}

fn draw_scale_bar(canvas: &mut SvgCanvas, view: &InsetView) {
    let fits = |length: &f64| length * view.scale < 0.3 * view.side;
    let length = SCALE_LENGTHS.into_iter().find(fits).unwrap_or(1.0);
    let (x, y) = (view.corner.0 + 8.0, view.corner.1 + view.side - 8.0);
    canvas.line(&[(x, y), (x + length * view.scale, y)], Stroke::new(TEXT, 1.2));
    canvas.text((x, y - 4.0), TextStyle::new(9.5), &format!("{} LU", format_number(length)));
}

fn draw_caption(canvas: &mut SvgCanvas, pass: &Pass, index: usize, (x, y): Point) {
    let encounter = &pass.encounter;
    let title = format!(
        "{index}: satellite {}, step {}, {}°",
        encounter.satellite, encounter.step, encounter.bearing_deg
    );
    canvas.text((x, y + 15.0), TextStyle::new(12.0).bold(), &title);
    let details = format!(
        "{}, {:.1} LU/TU, miss {:.1} LU",
        kind_text(encounter),
        SPEED.value(encounter.relative_speed),
        MISS.value(encounter.miss_distance)
    );
    canvas.text((x, y + 30.0), TextStyle::new(10.0).colour(kind_colour(encounter.kind)), &details);
}
