//! The episodes of one lease that sessions run.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use api_types::Judge;
use env_core::Scenario;
use tokio::time::Instant;

use store::ids::{EpisodeId, LeaseId, RunId};
use store::keys::EpisodeKey;

use super::run_end::RunEnd;
use crate::leases::session_episodes::SessionEpisodes;
use crate::results::reported::ReportedEpisode;

/// Lease with the episodes that no session has reserved.
#[derive(Debug)]
pub(crate) struct EpisodePool {
    /// Id of the run.
    pub(crate) run: RunId,
    /// Id of the lease.
    pub(crate) lease: LeaseId,
    /// Number of episodes in each group.
    pub(crate) group_size: i64,
    /// Time from the start or renewal of the lease to its expiry.
    pub(crate) ttl: Duration,
    /// Time of the last renewal.
    pub(crate) renewed_at: Instant,
    /// Judge of the steps, if the run's settings name one.
    pub(crate) judge: Option<Judge>,
    /// Flag that the run was deleted.
    pub(crate) run_end: RunEnd,
    /// Groups of the lease, in order.
    pub(crate) groups: Vec<PoolGroup>,
    /// Numbers of the groups of episodes that sessions began and left, until this is stored.
    pub(super) abandoned: Vec<i64>,
    /// Episodes that sessions run now, of all pools.
    pub(super) running: Arc<SessionEpisodes>,
}

/// Group of a pool.
#[derive(Debug)]
pub(crate) struct PoolGroup {
    /// Number of the group in the lease.
    pub(crate) number: i64,
    /// Scenario of all episodes in the group.
    pub(crate) scenario: Scenario,
    /// Name by which clients reserve episodes of this group.
    pub(crate) name: Option<String>,
    /// Indices, in the lease, of the episodes that no session has reserved.
    pub(crate) free: BTreeSet<i64>,
    /// True if the scenario is disclosed. Sessions begin the groups of a lease with `disclosure: begin` as they run them.
    pub(crate) is_begun: bool,
}

/// Episode that was taken from a pool.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PooledEpisode {
    /// Index of the episode in the lease.
    pub(crate) index: i64,
    /// Scenario of the episode.
    pub(crate) scenario: Scenario,
}

/// Reason why a pool has no episode for a request.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum PoolExhausted {
    /// The named group has no free episode; holds the size of the group.
    #[error("all {0} episodes of the group are finished or running")]
    Group(i64),
    /// The lease has no free episode, or no free group for another name.
    #[error("all episodes of the lease are finished or running")]
    Lease,
    /// The named episode is not free or belongs to another lease.
    #[error("episode {0} is not in the lease, or is finished or running")]
    Episode(EpisodeId),
}

impl EpisodePool {
    /// Returns true if the lease has expired, as far as this server's sessions renewed it.
    pub(super) fn is_expired(&self) -> bool {
        self.renewed_at.elapsed() > self.ttl
    }

    /// Takes a free episode: the named one, or one of the named group, or the first one.
    ///
    /// The first request with a new group name assigns the name to the first group with all of its episodes free.
    pub(super) fn take(
        &mut self,
        group_name: Option<&str>,
        episode: Option<&EpisodeId>,
    ) -> Result<PooledEpisode, PoolExhausted> {
        if let Some(episode) = episode {
            let group = self.groups.iter_mut().find(|group| group.free.contains(&episode.index));
            let group = group.filter(|_| episode.lease == self.lease);
            let group = group.ok_or_else(|| PoolExhausted::Episode(episode.clone()))?;
            group.free.remove(&episode.index);
            let taken = PooledEpisode { index: episode.index, scenario: group.scenario.clone() };
            self.running.insert(self.key(taken.index));
            return Ok(taken);
        }
        let is_untouched =
            |group: &PoolGroup| group.name.is_none() && group.free.len() as i64 == self.group_size;
        let position = match group_name {
            Some(name) => {
                let known = self.groups.iter().position(|group| group.name.as_deref() == Some(name));
                known.or_else(|| self.groups.iter().position(is_untouched)).ok_or(PoolExhausted::Lease)?
            }
            None => {
                self.groups.iter().position(|group| !group.free.is_empty()).ok_or(PoolExhausted::Lease)?
            }
        };
        let group = &mut self.groups[position];
        if let Some(name) = group_name {
            group.name = Some(name.to_owned());
        }
        let index = group.free.pop_first().ok_or(PoolExhausted::Group(self.group_size))?;
        let taken = PooledEpisode { index, scenario: group.scenario.clone() };
        self.running.insert(self.key(index));
        Ok(taken)
    }

    /// Returns the number of the group from which [`Self::take`] would take an episode, if the group is not begun.
    pub(super) fn unbegun_group(&self, group_name: Option<&str>, episode: Option<&EpisodeId>) -> Option<i64> {
        let is_untouched =
            |group: &&PoolGroup| group.name.is_none() && group.free.len() as i64 == self.group_size;
        let group = match (episode, group_name) {
            (Some(episode), _) => self.groups.iter().find(|group| group.free.contains(&episode.index)),
            (None, Some(name)) => {
                let known = self.groups.iter().find(|group| group.name.as_deref() == Some(name));
                known.or_else(|| self.groups.iter().find(is_untouched))
            }
            (None, None) => self.groups.iter().find(|group| !group.free.is_empty()),
        };
        group.filter(|group| !group.is_begun).map(|group| group.number)
    }

    /// Returns the numbers of the next groups of a task to begin, so that at least `wanted` of its episodes can be taken.
    pub(super) fn unbegun_groups(&self, task: &str, wanted: usize) -> Vec<i64> {
        let of_task = || self.free_groups().filter(|group| group.scenario.task().id() == task);
        let mut begun: usize = of_task().filter(|group| group.is_begun).map(|group| group.free.len()).sum();
        let mut numbers = Vec::new();
        for group in of_task().filter(|group| !group.is_begun) {
            if begun >= wanted {
                break;
            }
            begun += group.free.len();
            numbers.push(group.number);
        }
        numbers
    }

    /// Marks groups as begun.
    pub(super) fn set_begun(&mut self, numbers: &[i64]) {
        for group in self.groups.iter_mut().filter(|group| numbers.contains(&group.number)) {
            group.is_begun = true;
        }
    }

    /// Takes the first free episode of a task whose group is begun.
    pub(crate) fn take_for_task(&mut self, task: &str) -> Option<PooledEpisode> {
        let matches = |group: &&mut PoolGroup| {
            group.is_begun && !group.free.is_empty() && group.scenario.task().id() == task
        };
        let group = self.groups.iter_mut().find(matches)?;
        let taken = PooledEpisode { index: group.free.pop_first()?, scenario: group.scenario.clone() };
        self.running.insert(self.key(taken.index));
        Some(taken)
    }

    /// Records that sessions no longer run these episodes: their reports were answered.
    pub(super) fn end_episodes(&self, reported: &[ReportedEpisode]) {
        let ids = reported.iter().filter_map(|reported| reported.episode.parse::<EpisodeId>().ok());
        ids.for_each(|id| self.running.remove(self.key(id.index)));
    }

    /// Key of an episode of the lease.
    const fn key(&self, index: i64) -> EpisodeKey {
        EpisodeKey { lease: self.lease.number, number: index }
    }

    /// Returns the groups with free episodes, in order.
    pub(crate) fn free_groups(&self) -> impl Iterator<Item = &PoolGroup> {
        self.groups.iter().filter(|group| !group.free.is_empty())
    }

    /// Removes episodes that were reported by other ways.
    pub(super) fn remove_reported(&mut self, reported: &BTreeSet<i64>) {
        for group in &mut self.groups {
            group.free.retain(|index| !reported.contains(index));
        }
    }

    /// Returns an episode that was taken and did not run to its end. Its first attempt is lost: a client that saw the scenario must
    /// not gain by another one.
    pub(crate) fn give_back(&mut self, index: i64) {
        let number = index.checked_div(self.group_size).unwrap_or_default();
        self.abandoned.push(number);
        self.running.remove(self.key(index));
        if let Some(group) = self.groups.iter_mut().find(|group| group.number == number) {
            group.free.insert(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use env_core::{Recipe, Seed, task};

    use super::*;

    fn pool(groups: i64, group_size: i64) -> EpisodePool {
        let recipe = Arc::new(Recipe::new(task("kessler/survival").unwrap()).unwrap());
        let groups = (0..groups).map(|number| PoolGroup {
            number,
            scenario: Scenario::new(Arc::clone(&recipe), Seed::user(number as u64).unwrap()),
            name: None,
            free: (number * group_size..(number + 1) * group_size).collect(),
            is_begun: true,
        });
        EpisodePool {
            run: "run".parse().unwrap(),
            lease: "7-abcdef".parse().unwrap(),
            group_size,
            ttl: Duration::from_secs(600),
            renewed_at: Instant::now(),
            judge: None,
            run_end: RunEnd::default(),
            groups: groups.collect(),
            abandoned: Vec::new(),
            running: Arc::default(),
        }
    }

    #[test]
    fn group_name_selects_one_scenario() {
        let mut pool = pool(2, 2);
        let seed = |episode: PooledEpisode| episode.scenario.seed().get();
        assert_eq!(pool.take(Some("a"), None).map(seed), Ok(0));
        assert_eq!(pool.take(Some("b"), None).map(seed), Ok(1));
        assert_eq!(pool.take(Some("a"), None).map(seed), Ok(0));
        assert_eq!(pool.take(Some("a"), None).map(seed), Err(PoolExhausted::Group(2)));
        assert_eq!(pool.take(Some("c"), None).map(seed), Err(PoolExhausted::Lease));
        pool.give_back(0);
        assert_eq!(pool.take(Some("a"), None).unwrap().index, 0, "a returned episode is free again");
        assert_eq!(pool.take(None, None).unwrap().index, 3);
        assert_eq!(pool.take(None, None), Err(PoolExhausted::Lease));
    }

    #[test]
    fn named_episode_is_taken_once() {
        let mut pool = pool(1, 2);
        let episode: EpisodeId = "ep_7-abcdef_1".parse().unwrap();
        assert_eq!(pool.take(None, Some(&episode)).unwrap().index, 1);
        assert_eq!(pool.take(None, Some(&episode)), Err(PoolExhausted::Episode(episode)));
        let of_other_lease: EpisodeId = "ep_8-abcdef_0".parse().unwrap();
        assert!(pool.take(None, Some(&of_other_lease)).is_err());
        assert_eq!(pool.take(None, None).unwrap().index, 0);
    }

    #[test]
    fn returned_episode_is_abandoned() {
        let mut pool = pool(2, 2);
        let taken = pool.take(None, None).unwrap();
        pool.give_back(taken.index);
        assert_eq!(pool.abandoned, [0]);
    }

    #[test]
    fn groups_are_begun_as_far_as_episodes_are_wanted() {
        let mut pool = pool(3, 2);
        pool.groups.iter_mut().for_each(|group| group.is_begun = false);
        assert_eq!((pool.unbegun_group(None, None), pool.unbegun_group(Some("a"), None)), (Some(0), Some(0)));
        let task = pool.groups[0].scenario.task().id();
        assert!(pool.take_for_task(task).is_none(), "no group is begun");
        assert_eq!(pool.unbegun_groups(task, 3), [0, 1]);
        pool.set_begun(&[0, 1]);
        assert!(pool.unbegun_groups(task, 4).is_empty());
        assert_eq!(pool.unbegun_groups(task, 9), [2]);
        assert_eq!(pool.take_for_task(task).unwrap().index, 0);
    }
}
