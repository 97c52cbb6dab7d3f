//! Leases as the server grants them, and their episodes one by one.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use env_core::batch::episode_assigner::PooledEpisode;
use env_core::seed::SeedSpace;
use env_core::{Recipe, Scenario, Seed};
use serde::Deserialize;
use serde_json::Value;

/// Properties that all episodes of a lease share.
#[derive(Debug)]
pub(super) struct Lease {
    pub(super) id: String,
    /// True if results are claimed as columns, false if they are reported as action logs.
    pub(super) columns: bool,
    /// Number of episodes of all groups.
    pub(super) episodes: usize,
    pub(super) ttl: Duration,
    /// Policy version that the lease was taken for.
    pub(super) policy_version: u32,
}

/// An episode of a lease.
#[derive(Debug, Clone)]
pub(crate) struct LeasedEpisode {
    pub(super) lease: Arc<Lease>,
    pub(super) index: usize,
    /// Level of the scenario; `None` if the strategy has no levels.
    pub(crate) level: Option<i64>,
    /// True if the trainer should learn from the episode.
    pub(crate) train: bool,
}

impl LeasedEpisode {
    /// Id under which the episode is reported.
    pub(super) fn id(&self) -> String {
        format!("ep_{}_{}", self.lease.id, self.index)
    }
}

/// Groups of a lease whose scenarios the server has not disclosed.
#[derive(Debug, Clone)]
pub(super) struct UnbegunGroups {
    /// Id of the lease.
    pub(super) lease: String,
    /// Numbers of the groups.
    pub(super) groups: Vec<usize>,
}

/// Episodes of a lease that no environment has taken yet.
#[derive(Debug)]
pub(super) struct LeaseEpisodes {
    pub(super) lease: Arc<Lease>,
    group_size: usize,
    ranges: Vec<SeedRange>,
    next: Position,
    /// Number of episodes of known scenarios that no environment has taken yet.
    pub(super) left: usize,
    /// Numbers of the groups whose scenarios the server has not disclosed.
    unbegun: VecDeque<usize>,
}

/// Consecutive groups of one recipe whose seeds are consecutive too.
#[derive(Debug)]
struct SeedRange {
    recipe: Arc<Recipe>,
    first_group: usize,
    groups: usize,
    first_seed: u64,
    level: Option<i64>,
    train: bool,
}

/// Position of an episode in a lease.
#[derive(Debug, Clone, Copy, Default)]
struct Position {
    range: usize,
    /// Group within the range.
    group: usize,
    /// Episode within the group.
    member: usize,
}

#[derive(Deserialize)]
struct LeaseResponse {
    lease: String,
    form: String,
    group_size: usize,
    policy_version: u32,
    recipes: Vec<Value>,
    groups: Vec<GroupResponse>,
    ranges: Option<Vec<RangeResponse>>,
    #[serde(default)]
    undisclosed: Vec<UndisclosedResponse>,
}

#[derive(Deserialize)]
struct GroupResponse {
    group: usize,
    recipe: usize,
    seed: u64,
    level: Option<i64>,
    train: bool,
}

#[derive(Deserialize)]
struct UndisclosedResponse {
    group: usize,
}

#[derive(Deserialize)]
struct RangeResponse {
    recipe: usize,
    level: Option<i64>,
    first_group: usize,
    groups: usize,
    seed: u64,
}

impl LeaseEpisodes {
    /// Reads the server's response to a lease request.
    ///
    /// # Errors
    /// Returns a message if the response is malformed, has a recipe that this version does not support, or has evaluation
    /// seeds although `evaluation` is false.
    pub(super) fn read(response: Value, ttl: Duration, evaluation: bool) -> Result<Self, String> {
        let response = read_response(response)?;
        let ranges = checked_ranges(&response, evaluation)?;
        let unbegun: VecDeque<usize> = response.undisclosed.iter().map(|group| group.group).collect();
        let left = count_episodes(&ranges, response.group_size);
        let lease = Lease {
            id: response.lease,
            columns: response.form == "columns",
            episodes: left + unbegun.len() * response.group_size,
            ttl,
            policy_version: response.policy_version,
        };
        let lease = Arc::new(lease);
        let (group_size, next) = (response.group_size, Position::default());
        Ok(Self { lease, group_size, ranges, next, left, unbegun })
    }

    /// Number of episodes whose scenarios the server has not disclosed.
    pub(super) fn undisclosed(&self) -> usize {
        self.unbegun.len() * self.group_size
    }

    /// Numbers of the next groups to begin, with at least `episodes` episodes if there are so many.
    pub(super) fn next_unbegun(&self, episodes: usize) -> Vec<usize> {
        let groups = episodes.div_ceil(self.group_size.max(1));
        self.unbegun.iter().take(groups).copied().collect()
    }

    /// Adds the scenarios of groups that were begun, from the server's response.
    ///
    /// # Errors
    /// As for [`Self::read`]. The groups are not requested again.
    pub(super) fn add_begun(&mut self, groups: &[usize], response: Value) -> Result<(), String> {
        self.unbegun.retain(|group| !groups.contains(group));
        let ranges = checked_ranges(&read_response(response)?, false)?;
        self.left += count_episodes(&ranges, self.group_size);
        self.ranges.extend(ranges);
        Ok(())
    }

    /// Forgets the groups that were not begun; returns the number of their episodes.
    pub(super) fn drop_unbegun(&mut self) -> usize {
        let episodes = self.undisclosed();
        self.unbegun.clear();
        episodes
    }

    /// Scenario of the first episode of the lease.
    pub(super) fn first_scenario(&self) -> Option<Scenario> {
        let range = self.ranges.first()?;
        Some(Scenario::new(Arc::clone(&range.recipe), Seed::new(range.first_seed).ok()?))
    }

    /// Takes the next episode; the episodes of a group are consecutive.
    pub(super) fn take_next(&mut self) -> Option<PooledEpisode<LeasedEpisode>> {
        let mut position = self.next;
        if position.member == self.group_size {
            position = Position { group: position.group + 1, member: 0, ..position };
        }
        if self.ranges.get(position.range).is_some_and(|range| range.groups == position.group) {
            position = Position { range: position.range + 1, group: 0, ..position };
        }
        let range = self.ranges.get(position.range)?;
        let seed = Seed::new(range.first_seed + position.group as u64).ok()?;
        let index = (range.first_group + position.group) * self.group_size + position.member;
        self.next = Position { member: position.member + 1, ..position };
        self.left -= 1;
        let lease = Arc::clone(&self.lease);
        let id = LeasedEpisode { lease, index, level: range.level, train: range.train };
        Some(PooledEpisode { id, scenario: Scenario::new(Arc::clone(&range.recipe), seed) })
    }
}

fn read_response(response: Value) -> Result<LeaseResponse, String> {
    serde_json::from_value(response).map_err(|error| {
        format!("the server sent a lease that this version of sparring cannot read: {error}")
    })
}

/// Number of episodes of seed ranges.
fn count_episodes(ranges: &[SeedRange], group_size: usize) -> usize {
    ranges.iter().map(|range| range.groups).sum::<usize>() * group_size
}

/// Reads the scenarios of a lease, and checks their seeds.
fn checked_ranges(response: &LeaseResponse, evaluation: bool) -> Result<Vec<SeedRange>, String> {
    let ranges = read_ranges(response)?;
    // A policy that trains on held-out scenarios invalidates its evaluations; no server grants such a lease.
    let is_held_out = |range: &SeedRange| {
        Seed::new(range.first_seed).is_ok_and(|seed| seed.space() == SeedSpace::Evaluation)
    };
    if ranges.iter().any(is_held_out) && !evaluation {
        return Err("the lease has evaluation seeds, which are only for leases of an evaluation".to_owned());
    }
    let last_seed = |range: &SeedRange| Seed::new(range.first_seed + range.groups.saturating_sub(1) as u64);
    if let Some(error) = ranges.iter().find_map(|range| last_seed(range).err()) {
        return Err(error.to_string());
    }
    Ok(ranges)
}

fn read_ranges(response: &LeaseResponse) -> Result<Vec<SeedRange>, String> {
    let recipes = response.recipes.iter().map(Recipe::from_json).map(|recipe| recipe.map(Arc::new));
    let recipes = recipes.collect::<Result<Vec<_>, _>>();
    let recipes = recipes.map_err(|error| {
        format!("the lease has a scenario that this version of sparring does not support: {error}")
    })?;
    let recipe =
        |index: usize| recipes.get(index).map(Arc::clone).ok_or("the lease refers to a missing recipe");
    let mut seed_ranges = Vec::new();
    match &response.ranges {
        Some(ranges) => {
            for range in ranges {
                seed_ranges.push(SeedRange {
                    recipe: recipe(range.recipe)?,
                    first_group: range.first_group,
                    groups: range.groups,
                    first_seed: range.seed,
                    level: range.level,
                    train: true,
                });
            }
        }
        None => {
            for group in &response.groups {
                seed_ranges.push(SeedRange {
                    recipe: recipe(group.recipe)?,
                    first_group: group.group,
                    groups: 1,
                    first_seed: group.seed,
                    level: group.level,
                    train: group.train,
                });
            }
        }
    }
    Ok(seed_ranges)
}
