//! Publishes feeds and the states of runs over one connection.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::time::{Duration, Instant};

use job_queue::nats::feed::{
    FeedConnection, FeedError, FeedSettings, FeedStream, PublishedRunState, RunStateBucket,
};
use store::feeds::{self, NatsFeedRow, RunStateRow};
use store::runs::RunStatus;

use super::feed_round::{FeedRound, RoundError};
use super::{FeedSessionEnd, FeedStreamWorker, PublishedGroups};
use crate::engine::error::ServiceError;
use crate::metrics;
use crate::rollouts::settings::settings_from_json;
use crate::workers::round_error::ends_worker;

/// Interval between two questions for acknowledgements, while groups wait for them.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Interval between two rounds without a signal.
const IDLE_INTERVAL: Duration = Duration::from_secs(5);
/// Pause after each round, so that many commits share one.
const MIN_PAUSE: Duration = Duration::from_millis(20);
/// Pause after reading the states of all runs, as a multiple of the time that it took.
const STATES_PAUSE_FACTOR: u32 = 20;
/// Pause before a feed that failed is tried again.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Description of errors of the database in the log.
const FAILURE: &str = "feeds could not be published";

/// Feed that could not be published.
#[derive(Debug, Clone)]
pub(super) struct FailedFeed {
    pub(super) reason: String,
    /// Time from which it is tried again.
    pub(super) retry_at: Instant,
}

/// Publishes over one connection.
pub(super) struct FeedSession<'a> {
    worker: &'a mut FeedStreamWorker,
    connection: &'a FeedConnection,
    published: &'a mut PublishedGroups,
    states: RunStateBucket,
    /// Runs whose feeds are delivered by NATS.
    wanted: Vec<FeedSettings>,
    feeds: BTreeMap<String, FeedStream>,
    failed: BTreeMap<String, FailedFeed>,
    /// Time from which acknowledgements are read again.
    poll_at: Instant,
    /// True if the states of runs may differ from those that were published.
    is_dirty: bool,
    /// Time from which the states may be read again.
    refresh_at: Instant,
    /// True if a server with a copy of the database keeps the states of some runs.
    has_copy: bool,
    /// Time from which the server checks again whether the other one runs.
    copy_check_at: Instant,
    /// True if a round left groups to publish.
    has_more: bool,
}

impl<'a> FeedSession<'a> {
    /// Reads the states that were published before, and deletes streams that are not wanted any more.
    pub(super) async fn start(
        worker: &'a mut FeedStreamWorker,
        connection: &'a FeedConnection,
        published: &'a mut PublishedGroups,
    ) -> Result<Self, FeedSessionEnd> {
        let states = connection.run_states().await?;
        let failed = worker.denied.clone();
        let mut session = Self {
            worker,
            connection,
            published,
            states,
            wanted: Vec::new(),
            feeds: BTreeMap::new(),
            failed,
            poll_at: Instant::now(),
            is_dirty: true,
            refresh_at: Instant::now(),
            has_copy: false,
            copy_check_at: Instant::now(),
            has_more: false,
        };
        while session.is_dirty {
            session.refresh().await?;
            tokio::time::sleep(MIN_PAUSE).await;
        }
        for run in connection.published_runs().await? {
            if !session.wanted.iter().any(|settings| settings.run == run) {
                connection.delete_feed(&run).await?;
            }
        }
        Ok(session)
    }

    /// Publishes until NATS is away or the service stops.
    pub(super) async fn run(&mut self) -> Result<Infallible, FeedSessionEnd> {
        loop {
            self.worker.groups.mark_unchanged();
            if self.has_copy && Instant::now() >= self.copy_check_at {
                self.is_dirty = true;
                self.copy_check_at = Instant::now() + IDLE_INTERVAL;
            }
            if self.is_dirty && Instant::now() >= self.refresh_at {
                let started = Instant::now();
                self.refresh().await?;
                self.refresh_at = Instant::now() + started.elapsed() * STATES_PAUSE_FACTOR;
            }
            self.publish_feeds().await?;
            if self.worker.logged.take().is_some() {
                tracing::info!("The server can publish feeds again.");
            }
            tokio::time::sleep(MIN_PAUSE).await;
            if self.has_more {
                self.is_dirty |= self.worker.runs.has_changed().unwrap_or(true);
                continue;
            }
            let has_waiting = self.feeds.values().any(|feed| !feed.is_empty());
            let mut pause = if has_waiting { POLL_INTERVAL } else { IDLE_INTERVAL };
            for failed in self.failed.values() {
                pause = pause.min(failed.retry_at.saturating_duration_since(Instant::now()));
            }
            if self.is_dirty {
                pause = pause.min(self.refresh_at.saturating_duration_since(Instant::now()));
            }
            tokio::select! {
                changed = self.worker.groups.changed() => changed.map_err(|_| FeedSessionEnd::Stopping)?,
                changed = self.worker.runs.changed() => {
                    changed.map_err(|_| FeedSessionEnd::Stopping)?;
                    self.is_dirty = true;
                }
                () = tokio::time::sleep(pause) => {}
            }
        }
    }

    /// Publishes the states of all runs, and finds the runs whose feeds are wanted.
    async fn refresh(&mut self) -> Result<(), FeedSessionEnd> {
        self.worker.runs.mark_unchanged();
        let (states, wanted) = match self.read_runs().await {
            Ok(read) => read,
            Err(error) if ends_worker(&error, FAILURE) => return Err(FeedSessionEnd::Stopping),
            Err(_) => return Ok(()), // it stays dirty
        };
        self.is_dirty = false;
        self.has_copy = self.states.update(states).await?;
        let is_wanted = |run: &str| wanted.iter().any(|settings| settings.run == run);
        for run in self.feeds.keys().filter(|run| !is_wanted(run)).cloned().collect::<Vec<_>>() {
            self.connection.delete_feed(&run).await?;
            self.feeds.remove(&run);
        }
        self.failed.retain(|run, _| is_wanted(run));
        self.published.retain(|run, _| is_wanted(run));
        let worker = &mut *self.worker;
        worker.denied.retain(|run, _| is_wanted(run));
        let retained = worker.errors.retain(&worker.writer, is_wanted).await;
        self.wanted = wanted;
        go_on_after(retained)
    }

    /// Reads the states of all runs, and the settings of the feeds that NATS delivers.
    async fn read_runs(
        &self,
    ) -> Result<(BTreeMap<String, PublishedRunState>, Vec<FeedSettings>), ServiceError> {
        let mut conn = self.worker.readers.acquire().await?;
        let rows = feeds::run_states(&mut conn).await?;
        let states = rows.into_iter().map(|row| (row.run.clone(), published_state(row))).collect();
        let mut wanted = Vec::new();
        for NatsFeedRow { run, created_at, settings } in feeds::delivered_by_nats(&mut conn).await? {
            let max_groups = settings_from_json(&settings)?.max_unacknowledged_groups.into();
            wanted.push(FeedSettings { run, created_at, max_groups });
        }
        Ok((states, wanted))
    }

    /// Publishes what the streams lack, and reads acknowledgements if they are due.
    async fn publish_feeds(&mut self) -> Result<(), FeedSessionEnd> {
        let now = Instant::now();
        let is_poll = now >= self.poll_at;
        if is_poll {
            self.poll_at = now + POLL_INTERVAL;
        }
        self.has_more = false;
        let mut unpublished = 0;
        let mut wanted = self.wanted.clone();
        // A denied feed ends the connection, so the others come first.
        wanted.sort_by_key(|settings| self.worker.denied.contains_key(&settings.run));
        for settings in wanted {
            let run = settings.run.clone();
            if self.failed.get(&run).is_some_and(|failed| now < failed.retry_at) {
                continue;
            }
            self.worker.current = Some(run.clone());
            let left = self.publish_feed(settings, is_poll).await;
            self.worker.current = None;
            match left {
                Ok(left) => {
                    self.failed.remove(&run);
                    let worker = &mut *self.worker;
                    worker.denied.remove(&run);
                    go_on_after(worker.errors.clear(&worker.writer, &run).await)?;
                    self.has_more |= left > 0;
                    unpublished += left;
                }
                Err(RoundError::Service(error)) if ends_worker(&error, FAILURE) => {
                    return Err(FeedSessionEnd::Stopping);
                }
                Err(RoundError::Service(_)) => {} // the next round tries again
                Err(RoundError::Feed(error)) => self.note_failure(run, &error).await?,
            }
        }
        if self.failed.is_empty() {
            metrics::set_unpublished_groups(unpublished);
        } else if let Err(error) = self.worker.count_unpublished(self.published).await
            && ends_worker(&error.into(), FAILURE)
        {
            return Err(FeedSessionEnd::Stopping);
        }
        Ok(())
    }

    /// Brings the stream of a run up to date. Returns the number of groups that are left for the next round.
    async fn publish_feed(&mut self, settings: FeedSettings, is_poll: bool) -> Result<usize, RoundError> {
        let run = settings.run.clone();
        let mut feed = match self.feeds.remove(&run) {
            Some(feed) if *feed.settings() == settings => feed,
            _ => self.connection.open_feed(&settings).await?,
        };
        let round = FeedRound { readers: &self.worker.readers, writer: &self.worker.writer, run: &run };
        let left = round.run(&mut feed, is_poll).await;
        self.published.insert(run.clone(), feed.ids());
        // After an error of NATS, the stream is opened and read again.
        if !matches!(left, Err(RoundError::Feed(_))) {
            self.feeds.insert(run, feed);
        }
        left
    }

    /// Notes that a feed failed: in the log, and in the policy of the run. Another server keeps its feed, which is shown at once; other
    /// errors are shown when they are repeated, since most of them pass.
    async fn note_failure(&mut self, run: String, error: &FeedError) -> Result<(), FeedSessionEnd> {
        let reason = error.to_string();
        let is_known = self.failed.get(&run).is_some_and(|failed| failed.reason == reason);
        if !is_known && !matches!(error, FeedError::OutOfStep) {
            tracing::warn!(
                run,
                error = reason,
                "The feed of a run could not be published; the server tries again."
            );
        }
        if is_known || matches!(error, FeedError::OtherServer { .. } | FeedError::Copy { .. }) {
            let worker = &mut *self.worker;
            go_on_after(worker.errors.show(&worker.writer, &run, &reason).await)?;
        }
        self.failed.insert(run, FailedFeed { reason, retry_at: Instant::now() + RETRY_PAUSE });
        Ok(())
    }
}

/// Ends the session if the writer stops. The log has other errors of changes.
fn go_on_after(changed: Result<(), ServiceError>) -> Result<(), FeedSessionEnd> {
    match changed {
        Err(error) if ends_worker(&error, FAILURE) => Err(FeedSessionEnd::Stopping),
        _ => Ok(()),
    }
}

/// Converts the state of a run to its published form.
fn published_state(row: RunStateRow) -> PublishedRunState {
    let state = match row.status {
        _ if row.is_archived => "archived",
        RunStatus::Active => "active",
        RunStatus::Paused => "paused",
    };
    PublishedRunState {
        state: state.to_owned(),
        policy_version: row.policy_version,
        policy: row.policy,
        version: row.version,
        created_at: row.created_at,
        server: String::new(), // the bucket enters it
    }
}
