//! [`OrbitFacts`]: numbers of the circular orbits of a task, for prompts and samples.

use env_core::TaskSpec;
use env_core::tasking::constants::{EARTH_MU, EARTH_RADIUS_M};
use env_core::tasking::environments::TaskingEnvironment;

use super::units::{M_PER_KM, S_PER_MINUTE};

/// Least elevation at which a target sees the satellite that images it, degrees, as in BSK-RL.
const TARGET_ELEVATION_DEG: f64 = 45.0;

/// Numbers of a circular orbit around a spherical Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OrbitFacts {
    /// Height above the Earth, km.
    pub(super) altitude_km: f64,
    /// Inclination of the orbit, degrees.
    pub(super) inclination_deg: f64,
    /// Duration of an orbit, minutes: 2π√(a³/μ).
    pub(super) minutes: f64,
    /// Angle along the orbit in a minute, degrees.
    pub(super) deg_per_minute: f64,
    /// Half of the angle along the orbit in the shadow, degrees, if the Sun is in its plane: asin(R/a) for parallel rays.
    pub(super) half_shadow_deg: f64,
    /// Distance from the track at which targets are seen, km: R(acos((R/a) cos ε) − ε) for an elevation ε of the satellite.
    pub(super) sight_km: f64,
}

impl OrbitFacts {
    /// Numbers of a task's orbits; those of scanning for a task of another world.
    pub(super) fn of(task: &dyn TaskSpec) -> Self {
        let [scanning, ..] = TaskingEnvironment::defaults();
        let environment = TaskingEnvironment::from_id(task.id()).unwrap_or(scanning);
        let altitude_m = environment.altitude_m();
        let radius_m = EARTH_RADIUS_M + altitude_m;
        let ratio = EARTH_RADIUS_M / radius_m;
        let minutes =
            std::f64::consts::TAU * libm::sqrt(radius_m * radius_m * radius_m / EARTH_MU) / S_PER_MINUTE;
        let elevation = TARGET_ELEVATION_DEG.to_radians();
        Self {
            altitude_km: altitude_m / M_PER_KM,
            inclination_deg: environment.inclination_deg(),
            minutes,
            deg_per_minute: 360.0 / minutes,
            half_shadow_deg: libm::asin(ratio).to_degrees(),
            sight_km: EARTH_RADIUS_M / M_PER_KM * (libm::acos(ratio * libm::cos(elevation)) - elevation),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Periods are those of the environments' documentation: 95 and 101 minutes.
    #[test]
    fn numbers_match_known_orbits() {
        for (task, minutes, half_shadow_deg, sight_km) in
            [("tasking/imaging", 94.6, 68.0, 448.0), ("tasking/constellation", 100.9, 62.7, 677.0)]
        {
            let facts = OrbitFacts::of(env_core::task(task).unwrap());
            assert!((facts.minutes - minutes).abs() < 0.1, "{task}: {facts:?}");
            assert!((facts.half_shadow_deg - half_shadow_deg).abs() < 0.1, "{task}: {facts:?}");
            assert!((facts.sight_km - sight_km).abs() < 1.0, "{task}: {facts:?}");
            assert!((facts.deg_per_minute * facts.minutes - 360.0).abs() < 1e-9);
        }
    }
}
