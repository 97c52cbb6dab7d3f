//! Connection of a server to NATS: opened again after each interruption, with everything that depends on it.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use async_nats::jetstream::message::Acker;
use async_nats::jetstream::{self, Message};
use async_nats::{Client, Message as CoreMessage};
use futures_util::StreamExt;
use jobs::envelope::{MAX_ENVELOPE_BYTES, ResultEnvelope};
use tokio::sync::mpsc::UnboundedReceiver;

use super::pending::RemoteReply;
use super::registry::HeartbeatReaction;
use super::{Link, Publisher, Shared};
use crate::nats::connection::{Connection, NatsError};
use crate::nats::membership::{self, Heartbeat};
use crate::nats::names::last_word;
use crate::nats::objects::{ObjectBucket, object_of};
use crate::nats::streams::{self, JobStreams};
use crate::status::QueueNotice;

/// Pause before the next attempt to connect.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Pause after an error of the settings, which an operator must mend.
const SETTINGS_PAUSE: Duration = Duration::from_secs(5);
/// Interval between two searches for lost jobs and stalled workers.
const TICK: Duration = Duration::from_millis(500);
/// Largest heartbeat of a worker, in bytes.
const MAX_HEARTBEAT_BYTES: usize = 64 * 1024;

/// Connects again and again, until the queue is dropped. `due` has the results to acknowledge.
pub(super) async fn run(shared: Arc<Shared>, mut due: UnboundedReceiver<Acker>) {
    let mut announced = None;
    loop {
        let Err(error) = serve(&shared, &mut due, &mut announced).await;
        let problem = if error.passes() { "is away" } else { "cannot be used" };
        let reason = format!("NATS at {} {problem}: {error}", shared.config.nats.url);
        *shared.link.lock() = Link::Down(reason);
        shared.registry.lock().stall_all();
        shared.pending.take_all_back();
        announce(&shared, &mut announced, !error.passes());
        tokio::time::sleep(if error.passes() { RETRY_PAUSE } else { SETTINGS_PAUSE }).await;
    }
}

/// Announces that the queue is degraded, or no longer. With `needs_operator` it also announces that the reason has changed since:
/// waiting does not help against the new one.
fn announce(shared: &Shared, announced: &mut Option<String>, needs_operator: bool) {
    let degraded = shared.degraded();
    let is_news = degraded.is_some() != announced.is_some() || needs_operator && degraded != *announced;
    if is_news {
        announced.clone_from(&degraded);
        shared.notify(degraded.map_or(QueueNotice::Restored, QueueNotice::Degraded));
    }
}

/// Serves one connection until it ends.
async fn serve(
    shared: &Arc<Shared>,
    due: &mut UnboundedReceiver<Acker>,
    announced: &mut Option<String>,
) -> Result<Infallible, NatsError> {
    let connection = Connection::open(&shared.config.nats, "sparring serve").await?;
    tokio::select! {
        error = connection.end() => Err(error),
        ended = serve_connection(shared, &connection, due, announced) => ended,
    }
}

/// Creates the streams, and passes on results and heartbeats.
async fn serve_connection(
    shared: &Arc<Shared>,
    connection: &Connection,
    due: &mut UnboundedReceiver<Acker>,
    announced: &mut Option<String>,
) -> Result<Infallible, NatsError> {
    let cluster = &shared.config.nats.cluster;
    let client = connection.client.clone();
    let context = jetstream::new(client.clone());
    let JobStreams { jobs, results } = streams::create(&context, cluster).await?;
    // Jobs of earlier connections were taken back.
    let purged = jobs.purge().filter(cluster.jobs_of_server(&shared.config.server)).await;
    purged.map_err(|error| NatsError::new("old jobs cannot be deleted", error))?;
    let consumer = streams::results_consumer(&results, cluster, &shared.config.server).await?;
    let results = consumer.messages().await;
    let mut results = results.map_err(|error| NatsError::new("results cannot be read", error))?;
    let heartbeats = client.subscribe(cluster.all_heartbeats()).await;
    let mut heartbeats = heartbeats.map_err(|error| NatsError::new("heartbeats cannot be read", error))?;
    let objects = streams::job_objects(&context, cluster);
    *shared.link.lock() = Link::Up(Arc::new(Publisher { context, jobs, objects: objects.clone() }));
    tracing::info!(url = %shared.config.nats.url, cluster = %cluster, "Connected to NATS.");
    let mut ticks = tokio::time::interval(TICK);
    loop {
        tokio::select! {
            message = results.next() => match message {
                Some(Ok(message)) => shared.take_message(message, &objects),
                Some(Err(error)) => return Err(NatsError::new("results cannot be read", error)),
                None => return Err(NatsError::Failed("the stream of results ended".to_owned())),
            },
            message = heartbeats.next() => match message {
                Some(message) => shared.take_heartbeat(&client, &message).await,
                None => return Err(NatsError::Failed("the heartbeats ended".to_owned())),
            },
            Some(acker) = due.recv() => {
                // A result whose acknowledgement is lost is delivered again, and ignored.
                let _ = acker.ack().await;
            }
            _ = ticks.tick() => {
                shared.tick();
                announce(shared, announced, false);
            }
        }
    }
}

impl Shared {
    /// Passes a result to its job, or ignores it. A large one is read beside the others.
    fn take_message(self: &Arc<Self>, message: Message, objects: &ObjectBucket) {
        let (message, acker) = message.split();
        let worker = last_word(&message.subject).to_owned();
        let Some(object) = object_of(&message).map(str::to_owned) else {
            return self.take_result(worker, &message.payload, acker);
        };
        let (shared, objects) = (Arc::clone(self), objects.clone());
        tokio::spawn(async move {
            match objects.payload(&message, MAX_ENVELOPE_BYTES).await {
                // Nothing reads it again: a result that is delivered again is ignored.
                Ok(payload) => {
                    shared.take_result(worker, &payload.unwrap_or_default(), acker);
                    let _ = objects.delete(&object).await;
                }
                Err(error) => tracing::warn!(worker, %error, "A result cannot be read."),
            }
        });
    }

    /// Passes a result to its job, or ignores it.
    fn take_result(&self, worker: String, payload: &[u8], acker: Acker) {
        match ResultEnvelope::read(payload) {
            Ok(envelope) => {
                if let Some(late) = self.pending.complete(RemoteReply { worker, envelope, acker }) {
                    self.count(|counters| counters.ignored_results += 1);
                    self.acknowledge(late.acker);
                }
            }
            Err(error) => {
                tracing::warn!(worker, error = %error, "A result cannot be read and is ignored.");
                self.registry.lock().count_error(&worker);
                self.count(|counters| counters.ignored_results += 1);
                self.acknowledge(acker);
            }
        }
    }

    /// Notes a heartbeat, and answers the worker.
    async fn take_heartbeat(&self, client: &Client, message: &CoreMessage) {
        if message.payload.len() > MAX_HEARTBEAT_BYTES {
            return;
        }
        let Some(heartbeat) = membership::read::<Heartbeat>(&message.payload) else { return };
        // A worker may publish under its own id only, where the permissions of NATS say so.
        if heartbeat.id != last_word(&message.subject) {
            return;
        }
        let subject = self.config.nats.cluster.control(&heartbeat.id);
        let HeartbeatReaction { answer, notice } = self.registry.lock().note_heartbeat(heartbeat);
        if let Some(notice) = notice {
            self.notify(notice);
        }
        if let Some(answer) = answer {
            // A lost answer is repeated with the next heartbeat.
            let _ = client.publish(subject, membership::write(&answer).into()).await;
        }
    }

    /// Takes lost jobs back, and finds stalled workers.
    fn tick(self: &Arc<Self>) {
        let (notices, served, active) = {
            let mut registry = self.registry.lock();
            let notices = registry.tick(TICK);
            (notices, registry.served_kinds(), registry.active_jobs())
        };
        notices.into_iter().for_each(|notice| self.notify(notice));
        let sequences = self.pending.take_back(&served, &active, self.config.patience);
        let publisher = match &*self.link.lock() {
            Link::Up(publisher) if !sequences.is_empty() => Arc::clone(publisher),
            _ => return,
        };
        tokio::spawn(async move {
            for sequence in sequences {
                // A worker may have acknowledged it meanwhile.
                let _ = publisher.jobs.delete_message(sequence).await;
            }
        });
    }
}
