//! Replay of the recorded episodes of the public kessler-env.

use serde_json::{Value, json};

use crate::kessler::recording::compare_recording;
use crate::testing::decompress;

/// Largest allowed difference. Differences come from the order of floating-point operations (about 1e-16
/// relative a step), amplified by orbital shear and by 1/r³ for bodies that dip towards the Earth.
const REPLAY_TOLERANCE: f64 = 1e-9;

fn recording() -> Value {
    decompress(include_bytes!("../../../fixtures/kessler-episodes.json.gz"))
}

#[test]
fn validate_kessler_env_every_recorded_episode_replays() {
    let comparison = compare_recording(&recording(), REPLAY_TOLERANCE).unwrap();
    assert_eq!(comparison.first, None);
    assert_eq!((comparison.episodes, comparison.steps), (30, 1361));
}

/// The comparison can fail: on a changed reward and on a missing alert.
#[test]
fn changed_recording_is_detected() {
    let changed = |episode: usize, step: usize, key: &str, value: Value| {
        let mut recording = recording();
        recording["episodes"][episode]["steps"][step][key] = value;
        let first = compare_recording(&recording, REPLAY_TOLERANCE).unwrap().first.unwrap();
        (first.episode, first.step)
    };
    let recorded = recording();
    let reward = recorded["episodes"][4]["steps"][10]["reward"].as_f64().unwrap();
    assert_eq!(changed(4, 10, "reward", json!(reward + 1e-6)), (4, 11));
    let episodes = recorded["episodes"].as_array().unwrap().iter().enumerate();
    let with_alert =
        |episode: &Value| episode["steps"].as_array()?.iter().position(|step| step["alerts"] != json!([]));
    let (episode, step) = episodes.filter_map(|(i, episode)| Some((i, with_alert(episode)?))).next().unwrap();
    assert_eq!(changed(episode, step, "alerts", json!([])), (episode, step + 1));
}
