//! Recordings of BSK-RL, and episodes of tasking through all options.

mod agents;
mod episode;
mod options;
mod setups;

use env_core::World;
use env_core::tasking::TASKING;
use serde_json::{Value, json};

pub use self::episode::{EpisodeCoverage, fly_episode};
pub use self::options::random_bytes;
use crate::target::{Target, json_seeds, with_json};

/// Targets that run simulations, with a part of the inputs of others.
pub(super) const TARGETS: &[Target] = &[
    Target::new("tasking_recording", recording, recording_seeds).divided_by(50),
    Target::new("tasking_episode", |bytes| fly_episode(bytes).is_some(), episode_seeds).divided_by(50),
];

/// Steps and targets that are kept of the recording.
const KEPT: usize = 3;
/// A recording with deaths of imaging satellites.
const RECORDING: &[u8] =
    include_bytes!("../../../../env-core/fixtures/tasking/recorded/deaths_constellation.json.gz");

/// A recording is replayed or refused with one sentence.
fn recording(bytes: &[u8]) -> bool {
    with_json(bytes, |value| match TASKING.compare_recording(&value, 0.0) {
        None => false,
        Some(Ok(compared)) => {
            assert!(compared.steps <= KEPT + 1, "{} steps", compared.steps);
            assert!(compared.worst.iter().all(|worst| !worst.difference.is_nan()));
            true
        }
        Some(Err(error)) => {
            let length = error.to_string().len();
            assert!(length < 8192, "the error has {length} bytes");
            false
        }
    })
}

/// The first steps of a recording, with few targets and without windows.
fn recording_seeds() -> Vec<Vec<u8>> {
    let mut value: Value =
        serde_json::from_reader(flate2::read::GzDecoder::new(RECORDING)).expect("the fixture is a recording");
    for list in ["steps", "targets"] {
        if let Some(items) = value[list].as_array_mut() {
            items.truncate(KEPT);
        }
    }
    value["opportunities"] = json!({});
    json_seeds([value])
}

/// Bytes drawn at random whose set-up is valid.
fn episode_seeds() -> Vec<Vec<u8>> {
    // Some set-ups have a storage without capacity, or satellites without links.
    (0..40).map(random_bytes).filter(|bytes| setups::is_valid(bytes)).collect()
}
