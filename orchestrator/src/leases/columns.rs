//! Creates a lease of columns: ranges of seeds instead of single groups. The groups to audit are drawn with the lease. Their brackets
//! take milliseconds, so they are computed between two changes: the first makes the proposals, the second grants the lease.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::{Seed, SeedSpace};
use rayon::ThreadPool;
use sqlx::SqliteConnection;
use store::audit_samples::{self, SampledGroupRow};
use store::columns::{self, SeedRangeRow};
use store::leases::{self, Disclosure, LeaseForm, LeaseRow, Purpose};
use store::{StoreError, brackets, from_json, proposals, scenarios, to_i64, to_u32};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::{RunState, group_role};
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::writer::Writer;
use crate::leases::audit_sample::{RecipeRange, SampledGroup, draw_sample};
use crate::leases::create::{CreateLease, GrantedLease, TTL_S, counts_as_evidence};
use crate::leases::slots::{can_show_mastery, slot_of};
use crate::metrics::LeaseEvent;
use crate::runs::settings::MAX_GROUP_SIZE;
use crate::runs::validate::{check_episodes, check_range};
use crate::runs::version_step::check_version_step;
use curriculum::{Proposal, SequencedProposal, StrategyKind};
use jobs::prepare::recipe_of;
use jobs::seeds::seed_of;

/// Most groups, and most episodes, of a lease of columns.
pub const MAX_COLUMN_GROUPS: u32 = 100_000;

/// Seed ranges of a lease at most; the lease takes as many proposals.
const MAX_SEED_RANGES: u32 = 64;

/// Creates a lease whose episodes are ranges of seeds.
///
/// # Errors
/// Returns an error if the lease may not be granted.
pub async fn create_column_lease(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    request: CreateLease,
) -> Result<GrantedLease, ServiceError> {
    let ReservedRanges { ranges, audit_groups } = writer.change(ReserveRanges(request.clone())).await?;
    let threads = Arc::clone(threads);
    let drawn = tokio::task::spawn_blocking(move || {
        let sample = threads.install(|| draw_sample(&ranges, audit_groups))?;
        Ok::<_, ServiceError>((ranges, sample))
    });
    let (ranges, sample) =
        drawn.await.map_err(|error| ServiceError::invalid("form", error.to_string()))??;
    writer.change(CreateColumnLease { request, ranges, sample }).await
}

/// Makes the proposals of a lease of columns.
struct ReserveRanges(CreateLease);

/// Ranges of a lease that is not granted yet.
struct ReservedRanges {
    ranges: Vec<RecipeRange>,
    /// Number of groups to audit.
    audit_groups: usize,
}

impl ReserveRanges {
    fn check(&self, state: &RunState) -> Result<u32, ServiceError> {
        let Self(request) = self;
        if state.paused_at.is_some() {
            return Err(ServiceError::Paused(state.run.clone()));
        }
        if request.purpose == Purpose::Eval {
            let why = "must be groups with `purpose: eval`: every episode of an evaluation is replayed";
            return Err(ServiceError::invalid("form", why));
        }
        if request.evaluation.is_some() {
            return Err(ServiceError::invalid("evaluation", "needs `form: groups` and `purpose: eval`"));
        }
        if request.disclosure == Disclosure::Begin {
            let why = "must be `lease` with `form: columns`: ranges of seeds are disclosed with the lease";
            return Err(ServiceError::invalid("disclosure", why));
        }
        if request.refill {
            let why = "needs results per group; leave it out, or use `form: groups`";
            return Err(ServiceError::invalid("refill", why));
        }
        let strategy = state.settings.curriculum.strategy;
        if !strategy.supports_columns() {
            let supporting: Vec<&str> = StrategyKind::ALL
                .into_iter()
                .filter(|kind| kind.supports_columns())
                .map(StrategyKind::name)
                .collect();
            let why = format!(
                "must be groups: the strategy {strategy} chooses every scenario by the results before it, which ranges of \
                 seeds cannot follow; create the run with {}",
                supporting.join(" or ")
            );
            return Err(ServiceError::invalid("form", why));
        }
        let group_size = request.group_size.unwrap_or(state.settings.group_size);
        check_range("groups", request.groups, 1, MAX_COLUMN_GROUPS)?;
        check_range("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        check_range("ttl_s", request.ttl_s, *TTL_S.start(), *TTL_S.end())?;
        check_version_step("policy_version", request.policy_version, state.policy_version)?;
        check_episodes(request.groups, group_size, MAX_COLUMN_GROUPS)?;
        Ok(group_size)
    }
}

impl Change for ReserveRanges {
    type Output = ReservedRanges;

    async fn apply(self, tx: &mut WriteTx) -> Result<ReservedRanges, ServiceError> {
        let (run, now) = (self.0.run.as_str(), tx.now);
        let RunTx { mut state, conn, .. } = tx.run(run).await?;
        let group_size = self.check(&state)?;
        self.0.new_row(conn, group_size, now).await?; // the run and the owner may have another lease
        let (mut first, mut ranges) = (0, Vec::new());
        let shares: Vec<u32> = split(self.0.groups).collect();
        let proposed = state.propose(conn, now, shares.len() as u64).await?;
        let seqs: Vec<i64> = proposed.iter().map(|proposed| to_i64(proposed.seq)).collect();
        proposals::set_leased(conn, run, &seqs).await?;
        for ((number, groups), SequencedProposal { seq, proposal }) in (0..).zip(shares).zip(proposed) {
            let range = seed_range(&state, seq, &proposal, SeedRange { number, first, groups })?;
            let recipe = recipe_of(&proposal).map_err(StoreError::from)?;
            ranges.push(RecipeRange { range, recipe: Arc::new(recipe) });
            first += groups;
        }
        Ok(ReservedRanges { ranges, audit_groups: state.settings.audit_groups as usize })
    }
}

/// Grants a lease of columns: its ranges, its secret audit sample, and the slots of the sample.
struct CreateColumnLease {
    request: CreateLease,
    ranges: Vec<RecipeRange>,
    sample: Vec<SampledGroup>,
}

impl Change for CreateColumnLease {
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let (run, now) = (self.request.run.as_str(), tx.now);
        let RunTx { mut state, conn, .. } = tx.run(run).await?;
        let group_size = self.request.group_size.unwrap_or(state.settings.group_size);
        let row = self.request.new_row(conn, group_size, now).await?;
        let row = LeaseRow { form: LeaseForm::Columns, ..row };
        leases::insert(conn, &row, &[]).await?;
        for RecipeRange { range, recipe } in &self.ranges {
            scenarios::insert_recipes(conn, &[&**recipe]).await?;
            columns::insert_range(conn, row.id, range).await?;
        }
        self.store_sample(conn, &mut state, &row, now).await?;
        tx.emit(run, &RunEvent::lease(&row, LeaseEvent::Created))?;
        Ok(GrantedLease { row, groups: Vec::new(), scenarios: None })
    }
}

impl CreateColumnLease {
    /// Stores the sample with its scenarios and brackets, and opens its slots.
    async fn store_sample(
        &self,
        conn: &mut SqliteConnection,
        state: &mut RunState,
        row: &LeaseRow,
        now: i64,
    ) -> Result<(), ServiceError> {
        let is_evidence = counts_as_evidence(row.purpose, &state.settings);
        let scenarios: Vec<_> = self.sample.iter().map(|group| &group.scenario).collect();
        scenarios::insert(conn, &scenarios).await?;
        let ids: Vec<_> = scenarios.iter().map(|scenario| scenario.id()).collect();
        let brackets = ids.iter().zip(&self.sample).map(|(id, group)| (id.0.as_slice(), &group.bracket));
        brackets::insert(conn, &brackets.collect::<Vec<_>>()).await?;
        let seqs: Vec<i64> = self.ranges.iter().map(|of| of.range.proposal).collect();
        let mut proposals = BTreeMap::new();
        for leased in proposals::get_many(conn, &state.run, &seqs).await? {
            proposals.insert(leased.seq, from_json::<Proposal>("a proposal", &leased.body)?);
        }
        let (mut rows, mut slots) = (Vec::new(), Vec::new());
        for (group, id) in self.sample.iter().zip(&ids) {
            let range = self.ranges.iter().map(|of| &of.range).find(|range| range.holds(group.number));
            let proposal = range.and_then(|range| Some((range.proposal, proposals.get(&range.proposal)?)));
            let Some((seq, proposal)) = proposal else { continue }; // each group is in a range, which has its proposal
            let is_slot = is_evidence && group.is_contested && can_show_mastery(proposal);
            if is_slot {
                slots.push(slot_of(row.id, seq, to_u32(group.number), proposal));
            }
            let (number, is_contested) = (group.number, group.is_contested);
            rows.push(SampledGroupRow { number, scenario: id.0.to_vec(), is_contested, is_slot });
        }
        audit_samples::insert(conn, row.id, &rows).await?;
        Ok(state.open_slots(conn, slots, now).await?)
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
