//! Publishes trajectory feeds and the states of runs on NATS.
//!
//! The database is the authority: the stream of a run has the groups that are not acknowledged, in order of their ids. After each
//! commit the worker publishes what the stream lacks. It acknowledges in the database what all consumers have acknowledged, and then
//! removes it from the stream. `session` has the steps for one connection. After an interruption, or a crash of the server or of NATS,
//! the worker reads again what each stream has, and goes on: nothing is lost, and no group is published twice.

mod feed_errors;
mod feed_round;
mod session;

use std::collections::{BTreeMap, BTreeSet};
use std::convert::Infallible;
use std::time::{Duration, Instant};

use job_queue::nats::feed::FeedConnection;
use job_queue::nats::{NatsConfig, NatsError};
use sqlx::SqlitePool;
use store::{StoreError, feeds, trajectories};
use tokio::sync::watch;

use self::feed_errors::FeedErrors;
use self::session::{FailedFeed, FeedSession};
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::metrics;
use crate::workers::round_error::ends_worker;

/// Pause before the next attempt to connect.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Pause before a feed is tried again that the user of NATS may not publish: each attempt ends the connection.
const DENIED_PAUSE: Duration = Duration::from_secs(60);

/// Where the server publishes feeds.
#[derive(Debug, Clone)]
pub struct FeedServer {
    /// How to reach NATS.
    pub nats: NatsConfig,
    /// Name of the server: the same after a restart, and different for each database.
    pub name: String,
}

/// Worker that publishes feeds.
#[derive(Debug)]
pub(super) struct FeedStreamWorker {
    /// Pool of connections that read.
    readers: SqlitePool,
    /// Writer that acknowledges groups.
    writer: Writer,
    /// Where feeds are published.
    server: FeedServer,
    /// Changes after commits that pushed groups.
    groups: watch::Receiver<u64>,
    /// Changes after commits that changed the states of runs.
    runs: watch::Receiver<u64>,
    errors: FeedErrors,
    /// Run whose feed is being published.
    current: Option<String>,
    /// Feeds that the user of NATS may not publish, by run.
    denied: BTreeMap<String, FailedFeed>,
    /// Reason of the interruption that the log has; `None` while feeds are published.
    logged: Option<NatsError>,
}

/// Reason why a connection is not used any more.
#[derive(Debug)]
enum FeedSessionEnd {
    /// The writer of the service stops.
    Stopping,
    /// No feed can be published.
    Away(NatsError),
    /// The user of NATS may not publish the feed of a run.
    Denied { run: String, error: NatsError },
}

impl From<NatsError> for FeedSessionEnd {
    fn from(error: NatsError) -> Self {
        Self::Away(error)
    }
}

/// Ids of the groups that each stream had when it was last read.
type PublishedGroups = BTreeMap<String, BTreeSet<i64>>;

/// Signals of commits that concern feeds.
#[derive(Debug)]
pub(super) struct FeedSignals {
    /// Changes after commits that pushed groups.
    pub groups: watch::Receiver<u64>,
    /// Changes after commits that changed the states of runs.
    pub runs: watch::Receiver<u64>,
}

impl FeedStreamWorker {
    /// Creates a worker that has not started.
    pub(super) fn new(readers: SqlitePool, writer: Writer, server: FeedServer, signals: FeedSignals) -> Self {
        let FeedSignals { groups, runs } = signals;
        Self {
            readers,
            writer,
            server,
            groups,
            runs,
            errors: FeedErrors::default(),
            current: None,
            denied: BTreeMap::new(),
            logged: None,
        }
    }

    /// Runs until the writer stops.
    pub(super) async fn run(mut self) {
        let mut published = PublishedGroups::new();
        loop {
            let Err(end) = self.serve(&mut published).await;
            let noted = match end {
                FeedSessionEnd::Stopping => return,
                FeedSessionEnd::Away(error) => self.note_interruption(error).await,
                FeedSessionEnd::Denied { run, error } => self.note_denial(run, &error).await,
            };
            if let Err(error) = noted
                && ends_worker(&error, "the state of feeds could not be shown")
            {
                return;
            }
            if let Err(error) = self.count_unpublished(&published).await
                && ends_worker(&error.into(), "groups of feeds could not be counted")
            {
                return;
            }
            tokio::time::sleep(RETRY_PAUSE).await;
        }
    }

    /// Serves one connection until it is interrupted.
    async fn serve(&mut self, published: &mut PublishedGroups) -> Result<Infallible, FeedSessionEnd> {
        let connection = FeedConnection::open(&self.server.nats, &self.server.name).await?;
        let end = connection.end();
        self.current = None;
        let session = async { FeedSession::start(self, &connection, published).await?.run().await };
        tokio::select! {
            error = end => Err(self.end_of_connection(error)),
            ended = session => ended,
        }
    }

    /// Returns why a session ended with its connection. NATS answers the denied request of the feed that is being published.
    fn end_of_connection(&mut self, error: NatsError) -> FeedSessionEnd {
        match (self.current.take(), &error) {
            (Some(run), NatsError::Denied(_)) => FeedSessionEnd::Denied { run, error },
            _ => FeedSessionEnd::Away(error),
        }
    }

    /// Logs why no feed is published, unless the log has it. A reason that is repeated, or against which waiting does not help, is shown
    /// in the policies of the runs; the others are over after a moment.
    async fn note_interruption(&mut self, error: NatsError) -> Result<(), ServiceError> {
        let is_known = self.logged.as_ref() == Some(&error);
        if !is_known {
            tracing::warn!(%error, "Feeds are not published; trainers can use HTTP.");
        }
        let (is_lasting, reason) = (!error.passes(), error.to_string());
        self.logged = Some(error);
        if is_known || is_lasting { self.show_in_policies(&reason).await } else { Ok(()) }
    }

    /// Shows that the user of NATS may not publish the feed of a run, and leaves it out for a while, so that the others are published.
    async fn note_denial(&mut self, run: String, error: &NatsError) -> Result<(), ServiceError> {
        let reason = error.to_string();
        if self.denied.get(&run).is_none_or(|denied| denied.reason != reason) {
            tracing::warn!(
                run,
                error = reason,
                "The feed of a run could not be published; the server tries again."
            );
        }
        let failed = FailedFeed { reason: reason.clone(), retry_at: Instant::now() + DENIED_PAUSE };
        self.denied.insert(run.clone(), failed);
        self.errors.show(&self.writer, &run, &reason).await
    }

    /// Shows in the policies of runs why no feed is published.
    async fn show_in_policies(&mut self, reason: &str) -> Result<(), ServiceError> {
        let rows = {
            let mut conn = self.readers.acquire().await?;
            feeds::delivered_by_nats(&mut conn).await?
        };
        self.errors.retain(&self.writer, |run| rows.iter().any(|row| row.run == run)).await?;
        for row in rows {
            self.errors.show(&self.writer, &row.run, reason).await?;
        }
        Ok(())
    }

    /// Counts the groups that wait while NATS is away.
    async fn count_unpublished(&self, published: &PublishedGroups) -> Result<(), StoreError> {
        let mut conn = self.readers.acquire().await.map_err(StoreError::from)?;
        let mut unpublished = 0;
        for row in feeds::delivered_by_nats(&mut conn).await? {
            let ids = published.get(&row.run);
            let groups = trajectories::unacknowledged(&mut conn, &row.run).await?;
            unpublished +=
                groups.iter().filter(|group| !ids.is_some_and(|ids| ids.contains(&group.id))).count();
        }
        metrics::set_unpublished_groups(unpublished);
        Ok(())
    }
}
