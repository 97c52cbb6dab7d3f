//! Map of one plane of Hill's frame: the chief, starts with their velocities, coasting paths and the reference plan.

use env_core::docking::constants::{DOCKING_RADIUS_M, MAX_DISTANCE_M};
use env_core::docking::relative_motion::{RelativeState, speed};

use super::MAP_SIDE;
use super::scene::{DeputyTracks, DockingScene};
use crate::angles::angle_between;
use crate::docking::aim::{AIM_TOLERANCE_DEG, MatchingDeputy};
use crate::docking::vocabulary::BEARING;
use crate::label_placer::LabelPlacer;
use crate::picture_parts::{AGENT_COLOURS, AIM_COLOUR, SPACE_COLOUR};
use crate::svg::{Arrow, DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle, format_number};

/// Plane of a map, by the indices of its axes in a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Id of the map in the document.
    id: &'static str,
    title: &'static str,
    /// Name of the upper direction.
    up_name: &'static str,
    across: usize,
    up: usize,
}

/// Planes of the two maps. Both have in-track to the right, so that a place has one horizontal position.
pub(super) const PLANES: [Plane; 2] = [
    Plane {
        id: "in-plane", title: "In the plane of the orbit", up_name: "radial out, 0°", across: 1, up: 0
    },
    Plane { id: "out-of-plane", title: "Out of the plane", up_name: "cross-track", across: 1, up: 2 },
];

/// Colour of the chief and of the docking radius.
pub(super) const CHIEF_COLOUR: &str = "#ffffff";
/// Colour of the bounds of the episode.
pub(super) const BOUNDS_COLOUR: &str = "#ff7b72";
/// Smallest radius on the page at which the docking radius is visible.
const MIN_DOCKING_RADIUS: f64 = 4.0;
/// Length of the arrow of the fastest start.
const LONGEST_ARROW: f64 = 70.0;
/// Length of the shortest arrow that is drawn.
const SHORTEST_ARROW: f64 = 4.0;
/// Length of the sector of the aimed bearing.
const AIM_SECTOR_LENGTH: f64 = 90.0;
/// Size of the number of a deputy.
const LABEL_SIZE: Point = (9.0, 13.0);
/// Free space at the edges of a map.
const EDGE: f64 = 44.0;

/// Projection from metres to the page.
struct PlaneProjection {
    corner: Point,
    middle: Point,
    plane: Plane,
    /// Units of the page per metre.
    scale: f64,
    /// Units of the page per m/s.
    arrow_scale: f64,
}

impl PlaneProjection {
    /// Fits the largest distance of the scene around the chief. Both maps have one scale.
    fn fit(scene: &DockingScene, plane: Plane, corner: Point) -> Self {
        let fastest = scene.deputies.iter().map(|deputy| speed(&deputy.start)).fold(1e-9, f64::max);
        Self {
            corner,
            middle: (corner.0 + 0.5 * MAP_SIDE, corner.1 + 0.5 * MAP_SIDE),
            plane,
            scale: (0.5 * MAP_SIDE - EDGE) / scene.farthest(),
            arrow_scale: LONGEST_ARROW / fastest,
        }
    }

    fn point(&self, state: &RelativeState) -> Point {
        let (across, up) = (state[self.plane.across], state[self.plane.up]);
        (self.middle.0 + self.scale * across, self.middle.1 - self.scale * up)
    }

    fn points(&self, states: &[RelativeState]) -> Vec<Point> {
        // Points far outside the map would only make the document longer.
        let near = |point: &Point| {
            (point.0 - self.middle.0).abs() < 2.0 * MAP_SIDE
                && (point.1 - self.middle.1).abs() < 2.0 * MAP_SIDE
        };
        states.iter().map(|state| self.point(state)).take_while(near).collect()
    }
}

/// Draws the map of a plane into a square with the given corner.
pub(super) fn draw(canvas: &mut SvgCanvas, scene: &DockingScene, plane: Plane, corner: Point) {
    let map = PlaneProjection::fit(scene, plane, corner);
    canvas.panel(corner, (MAP_SIDE, MAP_SIDE), SPACE_COLOUR);
    canvas.begin_clip(plane.id, corner, (MAP_SIDE, MAP_SIDE));
    draw_ground(canvas, scene, &map);
    if plane.up == 0 {
        draw_aim_sector(canvas, scene, &map);
    }
    for (index, deputy) in scene.deputies.iter().enumerate() {
        draw_tracks(canvas, deputy, agent_colour(index), &map);
    }
    let mut labels = LabelPlacer::new(corner, (MAP_SIDE, MAP_SIDE));
    scene.deputies.iter().for_each(|deputy| labels.avoid(map.point(&deputy.start), 9.0));
    for (index, deputy) in scene.deputies.iter().enumerate() {
        draw_start(canvas, deputy, index, scene.is_aimed(index), &map);
        draw_number(canvas, deputy, index, &mut labels, &map);
    }
    draw_chief(canvas, &map);
    canvas.end_clip();
    let title = (corner.0 + 10.0, corner.1 + MAP_SIDE - 10.0);
    canvas.text(title, TextStyle::new(12.0).bold(), plane.title);
}

/// Returns the colour of a deputy.
pub(super) fn agent_colour(index: usize) -> &'static str {
    AGENT_COLOURS[index % AGENT_COLOURS.len()]
}

/// Draws axes with their names, rings at round distances, and the bounds if they are near.
fn draw_ground(canvas: &mut SvgCanvas, scene: &DockingScene, map: &PlaneProjection) {
    let PlaneProjection { corner, middle, .. } = *map;
    let thin = Stroke::new(GRID, 1.0).opacity(0.7);
    canvas.line(&[(corner.0, middle.1), (corner.0 + MAP_SIDE, middle.1)], thin);
    canvas.line(&[(middle.0, corner.1), (middle.0, corner.1 + MAP_SIDE)], thin);
    let style = TextStyle::new(10.0).colour(DIM);
    let step = ring_step(scene.farthest());
    for ring in [step, 2.0 * step, 3.0 * step] {
        let radius = ring * map.scale;
        if radius > 0.5 * MAP_SIDE {
            continue;
        }
        canvas.circle(middle, radius, "none", Some(thin));
        let label = format!("{} m", format_number(ring));
        canvas.text((middle.0 + 0.707 * radius + 2.0, middle.1 + 0.707 * radius + 9.0), style, &label);
    }
    canvas.circle(
        middle,
        MAX_DISTANCE_M * map.scale,
        "none",
        Some(Stroke::new(BOUNDS_COLOUR, 1.4).dashes("6 4")),
    );
    canvas.text((middle.0 + 6.0, corner.1 + 14.0), style, map.plane.up_name);
    let right = (corner.0 + MAP_SIDE - 8.0, middle.1 - 5.0);
    canvas.text(right, style.anchor(TextAnchor::End), "in-track, 90°");
}

/// Returns a round distance in m of which two to four fit into the farthest one.
fn ring_step(farthest: f64) -> f64 {
    let mut step = 0.5;
    for ratio in [2.0, 2.0, 2.5].iter().cycle() {
        if step * 2.5 >= farthest {
            break;
        }
        step *= ratio;
    }
    step
}

/// Draws the sector of the aimed bearing, from the deputy that matches it best.
fn draw_aim_sector(canvas: &mut SvgCanvas, scene: &DockingScene, map: &PlaneProjection) {
    let Some(aimed) = scene.design.as_ref().and_then(|design| design.aim.bearing_deg) else { return };
    let aimed_deg = BEARING.value(aimed);
    let difference = |deputy: &&MatchingDeputy| angle_between(aimed_deg, deputy.bearing_deg);
    let nearest = scene.aimed.iter().min_by(|a, b| difference(a).total_cmp(&difference(b)));
    let Some(deputy) = nearest.and_then(|nearest| scene.deputies.get(nearest.index)) else { return };
    let from = map.point(&deputy.start);
    let mut outline = vec![from];
    outline.extend((0..=10).map(|part| {
        let angle = aimed_deg + AIM_TOLERANCE_DEG * (f64::from(part) / 5.0 - 1.0);
        let (sin, cos) = libm::sincos(angle.to_radians());
        (from.0 + AIM_SECTOR_LENGTH * sin, from.1 - AIM_SECTOR_LENGTH * cos)
    }));
    canvas.area(&outline, AIM_COLOUR, 0.2, None);
}

/// Draws the path of the reference plan, and the coasting path.
fn draw_tracks(canvas: &mut SvgCanvas, deputy: &DeputyTracks, colour: &'static str, map: &PlaneProjection) {
    canvas.line(&map.points(&deputy.coast), Stroke::new(colour, 1.2).opacity(0.55).dashes("2 4"));
    canvas.line(&map.points(&deputy.reference), Stroke::new(colour, 1.8));
}

/// Draws the start of a deputy with its velocity. A ring marks a deputy that matches the aim.
fn draw_start(
    canvas: &mut SvgCanvas,
    deputy: &DeputyTracks,
    index: usize,
    is_aimed: bool,
    map: &PlaneProjection,
) {
    let (at, colour) = (map.point(&deputy.start), agent_colour(index));
    let across = map.arrow_scale * deputy.start[3 + map.plane.across];
    let up = map.arrow_scale * deputy.start[3 + map.plane.up];
    if (across * across + up * up).sqrt() > SHORTEST_ARROW {
        let arrow = Arrow { from: at, to: (at.0 + across, at.1 - up) };
        canvas.arrow(arrow, 7.0, Stroke::new(TEXT, 1.6));
    }
    canvas.circle(at, 5.0, colour, None);
    if is_aimed {
        canvas.circle(at, 9.0, "none", Some(Stroke::new(AIM_COLOUR, 1.4)));
    }
}

/// Draws the number of a deputy beside its start, where there is room.
fn draw_number(
    canvas: &mut SvgCanvas,
    deputy: &DeputyTracks,
    index: usize,
    labels: &mut LabelPlacer,
    map: &PlaneProjection,
) {
    let (left, top) = labels.place(map.point(&deputy.start), LABEL_SIZE);
    let style = TextStyle::new(12.0).bold().colour(agent_colour(index)).anchor(TextAnchor::Middle);
    canvas.text((left + 0.5 * LABEL_SIZE.0, top + 0.8 * LABEL_SIZE.1), style, &index.to_string());
}

/// Draws the chief with the docking radius, which is enlarged where it would be invisible.
fn draw_chief(canvas: &mut SvgCanvas, map: &PlaneProjection) {
    let radius = (DOCKING_RADIUS_M * map.scale).max(MIN_DOCKING_RADIUS);
    canvas.circle(map.middle, radius, "none", Some(Stroke::new(CHIEF_COLOUR, 1.2)));
    canvas.dots(&[map.middle], Stroke::new(CHIEF_COLOUR, 3.0));
}
