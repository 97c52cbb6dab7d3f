//! Reads the rows of the runs and leases whose episodes sessions run.

use std::collections::BTreeSet;

use sqlx::SqliteConnection;
use store::ids::{LeaseId, RunId};
use store::leases::LeaseRow;
use store::runs::{self, RunRow};
use store::scenarios::ScenarioLoader;
use store::{episodes, groups};

use super::pool::PoolGroup;
use crate::engine::error::ServiceError;
use crate::leases::find::find_lease;

/// Finds a run.
///
/// # Errors
/// Returns [`ServiceError::UnknownRun`] if there is no such run.
pub(super) async fn find_run(conn: &mut SqliteConnection, run: &RunId) -> Result<RunRow, ServiceError> {
    let row = runs::get(conn, run.as_str()).await?;
    row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))
}

/// Finds a lease and checks that it is active.
///
/// # Errors
/// Returns [`ServiceError::LeaseClosed`] if it has ended, and the errors of [`find_lease`].
pub(super) async fn find_active(
    conn: &mut SqliteConnection,
    run: &RunId,
    lease: &LeaseId,
) -> Result<LeaseRow, ServiceError> {
    let row = find_lease(conn, run, lease).await?;
    if row.is_active() {
        Ok(row)
    } else {
        Err(ServiceError::LeaseClosed { lease: lease.to_string(), status: row.status })
    }
}

/// Loads the groups of a lease with the indices of their unreported episodes.
///
/// # Errors
/// Returns an error of the store if a query fails or a scenario cannot be read.
pub(super) async fn load_groups(
    conn: &mut SqliteConnection,
    lease: &LeaseRow,
) -> Result<Vec<PoolGroup>, ServiceError> {
    let reported: BTreeSet<i64> = episodes::reported(conn, lease.id).await?.into_iter().collect();
    let rows = groups::of_lease(conn, lease.id).await?;
    let ids: Vec<_> = rows.iter().map(|group| &group.scenario).collect();
    let scenarios = ScenarioLoader::default().all(conn, &ids).await?;
    let mut groups = Vec::with_capacity(rows.len());
    for group in rows {
        let scenario = scenarios.get(&group.scenario)?.clone();
        let first = group.number * lease.group_size;
        let free = (first..first + lease.group_size).filter(|index| !reported.contains(index)).collect();
        let (number, is_begun) = (group.number, group.is_disclosed);
        groups.push(PoolGroup { number, scenario, name: None, free, is_begun });
    }
    Ok(groups)
}
