//! Orbits against BSK-RL's recordings and closed forms.

use super::recordings::reference;
use crate::tasking::constants::{EARTH_MU, EARTH_RADIUS_M};
use crate::tasking::orbit::{GravityModel, Orbit, OrbitalElements, Sky};
use crate::tasking::time::Epoch;
use crate::tasking::vector3::{Vector3, norm, sub};

fn circular(inclination_rad: f64) -> OrbitalElements {
    OrbitalElements {
        semi_major_axis_m: 6_871_000.0,
        eccentricity: 0.0,
        inclination_rad,
        ascending_node_rad: 1.0,
        periapsis_rad: 0.0,
        true_anomaly_rad: 0.3,
    }
}

#[test]
fn validate_bsk_orbit() {
    let mut compared = 0;
    for name in ["a_random_seed1", "a_random_seed2", "a_random_seed3", "a_heuristic_seed100"] {
        let recording = reference(name);
        let vector =
            |value: &serde_json::Value| -> Vector3<f64> { [0, 1, 2].map(|i| value[i].as_f64().unwrap()) };
        let initial = &recording["initial"];
        let mut sky = Sky::new(Epoch::parse(initial["utc_init"].as_str().unwrap()).unwrap().tdb_s());
        let (position, velocity) = (vector(&initial["r_BN_N"]), vector(&initial["v_BN_N"]));
        let mut orbit = Orbit::new(GravityModel::Ggm10, position, velocity, &sky, 1.0);
        for step in recording["steps"].as_array().unwrap() {
            let time = step["t_end"].as_f64().unwrap();
            orbit.extend_to(time, &mut sky);
            let apart = norm(&sub(&orbit.arc(time).position(time), &vector(&step["r_BN_N"])));
            assert!(apart <= 0.5, "{name} at {time} s: {apart} m");
            compared += 1;
        }
    }
    // Positions after all steps of these episodes, of which two last for five orbits.
    assert_eq!(compared, 832);
}

#[test]
fn kepler_orbit_returns_after_its_period() {
    let (position, velocity) = circular(0.7).state(EARTH_MU);
    let mut sky = Sky::new(0.0);
    let mut orbit = Orbit::new(GravityModel::Kepler, position, velocity, &sky, 1.0);
    let period = 2.0 * std::f64::consts::PI * (6_871_000.0_f64.powi(3) / EARTH_MU).sqrt();
    orbit.extend_to(period, &mut sky);
    let apart = norm(&sub(&orbit.arc(period).position(period), &position));
    assert!(apart < 0.02, "{apart} m");
}

#[test]
fn validate_bsk_orbit_node_rate_of_j2() {
    /// Oblateness J₂ of the field GGM03S.
    const J2: f64 = 4.841_692_638_33e-4 * 2.236_067_977_499_79;
    let elements = circular(0.9);
    let (position, velocity) = elements.state(EARTH_MU);
    let mut sky = Sky::new(0.0);
    let mut orbit = Orbit::new(GravityModel::J2, position, velocity, &sky, 1.0);
    let period = 2.0 * std::f64::consts::PI * (elements.semi_major_axis_m.powi(3) / EARTH_MU).sqrt();
    let end = 15.0 * period;
    orbit.extend_to(end, &mut sky);
    let arc = orbit.arc(end);
    let after = OrbitalElements::from_state(EARTH_MU, &arc.position(end), &arc.velocity(end));
    let rate = (after.ascending_node_rad - elements.ascending_node_rad) / end;
    let motion = 2.0 * std::f64::consts::PI / period;
    let ratio = EARTH_RADIUS_M / elements.semi_major_axis_m;
    let expected = -1.5 * motion * J2 * ratio * ratio * libm::cos(elements.inclination_rad);
    assert!((rate / expected - 1.0).abs() < 0.01, "{rate} {expected}");
}

#[test]
fn elements_of_a_state_are_those_it_was_made_from() {
    let elements = OrbitalElements { eccentricity: 0.02, periapsis_rad: 2.0, ..circular(1.2) };
    let (position, velocity) = elements.state(EARTH_MU);
    let back = OrbitalElements::from_state(EARTH_MU, &position, &velocity);
    assert!((back.semi_major_axis_m - elements.semi_major_axis_m).abs() < 1e-6);
    for (ours, theirs) in [
        (back.eccentricity, elements.eccentricity),
        (back.inclination_rad, elements.inclination_rad),
        (back.ascending_node_rad, elements.ascending_node_rad),
        (back.periapsis_rad, elements.periapsis_rad),
        (back.true_anomaly_rad, elements.true_anomaly_rad),
    ] {
        assert!((ours - theirs).abs() < 1e-9, "{ours} {theirs}");
    }
}
