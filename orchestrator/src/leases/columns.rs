//! Creates a lease of columns: ranges of seeds instead of single groups.

use crate::engine::run_state::group_role;
use crate::metrics::LeaseEvent;
use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed, SeedSpace};
use store::columns::{self, SeedRangeRow};
use store::leases::{self, LeaseForm, LeaseRow, Purpose};
use store::{StoreError, proposals, scenarios, to_i64, to_u64};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::leases::create::{CreateLease, GrantedLease, TTL_S};
use crate::leases::prepare::recipe_of;
use crate::leases::seeds::seed_of;
use crate::runs::settings::MAX_GROUP_SIZE;
use crate::runs::validate::{check_episodes, check_range};
use curriculum::{Proposal, SequencedProposal};

/// Most groups, and most episodes, of a lease of columns.
pub const MAX_COLUMN_GROUPS: u32 = 100_000;

/// Seed ranges of a lease at most; the lease takes as many proposals.
const MAX_SEED_RANGES: u32 = 64;

/// Creates a lease whose episodes are ranges of seeds.
#[derive(Debug, Clone)]
pub struct CreateColumnLease(pub CreateLease);

impl CreateColumnLease {
    fn check(&self, state: &RunState) -> Result<u32, ServiceError> {
        let Self(request) = self;
        if state.is_paused {
            return Err(ServiceError::Paused(state.run.clone()));
        }
        if request.purpose == Purpose::Eval {
            let why = "must be groups with `purpose: eval`: every episode of an evaluation is replayed";
            return Err(ServiceError::invalid("form", why));
        }
        if request.evaluation.is_some() {
            return Err(ServiceError::invalid("evaluation", "needs `form: groups` and `purpose: eval`"));
        }
        if request.refill {
            let why = "needs results per group; leave it out, or use `form: groups`";
            return Err(ServiceError::invalid("refill", why));
        }
        let strategy = state.settings.curriculum.strategy;
        if strategy.replays_scenarios() {
            let why = format!(
                "must be groups: the strategy {strategy} repeats scenarios, which ranges of seeds cannot contain"
            );
            return Err(ServiceError::invalid("form", why));
        }
        let group_size = request.group_size.unwrap_or(state.settings.group_size);
        check_range("groups", request.groups, 1, MAX_COLUMN_GROUPS)?;
        check_range("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        check_range("ttl_s", request.ttl_s, *TTL_S.start(), *TTL_S.end())?;
        check_episodes(request.groups, group_size, MAX_COLUMN_GROUPS)?;
        Ok(group_size)
    }
}

impl Change for CreateColumnLease {
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let (run, now) = (self.0.run.as_str(), tx.now);
        let RunTx { state, conn, .. } = tx.run(run).await?;
        let group_size = self.check(state)?;
        let row = self.0.new_row(conn, group_size, now).await?;
        let row = LeaseRow { form: LeaseForm::Columns, ..row };
        leases::insert(conn, &row, &[]).await?;
        let mut first = 0;
        let shares: Vec<u32> = split(self.0.groups).collect();
        let proposed = state.propose(conn, now, shares.len() as u64).await?;
        let seqs: Vec<i64> = proposed.iter().map(|proposed| to_i64(proposed.seq)).collect();
        proposals::set_leased(conn, run, &seqs).await?;
        for ((number, groups), SequencedProposal { seq, proposal }) in (0..).zip(shares).zip(proposed) {
            let range = seed_range(state, seq, &proposal, SeedRange { number, first, groups })?;
            let recipe = recipe_of(&proposal).map_err(StoreError::from)?;
            scenarios::insert_recipes(conn, &[&recipe]).await?;
            columns::insert_range(conn, row.id, &range).await?;
            first += groups;
        }
        tx.emit(run, &RunEvent::lease(&row, LeaseEvent::Created))?;
        Ok(GrantedLease { row, groups: Vec::new(), scenarios: None })
    }
}

/// Splits the groups into ranges of nearly equal size, one for each proposal.
fn split(groups: u32) -> impl Iterator<Item = u32> {
    let ranges = groups.min(MAX_SEED_RANGES);
    (0..ranges).map(move |range| groups / ranges + u32::from(range < groups % ranges))
}

/// Position of a range in its lease.
#[derive(Clone, Copy)]
struct SeedRange {
    number: i64,
    /// Number of the first group.
    first: u32,
    groups: u32,
}

/// Builds the row of a range that serves a proposal.
fn seed_range(
    state: &RunState,
    seq: u64,
    proposal: &Proposal,
    range: SeedRange,
) -> Result<SeedRangeRow, ServiceError> {
    let recipe = recipe_of(proposal).map_err(StoreError::from)?;
    // The first seed is chosen so that all seeds of the range lie in the space of training seeds.
    let SeedRange { number, first, groups } = range;
    let bits = seed_of(SeedSpace::Training, state.seed, seq, 0).get();
    let room = u64::from(MAX_COLUMN_GROUPS);
    let bits = (bits & env_core::MAX_USER_SEED) % (env_core::MAX_USER_SEED - room);
    Ok(SeedRangeRow {
        number,
        proposal: to_i64(seq),
        recipe: recipe.id().0.to_vec(),
        task: proposal.task.clone(),
        level: proposal.level.map(i64::from),
        role: group_role(proposal.role),
        first_group: i64::from(first),
        groups: i64::from(groups),
        first_seed: to_i64(Seed::in_space(SeedSpace::Training, bits).get()),
        finished: 0,
        failed: 0,
        score_sum: 0.0,
    })
}

/// Builds the scenario of a group of a range.
///
/// # Errors
/// Returns an error if the stored seed is out of range.
pub fn scenario_of(range: &SeedRangeRow, recipe: Arc<Recipe>, group: i64) -> Result<Scenario, StoreError> {
    let seed = Seed::new(to_u64(range.first_seed + (group - range.first_group)))?;
    Ok(Scenario::new(recipe, seed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_nearly_equal_and_never_empty() {
        for groups in [1, 2, 63, 64, 65, 1000, MAX_COLUMN_GROUPS] {
            let all: Vec<u32> = split(groups).collect();
            assert_eq!(all.iter().sum::<u32>(), groups);
            let (min, max) = (all.iter().min().unwrap(), all.iter().max().unwrap());
            assert!(*min >= 1 && max - min <= 1 && all.len() <= 64);
        }
    }
}
