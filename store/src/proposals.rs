//! The durable queue of proposals. Table `proposals`.

use std::collections::BTreeSet;

use serde::{Serialize, Serializer};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError, to_json};

/// Key of a proposal. It is serialised as `[run, seq]`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProposalKey {
    /// Id of the run.
    pub run: String,
    /// Sequence number of the event that proposed it.
    pub seq: i64,
}

impl Serialize for ProposalKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (&self.run, self.seq).serialize(serializer)
    }
}

/// A proposal to be stored.
#[derive(Debug, Clone)]
pub struct NewProposal {
    /// Sequence number of the event that proposed it.
    pub seq: i64,
    /// The proposal as JSON.
    pub body: String,
}

/// A proposal that waits for its scenario.
#[derive(Debug, Clone)]
pub struct UnpreparedProposal {
    /// Id of the run.
    pub run: String,
    /// Seed of the run.
    pub run_seed: i64,
    /// Sequence number of the event that proposed it.
    pub seq: i64,
    /// The proposal as JSON.
    pub body: String,
}

/// A proposal at the head of its run's queue.
#[derive(Debug, Clone)]
pub struct QueuedProposal {
    /// Sequence number of the event that proposed it.
    pub seq: i64,
    /// The proposal as JSON.
    pub body: String,
    /// Id of the scenario, once it is prepared.
    pub scenario: Option<Vec<u8>>,
    /// True if the scenario is contested.
    pub is_contested: Option<bool>,
    /// Number of times that the proposal was leased before.
    pub attempts: i64,
}

/// Scenario of a proposal.
#[derive(Debug, Clone)]
pub struct ProposalScenario {
    /// Id of the scenario.
    pub id: Vec<u8>,
    /// True if the scenario is contested.
    pub is_contested: bool,
}

/// Reads the highest sequence number of the proposals of a run; none if it has no proposal.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn last_seq(conn: &mut SqliteConnection, run: &str) -> Result<Option<i64>, StoreError> {
    let last = sqlx::query_scalar!(r#"SELECT max(seq) AS "seq: i64" FROM proposals WHERE run = ?"#, run);
    Ok(last.fetch_one(conn).await?)
}

/// Adds proposals to the queue of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    run: &str,
    proposals: &[NewProposal],
) -> Result<(), StoreError> {
    let rows: Vec<_> = proposals.iter().map(|proposal| (proposal.seq, &proposal.body)).collect();
    let rows = to_json(&rows)?;
    query!(
        "INSERT INTO proposals (run, seq, state, body)
         SELECT ?, value ->> 0, 'proposed', value ->> 1 FROM json_each(?)",
        run,
        rows
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads proposals of active runs that have no scenario yet: each run's in order, and the runs in turn.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn unprepared(
    conn: &mut SqliteConnection,
    limit: i64,
) -> Result<Vec<UnpreparedProposal>, StoreError> {
    Ok(sqlx::query_as!(
        UnpreparedProposal,
        "SELECT p.run, r.seed AS run_seed, p.seq, p.body
         FROM proposals p JOIN runs r ON r.id = p.run
         WHERE p.state = 'proposed' AND r.status = 'active'
         ORDER BY row_number() OVER (PARTITION BY p.run ORDER BY p.seq), p.run LIMIT ?",
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads which of these proposals still wait for a scenario.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn unprepared_among(
    conn: &mut SqliteConnection,
    keys: &[ProposalKey],
) -> Result<BTreeSet<ProposalKey>, StoreError> {
    let keys = to_json(&keys)?;
    let rows = sqlx::query_as!(
        ProposalKey,
        r#"SELECT p.run AS "run!", p.seq AS "seq!" FROM json_each(?) AS place
           CROSS JOIN proposals p ON p.run = place.value ->> 0 AND p.seq = place.value ->> 1
           WHERE p.state = 'proposed'"#,
        keys
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().collect())
}

/// Reads the scenario of a proposal; none if it is not prepared, or was deleted.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn scenario_of(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
) -> Result<Option<ProposalScenario>, StoreError> {
    let row = query!(
        r#"SELECT scenario, is_contested AS "is_contested: bool" FROM proposals WHERE run = ? AND seq = ?"#,
        run,
        seq
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.and_then(|row| {
        Some(ProposalScenario { id: row.scenario?, is_contested: row.is_contested.unwrap_or(false) })
    }))
}

/// A proposal that is leased.
#[derive(Debug, Clone)]
pub struct LeasedProposal {
    /// Sequence number of the event that proposed it.
    pub seq: i64,
    /// The proposal as JSON.
    pub body: String,
    /// Number of times that the proposal was leased, this time included.
    pub attempts: i64,
}

/// Reads proposals of a run by their sequence numbers, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get_many(
    conn: &mut SqliteConnection,
    run: &str,
    seqs: &[i64],
) -> Result<Vec<LeasedProposal>, StoreError> {
    let seqs = to_json(&seqs)?;
    Ok(sqlx::query_as!(
        LeasedProposal,
        r#"SELECT p.seq AS "seq!", p.body AS "body!", p.attempts AS "attempts!: i64" FROM json_each(?1) AS place
           CROSS JOIN proposals p ON p.run = ?2 AND p.seq = place.value ORDER BY p.seq"#,
        seqs,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// The scenario that was prepared for a proposal.
#[derive(Debug, Clone, Copy)]
pub struct PreparedProposal<'a> {
    /// Id of the run.
    pub run: &'a str,
    /// Sequence number of the event that proposed it.
    pub seq: i64,
    /// Id of the scenario.
    pub scenario: [u8; 32],
    /// True if the scenario is contested.
    pub is_contested: bool,
    /// True if a threat was placed to make it contested.
    pub is_planted: bool,
}

/// Sets the scenarios of proposals. Proposals that were dropped meanwhile stay as they are.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn set_prepared(
    conn: &mut SqliteConnection,
    rows: &[PreparedProposal<'_>],
) -> Result<(), StoreError> {
    for rows in rows.chunks(MAX_ROWS) {
        let mut statements = QueryBuilder::new("");
        for row in rows {
            statements.push("UPDATE proposals SET state = 'prepared', scenario = ");
            statements.push_bind(row.scenario.to_vec()).push(", is_contested = ").push_bind(row.is_contested);
            statements.push(", is_planted = ").push_bind(row.is_planted);
            statements.push(" WHERE run = ").push_bind(row.run);
            statements.push(" AND seq = ").push_bind(row.seq).push(" AND state = 'proposed'; ");
        }
        statements.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Counts the waiting proposals of a run, prepared or not.
///
/// The statement names its index: by itself SQLite would read all proposals that the run ever had.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_waiting(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM proposals INDEXED BY proposals_waiting
           WHERE run = ? AND state IN ('proposed', 'prepared')"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Reads the head of a run's queue, in order. The statement names its index, as [`count_waiting`] does.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn head(
    conn: &mut SqliteConnection,
    run: &str,
    limit: i64,
) -> Result<Vec<QueuedProposal>, StoreError> {
    Ok(sqlx::query_as!(
        QueuedProposal,
        r#"SELECT seq, body, scenario, is_contested AS "is_contested: bool", attempts FROM proposals INDEXED BY proposals_waiting
           WHERE run = ? AND state IN ('proposed', 'prepared') ORDER BY seq LIMIT ?"#,
        run,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Marks proposals as leased, and counts the attempt.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_leased(conn: &mut SqliteConnection, run: &str, seqs: &[i64]) -> Result<(), StoreError> {
    let seqs = to_json(&seqs)?;
    query!(
        "UPDATE proposals SET state = 'leased', attempts = attempts + 1
         WHERE run = ? AND seq IN (SELECT value FROM json_each(?))",
        run,
        seqs
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Puts a leased proposal back into the queue, if it was leased fewer than `max_attempts` times. Returns true if it was put back.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn offer_again(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
    max_attempts: i64,
) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE proposals SET state = 'prepared' WHERE run = ? AND seq = ? AND state = 'leased' AND attempts < ?",
        run,
        seq,
        max_attempts
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Puts leased proposals back into the queue as if they had not been leased: no trainer received their scenarios.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn return_unseen(conn: &mut SqliteConnection, run: &str, seqs: &[i64]) -> Result<(), StoreError> {
    let seqs = to_json(&seqs)?;
    query!(
        "UPDATE proposals SET state = 'prepared', attempts = attempts - 1
         WHERE run = ? AND state = 'leased' AND seq IN (SELECT value FROM json_each(?))",
        run,
        seqs
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Drops proposals that are out of date.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn drop_all(conn: &mut SqliteConnection, run: &str, seqs: &[i64]) -> Result<(), StoreError> {
    let seqs = to_json(&seqs)?;
    query!(
        "UPDATE proposals SET state = 'dropped' WHERE run = ? AND seq IN (SELECT value FROM json_each(?))",
        run,
        seqs
    )
    .execute(conn)
    .await?;
    Ok(())
}
