//! Settings of the streams and their consumers. The server creates them; workers only read them.

use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::jetstream::consumer::{AckPolicy, Consumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use jobs::JobKind;
use jobs::envelope::MAX_MESSAGE_BYTES;

use super::connection::NatsError;
use super::names::ClusterName;
use super::objects::ObjectBucket;

/// Time after which an unacknowledged job is delivered to another worker. Workers extend it while they work.
pub(crate) const JOB_ACK_WAIT: Duration = Duration::from_secs(5);
/// Largest number of deliveries of a job; after them the server does it itself.
const MAX_DELIVERIES: i64 = 3;
/// Largest number of jobs of a kind that workers hold together.
const MAX_JOBS_HELD: i64 = 20_000;
/// Time after which an unacknowledged result is delivered again.
const RESULT_ACK_WAIT: Duration = Duration::from_secs(60);
/// Largest number of results that wait for their commit.
const MAX_RESULTS_HELD: i64 = 20_000;
/// Age after which messages and objects are deleted: those of a server that ended for ever.
const MAX_AGE: Duration = Duration::from_secs(3600);
/// Time in which a repeated message id is recognised.
const DUPLICATE_WINDOW: Duration = Duration::from_secs(120);
/// Largest size of a stream, in bytes. A full stream refuses messages.
const MAX_STREAM_BYTES: i64 = 256 << 20;

fn stream_config(name: String, subjects: String) -> Config {
    Config {
        name,
        subjects: vec![subjects],
        retention: RetentionPolicy::WorkQueue,
        discard: DiscardPolicy::New,
        storage: StorageType::File,
        max_age: MAX_AGE,
        max_bytes: MAX_STREAM_BYTES,
        max_message_size: i32::try_from(MAX_MESSAGE_BYTES + 4096).unwrap_or(i32::MAX), // headers are counted
        duplicate_window: DUPLICATE_WINDOW,
        ..Config::default()
    }
}

/// Creates the streams, the bucket and the consumers of jobs, or updates their settings. Returns the streams.
pub(crate) async fn create(context: &Context, cluster: &ClusterName) -> Result<JobStreams, NatsError> {
    let jobs = upsert(context, stream_config(cluster.jobs_stream(), cluster.all_jobs())).await?;
    let results = upsert(context, stream_config(cluster.results_stream(), cluster.all_results())).await?;
    job_objects(context, cluster).ensure().await?;
    for kind in JobKind::ALL {
        let consumer = pull::Config {
            durable_name: Some(kind.as_str().to_owned()),
            filter_subject: cluster.jobs_of_kind(kind),
            ack_policy: AckPolicy::Explicit,
            ack_wait: JOB_ACK_WAIT,
            max_deliver: MAX_DELIVERIES,
            max_ack_pending: MAX_JOBS_HELD,
            ..pull::Config::default()
        };
        let created = jobs.create_consumer(consumer).await;
        created.map_err(|error| NatsError::new("a consumer of jobs cannot be created", error))?;
    }
    Ok(JobStreams { jobs, results })
}

/// Returns the bucket of the jobs and results of a cluster that are too large for a message.
pub(crate) fn job_objects(context: &Context, cluster: &ClusterName) -> ObjectBucket {
    ObjectBucket::new(context.clone(), cluster.job_objects(), MAX_AGE)
}

/// Streams of a cluster.
pub(crate) struct JobStreams {
    pub(crate) jobs: Stream,
    pub(crate) results: Stream,
}

/// Creates a stream, or updates its settings. Returns it with its current state.
pub(crate) async fn upsert(context: &Context, config: Config) -> Result<Stream, NatsError> {
    let name = config.name.clone();
    let failed = |error: &dyn std::fmt::Display| {
        // A server without JetStream does not answer.
        let has_no_answer = error.to_string().contains("timed out")
            || error.to_string().contains("no responders")
            || error.to_string().contains("unavailable");
        let hint = if has_no_answer { " (NATS needs JetStream: `nats-server -js`)" } else { "" };
        NatsError::new(&format!("the stream {name} cannot be created{hint}"), error)
    };
    context.create_or_update_stream(config).await.map_err(|error| failed(&error))?;
    context.get_stream(&name).await.map_err(|error| failed(&error))
}

/// Returns the consumer of the results for a server.
pub(crate) async fn results_consumer(
    results: &Stream,
    cluster: &ClusterName,
    server: &str,
) -> Result<Consumer<pull::Config>, NatsError> {
    let consumer = pull::Config {
        durable_name: Some(format!("results-{server}")),
        filter_subject: cluster.results_of_server(server),
        ack_policy: AckPolicy::Explicit,
        ack_wait: RESULT_ACK_WAIT,
        max_ack_pending: MAX_RESULTS_HELD,
        inactive_threshold: MAX_AGE,
        ..pull::Config::default()
    };
    let created = results.create_consumer(consumer).await;
    created.map_err(|error| NatsError::new("the consumer of results cannot be created", error))
}

/// Returns the consumer of the jobs of a kind, which the server has created.
pub(crate) async fn jobs_consumer(
    context: &Context,
    cluster: &ClusterName,
    kind: JobKind,
) -> Result<Consumer<pull::Config>, NatsError> {
    let consumer = context.get_consumer_from_stream(kind.as_str(), cluster.jobs_stream()).await;
    consumer.map_err(|error| NatsError::new("the consumer of jobs cannot be read", error))
}
