//! Groups that are disclosed to their trainer or become slots after they were leased.

use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};

/// Marks groups of a lease as disclosed; those in `slots` become slots.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn disclose(
    conn: &mut SqliteConnection,
    lease: i64,
    numbers: &[i64],
    slots: &[i64],
) -> Result<(), StoreError> {
    let (numbers, slots) = (to_json(&numbers)?, to_json(&slots)?);
    query!(
        "UPDATE groups SET is_disclosed = 1, is_slot = is_slot OR number IN (SELECT value FROM json_each(?))
         WHERE lease = ? AND number IN (SELECT value FROM json_each(?))",
        slots,
        lease,
        numbers
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Makes groups of a lease slots.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_slots(conn: &mut SqliteConnection, lease: i64, numbers: &[i64]) -> Result<(), StoreError> {
    let numbers = to_json(&numbers)?;
    query!(
        "UPDATE groups SET is_slot = 1 WHERE lease = ? AND number IN (SELECT value FROM json_each(?))",
        lease,
        numbers
    )
    .execute(conn)
    .await?;
    Ok(())
}
