//! A lease as it is granted, and its episodes one by one.

use std::sync::Arc;
use std::time::Duration;

use env_core::seed::SeedSpace;
use env_core::{Recipe, Scenario, Seed};
use serde::Deserialize;
use serde_json::Value;

/// What is known of a lease by all its episodes.
#[derive(Debug)]
pub(super) struct Lease {
    pub(super) id: String,
    pub(super) columns: bool,
    /// Episodes of all its groups.
    pub(super) episodes: usize,
    pub(super) ttl: Duration,
    /// The policy it was taken for.
    pub(super) version: u32,
}

/// An episode of a lease.
#[derive(Debug, Clone)]
pub(crate) struct Episode {
    pub(super) lease: Arc<Lease>,
    pub(super) index: usize,
    /// Its level, where it has one.
    pub(crate) level: Option<i64>,
    /// Whether to learn from it.
    pub(crate) train: bool,
}

impl Episode {
    /// What it is reported as.
    pub(super) fn name(&self) -> String {
        format!("ep_{}_{}", self.lease.id, self.index)
    }
}

#[derive(Deserialize)]
struct Granted {
    lease: String,
    form: String,
    group_size: usize,
    policy_version: u32,
    recipes: Vec<Value>,
    groups: Vec<Group>,
    ranges: Option<Vec<Range>>,
}

#[derive(Deserialize)]
struct Group {
    group: usize,
    recipe: usize,
    seed: u64,
    level: Option<i64>,
    train: bool,
}

#[derive(Deserialize)]
struct Range {
    recipe: usize,
    level: Option<i64>,
    first: usize,
    groups: usize,
    seed: u64,
}

/// A run of groups whose seeds follow each other.
#[derive(Debug)]
struct Stretch {
    recipe: Arc<Recipe>,
    first: usize,
    groups: usize,
    seed: u64,
    level: Option<i64>,
    train: bool,
}

/// The episodes of a lease that were not handed out yet.
#[derive(Debug)]
pub(super) struct Episodes {
    pub(super) lease: Arc<Lease>,
    group_size: usize,
    stretches: Vec<Stretch>,
    /// Stretch, group and sibling that come next.
    at: (usize, usize, usize),
    pub(super) left: usize,
}

impl Episodes {
    /// Reads what the server granted.
    ///
    /// # Errors
    /// What is no lease, or of worlds that this wheel does not know.
    pub(super) fn read(granted: Value, ttl: Duration, evaluation: bool) -> Result<Self, String> {
        let granted: Granted =
            serde_json::from_value(granted).map_err(|error| format!("no lease: {error}"))?;
        let recipes = granted.recipes.iter().map(Recipe::from_json).map(|recipe| recipe.map(Arc::new));
        let recipes = recipes.collect::<Result<Vec<_>, _>>();
        let recipes =
            recipes.map_err(|error| format!("a scenario that this version does not know: {error}"))?;
        let recipe = |at: usize| recipes.get(at).map(Arc::clone).ok_or("a recipe that is not there");
        let mut stretches = Vec::new();
        match &granted.ranges {
            Some(ranges) => {
                for range in ranges {
                    let Range { first, groups, seed, level, .. } = *range;
                    stretches.push(Stretch {
                        recipe: recipe(range.recipe)?,
                        first,
                        groups,
                        seed,
                        level,
                        train: true,
                    });
                }
            }
            None => {
                for group in &granted.groups {
                    let Group { group: first, seed, level, train, .. } = *group;
                    stretches.push(Stretch {
                        recipe: recipe(group.recipe)?,
                        first,
                        groups: 1,
                        seed,
                        level,
                        train,
                    });
                }
            }
        }
        // Who trains on what is held out learns nothing about itself; no server gives such a lease.
        let held_out = |stretch: &Stretch| {
            Seed::new(stretch.seed).is_ok_and(|seed| seed.space() == SeedSpace::Evaluation)
        };
        if stretches.iter().any(held_out) && !evaluation {
            return Err(
                "it has seeds of evaluations, which are flown under leases of theirs alone".to_owned()
            );
        }
        let last = |stretch: &Stretch| Seed::new(stretch.seed + stretch.groups.saturating_sub(1) as u64);
        if let Some(error) = stretches.iter().find_map(|stretch| last(stretch).err()) {
            return Err(error.to_string());
        }
        let left = stretches.iter().map(|stretch| stretch.groups).sum::<usize>() * granted.group_size;
        let lease = Lease {
            id: granted.lease,
            columns: granted.form == "columns",
            episodes: left,
            ttl,
            version: granted.policy_version,
        };
        let lease = Arc::new(lease);
        Ok(Self { lease, group_size: granted.group_size, stretches, at: (0, 0, 0), left })
    }

    /// The recipe of the first.
    pub(super) fn first(&self) -> Option<Scenario> {
        let stretch = self.stretches.first()?;
        Some(Scenario::new(Arc::clone(&stretch.recipe), Seed::new(stretch.seed).ok()?))
    }

    /// The next; siblings of a group follow each other.
    pub(super) fn next(&mut self) -> Option<(Episode, Scenario)> {
        let (mut stretch, mut group, mut sibling) = self.at;
        if sibling == self.group_size {
            (group, sibling) = (group + 1, 0);
        }
        if self.stretches.get(stretch).is_some_and(|of| of.groups == group) {
            (stretch, group) = (stretch + 1, 0);
        }
        let of = self.stretches.get(stretch)?;
        let seed = Seed::new(of.seed + group as u64).ok()?;
        let index = (of.first + group) * self.group_size + sibling;
        self.at = (stretch, group, sibling + 1);
        self.left -= 1;
        let episode = Episode { lease: Arc::clone(&self.lease), index, level: of.level, train: of.train };
        Some((episode, Scenario::new(Arc::clone(&of.recipe), seed)))
    }
}
