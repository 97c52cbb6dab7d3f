//! Server side: jobs go to workers if that pays, and are done here if no worker can do them.
//!
//! [`NatsQueue`] decides for each job. `session` holds the connection to NATS, `pending` the jobs without a result, `registry` the
//! workers, `costs` the estimates by which cheap jobs stay here, `verify` the trust in workers, `unverified` the results that
//! were only trusted, `designs` the layouts that workers design, and `rollouts` the groups that they roll out.

mod costs;
mod designs;
pub(crate) mod fuzzing;
mod pending;
mod registry;
mod rollouts;
mod session;
mod unverified;
mod verify;

use std::sync::Arc;
use std::time::Duration;

use async_nats::HeaderMap;
use async_nats::jetstream::Context;
use async_nats::jetstream::message::Acker;
use async_nats::jetstream::stream::Stream;
use futures_util::FutureExt;
use futures_util::future::{BoxFuture, join_all};
use jobs::envelope::{JobAddress, JobEnvelope, JobId, JobReply};
use jobs::world_version::world_version;
use jobs::{JobKind, JobOutput, JobPayload};
use parking_lot::Mutex;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;

use self::costs::CostEstimates;
pub use self::designs::{DesignQueue, RemoteDesign, RemoteDesignError};
use self::pending::{PendingJobs, RemoteEnd, RemoteReply, SentJob};
use self::registry::WorkerRegistry;
pub use self::rollouts::{RemoteRollout, RemoteRolloutError, RolloutQueue};
use self::unverified::UnverifiedJob;
use self::verify::ItemsToVerify;
use super::connection::NatsConfig;
use super::names::subject_word;
use super::objects::{OBJECT_HEADER, ObjectBucket, ObjectGuard};
use crate::local::{LocalQueue, TimedOutput};
use crate::queue::{CompletedJob, JobError, JobQueue, Receipt};
use crate::status::{QueueCounters, QueueNotice, QueueStatus};

/// Largest number of episodes of a job that goes to a worker.
const MAX_ITEMS_SENT: usize = 32;
/// Jobs that may wait for each slot of a worker; the server does further ones itself.
const JOBS_PER_SLOT: usize = 4;
/// Time in which JetStream must confirm that it stored a job.
const PUBLISH_TIMEOUT: Duration = Duration::from_secs(5);

/// Configuration of a queue on NATS.
#[derive(Debug, Clone)]
pub struct NatsQueueConfig {
    /// How to reach NATS.
    pub nats: NatsConfig,
    /// Name of the server among those of the cluster; the same after a restart.
    pub server: String,
    /// Number of this start of the server: higher than that of any earlier start.
    pub epoch: u64,
    /// Share of results that the server recomputes, from 0 to 1.
    pub verified_share: f64,
    /// Jobs whose expected time is shorter stay in this process.
    pub min_job: Duration,
    /// Time after which the server does a job itself that no worker works on.
    pub patience: Duration,
}

/// Queue that sends jobs to workers.
#[derive(Debug)]
pub struct NatsQueue {
    shared: Arc<Shared>,
    /// Holds the connection; it ends with the queue.
    session: JoinHandle<()>,
}

/// State that calls and the session share.
pub(super) struct Shared {
    config: NatsQueueConfig,
    local: LocalQueue,
    world: &'static str,
    link: Mutex<Link>,
    pending: PendingJobs,
    registry: Mutex<WorkerRegistry>,
    costs: CostEstimates,
    counters: Mutex<QueueCounters>,
    acknowledgements: UnboundedSender<Acker>,
    notices: UnboundedSender<QueueNotice>,
}

/// Connection to NATS as calls use it.
enum Link {
    /// Jobs can be sent.
    Up(Arc<Publisher>),
    /// Jobs cannot be sent, for this reason.
    Down(String),
}

/// Handles with which jobs are sent and deleted.
struct Publisher {
    context: Context,
    jobs: Stream,
    /// Jobs and results that are too large for a message.
    objects: ObjectBucket,
}

impl std::fmt::Debug for Shared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shared").field("config", &self.config).finish_non_exhaustive()
    }
}

impl NatsQueue {
    /// Starts a queue that connects in the background. Returns it with the notices of its workers.
    ///
    /// It needs a Tokio runtime. Until the connection is open, `local` does all jobs.
    #[must_use]
    pub fn start(config: NatsQueueConfig, local: LocalQueue) -> (Self, UnboundedReceiver<QueueNotice>) {
        let (acknowledgements, due) = unbounded_channel();
        let (notices, noticed) = unbounded_channel();
        let config = NatsQueueConfig { server: subject_word(&config.server), ..config };
        let world = world_version();
        let shared = Arc::new(Shared {
            link: Mutex::new(Link::Down(format!("connecting to {}", config.nats.url))),
            pending: PendingJobs::new(config.epoch),
            registry: Mutex::new(WorkerRegistry::new(config.server.clone(), world)),
            costs: CostEstimates::default(),
            counters: Mutex::default(),
            local,
            world,
            config,
            acknowledgements,
            notices,
        });
        let session = tokio::spawn(session::run(Arc::clone(&shared), due));
        (Self { shared, session }, noticed)
    }

    /// Returns the designs of the queue. They need the queue.
    #[must_use]
    pub fn designs(&self) -> DesignQueue {
        DesignQueue(Arc::clone(&self.shared))
    }

    /// Returns the rollouts of the queue. They need the queue.
    #[must_use]
    pub fn rollouts(&self) -> RolloutQueue {
        RolloutQueue(Arc::clone(&self.shared))
    }
}

impl Drop for NatsQueue {
    fn drop(&mut self) {
        self.session.abort();
    }
}

impl JobQueue for NatsQueue {
    fn run(&self, job: JobPayload) -> BoxFuture<'static, Result<CompletedJob, JobError>> {
        let shared = Arc::clone(&self.shared);
        async move { shared.run(job).await }.boxed()
    }

    fn status(&self) -> QueueStatus {
        let shared = &self.shared;
        QueueStatus {
            is_distributed: true,
            degraded: shared.degraded(),
            waiting: shared.pending.len(),
            workers: shared.registry.lock().list(),
            counters: *shared.counters.lock(),
        }
    }
}

impl Shared {
    /// Does a job, or the parts of it.
    async fn run(self: &Arc<Self>, job: JobPayload) -> Result<CompletedJob, JobError> {
        let Some(items) = self.items_to_send(&job) else { return self.run_locally(Arc::new(job)).await };
        let parts = job.split(items).into_iter().map(|part| self.run_part(Arc::new(part)));
        let (mut outputs, mut receipt) = (Vec::new(), Receipt::default());
        for done in join_all(parts).await {
            let done = done?;
            outputs.push(done.output);
            receipt.merge(done.receipt);
        }
        let output = JobOutput::join(outputs).ok_or(JobError::OtherKind)?;
        Ok(CompletedJob { output, receipt })
    }

    /// Returns the number of items of the jobs that go to workers; `None` if the job stays here.
    fn items_to_send(&self, job: &JobPayload) -> Option<usize> {
        if matches!(*self.link.lock(), Link::Down(_)) {
            return None;
        }
        let slots = self.registry.lock().slots(job.kind());
        if slots == 0 || job.is_empty() || self.pending.count(job.kind()) >= slots * JOBS_PER_SLOT {
            return None;
        }
        if self.config.min_job > Duration::ZERO {
            // The first job of a task is measured here.
            let expected = self.costs.of(job)?;
            if expected < self.config.min_job {
                return None;
            }
        }
        // Proposals of a job share its time limit, so they stay together.
        let is_divisible = job.kind() != JobKind::Prepare;
        Some(if is_divisible { job.len().div_ceil(slots).clamp(1, MAX_ITEMS_SENT) } else { job.len() })
    }

    async fn run_part(self: &Arc<Self>, job: Arc<JobPayload>) -> Result<CompletedJob, JobError> {
        match self.run_remotely(&job).await {
            Some(done) => done,
            None => self.run_locally(job).await,
        }
    }

    async fn run_locally(&self, job: Arc<JobPayload>) -> Result<CompletedJob, JobError> {
        let output = self.compute(job).await?;
        self.count(|counters| counters.done_locally += 1);
        Ok(CompletedJob { output, receipt: Receipt::default() })
    }

    /// Computes a job on threads of this process, and notes its cost.
    async fn compute(&self, job: Arc<JobPayload>) -> Result<JobOutput, JobError> {
        let TimedOutput { output, duration } = self.local.run_timed(Arc::clone(&job)).await?;
        self.costs.add(&job, self.local.threads(&job), duration);
        Ok(output)
    }

    /// Sends a job and waits for its result. `None` if the server has to do the job itself.
    async fn run_remotely(self: &Arc<Self>, job: &Arc<JobPayload>) -> Option<Result<CompletedJob, JobError>> {
        let reply = self.ask_worker(job.kind(), job.encode().ok()?).await?;
        self.take_reply(job, reply).await
    }

    /// Sends a job of a kind with its encoded payload, and waits for the reply. `None` if no worker replies.
    async fn ask_worker(&self, kind: JobKind, body: Vec<u8>) -> Option<RemoteReply> {
        let publisher = match &*self.link.lock() {
            Link::Up(publisher) => Arc::clone(publisher),
            Link::Down(_) => return None,
        };
        let sent = self.pending.insert(kind);
        let guard = PendingGuard { shared: self, id: sent.id };
        let end = self.send(&publisher, kind, body, sent).await;
        drop(guard);
        match end {
            Some(RemoteEnd::Reply(reply)) => Some(*reply),
            Some(RemoteEnd::TakenBack) | None => {
                self.count(|counters| counters.taken_back += 1);
                None
            }
        }
    }

    /// Publishes a job and waits for its end. `None` if it cannot be published.
    async fn send(
        &self,
        publisher: &Publisher,
        kind: JobKind,
        body: Vec<u8>,
        sent: SentJob,
    ) -> Option<RemoteEnd> {
        let SentJob { id, token, end } = sent;
        let server = self.config.server.as_str();
        let address = JobAddress { world: self.world, server, kind, id, token };
        let message = JobEnvelope::write(address, body).ok()?;
        let bytes = message.len() as u64;
        let mut headers = HeaderMap::new();
        headers.insert(async_nats::header::NATS_MESSAGE_ID, id.to_string());
        let subject = self.config.nats.cluster.jobs(kind, server);
        let object = format!("job-{id}");
        let payload = publisher.objects.wrap(&object, message, &mut headers).await.ok()?;
        // It is deleted with the job, also if nothing waits for the job any more.
        let _object =
            headers.get(OBJECT_HEADER).is_some().then(|| ObjectGuard::new(&publisher.objects, object));
        let published =
            publisher.context.publish_with_headers(subject, headers, payload.into()).await.ok()?;
        let confirmed = tokio::time::timeout(PUBLISH_TIMEOUT, published.into_future()).await;
        self.pending.set_sequence(id, confirmed.ok()?.ok()?.sequence);
        self.count(|counters| {
            counters.sent += 1;
            counters.bytes_sent += bytes;
        });
        end.await.ok()
    }

    /// Uses the reply of a worker, if the worker may be trusted. `None` if the server has to do the job itself.
    async fn take_reply(
        self: &Arc<Self>,
        job: &Arc<JobPayload>,
        reply: RemoteReply,
    ) -> Option<Result<CompletedJob, JobError>> {
        let RemoteReply { worker, envelope, acker } = reply;
        let body = match envelope.reply {
            JobReply::Done { body, .. } => body,
            JobReply::Failed(reason) | JobReply::Refused(reason) => {
                tracing::warn!(worker, reason, "A worker could not do a job; the server does it itself.");
                self.registry.lock().count_error(&worker);
                self.acknowledge(acker);
                return None;
            }
            // No policy has a part in these jobs.
            JobReply::Superseded => {
                self.acknowledge(acker);
                return None;
            }
        };
        let (is_welcome, is_due) = {
            let registry = self.registry.lock();
            (registry.may_work(&worker), registry.must_verify(&worker))
        };
        if !is_welcome {
            self.ignore(acker);
            return None;
        }
        let output = match JobOutput::decode(job, body.bytes()) {
            Ok(output) => output,
            Err(error) => {
                self.expel(&worker, format!("its result of a {} job is invalid: {error}", job.kind()));
                self.acknowledge(acker);
                return None;
            }
        };
        let items = ItemsToVerify::choose(&output, self.config.verified_share, is_due);
        match self.agrees(&worker, job, &output, &items).await {
            Err(error) => return Some(Err(error)),
            Ok(false) => {
                let task = job.task();
                let reason =
                    format!("its result of a {} job of {task} differs from the server's", job.kind());
                self.expel(&worker, reason);
                self.acknowledge(acker);
                return None;
            }
            Ok(true) => {}
        }
        let bytes = body.bytes().len();
        let unverified = UnverifiedJob { job: Arc::clone(job), output: output.clone(), bytes };
        if !self.registry.lock().count_job(&worker, unverified) {
            self.ignore(acker);
            return None;
        }
        self.count(|counters| counters.count_remote(job.kind(), bytes as u64));
        Some(Ok(CompletedJob { output, receipt: self.receipt(acker) }))
    }

    /// Receipt that acknowledges a result.
    fn receipt(&self, acker: Acker) -> Receipt {
        let acknowledgements = self.acknowledgements.clone();
        Receipt::new(move || drop(acknowledgements.send(acker)))
    }

    /// Acknowledges a result that is not used.
    fn acknowledge(&self, acker: Acker) {
        // The session ends with the process, and the message is then delivered again.
        drop(self.acknowledgements.send(acker));
    }

    /// Ignores the result of an expelled worker.
    fn ignore(&self, acker: Acker) {
        self.count(|counters| counters.ignored_results += 1);
        self.acknowledge(acker);
    }

    fn notify(&self, notice: QueueNotice) {
        drop(self.notices.send(notice)); // without a receiver there is no reader
    }

    fn count(&self, add: impl FnOnce(&mut QueueCounters)) {
        add(&mut self.counters.lock());
    }

    /// Why no worker does jobs; `None` if one does.
    fn degraded(&self) -> Option<String> {
        if let Link::Down(reason) = &*self.link.lock() {
            return Some(format!("{reason}; the server does all jobs itself"));
        }
        let is_served = !self.registry.lock().served_kinds().is_empty();
        let reason =
            "no worker is connected; the server does all jobs itself (start one with `sparring worker`)";
        (!is_served).then(|| reason.to_owned())
    }
}

/// Removes a job from the pending ones, also if its caller stops waiting.
struct PendingGuard<'a> {
    shared: &'a Shared,
    id: JobId,
}

impl Drop for PendingGuard<'_> {
    fn drop(&mut self) {
        self.shared.pending.remove(self.id);
    }
}
