//! Against the recorded episodes of the public kessler-env.

use std::io::Read;

use crate::kessler::record::{Recording, compare};

/// Differences come from the order of floating-point operations (about 1e-16 relative a step), amplified by orbital
/// shear and by 1/r³ for bodies that dip towards the Earth; 1e-9 is the contract.
const TOLERANCE: f64 = 1e-9;

fn recording() -> Recording {
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
        let found = compare(episode, TOLERANCE).unwrap();
        steps += found.steps;
        assert_eq!(found.first_mismatch, None, "episode {i}");
        assert_eq!(found.first_beyond, None, "episode {i}: {found:?}");
    }
    assert_eq!(steps, 1361);
}

/// The comparison can fail: one burn changed, one reward changed, one alert gone.
#[test]
fn a_changed_recording_is_seen() {
    let mut recording = recording();
    recording.episodes[4].steps[10].reward += 1e-6;
    let found = compare(&recording.episodes[4], TOLERANCE).unwrap();
    assert_eq!(found.first_beyond.map(|(step, _)| step), Some(11));
    let hit = recording.episodes.iter_mut().find(|e| e.steps.iter().any(|s| !s.alerts.is_empty())).unwrap();
    let at = hit.steps.iter().position(|s| !s.alerts.is_empty()).unwrap();
    hit.steps[at].alerts.clear();
    assert_eq!(compare(hit, TOLERANCE).unwrap().first_mismatch.map(|(step, _)| step), Some(at + 1));
}
