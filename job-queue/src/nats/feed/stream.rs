//! Stream of a run's trajectory feed.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use async_nats::HeaderMap;
use async_nats::header::{NATS_EXPECTED_LAST_SEQUENCE, NATS_MESSAGE_ID};
use async_nats::jetstream::consumer::{AckPolicy, pull};
use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::stream::{Compression, Config, DiscardPolicy, StorageType, Stream};
use async_nats::jetstream::{Context, Message};
use futures_util::{StreamExt, TryStreamExt};
use jobs::envelope::MAX_MESSAGE_BYTES;

use super::{FeedError, FeedSettings};
use crate::nats::connection::NatsError;
use crate::nats::names::ClusterName;
use crate::nats::objects::{OBJECT_HEADER, ObjectBucket};
use crate::nats::streams;

/// Time in which JetStream must confirm that it stored a group.
const PUBLISH_TIMEOUT: Duration = Duration::from_secs(10);
/// Time in which JetStream must list the messages of a stream.
const LIST_TIMEOUT: Duration = Duration::from_secs(10);
/// Time in which a repeated message id is recognised.
const DUPLICATE_WINDOW: Duration = Duration::from_secs(120);
/// Messages of removed groups that a stream may still have, and headers, beyond the groups that are not acknowledged.
const EXTRA_MESSAGES: i64 = 64;

/// A group to be published.
#[derive(Debug)]
pub struct FeedMessage {
    /// Id of the group.
    pub id: i64,
    /// The group as JSON.
    pub json: Vec<u8>,
}

/// A group in the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StoredGroup {
    id: i64,
    /// True if the group is an object, to which the message refers.
    is_object: bool,
}

/// Stream of a run, and the groups that it has.
pub struct FeedStream {
    context: Context,
    stream: Stream,
    subject: String,
    objects: ObjectBucket,
    settings: FeedSettings,
    last_sequence: u64,
    /// Groups by the sequence number of their message.
    stored: BTreeMap<u64, StoredGroup>,
}

impl std::fmt::Debug for FeedStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FeedStream").field("subject", &self.subject).finish_non_exhaustive()
    }
}

/// Bucket of the groups of a stream that are too large for a message.
pub(super) fn large_groups(context: &Context, stream: &str) -> ObjectBucket {
    ObjectBucket::new(context.clone(), stream.to_owned(), Duration::ZERO)
}

/// Name of the object of a group.
fn object_name(id: i64) -> String {
    format!("group-{id}")
}

impl FeedStream {
    /// Creates the stream or updates its settings, and reads which groups it has.
    pub(super) async fn open(
        context: &Context,
        cluster: &ClusterName,
        settings: &FeedSettings,
        metadata: HashMap<String, String>,
    ) -> Result<Self, FeedError> {
        let (name, subject) = (cluster.feed_stream(&settings.run), cluster.feed(&settings.run));
        let config = Config {
            name: name.clone(),
            description: Some(format!("Sparring: trajectory feed of the run {}", settings.run)),
            subjects: vec![subject.clone()],
            discard: DiscardPolicy::New,
            storage: StorageType::File,
            compression: Some(Compression::S2),
            max_messages: settings.max_groups.saturating_add(EXTRA_MESSAGES),
            max_message_size: i32::try_from(MAX_MESSAGE_BYTES + 4096).unwrap_or(i32::MAX), // headers are counted
            duplicate_window: DUPLICATE_WINDOW,
            metadata,
            ..Config::default()
        };
        let stream = streams::upsert(context, config).await?;
        let last_sequence = stream.cached_info().state.last_sequence;
        let stored = read_groups(&stream).await?;
        let (context, objects) = (context.clone(), large_groups(context, &name));
        Ok(Self { context, stream, subject, objects, settings: settings.clone(), last_sequence, stored })
    }

    /// Settings with which the stream was opened.
    #[must_use]
    pub const fn settings(&self) -> &FeedSettings {
        &self.settings
    }

    /// Ids of the groups in the stream.
    #[must_use]
    pub fn ids(&self) -> BTreeSet<i64> {
        self.stored.values().map(|group| group.id).collect()
    }

    /// Returns true if the stream has no groups.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stored.is_empty()
    }

    /// Publishes a group, after all that were published before.
    ///
    /// # Errors
    /// Returns [`FeedError::OutOfStep`] if the stream has other messages than this server published.
    pub async fn publish(&mut self, group: FeedMessage) -> Result<(), FeedError> {
        let FeedMessage { id, json } = group;
        let mut headers = HeaderMap::new();
        headers.insert(NATS_MESSAGE_ID, id.to_string());
        // A message of an earlier connection that arrives late is refused.
        headers.insert(NATS_EXPECTED_LAST_SEQUENCE, self.last_sequence.to_string());
        let payload = self.objects.wrap(&object_name(id), json, &mut headers).await?;
        let is_object = headers.get(OBJECT_HEADER).is_some();
        let failed = |error: &dyn std::fmt::Display| NatsError::new("a group cannot be published", error);
        let sent = self.context.publish_with_headers(self.subject.clone(), headers, payload.into()).await;
        let sent = sent.map_err(|error| failed(&error))?.into_future();
        let answer = tokio::time::timeout(PUBLISH_TIMEOUT, sent).await.map_err(|error| failed(&error))?;
        let stored = answer.map_err(|error| match error.kind() {
            PublishErrorKind::WrongLastSequence => FeedError::OutOfStep,
            _ => failed(&error).into(),
        })?;
        if stored.duplicate && stored.sequence <= self.last_sequence {
            return Err(FeedError::Repeated(id));
        }
        self.last_sequence = stored.sequence;
        self.stored.insert(stored.sequence, StoredGroup { id, is_object });
        Ok(())
    }

    /// Returns the ids of groups that every durable consumer has acknowledged; none without a durable consumer. A group counts only
    /// when all earlier ones are acknowledged, too.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn acknowledged(&self) -> Result<Vec<i64>, NatsError> {
        let mut floor: Option<u64> = None;
        let mut consumers = self.stream.consumers();
        let failed =
            |error: &dyn std::fmt::Display| NatsError::new("the consumers of a feed cannot be listed", error);
        while let Some(info) = consumers.try_next().await.map_err(|error| failed(&error))? {
            if info.config.durable_name.is_some() && info.config.ack_policy != AckPolicy::None {
                let acknowledged = info.ack_floor.stream_sequence;
                floor = Some(floor.map_or(acknowledged, |floor| floor.min(acknowledged)));
            }
        }
        let through = floor.map_or(0, |floor| floor);
        Ok(self.stored.range(..=through).map(|(_, group)| group.id).collect())
    }

    /// Removes all groups except `kept` from the stream: first the objects, so that none is left over.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn retain(&mut self, kept: &BTreeSet<i64>) -> Result<(), NatsError> {
        let failed =
            |error: &dyn std::fmt::Display| NatsError::new("groups cannot be removed from a feed", error);
        let removed = |group: &StoredGroup| !kept.contains(&group.id);
        let sequences: Vec<u64> =
            self.stored.iter().filter(|(_, group)| removed(group)).map(|(sequence, _)| *sequence).collect();
        let Some(&last) = sequences.last() else { return Ok(()) };
        for group in self.stored.values().filter(|group| removed(group) && group.is_object) {
            self.objects.delete(&object_name(group.id)).await?;
        }
        // Those before the first group that stays go by one request.
        let first_kept = self.stored.iter().find(|(_, group)| !removed(group)).map(|(sequence, _)| *sequence);
        let purged = first_kept.map_or(last, |first| first - 1);
        if sequences.first().is_some_and(|first| *first <= purged) {
            self.stream.purge().sequence(purged + 1).await.map_err(|error| failed(&error))?;
        }
        for &sequence in sequences.iter().filter(|sequence| **sequence > purged) {
            self.stream.delete_message(sequence).await.map_err(|error| failed(&error))?;
        }
        self.stored.retain(|_, group| kept.contains(&group.id));
        Ok(())
    }
}

/// Reads which groups a stream has, by the headers of its messages.
async fn read_groups(stream: &Stream) -> Result<BTreeMap<u64, StoredGroup>, NatsError> {
    let failed =
        |error: &dyn std::fmt::Display| NatsError::new("the groups of a feed cannot be listed", error);
    let messages = stream.cached_info().state.messages;
    let mut stored = BTreeMap::new();
    if messages == 0 {
        return Ok(stored);
    }
    let config = pull::Config {
        headers_only: true,
        ack_policy: AckPolicy::None,
        inactive_threshold: LIST_TIMEOUT,
        memory_storage: true,
        ..pull::Config::default()
    };
    let consumer = stream.create_consumer(config).await.map_err(|error| failed(&error))?;
    let limit = usize::try_from(messages).unwrap_or(usize::MAX);
    let batch = consumer.batch().max_messages(limit).expires(LIST_TIMEOUT).messages().await;
    let mut batch = batch.map_err(|error| failed(&error))?;
    while let Some(message) = batch.next().await {
        let message: Message = message.map_err(|error| failed(&error))?;
        let info = message.info().map_err(|error| failed(&error))?;
        let header = |name: &str| message.headers.as_ref().and_then(|headers| headers.get(name));
        let id = header(NATS_MESSAGE_ID.as_ref()).and_then(|id| id.as_str().parse().ok());
        // A message without an id is of another program; no group has the id 0, so it is removed.
        let group = StoredGroup { id: id.unwrap_or(0), is_object: header(OBJECT_HEADER).is_some() };
        stored.insert(info.stream_sequence, group);
        if info.pending == 0 {
            break;
        }
    }
    if stored.len() < limit {
        return Err(failed(&format!("{} of {limit} were read", stored.len())));
    }
    // It ends by itself, too.
    let _ = stream.delete_consumer(&consumer.cached_info().name).await;
    Ok(stored)
}
