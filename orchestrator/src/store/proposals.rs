//! The durable queue of proposals.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};

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

/// Queues a proposal.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, run: &str, seq: i64, body: &str) -> Result<(), StoreError> {
    query!("INSERT INTO proposals (run, seq, state, body) VALUES (?, ?, 'proposed', ?)", run, seq, body)
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

/// Gives a proposal its scenario; nothing happens to one that was dropped meanwhile.
///
/// # Errors
/// The database's.
pub async fn prepared(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
    scenario: &[u8],
    contested: bool,
    planted: bool,
) -> Result<(), StoreError> {
    query!(
        "UPDATE proposals SET state = 'prepared', scenario = ?, contested = ?, planted = ?
         WHERE run = ? AND seq = ? AND state = 'proposed'",
        scenario,
        contested,
        planted,
        run,
        seq
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// How many proposals wait, prepared or not.
///
/// # Errors
/// The database's.
pub async fn waiting(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM proposals WHERE run = ? AND state IN ('proposed', 'prepared')"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// The head of the queue, in order.
///
/// # Errors
/// The database's.
pub async fn head(conn: &mut SqliteConnection, run: &str, limit: i64) -> Result<Vec<Queued>, StoreError> {
    Ok(sqlx::query_as!(
        Queued,
        "SELECT seq, body, scenario, contested FROM proposals
         WHERE run = ? AND state IN ('proposed', 'prepared') ORDER BY seq LIMIT ?",
        run,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Marks a proposal as leased.
///
/// # Errors
/// The database's.
pub async fn leased(conn: &mut SqliteConnection, run: &str, seq: i64) -> Result<(), StoreError> {
    query!(
        "UPDATE proposals SET state = 'leased', attempts = attempts + 1 WHERE run = ? AND seq = ?",
        run,
        seq
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

/// Drops a proposal that nobody wants any more.
///
/// # Errors
/// The database's.
pub async fn discard(conn: &mut SqliteConnection, run: &str, seq: i64) -> Result<(), StoreError> {
    query!("UPDATE proposals SET state = 'dropped' WHERE run = ? AND seq = ?", run, seq)
        .execute(conn)
        .await?;
    Ok(())
}

/// Proposals' JSON, by their seqs.
///
/// # Errors
/// The database's.
pub async fn bodies(
    conn: &mut SqliteConnection,
    run: &str,
    seqs: &[i64],
) -> Result<BTreeMap<i64, String>, StoreError> {
    let seqs = to_json(&seqs)?;
    let rows = query!(
        "SELECT seq, body FROM proposals WHERE run = ? AND seq IN (SELECT value FROM json_each(?))",
        run,
        seqs
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.seq, row.body)).collect())
}
