//! Looks a lease up by its id.

use sqlx::SqliteConnection;
use store::compacted_leases;
use store::ids::{LeaseId, RunId};
use store::leases::{self, LeaseRow};
use store::runs;

use crate::engine::error::ServiceError;
use crate::ownership::{Actor, check_lease};

/// Returns the row of a lease of this run, compacted or not.
///
/// # Errors
/// Returns [`ServiceError::UnknownLease`] if there is no such lease, or if it belongs to another run or database.
pub async fn find_lease(
    conn: &mut SqliteConnection,
    run: &RunId,
    lease: &LeaseId,
) -> Result<LeaseRow, ServiceError> {
    let row = match leases::get(conn, lease.number).await? {
        None => compacted_leases::get(conn, run.as_str(), lease.number).await?.map(|lease| lease.row),
        row => row,
    };
    let row = row.filter(|row| row.id_suffix == lease.suffix && row.run == run.as_str());
    // A deleted run has no active lease.
    if !row.as_ref().is_some_and(LeaseRow::is_active) && !runs::exists(conn, run.as_str()).await? {
        return Err(ServiceError::UnknownRun(run.to_string()));
    }
    row.ok_or_else(|| ServiceError::UnknownLease(lease.to_string()))
}

/// Returns the row of a lease of this run that an actor may use, compacted or not.
///
/// # Errors
/// Returns the errors of [`find_lease`], and [`ServiceError::ForeignLease`] if the lease belongs to another principal.
pub async fn find_own_lease(
    conn: &mut SqliteConnection,
    run: &RunId,
    lease: &LeaseId,
    actor: Actor,
) -> Result<LeaseRow, ServiceError> {
    let row = find_lease(conn, run, lease).await?;
    check_lease(actor, &row)?;
    Ok(row)
}
