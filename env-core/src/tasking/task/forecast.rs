//! The sky of an episode before its first action, for designers and pictures: paths, shadow, passes and windows.

use super::critique::orbit_angle_deg;
use super::layout::{TargetPlace, TaskingLayout};
use super::map::{MapObjects, StationMark};
use super::motion::place;
use super::planner::SlewTime;
use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::error::ScenarioError;
use crate::scene::Point;
use crate::task::Scenario;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::satellite::eclipse::illumination;
use crate::tasking::setup::SatelliteArgs;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::vector3::{Vector3, norm, rotate, scale, sub};

/// Time between two points of a track, s.
pub const TRACK_STEP_S: f64 = 30.0;
/// Joules of a watt-hour.
const J_PER_WH: f64 = 3600.0;
/// Share of the Sun below which a satellite counts as in the shadow.
const DARK: f64 = 0.5;

/// The sky of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskingForecast {
    /// Time limit of the episode, s.
    pub time_limit_s: f64,
    /// Paths and windows of each satellite.
    pub satellites: Vec<SatelliteForecast>,
    /// Ground stations in service.
    pub stations: Vec<StationMark>,
    /// All targets: the drawn ones, then those of the layout.
    pub targets: Vec<TargetPlace>,
    /// Number of drawn targets: the index of the layout's first one.
    pub drawn_targets: usize,
    /// Longitude and latitude of the point below the Sun at the start, degrees.
    pub sun: Point,
}

/// The sky of one satellite.
#[derive(Debug, Clone, PartialEq)]
pub struct SatelliteForecast {
    /// Resources at the start.
    pub resources: StartResources,
    /// Points of the path, [`TRACK_STEP_S`] apart, from the start to the time limit.
    pub track: Vec<TrackPoint>,
    /// Passes over ground stations in the order of their close.
    pub passes: Vec<Opportunity>,
    /// Windows of targets in the order of their close.
    pub windows: Vec<Opportunity>,
}

/// A point of a satellite's path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Time since the start, s.
    pub time_s: f64,
    /// Planet-fixed direction of the satellite, of length 1.
    pub direction: Vector3<f64>,
    /// Visible share of the Sun.
    pub sunlight: f64,
    /// Angle along the orbit from local noon, degrees.
    pub orbit_angle_deg: f64,
}

/// Resources of a satellite at the start, and what its work takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartResources {
    /// Capacity of the battery, W·h.
    pub battery_wh: f64,
    /// Charge of the battery, W·h.
    pub charge_wh: f64,
    /// Power of the devices that are always on, W.
    pub idle_w: f64,
    /// Power of these devices and the instrument, W.
    pub work_w: f64,
    /// Power of a panel that faces the Sun, W.
    pub panel_w: f64,
    /// Capacity of the storage, bits.
    pub storage_bits: f64,
    /// Data in the storage, bits.
    pub stored_bits: f64,
    /// Data of a second of scanning, or of an image, bits.
    pub work_bits: f64,
    /// Speed of the fastest wheel as a share of the limit.
    pub wheel_share: f64,
    /// Time that an image takes at least, as the planner reckons it, s.
    pub image_s: f64,
}

impl TaskingForecast {
    /// Computes the sky of a scenario.
    ///
    /// # Errors
    /// Returns the error of a scenario that is invalid or cannot start.
    pub fn of_scenario(scenario: &Scenario) -> Result<Self, ScenarioError> {
        Self::of_setup(TaskSetup::read(scenario.recipe())?, scenario)
    }

    /// Computes the sky of a scenario with another layout, which may leave no target.
    ///
    /// # Errors
    /// Returns the error of a scenario that is invalid or cannot start.
    pub fn with_layout(scenario: &Scenario, layout: TaskingLayout) -> Result<Self, ScenarioError> {
        Self::of_setup(TaskSetup::read(scenario.recipe())?.with_layout(layout), scenario)
    }

    fn of_setup(setup: TaskSetup, scenario: &Scenario) -> Result<Self, ScenarioError> {
        let placed = setup.placed_targets();
        let run = TaskRun::start(setup, scenario.seed())?;
        let sim = &run.sim;
        let MapObjects { stations, target_longitudes, target_latitudes, .. } = MapObjects::new(sim);
        let places = target_longitudes.into_iter().zip(target_latitudes);
        let targets: Vec<TargetPlace> = places
            .zip(sim.targets())
            .map(|(place, target)| TargetPlace::at(place, target.priority))
            .collect();
        Ok(Self {
            time_limit_s: sim.time_limit_s(),
            satellites: (0..sim.len()).map(|index| SatelliteForecast::new(sim, index)).collect(),
            stations,
            drawn_targets: targets.len().saturating_sub(placed),
            targets,
            sun: place(&rotate(&sim.planet_from_inertial(), &sim.sun_position())),
        })
    }
}

impl SatelliteForecast {
    fn new(sim: &TaskingSim, index: usize) -> Self {
        let limit_s = sim.time_limit_s();
        let of_kind = |kind| {
            let all = sim.opportunities(index).upcoming(kind, 0.0).iter();
            all.filter(|window| window.open_s < limit_s).copied().collect()
        };
        let points = (limit_s / TRACK_STEP_S) as usize;
        Self {
            resources: StartResources::new(sim, index),
            track: (0..=points)
                .map(|point| TrackPoint::new(sim, index, point as f64 * TRACK_STEP_S))
                .collect(),
            passes: of_kind(OpportunityKind::GroundStation),
            windows: of_kind(OpportunityKind::Target),
        }
    }

    /// Times at which the satellite enters and leaves the shadow, s; the first may be the start, the last the time limit.
    #[must_use]
    pub fn shadows(&self) -> Vec<[f64; 2]> {
        let is_same = |a: &TrackPoint, b: &TrackPoint| (a.sunlight < DARK) == (b.sunlight < DARK);
        let dark = self.track.chunk_by(is_same).filter(|points| points[0].sunlight < DARK);
        dark.map(|points| [points[0].time_s, points[points.len() - 1].time_s]).collect()
    }

    /// The point of the path nearest to a time, s.
    #[must_use]
    pub fn point_at(&self, time_s: f64) -> Option<&TrackPoint> {
        let index = libm::round((time_s / TRACK_STEP_S).max(0.0)) as usize;
        self.track.get(index.min(self.track.len().saturating_sub(1)))
    }
}

impl TrackPoint {
    fn new(sim: &TaskingSim, index: usize, time_s: f64) -> Self {
        let arc = sim.satellite(index).orbit().arc(time_s);
        let (position, velocity, sun) = (arc.position(time_s), arc.velocity(time_s), sim.sky().sun(time_s));
        let planet_fixed = rotate(&sim.sky().earth(time_s).planet_from_inertial(), &position);
        Self {
            time_s,
            direction: scale(&planet_fixed, 1.0 / norm(&planet_fixed)),
            sunlight: illumination(&position, &sun),
            orbit_angle_deg: orbit_angle_deg(&position, &velocity, &sun),
        }
    }

    /// Longitude and latitude below the satellite, degrees.
    #[must_use]
    pub fn place(&self) -> Point {
        place(&self.direction)
    }
}

impl StartResources {
    fn new(sim: &TaskingSim, index: usize) -> Self {
        let satellite = sim.satellite(index);
        let args: &SatelliteArgs = &satellite.spec().args;
        let fastest = args.wheel_speeds_rpm.iter().fold(0.0, |most: f64, speed| most.max(speed.abs()));
        let idle_w = args.base_load_w();
        let to_sun = sub(&sim.sun_position(), &satellite.state.position);
        Self {
            battery_wh: args.battery_capacity_ws / J_PER_WH,
            charge_wh: args.stored_charge_ws / J_PER_WH,
            idle_w,
            work_w: idle_w - args.instrument_power_w,
            panel_w: args.facing_panel_w(norm(&to_sun)),
            storage_bits: args.storage_capacity_bits,
            stored_bits: args.storage_init_bits,
            work_bits: args.instrument_bits,
            wheel_share: fastest / args.max_wheel_speed_rpm,
            image_s: SlewTime::new(args).seconds(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry;
    use crate::seed::Seed;
    use crate::task::Recipe;

    fn scenario(task: &str) -> Scenario {
        let recipe = Recipe::at_level(registry::task(task).unwrap(), 3).unwrap();
        Scenario::new(recipe, Seed::user(3).unwrap())
    }

    #[test]
    fn shadows_lie_around_midnight() {
        for task in ["tasking/scanning", "tasking/imaging", "tasking/constellation"] {
            let forecast = TaskingForecast::of_scenario(&scenario(task)).unwrap();
            assert!(!forecast.satellites.is_empty());
            for satellite in &forecast.satellites {
                assert!(
                    (satellite.track.last().unwrap().time_s - forecast.time_limit_s).abs() < TRACK_STEP_S
                );
                for [from_s, to_s] in satellite.shadows() {
                    // Half of an orbit is 2850 s.
                    assert!(to_s - from_s < 2300.0, "{task} {from_s} {to_s}");
                    let middle = satellite.point_at(0.5 * (from_s + to_s)).unwrap();
                    let is_whole = from_s > 0.0 && to_s < forecast.time_limit_s - TRACK_STEP_S;
                    assert!(!is_whole || (middle.orbit_angle_deg - 180.0).abs() < 3.0, "{task}");
                }
                for pass in &satellite.passes {
                    assert!(pass.object < forecast.stations.len() && pass.open_s < pass.close_s);
                }
            }
        }
    }

    #[test]
    fn windows_are_near_their_targets() {
        let scenario = scenario("tasking/imaging");
        let places = vec![TargetPlace::at((20.0, 10.0), 1.0), TargetPlace::at((-60.0, -30.0), 1.0)];
        let layout =
            TaskingLayout { targets: Some(places), keeps_drawn_targets: true, ..TaskingLayout::default() };
        let forecast = TaskingForecast::with_layout(&scenario, layout).unwrap();
        assert_eq!(forecast.drawn_targets, 4500);
        assert_eq!(forecast.targets.len(), 4502);
        let satellite = &forecast.satellites[0];
        assert!(satellite.windows.len() > 100);
        for window in &satellite.windows {
            let point = satellite.point_at(0.5 * (window.open_s + window.close_s)).unwrap();
            let target = forecast.targets[window.object];
            // Seen from 500 km at 45° or more, a target is at most 4.1° of arc from the track; half a step adds 1°.
            assert!((point.place().1 - target.latitude_deg).abs() < 5.5, "{window:?}");
        }
    }
}
