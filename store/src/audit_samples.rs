//! The groups of active leases of columns that will be audited, which no client knows before the claim. Table `audit_samples`.

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError};

/// Row of the `audit_samples` table, without its lease: a group that will be audited.
#[derive(Debug, Clone)]
pub struct SampledGroupRow {
    /// Number of the group in the lease.
    pub number: i64,
    /// Id of the scenario.
    pub scenario: Vec<u8>,
    /// True if the scenario is contested.
    pub is_contested: bool,
    /// True if the group is a slot: its result is evidence of mastery.
    pub is_slot: bool,
}

/// Stores the audit sample of a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    lease: i64,
    sample: &[SampledGroupRow],
) -> Result<(), StoreError> {
    for rows in sample.chunks(MAX_ROWS) {
        let mut statement =
            QueryBuilder::new("INSERT INTO audit_samples (lease, number, scenario, is_contested, is_slot) ");
        statement.push_values(rows, |mut values, row| {
            values.push_bind(lease).push_bind(row.number).push_bind(row.scenario.clone());
            values.push_bind(row.is_contested).push_bind(row.is_slot);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the audit sample of a lease, in order. It is empty once the lease has a claim or has ended.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_lease(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<SampledGroupRow>, StoreError> {
    Ok(sqlx::query_as!(
        SampledGroupRow,
        r#"SELECT number, scenario, is_contested AS "is_contested: bool", is_slot AS "is_slot: bool"
           FROM audit_samples WHERE lease = ? ORDER BY number"#,
        lease
    )
    .fetch_all(conn)
    .await?)
}

/// Deletes the audit sample of a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn delete(conn: &mut SqliteConnection, lease: i64) -> Result<(), StoreError> {
    query!("DELETE FROM audit_samples WHERE lease = ?", lease).execute(conn).await?;
    Ok(())
}
