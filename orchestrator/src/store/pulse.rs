//! A row that is written to see whether anything can be.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// Writes it.
///
/// # Errors
/// The database's: what is wanted of it.
pub async fn beat(conn: &mut SqliteConnection, now: Millis) -> Result<(), StoreError> {
    query!("INSERT INTO pulse (id, at) VALUES (1, ?) ON CONFLICT (id) DO UPDATE SET at = excluded.at", now)
        .execute(conn)
        .await?;
    Ok(())
}
