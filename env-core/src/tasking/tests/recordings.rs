//! The recorded episodes of BSK-RL.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::tasking::recording::compare_recording;
use crate::world::{RecordingComparison, WorstDifference};

/// Paths of the recordings in a folder of the fixtures, in order.
pub(super) fn recordings(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tasking").join(folder);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path()).collect();
    files.sort();
    files
}

/// Reads a gzipped recording.
pub(super) fn load(path: &Path) -> Value {
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    flate2::read::GzDecoder::new(file).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Reads a recording of the folder `reference` by its name.
pub(super) fn reference(name: &str) -> Value {
    load(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/tasking/reference/{name}.json.gz")))
}

/// Replays a recording of the folder `reference`, and asserts that no value is beyond its tolerance.
pub(super) fn replay_reference(name: &str) -> RecordingComparison {
    let comparison = compare_recording(&reference(name), 0.0).unwrap();
    assert_eq!(comparison.first, None, "{name}");
    comparison
}

/// The worst difference of a quantity.
pub(super) fn worst(comparison: &RecordingComparison, quantity: &str) -> WorstDifference {
    *comparison.worst.iter().find(|worst| worst.quantity == quantity).unwrap()
}

/// Asserts the number of compared values of a quantity over several comparisons, and a bound of their differences.
pub(super) fn assert_compared(
    comparisons: &[RecordingComparison],
    quantity: &str,
    values: usize,
    bound: f64,
) {
    let found: Vec<WorstDifference> =
        comparisons.iter().map(|comparison| worst(comparison, quantity)).collect();
    let count: usize = found.iter().map(|worst| worst.values).sum();
    assert_eq!(count, values, "values of {quantity}");
    for worst in found {
        assert!(worst.difference <= bound, "{quantity}: {:e} of at most {bound:e}", worst.difference);
    }
}

/// Recorded episodes of the scanning environment.
pub(super) const SCANNING: [&str; 5] =
    ["a_random_seed0", "a_random_seed1", "a_random_seed2", "a_random_seed3", "a_heuristic_seed100"];
/// Recorded episodes of three imaging satellites.
pub(super) const IMAGING: [&str; 3] = ["b_gym_seed0", "b_pz_seed0", "b_los_pz_seed10"];
