//! Replay of the recorded episodes of the public kessler-env.

use std::io::Read;

use crate::kessler::recording::{EpisodeRecording, KesslerRecording, compare_episode};

/// Largest allowed difference. Differences come from the order of floating-point operations (about 1e-16
/// relative a step), amplified by orbital shear and by 1/r³ for bodies that dip towards the Earth.
const REPLAY_TOLERANCE: f64 = 1e-9;

fn recording() -> KesslerRecording {
    let packed = include_bytes!("../../../fixtures/kessler-episodes.json.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(&packed[..]).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn validate_kessler_env_every_recorded_episode_replays() {
    let recording = recording();
    assert_eq!(recording.episodes.len(), 30);
    let mut steps = 0;
    for (i, episode) in recording.episodes.iter().enumerate() {
        let differences = compare_episode(episode, REPLAY_TOLERANCE).unwrap();
        steps += differences.steps;
        assert_eq!(differences.first_mismatch, None, "episode {i}");
        assert_eq!(differences.first_beyond, None, "episode {i}: {differences:?}");
    }
    assert_eq!(steps, 1361);
}

/// The comparison can fail: on a changed reward and on a missing alert.
#[test]
fn changed_recording_is_detected() {
    let mut recording = recording();
    recording.episodes[4].steps[10].reward += 1e-6;
    let differences = compare_episode(&recording.episodes[4], REPLAY_TOLERANCE).unwrap();
    assert_eq!(differences.first_beyond.map(|difference| difference.step), Some(11));
    let has_alert = |episode: &&mut EpisodeRecording| episode.steps.iter().any(|s| !s.alerts.is_empty());
    let with_alert = recording.episodes.iter_mut().find(has_alert).unwrap();
    let index = with_alert.steps.iter().position(|s| !s.alerts.is_empty()).unwrap();
    with_alert.steps[index].alerts.clear();
    let differences = compare_episode(with_alert, REPLAY_TOLERANCE).unwrap();
    assert_eq!(differences.first_mismatch.map(|difference| difference.step), Some(index + 1));
}
