//! Runs, their settings and their seeds. Tables `runs`, `run_settings` and `used_run_seeds`.
//!
//! Functions that read runs skip those that are being deleted ([`run_deletion`](super::run_deletion)).

use sqlx::{SqliteConnection, query};

use super::{StoreError, text_enum, to_json};
use crate::Millis;
use crate::name_set::NameSet;
use crate::principals::PrincipalId;

text_enum! {
    /// Status of a run: only active runs grant leases.
    pub enum RunStatus: "a run's status" {
        /// The run grants leases.
        Active = "active",
        /// The run grants no leases. Results of leases that were granted before are still accepted.
        Paused = "paused",
    }
}

/// Row of the `runs` table.
#[derive(Debug, Clone)]
pub struct RunRow {
    /// Id of the run.
    pub id: String,
    /// Name that is displayed.
    pub name: String,
    /// Seed of the run's random streams.
    pub seed: i64,
    /// Status of the run: active or paused.
    pub status: RunStatus,
    /// The settings as JSON.
    pub settings: String,
    /// Newest policy version that a trainer reported.
    pub policy_version: i64,
    /// When the run was created.
    pub created_at: Millis,
    /// When the run was archived; archived runs are left out of lists.
    pub archived_at: Option<Millis>,
    /// When the run was paused; none while it is active.
    pub paused_at: Option<Millis>,
    /// True if another run, possibly a deleted one, has the same seed.
    pub is_seed_reused: bool,
    /// Tags of the run.
    pub tags: NameSet,
    /// Name of the principal that owns the run; none if it was created without authentication.
    pub owner: Option<String>,
    /// Names of the principals that may take part in the run beside its owner.
    pub members: NameSet,
    /// Note of the team; empty if there is none.
    pub note: String,
    /// Number of its episodes: finished, or of accepted claims.
    pub episodes: i64,
    /// Mean skill of its latest episodes; none before there are any with a skill.
    pub skill: Option<f64>,
    /// When the run had its first results.
    pub first_results_at: Option<Millis>,
    /// When the run had its latest results.
    pub last_results_at: Option<Millis>,
}

/// Selects [`RunRow`]s of runs that exist: takes what follows `FROM` and the arguments of the statement. The runs are `r`, their totals
/// `t`.
macro_rules! query_runs {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            RunRow,
            r#"SELECT r.id, r.name, r.seed, r.status AS "status: RunStatus", r.settings, r.policy_version, r.created_at,
                      r.archived_at, r.paused_at, r.is_seed_reused AS "is_seed_reused: bool",
                      (SELECT json_group_array(tag) FROM run_tags WHERE run = r.id) AS "tags!: NameSet",
                      (SELECT name FROM principals WHERE id = r.owner) AS "owner: String",
                      (SELECT json_group_array(p.name) FROM run_members m CROSS JOIN principals p ON p.id = m.principal
                       WHERE m.run = r.id) AS "members!: NameSet",
                      r.note, coalesce(t.episodes, 0) AS "episodes!: i64", t.skill AS "skill: f64",
                      t.first_results_at AS "first_results_at?: i64", t.last_results_at AS "last_results_at?: i64"
               FROM "# + $rest,
            $($argument),+
        )
    };
}

/// Id and name of a run.
#[derive(Debug, Clone)]
pub struct RunNameRow {
    /// Id of the run.
    pub id: String,
    /// Name that is displayed.
    pub name: String,
    /// True if the run is archived.
    pub is_archived: bool,
}

/// Settings of a run that were in force from a moment on.
#[derive(Debug, Clone)]
pub struct SettingsRow {
    /// Number of the change, from 0.
    pub revision: i64,
    /// When the settings came into force.
    pub at: Millis,
    /// The settings as JSON.
    pub settings: String,
}

/// Stores a new run without tags. Returns false if the id is taken, possibly by a run that is being deleted.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &RunRow,
    owner: Option<PrincipalId>,
) -> Result<bool, StoreError> {
    let done = query!(
        "INSERT INTO runs (id, name, seed, status, settings, policy_version, created_at, owner, is_seed_reused, note)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id) DO NOTHING",
        row.id,
        row.name,
        row.seed,
        row.status,
        row.settings,
        row.policy_version,
        row.created_at,
        owner,
        row.is_seed_reused,
        row.note
    )
    .execute(&mut *conn)
    .await?;
    let is_new = done.rows_affected() == 1;
    if is_new {
        set_settings(conn, &row.id, &row.settings, row.created_at).await?;
    }
    Ok(is_new)
}

/// Records the seed of a new run. Returns true if another run, possibly a deleted one, used it before.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn record_seed(conn: &mut SqliteConnection, seed: i64) -> Result<bool, StoreError> {
    let done = query!("INSERT INTO used_run_seeds (seed) VALUES (?) ON CONFLICT (seed) DO NOTHING", seed);
    Ok(done.execute(conn).await?.rows_affected() == 0)
}

/// Marks the runs with a seed as runs of a reused seed. Returns the ids of those that were not marked before.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn mark_seed_reused(conn: &mut SqliteConnection, seed: i64) -> Result<Vec<String>, StoreError> {
    Ok(sqlx::query_scalar!(
        "UPDATE runs SET is_seed_reused = 1 WHERE seed = ? AND is_seed_reused = 0 AND deleted_at IS NULL
         RETURNING id",
        seed
    )
    .fetch_all(conn)
    .await?)
}

/// Reads a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, id: &str) -> Result<Option<RunRow>, StoreError> {
    Ok(query_runs!(
        "runs r LEFT JOIN run_totals t ON t.run = r.id WHERE r.id = ? AND r.deleted_at IS NULL",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Returns true if a run exists.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn exists(conn: &mut SqliteConnection, id: &str) -> Result<bool, StoreError> {
    let found = sqlx::query_scalar!("SELECT id FROM runs WHERE id = ? AND deleted_at IS NULL", id);
    Ok(found.fetch_optional(conn).await?.is_some())
}

/// Ids of runs that were archived before a time, the earliest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn archived_before(
    conn: &mut SqliteConnection,
    at: Millis,
    limit: i64,
) -> Result<Vec<String>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT id FROM runs WHERE archived_at < ? AND deleted_at IS NULL ORDER BY archived_at LIMIT ?",
        at,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the runs with these ids, in their order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_ids(conn: &mut SqliteConnection, ids: &[String]) -> Result<Vec<RunRow>, StoreError> {
    let ids = to_json(&ids)?;
    Ok(query_runs!(
        "json_each(?) wanted CROSS JOIN runs r ON r.id = wanted.value LEFT JOIN run_totals t ON t.run = r.id
         WHERE r.deleted_at IS NULL ORDER BY wanted.key",
        ids
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the ids and names of all runs, in order of creation.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn names(conn: &mut SqliteConnection) -> Result<Vec<RunNameRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunNameRow,
        r#"SELECT id, name, archived_at IS NOT NULL AS "is_archived!: bool" FROM runs
           WHERE deleted_at IS NULL ORDER BY created_at, id"#
    )
    .fetch_all(conn)
    .await?)
}

/// Pauses, resumes or archives a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_status(
    conn: &mut SqliteConnection,
    id: &str,
    status: RunStatus,
    archived_at: Option<Millis>,
    paused_at: Option<Millis>,
) -> Result<(), StoreError> {
    query!(
        "UPDATE runs SET status = ?, archived_at = ?, paused_at = ? WHERE id = ?",
        status,
        archived_at,
        paused_at,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Sets the settings of a run, as JSON, and the columns that lists read instead.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn set_settings(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!(
        "UPDATE runs SET settings = ?2, strategy = coalesce(?2 ->> '$.curriculum.strategy', ''),
                tasks = coalesce((SELECT group_concat(task) FROM (
                            SELECT value ->> '$.task' AS task FROM json_each(?2, '$.curriculum.tasks') ORDER BY task)), '')
         WHERE id = ?1",
        id,
        settings
    )
    .execute(&mut *conn)
    .await?;
    append_settings(conn, id, settings, now).await
}

/// Adds settings to the history of a run, unless they are the same as the last ones.
async fn append_settings(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
    now: Millis,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO run_settings (run, revision, at, settings)
         SELECT ?1, coalesce(max(revision), -1) + 1, ?2, ?3 FROM run_settings WHERE run = ?1
         HAVING ?3 IS NOT (SELECT settings FROM run_settings WHERE run = ?1 ORDER BY revision DESC LIMIT 1)",
        id,
        now,
        settings
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the history of a run's settings below a number, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn settings_history(
    conn: &mut SqliteConnection,
    id: &str,
    before: i64,
    limit: i64,
) -> Result<Vec<SettingsRow>, StoreError> {
    Ok(sqlx::query_as!(
        SettingsRow,
        "SELECT revision, at, settings FROM run_settings WHERE run = ? AND revision < ? ORDER BY revision DESC LIMIT ?",
        id,
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the curriculum settings that a run began with, as JSON; none if they never changed.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn initial_curriculum(conn: &mut SqliteConnection, id: &str) -> Result<Option<String>, StoreError> {
    let first = sqlx::query_scalar!("SELECT initial_curriculum FROM runs WHERE id = ?", id);
    Ok(first.fetch_optional(conn).await?.flatten())
}

/// Keeps the curriculum settings that a run began with, before they change for the first time.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn keep_initial_curriculum(
    conn: &mut SqliteConnection,
    id: &str,
    settings: &str,
) -> Result<(), StoreError> {
    query!(
        "UPDATE runs SET initial_curriculum = ? WHERE id = ? AND initial_curriculum IS NULL",
        settings,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Sets the display name of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_name(conn: &mut SqliteConnection, id: &str, name: &str) -> Result<(), StoreError> {
    query!("UPDATE runs SET name = ? WHERE id = ?", name, id).execute(conn).await?;
    Ok(())
}

/// Sets the note of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_note(conn: &mut SqliteConnection, id: &str, note: &str) -> Result<(), StoreError> {
    query!("UPDATE runs SET note = ? WHERE id = ?", note, id).execute(conn).await?;
    Ok(())
}

/// Sets the newest policy version of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_policy_version(
    conn: &mut SqliteConnection,
    id: &str,
    version: i64,
) -> Result<(), StoreError> {
    query!("UPDATE runs SET policy_version = ? WHERE id = ?", version, id).execute(conn).await?;
    Ok(())
}
