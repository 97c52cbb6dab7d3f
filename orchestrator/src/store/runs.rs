//! Runs.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A run as stored.
#[derive(Debug, Clone)]
pub struct RunRow {
    /// Its id.
    pub id: String,
    /// Its name for people.
    pub name: String,
    /// The seed of its streams.
    pub seed: i64,
    /// `active` or `paused`.
    pub status: String,
    /// JSON.
    pub settings: String,
    /// The newest policy version a trainer reported.
    pub policy_version: i64,
    /// When it was made.
    pub created_at: Millis,
    /// When it was archived: nobody wants to see it any more.
    pub archived_at: Option<Millis>,
}

/// Stores a new run; false if the id is taken.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &RunRow,
    owner: Option<i64>,
) -> Result<bool, StoreError> {
    let done = query!(
        "INSERT INTO runs (id, name, seed, status, settings, policy_version, created_at, owner)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id) DO NOTHING",
        row.id,
        row.name,
        row.seed,
        row.status,
        row.settings,
        row.policy_version,
        row.created_at,
        owner
    )
    .execute(&mut *conn)
    .await?;
    let fresh = done.rows_affected() == 1;
    if fresh {
        note_settings(conn, &row.id, &row.settings, row.created_at).await?;
    }
    Ok(fresh)
}

/// One run.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: &str) -> Result<Option<RunRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunRow,
        "SELECT id, name, seed, status, settings, policy_version, created_at, archived_at FROM runs WHERE id = ?",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Runs in order of (creation, id), newest last, after a cursor: those that are archived, or the others.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    after: (Millis, &str),
    archived: bool,
    limit: i64,
) -> Result<Vec<RunRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunRow,
        "SELECT id, name, seed, status, settings, policy_version, created_at, archived_at FROM runs
         WHERE (created_at, id) > (?, ?) AND (archived_at IS NOT NULL) = ? ORDER BY created_at, id LIMIT ?",
        after.0,
        after.1,
        archived,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// The ids of all runs.
///
/// # Errors
/// The database's.
pub async fn ids(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT id FROM runs ORDER BY created_at, id").fetch_all(conn).await?)
}

/// Pauses or resumes.
///
/// # Errors
/// The database's.
pub async fn set_status(
    conn: &mut SqliteConnection,
    id: &str,
    status: &str,
    archived_at: Option<Millis>,
) -> Result<(), StoreError> {
    query!("UPDATE runs SET status = ?, archived_at = ? WHERE id = ?", status, archived_at, id)
        .execute(conn)
        .await?;
    Ok(())
}

/// Sets the settings, as JSON.
///
/// # Errors
/// The database's.
pub async fn set_settings(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!("UPDATE runs SET settings = ? WHERE id = ?", settings, id).execute(&mut *conn).await?;
    note_settings(conn, id, settings, now).await
}

/// Notes what a run was told, where that is news.
async fn note_settings(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO run_settings (run, nth, at, settings)
         SELECT ?1, coalesce(max(nth), -1) + 1, ?2, ?3 FROM run_settings WHERE run = ?1
         HAVING ?3 IS NOT (SELECT settings FROM run_settings WHERE run = ?1 ORDER BY nth DESC LIMIT 1)",
        id,
        now,
        settings
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// What a run was told, the newest first: when, and as JSON.
///
/// # Errors
/// The database's.
pub async fn told(
    conn: &mut SqliteConnection,
    id: &str,
    before: i64,
    limit: i64,
) -> Result<Vec<(i64, Millis, String)>, StoreError> {
    let rows = query!(
        "SELECT nth, at, settings FROM run_settings WHERE run = ? AND nth < ? ORDER BY nth DESC LIMIT ?",
        id,
        before,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.nth, row.at, row.settings)).collect())
}

/// What the curriculum of a run was told when it began, as JSON, where that has changed since.
///
/// # Errors
/// The database's.
pub async fn first_curriculum(conn: &mut SqliteConnection, id: &str) -> Result<Option<String>, StoreError> {
    let first = sqlx::query_scalar!("SELECT first_curriculum FROM runs WHERE id = ?", id);
    Ok(first.fetch_optional(conn).await?.flatten())
}

/// Keeps what the curriculum of a run was told when it began, before the first change of it.
///
/// # Errors
/// The database's.
pub async fn keep_first_curriculum(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
) -> Result<(), StoreError> {
    query!("UPDATE runs SET first_curriculum = ? WHERE id = ? AND first_curriculum IS NULL", settings, id)
        .execute(conn)
        .await?;
    Ok(())
}

/// Sets the name for people.
///
/// # Errors
/// The database's.
pub async fn set_name(conn: &mut SqliteConnection, id: &str, name: &str) -> Result<(), StoreError> {
    query!("UPDATE runs SET name = ? WHERE id = ?", name, id).execute(conn).await?;
    Ok(())
}

/// Sets the newest policy version.
///
/// # Errors
/// The database's.
pub async fn set_policy_version(
    conn: &mut SqliteConnection,
    id: &str,
    version: i64,
) -> Result<(), StoreError> {
    query!("UPDATE runs SET policy_version = ? WHERE id = ?", version, id).execute(conn).await?;
    Ok(())
}
