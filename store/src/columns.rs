//! Leases of columns: their ranges of seeds, and what trainers claim of their episodes. Tables `seed_ranges`, `column_claims`,
//! `audited_scores` and `claim_counters`.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::groups::GroupRole;
use super::keys::EpisodeKey;
use super::{MAX_ROWS, StoreError, text_enum, to_json};
use crate::Millis;

text_enum! {
    /// State of a claim of columns.
    pub enum ClaimState: "a claim's state" {
        /// Logs of the audited groups are still missing.
        Claimed = "claimed",
        /// All audited logs replayed as claimed.
        Accepted = "accepted",
        /// An audited log did not replay as claimed.
        Refused = "refused",
        /// Audited logs did not arrive before the lease ended.
        Unproven = "unproven",
    }
}

/// Row of the `seed_ranges` table, without its lease: groups that share a recipe.
#[derive(Debug, Clone)]
pub struct SeedRangeRow {
    /// Index of the range in the lease, from 0.
    pub number: i64,
    /// Sequence number of the proposal that the groups serve.
    pub proposal: i64,
    /// Id of the recipe.
    pub recipe: Vec<u8>,
    /// Task of the recipe.
    pub task: String,
    /// Level of the proposal; none for strategies without levels.
    pub level: Option<i64>,
    /// Role of the proposal.
    pub role: GroupRole,
    /// Number of the first group in the lease.
    pub first_group: i64,
    /// Number of its groups.
    pub groups: i64,
    /// Seed of the first group. Each following group has the next seed.
    pub first_seed: i64,
    /// Finished episodes, as claimed.
    pub finished: i64,
    /// Failed episodes, as claimed.
    pub failed: i64,
    /// Sum of the claimed scores of the finished episodes.
    pub score_sum: f64,
}

impl SeedRangeRow {
    /// True if the group with this number in the lease belongs to the range.
    #[must_use]
    pub const fn holds(&self, group: i64) -> bool {
        group >= self.first_group && group < self.first_group + self.groups
    }
}

/// Adds a range to a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert_range(
    conn: &mut SqliteConnection,
    lease: i64,
    row: &SeedRangeRow,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO seed_ranges (lease, number, proposal, recipe, task, level, role, first_group, groups, first_seed)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        lease,
        row.number,
        row.proposal,
        row.recipe,
        row.task,
        row.level,
        row.role,
        row.first_group,
        row.groups,
        row.first_seed
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the ranges of a lease in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn ranges(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<SeedRangeRow>, StoreError> {
    Ok(sqlx::query_as!(
        SeedRangeRow,
        r#"SELECT number, proposal, recipe, task, level, role AS "role: GroupRole", first_group, groups, first_seed, finished,
                  failed, score_sum
           FROM seed_ranges WHERE lease = ? ORDER BY number"#,
        lease
    )
    .fetch_all(conn)
    .await?)
}

/// Totals of the claimed episodes of one range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeTotals {
    /// Index of the range in the lease.
    pub number: i64,
    /// Number of finished episodes.
    pub finished: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Sum of the scores of the finished episodes.
    pub score_sum: f64,
}

/// Stores the totals of a range.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_range_totals(
    conn: &mut SqliteConnection,
    lease: i64,
    totals: &RangeTotals,
) -> Result<(), StoreError> {
    query!(
        "UPDATE seed_ranges SET finished = ?, failed = ?, score_sum = ? WHERE lease = ? AND number = ?",
        totals.finished,
        totals.failed,
        totals.score_sum,
        lease,
        totals.number
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Row of the `column_claims` table, without its lease and its columns.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnClaimRow {
    /// State of the claim.
    pub state: ClaimState,
    /// Digest of the claimed columns.
    pub digest: Vec<u8>,
    /// Version of the policy that ran the episodes.
    pub policy_version: i64,
    /// Number of claimed episodes.
    pub episodes: i64,
    /// Claimed episodes that the infrastructure lost.
    pub failed: i64,
    /// Why the claim was refused.
    pub refusal_reason: Option<String>,
    /// When the claim arrived.
    pub at: Millis,
}

/// Stores a claim with its columns.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert_claim(
    conn: &mut SqliteConnection,
    lease: i64,
    row: &ColumnClaimRow,
    body: &[u8],
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO column_claims (lease, state, digest, policy_version, episodes, failed, refusal_reason, body, at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        lease,
        row.state,
        row.digest,
        row.policy_version,
        row.episodes,
        row.failed,
        row.refusal_reason,
        body,
        row.at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the claim of a lease; none if nothing was claimed.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn claim(conn: &mut SqliteConnection, lease: i64) -> Result<Option<ColumnClaimRow>, StoreError> {
    Ok(sqlx::query_as!(
        ColumnClaimRow,
        r#"SELECT state AS "state: ClaimState", digest, policy_version, episodes, failed, refusal_reason, at
           FROM column_claims WHERE lease = ?"#,
        lease
    )
    .fetch_optional(conn)
    .await?)
}

/// Reads the columns of a lease's claim, as they are stored.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn body(conn: &mut SqliteConnection, lease: i64) -> Result<Option<Vec<u8>>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT body FROM column_claims WHERE lease = ?", lease)
        .fetch_optional(conn)
        .await?)
}

/// Sets the state of a lease's claim, with the reason of a refusal.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn settle(
    conn: &mut SqliteConnection,
    lease: i64,
    state: ClaimState,
    refusal_reason: Option<&str>,
) -> Result<(), StoreError> {
    query!(
        "UPDATE column_claims SET state = ?, refusal_reason = ? WHERE lease = ?",
        state,
        refusal_reason,
        lease
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Stores the claimed scores of audited episodes, by their indices in the lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert_scores(
    conn: &mut SqliteConnection,
    lease: i64,
    scores: &[(i64, f64)],
) -> Result<(), StoreError> {
    for rows in scores.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO audited_scores (lease, number, score) ");
        statement.push_values(rows, |mut values, (number, score)| {
            values.push_bind(lease).push_bind(number).push_bind(score);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the indices of a lease's audited episodes, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn audited(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT number FROM audited_scores WHERE lease = ? ORDER BY number", lease)
        .fetch_all(conn)
        .await?)
}

/// Reads the claimed scores of audited episodes. Episodes that were claimed as failed have none.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn scores(
    conn: &mut SqliteConnection,
    keys: &[EpisodeKey],
) -> Result<BTreeMap<EpisodeKey, f64>, StoreError> {
    let keys = to_json(&keys)?;
    let rows = query!(
        r#"SELECT s.lease AS "lease!", s.number AS "number!", s.score AS "score!: f64" FROM json_each(?) AS place
           CROSS JOIN audited_scores s ON s.lease = place.value ->> 0 AND s.number = place.value ->> 1"#,
        keys
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (EpisodeKey { lease: row.lease, number: row.number }, row.score)).collect())
}

/// Counters of claimed episodes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClaimCounters {
    /// Episodes of accepted claims that finished.
    pub episodes: i64,
    /// Audited ones among these; they are also in the task counters.
    pub audited: i64,
    /// Sum of the scores of `episodes`.
    pub score_sum: f64,
    /// Episodes of accepted claims that failed.
    pub failed: i64,
    /// Episodes of refused claims.
    pub refused: i64,
    /// Episodes of claims whose audited logs never arrived.
    pub unproven: i64,
    /// Episodes of leases that ended unclaimed.
    pub expired: i64,
}

/// Adds to the counters of a run's task at a level.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_counters(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    level: Option<i64>,
    counters: &ClaimCounters,
) -> Result<(), StoreError> {
    let level = level.unwrap_or(-1);
    query!(
        "INSERT INTO claim_counters (run, task, level, episodes, audited, score_sum, failed, refused, unproven, expired)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, level) DO UPDATE SET
             episodes = episodes + excluded.episodes, audited = audited + excluded.audited,
             score_sum = score_sum + excluded.score_sum, failed = failed + excluded.failed,
             refused = refused + excluded.refused, unproven = unproven + excluded.unproven, expired = expired + excluded.expired",
        run,
        task,
        level,
        counters.episodes,
        counters.audited,
        counters.score_sum,
        counters.failed,
        counters.refused,
        counters.unproven,
        counters.expired
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the counters of a run, by task.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn counters(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<BTreeMap<String, ClaimCounters>, StoreError> {
    let rows = query!(
        r#"SELECT task, sum(episodes) AS "episodes!: i64", sum(audited) AS "audited!: i64",
                  sum(score_sum) AS "score_sum!: f64", sum(failed) AS "failed!: i64", sum(refused) AS "refused!: i64",
                  sum(unproven) AS "unproven!: i64", sum(expired) AS "expired!: i64"
           FROM claim_counters WHERE run = ? GROUP BY task ORDER BY task"#,
        run
    )
    .fetch_all(conn)
    .await?;
    let counters = rows.into_iter().map(|r| {
        let counters = ClaimCounters {
            episodes: r.episodes,
            audited: r.audited,
            score_sum: r.score_sum,
            failed: r.failed,
            refused: r.refused,
            unproven: r.unproven,
            expired: r.expired,
        };
        (r.task, counters)
    });
    Ok(counters.collect())
}
