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

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: Plan = Plan { inputs: 100_000, seed: 0, timeout: TIMEOUT };

    fn seeds() -> Vec<Vec<u8>> {
        vec![b"{\"name\":\"value\",\"list\":[1,2,3]}".to_vec()]
    }

    #[test]
    fn panic_on_a_rare_byte_is_found() {
        let target = Target::new(
            "planted",
            |bytes| {
                assert!(!bytes.contains(&0xf7), "the planted panic");
                true
            },
            seeds,
        );
        let failure = fuzz(&target, PLAN).expect_err("the byte is drawn");
        assert_eq!(failure.kind, FailureKind::Panic);
        assert!(failure.input.contains(&0xf7));
        assert!(failure.to_string().contains("\\xf7"), "{failure}");
        let folder = std::env::temp_dir().join(format!("sparring-fuzz-{}", std::process::id()));
        let path = failure.save(&folder).expect("the folder can be written");
        assert_eq!(fs::read(path).expect("the file exists"), failure.input);
        fs::remove_dir_all(folder).expect("the folder exists");
    }

    #[test]
    fn panic_behind_valid_json_is_found() {
        let target = Target::new(
            "planted",
            |bytes| {
                let Ok(value) = serde_json::from_slice::<serde_json::Value>(bytes) else { return false };
                assert!(value["list"][1] != -1, "the planted panic");
                true
            },
            seeds,
        );
        assert_eq!(fuzz(&target, PLAN).expect_err("the number is drawn").kind, FailureKind::Panic);
    }

    #[test]
    fn slow_input_and_rejected_seed_fail() {
        let slow = |_: &[u8]| {
            std::thread::sleep(Duration::from_millis(20));
            true
        };
        let failure =
            fuzz(&Target::new("slow", slow, seeds), Plan { timeout: Duration::from_millis(10), ..PLAN })
                .expect_err("each run is slow");
        assert_eq!(failure.kind, FailureKind::Timeout);
        let failure = fuzz(&Target::new("strict", |_| false, seeds), PLAN).expect_err("no seed is accepted");
        assert_eq!(failure.kind, FailureKind::RejectedSeed);
    }

    #[test]
    fn same_seed_gives_the_same_inputs() {
        let inputs = |seed| {
            let mut corpus = Corpus::new(seeds(), seed);
            (0..1000).map(|_| corpus.next_input()).collect::<Vec<_>>()
        };
        assert_eq!(inputs(1), inputs(1));
        assert_ne!(inputs(1), inputs(2));
    }
}
