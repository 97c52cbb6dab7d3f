//! Versions of the policies of runs, which the worker follows to end rollouts of old ones.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::time::Duration;

use async_nats::jetstream::Context;
use tokio::sync::watch;

use crate::nats::feed::{PublishedRunState, follow_run_states};
use crate::nats::names::ClusterName;

/// Pause before the states are followed again, for example until the server has created their bucket.
const RETRY_PAUSE: Duration = Duration::from_secs(1);

/// States of runs as far as the worker knows them, by run.
#[derive(Debug, Default)]
pub(super) struct RunVersions(watch::Sender<BTreeMap<String, PublishedRunState>>);

/// Policy version of a job, and the server of its run.
#[derive(Debug, Clone, Copy)]
pub(super) struct JobVersion<'a> {
    pub(super) run: &'a str,
    pub(super) server: &'a str,
    pub(super) version: i64,
}

impl JobVersion<'_> {
    /// True if a server has set a newer version. A state that arrives late has an older one, and supersedes nothing.
    fn is_superseded(self, states: &BTreeMap<String, PublishedRunState>) -> bool {
        let state = states.get(self.run).filter(|state| state.server == self.server);
        state.is_some_and(|state| state.version > self.version)
    }
}

impl RunVersions {
    /// Waits until the policy of a job has a newer version.
    pub(super) async fn superseded(&self, job: JobVersion<'_>) {
        let mut states = self.0.subscribe();
        // The sender lives as long as `self`.
        let _ = states.wait_for(|states| job.is_superseded(states)).await;
    }

    /// Follows the states of all runs for as long as the future is polled.
    pub(super) async fn follow(&self, context: &Context, cluster: &ClusterName) -> Infallible {
        let note = |run: String, state: Option<PublishedRunState>| {
            self.0.send_modify(|states| match state {
                Some(state) => drop(states.insert(run, state)),
                None => drop(states.remove(&run)),
            });
        };
        loop {
            if let Err(error) = follow_run_states(context, cluster, note).await {
                tracing::debug!(%error, "The states of runs cannot be followed yet.");
            }
            tokio::time::sleep(RETRY_PAUSE).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_newer_version_of_the_same_server_supersedes() {
        let state = |version| PublishedRunState {
            state: "active".to_owned(),
            policy_version: 0,
            policy: "chat".to_owned(),
            version,
            created_at: 0,
            server: "s".to_owned(),
        };
        let states = [("run".to_owned(), state(4))].into_iter().collect();
        let job = JobVersion { run: "run", server: "s", version: 3 };
        assert!(job.is_superseded(&states));
        for current in [
            JobVersion { version: 4, ..job },
            JobVersion { version: 5, ..job },
            JobVersion { server: "other", ..job },
            JobVersion { run: "other", ..job },
        ] {
            assert!(!current.is_superseded(&states), "{current:?}");
        }
    }
}
