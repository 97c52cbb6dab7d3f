//! What every world answers to beyond its tasks: recordings made elsewhere, and what a benchmark of it steps.

use serde_json::Value;

use crate::task::TaskSpec;

/// A world: a module of tasks that share one engine.
pub trait World: Send + Sync {
    /// The world and its version, as `kessler@1`.
    fn id(&self) -> &'static str;
    /// Its tasks.
    fn tasks(&self) -> Vec<&'static dyn TaskSpec>;
    /// The task and params that benchmarks of this world step.
    fn bench(&self) -> BenchSpec;
    /// Replays a file of episodes recorded elsewhere and compares number by number; `None` if the file is not one of
    /// this world's.
    fn compare(&self, recording: &Value, tolerance: f64) -> Option<Result<Compared, RecordError>>;

    /// Its name without the version.
    fn name(&self) -> &'static str {
        self.id().split('@').next().unwrap_or_default()
    }
}

/// What a benchmark steps.
#[derive(Debug, Clone, Copy)]
pub struct BenchSpec {
    /// The task.
    pub task: &'static str,
    /// Its params; the others are at their defaults.
    pub params: &'static [(&'static str, f64)],
    /// Actions are uniform within plus and minus this.
    pub action: f64,
    /// What a step of the public original costs in-process, µs, as measured for this project on one core; none where
    /// it was not measured.
    pub original_us_per_step: Option<f64>,
}

/// What a file of recorded episodes came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Episodes replayed.
    pub episodes: usize,
    /// Steps compared.
    pub steps: usize,
    /// The worst absolute difference of each quantity, in the order people should read them.
    pub worst: Vec<(&'static str, f64)>,
    /// The first step that differs by more than its tolerance, or in a word.
    pub first: Option<FirstDifference>,
    /// Differences that are meant, each with its reason; they do not count as differing.
    pub documented: Vec<String>,
}

/// Where a recording and its replay part.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstDifference {
    /// Counted from 0.
    pub episode: usize,
    /// Counted from 1.
    pub step: usize,
    /// What differs.
    pub what: String,
}

/// A recording that cannot be replayed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RecordError {
    /// The file is not what its world's recordings look like.
    #[error("{0}")]
    Malformed(String),
    /// One episode cannot be replayed.
    #[error("episode {episode}: {reason}")]
    Episode {
        /// Counted from 0.
        episode: usize,
        /// Why.
        reason: String,
    },
}
