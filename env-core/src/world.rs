//! The interface of a world: its tasks, recordings of its public original, and benchmarks.

use serde_json::Value;

use crate::task::TaskSpec;

/// A world: tasks that share one simulation.
pub trait World: Send + Sync {
    /// Id of the world with its version, such as `kessler@1`.
    fn id(&self) -> &'static str;

    /// Name of the world without the version.
    fn name(&self) -> &'static str {
        self.id().split('@').next().unwrap_or_default()
    }

    /// Tasks of the world.
    fn tasks(&self) -> Vec<&'static dyn TaskSpec>;

    /// Replays a file of recorded episodes, and compares all values. Returns `None` if the file is not a recording of this world.
    /// `tolerance` is the largest difference of a number that is accepted, unless the world defines a larger one for its quantity.
    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>>;

    /// Benchmarks of this world; the first one is used if none is named.
    fn benchmarks(&self) -> Vec<BenchSpec>;
}

/// Task and actions of a benchmark.
#[derive(Clone, Copy)]
pub struct BenchSpec {
    /// The task that is stepped.
    pub task: &'static dyn TaskSpec,
    /// Params as pairs of name and value; the others have their defaults.
    pub params: &'static [(&'static str, f64)],
    /// Largest magnitude of the uniform random actions of a box. Of named actions each is as likely.
    pub action: f64,
    /// Duration of a step of the public original in one process on one core, µs, as measured for this project; `None` if it
    /// was not measured.
    pub original_us_per_step: Option<f64>,
}

/// Result of a comparison with a file of recorded episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingComparison {
    /// Number of replayed episodes.
    pub episodes: usize,
    /// Number of compared steps.
    pub steps: usize,
    /// The worst difference of each quantity, in the order of presentation.
    pub worst: Vec<WorstDifference>,
    /// The first step with a value beyond its tolerance, or with a different flag or text.
    pub first: Option<FirstDifference>,
    /// Intended differences, each with its reason; they do not count as differences.
    pub documented: Vec<String>,
}

/// The worst difference of a quantity, relative to its tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorstDifference {
    /// Name of the quantity.
    pub quantity: &'static str,
    /// Absolute difference; infinite if one value is NaN.
    pub difference: f64,
    /// Largest allowed difference: the requested tolerance, or the precision of the recording if that is larger.
    pub allowed: f64,
    /// True if a value was compared: a recording need not have all quantities.
    pub is_compared: bool,
    /// Number of compared values.
    pub values: usize,
}

impl WorstDifference {
    /// Creates a record without compared values; `allowed` is the requested tolerance.
    #[must_use]
    pub const fn new(quantity: &'static str, allowed: f64) -> Self {
        Self { quantity, difference: 0.0, allowed, is_compared: false, values: 0 }
    }

    /// Replaces the record by another difference of the same quantity if that is worse.
    pub fn update(&mut self, difference: f64, allowed: f64) {
        self.is_compared = true;
        self.values += 1;
        // A difference beyond the allowed one is worse than one within; then the ratio decides, which may overflow.
        let rank = |difference: f64, allowed: f64| {
            (difference > allowed, difference / allowed.max(f64::MIN_POSITIVE), difference)
        };
        if difference > 0.0 && rank(difference, allowed) > rank(self.difference, self.allowed) {
            (self.difference, self.allowed) = (difference, allowed);
        }
    }
}

/// First difference of a recording and its replay.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstDifference {
    /// Index of the episode, counted from 0.
    pub episode: usize,
    /// Number of the step, counted from 1.
    pub step: usize,
    /// Description of the difference.
    pub what: String,
}

/// A recording that cannot be replayed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ComparisonError {
    /// The file is not a recording of its world.
    #[error("{0}")]
    Malformed(String),
    /// An episode cannot be replayed.
    #[error("episode {episode}: {reason}")]
    Episode {
        /// Index of the episode, counted from 0.
        episode: usize,
        /// Reason why it cannot be replayed.
        reason: String,
    },
}
