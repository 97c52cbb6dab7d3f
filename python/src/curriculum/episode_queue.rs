//! Queue between the environments and the two threads: leased episodes to begin, and results to send.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use env_core::Scenario;
use env_core::batch::episode_assigner::{AssignedEpisode, EpisodePool, PooledEpisode, RecordedActions};
use serde::Serialize;
use serde_json::Value;

use super::lease::{Lease, LeaseEpisodes, LeasedEpisode, UnbegunGroups};

/// Episodes per environment that are kept leased.
pub(super) const EPISODES_PER_ENV: usize = 2;

/// Counts of episodes by their outcome, since the curriculum was opened.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct EpisodeCounts {
    /// Leases that the server granted.
    pub(super) leases: u64,
    /// Run to their end.
    pub(super) finished: u64,
    /// Claimed in columns that the server accepted after its audit.
    pub(super) accepted: u64,
    /// Claimed in columns that failed the audit, or reported with an action log that the server rejected.
    pub(super) refused: u64,
    /// Claimed in columns whose audit did not end in time.
    pub(super) unproven: u64,
    /// Reported with an action log, and counted as evidence of mastery.
    pub(super) counted: u64,
    /// Reported with an action log, and stored without counting as evidence.
    pub(super) stored: u64,
    /// Reported again after the server had counted them.
    pub(super) duplicate: u64,
    /// Reported after their lease had ended.
    pub(super) late: u64,
    /// Not run to their end: released or abandoned.
    pub(super) unfinished: u64,
    /// Finished, but not submitted when the curriculum was closed.
    pub(super) lost: u64,
}

/// A lease of columns, with the results of its finished episodes.
#[derive(Debug)]
pub(super) struct ColumnLease {
    pub(super) lease: Arc<Lease>,
    /// Results by the index of the episode.
    pub(super) results: Vec<Option<EpisodeResult>>,
    /// Episodes that are neither finished nor abandoned.
    open: usize,
    /// Oldest policy version that ran any of the episodes.
    pub(super) policy_version: u32,
}

/// Result of one episode of a lease of columns.
#[derive(Debug)]
pub(super) struct EpisodeResult {
    pub(super) score: f64,
    pub(super) actions: RecordedActions,
}

/// A lease of groups.
#[derive(Debug)]
struct GroupLease {
    lease: Arc<Lease>,
    /// Episodes that are neither finished nor abandoned.
    open: usize,
    /// Episodes that are finished and not reported.
    unreported: usize,
    /// True if any episode was abandoned.
    has_abandoned: bool,
}

/// Message to send to the server.
#[derive(Debug)]
pub(super) enum Submission {
    /// Claim of the finished episodes of a lease of columns.
    Columns(ColumnLease),
    /// Result of an episode of a lease of groups.
    Result {
        /// Episode of the lease.
        episode: LeasedEpisode,
        /// Actions of all steps.
        actions: RecordedActions,
        /// Policy version that ran the episode.
        policy_version: u32,
    },
    /// Release of the unfinished episodes of a lease.
    Release(Arc<Lease>),
}

impl Submission {
    /// Number of episodes whose results it has.
    pub(super) fn episodes(&self) -> usize {
        match self {
            Self::Columns(columns) => columns.results.iter().flatten().count(),
            Self::Result { .. } => 1,
            Self::Release(_) => 0,
        }
    }
}

/// Period in which the server does not answer.
#[derive(Debug)]
pub(super) struct Outage {
    pub(super) since: Instant,
    pub(super) reason: String,
}

/// State that environments and the two threads share.
#[derive(Debug, Default)]
pub(super) struct EpisodeQueue {
    /// Policy version of the episodes that begin now.
    pub(super) policy_version: u32,
    leases: VecDeque<LeaseEpisodes>,
    /// Episodes that an environment began and returned.
    returned: Vec<PooledEpisode<LeasedEpisode>>,
    column_leases: BTreeMap<String, ColumnLease>,
    group_leases: BTreeMap<String, GroupLease>,
    pub(super) outbox: VecDeque<Submission>,
    /// Episodes in the outbox, including those that are being sent.
    pub(super) unsent: usize,
    /// Number of episodes to keep leased.
    pub(super) target: usize,
    /// Number of environments that take episodes.
    pub(super) envs: usize,
    /// Message of the server if the run is paused.
    pub(super) paused: Option<String>,
    /// Current outage of the server.
    pub(super) outage: Option<Outage>,
    /// Error after which nothing more is fetched.
    pub(super) error: Option<String>,
    /// Message about the exit of the server, if this process started it and it has exited.
    pub(super) server_exit: Option<String>,
    /// True if the evaluation has no more episodes.
    pub(super) is_exhausted: bool,
    pub(super) is_closing: bool,
    /// True while a lease request is in progress.
    pub(super) is_fetching: bool,
    /// True while a submission is in progress.
    pub(super) is_sending: bool,
    /// True once the caller has stopped waiting for unsent results.
    pub(super) is_abandoned: bool,
    /// True if everything was sent after closing.
    pub(super) is_drained: bool,
    pub(super) counts: EpisodeCounts,
}

impl EpisodeQueue {
    /// Number of episodes that can be begun at once.
    pub(super) fn ready(&self) -> usize {
        self.returned.len() + self.leases.iter().map(|episodes| episodes.left).sum::<usize>()
    }

    /// Number of leased episodes whose scenarios the server has not disclosed.
    pub(super) fn undisclosed(&self) -> usize {
        self.leases.iter().map(LeaseEpisodes::undisclosed).sum()
    }

    /// Groups to begin now, so that every other environment finds an episode at once. The other groups of a lease stay undisclosed:
    /// a scenario that is disclosed and not flown is a lost attempt.
    pub(super) fn next_unbegun(&self) -> Option<UnbegunGroups> {
        let begun = self.target.saturating_sub(EPISODES_PER_ENV * self.envs) + self.envs.div_ceil(2);
        let wanted = begun.checked_sub(self.ready()).filter(|wanted| *wanted > 0)?;
        let episodes = self.leases.iter().find(|episodes| episodes.undisclosed() > 0)?;
        Some(UnbegunGroups { lease: episodes.lease.id.clone(), groups: episodes.next_unbegun(wanted) })
    }

    /// Adds the scenarios of groups that were begun, from the server's response.
    ///
    /// # Errors
    /// Returns a message if the response is malformed.
    pub(super) fn add_begun(&mut self, begun: &UnbegunGroups, response: Value) -> Result<(), String> {
        let lease = self.leases.iter_mut().find(|episodes| episodes.lease.id == begun.lease);
        lease.map_or(Ok(()), |episodes| episodes.add_begun(&begun.groups, response))
    }

    /// Forgets the groups of a lease that were not begun: the lease has ended.
    pub(super) fn drop_unbegun(&mut self, lease: &str) {
        let Some(episodes) = self.leases.iter_mut().find(|episodes| episodes.lease.id == lease) else {
            return;
        };
        let (dropped, lease) = (episodes.drop_unbegun(), Arc::clone(&episodes.lease));
        self.counts.unfinished += dropped as u64;
        if let Some(groups) = self.group_leases.get_mut(&lease.id) {
            (groups.open, groups.has_abandoned) = (groups.open.saturating_sub(dropped), true);
        }
        self.release_if_done(&lease);
    }

    /// Number of finished episodes whose lease of columns is not complete.
    pub(super) fn unclaimed(&self) -> usize {
        self.column_leases.values().map(|columns| columns.results.iter().flatten().count()).sum()
    }

    /// Checks that the queue is neither closed nor failed.
    ///
    /// # Errors
    /// Returns the message to show to the user.
    pub(super) fn check_usable(&self) -> Result<(), String> {
        if self.is_closing {
            return Err("the curriculum is closed: open another one with the same run".to_owned());
        }
        self.error.clone().map_or(Ok(()), Err)
    }

    /// Returns the error that ended the curriculum, with the number of refused episodes.
    pub(super) fn failure(&self) -> Option<String> {
        let error = self.error.as_ref()?;
        Some(match self.counts.refused {
            0 => error.clone(),
            refused => format!("{error}; refused in all: {refused} episodes"),
        })
    }

    /// Explains why no episode arrives or no result is accepted.
    pub(super) fn stall_reason(&self) -> String {
        if let Some(reason) = self.server_exit.as_ref().or(self.paused.as_ref()) {
            return reason.clone();
        }
        match &self.outage {
            Some(Outage { since, reason }) => {
                format!(
                    "the server has been unreachable for {:.0} s: {reason}",
                    since.elapsed().as_secs_f64()
                )
            }
            None => "the server did not answer in time; increase the timeout if it is busy".to_owned(),
        }
    }

    /// Ends an outage: the server answered.
    pub(super) fn end_outage(&mut self) {
        (self.outage, self.server_exit) = (None, None);
    }

    /// Begins an outage, unless one has begun already.
    pub(super) fn begin_outage(&mut self, reason: String) {
        self.outage.get_or_insert_with(|| Outage { since: Instant::now(), reason });
    }

    /// Drops all unsent results; returns how many episodes are lost.
    pub(super) fn drop_unsent(&mut self) -> usize {
        let lost = if self.is_drained { 0 } else { std::mem::take(&mut self.unsent) };
        self.is_abandoned = true;
        self.counts.lost += lost as u64;
        self.outbox.retain(|submission| submission.episodes() == 0);
        lost
    }

    /// Scenario of the next episode, which stays in the queue.
    ///
    /// All kessler tasks of a run have one shape, and so have all its docking tasks.
    pub(super) fn first_scenario(&self) -> Option<Scenario> {
        let returned = self.returned.last().map(|episode| episode.scenario.clone());
        returned.or_else(|| self.leases.iter().find_map(LeaseEpisodes::first_scenario))
    }

    /// Adds the episodes of a new lease.
    pub(super) fn add(&mut self, episodes: LeaseEpisodes) {
        let lease = Arc::clone(&episodes.lease);
        self.counts.leases += 1;
        let open = lease.episodes;
        if lease.columns {
            let results = (0..lease.episodes).map(|_| None).collect();
            let policy_version = lease.policy_version;
            let columns = ColumnLease { lease: Arc::clone(&lease), results, open, policy_version };
            self.column_leases.insert(lease.id.clone(), columns);
        } else {
            let groups = GroupLease { lease: Arc::clone(&lease), open, unreported: 0, has_abandoned: false };
            self.group_leases.insert(lease.id.clone(), groups);
        }
        self.leases.push_back(episodes);
    }

    /// Records an episode that was run to its end.
    pub(super) fn finish(&mut self, finished: AssignedEpisode<LeasedEpisode>) {
        let AssignedEpisode { id: episode, scenario, actions, team_return, version } = finished;
        let range = scenario.task().score_range();
        let score = team_return.clamp(range.min, range.max);
        self.counts.finished += 1;
        if !episode.lease.columns {
            if let Some(groups) = self.group_leases.get_mut(&episode.lease.id) {
                groups.open = groups.open.saturating_sub(1);
                groups.unreported += 1;
            }
            self.enqueue(Submission::Result { episode, actions, policy_version: version });
            return;
        }
        let Some(columns) = self.column_leases.get_mut(&episode.lease.id) else { return };
        columns.policy_version = columns.policy_version.min(version);
        if let Some(result) = columns.results.get_mut(episode.index).filter(|result| result.is_none()) {
            *result = Some(EpisodeResult { score, actions });
            columns.open -= 1;
        }
        self.claim_if_complete(&episode.lease);
    }

    /// Records an episode that will not be run to its end.
    pub(super) fn abandon(&mut self, episode: &LeasedEpisode) {
        if let Some(groups) = self.group_leases.get_mut(&episode.lease.id) {
            (groups.open, groups.has_abandoned) = (groups.open.saturating_sub(1), true);
            self.counts.unfinished += 1;
            self.release_if_done(&episode.lease);
        } else if let Some(columns) = self.column_leases.get_mut(&episode.lease.id) {
            columns.open = columns.open.saturating_sub(1);
            self.counts.unfinished += 1;
            self.claim_if_complete(&episode.lease);
        }
    }

    /// Records that an episode of a lease of groups was reported.
    pub(super) fn mark_reported(&mut self, lease: &Lease) {
        if let Some(groups) = self.group_leases.get_mut(&lease.id) {
            groups.unreported = groups.unreported.saturating_sub(1);
            self.release_if_done(lease);
        }
    }

    /// Releases all episodes that are not finished.
    ///
    /// A lease of columns with results is claimed with the episodes that are finished.
    pub(super) fn release_unfinished(&mut self) {
        self.leases.clear();
        self.returned.clear();
        for (_, columns) in std::mem::take(&mut self.column_leases) {
            self.counts.unfinished += columns.open as u64;
            let has_results = columns.results.iter().any(Option::is_some);
            let submission = if has_results {
                Submission::Columns(columns)
            } else {
                Submission::Release(Arc::clone(&columns.lease))
            };
            self.enqueue(submission);
        }
        for (_, GroupLease { lease, open, .. }) in std::mem::take(&mut self.group_leases) {
            self.counts.unfinished += open as u64;
            self.enqueue(Submission::Release(lease));
        }
    }

    /// Leases with unfinished episodes.
    pub(super) fn active_leases(&self) -> Vec<Arc<Lease>> {
        let columns = self.column_leases.values().map(|columns| &columns.lease);
        columns.chain(self.group_leases.values().map(|groups| &groups.lease)).map(Arc::clone).collect()
    }

    fn enqueue(&mut self, submission: Submission) {
        self.unsent += submission.episodes();
        self.outbox.push_back(submission);
    }

    fn claim_if_complete(&mut self, lease: &Lease) {
        if self.column_leases.get(&lease.id).is_some_and(|columns| columns.open == 0)
            && let Some(columns) = self.column_leases.remove(&lease.id)
        {
            self.enqueue(Submission::Columns(columns));
        }
    }

    /// Removes a lease that has no open episode; releases it if any episode was abandoned.
    ///
    /// The server ends a lease by itself once all its episodes are reported.
    fn release_if_done(&mut self, lease: &Lease) {
        if self.group_leases.get(&lease.id).is_some_and(|groups| groups.open + groups.unreported == 0)
            && let Some(GroupLease { lease, has_abandoned: true, .. }) = self.group_leases.remove(&lease.id)
        {
            self.enqueue(Submission::Release(lease));
        }
    }
}

impl EpisodePool for EpisodeQueue {
    type EpisodeId = LeasedEpisode;

    fn take_episode(&mut self) -> Option<PooledEpisode<LeasedEpisode>> {
        if let Some(returned) = self.returned.pop() {
            return Some(returned);
        }
        let next = self.leases.iter_mut().find_map(LeaseEpisodes::take_next);
        self.leases.retain(|episodes| episodes.left + episodes.undisclosed() > 0);
        next
    }

    fn return_episode(&mut self, episode: PooledEpisode<LeasedEpisode>) {
        if !self.is_closing {
            self.returned.push(episode);
        }
    }
}
