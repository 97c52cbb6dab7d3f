//! Stored deadlines, which are shifted together when the system's clock jumps.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Shifts all deadlines by `by` milliseconds: leases keep their remaining time, pauses their duration, and delivered trajectory groups are delivered
/// again after the same time.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn shift(conn: &mut SqliteConnection, by: Millis) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET expires_at = expires_at + ?1, first_expires_at = first_expires_at + ?1
         WHERE status = 'active'",
        by
    )
    .execute(&mut *conn)
    .await?;
    query!("UPDATE runs SET paused_at = paused_at + ? WHERE paused_at IS NOT NULL", by)
        .execute(&mut *conn)
        .await?;
    query!("UPDATE trajectory_groups SET visible_at = visible_at + ? WHERE state = 'delivered'", by)
        .execute(conn)
        .await?;
    Ok(())
}
