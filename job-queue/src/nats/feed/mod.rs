//! Trajectory feeds on JetStream: one stream for each run, and the states of runs in a key-value bucket.
//!
//! The database decides what a stream holds: the groups that are not acknowledged, in order of their ids. [`FeedStream`] publishes a
//! group once, reads which groups all trainers have acknowledged, and removes groups. [`RunStateBucket`] has the states. Nothing here
//! reads the database; `workers/feed_stream` of the service does, and compares both sides again after each interruption.
//! `presence` finds out whether another server with a copy of the database runs.

mod presence;
mod run_states;
mod stream;

use std::collections::HashMap;

use async_nats::jetstream::{self, Context};
use futures_util::TryStreamExt;

use self::presence::{ServerPresence, ServersOfCluster};
pub(crate) use self::run_states::follow_run_states;
pub use self::run_states::{PublishedRunState, RunStateBucket};
pub use self::stream::{FeedMessage, FeedStream};
use super::connection::{Connection, NatsConfig, NatsError};
use super::names::{ClusterName, subject_word};
use super::objects::find_stream;

/// Metadata of a stream: the server that publishes it.
const SERVER_KEY: &str = "sparring-server";
/// Metadata of a stream: when its run was created, which tells it from a deleted run of the same id.
const CREATED_KEY: &str = "sparring-run-created";

/// Error of a run's stream.
#[derive(Debug, Clone, thiserror::Error)]
pub enum FeedError {
    /// NATS or JetStream failed.
    #[error(transparent)]
    Nats(#[from] NatsError),
    /// Another server publishes a run with the same id under the same name of servers.
    #[error(
        "the stream {stream} belongs to the run of another server ({owner}); choose another id of the run, or start this server with another --nats-name"
    )]
    OtherServer {
        /// Name of the stream.
        stream: String,
        /// Name of the server that publishes it.
        owner: String,
    },
    /// Another server that runs publishes this very run: its database is a copy of this server's, or the other way round.
    #[error(
        "the server {owner} publishes the run from a copy of this database; stop one of the two servers, or switch the run to `\"delivery\": \"http\"` on this one"
    )]
    Copy {
        /// Name of the server that publishes the run.
        owner: String,
    },
    /// The stream has other messages than this server published.
    #[error("another program changed the stream; the server reads it again")]
    OutOfStep,
    /// A group cannot be read from the database.
    #[error("the group {id} cannot be read: {reason}")]
    Unreadable {
        /// Id of the group.
        id: i64,
        /// Error of reading it.
        reason: String,
    },
    /// JetStream remembers the group although it has no message of it.
    #[error(
        "JetStream still remembers the removed group {0}; the server publishes it again within two minutes"
    )]
    Repeated(i64),
}

/// Stream of a run, as the server wants it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FeedSettings {
    /// Id of the run.
    pub run: String,
    /// When the run was created, milliseconds since the epoch.
    pub created_at: i64,
    /// Largest number of groups in the stream.
    pub max_groups: i64,
}

/// An open connection for feeds. Its owner opens a new one after an interruption.
pub struct FeedConnection {
    connection: Connection,
    context: Context,
    cluster: ClusterName,
    server: String,
    servers: ServersOfCluster,
    _presence: ServerPresence,
}

impl std::fmt::Debug for FeedConnection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FeedConnection").field("server", &self.server).finish_non_exhaustive()
    }
}

impl FeedConnection {
    /// Connects. `server` is the name of the server: the same after a restart.
    ///
    /// # Errors
    /// Returns [`NatsError`] if NATS cannot be reached.
    pub async fn open(config: &NatsConfig, server: &str) -> Result<Self, NatsError> {
        let connection = Connection::open(config, "sparring serve: feeds").await?;
        let context = jetstream::new(connection.client.clone());
        let (cluster, server) = (config.cluster.clone(), subject_word(server));
        let servers = ServersOfCluster::new(connection.client.clone(), cluster.clone());
        let _presence = servers.announce(&server).await?;
        Ok(Self { connection, context, cluster, server, servers, _presence })
    }

    /// Returns a future that ends with the connection, with the reason.
    pub fn end(&self) -> impl Future<Output = NatsError> + Send + use<> {
        self.connection.end()
    }

    /// Opens the bucket with the states of runs, which is created if it does not exist.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn run_states(&self) -> Result<RunStateBucket, NatsError> {
        RunStateBucket::open(&self.context, self.servers.clone(), self.server.clone()).await
    }

    /// Returns the runs of this server that have a stream.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn published_runs(&self) -> Result<Vec<String>, NatsError> {
        let (mut streams, mut runs) = (self.context.streams(), Vec::new());
        while let Some(info) =
            streams.try_next().await.map_err(|error| NatsError::new("streams cannot be listed", error))?
        {
            let is_own = info.config.metadata.get(SERVER_KEY) == Some(&self.server);
            runs.extend(self.cluster.run_of_feed_stream(&info.config.name).filter(|_| is_own));
        }
        Ok(runs)
    }

    /// Opens the stream of a run with these settings, and reads which groups it has.
    ///
    /// # Errors
    /// Returns [`FeedError::OtherServer`] if the stream belongs to another run, and [`FeedError::Copy`] if a server that runs publishes
    /// this very run.
    pub async fn open_feed(&self, settings: &FeedSettings) -> Result<FeedStream, FeedError> {
        let name = self.cluster.feed_stream(&settings.run);
        let created = settings.created_at.to_string();
        if let Some(stream) = find_stream(&self.context, &name).await? {
            let metadata = &stream.cached_info().config.metadata;
            let owner = metadata.get(SERVER_KEY).cloned().unwrap_or_default();
            match (owner == self.server, metadata.get(CREATED_KEY) == Some(&created)) {
                (false, false) => return Err(FeedError::OtherServer { stream: name, owner }),
                // A run with this id was deleted while NATS was away.
                (true, false) => self.delete_feed(&settings.run).await?,
                (false, true) if self.servers.is_running(&owner).await? => {
                    return Err(FeedError::Copy { owner });
                }
                // The database may have moved to another host.
                (_, true) => {}
            }
        }
        let metadata = [(SERVER_KEY, self.server.clone()), (CREATED_KEY, created)];
        let metadata: HashMap<String, String> =
            metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        FeedStream::open(&self.context, &self.cluster, settings, metadata).await
    }

    /// Deletes the stream of a run, its large groups, and its consumers.
    ///
    /// # Errors
    /// Returns [`NatsError`] if JetStream fails.
    pub async fn delete_feed(&self, run: &str) -> Result<(), NatsError> {
        let name = self.cluster.feed_stream(run);
        stream::large_groups(&self.context, &name).remove().await?;
        if find_stream(&self.context, &name).await?.is_none() {
            return Ok(());
        }
        let deleted = self.context.delete_stream(&name).await;
        deleted.map_err(|error| NatsError::new(&format!("the stream {name} cannot be deleted"), error))?;
        Ok(())
    }
}
