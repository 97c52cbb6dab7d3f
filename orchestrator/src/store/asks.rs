//! What designers are asked, and what came of it.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// One round of asking a designer, as stored.
#[derive(Debug, Clone, Default)]
pub struct AskRow {
    /// Its number.
    pub id: i64,
    /// The run.
    pub run: String,
    /// The task.
    pub task: String,
    /// The level; none where there are none, and before it has begun.
    pub level: Option<i64>,
    /// `llm` or `procedural`.
    pub designer: String,
    /// `worker` or `hand`.
    pub asked_by: String,
    /// `waiting`, `running`, `done` or `failed`.
    pub state: String,
    /// How many layouts were wanted.
    pub wanted: i64,
    /// How many the gate let through.
    pub admitted: i64,
    /// Of these, by the designer that was asked.
    pub own: i64,
    /// How many it refused.
    pub refused: i64,
    /// The model, where one was asked.
    pub model: Option<String>,
    /// The version of its prompt.
    pub prompt: Option<String>,
    /// Rounds.
    pub rounds: i64,
    /// Tokens in.
    pub tokens_in: i64,
    /// Tokens out.
    pub tokens_out: i64,
    /// What they cost.
    pub cost: f64,
    /// How long it took.
    pub latency_ms: i64,
    /// JSON: the failure profile as it stood.
    pub profile: Option<String>,
    /// Criticised episodes that it rests on.
    pub criticised: Option<i64>,
    /// JSON: what went wrong without ending it.
    pub troubles: String,
    /// Why it failed.
    pub error: Option<String>,
    /// When it was asked.
    pub created_at: Millis,
    /// When it ended.
    pub ended_at: Option<Millis>,
}

/// Stores what is asked, to wait: its number. What can only have happened since is not looked at.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, ask: &AskRow, now: Millis) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"INSERT INTO design_asks (run, task, designer, asked_by, state, wanted, created_at)
           VALUES (?, ?, ?, ?, 'waiting', ?, ?) RETURNING id AS "id!""#,
        ask.run,
        ask.task,
        ask.designer,
        ask.asked_by,
        ask.wanted,
        now
    )
    .fetch_one(conn)
    .await?)
}

/// Begins one that waits, with what it rests on; false if it does not wait any more.
///
/// # Errors
/// The database's.
pub async fn begin(
    conn: &mut SqliteConnection,
    id: i64,
    level: Option<i64>,
    profile: &str,
    criticised: i64,
) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE design_asks SET state = 'running', level = ?, profile = ?, criticised = ?
         WHERE id = ? AND state = 'waiting'",
        level,
        profile,
        criticised,
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Ends one that is not over yet, with what came of it; false if it is. It failed if it says why.
///
/// # Errors
/// The database's.
pub async fn end(conn: &mut SqliteConnection, ended: &AskRow, now: Millis) -> Result<bool, StoreError> {
    let state = if ended.error.is_some() { "failed" } else { "done" };
    let done = query!(
        "UPDATE design_asks SET state = ?, admitted = ?, own = ?, refused = ?, model = ?, prompt = ?, rounds = ?, tokens_in = ?,
             tokens_out = ?, cost = ?, latency_ms = ?, troubles = ?, error = ?, ended_at = ?
         WHERE id = ? AND state IN ('waiting', 'running')",
        state,
        ended.admitted,
        ended.own,
        ended.refused,
        ended.model,
        ended.prompt,
        ended.rounds,
        ended.tokens_in,
        ended.tokens_out,
        ended.cost,
        ended.latency_ms,
        ended.troubles,
        ended.error,
        now,
        ended.id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Fails what was running when the server went away; how many.
///
/// # Errors
/// The database's.
pub async fn interrupt(conn: &mut SqliteConnection, now: Millis) -> Result<u64, StoreError> {
    let done = query!(
        "UPDATE design_asks SET state = 'failed', error = 'interrupted: the server went away', ended_at = ?
         WHERE state = 'running'",
        now
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected())
}

/// The oldest ask that waits, of each run: (ask, run).
///
/// # Errors
/// The database's.
pub async fn waiting(conn: &mut SqliteConnection) -> Result<Vec<(i64, String)>, StoreError> {
    let rows = query!(
        r#"SELECT min(id) AS "id!: i64", run AS "run!" FROM design_asks WHERE state = 'waiting' GROUP BY run ORDER BY run"#
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.id, r.run)).collect())
}

/// All that are running: (ask, run, task).
///
/// # Errors
/// The database's.
pub async fn all_running(conn: &mut SqliteConnection) -> Result<Vec<(i64, String, String)>, StoreError> {
    let rows = query!("SELECT id, run, task FROM design_asks WHERE state = 'running' ORDER BY id")
        .fetch_all(conn)
        .await?;
    Ok(rows.into_iter().map(|r| (r.id, r.run, r.task)).collect())
}

/// How many asks of a run are running: one, if any.
///
/// # Errors
/// The database's.
pub async fn running(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM design_asks WHERE run = ? AND state = 'running'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// How many asks of a run wait or run.
///
/// # Errors
/// The database's.
pub async fn open(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM design_asks WHERE run = ? AND state IN ('waiting', 'running')"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// One ask of a run.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, run: &str, id: i64) -> Result<Option<AskRow>, StoreError> {
    Ok(sqlx::query_as!(
        AskRow,
        "SELECT id, run, task, level, designer, asked_by, state, wanted, admitted, own, refused, model, prompt,
                rounds, tokens_in, tokens_out, cost, latency_ms, profile, criticised, troubles, error, created_at, ended_at
         FROM design_asks WHERE run = ? AND id = ?",
        run,
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Asks of a run, the newest first, before a number.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    (task, state): (Option<&str>, Option<&str>),
    before: i64,
    limit: i64,
) -> Result<Vec<AskRow>, StoreError> {
    Ok(sqlx::query_as!(
        AskRow,
        "SELECT id, run, task, level, designer, asked_by, state, wanted, admitted, own, refused, model, prompt,
                rounds, tokens_in, tokens_out, cost, latency_ms, profile, criticised, troubles, error, created_at, ended_at
         FROM design_asks
         WHERE run = ?1 AND id < ?2 AND (?3 IS NULL OR task = ?3) AND (?4 IS NULL OR state = ?4)
         ORDER BY id DESC LIMIT ?5",
        run,
        before,
        task,
        state,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// What asks of a run took together.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bill {
    /// Asks.
    pub asks: i64,
    /// Those that failed.
    pub failed: i64,
    /// Tokens in.
    pub tokens_in: i64,
    /// Tokens out.
    pub tokens_out: i64,
    /// What they cost.
    pub cost: f64,
}

/// What asks of a run took, by the designer that was asked.
///
/// # Errors
/// The database's.
pub async fn bills(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(String, Bill)>, StoreError> {
    let rows = query!(
        r#"SELECT designer AS "designer!", count(*) AS "asks!: i64", sum(state = 'failed') AS "failed!: i64",
                  sum(tokens_in) AS "tokens_in!: i64", sum(tokens_out) AS "tokens_out!: i64", sum(cost) AS "cost!: f64"
           FROM design_asks WHERE run = ? GROUP BY designer ORDER BY designer"#,
        run
    )
    .fetch_all(conn)
    .await?;
    let bills = rows.into_iter().map(|r| {
        let bill = Bill {
            asks: r.asks,
            failed: r.failed,
            tokens_in: r.tokens_in,
            tokens_out: r.tokens_out,
            cost: r.cost,
        };
        (r.designer, bill)
    });
    Ok(bills.collect())
}

/// What language models took, by run and day.
#[derive(Debug, Clone, PartialEq)]
pub struct SpentRow {
    /// The run.
    pub run: String,
    /// Days since 1970 UTC.
    pub day: i64,
    /// Tokens, in and out.
    pub tokens: i64,
    /// What they cost.
    pub cost: f64,
}

/// What language models took so far, by run and day.
///
/// # Errors
/// The database's.
pub async fn spent(conn: &mut SqliteConnection) -> Result<Vec<SpentRow>, StoreError> {
    Ok(sqlx::query_as!(
        SpentRow,
        r#"SELECT run AS "run!", created_at / 86400000 AS "day!: i64", sum(tokens_in + tokens_out) AS "tokens!: i64",
                  sum(cost) AS "cost!: f64"
           FROM design_asks WHERE designer = 'llm' GROUP BY run, created_at / 86400000 ORDER BY run"#
    )
    .fetch_all(conn)
    .await?)
}

/// How an ask that is over went.
#[derive(Debug, Clone, PartialEq)]
pub struct Over {
    /// When it ended.
    pub at: Millis,
    /// How many layouts of the designer that was asked were let through.
    pub own: i64,
}

/// The last asks of a run's task that are over, the newest first.
///
/// # Errors
/// The database's.
pub async fn lately(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    limit: i64,
) -> Result<Vec<Over>, StoreError> {
    Ok(sqlx::query_as!(
        Over,
        r#"SELECT coalesce(ended_at, created_at) AS "at!: i64", own FROM design_asks
           WHERE run = ? AND task = ? AND state IN ('done', 'failed') ORDER BY id DESC LIMIT ?"#,
        run,
        task,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// The failure profile that the last ask of a run's task rested on, and how many criticised episodes that rested on.
///
/// # Errors
/// The database's.
pub async fn last_profile(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Option<(String, i64)>, StoreError> {
    let row = query!(
        r#"SELECT profile AS "profile!", criticised AS "criticised!" FROM design_asks
           WHERE run = ? AND task = ? AND profile IS NOT NULL AND criticised IS NOT NULL ORDER BY id DESC LIMIT 1"#,
        run,
        task
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.map(|r| (r.profile, r.criticised)))
}
