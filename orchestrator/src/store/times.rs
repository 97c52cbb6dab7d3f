//! What waits for a time, moved together where the clock jumps.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// Moves it by so much: leases hold as long as before, groups that were delivered come again when they would have.
///
/// # Errors
/// The database's.
pub async fn shift(conn: &mut SqliteConnection, by: Millis) -> Result<(), StoreError> {
    query!("UPDATE leases SET expires_at = expires_at + ? WHERE status = 'active'", by)
        .execute(&mut *conn)
        .await?;
    query!("UPDATE trajectory_groups SET visible_at = visible_at + ? WHERE state = 'delivered'", by)
        .execute(conn)
        .await?;
    Ok(())
}
