//! Runs a target on many mutated inputs, without coverage.

use std::fmt;
use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::corpus::Corpus;
use crate::target::Target;

/// Longest time for one input. Limits of sizes keep every parser far below it, without optimisation too.
pub const TIMEOUT: Duration = Duration::from_secs(2);
/// Number of runs of a slow input: on a busy machine, one run alone proves nothing.
const SLOW_RUNS: usize = 3;

/// Amount of inputs of a run.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// Number of mutated inputs.
    pub inputs: u64,
    /// Seed of the random numbers; the same seed gives the same inputs.
    pub seed: u64,
    /// Longest time for one input; [`TIMEOUT`] by default.
    pub timeout: Duration,
}

/// Summary of a run without a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Summary {
    /// Number of mutated inputs.
    pub inputs: u64,
    /// Number of mutated inputs that the parser accepted.
    pub accepted: u64,
}

/// Reason why an input fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailureKind {
    /// The parser panicked, or its law is violated.
    Panic,
    /// The parser takes longer than the timeout of the plan.
    Timeout,
    /// The parser rejects a seed, so that its mutations would not get far.
    RejectedSeed,
}

/// Input that fails, with its target.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// Name of the target.
    pub target: &'static str,
    /// Reason of the failure.
    pub kind: FailureKind,
    /// Number of inputs before this one.
    pub number: u64,
    /// Bytes of the input.
    pub input: Vec<u8>,
}

impl Failure {
    /// Writes the input to a file in `folder` and returns the path of the file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn save(&self, folder: &Path) -> io::Result<PathBuf> {
        fs::create_dir_all(folder)?;
        let path = folder.join(format!("{}-{}.bin", self.target, self.number));
        fs::write(&path, &self.input)?;
        Ok(path)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { target, kind, number, input } = self;
        write!(
            f,
            "{target}: {kind:?} at input {number} of {} bytes: b\"{}\"",
            input.len(),
            input.escape_ascii()
        )
    }
}

/// Runs a target on its seeds, then on mutated inputs.
///
/// # Errors
/// Returns the first input that fails.
pub fn fuzz(target: &Target, plan: Plan) -> Result<Summary, Failure> {
    let seeds = (target.seeds)();
    for (number, seed) in (0..).zip(&seeds) {
        if !check(target, plan, number, seed)? {
            let (kind, input) = (FailureKind::RejectedSeed, seed.clone());
            return Err(Failure { target: target.name, kind, number, input });
        }
    }
    let mut corpus = Corpus::new(seeds, plan.seed);
    let mut summary = Summary { inputs: plan.inputs, accepted: 0 };
    for number in 0..plan.inputs {
        let input = corpus.next_input();
        if check(target, plan, number, &input)? {
            summary.accepted += 1;
            corpus.keep(input);
        }
    }
    Ok(summary)
}

/// Runs a target on one input. Returns true if the parser accepted it.
fn check(target: &Target, plan: Plan, number: u64, input: &[u8]) -> Result<bool, Failure> {
    let failure = |kind| Failure { target: target.name, kind, number, input: input.to_vec() };
    let started = Instant::now();
    let accepted = catch_unwind(AssertUnwindSafe(|| (target.run)(input)));
    let accepted = accepted.map_err(|_| failure(FailureKind::Panic))?;
    if started.elapsed() > plan.timeout && is_slow(target, plan.timeout, input) {
        return Err(failure(FailureKind::Timeout));
    }
    Ok(accepted)
}

/// True if each of several runs takes too long.
fn is_slow(target: &Target, timeout: Duration, input: &[u8]) -> bool {
    (0..SLOW_RUNS).all(|_| {
        let started = Instant::now();
        (target.run)(input);
        started.elapsed() > timeout
    })
}
