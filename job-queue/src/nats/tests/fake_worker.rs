//! A worker that misbehaves as its test says.

use std::time::Duration;

use async_nats::jetstream::{self, Context};
use async_nats::{Client, HeaderMap};
use futures_util::StreamExt;
use jobs::JobKind;
use jobs::envelope::{JobEnvelope, JobReply, ReplyBody, ResultEnvelope};
use jobs::prepare::unsolvable::UnsolvableParams;
use jobs::world_version::world_version;
use jobs::{JobContext, JobOutput, JobPayload};
use tokio::task::JoinHandle;

use super::config;
use crate::nats::membership::{self, Heartbeat};
use crate::nats::streams;
use crate::testing::NatsServer;

/// A worker without the code of workers. Dropping it ends its heartbeats.
pub(super) struct FakeWorker {
    pub(super) id: &'static str,
    kind: JobKind,
    context: Context,
    heart: JoinHandle<()>,
}

impl Drop for FakeWorker {
    fn drop(&mut self) {
        self.heart.abort();
    }
}

impl FakeWorker {
    /// Joins with audits only.
    pub(super) async fn join(nats: &NatsServer, id: &'static str) -> Self {
        Self::join_for(nats, id, JobKind::Audit).await
    }

    /// Joins with jobs of a kind only.
    pub(super) async fn join_for(nats: &NatsServer, id: &'static str, kind: JobKind) -> Self {
        let client = async_nats::connect(nats.url()).await.unwrap();
        let heart = tokio::spawn(beat(client.clone(), nats.url(), id, kind));
        Self { id, kind, context: jetstream::new(client), heart }
    }

    /// Takes the next job.
    pub(super) async fn take(&self, nats: &NatsServer) -> (JobEnvelope, jetstream::message::Acker) {
        let consumer = loop {
            match streams::jobs_consumer(&self.context, &config(nats).cluster, self.kind).await {
                Ok(consumer) => break consumer,
                Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
            }
        };
        loop {
            let batch = consumer.batch().max_messages(1).expires(Duration::from_secs(2)).messages().await;
            if let Some(message) = batch.unwrap().next().await {
                let (message, acker) = message.unwrap().split();
                return (JobEnvelope::read(&message.payload).unwrap(), acker);
            }
        }
    }

    /// Computes a job, and changes its result.
    pub(super) fn reply(job: &JobEnvelope, distort: impl Fn(&mut JobOutput)) -> JobReply {
        let payload = JobPayload::decode(job.kind, job.body()).unwrap();
        let unsolvable = UnsolvableParams::default();
        let mut output = payload.run(JobContext { unsolvable: &unsolvable, is_wanted: &|| true });
        distort(&mut output);
        JobReply::Done { body: ReplyBody::new(output.encode().unwrap()), micros: 1 }
    }

    /// Sends a result under a message id.
    pub(super) async fn send(&self, nats: &NatsServer, job: &JobEnvelope, reply: JobReply, message_id: &str) {
        let message = ResultEnvelope::write(job, self.id, reply).unwrap();
        let mut headers = HeaderMap::new();
        headers.insert(async_nats::header::NATS_MESSAGE_ID, message_id);
        let subject = config(nats).cluster.results(&job.server, job.kind, self.id);
        let published = self.context.publish_with_headers(subject, headers, message.into()).await.unwrap();
        published.await.unwrap();
    }

    /// Number of messages in the streams of jobs and results.
    pub(super) async fn messages(&self, nats: &NatsServer) -> [u64; 2] {
        let cluster = config(nats).cluster;
        let mut counts = [0; 2];
        for (count, stream) in counts.iter_mut().zip([cluster.jobs_stream(), cluster.results_stream()]) {
            *count = self.context.get_stream(stream).await.unwrap().cached_info().state.messages;
        }
        counts
    }
}

/// Sends heartbeats that never name a job.
async fn beat(client: Client, url: String, id: &'static str, kind: JobKind) {
    let cluster: crate::nats::ClusterName = "test".parse().unwrap();
    let heartbeat = Heartbeat {
        id: id.to_owned(),
        host: url,
        version: "0".to_owned(),
        world: world_version().to_owned(),
        kinds: vec![kind.to_string()],
        concurrency: 64,
        chat_calls: 0,
        chat_model: None,
        llm_designs: 0,
        active: Vec::new(),
        is_waiting: false,
        is_leaving: false,
    };
    loop {
        client.publish(cluster.heartbeats(id), membership::write(&heartbeat).into()).await.unwrap();
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}
