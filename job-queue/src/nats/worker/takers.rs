//! Loops that take jobs, one for each kind.

use std::sync::Arc;
use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::jetstream::consumer::{Consumer, pull};
use async_nats::jetstream::message::Acker;
use futures_util::StreamExt;
use jobs::JobKind;
use jobs::envelope::{JobEnvelope, MAX_ENVELOPE_BYTES};
use tokio::sync::OwnedSemaphorePermit;
use tokio::task::JoinSet;

use super::WorkerProcess;
use super::job_run::{HeldJob, ReceivedJob};
use crate::nats::connection::NatsError;
use crate::nats::objects::ObjectBucket;
use crate::nats::streams;

/// How long a request for a job waits at the NATS server.
const REQUEST_EXPIRY: Duration = Duration::from_secs(5);

/// Starts the loops of a worker. A loop ends with an error only.
pub(super) fn spawn(state: &Arc<WorkerProcess>, context: &Context, takers: &mut JoinSet<NatsError>) {
    for &kind in &state.config.kinds {
        let (state, context) = (Arc::clone(state), context.clone());
        takers.spawn(async move {
            match take_jobs(&state, &context, kind).await {
                Ok(()) => NatsError::Failed(format!("the jobs of the kind {kind} ended")),
                Err(error) => error,
            }
        });
    }
    if state.config.kinds.iter().any(|kind| kind.is_rollout()) {
        let (state, context) = (Arc::clone(state), context.clone());
        takers.spawn(async move {
            match state.run_versions.follow(&context, &state.config.nats.cluster).await {}
        });
    }
}

/// Takes jobs of a kind. One job waits for a free thread while the others run. Conversations and designs have permits of their own.
async fn take_jobs(state: &Arc<WorkerProcess>, context: &Context, kind: JobKind) -> Result<(), NatsError> {
    let cluster = &state.config.nats.cluster;
    let consumer = streams::jobs_consumer(context, cluster, kind).await?;
    let objects = streams::job_objects(context, cluster);
    loop {
        let own = match state.own_permits(kind) {
            Some(permits) => Some(permits.acquire_owned().await),
            None => None,
        };
        let Some(received) = next_job(&consumer, &objects).await? else { continue };
        let held = HeldJob::new(Arc::clone(state), received);
        let permit = match own {
            Some(own) => own,
            None => held.wait_for(Arc::clone(&state.permits).acquire_owned()).await,
        };
        let Ok(permit) = permit else { return Ok(()) };
        let context = context.clone();
        tokio::spawn(async move {
            let _permit: OwnedSemaphorePermit = permit;
            held.run(&context).await;
        });
    }
}

/// Waits for a job; `None` if there is none for some seconds.
async fn next_job(
    consumer: &Consumer<pull::Config>,
    objects: &ObjectBucket,
) -> Result<Option<ReceivedJob>, NatsError> {
    let unreadable = |error: &dyn std::fmt::Display| NatsError::new("jobs cannot be taken", error);
    let batch = consumer.batch().max_messages(1).expires(REQUEST_EXPIRY).messages().await;
    let mut batch = batch.map_err(|error| unreadable(&error))?;
    let Some(message) = batch.next().await else { return Ok(None) };
    let (message, acker) = message.map_err(|error| unreadable(&error))?.split();
    let Some(payload) = objects.payload(&message, MAX_ENVELOPE_BYTES).await? else {
        // The server has taken the job back.
        leave(&acker).await;
        return Ok(None);
    };
    match JobEnvelope::read(&payload) {
        Ok(envelope) => Ok(Some(ReceivedJob { envelope, acker })),
        Err(error) => {
            tracing::warn!(error = %error, "A job cannot be read; it is left to others.");
            leave(&acker).await;
            Ok(None)
        }
    }
}

/// Leaves a job to other workers, after a while.
async fn leave(acker: &Acker) {
    let nak = async_nats::jetstream::AckKind::Nak(Some(Duration::from_secs(1)));
    // If it is lost, the job is delivered again anyway.
    let _ = acker.ack_with(nak).await;
}
