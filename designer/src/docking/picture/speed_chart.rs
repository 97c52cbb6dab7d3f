//! Chart of speeds against distances: the speed limit, each start, and the reference plan from there to the chief.

use env_core::docking::constants::DOCKING_RADIUS_M;
use env_core::docking::relative_motion::{RelativeState, distance, speed, speed_limit};

use super::plane_map::{BOUNDS_COLOUR, agent_colour};
use super::scene::DockingScene;
use super::{CHART_HEIGHT, MAP_SIDE};
use crate::picture_parts::{AIM_COLOUR, SPACE_COLOUR};
use crate::svg::{DIM, GRID, Point, Stroke, SvgCanvas, TextAnchor, TextStyle, format_number};

/// Space for the names of the axes, left of and below the curves.
const AXIS_SPACE: (f64, f64) = (44.0, 38.0);
/// Space above the curves, for the title, and to the right.
const FREE_SPACE: (f64, f64) = (14.0, 30.0);
/// Number of points of the speed limit.
const LIMIT_POINTS: u32 = 48;
/// Distances with a label, m.
const DISTANCE_LABELS: [f64; 10] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 300.0, 1000.0];

/// Axes of the chart: a logarithm of the distance to the right, the speed up.
struct Axes {
    /// Corner of the curves at the bottom left.
    origin: Point,
    size: Point,
    /// Largest distance in the chart, m.
    farthest: f64,
    /// Largest speed in the chart, m/s.
    fastest: f64,
}

impl Axes {
    fn fit(scene: &DockingScene, (left, top): Point) -> Self {
        let states =
            || scene.deputies.iter().flat_map(|deputy| deputy.reference.iter().chain([&deputy.start]));
        let farthest = 1.15 * scene.farthest();
        let fastest = states().map(speed).fold(speed_limit(farthest), f64::max);
        Self {
            origin: (left + AXIS_SPACE.0, top + CHART_HEIGHT - AXIS_SPACE.1),
            size: (MAP_SIDE - AXIS_SPACE.0 - FREE_SPACE.0, CHART_HEIGHT - AXIS_SPACE.1 - FREE_SPACE.1),
            farthest,
            fastest: 1.08 * fastest,
        }
    }

    fn point(&self, distance: f64, speed: f64) -> Point {
        let share = libm::log(distance.max(DOCKING_RADIUS_M) / DOCKING_RADIUS_M)
            / libm::log(self.farthest / DOCKING_RADIUS_M);
        (self.origin.0 + self.size.0 * share, self.origin.1 - self.size.1 * speed / self.fastest)
    }

    fn state(&self, state: &RelativeState) -> Point {
        self.point(distance(state), speed(state))
    }
}

/// Draws the chart into a rectangle with the given corner.
pub(super) fn draw(canvas: &mut SvgCanvas, scene: &DockingScene, corner: Point) {
    let axes = Axes::fit(scene, corner);
    canvas.panel(corner, (MAP_SIDE, CHART_HEIGHT), SPACE_COLOUR);
    draw_axes(canvas, &axes, corner);
    draw_limit(canvas, &axes);
    for (index, deputy) in scene.deputies.iter().enumerate() {
        let line: Vec<Point> = deputy.reference.iter().map(|state| axes.state(state)).collect();
        canvas.line(&line, Stroke::new(agent_colour(index), 1.8));
    }
    for (index, deputy) in scene.deputies.iter().enumerate() {
        let at = axes.state(&deputy.start);
        canvas.circle(at, 5.0, agent_colour(index), None);
        if scene.is_aimed(index) {
            canvas.circle(at, 9.0, "none", Some(Stroke::new(AIM_COLOUR, 1.4)));
        }
    }
}

/// Draws the curve of the speed limit, and the area above it.
fn draw_limit(canvas: &mut SvgCanvas, axes: &Axes) {
    let ratio = axes.farthest / DOCKING_RADIUS_M;
    let at = |part: u32| {
        let distance = DOCKING_RADIUS_M * libm::pow(ratio, f64::from(part) / f64::from(LIMIT_POINTS));
        axes.point(distance, speed_limit(distance))
    };
    let curve: Vec<Point> = (0..=LIMIT_POINTS).map(at).collect();
    let mut above = curve.clone();
    let top = axes.origin.1 - axes.size.1;
    above.extend([(axes.origin.0 + axes.size.0, top), (axes.origin.0, top)]);
    canvas.area(&above, BOUNDS_COLOUR, 0.08, None);
    canvas.line(&curve, Stroke::new(BOUNDS_COLOUR, 1.6));
}

/// Draws the grid with its numbers, and the names of the axes.
fn draw_axes(canvas: &mut SvgCanvas, axes: &Axes, corner: Point) {
    let style = TextStyle::new(10.0).colour(DIM);
    let thin = Stroke::new(GRID, 1.0).opacity(0.7);
    let (left, bottom) = axes.origin;
    let (right, top) = (left + axes.size.0, bottom - axes.size.1);
    for distance in DISTANCE_LABELS.into_iter().filter(|distance| *distance <= axes.farthest) {
        let (x, _) = axes.point(distance, 0.0);
        canvas.line(&[(x, top), (x, bottom)], thin);
        canvas.text((x, bottom + 14.0), style.anchor(TextAnchor::Middle), &format_number(distance));
    }
    let step = speed_step(axes.fastest);
    let mut speed = 0.0;
    while speed <= axes.fastest {
        let (_, y) = axes.point(DOCKING_RADIUS_M, speed);
        canvas.line(&[(left, y), (right, y)], thin);
        canvas.text((left - 6.0, y + 3.5), style.anchor(TextAnchor::End), &format_number(speed));
        speed += step;
    }
    canvas.text((corner.0 + 10.0, corner.1 + 18.0), TextStyle::new(12.0).bold(), "Speed, m/s");
    let name = (right, bottom + 30.0);
    canvas.text(name, style.anchor(TextAnchor::End), "distance from the chief, m (logarithmic)");
}

/// Returns a round speed in m/s of which at most six fit into the fastest one.
fn speed_step(fastest: f64) -> f64 {
    let mut step = 0.05;
    for ratio in [2.0, 2.5, 2.0].iter().cycle() {
        if step * 6.0 >= fastest {
            break;
        }
        step *= ratio;
    }
    step
}
