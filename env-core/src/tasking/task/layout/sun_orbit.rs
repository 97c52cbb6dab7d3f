//! [`SunOrbit`]: an orbit in terms of the Sun, from which eclipses follow.

use super::{EpochDay, TaskingLayout};
use crate::task::TaskSpec;
use crate::tasking::environments::TaskingEnvironment;
use crate::tasking::orbit::Sky;
use crate::tasking::vector3::dot;

/// Local solar time of noon, h.
const NOON_HOUR: f64 = 12.0;
/// Degrees by which an hour of local solar time turns a node.
const DEG_PER_HOUR: f64 = 15.0;

/// Place of a circular orbit relative to the Sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunOrbit {
    /// Local solar time at which the first satellite passes the equator northwards, h. Noon and midnight give the longest eclipses.
    pub node_hour: f64,
    /// Angle of the first satellite along its orbit from local noon, in the direction of motion, degrees.
    pub start_angle_deg: f64,
}

/// Node and angle along the orbit of a satellite, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OrbitPlace {
    node_deg: f64,
    anomaly_deg: f64,
}

impl SunOrbit {
    /// The place on an orbit of an inclination, degrees.
    fn place(&self, epoch: &EpochDay, inclination_deg: f64) -> OrbitPlace {
        let sun = Sky::new(epoch.to_epoch().tdb_s()).sun(0.0);
        let sun_hour_angle_deg = (self.node_hour - NOON_HOUR) * DEG_PER_HOUR;
        let node_deg = libm::atan2(sun[1], sun[0]).to_degrees() + sun_hour_angle_deg;
        let (sin_node, cos_node) = libm::sincos(node_deg.to_radians());
        let (sin_tilt, cos_tilt) = libm::sincos(inclination_deg.to_radians());
        let to_node = [cos_node, sin_node, 0.0];
        let ahead = [-sin_node * cos_tilt, cos_node * cos_tilt, sin_tilt];
        let noon_deg = libm::atan2(dot(&sun, &ahead), dot(&sun, &to_node)).to_degrees();
        OrbitPlace { node_deg: wrap_deg(node_deg), anomaly_deg: wrap_deg(noon_deg + self.start_angle_deg) }
    }
}

impl TaskingLayout {
    /// Moves all satellites so that the first has this orbit at the epoch of the layout. Angles between satellites stay. Nothing happens
    /// without epoch and satellites, or for a task of another world.
    pub fn move_orbits(&mut self, orbit: SunOrbit, task: &dyn TaskSpec) {
        let (Some(epoch), Some(satellites)) = (&self.epoch, &mut self.satellites) else { return };
        let Some(environment) = TaskingEnvironment::from_id(task.id()) else { return };
        let place = orbit.place(epoch, environment.inclination_deg());
        let Some(first) = satellites.first().copied() else { return };
        for satellite in satellites {
            satellite.node_deg = wrap_deg(place.node_deg + satellite.node_deg - first.node_deg);
            satellite.anomaly_deg = wrap_deg(place.anomaly_deg + satellite.anomaly_deg - first.anomaly_deg);
        }
    }
}

/// Returns an angle in [0, 360), degrees.
fn wrap_deg(angle: f64) -> f64 {
    let wrapped = angle - 360.0 * libm::floor(angle / 360.0);
    if wrapped >= 360.0 { 0.0 } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry;
    use crate::seed::Seed;
    use crate::task::{Recipe, Scenario};
    use crate::tasking::task::forecast::TaskingForecast;

    #[test]
    fn satellites_start_at_the_angle_from_noon() {
        for (task, node_hour, start_angle_deg) in [
            ("tasking/scanning", 12.0, 0.0),
            ("tasking/imaging", 3.0, 100.0),
            ("tasking/constellation", 20.0, 300.0),
        ] {
            let recipe = Recipe::at_level(registry::task(task).unwrap(), 1).unwrap();
            let scenario = Scenario::new(recipe, Seed::user(5).unwrap());
            let mut layout = TaskingLayout::of_scenario(&scenario).unwrap();
            let orbit = SunOrbit { node_hour, start_angle_deg };
            layout.move_orbits(orbit, scenario.task());
            let forecast = TaskingForecast::with_layout(&scenario, layout).unwrap();
            let start = forecast.satellites[0].track[0];
            // The Sun's direction from the satellite and the frame of date add hundredths of a degree.
            let off = (start.orbit_angle_deg - start_angle_deg + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 0.1, "{task}: {off}");
            if let Some(second) = forecast.satellites.get(1) {
                let apart = (second.track[0].orbit_angle_deg - start_angle_deg).rem_euclid(360.0);
                assert!((apart - 30.0).abs() < 0.1, "level 1 spaces satellites by 30 degrees, got {apart}");
            }
        }
    }

    /// With the node at noon, the Sun is near the plane: the eclipse takes 38 % of the orbit. At dawn it is shorter.
    #[test]
    fn the_hour_of_the_node_decides_the_eclipse() {
        let recipe = Recipe::at_level(registry::task("tasking/scanning").unwrap(), 3).unwrap();
        let scenario = Scenario::new(recipe, Seed::user(5).unwrap());
        let longest = |node_hour: f64| {
            let mut layout = TaskingLayout::of_scenario(&scenario).unwrap();
            layout.epoch = Some(EpochDay { year: 2010, day: 80, second: 0.0 });
            layout.move_orbits(SunOrbit { node_hour, start_angle_deg: 0.0 }, scenario.task());
            let forecast = TaskingForecast::with_layout(&scenario, layout).unwrap();
            let shadows = forecast.satellites[0].shadows();
            shadows.iter().map(|[from_s, to_s]| to_s - from_s).fold(0.0, f64::max)
        };
        let (noon, dawn) = (longest(12.0), longest(6.0));
        assert!(noon > 2050.0 && dawn < noon - 120.0, "{noon} {dawn}");
    }
}
