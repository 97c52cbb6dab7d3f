//! Runs all planned episodes, several of them concurrently.

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use futures_util::StreamExt;
use llm::LlmError;
use tokio::sync::watch;

use super::episode::{self, EpisodeJob, EpisodeResult, PlayError};
use super::episode_policy::{DecisionError, PolicySource};
use super::transcript::Transcript;
use llm_policy::ActionCodec;

/// Consecutive episodes without a first step after which no further episode is started. The limit is the concurrency, if
/// that is larger.
const MAX_FAILED_STARTS: usize = 3;

/// Episode to run, with the action codec of its task.
#[derive(Debug)]
pub(super) struct PlannedEpisode<'a> {
    pub(super) job: EpisodeJob<'a>,
    pub(super) actions: &'a ActionCodec,
}

/// Runs the episodes in order, at most `concurrency` at once. Returns the results in the same order; episodes that were not
/// started have `None`.
///
/// # Errors
/// Returns an error if a policy cannot be created.
pub(super) async fn run_episodes(
    planned: &[PlannedEpisode<'_>],
    policy_source: &PolicySource,
    output: &Transcript,
    concurrency: usize,
    stop: &watch::Receiver<bool>,
) -> anyhow::Result<Vec<Option<EpisodeResult>>> {
    let monitor = FailureMonitor {
        max_failed_starts: concurrency.max(MAX_FAILED_STARTS) as u64,
        ..FailureMonitor::default()
    };
    let episodes = planned.iter().enumerate().map(|(place, planned)| {
        let (monitor, mut stop) = (&monitor, stop.clone());
        async move {
            if monitor.has_given_up.load(Ordering::Relaxed) || *stop.borrow() {
                return anyhow::Ok((place, None));
            }
            let policy =
                policy_source.episode_policy(planned.job.task, planned.actions, planned.job.number)?;
            let mut writer = output.writer();
            let result = episode::run_episode(&planned.job, policy, &mut writer, &mut stop).await;
            if monitor.observe(&result) {
                log_result(&planned.job, &result);
            }
            Ok((place, Some(result)))
        }
    });
    let mut all: Vec<Option<EpisodeResult>> = planned.iter().map(|_| None).collect();
    let mut running = futures_util::stream::iter(episodes).buffer_unordered(concurrency);
    while let Some(result) = running.next().await {
        let (place, result) = result?;
        all[place] = result;
    }
    Ok(all)
}

/// Decides whether further episodes are started after failures.
#[derive(Debug, Default)]
struct FailureMonitor {
    steps: AtomicU64,
    /// Consecutive episodes without a first step.
    failed_starts: AtomicU64,
    /// Value of `failed_starts` at which the monitor gives up.
    max_failed_starts: u64,
    /// True once no further episode is to be started.
    has_given_up: AtomicBool,
}

impl FailureMonitor {
    /// Records an episode. Returns true if any episode has taken a step so far; until then the command reports nothing but
    /// the first fault.
    fn observe(&self, result: &EpisodeResult) -> bool {
        let steps = result.rewards.len() as u64;
        let before = self.steps.fetch_add(steps, Ordering::Relaxed);
        let closed = matches!(
            &result.fault,
            Some(PlayError::Policy(DecisionError::Model(LlmError::CircuitOpen { .. })))
        );
        let output = matches!(&result.fault, Some(PlayError::Transcript(_)));
        let failed_starts = if steps == 0 && result.fault.is_some() {
            self.failed_starts.fetch_add(1, Ordering::Relaxed) + 1
        } else {
            self.failed_starts.store(0, Ordering::Relaxed);
            0
        };
        // The server is unreachable, or the circuit breaker is open: further episodes would fail in the same way.
        if result.fault.is_some()
            && (before + steps == 0 || failed_starts >= self.max_failed_starts || closed || output)
        {
            self.has_given_up.store(true, Ordering::Relaxed);
        }
        before + steps > 0
    }
}

/// Prints the result of an episode as one line on stderr.
fn log_result(job: &EpisodeJob<'_>, result: &EpisodeResult) {
    let EpisodeJob { number, task, .. } = job;
    let steps = result.rewards.len();
    let held =
        if result.held > 0 { format!(", {} of them without an action", result.held) } else { String::new() };
    let how = match &result.fault {
        None => format!("score {:.3} after {steps} steps{held}", result.score),
        Some(fault) => format!("aborted ({steps} steps{held}): {fault}"),
    };
    // A closed stderr is no failure.
    let _ = writeln!(std::io::stderr().lock(), "Episode {number}, {}: {how}", task.name);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::play::session::SessionError;

    /// A server that stops responding is not tried again for every remaining episode.
    #[test]
    fn repeated_failed_starts_end_the_run() {
        let monitor = FailureMonitor { max_failed_starts: 3, ..FailureMonitor::default() };
        let late = || EpisodeResult {
            fault: Some(SessionError::Late { after_s: 1 }.into()),
            ..EpisodeResult::default()
        };
        let result = || EpisodeResult { rewards: vec![0.0], ..EpisodeResult::default() };
        for episode in [result(), late(), late(), result(), late(), late()] {
            monitor.observe(&episode);
            assert!(!monitor.has_given_up.load(Ordering::Relaxed));
        }
        monitor.observe(&late());
        assert!(monitor.has_given_up.load(Ordering::Relaxed));
    }
}
