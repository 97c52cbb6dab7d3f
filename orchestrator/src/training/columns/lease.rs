//! Granting a lease of ranges of seeds.

use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed, SeedSpace};

use super::RANGES;
use crate::store::columns::{self, RangeRow};
use crate::store::leases::{self, COLUMNS, LeaseRow};
use crate::store::{StoreError, proposals, scenarios, signed, unsigned};
use crate::training::lease::{Granted, Purpose, TTL_S, TakeLease};
use crate::training::prepare::{recipe_of, seed_of};
use crate::training::settings::{MAX_GROUP_SIZE, within};
use crate::training::{Change, Happening, Mind, TrainingError, Work};
use curriculum::Proposal;

/// Most groups, and most episodes, of such a lease.
pub const MAX_GROUPS: u32 = 100_000;

/// Takes a lease whose episodes are ranges of seeds.
#[derive(Debug, Clone)]
pub struct TakeColumns(pub TakeLease);

impl TakeColumns {
    fn check(&self, mind: &Mind) -> Result<u32, TrainingError> {
        let Self(wish) = self;
        if mind.paused {
            return Err(TrainingError::Paused(mind.run.clone()));
        }
        if wish.purpose == Purpose::Eval {
            let why = "evaluations are flown on groups, every one of them replayed; leave form out";
            return Err(TrainingError::invalid("form", why));
        }
        if wish.evaluation.is_some() {
            return Err(TrainingError::invalid("evaluation", "suites are flown on groups; leave form out"));
        }
        if wish.refill {
            let why = "what comes in columns is not told apart group by group; leave it out";
            return Err(TrainingError::invalid("refill", why));
        }
        let strategy = mind.settings.curriculum.strategy;
        if strategy.returns() {
            let why = format!(
                "{strategy} faces single scenarios again, and columns are ranges of seeds; leave form out"
            );
            return Err(TrainingError::invalid("form", why));
        }
        let group_size = wish.group_size.unwrap_or(mind.settings.group_size);
        within("groups", wish.groups, 1, MAX_GROUPS)?;
        within("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        within("ttl_s", wish.ttl_s, TTL_S.0, TTL_S.1)?;
        within("groups × group_size", wish.groups.saturating_mul(group_size), 1, MAX_GROUPS)?;
        Ok(group_size)
    }
}

impl Change for TakeColumns {
    type Answer = Granted;

    async fn apply(self, work: &mut Work) -> Result<Granted, TrainingError> {
        let (run, now) = (self.0.run.as_str(), work.now);
        let (mind, conn) = work.mind(run).await?;
        let group_size = self.check(mind)?;
        let row = self.0.begin(conn, group_size, now).await?;
        let row = LeaseRow { form: COLUMNS.to_owned(), ..row };
        leases::insert(conn, &row, &[]).await?;
        let mut first = 0;
        let shares: Vec<u32> = split(self.0.groups).collect();
        let proposed = mind.propose(conn, now, shares.len() as u64).await?;
        let seqs: Vec<i64> = proposed.iter().map(|(seq, _)| signed(*seq)).collect();
        proposals::leased(conn, run, &seqs).await?;
        for ((number, groups), (seq, proposal)) in (0..).zip(shares).zip(proposed) {
            let range = range(mind, (seq, &proposal), (number, first, groups))?;
            let recipe = recipe_of(&proposal).map_err(StoreError::from)?;
            scenarios::insert_recipes(conn, &[&recipe]).await?;
            columns::insert_range(conn, row.id, &range).await?;
            first += groups;
        }
        work.tell(run, &Happening::lease(&row, "taken"))?;
        Ok(Granted { row, groups: Vec::new(), sets: None })
    }
}

/// As many ranges as proposals are asked for, as equal as can be.
fn split(groups: u32) -> impl Iterator<Item = u32> {
    let ranges = groups.min(RANGES);
    (0..ranges).map(move |range| groups / ranges + u32::from(range < groups % ranges))
}

fn range(
    mind: &Mind,
    (seq, proposal): (u64, &Proposal),
    (number, first, groups): (i64, u32, u32),
) -> Result<RangeRow, TrainingError> {
    let recipe = recipe_of(proposal).map_err(StoreError::from)?;
    // From where on all of them stay in the space of training seeds.
    let bits = seed_of(SeedSpace::Training, mind.seed, seq, 0).get();
    let room = u64::from(MAX_GROUPS);
    let bits = (bits & env_core::FREE_MASK) % (env_core::FREE_MASK - room);
    Ok(RangeRow {
        number,
        proposal: signed(seq),
        recipe: recipe.id().0.to_vec(),
        task: proposal.task.clone(),
        level: proposal.level.map(i64::from),
        role: crate::training::mind::word(&proposal.role)?,
        first: i64::from(first),
        groups: i64::from(groups),
        seed: signed(Seed::in_space(SeedSpace::Training, bits).get()),
        finished: 0,
        failed: 0,
        score: 0.0,
    })
}

/// The scenario of a group of a range.
///
/// # Errors
/// A stored seed that is none.
pub fn recipe_and_seed(range: &RangeRow, recipe: Arc<Recipe>, group: i64) -> Result<Scenario, StoreError> {
    let seed = Seed::new(unsigned(range.seed + (group - range.first)))?;
    Ok(Scenario::new(recipe, seed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_as_equal_as_can_be_and_none_is_empty() {
        for groups in [1, 2, 63, 64, 65, 1000, MAX_GROUPS] {
            let all: Vec<u32> = split(groups).collect();
            assert_eq!(all.iter().sum::<u32>(), groups);
            let (least, most) = (all.iter().min().unwrap(), all.iter().max().unwrap());
            assert!(*least >= 1 && most - least <= 1 && all.len() <= 64);
        }
    }
}
