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
    /// The worst difference of each quantity, in the order people should read them.
    pub worst: Vec<Worst>,
    /// The first step that differs by more than its tolerance, or in a word.
    pub first: Option<FirstDifference>,
    /// Differences that are meant, each with its reason; they do not count as differing.
    pub documented: Vec<String>,
}

/// The difference of a quantity that is worst for what is allowed of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worst {
    /// The quantity: a plain word.
    pub quantity: &'static str,
    /// The absolute difference; infinite where one is not a number.
    pub difference: f64,
    /// The largest that passes there: the tolerance asked for, or what the recording's own precision leaves, if that is
    /// more.
    pub allowed: f64,
}

impl Worst {
    /// Nothing compared yet; `allowed` by the tolerance asked for.
    #[must_use]
    pub const fn none(quantity: &'static str, allowed: f64) -> Self {
        Self { quantity, difference: 0.0, allowed }
    }

    /// Takes another difference of the same quantity in, where it is worse.
    pub fn take(&mut self, difference: f64, allowed: f64) {
        // Beyond what is allowed is worse than within; then by how many times; then plainly.
        let rank = |difference: f64, allowed: f64| {
            (difference > allowed, difference / allowed.max(f64::MIN_POSITIVE))
        };
        if difference > 0.0 && rank(difference, allowed) > rank(self.difference, self.allowed) {
            (self.difference, self.allowed) = (difference, allowed);
        }
    }
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
