//! Scene of an episode: a map of longitude and latitude with satellites, stations and upcoming targets.

use super::coastline::COASTLINE;
use super::motion::place;
use super::run::TaskRun;
use crate::scene::{Point, Primitive, Scene, Style, View};
use crate::tasking::access::OpportunityKind;

/// Largest longitude of the map, degrees.
const HALF_WIDTH_DEG: f64 = 180.0;
/// Radius of a target's mark, degrees.
const TARGET_DEG: f64 = 1.5;
/// Radius of a station's mark, degrees.
const STATION_DEG: f64 = 5.0;
/// Number of drawn targets of each satellite.
const TARGETS: usize = 10;

/// Builds the scene of a moment.
pub(super) fn build_scene(run: &TaskRun) -> Scene {
    let sim = &run.sim;
    let mut primitives: Vec<_> = COASTLINE.iter().map(|line| path(line.clone())).collect();
    primitives.extend([
        path(vec![(-HALF_WIDTH_DEG, 0.0), (HALF_WIDTH_DEG, 0.0)]),
        path(vec![
            (-HALF_WIDTH_DEG, -90.0),
            (HALF_WIDTH_DEG, -90.0),
            (HALF_WIDTH_DEG, 90.0),
            (-HALF_WIDTH_DEG, 90.0),
            (-HALF_WIDTH_DEG, -90.0),
        ]),
    ]);
    for station in sim.stations() {
        primitives.push(Primitive::Ring {
            at: place(&station.position),
            radius: STATION_DEG,
            style: Style::Guide,
        });
    }
    for agent in 0..sim.len() {
        let upcoming = sim.opportunities(agent).upcoming(OpportunityKind::Target, sim.time_s());
        for window in upcoming.iter().take(TARGETS) {
            let at = place(&sim.targets()[window.object].position);
            primitives.push(Primitive::Disc { at, radius: TARGET_DEG, style: Style::Target });
        }
    }
    for agent in 0..sim.len() {
        let style = if run.is_dead(agent) { Style::Lost } else { Style::Agent(agent as u32) };
        let at = place(&sim.planet_position(agent));
        primitives.push(Primitive::Marker { id: agent as u64, at, style });
    }
    let view = View {
        title: "longitude across, latitude up",
        center: (0.0, 0.0),
        half_extent: HALF_WIDTH_DEG,
        primitives,
    };
    Scene { views: vec![view], status_lines: status_lines(run), alerts: run.alerts() }
}

fn path(points: Vec<Point>) -> Primitive {
    Primitive::Path { points, style: Style::Guide }
}

fn status_lines(run: &TaskRun) -> Vec<String> {
    let sim = &run.sim;
    let head =
        format!("{:.0} s of {:.0}, score {:.3}", sim.time_s(), sim.time_limit_s(), run.outcome().score);
    let satellite = |agent: usize| {
        if run.is_dead(agent) {
            return format!("{agent}: dead");
        }
        let satellite = sim.satellite(agent);
        let share = satellite.battery_ws() / satellite.spec().args.battery_capacity_ws;
        format!("{agent}: battery {:.0} %", 100.0 * share)
    };
    std::iter::once(head).chain((0..sim.len()).map(satellite)).collect()
}
