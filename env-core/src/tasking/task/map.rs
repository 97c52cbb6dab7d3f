//! The map of an episode, which views draw: stations and targets, and the motion of the last step.

use serde::Serialize;

use super::motion::{StepMotion, place};
use super::rounding::round;
use super::run::TaskRun;
use crate::scene::Point;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::vector3::norm;

/// Number of upcoming targets that a map shows for each satellite.
const UPCOMING: usize = 10;

/// The map of an episode: constant parts, and the motion of the last step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpisodeMap {
    /// Stations and targets, at the start of the episode only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<MapObjects>,
    /// Motion within the last step.
    pub motion: StepMotion,
    /// Numbers of the next targets of each satellite, by index of the action.
    pub upcoming: Vec<Vec<usize>>,
    /// The target of each satellite's last action, if that is to image one.
    pub tasked: Vec<Option<TaskedTarget>>,
    /// Images of the last step as pairs of satellite and target.
    pub imaged: Vec<[usize; 2]>,
    /// Pairs of satellites that shared data at the end of the last step.
    pub links: Vec<[usize; 2]>,
}

/// The target of an action, with its window.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TaskedTarget {
    /// Number of the target.
    pub target: usize,
    /// Time at which its window opens, s.
    pub open_s: f64,
    /// Time at which its window closes, s.
    pub close_s: f64,
}

/// Stations and targets of an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapObjects {
    /// Ground stations of the episode.
    pub stations: Vec<StationMark>,
    /// Longitudes of the targets, degrees.
    pub target_longitudes: Vec<f64>,
    /// Latitudes of the targets, degrees.
    pub target_latitudes: Vec<f64>,
    /// Priorities of the targets.
    pub target_priorities: Vec<f64>,
}

/// A ground station on the map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StationMark {
    /// Name of the station.
    pub name: String,
    /// Longitude of the station, degrees.
    pub longitude: f64,
    /// Latitude of the station, degrees.
    pub latitude: f64,
    /// Radius of the circle within which the first satellite can be reached, degrees of arc.
    pub radius: f64,
}

impl EpisodeMap {
    /// The map after a step, or at the start.
    pub(super) fn new(run: &TaskRun, motion: StepMotion) -> Self {
        let sim = &run.sim;
        let upcoming = |agent: usize| {
            let windows = sim.opportunities(agent).upcoming(OpportunityKind::Target, sim.time_s());
            let known = sim.known_images(agent);
            let open = windows.iter().filter(|window| !known.contains(window.object));
            open.take(UPCOMING).map(|window| window.object).collect()
        };
        Self {
            objects: (sim.steps() == 0).then(|| MapObjects::new(sim)),
            motion,
            upcoming: (0..sim.len()).map(upcoming).collect(),
            tasked: (0..sim.len()).map(|agent| tasked_target(sim, agent)).collect(),
            imaged: run.last_step().imaged.clone(),
            links: run.last_step().links.clone(),
        }
    }
}

impl MapObjects {
    pub(super) fn new(sim: &TaskingSim) -> Self {
        let orbit_radius = norm(&sim.satellite(0).state.position);
        let stations = sim.stations().iter().map(|station| {
            let (longitude, latitude) = place(&station.position);
            let elevation = station.min_elevation_rad;
            let nearest = libm::acos((EARTH_RADIUS_M / orbit_radius * libm::cos(elevation)).clamp(-1.0, 1.0));
            let radius = round((nearest - elevation).to_degrees(), 2);
            StationMark { name: station.name.clone(), longitude, latitude, radius }
        });
        let places: Vec<Point> = sim.targets().iter().map(|target| place(&target.position)).collect();
        Self {
            stations: stations.collect(),
            target_longitudes: places.iter().map(|place| place.0).collect(),
            target_latitudes: places.iter().map(|place| place.1).collect(),
            target_priorities: sim.targets().iter().map(|target| round(target.priority, 4)).collect(),
        }
    }
}

/// The target of a satellite's last action, with its next window, or else with its last one.
fn tasked_target(sim: &TaskingSim, agent: usize) -> Option<TaskedTarget> {
    let target = sim.tasked_target(agent)?;
    let all = sim.opportunities(agent).all();
    let of_target = |window: &&Opportunity| window.kind == OpportunityKind::Target && window.object == target;
    let window = all.iter().filter(of_target).find(|window| window.close_s >= sim.time_s());
    let window = window.or_else(|| all.iter().rfind(of_target))?;
    Some(TaskedTarget { target, open_s: round(window.open_s, 1), close_s: round(window.close_s, 1) })
}
