//! One job of a worker, from its delivery to its acknowledgement.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::{Duration, Instant};

use async_nats::HeaderMap;
use async_nats::jetstream::message::Acker;
use async_nats::jetstream::{AckKind, Context};
use jobs::envelope::{JobEnvelope, JobReply, ReplyBody, ResultEnvelope};
use jobs::{JobContext, JobPayload};
use tokio::sync::oneshot;

use super::{WorkerProcess, design_run, rollout_run};
use crate::nats::streams::{self, JOB_ACK_WAIT};

/// Attempts to send a result. After them the job is delivered to another worker.
const SEND_ATTEMPTS: u32 = 3;
/// Time in which JetStream must confirm that it stored a result.
const SEND_TIMEOUT: Duration = Duration::from_secs(5);

/// A job as it was delivered.
pub(super) struct ReceivedJob {
    pub(super) envelope: JobEnvelope,
    pub(super) acker: Acker,
}

/// A job that this worker holds. Its server sees it in the heartbeats until it is dropped.
pub(super) struct HeldJob {
    state: Arc<WorkerProcess>,
    job: ReceivedJob,
}

impl Drop for HeldJob {
    fn drop(&mut self) {
        self.state.active.lock().remove(&self.job.envelope.id);
    }
}

impl HeldJob {
    /// Notes that the worker holds a job.
    pub(super) fn new(state: Arc<WorkerProcess>, job: ReceivedJob) -> Self {
        state.active.lock().insert(job.envelope.id);
        Self { state, job }
    }

    /// Waits for something, and keeps the job from being delivered to another worker meanwhile.
    pub(super) async fn wait_for<T>(&self, waited: impl Future<Output = T>) -> T {
        let mut waited = std::pin::pin!(waited);
        loop {
            match tokio::time::timeout(JOB_ACK_WAIT / 3, &mut waited).await {
                Ok(done) => return done,
                // If it is lost, the job is done twice.
                Err(_) => drop(self.job.acker.ack_with(AckKind::Progress).await),
            }
        }
    }

    /// Does the job, sends its result, and acknowledges it: in this order, so that no job is lost.
    pub(super) async fn run(self, context: &Context) {
        let reply = self.wait_for(self.compute()).await;
        let Some(reply) = reply else { return }; // the process stops
        let envelope = &self.job.envelope;
        let message = match ResultEnvelope::write(envelope, &self.state.id, reply) {
            Ok(message) => message,
            Err(error) => {
                let failed = JobReply::Failed(format!("its result cannot be sent: {error}"));
                ResultEnvelope::write(envelope, &self.state.id, failed).unwrap_or_default()
            }
        };
        for _ in 0..SEND_ATTEMPTS {
            if self.send(context, message.clone()).await {
                // If it is lost, the job is done twice, and its second result is ignored.
                let _ = self.job.acker.ack().await;
                return;
            }
        }
        tracing::warn!(job = %envelope.id, "A result could not be sent; the job is left to others.");
    }

    /// Sends a result. Returns true once JetStream has stored it.
    async fn send(&self, context: &Context, message: Vec<u8>) -> bool {
        let envelope = &self.job.envelope;
        let subject = self.state.config.nats.cluster.results(&envelope.server, envelope.kind, &self.state.id);
        let mut headers = HeaderMap::new();
        let id = format!("{}.{:x}", envelope.id, envelope.token.0);
        headers.insert(async_nats::header::NATS_MESSAGE_ID, id);
        let objects = streams::job_objects(context, &self.state.config.nats.cluster);
        // A second attempt has another object, since a worker may not delete objects.
        let object = format!("result-{}-{:x}", envelope.id, rand::random::<u64>());
        let sent = async {
            let payload = objects.wrap(&object, message, &mut headers).await.ok()?;
            let published = context.publish_with_headers(subject, headers, payload.into()).await.ok()?;
            published.await.ok()
        };
        tokio::time::timeout(SEND_TIMEOUT, sent).await.is_ok_and(|sent| sent.is_some())
    }

    /// Computes the reply, pure jobs on the worker's threads; `None` if they have ended.
    async fn compute(&self) -> Option<JobReply> {
        let JobEnvelope { kind, world, .. } = &self.job.envelope;
        if *world != self.state.world {
            let reason =
                format!("the job is of the worlds {world}, this worker computes {}", self.state.world);
            return Some(JobReply::Refused(reason));
        }
        if kind.is_design() {
            return Some(design_run::design(&self.state, &self.job.envelope).await);
        }
        if kind.is_rollout() {
            return Some(rollout_run::roll_out(&self.state, &self.job.envelope).await);
        }
        let job = match JobPayload::decode(*kind, self.job.envelope.body()) {
            Ok(job) => job,
            Err(error) => return Some(JobReply::Failed(format!("the job cannot be read: {error}"))),
        };
        let (sender, receiver) = oneshot::channel();
        let state = Arc::clone(&self.state);
        self.state.pool.spawn(move || {
            let _ = sender.send(reply_to(&state, &job));
        });
        receiver.await.ok()
    }
}

fn reply_to(state: &WorkerProcess, job: &JobPayload) -> JobReply {
    let started = Instant::now();
    let context = JobContext { unsolvable: &state.unsolvable, is_wanted: &|| true };
    let output = std::panic::catch_unwind(AssertUnwindSafe(|| job.run(context)));
    match output.map(|output| output.encode()) {
        Ok(Ok(body)) => {
            let micros = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
            JobReply::Done { body: ReplyBody::new(body), micros }
        }
        Ok(Err(error)) => JobReply::Failed(error.to_string()),
        Err(_) => JobReply::Failed("the computation panicked".to_owned()),
    }
}
