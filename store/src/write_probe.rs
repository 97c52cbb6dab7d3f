//! A row that is written to find out whether the database can be written. Table `write_probe`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Bytes that a large probe writes: as many as a large change.
const LARGE_PROBE_BYTES: i64 = 1 << 20;

/// Writes the row. After a failed change the probe must be large: a small row may fit where the change did not.
///
/// # Errors
/// Returns [`StoreError::Database`] if the database cannot be written.
pub async fn write(conn: &mut SqliteConnection, now: Millis, is_large: bool) -> Result<(), StoreError> {
    let bytes = if is_large { LARGE_PROBE_BYTES } else { 0 };
    query!(
        "INSERT INTO write_probe (id, at, padding) VALUES (1, ?, zeroblob(?))
         ON CONFLICT (id) DO UPDATE SET at = excluded.at, padding = excluded.padding",
        now,
        bytes
    )
    .execute(conn)
    .await?;
    Ok(())
}
