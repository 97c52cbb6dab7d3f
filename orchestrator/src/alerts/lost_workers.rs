//! Alerts about workers on other machines: those that are lost, and a server that does all jobs itself although it had workers.

use job_queue::status::{QueueStatus, WorkerState, WorkerStatus};
use store::alerts::{AlertRule, NewAlert};

/// Subject of the alert about all workers.
pub(super) const ALL_WORKERS: &str = "all workers";

/// Finds lost workers from the states of the queue.
#[derive(Debug, Default)]
pub(super) struct LostWorkers {
    /// True once a worker was active or had a job: a server that still waits for its first worker has lost none.
    had_workers: bool,
}

impl LostWorkers {
    /// Returns the alerts of a state. `is_lasting` is true while an alert about all workers lasts, maybe from an earlier process.
    pub(super) fn find(&mut self, status: &QueueStatus, is_lasting: bool) -> Vec<NewAlert> {
        let is_active = status.workers.iter().any(|worker| worker.state == WorkerState::Active);
        self.had_workers |= is_active || status.counters.sent > 0;
        match &status.degraded {
            Some(reason) if self.had_workers || is_lasting => vec![alert(ALL_WORKERS, reason.clone())],
            Some(_) => Vec::new(),
            None => status.workers.iter().filter_map(lost_worker).collect(),
        }
    }
}

/// Returns an alert if a worker takes no jobs any more.
fn lost_worker(worker: &WorkerStatus) -> Option<NewAlert> {
    let WorkerStatus { id, host, .. } = worker;
    let message = match worker.state {
        WorkerState::Active | WorkerState::Refused => return None,
        WorkerState::Stalled => format!("worker {id} on {host} sends no heartbeats"),
        WorkerState::Expelled => {
            let reason = worker.reason.as_deref().unwrap_or("a result was wrong");
            format!("worker {id} on {host} is expelled: {reason}")
        }
    };
    Some(alert(id, message))
}

fn alert(subject: &str, message: String) -> NewAlert {
    NewAlert { rule: AlertRule::WorkerLost, run: None, subject: subject.to_owned(), message, is_event: false }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn worker(id: &str, state: WorkerState) -> WorkerStatus {
        WorkerStatus {
            id: id.to_owned(),
            host: "host".to_owned(),
            version: String::new(),
            world: String::new(),
            kinds: Vec::new(),
            concurrency: 1,
            chat_model: None,
            active: 0,
            state,
            reason: None,
            jobs: 0,
            errors: 0,
            jobs_per_s: 0.0,
            verified: 0,
            last_seen: Duration::ZERO,
        }
    }

    fn subjects(found: &[NewAlert]) -> Vec<&str> {
        found.iter().map(|alert| alert.subject.as_str()).collect()
    }

    #[test]
    fn only_workers_that_worked_are_lost() {
        let mut lost = LostWorkers::default();
        let away = QueueStatus { degraded: Some("no worker is connected".into()), ..QueueStatus::default() };
        assert!(lost.find(&away, false).is_empty(), "the first worker has not come yet");
        assert_eq!(subjects(&lost.find(&away, true)), [ALL_WORKERS], "it lasts across a restart");
        let states = [WorkerState::Active, WorkerState::Stalled, WorkerState::Refused, WorkerState::Expelled];
        let workers = states.iter().map(|state| worker(state.as_str(), *state)).collect();
        let some = QueueStatus { workers, ..QueueStatus::default() };
        assert_eq!(subjects(&lost.find(&some, false)), ["stalled", "expelled"]);
        assert_eq!(subjects(&lost.find(&away, false)), [ALL_WORKERS]);
        assert_eq!(lost.find(&away, false)[0].message, "no worker is connected");
    }
}
