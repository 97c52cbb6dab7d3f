//! Leases whose episodes are ranges of seeds, and what is claimed of them.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError, to_json};
use crate::clock::Millis;

/// Groups of a lease that share a recipe, as stored.
#[derive(Debug, Clone)]
pub struct RangeRow {
    /// Its number in the lease.
    pub number: i64,
    /// The proposal that its groups serve.
    pub proposal: i64,
    /// Their recipe.
    pub recipe: Vec<u8>,
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<i64>,
    /// The proposal's role.
    pub role: String,
    /// The number of its first group.
    pub first: i64,
    /// How many groups.
    pub groups: i64,
    /// The seed of its first group; each next has the next seed.
    pub seed: i64,
    /// Episodes that finished, as claimed.
    pub finished: i64,
    /// Episodes that failed, as claimed.
    pub failed: i64,
    /// Sum of the scores claimed of those that finished.
    pub score: f64,
}

impl RangeRow {
    /// Whether a group of the lease is one of it.
    #[must_use]
    pub const fn holds(&self, group: i64) -> bool {
        group >= self.first && group < self.first + self.groups
    }
}

/// Adds a range to a lease.
///
/// # Errors
/// The database's.
pub async fn insert_range(conn: &mut SqliteConnection, lease: i64, row: &RangeRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO seed_ranges (lease, number, proposal, recipe, task, level, role, first, groups, seed)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        lease,
        row.number,
        row.proposal,
        row.recipe,
        row.task,
        row.level,
        row.role,
        row.first,
        row.groups,
        row.seed
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The ranges of a lease in order.
///
/// # Errors
/// The database's.
pub async fn ranges(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<RangeRow>, StoreError> {
    Ok(sqlx::query_as!(
        RangeRow,
        "SELECT number, proposal, recipe, task, level, role, first, groups, seed, finished, failed, score FROM seed_ranges
         WHERE lease = ? ORDER BY number",
        lease
    )
    .fetch_all(conn)
    .await?)
}

/// Keeps what the columns come to for a range.
///
/// # Errors
/// The database's.
pub async fn set_range_sums(
    conn: &mut SqliteConnection,
    (lease, number): (i64, i64),
    (finished, failed, score): (i64, i64, f64),
) -> Result<(), StoreError> {
    query!(
        "UPDATE seed_ranges SET finished = ?, failed = ?, score = ? WHERE lease = ? AND number = ?",
        finished,
        failed,
        score,
        lease,
        number
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// What is claimed of a lease's episodes, without the columns.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimRow {
    /// `claimed`, `accepted`, `refused` or `unproven`.
    pub state: String,
    /// Of what was claimed.
    pub digest: Vec<u8>,
    /// The policy that flew them.
    pub policy_version: i64,
    /// How many.
    pub episodes: i64,
    /// Of these, lost to infrastructure.
    pub failed: i64,
    /// Why it was refused.
    pub why: Option<String>,
    /// When it came.
    pub at: Millis,
}

/// Stores a claim with its columns.
///
/// # Errors
/// The database's.
pub async fn insert_claim(
    conn: &mut SqliteConnection,
    lease: i64,
    row: &ClaimRow,
    body: &[u8],
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO column_claims (lease, state, digest, policy_version, episodes, failed, why, body, at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        lease,
        row.state,
        row.digest,
        row.policy_version,
        row.episodes,
        row.failed,
        row.why,
        body,
        row.at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// What is claimed of a lease, if anything is.
///
/// # Errors
/// The database's.
pub async fn claim(conn: &mut SqliteConnection, lease: i64) -> Result<Option<ClaimRow>, StoreError> {
    Ok(sqlx::query_as!(
        ClaimRow,
        "SELECT state, digest, policy_version, episodes, failed, why, at FROM column_claims WHERE lease = ?",
        lease
    )
    .fetch_optional(conn)
    .await?)
}

/// The columns of a claim, as they are stored.
///
/// # Errors
/// The database's.
pub async fn body(conn: &mut SqliteConnection, lease: i64) -> Result<Option<Vec<u8>>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT body FROM column_claims WHERE lease = ?", lease)
        .fetch_optional(conn)
        .await?)
}

/// Says what became of a claim.
///
/// # Errors
/// The database's.
pub async fn settle(
    conn: &mut SqliteConnection,
    lease: i64,
    state: &str,
    why: Option<&str>,
) -> Result<(), StoreError> {
    query!("UPDATE column_claims SET state = ?, why = ? WHERE lease = ?", state, why, lease)
        .execute(conn)
        .await?;
    Ok(())
}

/// Remembers the scores claimed of audited episodes, by their indices.
///
/// # Errors
/// The database's.
pub async fn insert_scores(
    conn: &mut SqliteConnection,
    lease: i64,
    scores: &[(i64, f64)],
) -> Result<(), StoreError> {
    for rows in scores.chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO audited_scores (lease, number, score) ");
        statement.push_values(rows, |mut values, (number, score)| {
            values.push_bind(lease).push_bind(number).push_bind(score);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Indices of the episodes of a lease that are audited, in order.
///
/// # Errors
/// The database's.
pub async fn audited(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT number FROM audited_scores WHERE lease = ? ORDER BY number", lease)
        .fetch_all(conn)
        .await?)
}

/// The scores claimed of audited episodes, by lease and index; none of those that were claimed as failed.
///
/// # Errors
/// The database's.
pub async fn scores(
    conn: &mut SqliteConnection,
    places: &[(i64, i64)],
) -> Result<BTreeMap<(i64, i64), f64>, StoreError> {
    let places = to_json(&places)?;
    let rows = query!(
        r#"SELECT s.lease AS "lease!", s.number AS "number!", s.score AS "score!: f64" FROM json_each(?) AS place
           CROSS JOIN audited_scores s ON s.lease = place.value ->> 0 AND s.number = place.value ->> 1"#,
        places
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| ((row.lease, row.number), row.score)).collect())
}

/// Plain sums over what was claimed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClaimedSums {
    /// Episodes of accepted claims that did not fail.
    pub episodes: i64,
    /// Of these, audited: they are in the plain sums, too.
    pub audited: i64,
    /// Sum of their scores.
    pub score: f64,
    /// Episodes of accepted claims that failed.
    pub failed: i64,
    /// Episodes of refused claims.
    pub refused: i64,
    /// Episodes of claims whose audited logs never came.
    pub unproven: i64,
    /// Episodes of leases that ended unclaimed.
    pub expired: i64,
}

/// Adds to the sums of a task at a level.
///
/// # Errors
/// The database's.
pub async fn add_sums(
    conn: &mut SqliteConnection,
    run: &str,
    (task, level): (&str, Option<i64>),
    sums: &ClaimedSums,
) -> Result<(), StoreError> {
    let level = level.unwrap_or(-1);
    query!(
        "INSERT INTO claimed_sums (run, task, level, episodes, audited, score, failed, refused, unproven, expired)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, level) DO UPDATE SET
             episodes = episodes + excluded.episodes, audited = audited + excluded.audited, score = score + excluded.score,
             failed = failed + excluded.failed, refused = refused + excluded.refused,
             unproven = unproven + excluded.unproven, expired = expired + excluded.expired",
        run,
        task,
        level,
        sums.episodes,
        sums.audited,
        sums.score,
        sums.failed,
        sums.refused,
        sums.unproven,
        sums.expired
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The sums of a run by task.
///
/// # Errors
/// The database's.
pub async fn sums(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(String, ClaimedSums)>, StoreError> {
    let rows = query!(
        r#"SELECT task, sum(episodes) AS "episodes!: i64", sum(audited) AS "audited!: i64", sum(score) AS "score!: f64", sum(failed) AS "failed!: i64",
                  sum(refused) AS "refused!: i64", sum(unproven) AS "unproven!: i64", sum(expired) AS "expired!: i64"
           FROM claimed_sums WHERE run = ? GROUP BY task ORDER BY task"#,
        run
    )
    .fetch_all(conn)
    .await?;
    let sums = rows.into_iter().map(|r| {
        let sums = ClaimedSums {
            episodes: r.episodes,
            audited: r.audited,
            score: r.score,
            failed: r.failed,
            refused: r.refused,
            unproven: r.unproven,
            expired: r.expired,
        };
        (r.task, sums)
    });
    Ok(sums.collect())
}
