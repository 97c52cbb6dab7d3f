//! Size and integrity of a whole database.

use serde::Serialize;
use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::columns::ClaimState;
use super::ids::{EpisodeId, LeaseId};
use super::runs::RunStatus;
use crate::Millis;

/// Findings of one kind that are listed at most.
const MAX_FINDINGS: i64 = 20;

/// Size of a database.
#[derive(Debug, Clone, Serialize)]
pub struct DatabaseSize {
    /// Version of the database schema.
    pub schema: i64,
    /// Size of all pages, bytes.
    pub bytes: i64,
    /// Size of the free pages, bytes. `sparring db vacuum` returns them to the disk.
    pub free_bytes: i64,
    /// Tables with the size of their rows and indexes in bytes, largest first.
    pub tables: Vec<(String, i64)>,
}

/// Size of a database's pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageBytes {
    /// Size of all pages, bytes.
    pub all: i64,
    /// Size of the free pages, bytes.
    pub free: i64,
}

/// Reads the size of the pages.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn page_bytes(conn: &mut SqliteConnection) -> Result<PageBytes, StoreError> {
    let page: i64 = sqlx::query_scalar("PRAGMA page_size").fetch_one(&mut *conn).await?;
    let pages: i64 = sqlx::query_scalar("PRAGMA page_count").fetch_one(&mut *conn).await?;
    let free: i64 = sqlx::query_scalar("PRAGMA freelist_count").fetch_one(conn).await?;
    Ok(PageBytes { all: page * pages, free: page * free })
}

/// Reads the size of a database and its tables. This reads every page.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn size(conn: &mut SqliteConnection) -> Result<DatabaseSize, StoreError> {
    let PageBytes { all, free } = page_bytes(conn).await?;
    let schema =
        sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations").fetch_one(&mut *conn).await?;
    let tables = sqlx::query_as(
        "SELECT s.tbl_name, sum(d.pgsize) FROM dbstat d JOIN sqlite_schema s ON s.name = d.name
         WHERE d.aggregate = TRUE GROUP BY s.tbl_name ORDER BY 2 DESC, 1",
    );
    let tables = tables.fetch_all(conn).await?;
    Ok(DatabaseSize { schema, bytes: all, free_bytes: free, tables })
}

/// Numbers of a run.
#[derive(Debug, Clone, Serialize)]
pub struct RunSize {
    /// Id of the run.
    pub run: String,
    /// Status of the run: active or paused.
    pub status: RunStatus,
    /// Number of active leases.
    pub active: i64,
    /// Reported episodes that are stored whole.
    pub whole: i64,
    /// Reported episodes of compacted leases.
    pub compacted: i64,
    /// Episodes of accepted claims.
    pub claimed: i64,
    /// Number of level moves.
    pub moves: i64,
    /// Layouts that the gate admitted.
    pub layouts: i64,
    /// When the run was created.
    pub created_at: Millis,
}

/// Reads the numbers of all runs, oldest first. This reads all of their rows.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn runs(conn: &mut SqliteConnection) -> Result<Vec<RunSize>, StoreError> {
    Ok(sqlx::query_as!(
        RunSize,
        r#"SELECT r.id AS run, r.status AS "status: RunStatus", r.created_at,
                  (SELECT count(*) FROM leases l WHERE l.run = r.id AND l.status = 'active') AS "active!: i64",
                  (SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id WHERE l.run = r.id) AS "whole!: i64",
                  (SELECT coalesce(sum(episodes), 0) FROM compacted_leases f WHERE f.run = r.id) AS "compacted!: i64",
                  (SELECT coalesce(sum(episodes), 0) FROM claim_counters c WHERE c.run = r.id) AS "claimed!: i64",
                  (SELECT count(*) FROM level_moves m WHERE m.run = r.id) AS "moves!: i64",
                  (SELECT count(*) FROM layouts y WHERE y.run = r.id AND y.state <> 'refused') AS "layouts!: i64"
           FROM runs r WHERE r.deleted_at IS NULL ORDER BY r.created_at, r.id"#
    )
    .fetch_all(conn)
    .await?)
}

/// Checks the pages of the file with SQLite's own check. Returns the findings as sentences.
///
/// # Errors
/// Returns [`StoreError::Database`] if the check fails.
pub async fn check_pages(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let mut found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check(20)").fetch_all(conn).await?;
    found.retain(|line| line != "ok");
    Ok(found)
}

/// Checks that every reference leads to a row. Returns the findings as sentences.
///
/// # Errors
/// Returns [`StoreError::Database`] if the check fails.
pub async fn check_references(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let dangling: Vec<(String, Option<i64>, String)> =
        sqlx::query_as("SELECT \"table\", rowid, parent FROM pragma_foreign_key_check LIMIT ?")
            .bind(MAX_FINDINGS)
            .fetch_all(conn)
            .await?;
    let found = dangling.into_iter().map(|(table, row, parent)| {
        let row = row.map_or_else(String::new, |row| format!(" {row}"));
        format!("row{row} of {table} refers to a missing row of {parent}")
    });
    Ok(found.collect())
}

/// Finds episodes that have an outcome but no actions, except those of runs that are being deleted. Returns sentences.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn check_logs(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let rows = query!(
        r#"SELECT e.lease AS "lease!", e.number AS "number!", l.id_suffix FROM episodes e
           JOIN leases l ON l.id = e.lease JOIN runs r ON r.id = l.run AND r.deleted_at IS NULL
           WHERE e.outcome IS NOT NULL
                 AND NOT EXISTS (SELECT 1 FROM action_logs a WHERE a.lease = e.lease AND a.number = e.number)
           LIMIT 20"#
    );
    let rows = rows.fetch_all(conn).await?;
    let found = rows.into_iter().map(|row| {
        let lease = LeaseId { number: row.lease, suffix: row.id_suffix };
        format!("{} has an outcome but no actions", EpisodeId { lease, index: row.number })
    });
    Ok(found.collect())
}

/// Finds groups whose counts differ from their episodes, except those of runs that are being deleted. Returns sentences.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn check_groups(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let rows = query!(
        r#"SELECT g.lease AS "lease!", g.number AS "number!", g.finished, g.successes, count(e.number) AS "episodes!: i64",
                  coalesce(sum(e.success), 0) AS "successful!: i64"
           FROM groups g JOIN leases l ON l.id = g.lease JOIN runs r ON r.id = l.run AND r.deleted_at IS NULL
           LEFT JOIN episodes e ON e.lease = g.lease AND e.state = 'finished'
                AND e.number >= g.number * l.group_size AND e.number < (g.number + 1) * l.group_size
           WHERE l.form = 'groups' AND l.is_compacted = 0
           GROUP BY g.lease, g.number
           HAVING g.finished <> count(e.number) OR g.successes <> coalesce(sum(e.success), 0)
           LIMIT 20"#
    );
    let rows = rows.fetch_all(conn).await?;
    let found = rows.into_iter().map(|row| {
        format!(
            "group {} of lease {} counts {} finished episodes but has {}, and counts {} successes but has {}",
            row.number, row.lease, row.finished, row.episodes, row.successes, row.successful
        )
    });
    Ok(found.collect())
}

/// A value that is stored twice: as a counter, and as the rows that it counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CountedTwice<T> {
    /// Value by the counters.
    pub counters: T,
    /// Value by the rows that are stored whole.
    pub rows: T,
}

/// Numbers of finished episodes and of those that succeeded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FinishedEpisodes {
    /// Number of finished episodes.
    pub episodes: i64,
    /// Number of finished episodes that succeeded.
    pub successes: i64,
}

/// Counts the finished episodes of a run, by the task counters and by the rows. Compacted episodes are not among the rows.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn finished_episodes(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<CountedTwice<FinishedEpisodes>, StoreError> {
    let counters = sqlx::query_as!(
        FinishedEpisodes,
        r#"SELECT coalesce(sum(episodes), 0) AS "episodes!: i64", coalesce(sum(successes), 0) AS "successes!: i64"
           FROM task_counters WHERE run = ?"#,
        run
    )
    .fetch_one(&mut *conn)
    .await?;
    let rows = sqlx::query_as!(
        FinishedEpisodes,
        r#"SELECT count(*) AS "episodes!: i64", coalesce(sum(e.success), 0) AS "successes!: i64"
           FROM leases l JOIN episodes e ON e.lease = l.id
           JOIN groups g ON g.lease = l.id AND g.number = e.number / l.group_size
           WHERE l.run = ?1 AND e.state = 'finished' AND (g.proposal IS NOT NULL OR g.layout IS NOT NULL)
                 AND (l.form = 'groups' OR l.is_compacted = 1 OR EXISTS (
                     SELECT 1 FROM column_claims c WHERE c.lease = l.id AND c.state = 'accepted'))"#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok(CountedTwice { counters, rows })
}

/// Episodes that were claimed in columns, by the state of their claims.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClaimedEpisodes {
    /// Episodes of accepted claims that finished.
    pub finished: i64,
    /// Episodes of accepted claims that the infrastructure lost.
    pub failed: i64,
    /// Episodes of refused claims.
    pub refused: i64,
    /// Episodes of claims whose audited logs never arrived.
    pub unproven: i64,
}

impl ClaimedEpisodes {
    /// Adds the episodes of a claim. A claim that waits for its logs counts nowhere yet.
    pub const fn add(&mut self, state: ClaimState, episodes: i64, failed: i64) {
        match state {
            ClaimState::Claimed => {}
            ClaimState::Accepted => {
                self.finished += episodes - failed;
                self.failed += failed;
            }
            ClaimState::Refused => self.refused += episodes,
            ClaimState::Unproven => self.unproven += episodes,
        }
    }
}

/// Counts the claimed episodes of a run, by the counters and by the claims. Compacted claims are not among the rows.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn claimed_episodes(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<CountedTwice<ClaimedEpisodes>, StoreError> {
    let counters = sqlx::query_as!(
        ClaimedEpisodes,
        r#"SELECT coalesce(sum(episodes), 0) AS "finished!: i64", coalesce(sum(failed), 0) AS "failed!: i64",
                  coalesce(sum(refused), 0) AS "refused!: i64", coalesce(sum(unproven), 0) AS "unproven!: i64"
           FROM claim_counters WHERE run = ?"#,
        run
    )
    .fetch_one(&mut *conn)
    .await?;
    let claims = query!(
        r#"SELECT c.state AS "state: ClaimState", sum(c.episodes) AS "episodes!: i64", sum(c.failed) AS "failed!: i64"
           FROM leases l JOIN column_claims c ON c.lease = l.id WHERE l.run = ? GROUP BY c.state"#,
        run
    );
    let mut rows = ClaimedEpisodes::default();
    for claim in claims.fetch_all(conn).await? {
        rows.add(claim.state, claim.episodes, claim.failed);
    }
    Ok(CountedTwice { counters, rows })
}
