//! Replays recorded episodes and traces of BSK-RL 1.3.8 step by step and tick by tick.

use super::recordings::{load, recordings, reference};
use crate::tasking::orbit::GravityModel;
use crate::tasking::recording::compare_recording;
use crate::tasking::recording::replay::compare_with_gravity;
use crate::world::RecordingComparison;

/// The worst difference of a quantity.
fn worst(comparison: &RecordingComparison, quantity: &str) -> f64 {
    comparison.worst.iter().find(|worst| worst.quantity == quantity).unwrap().difference
}

/// Replays all recordings of a folder and asserts that no value is beyond its tolerance.
fn assert_replays(folder: &str, files: usize) {
    let paths = recordings(folder);
    assert_eq!(paths.len(), files, "recordings in {folder}");
    for path in paths {
        let comparison =
            compare_recording(&load(&path), 0.0).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        assert!(comparison.steps > 0, "{path:?} has no steps");
        assert_eq!(comparison.first, None, "{path:?}");
    }
}

#[test]
fn validate_bsk_reference_recordings() {
    assert_replays("reference", 10);
}

#[test]
fn validate_bsk_recorded_episodes() {
    assert_replays("recorded", 59);
}

#[test]
fn validate_bsk_trace_scanning() {
    let comparison = compare_recording(&reference("a_trace1hz_seed42"), 0.0).unwrap();
    assert_eq!(comparison.first, None);
    let bounds = [
        ("attitude", 1e-7),
        ("rate", 1e-8),
        ("wheel_speed", 1e-4),
        ("net_power", 1e-3),
        ("battery", 0.1),
        ("thruster_time", 1e-6),
    ];
    for (quantity, bound) in bounds {
        assert!(worst(&comparison, quantity) <= bound, "{quantity}: {}", worst(&comparison, quantity));
    }
    assert_eq!(worst(&comparison, "storage"), 0.0);
}

#[test]
fn validate_bsk_trace_imaging() {
    let comparison = compare_recording(&reference("b_trace1hz_seed7"), 0.0).unwrap();
    assert_eq!(comparison.first, None);
    for (quantity, bound) in [("attitude", 1e-7), ("rate", 1e-8), ("wheel_speed", 1e-4)] {
        assert!(worst(&comparison, quantity) <= bound, "{quantity}: {}", worst(&comparison, quantity));
    }
}

#[test]
fn validate_bsk_episodes_scanning() {
    for name in
        ["a_random_seed0", "a_random_seed1", "a_random_seed2", "a_random_seed3", "a_heuristic_seed100"]
    {
        let comparison = compare_recording(&reference(name), 0.0).unwrap();
        assert_eq!(comparison.first, None, "{name}");
        assert!(worst(&comparison, "battery") <= 1.0 && worst(&comparison, "wheel_speed") <= 0.02, "{name}");
        assert!(worst(&comparison, "observation") <= 1e-4, "{name}");
        assert!(worst(&comparison, "position") <= 0.5, "{name}");
        assert!(worst(&comparison, "window") <= 0.1, "{name}");
    }
}

#[test]
fn validate_bsk_episodes_imaging() {
    for name in ["b_gym_seed0", "b_pz_seed0", "b_los_pz_seed10"] {
        let comparison = compare_recording(&reference(name), 0.0).unwrap();
        assert_eq!(comparison.first, None, "{name}");
        assert!(worst(&comparison, "attitude") <= 1e-6, "{name}: {}", worst(&comparison, "attitude"));
        assert!(worst(&comparison, "window") <= 0.03, "{name}: {}", worst(&comparison, "window"));
    }
}

#[test]
fn simpler_gravity_is_within_kilometres() {
    let recording = reference("a_random_seed3");
    let comparison = compare_with_gravity(&recording, GravityModel::J2, 0.0).unwrap();
    let apart = worst(&comparison, "position");
    assert!((100.0..6_000.0).contains(&apart), "{apart} m");
}

#[test]
fn a_changed_recording_is_found() {
    let mut recording = reference("b_gym_seed0");
    recording["steps"][3]["reward_by_satellite"]["EO_1"] = 0.25.into();
    let first = compare_recording(&recording, 0.0).unwrap().first.unwrap();
    assert_eq!(first.step, 4);
    assert!(first.what.starts_with("reward of EO_1"), "{}", first.what);
}
