//! The durable queue of proposals.

use std::collections::BTreeSet;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError, to_json};

/// A proposal that waits for its scenario.
#[derive(Debug, Clone)]
pub struct Waiting {
    /// The run.
    pub run: String,
    /// The run's seed.
    pub run_seed: i64,
    /// The seq of the event that proposed it.
    pub seq: i64,
    /// JSON.
    pub body: String,
}

/// The head of a run's queue.
#[derive(Debug, Clone)]
pub struct Queued {
    /// The seq of the event that proposed it.
    pub seq: i64,
    /// JSON.
    pub body: String,
    /// Its scenario, once prepared.
    pub scenario: Option<Vec<u8>>,
    /// Whether that is contested.
    pub contested: Option<i64>,
}

/// Queues proposals: seq and JSON.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    run: &str,
    proposals: &[(i64, String)],
) -> Result<(), StoreError> {
    let proposals = to_json(&proposals)?;
    query!(
        "INSERT INTO proposals (run, seq, state, body)
         SELECT ?, value ->> 0, 'proposed', value ->> 1 FROM json_each(?)",
        run,
        proposals
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Proposals without a scenario, of active runs: each run's in order, the runs in turn.
///
/// # Errors
/// The database's.
pub async fn unprepared(conn: &mut SqliteConnection, limit: i64) -> Result<Vec<Waiting>, StoreError> {
    Ok(sqlx::query_as!(
        Waiting,
        "SELECT p.run, r.seed AS run_seed, p.seq, p.body
         FROM proposals p JOIN runs r ON r.id = p.run
         WHERE p.state = 'proposed' AND r.status = 'active'
         ORDER BY row_number() OVER (PARTITION BY p.run ORDER BY p.seq), p.run LIMIT ?",
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Which of these, by run and seq, still wait for a scenario.
///
/// # Errors
/// The database's.
pub async fn proposed(
    conn: &mut SqliteConnection,
    places: &[(&str, i64)],
) -> Result<BTreeSet<(String, i64)>, StoreError> {
    let places = to_json(&places)?;
    let rows = query!(
        r#"SELECT p.run AS "run!", p.seq AS "seq!" FROM json_each(?) AS place
           CROSS JOIN proposals p ON p.run = place.value ->> 0 AND p.seq = place.value ->> 1
           WHERE p.state = 'proposed'"#,
        places
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.run, row.seq)).collect())
}

/// The scenario of a proposal, and whether it is contested; none where it has none, or is not kept any more.
///
/// # Errors
/// The database's.
pub async fn scenario_of(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
) -> Result<Option<(Vec<u8>, bool)>, StoreError> {
    let row = query!("SELECT scenario, contested FROM proposals WHERE run = ? AND seq = ?", run, seq)
        .fetch_optional(conn)
        .await?;
    Ok(row.and_then(|row| Some((row.scenario?, row.contested.unwrap_or(0) != 0))))
}

/// What was prepared for a proposal.
#[derive(Debug, Clone, Copy)]
pub struct PreparedRow<'a> {
    /// Its run.
    pub run: &'a str,
    /// Its seq.
    pub seq: i64,
    /// The scenario.
    pub scenario: [u8; 32],
    /// Whether that is contested.
    pub contested: bool,
    /// Whether that was planted.
    pub planted: bool,
}

/// Gives proposals their scenarios; nothing happens to one that was dropped meanwhile.
///
/// # Errors
/// The database's.
pub async fn prepared(conn: &mut SqliteConnection, rows: &[PreparedRow<'_>]) -> Result<(), StoreError> {
    for rows in rows.chunks(ROWS) {
        let mut statements = QueryBuilder::new("");
        for row in rows {
            statements.push("UPDATE proposals SET state = 'prepared', scenario = ");
            statements.push_bind(row.scenario.to_vec()).push(", contested = ").push_bind(row.contested);
            statements.push(", planted = ").push_bind(row.planted).push(" WHERE run = ").push_bind(row.run);
            statements.push(" AND seq = ").push_bind(row.seq).push(" AND state = 'proposed'; ");
        }
        statements.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// How many proposals wait, prepared or not. By the index of those: left to itself SQLite goes through all that the run ever
/// proposed.
///
/// # Errors
/// The database's.
pub async fn waiting(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM proposals INDEXED BY proposals_waiting
           WHERE run = ? AND state IN ('proposed', 'prepared')"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// The head of the queue, in order; by that index too.
///
/// # Errors
/// The database's.
pub async fn head(conn: &mut SqliteConnection, run: &str, limit: i64) -> Result<Vec<Queued>, StoreError> {
    Ok(sqlx::query_as!(
        Queued,
        "SELECT seq, body, scenario, contested FROM proposals INDEXED BY proposals_waiting
         WHERE run = ? AND state IN ('proposed', 'prepared') ORDER BY seq LIMIT ?",
        run,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Marks proposals as leased.
///
/// # Errors
/// The database's.
pub async fn leased(conn: &mut SqliteConnection, run: &str, seqs: &[i64]) -> Result<(), StoreError> {
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

/// Offers a leased proposal again, if it was not leased too often; false if it was.
///
/// # Errors
/// The database's.
pub async fn offer_again(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
    most: i64,
) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE proposals SET state = 'prepared' WHERE run = ? AND seq = ? AND state = 'leased' AND attempts < ?",
        run,
        seq,
        most
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Drops proposals that nobody wants any more.
///
/// # Errors
/// The database's.
pub async fn discard(conn: &mut SqliteConnection, run: &str, seqs: &[i64]) -> Result<(), StoreError> {
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
