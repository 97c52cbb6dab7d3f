//! Replays recorded episodes and traces of BSK-RL 1.3.8 step by step and tick by tick.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::recordings::{
    IMAGING, SCANNING, assert_compared, load, recordings, reference, replay_reference, worst,
};
use crate::tasking::orbit::GravityModel;
use crate::tasking::recording::compare_recording;
use crate::tasking::recording::replay::compare_with_gravity;

/// Kind of a recording: a trace, or an episode of satellites that scan or image.
fn kind_of(path: &Path, recording: &Value) -> &'static str {
    let text = path.to_string_lossy();
    let scans =
        |satellite: &Value| satellite["dyn"][0].as_str().is_some_and(|name| name.starts_with("Continuous"));
    let is_scanning = match recording["satellites"].as_array() {
        Some(satellites) => scans(&satellites[0]),
        None => recording["kind"].as_str().is_some_and(|kind| kind.starts_with('a')),
    };
    match (text.contains("trace"), is_scanning) {
        (true, true) => "ticks of scanning",
        (true, false) => "ticks of imaging",
        (false, true) => "episodes of scanning",
        (false, false) => "episodes of imaging",
    }
}

/// Replays all recordings of a folder and asserts that no value is beyond its tolerance. Prints the largest difference of each
/// quantity by kind of recording. Returns the number of steps.
fn assert_replays(folder: &str, files: usize) -> usize {
    let paths = recordings(folder);
    assert_eq!(paths.len(), files, "recordings in {folder}");
    let mut steps = 0;
    let mut largest: BTreeMap<[&str; 2], (f64, String)> = BTreeMap::new();
    for path in paths {
        let recording = load(&path);
        let comparison =
            compare_recording(&recording, 0.0).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        assert!(comparison.steps > 0, "{path:?} has no steps");
        assert_eq!(comparison.first, None, "{path:?}");
        assert_eq!(worst(&comparison, "outcome").difference, 0.0, "{path:?}");
        steps += comparison.steps;
        for found in comparison.worst.iter().filter(|worst| worst.is_compared) {
            let entry = largest.entry([kind_of(&path, &recording), found.quantity]).or_default();
            if found.difference >= entry.0 {
                let file = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                *entry = (found.difference, format!("of {:.1e} allowed, {file}", found.allowed));
            }
        }
    }
    for ([kind, quantity], (difference, note)) in largest {
        println!("{folder}, {kind}: {quantity} {difference:.1e} {note}");
    }
    steps
}

#[test]
fn validate_bsk_reference_recordings() {
    assert_eq!(assert_replays("reference", 10), 1_295);
}

#[test]
fn validate_bsk_recorded_episodes() {
    assert_eq!(assert_replays("recorded", 64), 2_607);
}

#[test]
fn validate_bsk_trace_scanning() {
    /// Recorded ticks of the satellite.
    const TICKS: usize = 1_140;
    let trace = [replay_reference("a_trace1hz_seed42")];
    // Flags of an action: images, of which there are none. Commands of a tick are recorded in the next one.
    assert_compared(&trace, "step_end", 10, 0.0);
    assert_compared(&trace, "reward", 10, 1e-9);
    // The state after the reset is compared, too.
    assert_compared(&trace, "attitude", TICKS + 1, 1e-7);
    assert_compared(&trace, "rate", 3 * (TICKS + 1), 1e-8);
    assert_compared(&trace, "wheel_speed", 3 * (TICKS + 1), 1e-4);
    assert_compared(&trace, "net_power", TICKS, 1e-3);
    assert_compared(&trace, "panel_power", TICKS, 1e-3);
    assert_compared(&trace, "illumination", TICKS, 2e-4);
    assert_compared(&trace, "battery", TICKS + 1, 0.1);
    assert_compared(&trace, "storage", TICKS + 1, 0.0);
    assert_compared(&trace, "thruster_time", 8 * (TICKS - 1), 1e-6);
    assert_compared(&trace, "motor_torque", 6 * (TICKS - 1), 1e-5);
    assert_compared(&trace, "guidance", 3 * (TICKS - 1), 1e-6);
    assert_compared(&trace, "position", TICKS + 1, 0.5);
    assert_compared(&trace, "velocity", TICKS + 1, 0.0012);
}

#[test]
fn validate_bsk_trace_imaging() {
    /// Recorded ticks of the three satellites.
    const TICKS: usize = 3 * 562;
    let trace = [replay_reference("b_trace1hz_seed7")];
    // Images are equal in each action: the ends of actions, and who imaged which target.
    assert_compared(&trace, "step_end", 20, 0.0);
    assert_compared(&trace, "reward", 20, 1e-9);
    assert_compared(&trace, "attitude", TICKS + 3, 1e-7);
    assert_compared(&trace, "rate", 3 * (TICKS + 3), 1e-8);
    assert_compared(&trace, "wheel_speed", 3 * (TICKS + 3), 1e-4);
    assert_compared(&trace, "motor_torque", 6 * (TICKS - 3), 1e-5);
    assert_compared(&trace, "guidance", 3 * (TICKS - 3), 1e-6);
    assert_compared(&trace, "elevation", TICKS, 2e-6);
    assert_compared(&trace, "range", TICKS, 0.5);
    // Access of each tick, images of each action.
    assert_compared(&trace, "outcome", TICKS + 3 * 20, 0.0);
}

#[test]
fn validate_bsk_episodes_scanning() {
    /// Steps of all episodes, and their states with those of the resets.
    const STEPS: usize = 1_028;
    const STATES: usize = STEPS + 5;
    let episodes = SCANNING.map(replay_reference);
    assert_eq!(episodes.iter().map(|episode| episode.steps).sum::<usize>(), STEPS);
    // Start, end and duration of each step, and the end of each episode.
    assert_compared(&episodes, "step_end", 3 * STEPS + 5, 1e-9);
    // The reward with and without the penalty, and two sums of each episode.
    assert_compared(&episodes, "reward", 2 * STEPS + 2 * 5, 1e-9);
    assert_compared(&episodes, "storage", STATES, 0.0);
    assert_compared(&episodes, "battery", STATES, 1.0);
    assert_compared(&episodes, "wheel_speed", 3 * STATES, 0.02);
    assert_compared(&episodes, "net_power", STEPS, 0.02);
    assert_compared(&episodes, "pointing_error", 2 * STEPS, 4e-5);
    // Eight of twelve observed values, and the shares of battery, storage and wheels of each state.
    assert_compared(&episodes, "observation", (8 + 5) * STATES, 1e-4);
    assert_compared(&episodes, "position", STATES + 21 * 5, 0.5);
    assert_compared(&episodes, "velocity", STATES, 0.0012);
}

#[test]
fn validate_bsk_episodes_imaging() {
    /// Steps of all episodes.
    const STEPS: usize = 237;
    /// States of the satellites, with those of the resets.
    const STATES: usize = 3 * (STEPS + 3);
    let episodes = IMAGING.map(replay_reference);
    assert_eq!(episodes.iter().map(|episode| episode.steps).sum::<usize>(), STEPS);
    // Start, end and duration of each step. The duration is recorded once in the step and once, or by satellite as well, in its infos.
    assert_compared(&episodes[..1], "step_end", 4 * 80 + 1, 1e-9);
    assert_compared(&episodes[1..], "step_end", (4 + 3) * (82 + 75) + 2, 1e-9);
    assert_compared(&episodes, "attitude", STATES, 1e-6);
    assert_compared(&episodes, "storage", STATES, 0.0);
    // The rewarder's reward of each satellite, the returned ones, and the sums.
    assert_compared(&episodes[..1], "reward", 4 * 80 + 3, 1e-9);
    assert_compared(&episodes[1..], "reward", 6 * (82 + 75) + 6, 1e-9);
    for episode in &episodes {
        assert_eq!(worst(episode, "outcome").difference, 0.0);
    }
}

#[test]
fn validate_bsk_orbit_j2() {
    let recording = reference("a_random_seed3");
    let comparison = compare_with_gravity(&recording, GravityModel::J2, 0.0).unwrap();
    let apart = worst(&comparison, "position").difference;
    assert!((100.0..6_000.0).contains(&apart), "{apart} m");
}
