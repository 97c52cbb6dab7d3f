//! The episodes of one lease that sessions fly.

use std::collections::BTreeSet;
use std::time::Duration;

use env_core::Scenario;
use tokio::time::Instant;

use crate::ids::{EpisodeId, LeaseId, RunId};
use crate::judging::Judge;

/// A lease, and which of its episodes nobody flies yet.
#[derive(Debug)]
pub(super) struct Pool {
    pub(super) run: RunId,
    pub(super) lease: LeaseId,
    pub(super) group_size: i64,
    /// How long the lease holds from when it was taken or renewed.
    pub(super) ttl: Duration,
    pub(super) held_since: Instant,
    /// Who judges the steps, where the run says so.
    pub(super) judge: Option<Judge>,
    groups: Vec<Group>,
}

/// A group of a lease.
#[derive(Debug)]
pub(super) struct Group {
    /// Its number in the lease.
    pub(super) number: i64,
    pub(super) scenario: Scenario,
    /// What its episodes were asked for by.
    pub(super) name: Option<String>,
    /// Indices in the lease that nobody flies.
    pub(super) free: BTreeSet<i64>,
}

/// Why there is no episode to fly.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Exhausted {
    #[error("all {0} episodes of this group are flown or being flown")]
    Group(i64),
    #[error("all episodes of this lease are flown or being flown")]
    Lease,
    #[error("{0} is not an episode of this lease that is still to be flown")]
    Episode(EpisodeId),
}

impl Pool {
    pub(super) const fn new(
        run: RunId,
        lease: LeaseId,
        group_size: i64,
        (ttl, held_since): (Duration, Instant),
        judge: Option<Judge>,
        groups: Vec<Group>,
    ) -> Self {
        Self { run, lease, group_size, ttl, held_since, judge, groups }
    }

    /// Whether the lease is over for all that is known here.
    pub(super) fn is_over(&self) -> bool {
        self.held_since.elapsed() > self.ttl
    }

    /// An episode nobody flies: the one that is named, or of the group that is named, or any.
    pub(super) fn take(
        &mut self,
        name: Option<&str>,
        episode: Option<&EpisodeId>,
    ) -> Result<(i64, Scenario), Exhausted> {
        if let Some(episode) = episode {
            let held = self.groups.iter_mut().find(|group| group.free.contains(&episode.index));
            let group = held.filter(|_| episode.lease == self.lease);
            let group = group.ok_or_else(|| Exhausted::Episode(episode.clone()))?;
            group.free.remove(&episode.index);
            return Ok((episode.index, group.scenario.clone()));
        }
        let whole = |group: &Group| group.name.is_none() && group.free.len() as i64 == self.group_size;
        let at = match name {
            Some(name) => {
                let known = self.groups.iter().position(|group| group.name.as_deref() == Some(name));
                // A name is given to the first group that nobody has begun.
                known.or_else(|| self.groups.iter().position(whole)).ok_or(Exhausted::Lease)?
            }
            None => self.groups.iter().position(|g| !g.free.is_empty()).ok_or(Exhausted::Lease)?,
        };
        let group = &mut self.groups[at];
        if let Some(name) = name {
            group.name = Some(name.to_owned());
        }
        let index = group.free.pop_first().ok_or(Exhausted::Group(self.group_size))?;
        Ok((index, group.scenario.clone()))
    }

    /// The first episode of this task that nobody flies.
    pub(super) fn take_of(&mut self, task: &str) -> Option<(i64, Scenario)> {
        let free = |group: &&mut Group| !group.free.is_empty() && group.scenario.task().id() == task;
        let group = self.groups.iter_mut().find(free)?;
        Some((group.free.pop_first()?, group.scenario.clone()))
    }

    /// The scenarios of groups of which there are episodes that nobody flies, in order.
    pub(super) fn left(&self) -> impl Iterator<Item = (&Scenario, usize)> {
        let free = self.groups.iter().filter(|group| !group.free.is_empty());
        free.map(|group| (&group.scenario, group.free.len()))
    }

    /// What was reported is not to be flown.
    pub(super) fn forget(&mut self, reported: &BTreeSet<i64>) {
        for group in &mut self.groups {
            group.free.retain(|index| !reported.contains(index));
        }
    }

    /// Gives an episode back that was not flown to its end.
    pub(super) fn give_back(&mut self, index: i64) {
        let of = index.checked_div(self.group_size).unwrap_or_default();
        if let Some(group) = self.groups.iter_mut().find(|group| group.number == of) {
            group.free.insert(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use env_core::{Recipe, Seed, task};

    use super::*;

    fn pool(groups: i64, group_size: i64) -> Pool {
        let recipe = Recipe::new(task("kessler/survival").unwrap()).unwrap();
        let recipe = std::sync::Arc::new(recipe);
        let groups = (0..groups).map(|number| Group {
            number,
            scenario: Scenario::new(std::sync::Arc::clone(&recipe), Seed::user(number as u64).unwrap()),
            name: None,
            free: (number * group_size..(number + 1) * group_size).collect(),
        });
        let (run, lease) = ("run".parse().unwrap(), "7-abcdef".parse().unwrap());
        let held = (Duration::from_secs(600), Instant::now());
        Pool::new(run, lease, group_size, held, None, groups.collect())
    }

    #[test]
    fn a_name_is_one_scenario_for_all_of_its_episodes_and_no_more() {
        let mut pool = pool(2, 2);
        let seed = |(_, scenario): (i64, Scenario)| scenario.seed().get();
        assert_eq!(pool.take(Some("a"), None).map(seed), Ok(0));
        assert_eq!(pool.take(Some("b"), None).map(seed), Ok(1));
        assert_eq!(pool.take(Some("a"), None).map(seed), Ok(0));
        assert_eq!(pool.take(Some("a"), None).map(seed), Err(Exhausted::Group(2)));
        assert_eq!(pool.take(Some("c"), None).map(seed), Err(Exhausted::Lease));
        pool.give_back(0);
        assert_eq!(pool.take(Some("a"), None).unwrap().0, 0, "what was given back is flown by a sibling");
        assert_eq!(pool.take(None, None).unwrap().0, 3);
        assert_eq!(pool.take(None, None), Err(Exhausted::Lease));
    }

    #[test]
    fn an_episode_by_name_is_flown_once() {
        let mut pool = pool(1, 2);
        let episode: EpisodeId = "ep_7-abcdef_1".parse().unwrap();
        assert_eq!(pool.take(None, Some(&episode)).unwrap().0, 1);
        assert_eq!(pool.take(None, Some(&episode)), Err(Exhausted::Episode(episode)));
        let foreign: EpisodeId = "ep_8-abcdef_0".parse().unwrap();
        assert!(pool.take(None, Some(&foreign)).is_err());
        assert_eq!(pool.take(None, None).unwrap().0, 0);
    }
}
