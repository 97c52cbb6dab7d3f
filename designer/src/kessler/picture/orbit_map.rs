//! Map of a layout: the Earth, orbits, the reference plan, and debris on its way to its encounters.

use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::Body;

use super::scene::{Burn, Pass, Scene};
use super::style::{BURN_COLOUR, SATELLITE_COLOURS, draw_star, kind_colour};
use crate::kessler::aim::AIM_TOLERANCE_DEG;
use crate::kessler::design::Design;
use crate::label_placer::LabelPlacer;
use crate::picture_parts::{AIM_COLOUR, SPACE_COLOUR};
use crate::svg::{
    Arrow, BACKGROUND, DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle, format_number,
};

/// Number of steps before an encounter in which the path of its debris is drawn boldly.
const BOLD_STEPS: u32 = 6;
/// Number of burns above which they are drawn smaller, so that they do not cover the orbits.
const MANY_BURNS: usize = 40;
/// Length of the sector of the aimed bearing, in LU.
const AIM_SECTOR_LENGTH: f64 = 30.0;
/// Lengths of the scale bar, in LU; the longest that fits is used.
const SCALE_LENGTHS: [f64; 4] = [50.0, 20.0, 10.0, 5.0];
const EARTH_FILL: &str = "#16304f";
const EARTH_RIM: &str = "#5b8fd0";
const LABEL_FILL: &str = "#1b2430";

/// Projection from LU to the page. Everything that is drawn fits into the window.
struct Projection {
    corner: Point,
    size: Point,
    /// Middle of the window, in LU.
    middle: (f64, f64),
    /// Units of the page per LU.
    scale: f64,
}

impl Projection {
    fn fit(scene: &Scene, corner: Point, size: Point) -> Self {
        let coasting =
            (0..SATELLITES).flat_map(|s| (0..=HORIZON).map(move |step| scene.coast.satellite(s, step)));
        let reference = scene.reference.paths.iter().flatten();
        let passing = scene.passes.iter().flat_map(|pass| pass.path.iter());
        let mut low = (-EARTH_RADIUS, -EARTH_RADIUS);
        let mut high = (EARTH_RADIUS, EARTH_RADIUS);
        for body in coasting.chain(reference).chain(passing) {
            low = (low.0.min(body.x), low.1.min(body.y));
            high = (high.0.max(body.x), high.1.max(body.y));
        }
        let span = (high.0 - low.0 + 16.0, high.1 - low.1 + 16.0);
        let scale = (size.0 / span.0).min(size.1 / span.1);
        Self { corner, size, middle: (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1)), scale }
    }

    fn point(&self, x: f64, y: f64) -> Point {
        let across = self.corner.0 + 0.5 * self.size.0 + self.scale * (x - self.middle.0);
        (across, self.corner.1 + 0.5 * self.size.1 - self.scale * (y - self.middle.1))
    }

    fn body(&self, body: &Body) -> Point {
        self.point(body.x, body.y)
    }

    fn is_inside(&self, body: &Body) -> bool {
        let (x, y) = self.body(body);
        (self.corner.0..=self.corner.0 + self.size.0).contains(&x)
            && (self.corner.1..=self.corner.1 + self.size.1).contains(&y)
    }
}

/// Draws the map into a rectangle.
pub(super) fn draw(canvas: &mut SvgCanvas, scene: &Scene, corner: Point, size: Point) {
    let map = Projection::fit(scene, corner, size);
    canvas.panel(corner, size, SPACE_COLOUR);
    canvas.begin_clip("sky", corner, size);
    draw_ground(canvas, scene, &map);
    if let Some((design, (aim, pass))) = scene.design.as_ref().zip(scene.aimed_pass())
        && let Some(bearing_deg) = aim.bearing_deg
    {
        draw_aim_sector(canvas, scene, &map, design, f64::from(bearing_deg), pass);
    }
    scene.passes.iter().for_each(|pass| draw_approach(canvas, &map, pass));
    draw_orbits(canvas, scene, &map);
    draw_burns(canvas, scene, &map);
    draw_starts(canvas, scene, &map);
    draw_encounters(canvas, scene, &map);
    draw_scale_bar(canvas, &map);
    canvas.end_clip();
}

/// Draws the Earth, circles of known radii, the target radius, and background debris.
fn draw_ground(canvas: &mut SvgCanvas, scene: &Scene, map: &Projection) {
    let centre = map.point(0.0, 0.0);
    for radius in [50.0, 100.0, 150.0] {
        canvas.circle(centre, radius * map.scale, "none", Some(Stroke::new(GRID, 1.0).opacity(0.6)));
    }
    let target_radius = scene.reference.target_radius;
    if target_radius > 0.0 {
        let stroke = Stroke::new(TEXT, 1.2).opacity(0.6).dashes("1 5");
        canvas.circle(centre, target_radius * map.scale, "none", Some(stroke));
    }
    let dots: Vec<_> =
        scene.background.iter().filter(|body| map.is_inside(body)).map(|body| map.body(body)).collect();
    canvas.dots(&dots, Stroke::new(DIM, 2.4).opacity(0.55));
    canvas.circle(centre, EARTH_RADIUS * map.scale, EARTH_FILL, Some(Stroke::new(EARTH_RIM, 1.5)));
    let style = TextStyle::new(12.0).anchor(TextAnchor::Middle).colour(EARTH_RIM);
    canvas.text((centre.0, centre.1 + 4.0), style, "Earth");
}

/// Draws the sector from which the aimed debris comes, seen from the satellite when the bearing is measured.
fn draw_aim_sector(
    canvas: &mut SvgCanvas,
    scene: &Scene,
    map: &Projection,
    design: &Design,
    bearing_deg: f64,
    pass: &Pass,
) {
    let satellite = scene.coast.satellite(pass.satellite(), pass.bearing_step);
    let direction = design.frame.direction_deg(satellite, bearing_deg);
    let mut outline = vec![map.body(satellite)];
    for part in 0..=10 {
        let angle = direction + AIM_TOLERANCE_DEG * (f64::from(part) / 5.0 - 1.0);
        let (sin, cos) = libm::sincos(angle.to_radians());
        outline.push(map.point(satellite.x + AIM_SECTOR_LENGTH * cos, satellite.y + AIM_SECTOR_LENGTH * sin));
    }
    canvas.area(&outline, AIM_COLOUR, 0.16, Some(Stroke::new(AIM_COLOUR, 1.0).opacity(0.7)));
}

/// Draws the path of debris: faint from its start, bold in the last steps, with a star where a rogue appears.
fn draw_approach(canvas: &mut SvgCanvas, map: &Projection, pass: &Pass) {
    let colour = kind_colour(pass.encounter.kind);
    let dashes = if pass.encounter.is_rogue { "5 3" } else { "" };
    let end = pass.encounter.step;
    let bold_from = end.saturating_sub(BOLD_STEPS);
    let part = |from: u32, to: u32| -> Vec<Point> {
        let steps = pass.steps().filter(|(step, _)| (from..=to).contains(step));
        steps.map(|(_, body)| map.body(body)).collect()
    };
    canvas.line(&part(0, bold_from), Stroke::new(colour, 0.9).opacity(0.3));
    canvas.line(&part(bold_from, end), Stroke::new(colour, 2.0).dashes(dashes));
    canvas.line(&part(end, u32::MAX), Stroke::new(colour, 1.2).opacity(0.5));
    if let Some(start) = pass.path.first().map(|body| map.body(body)) {
        if pass.encounter.is_rogue {
            draw_star(canvas, start, colour);
        } else {
            canvas.circle(start, 2.2, colour, None);
        }
    }
    // A head halfway along the bold part shows the direction.
    let middle = end.saturating_sub(BOLD_STEPS / 2).max(pass.first_step + 1);
    if let Some((before, then)) = pass.at(middle - 1).zip(pass.at(middle)) {
        draw_head(canvas, map.body(before), map.body(then), colour);
    }
}

fn draw_head(canvas: &mut SvgCanvas, from: Point, to: Point, colour: &'static str) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = (dx * dx + dy * dy).sqrt().max(1e-6);
    let tip = (to.0 + 4.0 * dx / length, to.1 + 4.0 * dy / length);
    let tail = (tip.0 - 8.0 * dx / length, tip.1 - 8.0 * dy / length);
    canvas.arrow(Arrow { from: tail, to: tip }, 7.0, Stroke::new(colour, 1.0));
}

/// Draws the paths of holding satellites (solid, faint after a loss) and those of the reference plan (dashed).
fn draw_orbits(canvas: &mut SvgCanvas, scene: &Scene, map: &Projection) {
    for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
        let end = scene.lost[satellite].unwrap_or(HORIZON);
        let path = |from: u32, to: u32| -> Vec<_> {
            (from..=to).map(|step| map.body(scene.coast.satellite(satellite, step))).collect()
        };
        canvas.line(&path(end, HORIZON), Stroke::new(colour, 1.2).opacity(0.25));
        canvas.line(&path(0, end), Stroke::new(colour, 2.2));
        let reference: Vec<_> = scene.reference.paths[satellite].iter().map(|body| map.body(body)).collect();
        canvas.line(&reference, Stroke::new(colour, 1.6).dashes("3 4"));
    }
}

/// Draws the start of each satellite with its index.
fn draw_starts(canvas: &mut SvgCanvas, scene: &Scene, map: &Projection) {
    for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
        let start = map.body(scene.coast.satellite(satellite, 0));
        canvas.circle(start, 8.0, colour, None);
        let style = TextStyle::new(11.0).anchor(TextAnchor::Middle).bold().colour(BACKGROUND);
        canvas.text((start.0, start.1 + 4.0), style, &satellite.to_string());
    }
}

/// Draws the burns of the reference plan, longer for larger ones.
fn draw_burns(canvas: &mut SvgCanvas, scene: &Scene, map: &Projection) {
    let burns = &scene.reference.burns;
    let (base_length, head, width) =
        if burns.len() > MANY_BURNS { (9.0, 4.0, 0.9) } else { (16.0, 6.0, 1.6) };
    let arrow = |burn: &Burn| {
        let (dx, dy) = burn.delta_v;
        let size = (dx * dx + dy * dy).sqrt();
        let length = base_length * (1.0 + 1.5 * size.min(1.0));
        let from = map.body(&burn.satellite);
        let to = (from.0 + length * dx / size, from.1 - length * dy / size);
        (size > 0.0).then_some(Arrow { from, to })
    };
    let arrows: Vec<_> = burns.iter().filter_map(arrow).collect();
    canvas.arrows(&arrows, head, Stroke::new(BURN_COLOUR, width));
}

/// Draws a mark at each encounter, and a label with its index and step where there is room.
fn draw_encounters(canvas: &mut SvgCanvas, scene: &Scene, map: &Projection) {
    let point = |pass: &Pass| map.body(scene.coast.satellite(pass.satellite(), pass.encounter.step));
    let mut labels = LabelPlacer::new(map.corner, map.size);
    (0..SATELLITES).for_each(|satellite| labels.avoid(map.body(scene.coast.satellite(satellite, 0)), 10.0));
    scene.passes.iter().for_each(|pass| labels.avoid(point(pass), 5.0));
    for pass in &scene.passes {
        for (_, body) in pass.steps().filter(|(step, _)| step + BOLD_STEPS >= pass.encounter.step) {
            labels.avoid(map.body(body), 1.5);
        }
    }
    for (index, pass) in scene.passes.iter().enumerate() {
        let (point, colour) = (point(pass), kind_colour(pass.encounter.kind));
        let text = format!("{index}: step {}", pass.encounter.step);
        let size = (12.0 + 6.2 * text.chars().count() as f64, 16.0);
        let corner = labels.place(point, size);
        let middle = (corner.0 + 0.5 * size.0, corner.1 + 0.5 * size.1);
        canvas.line(&[point, middle], Stroke::new(colour, 0.9).opacity(0.8));
        canvas.circle(point, 4.0, BACKGROUND, Some(Stroke::new(colour, 2.0)));
        canvas.panel(corner, size, LABEL_FILL);
        let style = TextStyle::new(11.0).anchor(TextAnchor::Middle).colour(colour);
        canvas.text((middle.0, corner.1 + 12.0), style, &text);
    }
}

/// Draws the scale bar, and the axes of inertial bearings.
fn draw_scale_bar(canvas: &mut SvgCanvas, map: &Projection) {
    let fits = |length: &f64| length * map.scale < 0.3 * map.size.0;
    let length = SCALE_LENGTHS.into_iter().find(fits).unwrap_or(5.0);
    let (x, y) = (map.corner.0 + 16.0, map.corner.1 + map.size.1 - 16.0);
    let end = x + length * map.scale;
    canvas.line(&[(x, y - 4.0), (x, y), (end, y), (end, y - 4.0)], Stroke::new(TEXT, 1.2));
    canvas.text((end + 6.0, y), TextStyle::new(11.0), &format!("{} LU", format_number(length)));
    let origin = (map.corner.0 + map.size.0 - 52.0, map.corner.1 + map.size.1 - 18.0);
    let (x, y) = origin;
    canvas.arrow(Arrow { from: origin, to: (x + 24.0, y) }, 5.0, Stroke::new(DIM, 1.0));
    canvas.arrow(Arrow { from: origin, to: (x, y - 24.0) }, 5.0, Stroke::new(DIM, 1.0));
    canvas.text((x + 27.0, y + 4.0), TextStyle::new(10.0).colour(DIM), "+X");
    canvas.text((x - 6.0, y - 28.0), TextStyle::new(10.0).colour(DIM), "+Y");
}
