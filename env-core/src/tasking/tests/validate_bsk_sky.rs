//! The Earth's rotation, the Sun and the eclipse against BSK-RL's recordings.

use serde_json::Value;

use super::recordings::{load, recordings};
use crate::tasking::earth::EarthFrame;
use crate::tasking::orbit::Sky;
use crate::tasking::time::Epoch;
use crate::tasking::vector3::{Vector3, cross, norm};

fn vector(value: &Value) -> Vector3<f64> {
    [0, 1, 2].map(|i| value[i].as_f64().unwrap())
}

/// Recorded moments: the starts of ten recordings and the ends of eight episodes.
const MOMENTS: usize = 18;

/// Recorded moments: barycentric dynamical time of the start, seconds since then, and the object with their values.
fn moments() -> Vec<(f64, f64, Value)> {
    let mut moments = Vec::new();
    for path in recordings("reference") {
        let recording = load(&path);
        let epoch = Epoch::parse(recording["initial"]["utc_init"].as_str().unwrap()).unwrap();
        moments.push((epoch.tdb_s(), 0.0, recording["initial"].clone()));
        if let Some(end) = recording["final"]["sim_time"].as_f64() {
            moments.push((epoch.tdb_s(), end, recording["final"].clone()));
        }
    }
    assert_eq!(moments.len(), MOMENTS);
    moments
}

#[test]
fn validate_bsk_earth() {
    let mut elements = 0;
    for (start, seconds, recorded) in moments() {
        let ours = EarthFrame::at(start + seconds).planet_from_inertial();
        for (row, theirs) in ours.iter().zip(recorded["PN_dcm"].as_array().unwrap()) {
            for (ours, theirs) in row.iter().zip(vector(theirs)) {
                assert!((ours - theirs).abs() < 1e-11, "{ours} {theirs}");
                elements += 1;
            }
        }
    }
    assert_eq!(elements, 9 * MOMENTS);
}

#[test]
fn validate_bsk_sun() {
    for (start, seconds, recorded) in moments() {
        let mut sky = Sky::new(start);
        sky.extend_to(seconds + 60.0);
        let (ours, theirs) = (sky.sun(seconds), vector(&recorded["sun_position_N_m"]));
        let angle = norm(&cross(&ours, &theirs)) / (norm(&ours) * norm(&theirs));
        assert!(angle.to_degrees() * 3600.0 < 0.001, "{}″", angle.to_degrees() * 3600.0);
        assert!((norm(&ours) - norm(&theirs)).abs() < 200.0, "{} m", norm(&ours) - norm(&theirs));
    }
}

#[test]
fn the_sun_is_continuous_over_its_arcs() {
    let mut sky = Sky::new(2.5e8);
    sky.extend_to(90_000.0);
    for seam in [28_800.0, 57_600.0, 86_400.0] {
        let (before, after) = (sky.sun(seam - 1e-3), sky.sun(seam + 1e-3));
        let apart = norm(&[0, 1, 2].map(|i| before[i] - after[i]));
        assert!(apart < 600.0, "{apart} m");
    }
}
