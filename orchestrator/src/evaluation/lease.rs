//! Leases of a suite's scenarios, for a trainer that flies an evaluation.

use crate::metrics::LeaseEvent;
use std::sync::Arc;
use env_core::admission;
use rayon::ThreadPool;
use rayon::prelude::*;

use crate::evaluation::suite::SuiteEntry;
use crate::evaluation::suite::file;
use crate::store::evaluations::{self, EvaluationRow, EvaluationState};
use crate::store::groups::{GroupRole, GroupRow, GroupState};
use crate::store::leases::{self, LeaseRow};
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::prepare::{store_all, PreparedScenario};
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::engine::writer::Writer;

/// Takes a lease of scenarios of an evaluation that nobody flies: as many as are wanted, or as there are.
///
/// # Errors
/// A lease that may not be granted, an evaluation that there is not, or one of which nothing is left.
pub async fn create_suite_lease(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    wish: CreateLease,
    evaluation: i64,
) -> Result<GrantedLease, ServiceError> {
    let (row, entries) = writer.change(ReserveSuiteLease { wish, evaluation }).await?;
    let threads = Arc::clone(threads);
    // The suite has no witnesses, and a scenario that is flown can be shown beside one.
    let prepare = move || {
        let one = |(_, entry): &(i64, &'static SuiteEntry)| {
            let admission = admission::admit(&entry.scenario);
            admission.fair?;
            let contested = admission.contested;
            let bracket = admission.bracket.unwrap_or_else(|| entry.bracket.clone());
            Ok(PreparedScenario { scenario: entry.scenario.clone(), bracket, contested, planted: false })
        };
        threads.install(|| {
            entries
                .par_iter()
                .map(|entry| Ok((*entry, one(entry)?)))
                .collect::<Result<Vec<_>, env_core::ScenarioError>>()
        })
    };
    let prepared = tokio::task::spawn_blocking(prepare).await;
    let prepared = prepared.map_err(|error| ServiceError::invalid("evaluation", error.to_string()))?;
    let prepared = prepared.map_err(|error| ServiceError::invalid("evaluation", error.to_string()))?;
    writer.change(FillSuiteLease { row, evaluation, prepared }).await
}

fn unknown(evaluation: i64) -> ServiceError {
    ServiceError::invalid("evaluation", format!("there is no evaluation eval-{evaluation}"))
}

/// Looks what is to be flown; nothing is written yet.
struct ReserveSuiteLease {
    wish: CreateLease,
    evaluation: i64,
}

impl Change for ReserveSuiteLease {
    type Output = (LeaseRow, Vec<(i64, &'static SuiteEntry)>);

    async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
        let Self { mut wish, evaluation } = self;
        let now = tx.now;
        let RunTx { state: mind, conn, .. } = tx.run(wish.run.as_str()).await?;
        let row = evaluations::get(conn, evaluation).await?.ok_or_else(|| unknown(evaluation))?;
        let EvaluationRow { rollouts, version, run, suite, state, trouble, .. } = row;
        if run.as_deref() != Some(wish.run.as_str()) {
            let why = run.map_or_else(
                || "the server flies it by itself".to_owned(),
                |run| format!("it is one of the run {run}"),
            );
            return Err(ServiceError::invalid("evaluation", why));
        }
        if state == EvaluationState::Failed {
            let why = format!("it is over: {}", trouble.unwrap_or_else(|| state.to_string()));
            return Err(ServiceError::invalid("evaluation", why));
        }
        let size = crate::store::to_u32(rollouts);
        if wish.group_size.is_some_and(|given| given != size) {
            let why = format!("the evaluation flies each scenario {size} times; leave it out");
            return Err(ServiceError::invalid("group_size", why));
        }
        wish.group_size = Some(size);
        if let Some(version) = version.map(crate::store::to_u32) {
            if wish.policy_version != 0 && wish.policy_version != version {
                let why = format!("the evaluation is of version {version}; leave it out");
                return Err(ServiceError::invalid("policy_version", why));
            }
            wish.policy_version = version;
        }
        wish.check(mind)?;
        let entries = evaluations::waiting(conn, evaluation, i64::from(wish.groups)).await?;
        if entries.is_empty() {
            return Err(ServiceError::invalid(
                "evaluation",
                "all of its scenarios are flown, or leased to somebody",
            ));
        }
        wish.groups = crate::store::to_u32(entries.len() as i64);
        let lease = wish.new_row(conn, size, now).await?;
        leases::insert(conn, &lease, &[]).await?;
        evaluations::assign(conn, evaluation, lease.id, &entries).await?;
        let suite = file::built_in(&suite).ok_or_else(|| unknown(evaluation))?;
        let all: Vec<&'static SuiteEntry> = suite.suite.entries().collect();
        let picked = entries.into_iter().filter_map(|at| Some((at, *all.get(usize::try_from(at).ok()?)?)));
        tx.emit(&lease.run, &RunEvent::lease(&lease, LeaseEvent::Taken))?;
        Ok((lease, picked.collect()))
    }
}

/// Writes the groups of a reserved lease.
struct FillSuiteLease {
    row: LeaseRow,
    evaluation: i64,
    prepared: Vec<((i64, &'static SuiteEntry), PreparedScenario)>,
}

impl Change for FillSuiteLease {
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let Self { row, evaluation, prepared } = self;
        let row = leases::get(&mut tx.conn, row.id).await?.ok_or_else(|| unknown(evaluation))?;
        if !row.is_active() {
            return Err(ServiceError::LeaseOver { lease: row.name(), status: row.status });
        }
        store_all(&mut tx.conn, prepared.iter().map(|(_, prepared)| prepared)).await?;
        let group = |(number, ((_, entry), prepared)): (i64, ((i64, &'static SuiteEntry), PreparedScenario))| GroupRow {
            number,
            proposal: None,
            layout: None,
            scenario: prepared.scenario.id().0.to_vec(),
            task: entry.scenario.task().id().to_owned(),
            level: None,
            role: GroupRole::Suite,
            is_contested: prepared.contested,
            state: GroupState::Open,
            finished: 0,
            failed: 0,
            successes: 0,
            is_evidence: false,
            is_for_training: false,
        };
        let groups: Vec<GroupRow> = (0i64..).zip(prepared).map(group).collect();
        crate::store::groups::insert(&mut tx.conn, row.id, &groups).await?;
        Ok(GrantedLease { row, groups, scenarios: None })
    }
}
