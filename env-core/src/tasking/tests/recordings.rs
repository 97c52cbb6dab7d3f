//! The recorded episodes of BSK-RL.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde_json::Value;

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
