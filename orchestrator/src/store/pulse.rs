//! A row that is written to see whether anything can be.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// Bytes that are written along where the last change could not be: as many as a large one has.
const ROOM: i64 = 1 << 20;

/// Writes it; after trouble a large one.
///
/// # Errors
/// The database's: what is wanted of it.
pub async fn beat(conn: &mut SqliteConnection, now: Millis, troubled: bool) -> Result<(), StoreError> {
    let room = if troubled { ROOM } else { 0 };
    query!(
        "INSERT INTO pulse (id, at, room) VALUES (1, ?, zeroblob(?))
         ON CONFLICT (id) DO UPDATE SET at = excluded.at, room = excluded.room",
        now,
        room
    )
    .execute(conn)
    .await?;
    Ok(())
}
