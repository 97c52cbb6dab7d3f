//! Refills: groups that leases are given in place of groups whose episodes all have the same score. Table `leases`.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Sets how many groups of a lease may be replaced.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn allow(conn: &mut SqliteConnection, lease: i64, limit: i64) -> Result<(), StoreError> {
    query!("UPDATE leases SET remaining_refills = ? WHERE id = ?", limit, lease).execute(conn).await?;
    Ok(())
}

/// Adds up to `groups` pending refills to an active lease, within its limit.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_pending(conn: &mut SqliteConnection, lease: i64, groups: i64) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET pending_refills = pending_refills + min(remaining_refills, ?1),
                           remaining_refills = remaining_refills - min(remaining_refills, ?1)
         WHERE id = ?2 AND status = 'active' AND remaining_refills > 0",
        groups,
        lease
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Pending refills of a lease.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PendingRefill {
    /// Number of the lease.
    pub lease: i64,
    /// Number of groups that it is to be given.
    pub groups: i64,
}

/// Reads the active leases of a run with pending refills, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn pending(conn: &mut SqliteConnection, run: &str) -> Result<Vec<PendingRefill>, StoreError> {
    Ok(sqlx::query_as!(
        PendingRefill,
        "SELECT id AS lease, pending_refills AS groups FROM leases INDEXED BY leases_pending_refills
         WHERE run = ? AND pending_refills > 0 AND status = 'active' ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Counts groups that a lease was given.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_given(conn: &mut SqliteConnection, given: PendingRefill) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET pending_refills = pending_refills - ?1, groups = groups + ?1 WHERE id = ?2",
        given.groups,
        given.lease
    )
    .execute(conn)
    .await?;
    Ok(())
}
