//! Motion of satellites within a step, for views of an episode.

use serde::Serialize;

use super::rounding::round;
use crate::scene::Point;
use crate::tasking::constants::{EARTH_RADIUS_M, RAD_S_PER_RPM};
use crate::tasking::satellite::eclipse::illumination;
use crate::tasking::setup::environment::GroundStation;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::vector3::{Vector3, add, dot, norm, rotate, rotate_back, scale, sub};

/// Time between two samples of a step, s.
const SAMPLE_S: f64 = 10.0;

/// Samples of the motion of all satellites, at equal times within a step and at its end.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct StepMotion {
    /// Times of the samples since the start of the episode, s.
    pub time_s: Vec<f64>,
    /// Longitude and latitude of the point below the Sun, degrees.
    pub sun: Vec<[f64; 2]>,
    /// Motion of each satellite.
    pub satellites: Vec<SatelliteMotion>,
}

/// Samples of the motion of one satellite.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct SatelliteMotion {
    /// Longitudes of the satellite, degrees.
    pub longitude: Vec<f64>,
    /// Latitudes of the satellite, degrees.
    pub latitude: Vec<f64>,
    /// Longitude and latitude of the point that the instrument sees, degrees; none if it looks past the Earth.
    pub view: Vec<Option<[f64; 2]>>,
    /// Charges as shares of the battery.
    pub battery: Vec<f64>,
    /// Data as shares of the storage.
    pub storage: Vec<f64>,
    /// Speed of the fastest wheel as a share of the limit.
    pub wheels: Vec<f64>,
    /// Angles between the instrument and nadir, degrees.
    pub instrument_error: Vec<f64>,
    /// Angles between the panel's normal and the Sun, degrees.
    pub sun_error: Vec<f64>,
    /// Visible share of the Sun.
    pub sunlight: Vec<f64>,
    /// Number of a ground station that can be reached, if one can.
    pub station: Vec<Option<usize>>,
}

impl StepMotion {
    /// The motion so far of an episode that starts: one sample.
    pub(super) fn at_start(sim: &TaskingSim) -> Self {
        let mut motion = Self { satellites: vec![SatelliteMotion::default(); sim.len()], ..Self::default() };
        motion.push(sim);
        motion
    }

    /// Removes the samples of the last step.
    pub(super) fn clear(&mut self) {
        *self =
            Self { satellites: vec![SatelliteMotion::default(); self.satellites.len()], ..Self::default() };
    }

    /// Adds a sample if one is due at this tick of a step that began at `start_s`.
    pub(super) fn sample(&mut self, sim: &TaskingSim, start_s: f64) {
        let due_s = start_s + SAMPLE_S * (self.time_s.len() + 1) as f64;
        if sim.time_s() >= due_s {
            self.push(sim);
        }
    }

    /// Adds a sample at the end of a step.
    pub(super) fn finish(&mut self, sim: &TaskingSim) {
        if self.time_s.last().is_none_or(|last| *last < round(sim.time_s(), 6)) {
            self.push(sim);
        }
    }

    fn push(&mut self, sim: &TaskingSim) {
        self.time_s.push(round(sim.time_s(), 6));
        let planet = sim.planet_from_inertial();
        let sun = sim.sun_position();
        self.sun.push(place(&rotate(&planet, &sun)).into());
        for (index, satellite) in self.satellites.iter_mut().enumerate() {
            satellite.push(sim, index, &sun);
        }
    }
}

impl SatelliteMotion {
    fn push(&mut self, sim: &TaskingSim, index: usize, sun: &Vector3<f64>) {
        let satellite = sim.satellite(index);
        let (state, args) = (&satellite.state, &satellite.spec().args);
        let planet = sim.planet_from_inertial();
        let planet_position = rotate(&planet, &state.position);
        let (longitude, latitude) = place(&planet_position);
        let body = body_from_inertial(&state.attitude.sigma);
        let instrument = rotate_back(&body, &args.instrument_axis);
        let panel = rotate_back(&body, &args.panel_normal);
        let limit = args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        let fastest = state.attitude.wheels.iter().fold(0.0, |max: f64, speed| max.max(speed.abs()));
        self.longitude.push(longitude);
        self.latitude.push(latitude);
        let seen = seen_point(&state.position, &instrument);
        self.view.push(seen.map(|point| place(&rotate(&planet, &point)).into()));
        self.battery.push(round(state.battery / args.battery_capacity_ws, 4));
        let stored: f64 = satellite.stored().iter().sum();
        self.storage.push(round(stored / args.storage_capacity_bits, 4));
        self.wheels.push(round(fastest / limit, 4));
        self.instrument_error.push(degrees_between(&scale(&state.position, -1.0), &instrument));
        self.sun_error.push(degrees_between(sun, &panel));
        self.sunlight.push(round(illumination(&state.position, sun), 3));
        self.station.push(sim.stations().iter().position(|station| sees(station, &planet_position)));
    }
}

/// Longitude and latitude of a planet-fixed position, degrees, rounded to a kilometre on the ground.
pub(super) fn place(position: &Vector3<f64>) -> Point {
    let longitude = libm::atan2(position[1], position[0]);
    let latitude = libm::asin((position[2] / norm(position)).clamp(-1.0, 1.0));
    (round(longitude.to_degrees(), 2), round(latitude.to_degrees(), 2))
}

/// The point of a spherical Earth that a line of sight from a position meets first, if it does.
fn seen_point(position: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Vector3<f64>> {
    let along = dot(position, direction);
    let missing = EARTH_RADIUS_M * EARTH_RADIUS_M - dot(position, position) + along * along;
    (along < 0.0 && missing >= 0.0).then(|| add(position, &scale(direction, -along - missing.sqrt())))
}

/// True if a ground station sees a satellite above its minimum elevation.
fn sees(station: &GroundStation, satellite: &Vector3<f64>) -> bool {
    let line = sub(satellite, &station.position);
    let sine = dot(&line, &station.position) / (norm(&line) * norm(&station.position));
    libm::asin(sine.clamp(-1.0, 1.0)) >= station.min_elevation_rad
}

fn degrees_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let cosine = dot(a, b) / (norm(a) * norm(b));
    round(libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees(), 2)
}
