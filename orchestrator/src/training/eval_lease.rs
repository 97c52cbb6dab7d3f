//! Eval leases: scenarios of evaluation seeds at the current levels, task by task, as they come. They move nothing, so
//! they pass by the queue of proposals; what takes time is done between two changes, not inside one.

use std::sync::Arc;

use env_core::SeedSpace;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::lease::{Granted, TakeLease};
use super::prepare::{Hopeless, Place, Prepared, prepare, store_all};
use super::{Change, Happening, TrainingError, Work, Writer};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{self, LeaseRow};
use crate::store::unsigned;
use curriculum::{Proposal, Role};

/// Groups of a lease fit this many times into the numbers of one: seeds of two leases never meet.
const GROUPS_OF_A_LEASE: u64 = 1 << 20;

/// Takes an eval lease.
///
/// # Errors
/// A lease that may not be granted, or params for which no fair start exists.
pub async fn take_eval(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    wish: TakeLease,
) -> Result<Granted, TrainingError> {
    let Reserved { row, run_seed, proposals } = writer.change(Reserve(wish)).await?;
    let first = unsigned(row.id) * GROUPS_OF_A_LEASE;
    let threads = Arc::clone(threads);
    let prepared = tokio::task::spawn_blocking(move || {
        let numbered: Vec<(u64, Proposal)> = (first..).zip(proposals).collect();
        let hopeless = Hopeless::default(); // nothing contested is asked for
        let one = |(number, proposal): (u64, Proposal)| {
            let place = Place { space: SeedSpace::Evaluation, run_seed, seq: number };
            prepare(place, &proposal, None, (&hopeless, &|| true)).map(|prepared| (proposal, prepared))
        };
        threads.install(|| numbered.into_par_iter().map(one).collect::<Result<Vec<_>, _>>())
    });
    let prepared = prepared
        .await
        .map_err(|error| TrainingError::invalid("purpose", error.to_string()))?
        .map_err(|error| TrainingError::invalid("purpose", error.to_string()))?;
    writer.change(Fill { lease: row.id, prepared }).await
}

/// Writes the lease, without groups; one that is never filled expires like any other.
struct Reserve(TakeLease);

struct Reserved {
    row: LeaseRow,
    run_seed: u64,
    /// One per group.
    proposals: Vec<Proposal>,
}

impl Change for Reserve {
    type Answer = Reserved;

    async fn apply(self, work: &mut Work) -> Result<Reserved, TrainingError> {
        let Self(wish) = self;
        let now = work.now;
        let (mind, conn) = work.mind(wish.run.as_str()).await?;
        let group_size = wish.check(mind)?;
        let row = wish.begin(conn, group_size, now).await?;
        leases::insert(conn, &row, &[]).await?;
        let status = mind.curriculum.status();
        let tasks = &mind.settings.curriculum.tasks;
        let proposals = tasks.iter().cycle().take(wish.groups as usize).map(|plan| {
            let level = status.iter().find(|s| s.task == plan.task).and_then(|s| s.level);
            Proposal { why: "an evaluation".to_owned(), ..Proposal::at(plan, level, Role::Sample) }
        });
        let (run_seed, proposals) = (mind.seed, proposals.collect());
        work.tell(&row.run, &Happening::lease(&row, "taken"))?;
        Ok(Reserved { row, run_seed, proposals })
    }
}

/// Writes the groups of a reserved lease.
struct Fill {
    lease: i64,
    prepared: Vec<(Proposal, Prepared)>,
}

impl Change for Fill {
    type Answer = Granted;

    async fn apply(self, work: &mut Work) -> Result<Granted, TrainingError> {
        let row = leases::get(&mut work.conn, self.lease).await?;
        let row = row.ok_or_else(|| TrainingError::UnknownLease(self.lease.to_string()))?;
        if row.status != "active" {
            return Err(TrainingError::LeaseOver { lease: row.name(), status: row.status });
        }
        store_all(&mut work.conn, self.prepared.iter().map(|(_, prepared)| prepared)).await?;
        let mut groups = Vec::new();
        for (number, (proposal, prepared)) in (0i64..).zip(self.prepared) {
            let scenario = prepared.scenario.id().0.to_vec();
            groups.push(GroupRow {
                number,
                proposal: None,
                layout: None,
                scenario,
                task: proposal.task,
                level: proposal.level.map(i64::from),
                role: super::mind::word(&proposal.role)?,
                contested: i64::from(prepared.contested),
                state: "open".to_owned(),
                finished: 0,
                failed: 0,
                successes: 0,
                evidence: 0,
                train: 0,
            });
        }
        groups::insert(&mut work.conn, row.id, &groups).await?;
        Ok(Granted { row, groups, sets: None })
    }
}
