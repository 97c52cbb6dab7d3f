//! Refills: groups that leases are owed in place of groups whose episodes all have the same score. Table `leases`.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Sets how many groups of a lease may be replaced.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn allow(conn: &mut SqliteConnection, lease: i64, limit: i64) -> Result<(), StoreError> {
    query!("UPDATE leases SET refills = ? WHERE id = ?", limit, lease).execute(conn).await?;
    Ok(())
}

/// Owes `groups` more groups to an active lease, up to its limit.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn owe(conn: &mut SqliteConnection, lease: i64, groups: i64) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET owed = owed + min(refills, ?1), refills = refills - min(refills, ?1)
         WHERE id = ?2 AND status = 'active' AND refills > 0",
        groups,
        lease
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// A lease that is owed groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwedRefill {
    /// Number of the lease.
    pub lease: i64,
    /// Groups that it is owed.
    pub groups: i64,
}

/// Reads the active leases of a run that are owed groups, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn owed(conn: &mut SqliteConnection, run: &str) -> Result<Vec<OwedRefill>, StoreError> {
    Ok(sqlx::query_as!(
        OwedRefill,
        "SELECT id AS lease, owed AS groups FROM leases INDEXED BY leases_owed
         WHERE run = ? AND owed > 0 AND status = 'active' ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Counts groups that a lease was given.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_given(conn: &mut SqliteConnection, given: OwedRefill) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET owed = owed - ?1, groups = groups + ?1 WHERE id = ?2",
        given.groups,
        given.lease
    )
    .execute(conn)
    .await?;
    Ok(())
}
