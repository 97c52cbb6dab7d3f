//! Pauses of runs whose rollouts fail.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use clock::Millis;

/// Pause after the first group that fails. It doubles with each further failure.
const MIN_PAUSE: Duration = Duration::from_secs(1);
/// Maximum pause of a run.
const MAX_PAUSE: Duration = Duration::from_secs(60);

/// Pauses of failing runs, by run id.
#[derive(Debug, Default)]
pub(super) struct RunBackoff(BTreeMap<String, Pause>);

#[derive(Debug)]
struct Pause {
    until: Instant,
    length: Duration,
    /// When the policy that failed was set: another policy is tried at once.
    policy_set_at: Millis,
}

impl RunBackoff {
    /// Returns true if a run is paused now. A policy that was set after the failure ends the pause.
    pub(super) fn is_paused(&mut self, run: &str, policy_set_at: Millis) -> bool {
        match self.0.get(run) {
            Some(pause) if pause.policy_set_at != policy_set_at => {
                self.0.remove(run);
                false
            }
            Some(pause) => pause.until > Instant::now(),
            None => false,
        }
    }

    /// Pauses a run after a failure. Failures during a pause have the same cause and do not extend it.
    pub(super) fn pause(&mut self, run: &str, policy_set_at: Millis) {
        let known = self.0.get(run).filter(|pause| pause.policy_set_at == policy_set_at);
        if known.is_some_and(|pause| pause.until > Instant::now()) {
            return;
        }
        let length = known.map_or(MIN_PAUSE, |pause| (pause.length * 2).min(MAX_PAUSE));
        self.0.insert(run.to_owned(), Pause { until: Instant::now() + length, length, policy_set_at });
    }

    /// Ends the pause of a run after a success.
    pub(super) fn clear(&mut self, run: &str) {
        self.0.remove(run);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pause_doubles_until_the_policy_changes() {
        let mut backoff = RunBackoff::default();
        let mut pauses = Vec::new();
        for _ in 0..9 {
            backoff.pause("r", 1);
            backoff.pause("r", 1); // at the same time: the same cause
            assert!(backoff.is_paused("r", 1));
            let pause = backoff.0.get_mut("r").unwrap();
            pauses.push(pause.length.as_secs());
            pause.until = Instant::now();
        }
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 60, 60, 60]);
        assert!(!backoff.is_paused("r", 1), "the pause is over");
        backoff.pause("r", 1);
        assert!(!backoff.is_paused("r", 2), "another policy is tried at once");
        backoff.pause("r", 2);
        assert_eq!(backoff.0["r"].length, MIN_PAUSE);
    }
}
