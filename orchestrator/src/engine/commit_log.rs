//! The latest commits of the writer: how long they took, for the page of the server's health.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Time over which commits are summed.
pub const WINDOW: Duration = Duration::from_mins(1);
/// Largest number of commits that are remembered. A busy server commits a few hundred times a second.
const MAX_COMMITS: usize = 32_768;

/// Log of the latest commits. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct CommitLog(Arc<Mutex<VecDeque<Commit>>>);

#[derive(Debug, Clone, Copy)]
struct Commit {
    at: Instant,
    duration: Duration,
    changes: usize,
    succeeded: bool,
}

/// Commits of the last minute.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CommitSummary {
    /// Number of all commits.
    pub commits: usize,
    /// Number of the changes in them.
    pub changes: usize,
    /// Number of commits that failed.
    pub failed: usize,
    /// Median of their durations; none without commits.
    pub median: Option<Duration>,
    /// 99 % quantile of their durations; none without commits.
    pub p99: Option<Duration>,
}

impl CommitLog {
    /// Records a commit that ended now.
    pub(crate) fn record(&self, changes: usize, duration: Duration, succeeded: bool) {
        let mut commits = self.0.lock();
        if commits.len() == MAX_COMMITS {
            commits.pop_front();
        }
        commits.push_back(Commit { at: Instant::now(), duration, changes, succeeded });
    }

    /// Returns the commits of the last minute.
    #[must_use]
    pub fn summarize(&self) -> CommitSummary {
        let recent: Vec<Commit> = {
            let mut commits = self.0.lock();
            while commits.front().is_some_and(|commit| commit.at.elapsed() > WINDOW) {
                commits.pop_front();
            }
            commits.iter().copied().collect()
        };
        let mut durations: Vec<Duration> = recent.iter().map(|commit| commit.duration).collect();
        durations.sort_unstable();
        let quantile = |percent: usize| {
            let rank = (durations.len() * percent).div_ceil(100).max(1);
            durations.get(rank - 1).copied()
        };
        CommitSummary {
            commits: recent.len(),
            changes: recent.iter().map(|commit| commit.changes).sum(),
            failed: recent.iter().filter(|commit| !commit.succeeded).count(),
            median: quantile(50),
            p99: quantile(99),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commits_are_summed_with_their_quantiles() {
        let log = CommitLog::default();
        assert_eq!(log.summarize(), CommitSummary::default());
        for ms in (1..=200).rev() {
            log.record(2, Duration::from_millis(ms), ms != 7);
        }
        let summary = log.summarize();
        assert_eq!((summary.commits, summary.changes, summary.failed), (200, 400, 1));
        assert_eq!(
            (summary.median, summary.p99),
            (Some(Duration::from_millis(100)), Some(Duration::from_millis(198)))
        );
    }

    #[test]
    fn log_is_bounded() {
        let log = CommitLog::default();
        (0..=MAX_COMMITS).for_each(|_| log.record(1, Duration::ZERO, true));
        assert_eq!(log.summarize().commits, MAX_COMMITS);
    }
}
