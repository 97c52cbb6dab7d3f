//! Windows of access, and what satellites observe of them and of eclipses, against BSK-RL's recordings.

use super::recordings::{IMAGING, SCANNING, assert_compared, replay_reference};

#[test]
fn validate_bsk_windows_of_targets() {
    let episodes = IMAGING.map(replay_reference);
    // Opening and close of 1 103 windows in the lists, and of 243 chosen ones.
    assert_compared(&episodes, "target_window", 2 * (1_103 + 243), 0.03);
    assert_compared(&episodes, "station_window", 2 * 35, 0.1);
}

#[test]
fn validate_bsk_windows_of_stations() {
    let episodes = SCANNING.map(replay_reference);
    // Opening and close of 42 windows in the lists, and of the next one after each of 1 028 steps.
    assert_compared(&episodes, "station_window", 2 * (42 + 1_028), 0.1);
}

#[test]
fn validate_bsk_windows_eclipses() {
    let episodes = SCANNING.map(replay_reference);
    // Start and end after each of 1 028 steps, and their observations, with those of five resets. They are equal but for rounding.
    assert_compared(&episodes, "eclipse", 2 * 1_028, 0.0);
    assert_compared(&episodes, "observed_eclipse", 2 * (1_028 + 5), 1e-8);
    // Illumination of the searched trajectories every 30 s, and after each step.
    assert_compared(&episodes, "sampled_illumination", 5_562, 0.01);
    assert_compared(&episodes, "illumination", 1_028, 2e-4);
}

#[test]
fn validate_bsk_windows_observations() {
    let episodes = IMAGING.map(replay_reference);
    // 720 observations of ten targets: after 237 steps and three resets, of three satellites. 14 400 values.
    assert_compared(&episodes, "observed_priority", 7_200, 0.0);
    assert_compared(&episodes, "observed_window", 7_200, 0.05);
    let episodes = SCANNING.map(replay_reference);
    assert_compared(&episodes, "observed_window", 2 * (1_028 + 5), 0.1);
}
