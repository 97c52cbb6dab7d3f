//! Groups that leases are owed in place of those whose episodes all came to the same.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Says how many groups a lease may be given in place of others.
///
/// # Errors
/// The database's.
pub async fn allow(conn: &mut SqliteConnection, lease: i64, most: i64) -> Result<(), StoreError> {
    query!("UPDATE leases SET refills = ? WHERE id = ?", most, lease).execute(conn).await?;
    Ok(())
}

/// Owes an active lease so many more, as far as it may be given any.
///
/// # Errors
/// The database's.
pub async fn owe(conn: &mut SqliteConnection, lease: i64, more: i64) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET owed = owed + min(refills, ?1), refills = refills - min(refills, ?1)
         WHERE id = ?2 AND status = 'active' AND refills > 0",
        more,
        lease
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Active leases of a run that are owed some, the oldest first, with how many.
///
/// # Errors
/// The database's.
pub async fn owed(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(i64, i64)>, StoreError> {
    let rows = query!(
        "SELECT id, owed FROM leases INDEXED BY leases_owed
         WHERE run = ? AND owed > 0 AND status = 'active' ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.id, row.owed)).collect())
}

/// Counts groups that a lease was given.
///
/// # Errors
/// The database's.
pub async fn given(conn: &mut SqliteConnection, lease: i64, groups: i64) -> Result<(), StoreError> {
    query!("UPDATE leases SET owed = owed - ?1, groups = groups + ?1 WHERE id = ?2", groups, lease)
        .execute(conn)
        .await?;
    Ok(())
}
