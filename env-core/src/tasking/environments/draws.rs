//! Draws of a scenario's initial values, in the distributions of BSK-RL.

use crate::episode_rng::{EpisodeRng, RngStream};
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::setup::environment::Target;
use crate::tasking::time::Epoch;
use crate::tasking::vector3::{Vector3, norm, scale};

/// Altitude of BSK-RL's random orbits, m.
pub(super) const RANDOM_ALTITUDE_M: f64 = 500e3;
/// Inclination of BSK-RL's random orbits, degrees.
pub(super) const RANDOM_INCLINATION_DEG: f64 = 45.0;
/// Largest rate about each axis of a random tumble, rad/s.
const TUMBLE_RAD_S: f64 = 1e-4;

/// Draws a whole number from `low` to less than `high`.
fn whole(rng: &mut impl EpisodeRng, stream: RngStream, low: u32, high: u32) -> u32 {
    (rng.uniform_in(stream, f64::from(low), f64::from(high)) as u32).min(high - 1)
}

/// Draws a vector of independent standard normal numbers.
pub(super) fn normal_vector(rng: &mut impl EpisodeRng, stream: RngStream) -> Vector3<f64> {
    let ([x, y], [z, _]) = (rng.normals(stream), rng.normals(stream));
    [x, y, z]
}

/// Draws the start of an episode: from 2000 to 2021, as `random_epoch` of BSK-RL.
pub(super) fn epoch(rng: &mut impl EpisodeRng) -> Epoch {
    let mut draw = |low, high| whole(rng, RngStream::Epoch, low, high);
    Epoch {
        year: draw(2000, 2022) as i32,
        month: draw(1, 13),
        day: draw(1, 28),
        hour: draw(0, 23),
        minute: draw(0, 59),
        second: f64::from(draw(0, 59)) + f64::from(draw(0, 999)) / 1000.0,
    }
}

/// Draws a circular orbit: the ascending node and the place on it.
pub(super) fn circular_orbit(
    rng: &mut impl EpisodeRng,
    altitude_m: f64,
    inclination_deg: f64,
) -> OrbitalElements {
    let mut angle = || rng.uniform_in(RngStream::Orbit, 0.0, std::f64::consts::TAU);
    OrbitalElements {
        semi_major_axis_m: EARTH_RADIUS_M + altitude_m,
        eccentricity: 0.0,
        inclination_rad: inclination_deg.to_radians(),
        ascending_node_rad: angle(),
        periapsis_rad: 0.0,
        true_anomaly_rad: angle(),
    }
}

/// Draws an attitude, as MRP, and a rate, rad/s.
pub(super) fn tumble(rng: &mut impl EpisodeRng) -> (Vector3<f64>, Vector3<f64>) {
    let sigma = [0; 3].map(|_| rng.uniform(RngStream::Attitude));
    let omega = [0; 3].map(|_| rng.uniform_in(RngStream::Attitude, -TUMBLE_RAD_S, TUMBLE_RAD_S));
    (sigma, omega)
}

/// Draws the speeds of the wheels, rpm.
pub(super) fn wheel_speeds(rng: &mut impl EpisodeRng, largest_rpm: f64) -> Vector3<f64> {
    [0; 3].map(|_| rng.uniform_in(RngStream::Attitude, -largest_rpm, largest_rpm))
}

/// Latitude and longitude of the 10 000 largest cities, largest first, as little-endian integers in units of 1e-4 degrees
/// (World Cities Database, simplemaps.com; `scripts/bsk-cities` writes the file).
static CITIES: &[u8] = include_bytes!("../data/cities.bin");
/// Size of a city in [`CITIES`], bytes.
const CITY_BYTES: usize = 8;
/// Number of cities from which targets are drawn.
pub(super) const CITY_COUNT: usize = CITIES.len() / CITY_BYTES;

/// Direction of a city from the Earth's centre.
fn city(index: usize) -> Vector3<f64> {
    let bytes = &CITIES[index * CITY_BYTES..][..CITY_BYTES];
    let angle = |at: usize| {
        let units = i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        libm::sincos((f64::from(units) * 1e-4).to_radians())
    };
    let ((sin_latitude, cos_latitude), (sin_longitude, cos_longitude)) = (angle(0), angle(4));
    [cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude]
}

/// Draws different cities on a spherical Earth, at most all. The priority of each is a uniform number to the power
/// `priority_power`.
pub(super) fn city_targets(rng: &mut impl EpisodeRng, count: u32, priority_power: f64) -> Vec<Target> {
    let mut left: Vec<usize> = (0..CITY_COUNT).collect();
    (0..(count as usize).min(CITY_COUNT))
        .map(|drawn| {
            // Each draw swaps a city that is left to the front (Fisher and Yates).
            let others = (CITY_COUNT - drawn) as f64;
            let offset = (rng.uniform(RngStream::Targets) * others) as usize;
            left.swap(drawn, (drawn + offset).min(CITY_COUNT - 1));
            let index = left[drawn];
            Target {
                name: format!("city-{index}"),
                position: scale(&city(index), EARTH_RADIUS_M),
                priority: draw_priority(rng, priority_power),
            }
        })
        .collect()
}

/// Draws a uniform number to a power.
fn draw_priority(rng: &mut impl EpisodeRng, power: f64) -> f64 {
    let uniform = rng.uniform(RngStream::Targets);
    if power == 1.0 { uniform } else { libm::pow(uniform, power) }
}

/// Draws targets that are uniform on a spherical Earth. The priority of each is a uniform number to the power `priority_power`.
pub(super) fn uniform_targets(rng: &mut impl EpisodeRng, count: u32, priority_power: f64) -> Vec<Target> {
    (0..count)
        .map(|index| {
            let direction = loop {
                let vector = normal_vector(rng, RngStream::Targets);
                if norm(&vector) > 1e-6 {
                    break scale(&vector, 1.0 / norm(&vector));
                }
            };
            let priority = draw_priority(rng, priority_power);
            Target { name: format!("tgt-{index}"), position: scale(&direction, EARTH_RADIUS_M), priority }
        })
        .collect()
}
