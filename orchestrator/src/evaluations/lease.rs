//! Leases of a suite's scenarios, for a trainer that rolls out an evaluation.

use std::sync::Arc;

use env_core::admission;
use rayon::ThreadPool;
use rayon::prelude::*;
use store::evaluations::{self, EvaluationRow, EvaluationState};
use store::groups::{self, GroupRole, GroupRow};
use store::leases::{self, LeaseRow};
use store::to_u32;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::engine::writer::Writer;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::store_prepared::store_scenarios;
use crate::metrics::LeaseEvent;
use evaluation::suite::SuiteEntry;
use evaluation::suite::file;
use jobs::prepare::PreparedScenario;

/// Leases waiting scenarios of an evaluation: as many groups as requested, or as many as there are.
///
/// # Errors
/// Returns an error if the lease may not be granted, the evaluation does not exist or is over, or no scenario waits.
pub async fn create_suite_lease(
    writer: &Writer,
    threads: &Arc<ThreadPool>,
    request: CreateLease,
    evaluation: i64,
) -> Result<GrantedLease, ServiceError> {
    let ReservedSuiteLease { row, entries } =
        writer.change(ReserveSuiteLease { request, evaluation }).await?;
    let threads = Arc::clone(threads);
    let prepare = move || -> Result<Vec<PreparedScenario>, env_core::ScenarioError> {
        threads.install(|| entries.into_par_iter().map(prepare_entry).collect())
    };
    let prepared = tokio::task::spawn_blocking(prepare).await;
    let prepared = prepared.map_err(|error| ServiceError::invalid("evaluation", error.to_string()))?;
    let prepared = prepared.map_err(|error| ServiceError::invalid("evaluation", error.to_string()))?;
    writer.change(FillSuiteLease { row, evaluation, prepared }).await
}

/// Prepares a scenario of a suite. The suite stores no reference plan, which a replay is shown beside, so the bracket is computed
/// again.
fn prepare_entry(entry: &SuiteEntry) -> Result<PreparedScenario, env_core::ScenarioError> {
    let admission = admission::admit(&entry.scenario);
    admission.fair?;
    Ok(PreparedScenario {
        scenario: entry.scenario.clone(),
        bracket: admission.bracket.unwrap_or_else(|| entry.bracket.clone()),
        is_contested: admission.contested,
        is_planted: false,
    })
}

fn unknown(evaluation: i64) -> ServiceError {
    ServiceError::invalid("evaluation", format!("evaluation eval-{evaluation} does not exist"))
}

/// Writes the lease without groups. A lease that is never filled expires like any other.
struct ReserveSuiteLease {
    request: CreateLease,
    evaluation: i64,
}

struct ReservedSuiteLease {
    row: LeaseRow,
    /// One scenario of the suite for each group.
    entries: Vec<&'static SuiteEntry>,
}

impl Change for ReserveSuiteLease {
    type Output = ReservedSuiteLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<ReservedSuiteLease, ServiceError> {
        let Self { mut request, evaluation } = self;
        let id = request.run.clone();
        let mut run = tx.run(id.as_str()).await?;
        let row = evaluations::get(run.conn, evaluation).await?.ok_or_else(|| unknown(evaluation))?;
        let group_size = apply_evaluation(&row, &mut request)?;
        request.check(&run.state)?;
        let waiting = evaluations::waiting(run.conn, evaluation, i64::from(request.groups)).await?;
        if waiting.is_empty() {
            let reason = "has no scenario left to lease: all are complete or leased";
            return Err(ServiceError::invalid("evaluation", reason));
        }
        request.groups = to_u32(waiting.len() as i64);
        let lease = request.new_row(run.conn, group_size, run.now).await?;
        leases::insert(run.conn, &lease, &[]).await?;
        evaluations::assign(run.conn, evaluation, lease.id, &waiting).await?;
        let suite = file::built_in(&row.suite).ok_or_else(|| unknown(evaluation))?;
        let all: Vec<&'static SuiteEntry> = suite.suite.entries().collect();
        let entry = |position: i64| all.get(usize::try_from(position).ok()?).copied();
        let entries = waiting.into_iter().filter_map(entry).collect();
        run.emit(&RunEvent::lease(&lease, LeaseEvent::Created))?;
        Ok(ReservedSuiteLease { row: lease, entries })
    }
}

/// Sets the group size and the policy version that an evaluation prescribes. Returns the group size.
///
/// # Errors
/// Returns an error if the evaluation is of another run or over, or if the request asks for another group size or version.
fn apply_evaluation(row: &EvaluationRow, request: &mut CreateLease) -> Result<u32, ServiceError> {
    if row.run.as_deref() != Some(request.run.as_str()) {
        let reason = match &row.run {
            Some(run) => format!("belongs to run {run}; create the lease in that run"),
            None => "has no leases: the server rolls it out".to_owned(),
        };
        return Err(ServiceError::invalid("evaluation", reason));
    }
    if row.state == EvaluationState::Failed {
        let reason = row.error.clone().unwrap_or_else(|| row.state.to_string());
        return Err(ServiceError::invalid("evaluation", format!("has ended: {reason}")));
    }
    let group_size = to_u32(row.rollouts);
    if request.group_size.is_some_and(|requested| requested != group_size) {
        let reason = format!("must be {group_size}, the rollouts of the evaluation, or left out");
        return Err(ServiceError::invalid("group_size", reason));
    }
    request.group_size = Some(group_size);
    if let Some(version) = row.policy_version.map(to_u32) {
        if request.policy_version != 0 && request.policy_version != version {
            let reason = format!("must be {version}, the version of the evaluation, or left out");
            return Err(ServiceError::invalid("policy_version", reason));
        }
        request.policy_version = version;
    }
    Ok(group_size)
}

/// Writes the groups of a reserved lease.
struct FillSuiteLease {
    row: LeaseRow,
    evaluation: i64,
    /// One scenario for each group.
    prepared: Vec<PreparedScenario>,
}

impl Change for FillSuiteLease {
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let Self { row, evaluation, prepared } = self;
        tx.run(&row.run).await?; // it may have been deleted since the lease was reserved
        let row = leases::get(&mut tx.conn, row.id).await?.ok_or_else(|| unknown(evaluation))?;
        if !row.is_active() {
            return Err(ServiceError::LeaseClosed { lease: row.name(), status: row.status });
        }
        store_scenarios(&mut tx.conn, prepared.iter()).await?;
        let rows: Vec<GroupRow> =
            (0i64..).zip(&prepared).map(|(number, prepared)| group_row(number, prepared)).collect();
        groups::insert(&mut tx.conn, row.id, &rows).await?;
        Ok(GrantedLease { row, groups: rows, scenarios: None })
    }
}

fn group_row(number: i64, prepared: &PreparedScenario) -> GroupRow {
    let scenario = &prepared.scenario;
    let (task, id) = (scenario.task().id().to_owned(), scenario.id().0.to_vec());
    GroupRow { is_contested: prepared.is_contested, ..GroupRow::open(number, GroupRole::Suite, task, id) }
}
