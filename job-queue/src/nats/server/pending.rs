//! Jobs that were sent to workers and have no result yet.

use std::collections::{BTreeSet, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use async_nats::jetstream::message::Acker;
use jobs::JobKind;
use jobs::envelope::{FencingToken, JobId, ResultEnvelope};
use parking_lot::Mutex;
use tokio::sync::oneshot;

/// Longest time that a worker may hold a job, however often it reports to work on it.
const MAX_JOB_AGE: Duration = Duration::from_secs(300);
/// The same for a rollout or a design, whose language model may take minutes for a step.
const MAX_MODEL_JOB_AGE: Duration = Duration::from_secs(3600);

/// End of a job that was sent.
pub(super) enum RemoteEnd {
    /// A worker has replied.
    Reply(Box<RemoteReply>),
    /// The server takes the job back.
    TakenBack,
}

/// Reply of a worker.
pub(super) struct RemoteReply {
    /// Id of the worker, from the subject of its message.
    pub(super) worker: String,
    /// The reply with the names of its job.
    pub(super) envelope: ResultEnvelope,
    /// Acknowledges the message of the reply.
    pub(super) acker: Acker,
}

/// A job that was sent.
struct PendingJob {
    kind: JobKind,
    token: FencingToken,
    sent_at: Instant,
    /// Sequence number of its message, when JetStream has stored it.
    sequence: Option<u64>,
    end: oneshot::Sender<RemoteEnd>,
}

/// Jobs that were sent, by id.
pub(super) struct PendingJobs {
    epoch: u64,
    next: AtomicU64,
    jobs: Mutex<HashMap<JobId, PendingJob>>,
}

/// A job that is about to be sent.
pub(super) struct SentJob {
    pub(super) id: JobId,
    pub(super) token: FencingToken,
    pub(super) end: oneshot::Receiver<RemoteEnd>,
}

impl PendingJobs {
    /// Creates an empty table for one start of the server.
    pub(super) fn new(epoch: u64) -> Self {
        Self { epoch, next: AtomicU64::new(1), jobs: Mutex::default() }
    }

    /// Adds a job that is about to be sent.
    pub(super) fn insert(&self, kind: JobKind) -> SentJob {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let id = JobId { epoch: self.epoch, number };
        let token = FencingToken(rand::random());
        let (sender, end) = oneshot::channel();
        let job = PendingJob { kind, token, sent_at: Instant::now(), sequence: None, end: sender };
        self.jobs.lock().insert(id, job);
        SentJob { id, token, end }
    }

    /// Sets the sequence number of a job's message.
    pub(super) fn set_sequence(&self, id: JobId, sequence: u64) {
        if let Some(job) = self.jobs.lock().get_mut(&id) {
            job.sequence = Some(sequence);
        }
    }

    /// Removes a job whose caller does not wait any more. Returns the sequence number of its message.
    pub(super) fn remove(&self, id: JobId) -> Option<u64> {
        self.jobs.lock().remove(&id)?.sequence
    }

    /// Passes a reply to the caller of its job. Returns the reply if its job is not pending, or has another token.
    pub(super) fn complete(&self, reply: RemoteReply) -> Option<RemoteReply> {
        let id = reply.envelope.id;
        let mut jobs = self.jobs.lock();
        // A stale reply leaves the job as it is.
        let is_current = jobs.get(&id).is_some_and(|job| job.token == reply.envelope.token);
        let current = if is_current { jobs.remove(&id) } else { None };
        let Some(job) = current else { return Some(reply) };
        match job.end.send(RemoteEnd::Reply(Box::new(reply))) {
            Err(RemoteEnd::Reply(reply)) => Some(*reply),
            Ok(()) | Err(RemoteEnd::TakenBack) => None,
        }
    }

    /// Number of jobs of all kinds.
    pub(super) fn len(&self) -> usize {
        self.jobs.lock().len()
    }

    /// Number of jobs of a kind.
    pub(super) fn count(&self, kind: JobKind) -> usize {
        self.jobs.lock().values().filter(|job| job.kind == kind).count()
    }

    /// Takes all jobs back.
    pub(super) fn take_all_back(&self) {
        for (_, job) in self.jobs.lock().drain() {
            let _ = job.end.send(RemoteEnd::TakenBack);
        }
    }

    /// Takes back the jobs that no worker does: those of kinds without workers, those that are too old, and those that are older than
    /// `patience` and not `active`. Returns the sequence numbers of their messages.
    pub(super) fn take_back(
        &self,
        served: &BTreeSet<JobKind>,
        active: &BTreeSet<JobId>,
        patience: Duration,
    ) -> Vec<u64> {
        let mut jobs = self.jobs.lock();
        let is_lost = |id: &JobId, job: &PendingJob| {
            let age = job.sent_at.elapsed();
            let may_wait_for_model = job.kind.is_rollout() || job.kind.is_design();
            let max_age = if may_wait_for_model { MAX_MODEL_JOB_AGE } else { MAX_JOB_AGE };
            !served.contains(&job.kind) || age > max_age || (age > patience && !active.contains(id))
        };
        let lost: Vec<JobId> = jobs.iter().filter(|(id, job)| is_lost(id, job)).map(|(id, _)| *id).collect();
        let mut sequences = Vec::new();
        for id in lost {
            let Some(job) = jobs.remove(&id) else { continue };
            sequences.extend(job.sequence);
            let _ = job.end.send(RemoteEnd::TakenBack);
        }
        sequences
    }
}
