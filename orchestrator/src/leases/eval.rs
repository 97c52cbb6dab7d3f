//! Leases for evaluation: scenarios with evaluation seeds at the current levels, task by task. They never move a level, so they do not
//! use the proposal queue. Scenarios are prepared between two changes, not inside one, because that takes time.

use crate::engine::run_state::group_role;
use crate::metrics::LeaseEvent;
use std::sync::Arc;

use env_core::SeedSpace;
use rayon::ThreadPool;
use rayon::prelude::*;
use store::groups::{self, GroupRow};
use store::leases::{self, LeaseRow};
use store::to_u64;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::writer::Writer;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::store_prepared::store_scenarios;
use curriculum::{Proposal, ProposalRole};
use jobs::prepare::unsolvable::UnsolvableParams;
use jobs::prepare::{DrawContext, PreparedScenario, SeedSource, prepare};

/// Sequence numbers reserved for each lease, so that the seeds of two leases never coincide.
const NUMBERS_PER_LEASE: u64 = 1 << 20;

/// Creates a lease for evaluation at the current levels.
///
/// # Errors
/// Returns an error if the lease may not be granted, and [`ServiceError::Invalid`] if the params admit no fair start.
pub async fn create_eval_lease(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    request: CreateLease,
) -> Result<GrantedLease, ServiceError> {
    let ReservedEvalLease { row, run_seed, proposals } = writer.change(ReserveEvalLease(request)).await?;
    let first = to_u64(row.id) * NUMBERS_PER_LEASE;
    let threads = Arc::clone(threads);
    let prepared = tokio::task::spawn_blocking(move || {
        let numbered: Vec<(u64, Proposal)> = (first..).zip(proposals).collect();
        let unsolvable = UnsolvableParams::default(); // unused: no contested scenario is requested
        let one = |(number, proposal): (u64, Proposal)| {
            let seeds = SeedSource { space: SeedSpace::Evaluation, run_seed, seq: number };
            let context = DrawContext { unsolvable: &unsolvable, is_wanted: &|| true };
            prepare(seeds, &proposal, None, context).map(|prepared| (proposal, prepared))
        };
        threads.install(|| numbered.into_par_iter().map(one).collect::<Result<Vec<_>, _>>())
    });
    let prepared = prepared
        .await
        .map_err(|error| ServiceError::invalid("purpose", error.to_string()))?
        .map_err(|error| ServiceError::invalid("purpose", error.to_string()))?;
    writer.change(FillEvalLease { lease: row.id, prepared }).await
}

/// Writes the lease without groups. A lease that is never filled expires like any other.
struct ReserveEvalLease(CreateLease);

struct ReservedEvalLease {
    row: LeaseRow,
    run_seed: u64,
    /// One proposal for each group.
    proposals: Vec<Proposal>,
}

impl Change for ReserveEvalLease {
    type Output = ReservedEvalLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<ReservedEvalLease, ServiceError> {
        let Self(request) = self;
        let now = tx.now;
        let RunTx { state, conn, .. } = tx.run(request.run.as_str()).await?;
        let group_size = request.check(&state)?;
        let row = request.new_row(conn, group_size, now).await?;
        leases::insert(conn, &row, &[]).await?;
        let status = state.curriculum.status();
        let tasks = &state.settings.curriculum.tasks;
        let proposals = tasks.iter().cycle().take(request.groups as usize).map(|plan| {
            let level = status.iter().find(|s| s.task == plan.task).and_then(|s| s.level);
            Proposal { why: "an evaluation".to_owned(), ..Proposal::fresh(plan, level, ProposalRole::Sample) }
        });
        let (run_seed, proposals) = (state.seed, proposals.collect());
        tx.emit(&row.run, &RunEvent::lease(&row, LeaseEvent::Created))?;
        Ok(ReservedEvalLease { row, run_seed, proposals })
    }
}

/// Writes the groups of a reserved lease.
struct FillEvalLease {
    lease: i64,
    prepared: Vec<(Proposal, PreparedScenario)>,
}

impl Change for FillEvalLease {
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let row = leases::get(&mut tx.conn, self.lease).await?;
        let row = row.ok_or_else(|| ServiceError::UnknownLease(self.lease.to_string()))?;
        tx.run(&row.run).await?; // it may have been deleted since the lease was reserved
        if !row.is_active() {
            return Err(ServiceError::LeaseClosed { lease: row.name(), status: row.status });
        }
        store_scenarios(&mut tx.conn, self.prepared.iter().map(|(_, prepared)| prepared)).await?;
        let mut groups = Vec::new();
        for (number, (proposal, prepared)) in (0i64..).zip(self.prepared) {
            let scenario = prepared.scenario.id().0.to_vec();
            groups.push(GroupRow {
                level: proposal.level.map(i64::from),
                is_contested: prepared.is_contested,
                ..GroupRow::open(number, group_role(proposal.role), proposal.task, scenario)
            });
        }
        groups::insert(&mut tx.conn, row.id, &groups).await?;
        Ok(GrantedLease { row, groups, scenarios: None })
    }
}
